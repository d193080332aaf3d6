//! Volumes in chunks of all three axes, each decoded as a whole: Zarr and HDF5.
//!
//! What is read is decoded in parallel; chunks of which only a part was asked for stay in a bounded
//! cache for the next band or slab. Volumes whose chunks are so large that most of what is decoded
//! would not be asked for are rather unpacked once to a temporary file.

use super::{Header, Volume, check_box};
use crate::error::Result;
use rayon::prelude::*;
use std::collections::{HashMap, VecDeque};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// The cache holds at least this much, or the whole volume.
const MIN_CACHE: u64 = 16 << 20;
/// The cache never holds more.
const MAX_CACHE: u64 = 128 << 20;
/// Voxels that may be decoded for each one of a tile of 64 cubes before unpacking is better.
const MAX_WASTE: f64 = 10.0;

/// The chunks of a volume, in a regular grid from its first voxel on.
pub(super) trait Chunks: Send + Sync {
    /// Voxels of a chunk along x, y and z, at least 1.
    fn shape(&self) -> [u32; 3];

    /// Decodes the chunk at `index` of the grid into `out`: the voxels of it that lie inside the
    /// volume, x fastest, in the machine's byte order.
    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()>;

    /// Bytes that decoding a chunk takes besides the chunk.
    fn scratch(&self) -> u64;
}

/// A volume of chunks.
pub(super) struct ChunkedVolume {
    header: Header,
    chunks: Box<dyn Chunks>,
    shape: [u32; 3],
    cache: Mutex<Cache>,
    budget: u64,
    random: bool,
}

/// Decoded chunks; what came first leaves first.
#[derive(Default)]
struct Cache {
    chunks: HashMap<[u32; 3], Arc<Vec<u8>>>,
    order: VecDeque<[u32; 3]>,
    bytes: u64,
}

impl Cache {
    fn insert(&mut self, key: [u32; 3], chunk: Arc<Vec<u8>>, budget: u64) {
        let len = chunk.len() as u64;
        if len > budget || self.chunks.insert(key, chunk).is_some() {
            return;
        }
        self.order.push_back(key);
        self.bytes += len;
        while self.bytes > budget {
            let Some(first) = self.order.pop_front() else {
                return;
            };
            if let Some(old) = self.chunks.remove(&first) {
                self.bytes -= old.len() as u64;
            }
        }
    }
}

impl ChunkedVolume {
    pub(super) fn new(header: Header, chunks: Box<dyn Chunks>) -> Self {
        let dims = header.dims.0;
        let given = chunks.shape();
        let shape = [0, 1, 2].map(|a| given[a].clamp(1, dims[a]));
        let sample = header.dtype.bytes() as u64;
        let total = header.dims.voxels() * sample;
        // the chunks that a band of a slab of 64 cubes shares with the next band
        let layers = u64::from((66 + shape[2]) / shape[2] * shape[2]).min(u64::from(dims[2]));
        let band = u64::from(dims[0]) * u64::from(shape[1]) * layers * sample;
        let budget = band.clamp(MIN_CACHE, MAX_CACHE).min(total);
        let waste = |a: usize| (66.0 + f64::from(shape[a])).min(f64::from(dims[a])) / 64.0;
        let (y, z) = (waste(1).max(1.0), waste(2).max(1.0));
        let random = total <= budget || y * z <= MAX_WASTE;
        // what is unpacked as a whole, in the order of its chunks, is not asked for again
        let budget = if random { budget } else { MIN_CACHE };
        ChunkedVolume {
            random,
            budget,
            header,
            chunks,
            shape,
            cache: Mutex::default(),
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
        let fit = self.budget / self.chunk_bytes().max(1);
        (fit as usize).clamp(1, 4 * rayon::current_num_threads())
    }

    /// A chunk out of the cache, or decoded and, if only a part of it is asked for, put there.
    fn chunk(&self, index: [u32; 3], keep: bool) -> Result<Arc<Vec<u8>>> {
        let cache = || self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(chunk) = cache().chunks.get(&index) {
            return Ok(chunk.clone());
        }
        let voxels: usize = self.part(index).iter().map(|r| r.len()).product();
        let mut chunk = vec![0; voxels * self.header.dtype.bytes()];
        self.chunks.decode(index, &mut chunk)?;
        let chunk = Arc::new(chunk);
        if keep {
            cache().insert(index, chunk.clone(), self.budget);
        }
        Ok(chunk)
    }

    /// Copies what the box and the chunk share into slice `k` of the box.
    fn copy(&self, asked: &[Range<u32>; 3], k: u32, of: &(Shared, Arc<Vec<u8>>), out: &mut [u8]) {
        let (shared, chunk) = of;
        let (part, both) = (&shared.part, &shared.both);
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

/// The voxels of a chunk, and those of them that are asked for.
struct Shared {
    part: [Range<u32>; 3],
    both: [Range<u32>; 3],
}

impl Volume for ChunkedVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        check_box(&self.header, &x, &y, &z, out.len())?;
        if out.is_empty() {
            return Ok(());
        }
        let asked = [x, y, z];
        let slice = out.len() / asked[2].len();
        let span = |a: usize| {
            let n = self.shape[a];
            asked[a].start / n..(asked[a].end - 1) / n + 1
        };
        let mut indices = Vec::new();
        for k in span(2) {
            for j in span(1) {
                indices.extend(span(0).map(|i| [i, j, k]));
            }
        }
        for batch in indices.chunks(self.batch()) {
            let found: Vec<(Shared, Arc<Vec<u8>>)> = batch
                .par_iter()
                .map(|&index| {
                    let part = self.part(index);
                    let both = [0, 1, 2]
                        .map(|a| part[a].start.max(asked[a].start)..part[a].end.min(asked[a].end));
                    let chunk = self.chunk(index, part != both)?;
                    Ok((Shared { part, both }, chunk))
                })
                .collect::<Result<_>>()?;
            out.par_chunks_exact_mut(slice)
                .zip(asked[2].clone())
                .for_each(|(out, k)| found.iter().for_each(|of| self.copy(&asked, k, of, out)));
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.random
    }

    fn held_bytes(&self) -> u64 {
        let threads = rayon::current_num_threads() as u64;
        let batch = self.batch() as u64 * self.chunk_bytes();
        self.budget + batch + threads * self.chunks.scratch()
    }

    fn grain(&self) -> [u32; 3] {
        self.shape
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::{Dtype, Endian};
    use proptest::prelude::*;

    /// Chunks of which voxel (x, y, z) has the value x + 10 y + 100 z.
    struct Counting([u32; 3], Dims);

    impl Chunks for Counting {
        fn shape(&self) -> [u32; 3] {
            self.0
        }

        fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
            let part = [0, 1, 2].map(|a| {
                let start = index[a] * self.0[a];
                start..(start + self.0[a]).min(self.1.0[a])
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

    proptest! {
        #[test]
        fn any_box_of_any_chunks(
            dims in [2u32..9, 2u32..9, 2u32..9],
            shape in [1u32..11, 1u32..11, 1u32..11],
            ends in [(0.0..1.0, 0.0..1.0), (0.0..1.0, 0.0..1.0), (0.0..1.0, 0.0..1.0)],
        ) {
            let header = Header {
                format: "test",
                dims: Dims(dims),
                dtype: Dtype::U32,
                endian: Endian::NATIVE,
                placement: Placement::default(),
            };
            let own = [0, 1, 2].map(|a| shape[a].min(dims[a]));
            let volume = ChunkedVolume::new(header, Box::new(Counting(own, Dims(dims))));
            let asked = [0, 1, 2].map(|a| {
                let (p, q): (f64, f64) = ends[a];
                let at = |v: f64| (v * f64::from(dims[a] + 1)) as u32;
                at(p.min(q))..at(p.max(q))
            });
            let [x, y, z] = asked.clone();
            let mut out = vec![0; 4 * x.len() * y.len() * z.len()];
            for _ in 0..2 {
                out.fill(0);
                volume.read_box(x.clone(), y.clone(), z.clone(), &mut out).unwrap();
                let mut values = out.as_chunks::<4>().0.iter();
                for k in z.clone() {
                    for j in y.clone() {
                        for i in x.clone() {
                            let found = u32::from_ne_bytes(*values.next().unwrap());
                            prop_assert_eq!(found, i + 10 * j + 100 * k);
                        }
                    }
                }
            }
        }
    }
}
