//! The files of an array's chunks and shards, and the tables of shards.

use crate::error::{Error, Result};
use crate::store::{self, File, is_remote};
use crate::sys::locks::lock;
use crate::volume::codecs::blosc::Broken;
use crate::volume::formats::zarr::codec;
use crate::volume::formats::zarr::codec::crc32c;
use crate::volume::formats::zarr::meta::{Array, ChunkKey};
use crate::volume::io::data;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Tables of shards that are kept, in entries of 16 bytes, unless one has more.
const RECENT: u64 = 1 << 20;

/// Places of the chunks of a shard: position and length, [`NONE`] for none.
type Table = Arc<Vec<[u64; 2]>>;

/// The place of a chunk that is not in its shard.
pub(crate) const NONE: [u64; 2] = [u64::MAX; 2];

/// The files of an array.
pub(crate) struct Files {
    folder: PathBuf,
    pub(crate) array: Array,
    /// Bytes of a chunk as stored.
    pub(crate) bytes: usize,
    tables: Mutex<HashMap<PathBuf, Option<Table>>>,
}

/// What a thread has open.
#[derive(Default)]
pub(crate) struct Cursor {
    shard: Option<Shard>,
}

struct Shard {
    path: PathBuf,
    /// The file, its size, and its table.
    open: Option<(File, u64, Table)>,
}

impl Files {
    /// The files of an array in a folder; `bytes` is the size of a chunk as stored.
    pub(crate) fn new(folder: PathBuf, array: Array, bytes: usize) -> Self {
        Files {
            folder,
            array,
            bytes,
            tables: Mutex::default(),
        }
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file of a chunk or shard.
    pub(crate) fn file(&self, place: &[u64]) -> PathBuf {
        let ChunkKey { front, separator } = self.array.key;
        let mut key = front.to_owned();
        for (i, n) in place.iter().enumerate() {
            if i > 0 || !front.is_empty() {
                key.push(separator);
            }
            key += &n.to_string();
        }
        self.folder.join(key)
    }

    /// The file at a path, and its size; `None` if there is none.
    ///
    /// # Errors
    /// [`Error::Format`] for what is no regular file.
    pub(crate) fn open(&self, path: &Path) -> Result<Option<(File, u64)>> {
        let open = || -> Result<(File, u64)> {
            let fail = |e| Error::io(path, "open", e);
            if !is_remote(path) {
                let size = data::file_len(path)?;
                return Ok((File::open(path).map_err(fail)?, size));
            }
            // a chunk comes with the answer that tells its size, and of a shard no more than is asked for
            let file = match self.array.shards {
                None => File::open(path),
                Some(_) => File::open_for_parts(path),
            };
            let file = file.map_err(fail)?;
            let size = file.len().map_err(fail)?;
            Ok((file, size))
        };
        match open() {
            Ok(open) => Ok(Some(open)),
            // unless all of it is gone
            Err(Error::Io { source, .. })
                if source.kind() == ErrorKind::NotFound && store::is_dir(&self.folder) =>
            {
                Ok(None)
            }
            Err(e) => Err(e),
        }
    }

    /// A chunk as stored, unpacked; `None` if it is not there.
    pub(crate) fn chunk(&self, place: &[u64], cursor: &mut Cursor) -> Result<Option<Vec<u8>>> {
        let Some((path, packed)) = self.packed(place, cursor)? else {
            return Ok(None);
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
        Ok(Some(stored))
    }

    /// The bytes of a chunk as they are in its file.
    fn packed(&self, place: &[u64], cursor: &mut Cursor) -> Result<Option<(PathBuf, Vec<u8>)>> {
        let Some(shards) = &self.array.shards else {
            let path = self.file(place);
            let Some((file, size)) = self.open(&path)? else {
                return Ok(None);
            };
            let bytes = self.read(&path, &file, 0..size, size)?;
            return Ok(Some((path, bytes)));
        };
        let counts = shards.count.iter();
        let outer: Vec<u64> = place
            .iter()
            .zip(counts.clone())
            .map(|(p, n)| p / n)
            .collect();
        let path = self.file(&outer);
        if cursor.shard.as_ref().is_none_or(|shard| shard.path != path) {
            let open = match (self.table(&path)?, self.open(&path)?) {
                (Some(table), Some((file, size))) => Some((file, size, table)),
                _ => None,
            };
            let path = path.clone();
            cursor.shard = Some(Shard { path, open });
        }
        let open = cursor.shard.as_ref().and_then(|shard| shard.open.as_ref());
        let Some((file, size, table)) = open else {
            return Ok(None);
        };
        // a table of that many is there
        let at = place
            .iter()
            .zip(counts)
            .fold(0, |at, (p, n)| at * n + p % n);
        let [start, len] = table[at as usize];
        if [start, len] == NONE {
            return Ok(None);
        }
        let bytes = self.read(&path, file, start..start.saturating_add(len), *size)?;
        Ok(Some((path, bytes)))
    }

    fn read(&self, path: &Path, file: &File, part: Range<u64>, size: u64) -> Result<Vec<u8>> {
        let most = codec::largest(&self.array.coding.packing, self.bytes) as u64;
        let (start, len) = (part.start, part.end - part.start);
        if part.end > size || len > most {
            let found = format!("a chunk of {len} bytes at {start} of {size}");
            return Err(Error::format(path, found, format!("at most {most}")));
        }
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, start)
            .map_err(|e| Error::io(path, "read", e))?;
        Ok(bytes)
    }

    /// The table of a shard. One thread at a time reads one, since it may be large.
    fn table(&self, path: &Path) -> Result<Option<Table>> {
        let mut tables = lock(&self.tables);
        if let Some(table) = tables.get(path) {
            return Ok(table.clone());
        }
        let kept: usize = tables.values().flatten().map(|t| t.len()).sum();
        let more = self.entries().unwrap_or(0);
        if kept as u64 + more > RECENT || tables.len() as u64 > RECENT / 16 {
            tables.clear();
        }
        let table = self.read_table(path)?.map(Arc::new);
        tables.insert(path.to_path_buf(), table.clone());
        Ok(table)
    }

    /// Chunks in a shard.
    fn entries(&self) -> Option<u64> {
        let shards = self.array.shards.as_ref()?;
        Some(
            shards
                .count
                .iter()
                .fold(1, |n: u64, &c| n.saturating_mul(c)),
        )
    }

    /// Bytes that tables of shards take, with those that `threads` threads hold on to.
    pub(crate) fn table_bytes(&self, threads: u64) -> u64 {
        let (Some(one), Some(shards)) = (self.entries(), &self.array.shards) else {
            return 0;
        };
        let (shape, chunk) = (self.array.shape.iter(), self.array.chunk.iter());
        let counts = shape.zip(chunk.zip(&shards.count));
        let all = counts.fold(one, |n, (s, (c, k))| {
            n.saturating_mul(s.div_ceil(c.saturating_mul(*k)))
        });
        let held = one.max(RECENT).saturating_add(threads.saturating_mul(one));
        16u64.saturating_mul(all.min(held))
    }

    /// Where the table of a shard of `size` bytes begins, and how many bytes it has.
    pub(crate) fn table_place(&self, path: &Path, size: u64) -> Result<(u64, u64)> {
        let shards = self.array.shards.as_ref();
        let sum = shards.map_or(0, |s| 4 * u64::from(s.checked));
        let len = self.entries().unwrap_or(0).saturating_mul(16);
        match size.checked_sub(len.saturating_add(sum)) {
            Some(end) => Ok((
                if shards.is_some_and(|s| s.at_end) {
                    end
                } else {
                    0
                },
                len,
            )),
            None => {
                let found = format!("a shard of {size} bytes");
                Err(Error::format(
                    path,
                    found,
                    format!("{len} bytes of its table alone"),
                ))
            }
        }
    }

    fn read_table(&self, path: &Path) -> Result<Option<Vec<[u64; 2]>>> {
        let (Some(shards), Some((file, size))) = (&self.array.shards, self.open(path)?) else {
            return Ok(None);
        };
        let (start, len) = self.table_place(path, size)?;
        let fail = |e| Error::io(path, "read", e);
        let mut table = vec![NONE; (len / 16) as usize];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut table);
        file.read_exact_at(bytes, start).map_err(fail)?;
        if shards.checked {
            let mut sum = [0; 4];
            file.read_exact_at(&mut sum, start + len).map_err(fail)?;
            if crc32c(bytes) != u32::from_le_bytes(sum) {
                let found = "a table of a shard with a wrong checksum";
                return Err(Error::format(path, found, "a whole one"));
            }
        }
        table
            .as_flattened_mut()
            .iter_mut()
            .for_each(|word| *word = u64::from_le(*word));
        Ok(Some(table))
    }
}
