//! Volumes in chunks of all three axes, each decoded as a whole: Zarr and HDF5.
//!
//! What is read is decoded in parallel; chunks of which only a part was asked for stay in a bounded
//! cache for the next box. A sweep reads boxes that share more chunks than that holds: it has each of them
//! decoded once, see [`Unpacked`].

use crate::error::Result;
use crate::grid::Dims;
use crate::volume::io::chunk_cache::{self, ChunkCache};
use crate::volume::io::decoded_once::{Parts, Shared, Unpacked};
use crate::volume::{Header, Volume};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// The chunks of a volume, in a regular grid from its first voxel on.
pub(crate) trait Chunks: Send + Sync {
    /// Voxels of a chunk along x, y and z, at least 1.
    fn shape(&self) -> [u32; 3];

    /// Decodes the chunk at `index` of the grid into `out`: the voxels of it that lie inside the
    /// volume, x fastest, in the machine's byte order. Does so in the calling thread alone.
    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()>;

    /// Bytes that decoding a chunk takes besides the chunk.
    fn scratch(&self) -> u64;

    /// Bytes that are kept for all of them, as tables of their places.
    fn kept(&self) -> u64 {
        0
    }
}

/// Smaller chunks are decoded several at a time.
const LEAST: u64 = 512 << 10;

/// The shape of a chunk, or of several small ones, x first.
pub(crate) fn grouped(chunk: [u32; 3], dims: Dims, sample: u64) -> [u32; 3] {
    let mut shape = [0, 1, 2].map(|a| chunk[a].clamp(1, dims.0[a]));
    let bytes = |shape: [u32; 3]| shape.iter().fold(sample, |n, &s| n * u64::from(s));
    for a in 0..3 {
        while shape[a] < dims.0[a] && bytes(shape) < LEAST {
            // whole chunks, until the volume ends
            shape[a] = shape[a].saturating_mul(2).min(dims.0[a]);
            if shape[a] < dims.0[a] {
                shape[a] = shape[a] / chunk[a] * chunk[a];
            }
        }
    }
    shape
}

/// A volume of chunks.
pub(crate) struct ChunkedVolume {
    header: Header,
    chunks: Box<dyn Chunks>,
    shape: [u32; 3],
    cache: ChunkCache<[u32; 3]>,
}

impl ChunkedVolume {
    pub(crate) fn new(header: Header, chunks: Box<dyn Chunks>) -> Self {
        let dims = header.dims.0;
        let given = chunks.shape();
        let shape = [0, 1, 2].map(|a| given[a].clamp(1, dims[a]));
        let sample = header.dtype.bytes() as u64;
        let total = header.dims.voxels() * sample;
        // the chunks that a band of a slab of 64 cubes shares with the next band
        let layers = u64::from((66 + shape[2]) / shape[2] * shape[2]).min(u64::from(dims[2]));
        let band = u64::from(dims[0]) * u64::from(shape[1]) * layers * sample;
        let budget = band.clamp(chunk_cache::LEAST, chunk_cache::MOST).min(total);
        ChunkedVolume {
            cache: ChunkCache::new(budget),
            header,
            chunks,
            shape,
        }
    }

    /// The voxels of a chunk inside the volume.
    fn part(&self, index: [u32; 3]) -> [Range<u32>; 3] {
        [0, 1, 2].map(|a| {
            let start = index[a] * self.shape[a];
            start
                ..start
                    .saturating_add(self.shape[a])
                    .min(self.header.dims.0[a])
        })
    }

    fn chunk_bytes(&self) -> u64 {
        let voxels: u64 = self.shape.iter().map(|&n| u64::from(n)).product();
        voxels * self.header.dtype.bytes() as u64
    }

    /// Chunks that are decoded together.
    fn batch(&self) -> usize {
        let fit = self.cache.budget() / self.chunk_bytes().max(1);
        (fit as usize).clamp(1, 4 * rayon::current_num_threads())
    }

    /// The chunks that a box meets.
    fn chunks_of(&self, asked: &[Range<u32>; 3]) -> Vec<Shared> {
        let span = |a: usize| {
            let n = self.shape[a];
            asked[a].start / n..(asked[a].end - 1) / n + 1
        };
        let mut all = Vec::new();
        for k in span(2) {
            for j in span(1) {
                let row = span(0).map(|i| [i, j, k]);
                all.extend(row.map(|index| Shared::new(index, self.part(index), asked)));
            }
        }
        all
    }

    /// A chunk out of the cache, or decoded and, if only a part of it is asked for, put there.
    fn chunk(&self, shared: &Shared) -> Result<Arc<Vec<u8>>> {
        if let Some(chunk) = self.cache.get(shared.index) {
            return Ok(chunk);
        }
        let mut chunk = vec![0; shared.samples() * self.header.dtype.bytes()];
        self.decode(shared, &mut chunk)?;
        let chunk = Arc::new(chunk);
        if shared.part != shared.both {
            self.cache.insert(shared.index, chunk.clone());
        }
        Ok(chunk)
    }

    /// Copies what the box and the chunk share into slice `k` of the box.
    fn copy(&self, asked: &[Range<u32>; 3], k: u32, of: &(Shared, Arc<Vec<u8>>), out: &mut [u8]) {
        let (shared, chunk) = of;
        let Shared { part, both, .. } = shared;
        if !both[2].contains(&k) {
            return;
        }
        let sample = self.header.dtype.bytes();
        let len = both[0].len() * sample;
        for j in both[1].clone() {
            let plane = (k - part[2].start) as usize * part[1].len();
            let row = (plane + (j - part[1].start) as usize) * part[0].len();
            let from = (row + (both[0].start - part[0].start) as usize) * sample;
            let row = (j - asked[1].start) as usize * asked[0].len();
            let to = (row + (both[0].start - asked[0].start) as usize) * sample;
            out[to..to + len].copy_from_slice(&chunk[from..from + len]);
        }
    }
}

impl Parts for ChunkedVolume {
    fn largest(&self) -> u64 {
        self.chunk_bytes()
    }

    fn parts_of(&self, asked: &[Range<u32>; 3]) -> Result<Vec<Shared>> {
        Ok(self.chunks_of(asked))
    }

    fn decode(&self, shared: &Shared, out: &mut [u8]) -> Result<()> {
        self.chunks.decode(shared.index, out)
    }

    fn end(&self, index: [u32; 3]) -> u32 {
        self.part(index)[2].end
    }
}

impl Volume for ChunkedVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let asked = [x, y, z];
        let slice = out.len() / asked[2].len();
        let mut chunks = self.chunks_of(&asked).into_iter().peekable();
        while chunks.peek().is_some() {
            let batch: Vec<Shared> = chunks.by_ref().take(self.batch()).collect();
            let found = batch.into_par_iter().map(|shared| {
                let chunk = self.chunk(&shared)?;
                Ok((shared, chunk))
            });
            let found: Vec<(Shared, Arc<Vec<u8>>)> = found.collect::<Result<_>>()?;
            out.par_chunks_exact_mut(slice)
                .zip(asked[2].clone())
                .for_each(|(out, k)| found.iter().for_each(|of| self.copy(&asked, k, of, out)));
        }
        Ok(())
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let total = self.header.dims.voxels() * self.header.dtype.bytes() as u64;
        if total <= self.cache.budget() {
            return Ok(None);
        }
        self.cache.clear();
        Ok(Some(Box::new(Unpacked::new(self, dir)?)))
    }

    fn held_bytes(&self) -> u64 {
        let grid = [0, 1, 2].map(|a| u64::from(self.header.dims.0[a].div_ceil(self.shape[a])));
        // no more are decoded at a time than there are
        let threads = (rayon::current_num_threads() as u64).min(grid.iter().product());
        let batch = self.batch() as u64 * self.chunk_bytes();
        self.cache.budget() + batch + threads * self.chunks.scratch() + self.chunks.kept()
    }

    fn grain(&self) -> [u32; 3] {
        self.shape
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::grid::Placement;
    use crate::volume::{Dtype, Endian};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Chunks of which voxel (x, y, z) has the value x + 10 y + 100 z.
    pub(crate) struct Counting {
        shape: [u32; 3],
        dims: [u32; 3],
        /// How many were decoded.
        pub(crate) decoded: Arc<AtomicUsize>,
    }

    impl Counting {
        pub(crate) fn new(shape: [u32; 3], dims: [u32; 3]) -> Self {
            Counting {
                shape: [0, 1, 2].map(|a| shape[a].min(dims[a])),
                dims,
                decoded: Arc::default(),
            }
        }

        pub(crate) fn header(&self) -> Header {
            Header {
                format: "test",
                dims: Dims(self.dims),
                dtype: Dtype::U32,
                endian: Endian::NATIVE,
                placement: Placement::default(),
            }
        }
    }

    /// A volume of them.
    pub(crate) fn counted(dims: [u32; 3], shape: [u32; 3]) -> ChunkedVolume {
        let chunks = Counting::new(shape, dims);
        ChunkedVolume::new(chunks.header(), Box::new(chunks))
    }

    impl Chunks for Counting {
        fn shape(&self) -> [u32; 3] {
            self.shape
        }

        fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
            self.decoded.fetch_add(1, Ordering::Relaxed);
            let part = [0, 1, 2].map(|a| {
                let start = index[a] * self.shape[a];
                start..(start + self.shape[a]).min(self.dims[a])
            });
            let mut values = out.as_chunks_mut::<4>().0.iter_mut();
            for k in part[2].clone() {
                for j in part[1].clone() {
                    for i in part[0].clone() {
                        *values.next().unwrap() = (i + 10 * j + 100 * k).to_ne_bytes();
                    }
                }
            }
            assert!(values.next().is_none());
            Ok(())
        }

        fn scratch(&self) -> u64 {
            0
        }
    }
}
