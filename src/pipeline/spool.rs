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
#[derive(Debug, Clone, Copy)]
pub struct Place<T> {
    offset: u64,
    len: usize,
    kind: PhantomData<T>,
}

impl<T> Place<T> {
    /// The place that an array's offset and length tell.
    pub fn new(offset: u64, len: usize) -> Self {
        Place {
            offset,
            len,
            kind: PhantomData,
        }
    }

    /// Where it begins.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    fn end(&self) -> u64 {
        self.offset + (self.len * size_of::<T>()) as u64
    }
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

    /// An empty array at the end of the spool.
    pub fn here<T>(&self) -> Place<T> {
        Place {
            offset: self.written + self.buffer.len() as u64,
            len: 0,
            kind: PhantomData,
        }
    }

    /// Appends to the array that was pushed or extended last.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn extend<T: Pod>(&mut self, place: &mut Place<T>, records: &[T]) -> Result<()> {
        let more = self.push(records)?;
        assert_eq!(more.offset, place.end(), "only the last array can grow");
        place.len += more.len;
        Ok(())
    }

    /// Appends an array whose records come one by one.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn push_all<T: Pod>(&mut self, records: impl Iterator<Item = T>) -> Result<Place<T>> {
        let mut place = self.here();
        for record in records {
            self.extend(&mut place, &[record])?;
        }
        Ok(place)
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

    /// Calls `each` for the records of an array, a block at a time.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails, and what `each` returns.
    pub fn for_each<T: Pod>(
        &mut self,
        place: &Place<T>,
        mut each: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let size = size_of::<T>();
        let block = (BUFFER / size).max(1);
        for first in (0..place.len).step_by(block) {
            let len = block.min(place.len - first);
            let offset = place.offset + (first * size) as u64;
            for record in self.get::<T>(&Place::new(offset, len))? {
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
        let mut grown = spool.here();
        for array in &arrays {
            spool.extend(&mut grown, array).unwrap();
        }
        assert_eq!(spool.get(&grown).unwrap(), arrays.concat());
        let mut all = Vec::new();
        spool
            .for_each(&grown, |v: u32| {
                all.push(v);
                Ok(())
            })
            .unwrap();
        assert_eq!(all, arrays.concat());
    }
}
