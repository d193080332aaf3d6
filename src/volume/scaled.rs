//! Samples that stand for physical values: `slope * stored + intercept`.

use super::{Dtype, Header, Volume, Voxel, check_box, with_voxel_type};
use crate::error::Result;
use std::ops::Range;
use std::path::Path;

/// Stored bytes that a thread holds while it converts, unless a row has more.
const PIECE: usize = 1 << 20;

/// A volume of stored samples that hands out physical values.
pub(super) struct Scaled<'a> {
    inner: Box<dyn Volume + 'a>,
    header: Header,
    slope: f64,
    intercept: f64,
}

impl<'a> Scaled<'a> {
    /// The values are f32 where the stored type has at most 16 bits or is f32, else f64, so that
    /// stored numbers that differ keep apart.
    pub(super) fn new(inner: Box<dyn Volume + 'a>, slope: f64, intercept: f64) -> Self {
        let mut header = inner.header().clone();
        header.dtype = value_type(header.dtype);
        Scaled {
            inner,
            header,
            slope,
            intercept,
        }
    }

    fn convert(&self, stored: &[u8], out: &mut [u8]) {
        with_voxel_type!(self.inner.header().dtype, T => self.convert_from::<T>(stored, out));
    }

    fn convert_from<T: Voxel>(&self, stored: &[u8], out: &mut [u8]) {
        let value = |from: &[u8]| {
            bytemuck::pod_read_unaligned::<T>(from).to_f64() * self.slope + self.intercept
        };
        let stored = stored.chunks_exact(size_of::<T>());
        if self.header.dtype == Dtype::F32 {
            for (out, from) in out.as_chunks_mut::<4>().0.iter_mut().zip(stored) {
                *out = (value(from) as f32).to_ne_bytes();
            }
        } else {
            for (out, from) in out.as_chunks_mut::<8>().0.iter_mut().zip(stored) {
                *out = value(from).to_ne_bytes();
            }
        }
    }
}

/// The type of the values of a stored type.
pub(super) fn value_type(stored: Dtype) -> Dtype {
    match stored {
        Dtype::U8 | Dtype::I8 | Dtype::U16 | Dtype::I16 | Dtype::F32 => Dtype::F32,
        Dtype::U32 | Dtype::I32 | Dtype::F64 => Dtype::F64,
    }
}

impl Volume for Scaled<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        check_box(&self.header, &x, &y, &z, out.len())?;
        if out.is_empty() {
            return Ok(());
        }
        let (from, to) = (self.inner.header().dtype.bytes(), self.header.dtype.bytes());
        let rows = (PIECE / (x.len() * from)).clamp(1, y.len());
        let mut stored = vec![0; rows * x.len() * from];
        let slice = x.len() * y.len() * to;
        for (k, out) in z.zip(out.chunks_exact_mut(slice)) {
            for (i, out) in out.chunks_mut(rows * x.len() * to).enumerate() {
                let stored = &mut stored[..out.len() / to * from];
                let top = y.start + (i * rows) as u32;
                let end = y.end.min(top + rows as u32);
                self.inner.read_box(x.clone(), top..end, k..k + 1, stored)?;
                self.convert(stored, out);
            }
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(Scaled::new(inner, self.slope, self.intercept))
        }))
    }

    fn grain(&self) -> [u32; 3] {
        self.inner.grain()
    }

    fn held_bytes(&self) -> u64 {
        let row = u64::from(self.header.dims.0[0]) * 8;
        self.inner.held_bytes() + rayon::current_num_threads() as u64 * row.max(PIECE as u64)
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.inner.mapped_bytes(z)
    }

    fn prefetch(&self, z: Range<u32>) {
        self.inner.prefetch(z);
    }

    fn release(&self, z: Range<u32>) {
        self.inner.release(z);
    }
}
