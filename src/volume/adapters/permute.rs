//! A volume whose axes are stored in another order than x, y, z.

use crate::error::Result;
use crate::grid::Dims;
use crate::volume::{Header, Volume};
use std::ops::Range;
use std::path::Path;

/// Stored bytes that a thread holds while it sorts, unless a row has more.
const PIECE: usize = 1 << 20;

/// The axes of a volume in the order in which they mean it to be: x, y and z.
pub(crate) struct Permuted<'a> {
    inner: Box<dyn Volume + 'a>,
    header: Header,
    /// Which of x, y and z each axis of the stored volume is, the fastest first.
    axes: [usize; 3],
}

/// What belongs to x, y and z, of what belongs to stored axes.
fn sorted<T: Copy>(axes: [usize; 3], stored: [T; 3]) -> [T; 3] {
    let mut out = stored;
    for (value, axis) in stored.into_iter().zip(axes) {
        out[axis] = value;
    }
    out
}

/// The sizes along stored axes of a volume of these along x, y and z.
pub(crate) fn stored_dims(axes: [usize; 3], dims: Dims) -> Dims {
    Dims(axes.map(|axis| dims.0[axis]))
}

impl<'a> Permuted<'a> {
    /// Sorts the axes of a volume; `axes` are three different ones.
    pub(crate) fn new(inner: Box<dyn Volume + 'a>, axes: [usize; 3]) -> Self {
        let mut header = inner.header().clone();
        header.dims = Dims(sorted(axes, header.dims.0));
        Permuted {
            inner,
            header,
            axes,
        }
    }

    /// Slices of the stored volume that slices along z are in.
    fn slices(&self, z: Range<u32>) -> Range<u32> {
        match self.axes[2] {
            2 => z,
            _ => 0..self.inner.header().dims.0[2],
        }
    }
}

impl Volume for Permuted<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let sample = self.header.dtype.bytes();
        let along = [1, x.len(), x.len() * y.len()];
        let strides = self.axes.map(|axis| along[axis]);
        let asked = [x, y, z];
        let [i, j, k] = self.axes.map(|axis| asked[axis].clone());
        let rows = (PIECE / (i.len() * sample)).clamp(1, j.len());
        let mut stored = vec![0; rows * i.len() * sample];
        for (slice, k) in k.enumerate() {
            let mut top = j.start;
            while top < j.end {
                let end = j.end.min(top + rows as u32);
                let stored = &mut stored[..(end - top) as usize * i.len() * sample];
                self.inner.read_box(i.clone(), top..end, k..k + 1, stored)?;
                for (row, stored) in stored.chunks_exact(i.len() * sample).enumerate() {
                    let row = row + (top - j.start) as usize;
                    let first = slice * strides[2] + row * strides[1];
                    for (n, from) in stored.chunks_exact(sample).enumerate() {
                        let to = (first + n * strides[0]) * sample;
                        out[to..to + sample].copy_from_slice(from);
                    }
                }
                top = end;
            }
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> { Box::new(Permuted::new(inner, self.axes)) }))
    }

    fn grain(&self) -> [u32; 3] {
        sorted(self.axes, self.inner.grain())
    }

    fn held_bytes(&self) -> u64 {
        let row = u64::from(self.inner.header().dims.0[0]) * self.header.dtype.bytes() as u64;
        self.inner.held_bytes() + rayon::current_num_threads() as u64 * row.max(PIECE as u64)
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.inner.mapped_bytes(self.slices(z))
    }

    fn prefetch(&self, z: Range<u32>) {
        // slices along another axis have rows of all that is stored
        if self.axes[2] == 2 {
            self.inner.prefetch(z);
        }
    }

    fn release(&self, z: Range<u32>) {
        self.inner.release(self.slices(z));
    }
}
