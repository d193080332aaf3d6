//! Volumes on disk: what is known of them before reading, and reading any box of voxels.

pub(crate) mod adapters;
mod codecs;
#[cfg(test)]
mod conformance;
mod descriptor;
mod filters;
mod format;
mod formats;
pub(crate) mod io;
mod memory;
pub(crate) mod open;
mod options;
mod region;
mod registry;
pub(crate) mod stamp;
mod stated;
pub(crate) mod stats;

pub(crate) use crate::grid::with_voxel_type;
pub use crate::grid::{Dtype, Endian, Slope, Voxel};
pub use adapters::crop::Cropped;
pub(crate) use adapters::decompress::spool_beside;
pub(crate) use adapters::kind::{Watch, Watched};
pub(crate) use adapters::temp_copy::PIECE as SPOOL_PIECE;
pub use adapters::temp_copy::spool;
pub use filters::filtered;
pub use filters::median::Medianed;
pub use filters::smooth::Smoothed;
pub use memory::MemoryVolume;
pub use open::{file_name, open, stem};
pub use options::{Headerless, Io, OpenOptions, Opened};
pub(crate) use region::row_words;
pub use region::{Filled, RegionVoxels};
pub use registry::input_help;
pub use stamp::{Before, Stamp, stamp};
pub(crate) use stated::place::place;
pub use stats::cylinder::{FoundCylinder, find_cylinder};
pub use stats::estimate::{Prediction, predict};
pub use stats::fill_value::fill_value;
pub(crate) use stats::inside::measured_voxels;
pub use stats::statistics::{Statistics, statistics};
pub use stats::threshold::ThresholdMethod;

use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use std::ops::Range;
use std::path::Path;

/// What a volume says of itself, after options have overridden it.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Name of the file format: `raw`, `metaimage`, `nrrd`, `tiff`, `png`, `nifti`, `numpy`, `vti`,
    /// `dicom`, `zarr`, `hdf5`, `bmp`, `vgi`, `xtekct`, `pyhst`, `pcr`, `isq`, `aim`, `amiramesh`, `mrc`, `analyze`.
    pub format: &'static str,
    /// Size in voxels.
    pub dims: Dims,
    /// Sample type.
    pub dtype: Dtype,
    /// Byte order on disk (samples are handed out in the machine's order).
    pub endian: Endian,
    /// Spacing, unit, origin and directions.
    pub placement: Placement,
}

/// A volume that hands out any box of voxels. Implementations are shared between threads.
pub trait Volume: Send + Sync {
    /// Size, type and place.
    fn header(&self) -> &Header;

    /// Reads the box `x` by `y` by `z` (half-open voxel ranges inside the volume) into `out`,
    /// x fastest, in the machine's byte order. `out` has exactly the box's bytes.
    ///
    /// # Errors
    /// [`crate::Error::Io`] or [`crate::Error::Format`] if the bytes cannot be had;
    /// [`crate::Error::Usage`] if the box or the size of `out` is not as said above.
    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        check_box(self.header(), [&x, &y, &z], out.len())?;
        match out.is_empty() {
            true => Ok(()),
            false => self.fill_box(x, y, z, out),
        }
    }

    /// What [`read_box`](Self::read_box) does, for a box of at least one voxel that lies inside the volume and an
    /// `out` of its size: implementations need not look at either again, and others do not call it.
    ///
    /// # Errors
    /// [`crate::Error::Io`] or [`crate::Error::Format`] if the bytes cannot be had.
    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()>;

    /// False for compressed streams, which read slices forward fast and anything else slowly; they
    /// are spooled to an uncompressed temporary file for a sweep that must read twice.
    fn random_access(&self) -> bool {
        true
    }

    /// The same volume for a sweep forward through boxes that overlap: chunks and pages are decoded once
    /// and kept, until they are released, in an unnamed file in `dir`. `None` if boxes that overlap cost
    /// little more than others.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the file cannot be made.
    fn decoded_once(&self, _dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        Ok(None)
    }

    /// Voxels along x, y and z of the parts that are decoded together: boxes at multiples of it are
    /// read with the least work.
    fn grain(&self) -> [u32; 3] {
        [1; 3]
    }

    /// The most memory that the volume keeps for itself besides what it hands out, in bytes: the
    /// window of a compressed stream. Mapped pages are not counted.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// Bytes of mapped pages that reading these slices leaves resident until they are released.
    fn mapped_bytes(&self, _z: Range<u32>) -> u64 {
        0
    }

    /// The voxels of row `y` of slice `z` that were measured, where others only fill the grid up; `None` if all were.
    fn measured(&self, _y: u32, _z: u32) -> Option<Range<u32>> {
        None
    }

    /// Says that the sweep will soon read these slices, so that the system can fetch them ahead.
    fn prefetch(&self, _z: Range<u32>) {}

    /// Says that the sweep is done with these slices: mapped pages are given back to the system.
    fn release(&self, _z: Range<u32>) {}
}

impl<V: Volume + ?Sized> Volume for &V {
    fn header(&self) -> &Header {
        (**self).header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        (**self).fill_box(x, y, z, out)
    }

    fn random_access(&self) -> bool {
        (**self).random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        (**self).decoded_once(dir)
    }

    fn grain(&self) -> [u32; 3] {
        (**self).grain()
    }

    fn held_bytes(&self) -> u64 {
        (**self).held_bytes()
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        (**self).mapped_bytes(z)
    }

    fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
        (**self).measured(y, z)
    }

    fn prefetch(&self, z: Range<u32>) {
        (**self).prefetch(z);
    }

    fn release(&self, z: Range<u32>) {
        (**self).release(z);
    }
}

/// For a volume around another one, in its field `$inner`: what that one answers for both.
macro_rules! hand_on {
    ($inner:ident) => {
        fn random_access(&self) -> bool {
            self.$inner.random_access()
        }

        fn grain(&self) -> [u32; 3] {
            self.$inner.grain()
        }

        fn mapped_bytes(&self, z: Range<u32>) -> u64 {
            self.$inner.mapped_bytes(z)
        }

        fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
            self.$inner.measured(y, z)
        }

        fn prefetch(&self, z: Range<u32>) {
            self.$inner.prefetch(z);
        }

        fn release(&self, z: Range<u32>) {
            self.$inner.release(z);
        }
    };
}
use hand_on;

/// Checks that a box lies inside a volume and that the caller's buffer of `out` bytes has its size.
fn check_box(header: &Header, ranges: [&Range<u32>; 3], out: usize) -> Result<()> {
    let inside = ranges
        .iter()
        .zip(header.dims.0)
        .all(|(r, n)| r.start <= r.end && r.end <= n);
    let bytes = ranges
        .iter()
        .try_fold(header.dtype.bytes(), |n, r| n.checked_mul(r.len()));
    if inside && bytes == Some(out) {
        return Ok(());
    }
    let [x, y, z] = ranges;
    Err(Error::usage(
        "read_box",
        format!("box {x:?}, {y:?}, {z:?} and a buffer of {out} bytes"),
        format!(
            "a box inside {} of {} and a buffer of its size",
            header.dims, header.dtype
        ),
    ))
}
