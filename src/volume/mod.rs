//! Volumes on disk: what is known of them before reading, and reading any box of voxels.

mod dtype;

pub(crate) use dtype::with_voxel_type;
pub use dtype::{Dtype, Voxel};

use crate::error::Result;
use crate::grid::{Dims, Placement};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Byte order of samples of more than one byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// What a volume says of itself, after options have overridden it.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Name of the file format: `raw`, `metaimage`, `nrrd`.
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
    /// [`crate::Error::Io`] or [`crate::Error::Format`] if the bytes cannot be had.
    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()>;

    /// False for compressed streams, which read slices forward fast and anything else slowly; they
    /// are spooled to an uncompressed temporary file before a sweep that must read twice.
    fn random_access(&self) -> bool {
        true
    }

    /// Says that the sweep will soon read these slices, so that the system can fetch them ahead.
    fn prefetch(&self, _z: Range<u32>) {}

    /// Says that the sweep is done with these slices: mapped pages are given back to the system.
    fn release(&self, _z: Range<u32>) {}
}
