//! Where uncompressed sample bytes come from: a map, positioned reads, or one file per part.
//!
//! All sources show one string of bytes, the samples of the volume from the first to the last.

use crate::error::{Error, Result};
use crate::store::File;
use crate::volume::io::data::open_file;
use crate::volume::io::mmap::Map;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Equally long rows of bytes at equal distances.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    /// First byte of the first row.
    pub(crate) start: u64,
    /// Bytes of a row, at least 1.
    pub(crate) bytes: usize,
    /// From the start of a row to the start of the next; at least `bytes`.
    pub(crate) stride: u64,
}

impl Rows {
    /// One row.
    pub(crate) fn one(start: u64, bytes: usize) -> Self {
        Rows {
            start,
            bytes,
            stride: bytes as u64,
        }
    }

    /// The part of `out` and the first byte of each row.
    pub(crate) fn split(self, out: &mut [u8]) -> impl Iterator<Item = (u64, &mut [u8])> {
        out.chunks_exact_mut(self.bytes)
            .enumerate()
            .map(move |(r, row)| (self.start + r as u64 * self.stride, row))
    }
}

/// The sample bytes of a volume as one string.
pub(crate) trait ByteSource: Send + Sync {
    /// Fills `out`, a whole number of rows, all inside the string.
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()>;

    /// False if going back is slow.
    fn random_access(&self) -> bool {
        true
    }

    /// The most memory that the source keeps for itself.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// True if reading leaves mapped pages resident.
    fn is_map(&self) -> bool {
        false
    }

    /// These bytes will be read soon.
    fn prefetch(&self, _bytes: Range<u64>) {}

    /// These bytes will not be read soon.
    fn release(&self, _bytes: Range<u64>) {}
}

/// Rows of at least this many bytes are fetched by one call before they are copied, which saves a
/// fifth of the time for pages that are in the system's cache.
const POPULATE: usize = 256 << 10;

/// A mapped file.
#[derive(Debug)]
pub(crate) struct MapSource(pub(crate) Map);

impl ByteSource for MapSource {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        let bytes = self.0.bytes();
        for (start, row) in rows.split(out) {
            if row.len() >= POPULATE {
                self.0.populate(start..start + row.len() as u64);
            }
            let start = start as usize;
            row.copy_from_slice(&bytes[start..start + row.len()]);
        }
        Ok(())
    }

    fn is_map(&self) -> bool {
        true
    }

    fn prefetch(&self, bytes: Range<u64>) {
        self.0.prefetch(bytes);
    }

    fn release(&self, bytes: Range<u64>) {
        self.0.release(bytes);
    }
}

/// One file, read at positions; the file offset is never moved, so threads need no lock.
#[derive(Debug)]
pub(crate) struct FileSource {
    pub(crate) file: Arc<File>,
    pub(crate) path: PathBuf,
    /// Bytes before the first sample.
    pub(crate) offset: u64,
}

/// Rows with gaps up to this size are cheaper to read with their gaps: one call for many rows.
const SMALL_GAP: u64 = 8 << 10;
/// Size of the buffer for rows that are read with their gaps.
const GATHER: u64 = 1 << 20;

impl ByteSource for FileSource {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        let gap = rows.stride - rows.bytes as u64;
        let together = GATHER / rows.stride;
        if gap > SMALL_GAP || together < 2 || out.len() <= rows.bytes {
            return rows.split(out).try_for_each(|(start, row)| {
                read_at(&self.file, &self.path, self.offset + start, row)
            });
        }
        let mut buffer = Vec::new();
        for (i, group) in out.chunks_mut(rows.bytes * together as usize).enumerate() {
            let count = (group.len() / rows.bytes) as u64;
            let span = (count - 1) * rows.stride + rows.bytes as u64;
            buffer.resize(span as usize, 0);
            let start = rows.start + i as u64 * together * rows.stride;
            read_at(&self.file, &self.path, self.offset + start, &mut buffer)?;
            for (row, from) in group
                .chunks_exact_mut(rows.bytes)
                .zip(buffer.chunks(rows.stride as usize))
            {
                row.copy_from_slice(&from[..row.len()]);
            }
        }
        Ok(())
    }

    fn prefetch(&self, bytes: Range<u64>) {
        will_need(&self.file, self.offset, bytes);
    }
}

/// Reads exactly `out` at a position.
pub(crate) fn read_at(file: &File, path: &Path, position: u64, out: &mut [u8]) -> Result<()> {
    file.read_exact_at(out, position).map_err(|e| {
        if e.kind() == std::io::ErrorKind::UnexpectedEof {
            Error::format(
                path,
                format!(
                    "the file's end inside the {} bytes at {position}",
                    out.len()
                ),
                "the length the file had when it was opened",
            )
        } else {
            Error::io(path, "read", e)
        }
    })
}

#[cfg(target_os = "linux")]
fn will_need(file: &File, offset: u64, bytes: Range<u64>) {
    let Some(file) = file.local() else {
        return;
    };
    let len = std::num::NonZeroU64::new(bytes.end.saturating_sub(bytes.start));
    let Some(last) = len.map(|len| offset + bytes.start + len.get() - 1) else {
        return;
    };
    let start = offset + bytes.start;
    // the system looks at each page, which for a file in its cache took a hundredth of a sparse scan's time
    let mut some = (start..last).step_by(PROBE).chain([last]);
    if !some.all(|at| is_cached(file, at)) {
        // a refusal changes speed only
        let _ = rustix::fs::fadvise(file, start, len, rustix::fs::Advice::WillNeed);
    }
}

/// Of so many bytes, one is looked at to see whether the system has them in memory.
#[cfg(target_os = "linux")]
const PROBE: usize = 1 << 20;

/// Whether a byte can be read without waiting for the disk; false where the system cannot tell.
#[cfg(target_os = "linux")]
fn is_cached(file: &std::fs::File, at: u64) -> bool {
    use rustix::io::{ReadWriteFlags, preadv2};
    let mut byte = [0];
    let mut parts = [std::io::IoSliceMut::new(&mut byte)];
    preadv2(file, &mut parts, at, ReadWriteFlags::NOWAIT) == Ok(1)
}

#[cfg(not(target_os = "linux"))]
fn will_need(_file: &File, _offset: u64, _bytes: Range<u64>) {}

/// A file and where its samples begin.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) path: PathBuf,
    /// Bytes before the first sample (of compressed files: before the stream).
    pub(crate) offset: u64,
}

/// Many files of equal share, such as one per slice. A file is opened for each read, once per call:
/// thousands of slices need no file handles, and threads no lock.
#[derive(Debug)]
pub(crate) struct PartsSource {
    pub(crate) parts: Vec<Part>,
    /// Sample bytes in each file.
    pub(crate) part_bytes: u64,
}

impl ByteSource for PartsSource {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        let mut current: Option<(usize, File)> = None;
        for (start, row) in rows.split(out) {
            let (mut position, mut rest) = (start, row);
            while !rest.is_empty() {
                let index = (position / self.part_bytes) as usize;
                let inside = position % self.part_bytes;
                let count = (self.part_bytes - inside).min(rest.len() as u64) as usize;
                let (now, later) = rest.split_at_mut(count);
                let part = &self.parts[index];
                let file = match current.take() {
                    Some((open, file)) if open == index => file,
                    _ => open_file(&part.path)?,
                };
                read_at(&file, &part.path, part.offset + inside, now)?;
                current = Some((index, file));
                position += count as u64;
                rest = later;
            }
        }
        Ok(())
    }

    fn prefetch(&self, bytes: Range<u64>) {
        let first = bytes.start / self.part_bytes;
        let end = bytes
            .end
            .div_ceil(self.part_bytes)
            .min(self.parts.len() as u64);
        for part in first..end {
            let part = &self.parts[part as usize];
            if let Ok(file) = open_file(&part.path) {
                will_need(&file, part.offset, 0..self.part_bytes);
            }
        }
    }
}
