//! The chunks of an array: found in their files or shards, unpacked, and put in order.

use super::super::blosc::Broken;
use super::super::chunked::Chunks;
use super::super::half;
use super::super::{Dtype, Endian};
use super::codec;
use super::meta::Array;
use crate::error::{Error, Result};
use crate::grid::Dims;
use std::collections::HashMap;
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Tables of shards that are kept, in entries of 16 bytes.
const RECENT: usize = 1 << 20;

/// Places of the chunks of a shard: position and length, `u64::MAX` for none.
type Table = Arc<Vec<[u64; 2]>>;

/// The chunks of an array.
pub(super) struct ZarrChunks {
    folder: PathBuf,
    array: Array,
    dims: Dims,
    /// Axes of the array that are x, y and z.
    axes: [usize; 3],
    /// Bytes of a chunk as stored.
    bytes: usize,
    tables: Mutex<HashMap<Vec<u64>, Option<Table>>>,
}

impl Chunks for ZarrChunks {
    fn shape(&self) -> [u32; 3] {
        let most = u64::from(crate::grid::MAX_DIM);
        self.axes.map(|a| self.array.chunk[a].min(most) as u32)
    }

    fn decode(&self, index: [u32; 3], out: &mut [u8]) -> Result<()> {
        let mut place = vec![0u64; self.array.shape.len()];
        for (axis, i) in self.axes.iter().zip(index) {
            place[*axis] = i.into();
        }
        let Some((path, packed)) = self.packed(&place)? else {
            let fill = &self.array.fill;
            out.chunks_exact_mut(fill.len())
                .for_each(|s| s.copy_from_slice(fill));
            return Ok(());
        };
        let steps = &self.array.coding.packing;
        let stored = codec::unpack(steps, packed, self.bytes).map_err(|e| match e {
            Broken::Damaged(found) => {
                Error::format(&path, found, "a whole chunk, as the metadata say")
            }
            Broken::Unsupported(what) => {
                Error::unsupported(&path, what, "write it anew with lz4 or zstd")
            }
        })?;
        self.put(index, stored, out);
        Ok(())
    }

    fn scratch(&self) -> u64 {
        // packed, unpacked, and in between
        3 * self.bytes as u64 + (1 << 20)
    }
}

impl ZarrChunks {
    /// The chunks of an array in a folder; `bytes` is the size of one as stored.
    pub(super) fn new(
        folder: PathBuf,
        array: Array,
        dims: Dims,
        axes: [usize; 3],
        bytes: usize,
    ) -> Self {
        ZarrChunks {
            folder,
            array,
            dims,
            axes,
            bytes,
            tables: Mutex::default(),
        }
    }

    fn file(&self, place: &[u64]) -> PathBuf {
        let (front, separator) = self.array.key;
        let mut key = front.to_owned();
        for (i, n) in place.iter().enumerate() {
            if i > 0 || !front.is_empty() {
                key.push(separator);
            }
            key += &n.to_string();
        }
        self.folder.join(key)
    }

    /// The file of a chunk or shard; `None` if there is none.
    fn open(&self, path: &Path) -> Result<Option<(File, u64)>> {
        let file = match File::open(path) {
            Ok(file) => file,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::io(path, "open", e)),
        };
        let meta = file.metadata().map_err(|e| Error::io(path, "read", e))?;
        if !meta.is_file() {
            return Err(Error::format(path, "a folder", "a chunk"));
        }
        Ok(Some((file, meta.len())))
    }

    /// The bytes of a chunk as they are in its file.
    fn packed(&self, place: &[u64]) -> Result<Option<(PathBuf, Vec<u8>)>> {
        let (path, range) = match &self.array.shards {
            None => (self.file(place), None),
            Some(shards) => {
                let counts = shards.count.iter();
                let outer: Vec<u64> = place
                    .iter()
                    .zip(counts.clone())
                    .map(|(p, n)| p / n)
                    .collect();
                let inner = place.iter().zip(counts);
                let at = inner.fold(0, |at, (p, n)| at * n + p % n);
                let path = self.file(&outer);
                let table = self.table(&path, outer)?;
                let Some([start, len]) = table.map(|t| t[at as usize]) else {
                    return Ok(None);
                };
                if [start, len] == [u64::MAX; 2] {
                    return Ok(None);
                }
                (path, Some((start, len)))
            }
        };
        let Some((file, size)) = self.open(&path)? else {
            return Ok(None);
        };
        let (start, len) = range.unwrap_or((0, size));
        // what is packed is hardly ever larger than what is not
        let most = self.bytes as u64 + self.bytes as u64 / 8 + 65_536;
        if start.checked_add(len).is_none_or(|end| end > size) || len > most {
            let found = format!("a chunk of {len} bytes at {start} of {size}");
            return Err(Error::format(&path, found, format!("at most {most}")));
        }
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, start)
            .map_err(|e| Error::io(&path, "read", e))?;
        Ok(Some((path, bytes)))
    }

    /// The table of a shard.
    fn table(&self, path: &Path, shard: Vec<u64>) -> Result<Option<Table>> {
        let tables = || self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(table) = tables().get(&shard) {
            return Ok(table.clone());
        }
        let table = self.read_table(path)?.map(Arc::new);
        let mut tables = tables();
        let kept: usize = tables.values().flatten().map(|t| t.len()).sum();
        if kept + table.as_ref().map_or(0, |t| t.len()) > RECENT || tables.len() > RECENT {
            tables.clear();
        }
        tables.insert(shard, table.clone());
        Ok(table)
    }

    fn read_table(&self, path: &Path) -> Result<Option<Vec<[u64; 2]>>> {
        let (Some(shards), Some((file, size))) = (&self.array.shards, self.open(path)?) else {
            return Ok(None);
        };
        let count = shards
            .count
            .iter()
            .try_fold(16u64, |n, &c| n.checked_mul(c));
        let len = count
            .unwrap_or(u64::MAX)
            .saturating_add(4 * shards.index.len() as u64);
        let Some(end) = size.checked_sub(len) else {
            let found = format!("a shard of {size} bytes");
            let expected = format!("{len} bytes of its table alone");
            return Err(Error::format(path, found, expected));
        };
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, if shards.at_end { end } else { 0 })
            .map_err(|e| Error::io(path, "read", e))?;
        let words = codec::unpack(&shards.index, bytes, count.unwrap_or(0) as usize);
        let words = words.map_err(|e| {
            Error::format(
                path,
                format!("a table of a shard with {e:?}"),
                "a whole one",
            )
        })?;
        let words = words
            .as_chunks::<8>()
            .0
            .iter()
            .map(|w| u64::from_le_bytes(*w));
        Ok(Some(words.collect::<Vec<_>>().as_chunks::<2>().0.to_vec()))
    }

    /// Copies what of a chunk is inside the volume, x fastest.
    fn put(&self, index: [u32; 3], mut stored: Vec<u8>, out: &mut [u8]) {
        let array = &self.array;
        let sample = if array.half { 2 } else { array.dtype.bytes() };
        if array.coding.endian != Endian::NATIVE && sample > 1 {
            stored.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        // samples from one to the next along each axis of the array
        let mut strides = vec![0; array.chunk.len()];
        let mut stride = 1;
        for &axis in array.coding.order.iter().rev() {
            strides[axis] = stride;
            stride *= array.chunk[axis] as usize;
        }
        let shape = self.shape();
        let [nx, ny, nz] = [0, 1, 2].map(|a| {
            let start = u64::from(index[a]) * u64::from(shape[a]);
            u64::from(shape[a]).min(u64::from(self.dims.0[a]) - start) as usize
        });
        let [sx, sy, sz] = self.axes.map(|a| strides[a]);
        let size = array.dtype.bytes();
        let mut rows = out.chunks_exact_mut(nx * size);
        for k in 0..nz {
            for (j, row) in (&mut rows).take(ny).enumerate() {
                let start = k * sz + j * sy;
                if sx == 1 && !array.half {
                    row.copy_from_slice(&stored[start * size..(start + nx) * size]);
                    continue;
                }
                for (i, out) in row.chunks_exact_mut(size).enumerate() {
                    let at = (start + i * sx) * sample;
                    let from = &stored[at..at + sample];
                    if array.half {
                        let value = half::to_f32(u16::from_ne_bytes([from[0], from[1]]));
                        out.copy_from_slice(&value.to_ne_bytes());
                    } else {
                        out.copy_from_slice(from);
                    }
                }
            }
        }
        debug_assert!(array.dtype == Dtype::F32 || !array.half);
    }
}
