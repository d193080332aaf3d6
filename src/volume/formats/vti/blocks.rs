//! Samples in packed blocks of equal size, each found by the table in front of them.

use crate::error::{Error, Result};
use crate::sys::locks::lock;
use crate::volume::Endian;
use crate::volume::formats::vti::Bytes;
use crate::volume::io::byte_source::{ByteSource, Rows};
use flate2::bufread::ZlibDecoder;
use std::collections::VecDeque;
use std::io::Read;
use std::sync::{Arc, Mutex};

/// Unpacked blocks that are kept, in bytes.
const CACHE: u64 = 16 << 20;
/// Larger blocks are refused: each is unpacked in memory.
const MAX_BLOCK: u64 = 256 << 20;

/// Where an array begins and how its header's numbers are written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) at: u64,
    /// Bytes per number, 4 or 8.
    pub(crate) word: u64,
    pub(crate) endian: Endian,
}

impl Place {
    /// Number `i` of the header.
    pub(crate) fn number(&self, bytes: &Bytes, i: u64) -> Result<u64> {
        let mut word = [0; 8];
        let word = &mut word[..self.word as usize];
        bytes.read_at(self.at.saturating_add(i.saturating_mul(self.word)), word)?;
        if self.endian == Endian::Big {
            word.reverse();
        }
        Ok(word.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }
}

/// How blocks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// There are no blocks.
    None,
    Zlib,
    Lz4,
}

/// The blocks of an array.
pub(crate) struct Blocks {
    bytes: Bytes,
    packing: Packing,
    /// Position and packed size of each block.
    blocks: Vec<(u64, u64)>,
    /// Unpacked bytes of each but the last.
    size: u64,
    total: u64,
    recent: Mutex<VecDeque<(u64, Arc<Vec<u8>>)>>,
}

impl Blocks {
    /// Reads the table: the number of blocks, their size, that of a smaller last one, and the packed
    /// size of each.
    ///
    /// # Errors
    /// [`Error::Format`] if it does not fit the file or the `total` bytes of samples.
    pub(crate) fn open(bytes: Bytes, place: Place, total: u64, packing: Packing) -> Result<Self> {
        let [count, size, last] = [
            place.number(&bytes, 0)?,
            place.number(&bytes, 1)?,
            place.number(&bytes, 2)?,
        ];
        let whole = if last == 0 {
            count
        } else {
            count.saturating_sub(1)
        };
        let stored = whole.checked_mul(size).and_then(|n| n.checked_add(last));
        let fits = count.saturating_mul(place.word) <= bytes.len();
        if stored != Some(total) || !fits || !(1..=MAX_BLOCK).contains(&size) || last > size {
            let found = format!("{count} blocks of {size} bytes, the last of {last}");
            let expected = format!("blocks of {total} bytes, as size and type say");
            return Err(Error::format(bytes.path(), found, expected));
        }
        let mut position = place.at.saturating_add((3 + count) * place.word);
        let mut blocks = Vec::with_capacity(count as usize);
        for i in 0..count {
            let packed = place.number(&bytes, 3 + i)?;
            blocks.push((position, packed));
            position = position.saturating_add(packed);
        }
        if position > bytes.len() || total > bytes.len().saturating_mul(1032) {
            let found = format!("blocks up to position {position}");
            let expected = format!("all of them in the file's {} bytes", bytes.len());
            return Err(Error::format(bytes.path(), found, expected));
        }
        Ok(Blocks {
            bytes,
            packing,
            blocks,
            size,
            total,
            recent: Mutex::default(),
        })
    }

    fn block(&self, index: u64) -> Result<Arc<Vec<u8>>> {
        let recent = || lock(&self.recent);
        if let Some((_, block)) = recent().iter().find(|(i, _)| *i == index) {
            return Ok(block.clone());
        }
        let (position, packed) = self.blocks[index as usize];
        let len = self.size.min(self.total - index * self.size);
        let mut block = vec![0; len as usize];
        self.unpack(position, packed, &mut block).map_err(|e| {
            let found = format!("block {index} at {position} that is damaged ({e})");
            Error::format(self.bytes.path(), found, format!("{len} bytes of samples"))
        })?;
        let block = Arc::new(block);
        let mut recent = recent();
        recent.push_back((index, block.clone()));
        while recent.len() as u64 > (CACHE / self.size).max(1) {
            recent.pop_front();
        }
        Ok(block)
    }

    fn unpack(&self, position: u64, packed: u64, out: &mut [u8]) -> std::io::Result<()> {
        let mut reader = self.bytes.reader(position, packed);
        if self.packing == Packing::Zlib {
            let mut decoder = ZlibDecoder::new(reader);
            return decoder
                .read_exact(out)
                .and_then(|()| decoder.read(&mut [0]).map(drop));
        }
        let mut from = Vec::new();
        reader.read_to_end(&mut from)?;
        match lz4_flex::block::decompress_into(&from, out) {
            Ok(n) if n == out.len() => Ok(()),
            _ => Err(std::io::ErrorKind::InvalidData.into()),
        }
    }
}

impl ByteSource for Blocks {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        for (start, row) in rows.split(out) {
            let (mut position, mut rest) = (start, row);
            while !rest.is_empty() {
                let block = self.block(position / self.size)?;
                let inside = &block[(position % self.size) as usize..];
                let count = inside.len().min(rest.len());
                let (now, later) = rest.split_at_mut(count);
                now.copy_from_slice(&inside[..count]);
                position += count as u64;
                rest = later;
            }
        }
        Ok(())
    }

    fn held_bytes(&self) -> u64 {
        let table = 16 * self.blocks.len() as u64;
        let threads = rayon::current_num_threads() as u64;
        table + CACHE.max(self.size) + threads * self.size
    }
}
