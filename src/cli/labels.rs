//! The option `--labels`: cells that another program has told apart.

use crate::cli::input::{check_read, open_beside};
use crate::cli::same_place::{parts_of_other, same_place};
use crate::convert::{CellRows, LabelRows, LabelSums, LabelVolume, Labels, check_read_beside};
use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype, Endian, Frame};
use crate::progress::Progress;
use crate::volume::{self, Headerless, OpenOptions, Opened, Stamp, Volume, file_name};
use std::path::Path;

/// Opens and reads the labels of the voxels of a volume, which lies in this world, in at most so many bytes of memory.
///
/// # Errors
/// Those of opening a volume and of [`CellRows::of_labels`]; [`Error::InputChanged`]; [`Error::Memory`].
pub fn read_labels(
    path: &Path,
    place: (&dyn Volume, Frame),
    memory: u64,
    progress: &dyn Progress,
) -> Result<Labels> {
    let dims = place.0.header().dims;
    let (opened, stamp) = open_in(path, place, memory, progress)?;
    let kept_in = std::env::temp_dir();
    let (rows, checksum) = CellRows::of_labels(&*opened.volume, dims, &kept_in, progress)?;
    check_read(&stamp, progress)?;
    check_any(rows.largest())?;
    Ok(Labels {
        file: file_name(path),
        checksum,
        rows: rows.into(),
    })
}

/// The same for parts, of which each reads those of its own slices: here all of them are read, and none is kept.
///
/// # Errors
/// As of [`read_labels`]; [`Error::Usage`] if slices cannot be read by themselves.
pub fn labels_of_parts(
    path: &Path,
    place: (&dyn Volume, Frame),
    memory: u64,
    progress: &dyn Progress,
) -> Result<Labels> {
    let dims = place.0.header().dims;
    let (opened, stamp) = open_in(path, place, memory, progress)?;
    if !opened.volume.random_access() {
        let found = format!("{}, which is packed as one stream", path.display());
        let expected = "labels of which each part can read its own";
        return Err(Error::usage("--labels", found, expected)
            .with_hint("unpack it first, as by `gunzip -k` or `zstd -d`"));
    }
    let sums = LabelSums::of(&*opened.volume, dims, progress)?;
    check_read(&stamp, progress)?;
    check_any(sums.largest)?;
    Ok(on_demand(path, opened, stamp, &sums))
}

/// Labels that were read before, for parts.
///
/// # Errors
/// Those of opening a volume.
pub fn known_labels(path: &Path, dims: Dims, sums: &LabelSums) -> Result<Labels> {
    let (opened, stamp) = open(path, dims)?;
    let found = opened.volume.header().dims;
    if found != dims {
        let found = format!("labels of {found} voxels");
        let expected = format!("{dims}, as they had when the plan was made");
        return Err(Error::usage("--labels", found, expected));
    }
    Ok(on_demand(path, opened, stamp, sums))
}

fn on_demand(path: &Path, opened: Opened, stamp: Stamp, sums: &LabelSums) -> Labels {
    Labels {
        file: file_name(path),
        checksum: sums.checksum.clone(),
        rows: LabelRows::OnDemand(Box::new(LabelVolume {
            volume: opened.volume.into(),
            largest: sums.largest,
            stamp,
        })),
    }
}

/// Opens the labels of a volume, which lies in this world, to be read in at most so many bytes of memory.
fn open_in(
    path: &Path,
    (volume, frame): (&dyn Volume, Frame),
    memory: u64,
    progress: &dyn Progress,
) -> Result<(Opened, Stamp)> {
    let header = volume.header();
    let (opened, stamp) = open(path, header.dims)?;
    check_read_beside(volume, &*opened.volume, "--labels", memory)?;
    if opened.volume.header().format == "raw" {
        progress.warn(&format!(
            "the labels {} state no type: they are read as {}, by their size, and in little endian if they have more bytes than one",
            path.display(),
            opened.volume.header().dtype
        ));
    }
    if header.dims == opened.volume.header().dims {
        let place = (&header.placement, frame);
        same_place("--labels", "labels", path, &opened, place)?;
    }
    Ok((opened, stamp))
}

/// Refuses labels of which none is of a cell.
fn check_any(largest: u64) -> Result<()> {
    if largest == 0 {
        let expected = "some that are not 0, which are those of cells";
        return Err(Error::usage("--labels", "labels that are all 0", expected));
    }
    Ok(())
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
            supposed: true,
        }),
        ..OpenOptions::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Placement;
    use crate::volume::MemoryVolume;

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
        let scan = MemoryVolume::new(Dims([4, 3, 2]), Placement::default(), vec![0u8; 24]).unwrap();
        let read = |progress: &dyn Progress| {
            read_labels(&path, (&scan, Frame::Unstated), u64::MAX, progress)
        };
        let LabelRows::Read(rows) = read(&crate::progress::Quiet).unwrap().rows else {
            panic!("rows that are kept");
        };
        assert_eq!(rows.largest(), 1);
        let read = read(&Writer(&path));
        assert!(matches!(read, Err(Error::InputChanged { .. })), "{read:?}");
    }
}
