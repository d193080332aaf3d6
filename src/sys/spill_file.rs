//! Temporary files: what the forward sweep leaves for the reverse one.

use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::{File, OpenOptions};
use std::marker::PhantomData;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 16;

/// Arrays of plain records, appended once and read back by their place.
#[derive(Debug)]
pub struct SpillFile {
    file: File,
    /// The file, or the directory of one without a name.
    path: PathBuf,
    written: u64,
    crc: crc32fast::Hasher,
    buffer: Vec<u8>,
}

/// How much a file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    /// Bytes.
    pub len: u64,
    /// CRC-32 of them.
    pub crc: u32,
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

    /// Its offset and length, see [`Place::new`].
    pub fn numbers(&self) -> [u64; 2] {
        [self.offset, self.len as u64]
    }

    fn end(&self) -> u64 {
        self.offset + (self.len * size_of::<T>()) as u64
    }
}

impl SpillFile {
    /// An empty spool in `dir`, in a file without a name.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(dir: &Path) -> Result<Self> {
        let file = crate::sys::temp_file::unnamed(dir)
            .map_err(|e| Error::io(dir, "create a temporary file", e))?;
        Ok(SpillFile::on(file, dir))
    }

    /// An empty spool at `path`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn create(path: &Path) -> Result<Self> {
        let mut options = OpenOptions::new();
        let made = options.read(true).write(true).create(true).truncate(true);
        let file = made.open(path).map_err(|e| Error::io(path, "create", e))?;
        Ok(SpillFile::on(file, path))
    }

    /// The spool at `path` as it was at `mark`; what came after is dropped.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened or cut.
    pub fn reopen(path: &Path, mark: Mark) -> Result<Self> {
        let mut options = OpenOptions::new();
        let opened = options.read(true).write(true).open(path);
        let file = opened.map_err(|e| Error::io(path, "open", e))?;
        file.set_len(mark.len)
            .map_err(|e| Error::io(path, "shorten", e))?;
        let mut spool = SpillFile::on(file, path);
        spool.written = mark.len;
        spool.crc = crc32fast::Hasher::new_with_initial_len(mark.crc, mark.len);
        Ok(spool)
    }

    /// The spool at `path` as it was at `mark`, to be read: nothing can be appended.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened.
    pub fn open(path: &Path, mark: Mark) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let mut spool = SpillFile::on(file, path);
        spool.written = mark.len;
        Ok(spool)
    }

    fn on(file: File, path: &Path) -> Self {
        SpillFile {
            file,
            path: path.to_path_buf(),
            written: 0,
            crc: crc32fast::Hasher::new(),
            buffer: Vec::new(),
        }
    }

    /// Writes out what is in memory and tells how much that makes.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn mark(&mut self) -> Result<Mark> {
        self.flush()?;
        Ok(Mark {
            len: self.written,
            crc: self.crc.clone().finalize(),
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
        if self.buffer.is_empty() {
            return Ok(());
        }
        let buffer = std::mem::take(&mut self.buffer);
        let written = self.write(&buffer);
        self.buffer = buffer;
        // else it stays: others may have been told where it will lie
        written.inspect(|()| self.buffer.clear())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all_at(bytes, self.written)
            .map_err(|e| Error::io(&self.path, "write", e))?;
        self.crc.update(bytes);
        self.written += bytes.len() as u64;
        Ok(())
    }

    /// Reads an array back.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn get<T: Pod>(&mut self, place: &Place<T>) -> Result<Vec<T>> {
        self.flush()?;
        self.read(place)
    }

    /// Reads an array back, of which nothing is in memory any more: see [`SpillFile::mark`].
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn read<T: Pod>(&self, place: &Place<T>) -> Result<Vec<T>> {
        debug_assert!(place.end() <= self.written);
        let mut out = vec![T::zeroed(); place.len];
        self.read_into(place.offset, bytemuck::cast_slice_mut(&mut out))?;
        Ok(out)
    }

    /// Reads bytes back from `offset` on, of which none is in memory any more.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn read_into(&self, offset: u64, out: &mut [u8]) -> Result<()> {
        debug_assert!(offset + out.len() as u64 <= self.written);
        self.file
            .read_exact_at(out, offset)
            .map_err(|e| Error::io(&self.path, "read back", e))
    }

    /// All of a spool of records of one type; `None` if it holds others.
    pub fn everything<T: Pod>(&self) -> Option<Place<T>> {
        let bytes = self.here::<T>().offset;
        let size = size_of::<T>() as u64;
        bytes
            .is_multiple_of(size)
            .then(|| Place::new(0, (bytes / size) as usize))
    }

    /// How many records there are, all of one type.
    pub fn records<T: Pod>(&self) -> u64 {
        self.here::<T>().offset / size_of::<T>() as u64
    }

    /// Calls `each` for all records, which are of one type and were marked, a block at a time.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails, and what `each` returns.
    pub fn each<T: Pod>(&self, mut each: impl FnMut(T) -> Result<()>) -> Result<()> {
        let (size, mut offset) = (size_of::<T>() as u64, 0);
        let (block, end) = ((BUFFER as u64 / size).max(1), self.here::<T>().offset);
        while offset < end {
            let count = block.min((end - offset) / size);
            let records = self.read::<T>(&Place::new(offset, count as usize))?;
            records.into_iter().try_for_each(&mut each)?;
            offset += count * size;
        }
        Ok(())
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
    fn what_could_not_be_written_stays_for_the_next_time() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("spool");
        std::fs::write(&path, b"").unwrap();
        let mut spool = SpillFile::on(File::open(&path).unwrap(), &path);
        let place = spool.push(&[1u32, 2, 3]).unwrap();
        assert!(spool.mark().is_err());
        let writable = OpenOptions::new().read(true).write(true).open(&path);
        spool.file = writable.unwrap();
        assert_eq!(spool.mark().unwrap().len, 12);
        assert_eq!(spool.get(&place).unwrap(), [1, 2, 3]);
    }

    #[test]
    fn arrays_come_back_as_they_went() {
        let dir = tempfile::tempdir().unwrap();
        let mut spool = SpillFile::new(dir.path()).unwrap();
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

    #[test]
    fn a_spool_goes_on_where_it_was_marked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("spool");
        let mut spool = SpillFile::create(&path).unwrap();
        let first = spool.push(&[1u64, 2, 3]).unwrap();
        let mark = spool.mark().unwrap();
        assert_eq!(mark.len, 24);
        spool.push(&[4u64; 100_000]).unwrap();
        spool.mark().unwrap();
        let mut again = SpillFile::reopen(&path, mark).unwrap();
        let second = again.push(&[5u64]).unwrap();
        assert_eq!(again.get(&first).unwrap(), [1, 2, 3]);
        assert_eq!(again.get(&second).unwrap(), [5]);
        let all: Vec<u8> = [1u64, 2, 3, 5]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let expected = Mark {
            len: 32,
            crc: crc32fast::hash(&all),
        };
        assert_eq!(again.mark().unwrap(), expected);
        assert_eq!(std::fs::read(&path).unwrap(), all);
    }
}
