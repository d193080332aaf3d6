//! A NumPy array as a volume, where it is.

use super::gather::Samples;
use super::{Known, header};
use alvis::Result;
use alvis::grid::Placement;
use alvis::volume::{Header, Volume};
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::ops::Range;

/// The samples of an array, with any strides. The array lives as long as this does; whoever writes to it meanwhile gets
/// tiles of neither state.
pub struct ArrayVolume {
    header: Header,
    samples: Samples,
    _owner: Py<PyUntypedArray>,
}

// SAFETY: the memory is that of an array which this owns a reference to; it is only read, by way of raw pointers, and no
// reference to it is ever made, so that the array may be written to by others, whatever they read then.
unsafe impl Send for ArrayVolume {}
// SAFETY: as above
unsafe impl Sync for ArrayVolume {}

impl ArrayVolume {
    /// Of an array with the axes z, y, x.
    ///
    /// # Errors
    /// Those of [`header`].
    pub fn new(array: &Bound<'_, PyUntypedArray>) -> Result<Self> {
        let Known { header, stored } = header(array.shape(), &array.dtype())?;
        Ok(ArrayVolume {
            header,
            samples: samples(array, stored),
            _owner: array.clone().unbind(),
        })
    }

    /// The same in another place.
    pub fn placed(mut self, placement: Placement) -> Self {
        self.header.placement = placement;
        self
    }

    /// What differs whenever the samples do.
    ///
    /// # Errors
    /// Those of reading it, of which there are none.
    pub fn checksum(&self) -> Result<String> {
        let [nx, ny, nz] = self.header.dims.0;
        let bytes = self.header.dims.slice_voxels() as usize * self.header.dtype.bytes();
        let slices = (0..nz)
            .into_par_iter()
            .map_with(Vec::new(), |buffer: &mut Vec<u8>, z| {
                buffer.resize(bytes, 0);
                self.fill_box(0..nx, 0..ny, z..z + 1, buffer)?;
                Ok(crc32fast::hash(buffer))
            });
        let sums = slices.collect::<Result<Vec<u32>>>()?;
        let all = crc32fast::hash(bytemuck::cast_slice(&sums));
        Ok(format!("of the checksum {all:08x}"))
    }
}

/// Where the samples of an array with the axes z, y, x lie.
pub fn samples(array: &Bound<'_, PyUntypedArray>, stored: super::gather::Stored) -> Samples {
    let mut strides = [0; 3];
    strides.copy_from_slice(array.strides());
    strides.reverse();
    Samples {
        // SAFETY: the pointer is that of a live array
        first: unsafe { (*array.as_array_ptr()).fields.data.cast_const().cast() },
        strides,
        stored,
    }
}

impl Volume for ArrayVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        // SAFETY: the box lies in the array and `out` has its size, as the trait promises; NumPy vouches for the strides
        unsafe { self.samples.copy([x, y, z], out) };
        Ok(())
    }
}
