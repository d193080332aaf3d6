//! The option `--labels`: cells that another program has told apart.

use crate::cli::same_place::{parts_of_other, same_place};
use crate::convert::{CellRows, Labels};
use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype, Endian};
use crate::progress::Progress;
use crate::volume::{self, Header, Headerless, OpenOptions, Opened, file_name};
use std::path::Path;

/// Opens and reads the labels of the voxels of a volume.
///
/// # Errors
/// Those of opening a volume and of [`CellRows::of_labels`].
pub fn read_labels(path: &Path, header: &Header, progress: &dyn Progress) -> Result<Labels> {
    let dims = header.dims;
    let opened = open(path, dims)?;
    if dims == opened.volume.header().dims {
        same_place("--labels", "labels", path, &opened, &header.placement)?;
    }
    let kept_in = std::env::temp_dir();
    let (rows, checksum) = CellRows::of_labels(&*opened.volume, dims, &kept_in, progress)?;
    if rows.largest() == 0 {
        let expected = "some that are not 0, which are those of cells";
        return Err(Error::usage("--labels", "labels that are all 0", expected));
    }
    Ok(Labels {
        file: file_name(path),
        checksum,
        rows,
    })
}

/// What to do with labels of 64 bits.
const NARROWER: &str = "save them with 32 bits if they are below 2^32, in Python with numpy.save('labels.npy', \
    labels.astype('uint32')), or number them anew";

/// Opens a volume of labels for one of this size.
///
/// # Errors
/// Those of opening a volume.
pub fn open(path: &Path, dims: Dims) -> Result<Opened> {
    volume::open(path, &options(path, dims)).map_err(|error| match &error {
        // what a format advises for types that it does not take: numbers with a fraction are no labels
        Error::Unsupported { hint, .. }
            if ["f64", "double", "loat64"].iter().any(|t| hint.contains(t)) =>
        {
            error.with_hint(NARROWER)
        }
        _ => parts_of_other(error, "--labels", "the labels", path),
    })
}

/// How to open them: a raw file is of the type that its size makes it.
fn options(path: &Path, dims: Dims) -> OpenOptions {
    let bytes = path.metadata().map_or(0, |found| found.len());
    let dtype = match bytes / dims.voxels() {
        2 => Dtype::U16,
        4 => Dtype::U32,
        // refused by its type, as whole numbers of this size are in files that state one
        8 => Dtype::F64,
        _ => Dtype::U8,
    };
    OpenOptions {
        headerless: Some(Headerless {
            dims: dims.0.map(u64::from),
            dtype,
            endian: Endian::Little,
            offset: 0,
        }),
        ..OpenOptions::default()
    }
}
