//! A volume in memory.

use super::{Endian, Header, Volume, Voxel};
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use std::ops::Range;

/// Samples in a vector, x fastest: for callers that have the volume already, and for tests.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryVolume<T> {
    header: Header,
    samples: Vec<T>,
}

impl<T: Voxel> MemoryVolume<T> {
    /// Takes `dims.voxels()` samples.
    ///
    /// # Errors
    /// [`Error::Usage`] if the number of samples is another, `dims` is out of range, or the
    /// placement is impossible.
    pub fn new(dims: Dims, placement: Placement, samples: Vec<T>) -> Result<Self> {
        let dims = Dims::new(dims.0.map(u64::from))?;
        placement.check()?;
        if samples.len() as u64 != dims.voxels() {
            return Err(Error::usage(
                "samples",
                samples.len().to_string(),
                format!("{} for {dims} voxels", dims.voxels()),
            ));
        }
        let header = Header {
            format: "memory",
            dims,
            dtype: T::DTYPE,
            endian: Endian::NATIVE,
            placement,
        };
        Ok(MemoryVolume { header, samples })
    }

    /// The samples, x fastest.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }
}

impl<T: Voxel> Volume for MemoryVolume<T> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.samples);
        let sample = size_of::<T>();
        let rows = z.flat_map(|k| y.clone().map(move |j| (j, k)));
        for ((j, k), row) in rows.zip(out.chunks_exact_mut(x.len() * sample)) {
            let at = self.header.dims.linear([x.start, j, k]) as usize * sample;
            row.copy_from_slice(&bytes[at..at + row.len()]);
        }
        Ok(())
    }
}
