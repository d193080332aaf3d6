//! Fixed-size records by number, in memory while they are few, in a temporary file beyond.

use crate::error::{Error, Result};
use bytemuck::Pod;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Records 0..n, written and read in any order. Unwritten ones are zero.
#[derive(Debug)]
pub struct RecordTable<T> {
    store: Store<T>,
    len: u64,
}

#[derive(Debug)]
enum Store<T> {
    Memory(Vec<T>),
    File(File, PathBuf),
}

impl<T: Pod> RecordTable<T> {
    /// A table of `len` zeroed records, in memory if they fit `budget` bytes, else in a temporary
    /// file without a name in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(len: u64, budget: u64, dir: &Path) -> Result<Self> {
        let size = std::mem::size_of::<T>() as u64;
        let store = if len.saturating_mul(size) <= budget {
            Store::Memory(vec![T::zeroed(); len as usize])
        } else {
            let file = tempfile::tempfile_in(dir)
                .map_err(|e| Error::io(dir, "create a temporary file", e))?;
            let bytes = len.checked_mul(size).ok_or_else(|| too_big(dir))?;
            file.set_len(bytes)
                .map_err(|e| Error::io(dir, "grow a temporary file", e))?;
            Store::File(file, dir.to_path_buf())
        };
        Ok(RecordTable { store, len })
    }

    /// Number of records.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Record `i`, below [`RecordTable::len`].
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn get(&self, i: u64) -> Result<T> {
        match &self.store {
            Store::Memory(records) => Ok(records[i as usize]),
            Store::File(file, dir) => {
                let mut record = T::zeroed();
                file.read_exact_at(bytemuck::bytes_of_mut(&mut record), i * size_of::<T>())
                    .map_err(|e| Error::io(dir, "read back a temporary file", e))?;
                Ok(record)
            }
        }
    }

    /// Replaces record `i`, below [`RecordTable::len`].
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn set(&mut self, i: u64, record: T) -> Result<()> {
        match &mut self.store {
            Store::Memory(records) => records[i as usize] = record,
            Store::File(file, dir) => file
                .write_all_at(bytemuck::bytes_of(&record), i * size_of::<T>())
                .map_err(|e| Error::io(dir, "write a temporary file", e))?,
        }
        Ok(())
    }

    /// Changes record `i` in place.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn update(&mut self, i: u64, change: impl FnOnce(&mut T)) -> Result<()> {
        let mut record = self.get(i)?;
        change(&mut record);
        self.set(i, record)
    }
}

fn size_of<T>() -> u64 {
    std::mem::size_of::<T>() as u64
}

fn too_big(dir: &Path) -> Error {
    let reason = std::io::Error::from(std::io::ErrorKind::FileTooLarge);
    Error::io(dir, "create a temporary file", reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_and_file_behave_alike() {
        let dir = tempfile::tempdir().unwrap();
        let mut tables =
            [0, 1 << 20].map(|budget| RecordTable::<u64>::new(1000, budget, dir.path()).unwrap());
        assert!(
            matches!(tables[0].store, Store::File(..))
                && matches!(tables[1].store, Store::Memory(_))
        );
        for t in &mut tables {
            for i in (0..1000).rev().step_by(3) {
                t.set(i, i * i).unwrap();
                t.update(i, |v| *v += 1).unwrap();
            }
        }
        for i in 0..1000 {
            assert_eq!(tables[0].get(i).unwrap(), tables[1].get(i).unwrap());
        }
        assert_eq!(tables[0].get(999).unwrap(), 999 * 999 + 1);
        assert_eq!(tables[0].get(998).unwrap(), 0);
    }
}
