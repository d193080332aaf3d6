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

/// A volume in memory.
#[derive(Debug, Clone)]
pub struct MemoryVolume<T> {
    header: Header,
    samples: Vec<T>,
}

impl<T: Voxel> MemoryVolume<T> {
    /// Takes `samples`, x fastest.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if their number is not that of `dims`.
    pub fn new(dims: Dims, placement: Placement, samples: Vec<T>) -> Result<Self> {
        let header = Header {
            format: "memory",
            dims,
            dtype: T::DTYPE,
            endian: Endian::Little,
            placement,
        };
        Ok(MemoryVolume { header, samples })
    }
}

impl<T: Voxel> Volume for MemoryVolume<T> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let mut rows = out.chunks_exact_mut(x.len() * std::mem::size_of::<T>());
        for z in z {
            for y in y.clone() {
                let start = self.header.dims.linear([x.start, y, z]) as usize;
                let row = bytemuck::cast_slice(&self.samples[start..start + x.len()]);
                rows.next()
                    .expect("out has the box's size")
                    .copy_from_slice(row);
            }
        }
        Ok(())
    }
}
