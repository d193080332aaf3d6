//! The chunks of a volume: unpacked, and put in order.

use crate::error::Result;
use crate::grid::Dims;
use crate::volume::formats::zarr::files::{Cursor, Files};
use crate::volume::io::chunked::{Chunks, grouped};
use crate::volume::{Dtype, Endian};
use half::f16;
use std::ops::Range;

/// The chunks of a volume, several small ones at a time.
pub(crate) struct ZarrChunks {
    pub(crate) files: Files,
    dims: Dims,
    /// Axes of the array that are x, y and z.
    axes: [usize; 3],
    /// The chunk of every other axis.
    place: Vec<u64>,
    /// Where in it the voxel 0 of a chunk is, and samples from one to the next along x, y and z.
    start: usize,
    strides: [usize; 3],
    /// A sample of chunks that are not there, in the machine's order.
    fill: Vec<u8>,
    /// Voxels of a chunk.
    chunk: [u32; 3],
    /// Voxels of chunks that are decoded together.
    shape: [u32; 3],
}

impl Chunks for ZarrChunks {
    fn shape(&self) -> [u32; 3] {
        self.shape
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let part = [0, 1, 2].map(|a| {
            let start = index[a] * self.shape[a];
            start..start.saturating_add(self.shape[a]).min(self.dims.0[a])
        });
        let span = |a: usize| part[a].start / self.chunk[a]..(part[a].end - 1) / self.chunk[a] + 1;
        let mut cursor = Cursor::default();
        for k in span(2) {
            for j in span(1) {
                for i in span(0) {
                    self.decode_one([i, j, k], &mut cursor, &part, out)?;
                }
            }
        }
        Ok(())
    }

    fn scratch(&self) -> u64 {
        // packed, unpacked, and in between
        let most = crate::volume::formats::zarr::codec::largest(
            &self.files.array.coding.packing,
            self.files.bytes,
        );
        3 * most as u64 + (1 << 20)
    }

    fn kept(&self) -> u64 {
        self.files.table_bytes(rayon::current_num_threads() as u64)
    }
}

impl ZarrChunks {
    /// The chunks of a volume of which the array's `axes` are x, y and z and `at` is the entry of every other axis.
    pub(crate) fn new(
        files: Files,
        dims: Dims,
        axes: [usize; 3],
        at: &[u64],
        dtype: Dtype,
    ) -> Self {
        let array = &files.array;
        let chunk = axes.map(|a| array.chunk[a].min(u64::from(crate::grid::MAX_DIM)) as u32);
        let fill = array.fill.unwrap_or(0.0);
        // samples from one to the next along each axis of the array
        let mut strides = vec![0; array.chunk.len()];
        let mut stride = 1;
        for &axis in array.coding.order.iter().rev() {
            strides[axis] = stride;
            stride *= array.chunk[axis] as usize;
        }
        let others = at.iter().zip(&array.chunk);
        let inside = others.clone().zip(&strides);
        ZarrChunks {
            dims,
            axes,
            place: others.map(|(at, n)| at / n).collect(),
            start: inside.map(|((at, n), s)| (at % n) as usize * s).sum(),
            strides: axes.map(|a| strides[a]),
            fill: sample(array.kind.dtype().unwrap_or(dtype), fill),
            chunk,
            shape: grouped(chunk, dims, dtype.bytes() as u64),
            files,
        }
    }

    /// Puts what of a chunk lies in `part` of the volume to its place there.
    fn decode_one(
        &self,
        index: [u32; 3],
        cursor: &mut Cursor,
        part: &[Range<u32>; 3],
        out: &mut [u8],
    ) -> Result<()> {
        let mut place = self.place.clone();
        for (axis, i) in self.axes.iter().zip(index) {
            place[*axis] = i.into();
        }
        let first = [0, 1, 2].map(|a| index[a] * self.chunk[a]);
        let both = [0, 1, 2].map(|a| {
            let end = first[a].saturating_add(self.chunk[a]);
            part[a].start.max(first[a])..part[a].end.min(end)
        });
        let size = self.fill.len();
        let row_of = |j: u32, k: u32| {
            let row = (k - part[2].start) as usize * part[1].len() + (j - part[1].start) as usize;
            let start = row * part[0].len() + (both[0].start - part[0].start) as usize;
            start * size..(start + both[0].len()) * size
        };
        let stored = self
            .files
            .chunk(&place, cursor)?
            .map(|stored| self.in_order(stored));
        for k in both[2].clone() {
            for j in both[1].clone() {
                let row = &mut out[row_of(j, k)];
                match &stored {
                    Some(stored) => {
                        let from = [both[0].start - first[0], j - first[1], k - first[2]];
                        self.put(stored, from, row);
                    }
                    None => {
                        let samples = row.chunks_exact_mut(size);
                        samples.for_each(|s| s.copy_from_slice(&self.fill));
                    }
                }
            }
        }
        Ok(())
    }

    /// Samples in the machine's byte order.
    fn in_order(&self, mut stored: Vec<u8>) -> Vec<u8> {
        let array = &self.files.array;
        if array.coding.endian != Endian::NATIVE && array.kind.size > 1 {
            let samples = stored.chunks_exact_mut(array.kind.size);
            samples.for_each(<[u8]>::reverse);
        }
        stored
    }

    /// Fills a row with the samples of a chunk from voxel `from` of it on.
    fn put(&self, stored: &[u8], from: [u32; 3], row: &mut [u8]) {
        let array = &self.files.array;
        let steps = from.iter().zip(self.strides);
        let start = steps.fold(self.start, |start, (from, stride)| {
            start + *from as usize * stride
        });
        let step = self.strides[0];
        let (sample, size) = (array.kind.size, self.fill.len());
        if step == 1 && sample == size {
            row.copy_from_slice(&stored[start * size..][..row.len()]);
            return;
        }
        for (i, out) in row.chunks_exact_mut(size).enumerate() {
            let from = &stored[(start + i * step) * sample..][..sample];
            if sample == size {
                out.copy_from_slice(from);
            } else {
                let value = f16::from_bits(u16::from_ne_bytes([from[0], from[1]])).to_f32();
                out.copy_from_slice(&value.to_ne_bytes());
            }
        }
    }
}

/// A sample of a value, in the machine's order.
fn sample(dtype: Dtype, v: f64) -> Vec<u8> {
    match dtype {
        Dtype::U8 => (v as u8).to_ne_bytes().to_vec(),
        Dtype::I8 => (v as i8).to_ne_bytes().to_vec(),
        Dtype::U16 => (v as u16).to_ne_bytes().to_vec(),
        Dtype::I16 => (v as i16).to_ne_bytes().to_vec(),
        Dtype::U32 => (v as u32).to_ne_bytes().to_vec(),
        Dtype::I32 => (v as i32).to_ne_bytes().to_vec(),
        Dtype::F32 => (v as f32).to_ne_bytes().to_vec(),
        Dtype::F64 => v.to_ne_bytes().to_vec(),
    }
}
