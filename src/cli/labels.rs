//! The option `--labels`: cells that another program has told apart.

use crate::cli::same_place::{parts_of_other, same_place};
use crate::convert::{CellRows, Labels};
use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype, Endian};
use crate::progress::Progress;
use crate::volume::{self, Header, Headerless, OpenOptions, file_name};
use std::path::Path;

/// Opens and reads the labels of the voxels of a volume.
///
/// # Errors
/// Those of opening a volume and of [`CellRows::of_labels`].
pub fn read_labels(path: &Path, header: &Header, progress: &dyn Progress) -> Result<Labels> {
    let dims = header.dims;
    let opened = volume::open(path, &options(path, dims))
        .map_err(|e| parts_of_other(e, "--labels", "the labels", path))?;
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

/// How to open them: a raw file is of the type that its size makes it.
fn options(path: &Path, dims: Dims) -> OpenOptions {
    let bytes = path.metadata().map_or(0, |found| found.len());
    let dtype = match bytes / dims.voxels() {
        2 => Dtype::U16,
        4 => Dtype::U32,
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
