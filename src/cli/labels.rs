//! The option `--labels`: cells that another program has told apart.

use crate::cli::input::{check_read, open_beside};
use crate::cli::same_place::{parts_of_other, same_place};
use crate::convert::{CellRows, Labels};
use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype, Endian, Frame};
use crate::progress::Progress;
use crate::volume::{self, Header, Headerless, OpenOptions, Opened, Stamp, file_name};
use std::path::Path;

/// Opens and reads the labels of the voxels of a volume, which lies in this world.
///
/// # Errors
/// Those of opening a volume and of [`CellRows::of_labels`]; [`Error::InputChanged`].
pub fn read_labels(
    path: &Path,
    (header, frame): (&Header, Frame),
    progress: &dyn Progress,
) -> Result<Labels> {
    let dims = header.dims;
    let (opened, stamp) = open(path, dims)?;
    if dims == opened.volume.header().dims {
        same_place(
            "--labels",
            "labels",
            path,
            &opened,
            (&header.placement, frame),
        )?;
    }
    let kept_in = std::env::temp_dir();
    let (rows, checksum) = CellRows::of_labels(&*opened.volume, dims, &kept_in, progress)?;
    check_read(&stamp, progress)?;
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

/// Opens a volume of labels for one of this size, with what tells any change to it from then on.
///
/// # Errors
/// Those of opening a volume.
pub fn open(path: &Path, dims: Dims) -> Result<(Opened, Stamp)> {
    let opened = || volume::open(path, &options(path, dims));
    open_beside(path, opened).map_err(|error| match &error {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Placement;

    /// Writes to a file when its first slice has been read.
    struct Writer<'a>(&'a Path);

    impl Progress for Writer<'_> {
        fn advance(&self, _: u64) {
            std::fs::write(self.0, [2; 4 * 3 * 2 + 1]).unwrap();
        }
    }

    #[test]
    fn labels_that_change_while_they_are_read_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("labels.raw");
        std::fs::write(&path, [1; 4 * 3 * 2]).unwrap();
        let header = Header {
            format: "raw",
            endian: Endian::Little,
            dims: Dims([4, 3, 2]),
            dtype: Dtype::U8,
            placement: Placement::default(),
        };
        let read = read_labels(&path, (&header, Frame::Unstated), &crate::progress::Quiet);
        assert_eq!(read.unwrap().rows.largest(), 1);
        let read = read_labels(&path, (&header, Frame::Unstated), &Writer(&path));
        assert!(matches!(read, Err(Error::InputChanged { .. })), "{read:?}");
    }
}
