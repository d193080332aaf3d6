//! Volumes in chunks or pages, each of which is decoded once, into a temporary file.
//!
//! Bands of a slab share chunks with the bands beside them and with the next slab, so chunks of 128^3 would be
//! decoded a dozen times over, and memory has no room for a slab of them. In a file they stay until the sweep
//! has passed them; then others take their place.

use crate::error::{Error, Result};
use crate::sys::locks::{self, lock};
use crate::volume::{Header, Volume};
use rayon::prelude::*;
use std::collections::HashMap;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex};

/// Places in the file begin at multiples of this.
const PAGE: u64 = 4096;

/// The parts of a volume that are decoded as a whole.
pub(crate) trait Parts: Volume {
    /// Bytes of the largest.
    fn largest(&self) -> u64;

    /// Those that a box of at least one voxel meets.
    fn parts_of(&self, asked: &[Range<u32>; 3]) -> Result<Vec<Shared>>;

    /// Fills `out` with a part. Does so in the calling thread alone.
    fn decode(&self, shared: &Shared, out: &mut [u8]) -> Result<()>;

    /// The first slice behind a part.
    fn end(&self, index: [u32; 3]) -> u32;
}

/// A part that a box meets.
pub(crate) struct Shared {
    /// Its own number among the parts, whichever box meets it.
    pub(crate) index: [u32; 3],
    /// Its voxels, x fastest; padded ones may lie outside the volume.
    pub(crate) part: [Range<u32>; 3],
    /// Those of them that are asked for.
    pub(crate) both: [Range<u32>; 3],
}

impl Shared {
    /// What a part and a box share.
    pub(crate) fn new(index: [u32; 3], part: [Range<u32>; 3], asked: &[Range<u32>; 3]) -> Self {
        let both =
            [0, 1, 2].map(|a| part[a].start.max(asked[a].start)..part[a].end.min(asked[a].end));
        Shared { index, part, both }
    }

    /// Samples of the whole part.
    pub(crate) fn samples(&self) -> usize {
        self.part.iter().map(|r| r.len()).product()
    }
}

/// A volume whose parts are kept as they are decoded, until they are released.
pub(crate) struct Unpacked<'a> {
    volume: &'a dyn Parts,
    store: Store,
}

impl<'a> Unpacked<'a> {
    /// Will keep parts in an unnamed file in `dir`, which goes away with this, also if the process dies.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub(crate) fn new(volume: &'a dyn Parts, dir: &Path) -> Result<Self> {
        let store = Store::new(dir, volume.largest())?;
        Ok(Unpacked { volume, store })
    }

    /// Where parts are in the file, once they are.
    fn slots(&self, all: Vec<Shared>) -> Result<Vec<(Shared, Arc<Slot>)>> {
        let slot = |shared: &Shared, wait| {
            let bytes = shared.samples() * self.header().dtype.bytes();
            let decode = |out: &mut [u8]| self.volume.decode(shared, out);
            self.store.get(shared.index, bytes, wait, decode)
        };
        // what others are about to decode is waited for when nothing else is left to do
        let begun = all
            .par_iter()
            .with_max_len(1)
            .map(|shared| slot(shared, false));
        let begun: Vec<Option<Arc<Slot>>> = begun.collect::<Result<_>>()?;
        let slots = all.into_iter().zip(begun).map(|(shared, begun)| {
            let found = match begun {
                Some(slot) => slot,
                None => slot(&shared, true)?.expect("waited for"),
            };
            Ok((shared, found))
        });
        slots.collect()
    }

    /// Copies what of slice `k` the box and a part share to that slice of the box, by way of `rows`, memory that is used
    /// again.
    fn copy(
        &self,
        asked: &[Range<u32>; 3],
        k: u32,
        of: &(Shared, Arc<Slot>),
        rows: &mut Vec<u8>,
        out: &mut [u8],
    ) -> Result<()> {
        let (shared, slot) = of;
        let Shared { part, both, .. } = shared;
        let sample = self.header().dtype.bytes();
        let row = part[0].len() * sample;
        let plane = (k - part[2].start) as usize * part[1].len();
        let first = (plane + (both[1].start - part[1].start) as usize) * row;
        let bytes = both[1].len() * row;
        let row_out = asked[0].len() * sample;
        let to = (both[1].start - asked[1].start) as usize * row_out;
        if part[0] == asked[0] {
            return self
                .store
                .read(slot, first as u64, &mut out[to..to + bytes]);
        }
        rows.resize(bytes, 0);
        self.store.read(slot, first as u64, rows)?;
        let skip = (both[0].start - part[0].start) as usize * sample;
        let to = to + (both[0].start - asked[0].start) as usize * sample;
        let len = both[0].len() * sample;
        for (out, from) in out[to..].chunks_mut(row_out).zip(rows.chunks_exact(row)) {
            out[..len].copy_from_slice(&from[skip..skip + len]);
        }
        Ok(())
    }
}

impl Volume for Unpacked<'_> {
    fn header(&self) -> &Header {
        self.volume.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let asked = [x, y, z];
        let parts = self.slots(self.volume.parts_of(&asked)?)?;
        let slice = out.len() / asked[2].len();
        let mut rows = Vec::new();
        for (k, out) in asked[2].clone().zip(out.chunks_exact_mut(slice)) {
            for of in parts.iter().filter(|of| of.0.both[2].contains(&k)) {
                self.copy(&asked, k, of, &mut rows, out)?;
            }
        }
        Ok(())
    }

    fn grain(&self) -> [u32; 3] {
        self.volume.grain()
    }

    fn held_bytes(&self) -> u64 {
        self.volume.held_bytes()
    }

    fn release(&self, z: Range<u32>) {
        self.store.forget(|index| self.volume.end(index) <= z.end);
    }
}

/// Decoded chunks in a file.
struct Store {
    file: File,
    dir: PathBuf,
    /// Bytes from one place for a chunk to the next.
    stride: u64,
    chunks: Mutex<Chunks>,
    /// Some chunk is there that was being decoded, or will not come.
    decoded: Condvar,
    places: Arc<Mutex<Places>>,
}

#[derive(Default)]
struct Chunks {
    /// `None` while a thread decodes it.
    slots: HashMap<[u32; 3], Option<Arc<Slot>>>,
    /// Memory to decode in.
    spare: Vec<Vec<u8>>,
}

/// Places of the file.
#[derive(Default)]
struct Places {
    free: Vec<u64>,
    /// The first that nobody has had.
    end: u64,
}

/// A place in the file, free for others once nobody reads there.
struct Slot {
    place: u64,
    places: Arc<Mutex<Places>>,
}

impl Drop for Slot {
    fn drop(&mut self) {
        lock(&self.places).free.push(self.place);
    }
}

impl Store {
    /// For chunks of at most `bytes`.
    fn new(dir: &Path, bytes: u64) -> Result<Self> {
        let fail = |e| Error::io(dir, "write a temporary copy of the volume", e);
        Ok(Store {
            file: crate::sys::temp_file::unnamed(dir).map_err(fail)?,
            dir: dir.to_path_buf(),
            stride: bytes.next_multiple_of(PAGE),
            chunks: Mutex::default(),
            decoded: Condvar::new(),
            places: Arc::default(),
        })
    }

    /// Where a chunk of `bytes` is; it is decoded by the first who asks. `decode` must not wait for other threads:
    /// those who ask for the same chunk wait for it, or, without `wait`, get `None`.
    ///
    /// # Errors
    /// Those of `decode`; [`Error::Io`] if the disk is full.
    fn get(
        &self,
        index: [u32; 3],
        bytes: usize,
        wait: bool,
        decode: impl FnOnce(&mut [u8]) -> Result<()>,
    ) -> Result<Option<Arc<Slot>>> {
        let mut chunks = lock(&self.chunks);
        loop {
            match chunks.slots.get(&index) {
                Some(Some(slot)) => return Ok(Some(slot.clone())),
                Some(None) if !wait => return Ok(None),
                Some(None) => chunks = locks::wait(&self.decoded, chunks),
                None => break,
            }
        }
        chunks.slots.insert(index, None);
        let buffer = chunks.spare.pop().unwrap_or_default();
        drop(chunks);
        let mut work = Decoding {
            store: self,
            index,
            buffer,
            slot: None,
        };
        work.buffer.resize(bytes, 0);
        decode(&mut work.buffer)?;
        let slot = self.place();
        self.file
            .write_all_at(&work.buffer, slot.place * self.stride)
            .map_err(|e| Error::io(&self.dir, "write a temporary copy of the volume", e))?;
        work.slot = Some(slot.clone());
        Ok(Some(slot))
    }

    fn place(&self) -> Arc<Slot> {
        let mut places = lock(&self.places);
        let place = places.free.pop().unwrap_or_else(|| {
            places.end += 1;
            places.end - 1
        });
        drop(places);
        Arc::new(Slot {
            place,
            places: self.places.clone(),
        })
    }

    /// Fills `out` from byte `at` of a chunk on.
    fn read(&self, slot: &Slot, at: u64, out: &mut [u8]) -> Result<()> {
        self.file
            .read_exact_at(out, slot.place * self.stride + at)
            .map_err(|e| Error::io(&self.dir, "read a temporary copy of the volume", e))
    }

    /// Forgets chunks that were decoded.
    fn forget(&self, which: impl Fn([u32; 3]) -> bool) {
        lock(&self.chunks)
            .slots
            .retain(|&index, slot| slot.is_none() || !which(index));
    }
}

/// A chunk that a thread decodes: whatever becomes of it, others are told.
struct Decoding<'a> {
    store: &'a Store,
    index: [u32; 3],
    buffer: Vec<u8>,
    slot: Option<Arc<Slot>>,
}

impl Drop for Decoding<'_> {
    fn drop(&mut self) {
        let mut chunks = lock(&self.store.chunks);
        match self.slot.take() {
            Some(slot) => chunks.slots.insert(self.index, Some(slot)),
            None => chunks.slots.remove(&self.index),
        };
        chunks.spare.push(std::mem::take(&mut self.buffer));
        drop(chunks);
        self.store.decoded.notify_all();
    }
}

#[cfg(all(test, any(feature = "hdf5", feature = "zarr")))]
mod tests {
    use super::*;
    use crate::volume::io::chunked::ChunkedVolume;
    use crate::volume::io::chunked::tests::Counting;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Threads that read all at once, each in an order of its own, have every chunk decoded once; places of chunks
    /// that were released are used again.
    #[test]
    fn chunks_are_decoded_once_and_leave() {
        let dims = [8, 8, 64];
        let chunks = Counting::new([4, 4, 4], dims);
        let decoded = chunks.decoded.clone();
        let volume = ChunkedVolume::new(chunks.header(), Box::new(chunks));
        let dir = tempfile::tempdir().unwrap();
        let once = Unpacked::new(&volume, dir.path()).unwrap();
        for slab in 0..7 {
            let z = 8 * slab..8 * slab + 9;
            let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build();
            pool.unwrap().broadcast(|thread| {
                for i in 0..8 {
                    let y = (i + 2 * thread.index() as u32) % 8;
                    let mut out = vec![0; 4 * 8 * 9];
                    let read = once.read_box(0..8, y..y + 1, z.clone(), &mut out);
                    read.unwrap();
                    let first = u32::from_ne_bytes(out[..4].try_into().unwrap());
                    assert_eq!(first, 10 * y + 100 * z.start);
                }
            });
            once.release(z.start..z.end - 1);
        }
        assert_eq!(decoded.load(Ordering::Relaxed), 4 * 15);
        let len = once.store.file.metadata().unwrap().len();
        assert_eq!(len, (4 * 3 - 1) * PAGE + 4 * 4 * 4 * 4);
        assert_eq!(dir.path().read_dir().unwrap().count(), 0);
    }

    /// A chunk that cannot be decoded is an error for everyone who asks, and no one waits for it for ever.
    #[test]
    fn a_chunk_that_fails_may_come_later() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::new(dir.path(), 3).unwrap();
        let tries = AtomicUsize::new(0);
        let decode = |out: &mut [u8]| {
            std::thread::yield_now();
            match tries.fetch_add(1, Ordering::Relaxed) {
                0..5 => Err(Error::Interrupted),
                _ => {
                    out.copy_from_slice(b"abc");
                    Ok(())
                }
            }
        };
        let got = std::thread::scope(|scope| {
            let ask = || {
                (0..3)
                    .filter(|_| store.get([0; 3], 3, true, decode).is_ok())
                    .count()
            };
            let asked = [scope.spawn(ask), scope.spawn(ask), scope.spawn(ask)];
            asked
                .map(|thread| thread.join().unwrap())
                .iter()
                .sum::<usize>()
        });
        assert_eq!((got, tries.into_inner()), (4, 6));
        let slot = store.get([0; 3], 3, true, |_| panic!("it is there"));
        let mut out = [0; 2];
        store.read(&slot.unwrap().unwrap(), 1, &mut out).unwrap();
        assert_eq!(&out, b"bc");
    }
}
