//! Samples that lie far away, as chunks: each is one stretch of bytes, of whole rows or whole slices, fetched as a whole.
//!
//! Rows of a band would be thousands of requests. What is fetched is kept as decoded chunks are, see [`ChunkedVolume`]: for
//! a sweep, in a file on this machine until it is behind it. The next ones along z are fetched ahead.
//!
//! [`ChunkedVolume`]: crate::volume::io::chunked::ChunkedVolume

use crate::error::Result;
use crate::grid::Dims;
use crate::sys::locks::lock;
use crate::volume::Volume;
use crate::volume::io::ahead::Ahead;
use crate::volume::io::chunked::Chunks;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Bytes of a chunk, about.
const BYTES: u64 = 8 << 20;
/// Chunks along z that are fetched ahead of one that is asked for, and the most of all.
const NEXT: u32 = 2;
const MOST: usize = 4;
/// A sweep asks for a chunk not long after the one before it along z; whoever reads here and there gets what was asked for
/// alone.
const NEAR: u32 = 4;
/// Bytes that the client takes, for its connections.
const CLIENT: u64 = 16 << 20;

/// A volume in files, cut into such chunks.
pub(crate) struct Blocked {
    inner: Arc<dyn Volume>,
    shape: [u32; 3],
    ahead: Arc<Ahead>,
    /// The last chunk along z that was asked for, of each row of them.
    last: Mutex<HashMap<u32, u32>>,
}

impl Blocked {
    pub(crate) fn new(inner: Arc<dyn Volume>) -> Self {
        let header = inner.header();
        let shape = shape(header.dims, header.dtype.bytes() as u64, BYTES);
        Blocked::of(inner, shape)
    }

    fn of(inner: Arc<dyn Volume>, shape: [u32; 3]) -> Self {
        let ahead = Arc::new(Ahead::new(MOST));
        Blocked {
            inner,
            shape,
            ahead,
            last: Mutex::default(),
        }
    }

    /// The voxels of a chunk; none behind the last.
    fn part(&self, index: [u32; 3]) -> [Range<u32>; 3] {
        let dims = self.inner.header().dims.0;
        [0, 1, 2].map(|a| {
            let start = index[a].saturating_mul(self.shape[a]).min(dims[a]);
            start..start.saturating_add(self.shape[a]).min(dims[a])
        })
    }

    fn fetch_next(&self, [i, j, k]: [u32; 3]) {
        let before = lock(&self.last).insert(j, k);
        if before.is_none_or(|before| before >= k || k - before > NEAR) {
            return;
        }
        for next in (1..=NEXT).map(|step| [i, j, k + step]) {
            let part = self.part(next);
            if part[2].is_empty() {
                return;
            }
            let inner = self.inner.clone();
            self.ahead.begin(next, k, move || {
                let samples: usize = part.iter().map(|r| r.len()).product();
                let mut chunk = vec![0; samples * inner.header().dtype.bytes()];
                let [x, y, z] = part;
                inner.read_box(x, y, z, &mut chunk)?;
                Ok(chunk)
            });
        }
    }
}

/// Voxels of chunks of about `bytes`: whole slices, or whole rows of one slice.
fn shape(dims: Dims, sample: u64, bytes: u64) -> [u32; 3] {
    let [nx, ny, nz] = dims.0;
    let row = u64::from(nx) * sample;
    let fit = |each: u64, most: u32| (bytes / each).clamp(1, u64::from(most)) as u32;
    match row * u64::from(ny) > bytes {
        true => [nx, fit(row, ny), 1],
        false => [nx, ny, fit(row * u64::from(ny), nz)],
    }
}

impl Chunks for Blocked {
    fn shape(&self) -> [u32; 3] {
        self.shape
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let taken = self.ahead.take(index);
        self.fetch_next(index);
        match taken {
            Ok(chunk) => out.copy_from_slice(&chunk?),
            Err(_turn) => {
                let [x, y, z] = self.part(index);
                self.inner.read_box(x, y, z, out)?;
            }
        }
        Ok(())
    }

    fn scratch(&self) -> u64 {
        // pieces as they arrive
        2 * BYTES + self.inner.held_bytes()
    }

    fn kept(&self) -> u64 {
        // those that were fetched ahead, and pieces of them as they arrive
        CLIENT
            + 2 * MOST as u64
                * self.shape.iter().map(|&n| u64::from(n)).product::<u64>()
                * self.inner.header().dtype.bytes() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Placement;
    use crate::volume::{Dtype, MemoryVolume};

    #[test]
    fn chunks_are_stretches_of_bytes() {
        let dims = |x, y, z| Dims([x, y, z]);
        assert_eq!(shape(dims(10, 10, 100), 2, 1000), [10, 10, 5]);
        assert_eq!(shape(dims(10, 10, 3), 2, 1000), [10, 10, 3]);
        assert_eq!(shape(dims(100, 100, 9), 2, 1000), [100, 5, 1]);
        assert_eq!(shape(dims(1000, 100, 9), 2, 1000), [1000, 1, 1]);
    }

    #[test]
    fn chunks_are_the_volume() {
        let dims = Dims([7, 5, 6]);
        let samples: Vec<u8> = (0..210).collect();
        let volume = MemoryVolume::new(dims, Placement::default(), samples.clone()).unwrap();
        assert_eq!(volume.header().dtype, Dtype::U8);
        for bytes in [14, 70, 1000] {
            let shape = shape(dims, 1, bytes);
            let chunks = Blocked::of(Arc::new(volume.clone()), shape);
            let mut found = Vec::new();
            for k in 0..6u32.div_ceil(shape[2]) {
                for j in 0..5u32.div_ceil(shape[1]) {
                    let size = [(j * shape[1], shape[1], 5), (k * shape[2], shape[2], 6)];
                    let [y, z] = size.map(|(at, step, end)| step.min(end - at));
                    let mut out = vec![0; 7 * (y * z) as usize];
                    chunks.decode([0, j, k], &mut out).unwrap();
                    found.extend(out);
                }
            }
            assert_eq!(found, samples, "{shape:?}");
        }
    }
}
