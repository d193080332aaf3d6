//! The bytes of a checkpoint file: a magic number, plain values, and a checksum over all of it.

use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// First bytes of a checkpoint; the last one counts the versions of what follows.
const MAGIC: [u8; 8] = *b"ALVISCP\x01";

/// Writes values to a file and sums up their bytes. Nothing is held in memory but a buffer.
pub struct Encoder {
    path: PathBuf,
    file: BufWriter<File>,
    crc: crc32fast::Hasher,
}

impl Encoder {
    /// Begins a file, or writes over one that is there: making one and removing one cost more.
    ///
    /// # Errors
    /// [`Error::Io`], here and below.
    pub fn create(path: &Path) -> Result<Self> {
        // what is left of a longer one is cut off in the end: ext4 writes out at once what is written to a file
        // that was emptied (`auto_da_alloc`)
        let mut options = File::options();
        let options = options.write(true).create(true).truncate(false);
        let file = options
            .open(path)
            .map_err(|e| Error::io(path, "create", e))?;
        let mut encoder = Encoder {
            path: path.to_path_buf(),
            file: BufWriter::with_capacity(1 << 16, file),
            crc: crc32fast::Hasher::new(),
        };
        encoder.raw(&MAGIC)?;
        Ok(encoder)
    }

    fn raw(&mut self, bytes: &[u8]) -> Result<()> {
        self.crc.update(bytes);
        let written = self.file.write_all(bytes);
        written.map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Writes a number.
    pub fn number(&mut self, value: u64) -> Result<()> {
        self.raw(&value.to_le_bytes())
    }

    /// Writes an array of plain records.
    pub fn array<T: Pod>(&mut self, values: &[T]) -> Result<()> {
        self.number(values.len() as u64)?;
        self.raw(bytemuck::cast_slice(values))
    }

    /// Writes records one by one; there must be `len` of them.
    pub fn records<T: Pod>(&mut self, len: usize, values: impl Iterator<Item = T>) -> Result<()> {
        self.number(len as u64)?;
        for value in values {
            self.raw(bytemuck::bytes_of(&value))?;
        }
        Ok(())
    }

    /// Writes the checksum and ends the file.
    pub fn finish(mut self) -> Result<()> {
        let crc = self.crc.finalize();
        let written = self.file.write_all(&crc.to_le_bytes());
        written
            .and_then(|()| self.file.flush())
            .and_then(|()| cut_off_the_rest(self.file.get_mut()))
            .map_err(|e| Error::io(&self.path, "write", e))
    }
}

/// Ends a file where it was written last.
fn cut_off_the_rest(file: &mut File) -> std::io::Result<()> {
    let end = file.stream_position()?;
    if file.metadata()?.len() > end {
        file.set_len(end)?;
    }
    Ok(())
}

/// Takes values out of a checkpoint in the order in which they were written. `None` means that the
/// bytes are not what was asked for.
#[derive(Debug)]
pub struct Decoder {
    bytes: Vec<u8>,
    at: usize,
}

impl Decoder {
    /// Takes the bytes of a whole file, if magic number and checksum are right.
    pub fn new(mut bytes: Vec<u8>) -> Option<Self> {
        let body = bytes.len().checked_sub(4)?;
        let crc = u32::from_le_bytes(bytes[body..].try_into().ok()?);
        if !bytes.starts_with(&MAGIC) || crc32fast::hash(&bytes[..body]) != crc {
            return None;
        }
        bytes.truncate(body);
        Some(Decoder {
            bytes,
            at: MAGIC.len(),
        })
    }

    fn raw(&mut self, len: usize) -> Option<&[u8]> {
        let end = self.at.checked_add(len)?;
        let bytes = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    /// A number.
    pub fn number(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.raw(8)?.try_into().ok()?))
    }

    /// A number that is an index or a length.
    pub fn index<T: TryFrom<u64>>(&mut self) -> Option<T> {
        self.number()?.try_into().ok()
    }

    /// An array of plain records.
    pub fn array<T: Pod>(&mut self) -> Option<Vec<T>> {
        let len: usize = self.index()?;
        let bytes = self.raw(len.checked_mul(size_of::<T>())?)?;
        let mut out = vec![T::zeroed(); len];
        bytemuck::cast_slice_mut(&mut out).copy_from_slice(bytes);
        Some(out)
    }

    /// True if all has been taken.
    pub fn is_empty(&self) -> bool {
        self.at == self.bytes.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write_sample(path: &Path) {
        let mut encoder = Encoder::create(path).unwrap();
        encoder.number(7).unwrap();
        encoder.array(&[1u32, 2, 3]).unwrap();
        encoder.array::<u128>(&[]).unwrap();
        encoder.records(2, [9u64, u64::MAX].into_iter()).unwrap();
        encoder.finish().unwrap();
    }

    fn sample() -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("c");
        write_sample(&path);
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn values_come_back_in_order() {
        let mut decoder = Decoder::new(sample()).unwrap();
        assert_eq!(decoder.number(), Some(7));
        assert_eq!(decoder.array::<u32>(), Some(vec![1, 2, 3]));
        assert_eq!(decoder.array::<u128>(), Some(vec![]));
        assert!(!decoder.is_empty());
        assert_eq!(decoder.array::<u64>(), Some(vec![9, u64::MAX]));
        assert!(decoder.is_empty());
        assert_eq!(decoder.number(), None);
    }

    #[test]
    fn a_file_is_written_over_one_of_any_length() {
        let (dir, whole) = (tempfile::tempdir().unwrap(), sample());
        let path = dir.path().join("c");
        for len in [0, 1, whole.len() - 1, whole.len(), whole.len() + 1, 1 << 20] {
            std::fs::write(&path, vec![0xff; len]).unwrap();
            write_sample(&path);
            assert_eq!(std::fs::read(&path).unwrap(), whole, "{len}");
        }
    }

    #[test]
    fn what_is_cut_or_changed_is_refused() {
        let whole = sample();
        for len in 0..whole.len() {
            assert!(Decoder::new(whole[..len].to_vec()).is_none(), "{len}");
        }
        for bit in 0..8 * whole.len() {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(Decoder::new(bytes).is_none(), "bit {bit}");
        }
        let mut longer = whole.clone();
        longer.push(0);
        assert!(Decoder::new(longer).is_none());
    }

    #[test]
    fn another_version_is_refused_also_with_its_own_checksum() {
        let mut bytes = sample();
        bytes[7] = 2;
        let body = bytes.len() - 4;
        let crc = crc32fast::hash(&bytes[..body]);
        bytes[body..].copy_from_slice(&crc.to_le_bytes());
        assert!(Decoder::new(bytes).is_none());
    }

    #[test]
    fn lengths_beyond_the_end_are_refused() {
        for len in [4, 1 << 40, u64::MAX] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("c");
            let mut encoder = Encoder::create(&path).unwrap();
            encoder.number(len).unwrap();
            encoder.number(0).unwrap();
            encoder.finish().unwrap();
            let mut decoder = Decoder::new(std::fs::read(&path).unwrap()).unwrap();
            assert_eq!(decoder.array::<u128>(), None);
        }
    }
}
