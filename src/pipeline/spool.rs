//! Temporary files without a name: what the forward sweep leaves for the reverse one.

use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::File;
use std::io::Write;
use std::marker::PhantomData;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 16;

/// Arrays of plain records, appended once and read back by their place.
#[derive(Debug)]
pub struct Spool {
    file: File,
    dir: PathBuf,
    written: u64,
    buffer: Vec<u8>,
}

/// Where an array lies.
#[derive(Debug)]
pub struct Place<T> {
    offset: u64,
    len: usize,
    kind: PhantomData<T>,
}

impl Spool {
    /// An empty spool in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(dir: &Path) -> Result<Self> {
        let file =
            tempfile::tempfile_in(dir).map_err(|e| Error::io(dir, "create a temporary file", e))?;
        Ok(Spool {
            file,
            dir: dir.to_path_buf(),
            written: 0,
            buffer: Vec::new(),
        })
    }

    /// Appends an array.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn push<T: Pod>(&mut self, records: &[T]) -> Result<Place<T>> {
        let offset = self.written + self.buffer.len() as u64;
        let bytes: &[u8] = bytemuck::cast_slice(records);
        if self.buffer.len() + bytes.len() > BUFFER {
            self.flush()?;
        }
        if bytes.len() > BUFFER {
            self.write(bytes)?;
        } else {
            self.buffer.extend_from_slice(bytes);
        }
        Ok(Place {
            offset,
            len: records.len(),
            kind: PhantomData,
        })
    }

    fn flush(&mut self) -> Result<()> {
        let buffer = std::mem::take(&mut self.buffer);
        self.write(&buffer)?;
        self.buffer = buffer;
        self.buffer.clear();
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all(bytes)
            .map_err(|e| Error::io(&self.dir, "write a temporary file", e))?;
        self.written += bytes.len() as u64;
        Ok(())
    }

    /// Reads an array back.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn get<T: Pod>(&mut self, place: &Place<T>) -> Result<Vec<T>> {
        self.flush()?;
        let mut out = vec![T::zeroed(); place.len];
        self.file
            .read_exact_at(bytemuck::cast_slice_mut(&mut out), place.offset)
            .map_err(|e| Error::io(&self.dir, "read back a temporary file", e))?;
        Ok(out)
    }

    /// Calls `each` for all records, if every array pushed held `T`s, a block at a time.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails, and what `each` returns.
    pub fn for_each<T: Pod>(&mut self, mut each: impl FnMut(T) -> Result<()>) -> Result<()> {
        self.flush()?;
        let size = std::mem::size_of::<T>() as u64;
        let total = self.written / size;
        let block = (BUFFER as u64 / size).max(1);
        for first in (0..total).step_by(block as usize) {
            let len = block.min(total - first) as usize;
            for record in self.get::<T>(&Place {
                offset: first * size,
                len,
                kind: PhantomData,
            })? {
                each(record)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_as_they_went() {
        let dir = tempfile::tempdir().unwrap();
        let mut spool = Spool::new(dir.path()).unwrap();
        let arrays: Vec<Vec<u32>> = (0..500)
            .map(|n| (0..n).map(|i| n * 1000 + i).collect())
            .collect();
        let places: Vec<_> = arrays.iter().map(|a| spool.push(a).unwrap()).collect();
        for (array, place) in arrays.iter().zip(&places).rev() {
            assert_eq!(&spool.get(place).unwrap(), array);
        }
        let mut all = Vec::new();
        spool
            .for_each(|v: u32| {
                all.push(v);
                Ok(())
            })
            .unwrap();
        assert_eq!(all, arrays.concat());
    }
}
