//! Image file directories: the tags of a page, of classic TIFF and BigTIFF.
//!
//! Numbers of tags and types are those of TIFF 6.0
//! (<https://www.itu.int/itudoc/itu-t/com16/tiff-fx/docs/tiff6.pdf>) and, for BigTIFF,
//! <https://www.awaresystems.be/imaging/tiff/bigtiff.html>.

use crate::error::{Error, Result};
use crate::volume::Endian;
use crate::volume::io::blob::{Bytes, Section};
use std::io::BufReader;

/// A directory with more entries is damaged.
const MAX_ENTRIES: u64 = 4096;
/// A page in more parts than this is damaged, or not worth its tags.
const MAX_VALUES: u64 = 1 << 20;
/// Text beyond this is not looked at.
const MAX_TEXT: u64 = 64 << 10;

/// Text that is read piece by piece is cut here.
const MAX_XML: u64 = 256 << 20;

/// A TIFF file and what its first bytes say.
pub(crate) struct File<'a> {
    pub(crate) bytes: &'a Bytes,
    pub(crate) endian: Endian,
    big: bool,
}

/// One tag: its type, number of values and where they are.
#[derive(Debug, Clone, Copy)]
struct Entry {
    tag: u16,
    kind: u16,
    count: u64,
    position: u64,
}

/// The tags of a page and the position of the next directory, 0 at the end.
pub(crate) struct Directory<'a> {
    file: &'a File<'a>,
    pub(crate) position: u64,
    entries: Vec<Entry>,
    pub(crate) next: u64,
}

impl<'a> File<'a> {
    /// Reads the header; also returns the position of the first directory.
    pub(crate) fn open(bytes: &'a Bytes) -> Result<(Self, u64)> {
        let mut head = [0; 16];
        let len = bytes.len().min(16) as usize;
        bytes.read_at(0, &mut head[..len])?;
        let endian = if head.starts_with(b"II") {
            Endian::Little
        } else {
            Endian::Big
        };
        let mut file = File {
            bytes,
            endian,
            big: false,
        };
        let magic = file.number(&head[2..4]);
        file.big = magic == 43;
        let first = match magic {
            42 => file.number(&head[4..8]),
            43 if file.number(&head[4..6]) == 8 && file.number(&head[6..8]) == 0 => {
                file.number(&head[8..16])
            }
            _ => {
                let found = format!("the numbers {magic} and {}", head[4..8].escape_ascii());
                return Err(Error::format(
                    bytes.path(),
                    found,
                    "a TIFF or BigTIFF header",
                ));
            }
        };
        Ok((file, first))
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        let join = |n: u64, b: &u8| n << 8 | u64::from(*b);
        match self.endian {
            Endian::Big => bytes.iter().fold(0, join),
            Endian::Little => bytes.iter().rev().fold(0, join),
        }
    }

    /// Reads the directory at a position.
    pub(crate) fn directory(&'a self, position: u64) -> Result<Directory<'a>> {
        let (count_len, entry_len, offset_len) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let mut buffer = vec![0; count_len];
        self.bytes.read_at(position, &mut buffer)?;
        let count = self.number(&buffer);
        if count == 0 || count > MAX_ENTRIES {
            let found = format!("a directory of {count} tags at position {position}");
            let expected = format!("1 to {MAX_ENTRIES} tags");
            return Err(Error::format(self.bytes.path(), found, expected));
        }
        buffer.resize(count as usize * entry_len + offset_len, 0);
        let start = position + count_len as u64;
        self.bytes.read_at(start, &mut buffer)?;
        let mut entries = Vec::with_capacity(count as usize);
        for (i, entry) in buffer
            .chunks_exact(entry_len)
            .take(count as usize)
            .enumerate()
        {
            let value = &entry[entry_len - offset_len..];
            let (kind, count) = (
                self.number(&entry[2..4]) as u16,
                self.number(&entry[4..entry_len - offset_len]),
            );
            let inside = count.saturating_mul(size_of_type(kind)) <= offset_len as u64;
            let place = start + (i * entry_len + entry_len - offset_len) as u64;
            entries.push(Entry {
                tag: self.number(&entry[..2]) as u16,
                kind,
                count,
                position: if inside { place } else { self.number(value) },
            });
        }
        Ok(Directory {
            file: self,
            position,
            entries,
            next: self.number(&buffer[count as usize * entry_len..]),
        })
    }
}

/// A fraction of two numbers above 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ratio {
    pub(crate) above: u64,
    pub(crate) below: u64,
}

/// Bytes per value of a type; 0 for types that are not known.
fn size_of_type(kind: u16) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 0,
    }
}

impl Directory<'_> {
    fn find(&self, tag: u16) -> Option<Entry> {
        self.entries.iter().find(|e| e.tag == tag).copied()
    }

    fn raw(&self, entry: Entry, most: u64) -> Result<Vec<u8>> {
        let size = size_of_type(entry.kind);
        let len = entry.count.saturating_mul(size);
        if len > most.min(self.file.bytes.len()) {
            let found = format!("tag {} with {} values", entry.tag, entry.count);
            return Err(Error::format(
                self.file.bytes.path(),
                found,
                "no more than the file can hold",
            ));
        }
        let mut out = vec![0; len as usize];
        self.file.bytes.read_at(entry.position, &mut out)?;
        Ok(out)
    }

    /// Whole numbers; `None` if the tag is missing.
    pub(crate) fn numbers(&self, tag: u16) -> Result<Option<Vec<u64>>> {
        let Some(entry) = self.find(tag) else {
            return Ok(None);
        };
        let size = size_of_type(entry.kind);
        if !matches!(entry.kind, 1 | 3 | 4 | 13 | 16 | 18) || entry.count == 0 {
            let found = format!(
                "tag {tag} with {} values of type {}",
                entry.count, entry.kind
            );
            return Err(Error::format(
                self.file.bytes.path(),
                found,
                "whole numbers from 0 up",
            ));
        }
        let bytes = self.raw(entry, MAX_VALUES * 8)?;
        let chunks = bytes.chunks_exact(size as usize);
        Ok(Some(chunks.map(|c| self.file.number(c)).collect()))
    }

    /// One number, or `default` if the tag is missing. All values must be equal, as for the bits of
    /// the samples of a colour.
    pub(crate) fn number(&self, tag: u16, default: u64) -> Result<u64> {
        let Some(values) = self.numbers(tag)? else {
            return Ok(default);
        };
        if values.iter().any(|&v| v != values[0]) {
            let found = format!("tag {tag} with the values {values:?}");
            return Err(Error::format(self.file.bytes.path(), found, "one value"));
        }
        Ok(values[0])
    }

    /// A fraction; `None` if the tag is missing, of another type, or one of its numbers is 0.
    pub(crate) fn ratio(&self, tag: u16) -> Result<Option<Ratio>> {
        let Some(entry) = self.find(tag).filter(|e| e.kind == 5 && e.count == 1) else {
            return Ok(None);
        };
        let bytes = self.raw(entry, 8)?;
        let [above, below] = [&bytes[..4], &bytes[4..]].map(|b| self.file.number(b));
        Ok((above > 0 && below > 0).then_some(Ratio { above, below }))
    }

    /// True if the page has the tag.
    pub(crate) fn has(&self, tag: u16) -> bool {
        self.find(tag).is_some()
    }

    /// Bytes of a tag of any type, at most `most`; empty if the tag is missing.
    pub(crate) fn bytes(&self, tag: u16, most: u64) -> Result<Vec<u8>> {
        let Some(mut entry) = self.find(tag).filter(|e| size_of_type(e.kind) == 1) else {
            return Ok(Vec::new());
        };
        entry.count = entry.count.min(most);
        self.raw(entry, most)
    }

    /// A reader of a text that may be long; `None` if the tag is missing.
    pub(crate) fn text_reader(&self, tag: u16) -> Option<BufReader<Section>> {
        let entry = self.find(tag).filter(|e| matches!(e.kind, 1 | 2 | 7))?;
        let len = entry.count.min(MAX_XML);
        Some(self.file.bytes.reader(entry.position, len))
    }

    /// The first characters of a text; empty if the tag is missing.
    pub(crate) fn text_begin(&self, tag: u16) -> Result<String> {
        let bytes = self.bytes(tag, 64)?;
        Ok(String::from_utf8_lossy(&bytes).trim_start().to_owned())
    }

    /// Number of values of a tag; 0 if it is missing.
    pub(crate) fn count(&self, tag: u16) -> u64 {
        self.find(tag).map_or(0, |entry| entry.count)
    }

    /// Text; empty if the tag is missing. Very long text is cut.
    pub(crate) fn text(&self, tag: u16) -> Result<String> {
        let Some(mut entry) = self.find(tag).filter(|e| matches!(e.kind, 1 | 2 | 7)) else {
            return Ok(String::new());
        };
        entry.count = entry.count.min(MAX_TEXT);
        let bytes = self.raw(entry, MAX_TEXT)?;
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        // ImageJ writes the micro sign in Latin-1
        Ok(match std::str::from_utf8(&bytes[..end]) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes[..end].iter().map(|&b| char::from(b)).collect(),
        })
    }
}
