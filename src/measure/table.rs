//! Fixed-size records by number, in memory while they are few, in a temporary file beyond.

use crate::error::{Error, Result};
use crate::sys::locks::{lock, unshared};
use bytemuck::Pod;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Records that are read and written together.
const BLOCK: u64 = 128;

/// Records 0..n, written and read in any order. Unwritten ones are zero.
#[derive(Debug)]
pub struct RecordTable<T> {
    store: Store<T>,
    len: u64,
}

#[derive(Debug)]
enum Store<T> {
    Memory(Vec<T>),
    File(Mutex<Blocks<T>>),
}

impl<T: Pod> RecordTable<T> {
    /// A table of `len` zeroed records, in memory if they fit `budget` bytes, else in a temporary
    /// file without a name in `dir`, with the blocks used last in memory.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(len: u64, budget: u64, dir: &Path) -> Result<Self> {
        let store = if len.saturating_mul(size_of::<T>()) <= budget {
            Store::Memory(vec![T::zeroed(); len as usize])
        } else {
            Store::File(Mutex::new(Blocks::new(len, budget, dir)?))
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
            Store::File(blocks) => {
                let mut blocks = lock(blocks);
                Ok(*blocks.record(i, false)?)
            }
        }
    }

    /// Changes record `i`, below [`RecordTable::len`], in place.
    ///
    /// # Errors
    /// [`Error::Io`] if the file fails.
    pub fn update(&mut self, i: u64, change: impl FnOnce(&mut T)) -> Result<()> {
        match &mut self.store {
            Store::Memory(records) => change(&mut records[i as usize]),
            Store::File(blocks) => {
                let blocks = unshared(blocks);
                change(blocks.record(i, true)?);
            }
        }
        Ok(())
    }
}

/// Records in a file. Block b of it can be in memory in slot b modulo the number of slots only.
#[derive(Debug)]
struct Blocks<T> {
    file: File,
    dir: PathBuf,
    slots: Vec<Slot<T>>,
}

#[derive(Debug)]
struct Slot<T> {
    block: u64,
    changed: bool,
    records: Vec<T>,
}

impl<T: Pod> Blocks<T> {
    fn new(len: u64, budget: u64, dir: &Path) -> Result<Self> {
        let file = crate::sys::temp_file::unnamed(dir)
            .map_err(|e| Error::io(dir, "create a temporary file", e))?;
        let bytes = len
            .checked_next_multiple_of(BLOCK)
            .and_then(|len| len.checked_mul(size_of::<T>()))
            .ok_or_else(|| too_big(dir))?;
        file.set_len(bytes)
            .map_err(|e| Error::io(dir, "grow a temporary file", e))?;
        let slots = (budget / (BLOCK * size_of::<T>())).max(1);
        let empty = || Slot {
            block: u64::MAX,
            changed: false,
            records: Vec::new(),
        };
        Ok(Blocks {
            file,
            dir: dir.to_path_buf(),
            slots: (0..slots).map(|_| empty()).collect(),
        })
    }

    fn record(&mut self, i: u64, change: bool) -> Result<&mut T> {
        let block = i / BLOCK;
        let at = (block % self.slots.len() as u64) as usize;
        let slot = &mut self.slots[at];
        if slot.block != block {
            let place = |block: u64| block * BLOCK * size_of::<T>();
            if slot.changed {
                self.file
                    .write_all_at(bytemuck::cast_slice(&slot.records), place(slot.block))
                    .map_err(|e| Error::io(&self.dir, "write a temporary file", e))?;
            }
            slot.block = u64::MAX;
            slot.changed = false;
            slot.records.resize(BLOCK as usize, T::zeroed());
            self.file
                .read_exact_at(bytemuck::cast_slice_mut(&mut slot.records), place(block))
                .map_err(|e| Error::io(&self.dir, "read back a temporary file", e))?;
            slot.block = block;
        }
        slot.changed |= change;
        Ok(&mut slot.records[(i % BLOCK) as usize])
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
        let mut tables = [0, 1 << 20, 3000]
            .map(|budget| RecordTable::<u64>::new(1000, budget, dir.path()).unwrap());
        assert!(
            matches!(tables[0].store, Store::File(_))
                && matches!(tables[1].store, Store::Memory(_))
        );
        for t in &mut tables {
            for i in (0..1000).rev().step_by(3) {
                t.update(i, |r| *r = i * i).unwrap();
                t.update(i, |v| *v += 1).unwrap();
            }
        }
        for i in 0..1000 {
            assert_eq!(tables[0].get(i).unwrap(), tables[1].get(i).unwrap());
            assert_eq!(tables[0].get(i).unwrap(), tables[2].get(i).unwrap());
        }
        assert_eq!(tables[0].get(999).unwrap(), 999 * 999 + 1);
        assert_eq!(tables[0].get(998).unwrap(), 0);
    }
}
