//! Long files past the page cache.
//!
//! What is written once, or read once, gains nothing by a copy in the page cache, and pays for it: the
//! system has to find a free page for every 4 KiB, and to copy. So whole blocks of long files go between our
//! buffers and the disk (`O_DIRECT`), where the file system can do that; the rest goes through the cache.

use crate::sys::huge_pages::{Pages, held};
use std::fs::File;
use std::io::{ErrorKind, Result};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// What offsets in files are multiples of: the block of most file systems.
const BLOCK: usize = 4096;
/// What addresses in memory are multiples of: the sector, which is all that devices ask for.
pub const SECTOR: usize = 512;
/// Less than this is faster through the cache, since each transfer waits for the disk.
pub const WORTH: usize = 128 << 10;

/// Bytes in memory that begin where transfers past the cache can begin.
#[derive(Debug, Default)]
pub struct Buffer {
    memory: Pages,
    /// Bytes in use; what is behind them is kept from before.
    len: usize,
}

impl Buffer {
    /// The bytes.
    pub fn get(&self) -> &[u8] {
        &self.memory[..self.len]
    }

    /// Bytes of memory that it holds.
    pub fn capacity(&self) -> usize {
        self.memory.len()
    }

    /// The bytes, to be changed.
    pub fn get_mut(&mut self) -> &mut [u8] {
        &mut self.memory[..self.len]
    }

    /// Replaces the bytes by `len` others, whose values mean nothing, with room for `bytes` in all.
    pub fn begin(&mut self, len: usize, bytes: usize) {
        let room = bytes.max(len);
        if self.memory.len() < room {
            self.memory.grow(and_more(room), and_more(len), 0);
        }
        self.len = len;
    }

    /// Bytes of memory that [`Buffer::begin`] takes beyond those asked for and a few more.
    pub fn rest_of_page(len: usize, bytes: usize) -> usize {
        let [used, room] = [len, bytes.max(len)].map(and_more);
        held(room, used) - room
    }

    /// Drops all but the first `len` bytes.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }

    /// Adds bytes.
    pub fn extend_from_slice(&mut self, more: &[u8]) {
        let end = self.len + more.len();
        if self.memory.len() < end {
            self.memory.grow(and_more(end), and_more(end), self.len);
        }
        self.memory[self.len..end].copy_from_slice(more);
        self.len = end;
    }

    /// Replaces the bytes by the first `len` of a file, or by fewer if it ends before. What is in the
    /// page cache already comes from there.
    ///
    /// # Errors
    /// [`ErrorKind::OutOfMemory`]; the system's.
    pub fn read(&mut self, file: &File, len: usize) -> Result<()> {
        self.len = 0;
        if self.memory.len() < len {
            self.memory = Pages::default();
            self.memory = Pages::new(len, len)?;
        }
        let out = &mut self.memory[..len];
        let absent = absent(file, len);
        let first = absent.start;
        let past = read_past_cache(file, &mut out[absent], first)?;
        let (before, rest) = out.split_at_mut(first);
        let mut found = read_at(file, before, 0)?;
        if found == first {
            found += past + read_at(file, &mut rest[past..], first + past)?;
        }
        self.len = found;
        Ok(())
    }
}

/// With room to spare: the next ones may be a little longer.
fn and_more(bytes: usize) -> usize {
    bytes + bytes / 8
}

/// Reads up to the end of `out` or of the file.
fn read_at(file: &File, out: &mut [u8], at: usize) -> Result<usize> {
    let mut done = 0;
    while done < out.len() {
        match file.read_at(&mut out[done..], (at + done) as u64) {
            Ok(0) => break,
            Ok(n) => done += n,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(done)
}

/// Writes a new file from byte `start` on, whole blocks past the cache.
///
/// For that, `start` is a multiple of [`SECTOR`], and the bytes lie in a [`Buffer`].
///
/// # Errors
/// The system's, with what could not be done.
pub fn write(
    path: &Path,
    start: usize,
    body: &[u8],
) -> std::result::Result<(), (&'static str, std::io::Error)> {
    let file = File::create(path).map_err(|e| ("create", e))?;
    put(&file, start, body).map_err(|e| ("write", e))
}

fn put(file: &File, start: usize, body: &[u8]) -> Result<()> {
    let first = start.next_multiple_of(BLOCK);
    let last = (start + body.len()) / BLOCK * BLOCK;
    let mut done = start..start;
    if last > first {
        let blocks = &body[first - start..last - start];
        done = first..first + write_past_cache(file, blocks, first)?;
    }
    file.write_all_at(&body[..done.start - start], start as u64)?;
    file.write_all_at(&body[done.end - start..], done.end as u64)
}

/// Writes whole blocks past the cache, as many as that works for.
fn write_past_cache(file: &File, blocks: &[u8], at: usize) -> Result<usize> {
    let step = |done: usize| file.write_at(&blocks[done..], (at + done) as u64);
    past_cache(file, (blocks.as_ptr().addr(), blocks.len()), step)
}

/// Reads whole blocks past the cache, as many as that works for.
fn read_past_cache(file: &File, blocks: &mut [u8], at: usize) -> Result<usize> {
    let memory = (blocks.as_ptr().addr(), blocks.len());
    past_cache(file, memory, |done| {
        file.read_at(&mut blocks[done..], (at + done) as u64)
    })
}

/// Transfers `length` bytes of whole blocks from or to `address` while the file's mode is direct; fewer,
/// or none, where the system cannot do that. Errors of the disk are errors: the cache would hide them.
#[cfg(target_os = "linux")]
fn past_cache(
    file: &File,
    (address, length): (usize, usize),
    mut step: impl FnMut(usize) -> Result<usize>,
) -> Result<usize> {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    if length == 0 || !address.is_multiple_of(SECTOR) {
        return Ok(0);
    }
    let flags = fcntl_getfl(file)?;
    if fcntl_setfl(file, flags | OFlags::DIRECT).is_err() {
        return Ok(0);
    }
    let mut done = Ok(0);
    while let Ok(bytes) = done
        && bytes < length
    {
        match step(bytes) {
            Ok(n) if n > 0 && n.is_multiple_of(BLOCK) => done = Ok(bytes + n),
            Ok(_) => break,
            Err(e) => match e.kind() {
                ErrorKind::Interrupted => {}
                ErrorKind::InvalidInput | ErrorKind::Unsupported => break,
                _ => done = Err(e),
            },
        }
    }
    fcntl_setfl(file, flags)?;
    done
}

#[cfg(not(target_os = "linux"))]
fn past_cache(
    _file: &File,
    _memory: (usize, usize),
    _step: impl FnMut(usize) -> Result<usize>,
) -> Result<usize> {
    Ok(0)
}

/// The longest stretch of whole blocks in the first `len` bytes of a file that the page cache does not
/// hold; empty if it is not worth a transfer of its own, or nobody knows.
#[cfg(target_os = "linux")]
fn absent(file: &File, len: usize) -> Range<usize> {
    if len < WORTH {
        return 0..0;
    }
    // SAFETY: the mapped bytes are never looked at, so it does not matter who changes them.
    let Ok(map) = (unsafe { memmap2::MmapOptions::new().len(len).map(file) }) else {
        return 0..0;
    };
    let page = rustix::param::page_size().max(BLOCK);
    let mut held = vec![0u8; len.div_ceil(page)];
    // SAFETY: the range is that of the map, and `held` has a byte for each of its pages.
    let told = unsafe { libc::mincore(map.as_ptr() as *mut _, len, held.as_mut_ptr()) };
    if told != 0 {
        return 0..0;
    }
    let (mut longest, mut first) = (0..0, 0);
    for stretch in held.chunk_by(|a, b| a & 1 == b & 1) {
        let bytes = first * page..((first + stretch.len()) * page).min(len) / BLOCK * BLOCK;
        if stretch[0] & 1 == 0 && bytes.len() > longest.len() {
            longest = bytes;
        }
        first += stretch.len();
    }
    if longest.len() < WORTH {
        return 0..0;
    }
    longest
}

#[cfg(not(target_os = "linux"))]
fn absent(_file: &File, _len: usize) -> Range<usize> {
    0..0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bytes that differ from block to block.
    fn bytes(len: usize) -> Vec<u8> {
        (0..len).map(|i| (i * 7 + i / BLOCK) as u8).collect()
    }

    /// A directory beside the build, which is more often on a disk than the temporary one.
    fn dir() -> tempfile::TempDir {
        tempfile::tempdir_in(env!("CARGO_MANIFEST_DIR")).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        /// What is written is read, however its parts lie to the blocks, and whatever is cached.
        #[test]
        fn files_come_back(sectors in 0usize..20, odd in 0usize..600, len in 1usize..700_000) {
            let (dir, head) = (dir(), sectors * SECTOR + odd / 599 * 100);
            let path = dir.path().join("file");
            let mut all = bytes(head + len);
            all[..head].fill(0);
            let mut body = Buffer::default();
            body.begin(0, len);
            body.extend_from_slice(&all[head..]);
            write(&path, head, body.get()).unwrap();
            prop_assert!(std::fs::read(&path).unwrap() == all);
            write(&path, head, body.get()).unwrap();
            let file = File::open(&path).unwrap();
            for (len, expected) in [(all.len(), all.len()), (all.len() / 3, all.len() / 3),
                (all.len() + 100_000, all.len())] {
                body.read(&file, len).unwrap();
                prop_assert!(body.get() == &all[..expected]);
            }
        }
    }

    #[test]
    fn what_is_a_little_longer_or_shorter_takes_no_other_memory() {
        for len in [200_000, 1_000_000, 3_000_000] {
            let mut buffer = Buffer::default();
            buffer.begin(len, len + len / 4);
            let held = (buffer.get().as_ptr(), buffer.capacity());
            for next in [len + len / 16, len / 2, len] {
                buffer.begin(next, next + next / 4);
                assert_eq!((buffer.get().as_ptr(), buffer.capacity()), held);
            }
        }
    }

    #[test]
    fn blocks_go_past_the_cache_where_the_file_system_can() {
        let dir = dir();
        let path = dir.path().join("file");
        let all = bytes(1 << 20);
        let mut body = Buffer::default();
        body.extend_from_slice(&all);
        write(&path, SECTOR, body.get()).unwrap();
        let file = File::open(&path).unwrap();
        let absent = absent(&file, all.len() + SECTOR);
        if absent.is_empty() {
            eprintln!("SKIPPED: {} holds files in memory", dir.path().display());
            return;
        }
        assert_eq!(absent, BLOCK..(1 << 20));
        body.read(&file, all.len() + SECTOR).unwrap();
        assert_eq!(body.get()[SECTOR..], all);
        assert_eq!(super::absent(&file, all.len()), BLOCK..(1 << 20));
        // read in the usual way, it is in the cache
        assert_eq!(std::fs::read(&path).unwrap().len(), all.len() + SECTOR);
        assert_eq!(super::absent(&file, all.len()), 0..0);
        body.read(&file, all.len() + SECTOR).unwrap();
        assert_eq!(body.get()[SECTOR..], all);
    }

    #[test]
    fn bytes_that_lie_badly_are_written_all_the_same() {
        let dir = dir();
        let path = dir.path().join("file");
        let all = bytes(400_000);
        for start in [1, 8, 256] {
            write(&path, SECTOR, &all[start..]).unwrap();
            let expected = [&[0; SECTOR], &all[start..]].concat();
            assert!(std::fs::read(&path).unwrap() == expected);
        }
    }
}
