//! The chunks of a dataset, or pieces of one without, as parts of a volume.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::formats::hdf5::number::{Inexact, Number, Raw};
use crate::volume::formats::hdf5::{LIBRARY_CACHE, broken};
use crate::volume::io::chunked::{Chunks, grouped};
use crate::volume::io::paged::MAX_CHUNK;
use hdf5_reader::{Dataset, SliceInfo, SliceInfoElem};
use std::path::PathBuf;

/// Datasets without chunks are read in pieces of at most this size, unless a row has more.
const PIECE: u64 = 4 << 20;

/// A volume in an array of HDF5.
pub(crate) struct H5Chunks {
    pub(crate) path: PathBuf,
    pub(crate) name: String,
    pub(crate) dataset: Dataset,
    pub(crate) number: Number,
    /// Voxels of a piece along x, y and z.
    pub(crate) shape: [u32; 3],
    pub(crate) dims: Dims,
    /// Which axes of the array x, y and z are.
    pub(crate) axes: [usize; 3],
    /// The entry along every axis of the array; of x, y and z the first.
    pub(crate) entry: Vec<u64>,
}

/// The voxels of a piece: a chunk, several small ones, or rows of what has no chunks.
///
/// # Errors
/// What is wrong with the chunks.
pub(crate) fn pieces(
    dataset: &Dataset,
    axes: [usize; 3],
    dims: Dims,
    stored: u64,
) -> Result<[u32; 3], String> {
    let shape = match dataset.chunks() {
        Some(chunk) if chunk.len() != dataset.ndim() || chunk.contains(&0) => {
            return Err(format!("chunks of {chunk:?}"));
        }
        Some(chunk) => grouped(axes.map(|a| chunk[a]), dims, stored),
        None => {
            // the last axis in whole rows, as many as fit
            let mut shape = [1; 3];
            let mut order = [0, 1, 2];
            order.sort_by_key(|&a| std::cmp::Reverse(axes[a]));
            let mut bytes = stored;
            for (i, a) in order.into_iter().enumerate() {
                let fit = if i == 0 { u64::MAX } else { PIECE / bytes };
                shape[a] = fit.clamp(1, dims.0[a].into()) as u32;
                bytes *= u64::from(shape[a]);
                if shape[a] < dims.0[a] {
                    break;
                }
            }
            shape
        }
    };
    let voxels = |shape: [u32; 3]| {
        shape
            .iter()
            .fold(stored, |n, &s| n.saturating_mul(s.into()))
    };
    let chunk = dataset.chunks().unwrap_or_default();
    let whole = chunk
        .iter()
        .fold(stored, |n, &s| n.saturating_mul(s.into()));
    match voxels(shape).max(if chunk.is_empty() { 0 } else { whole }) {
        bytes if bytes > MAX_CHUNK => Err(format!("chunks of {bytes} bytes")),
        _ => Ok(shape),
    }
}

impl H5Chunks {
    /// Voxels of a piece inside the volume, x first.
    pub(crate) fn size(&self, index: [u32; 3]) -> [u64; 3] {
        [0, 1, 2].map(|a| {
            let start = u64::from(index[a]) * u64::from(self.shape[a]);
            u64::from(self.shape[a]).min(u64::from(self.dims.0[a]) - start)
        })
    }

    fn read<const N: usize>(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let size = self.size(index);
        let mut start = self.entry.clone();
        let mut count = vec![1; start.len()];
        for (a, &axis) in self.axes.iter().enumerate() {
            start[axis] = u64::from(index[a]) * u64::from(self.shape[a]);
            count[axis] = size[a];
        }
        let ranges = start.iter().zip(&count);
        let selections = ranges.map(|(&start, &n)| SliceInfoElem::Slice {
            start,
            end: start + n,
            step: 1,
        });
        let selections = selections.collect();
        let found = self
            .dataset
            .read_slice::<Raw<N>>(&SliceInfo { selections })
            .map_err(|e| broken(&self.path, &self.name, &e))?;
        let stored = found.as_slice().unwrap_or_default();
        let voxels: u64 = size.iter().product();
        let sample = self.number.dtype.bytes();
        if stored.len() as u64 != voxels || out.len() as u64 != voxels * sample as u64 {
            let what = format!("{} voxels of a chunk", stored.len());
            return Err(Error::format(&self.path, what, format!("{voxels}")));
        }
        // elements from one to the next along each axis of the array
        let mut strides = vec![1; count.len()];
        for a in (1..count.len()).rev() {
            strides[a - 1] = strides[a] * count[a] as usize;
        }
        let [sx, sy, sz] = self.axes.map(|a| strides[a]);
        let [nx, ny, nz] = size.map(|n| n as usize);
        let mut rows = out.chunks_exact_mut(nx * sample);
        for k in 0..nz {
            for (j, row) in (&mut rows).take(ny).enumerate() {
                let elements = &stored[k * sz + j * sy..];
                let done = match sx {
                    1 => self.row(elements.iter(), row),
                    _ => self.row(elements.iter().step_by(sx), row),
                };
                done.map_err(|Inexact(value)| {
                    Error::format(
                        &self.path,
                        format!("the number {value} in the dataset {}", self.name),
                        "numbers that f64 holds exactly, up to 2^53",
                    )
                })?;
            }
        }
        Ok(())
    }

    /// Numbers of a row, in the machine's byte order.
    fn row<'a, const N: usize>(
        &self,
        elements: impl Iterator<Item = &'a Raw<N>>,
        row: &mut [u8],
    ) -> Result<(), Inexact> {
        if self.number.is_native() {
            for (Raw(element), out) in elements.zip(row.as_chunks_mut::<N>().0) {
                *out = *element;
            }
            return Ok(());
        }
        let sample = self.number.dtype.bytes();
        for (Raw(element), out) in elements.zip(row.chunks_exact_mut(sample)) {
            let mut bytes = [0; 8];
            bytes[..N].copy_from_slice(element);
            self.number.put(bytes, out)?;
        }
        Ok(())
    }
}

impl Chunks for H5Chunks {
    fn shape(&self) -> [u32; 3] {
        self.shape
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        match self.number.size {
            1 => self.read::<1>(index, out),
            2 => self.read::<2>(index, out),
            3 => self.read::<3>(index, out),
            4 => self.read::<4>(index, out),
            5 => self.read::<5>(index, out),
            6 => self.read::<6>(index, out),
            7 => self.read::<7>(index, out),
            _ => self.read::<8>(index, out),
        }
    }

    fn scratch(&self) -> u64 {
        let piece: u64 = self.shape.iter().map(|&n| u64::from(n)).product();
        let chunk = self.dataset.chunks().unwrap_or_default();
        let chunk: u64 = chunk.iter().map(|&n| u64::from(n)).product();
        // the piece as an array, one chunk before and after a filter, and what packing adds to noise
        (piece + 2 * chunk + chunk / 16) * self.number.size as u64 + LIBRARY_CACHE as u64
    }
}
