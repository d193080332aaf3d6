//! A long list of numbers in a file, of which a few pages are in memory; as steps down to parents, they are disjoint sets.
//!
//! The root of a set is its smallest member, as in `labels::union_find`. A member that was never joined to another one is
//! 0, as is what was never written, so that many members of which few are joined take little room. What is asked for lies near what was asked for
//! before, as basins beside each other have numbers beside each other.

use crate::error::{Error, Result};
use crate::sys::temp_file::unnamed;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Numbers of a page.
const PAGE: usize = 512;
/// Pages in memory.
const SLOTS: usize = 1024;
/// No page.
const EMPTY: u64 = u64::MAX;

#[derive(Debug, Clone)]
struct Slot {
    page: u64,
    changed: bool,
    numbers: Box<[u64]>,
}

/// A list that grows at its end.
#[derive(Debug)]
pub struct Numbers {
    file: File,
    dir: PathBuf,
    len: u64,
    slots: Vec<Slot>,
}

impl Numbers {
    /// An empty list, in a file without a name in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be made.
    pub fn new(dir: &Path) -> Result<Self> {
        let empty = Slot {
            page: EMPTY,
            changed: false,
            numbers: Box::default(),
        };
        Ok(Numbers {
            file: unnamed(dir).map_err(|e| failed(dir, e))?,
            dir: dir.to_path_buf(),
            len: 0,
            slots: vec![empty; SLOTS],
        })
    }

    /// As many sets of one member each.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn sets(dir: &Path, len: u64) -> Result<Self> {
        Ok(Numbers {
            len,
            ..Numbers::new(dir)?
        })
    }

    /// Appends a set of one member; returns that.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push_set(&mut self) -> Result<u64> {
        self.push(0)
    }

    /// How many there are.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Appends one; returns its place.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, number: u64) -> Result<u64> {
        self.len += 1;
        self.set(self.len - 1, number)?;
        Ok(self.len - 1)
    }

    /// Number `at`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn get(&mut self, at: u64) -> Result<u64> {
        debug_assert!(at < self.len, "{at} of {}", self.len);
        let slot = self.slot(at / PAGE as u64)?;
        Ok(slot.numbers[at as usize % PAGE])
    }

    /// Changes number `at`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn set(&mut self, at: u64, number: u64) -> Result<()> {
        debug_assert!(at < self.len, "{at} of {}", self.len);
        let slot = self.slot(at / PAGE as u64)?;
        slot.numbers[at as usize % PAGE] = number;
        slot.changed = true;
        Ok(())
    }

    fn slot(&mut self, page: u64) -> Result<&mut Slot> {
        let slot = &mut self.slots[(page % SLOTS as u64) as usize];
        if slot.page != page {
            let bytes = 8 * PAGE as u64;
            if slot.changed {
                let written = bytemuck::cast_slice(&slot.numbers);
                let done = self.file.write_all_at(written, slot.page * bytes);
                done.map_err(|e| failed(&self.dir, e))?;
            }
            // a page that no number has been written to is not in the file
            let mut numbers = vec![0u64; PAGE].into_boxed_slice();
            let into: &mut [u8] = bytemuck::cast_slice_mut(&mut numbers);
            let mut read = 0;
            while read < into.len() {
                let more = self
                    .file
                    .read_at(&mut into[read..], page * bytes + read as u64);
                match more.map_err(|e| failed(&self.dir, e))? {
                    0 => break,
                    more => read += more,
                }
            }
            *slot = Slot {
                page,
                changed: false,
                numbers,
            };
        }
        Ok(slot)
    }

    /// The smallest member of the set of a number.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn find(&mut self, mut a: u64) -> Result<u64> {
        loop {
            let parent = a - self.get(a)?;
            let grand = parent - self.get(parent)?;
            if grand == parent {
                return Ok(parent);
            }
            self.set(a, a - grand)?;
            a = grand;
        }
    }

    /// Joins the sets of two numbers. Returns the root that is none any more, if they were two sets.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn union(&mut self, a: u64, b: u64) -> Result<Option<u64>> {
        let (a, b) = (self.find(a)?, self.find(b)?);
        if a == b {
            return Ok(None);
        }
        let (low, high) = (a.min(b), a.max(b));
        self.set(high, high - low)?;
        Ok(Some(high))
    }

    /// Replaces the parent of each member by the number of its set, from 0 in the order of their smallest members;
    /// returns how many sets there are.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn number_sets(&mut self) -> Result<u64> {
        let mut sets = 0;
        for member in 0..self.len {
            let parent = member - self.get(member)?;
            // parents are smaller, so they have their numbers already
            let number = match parent == member {
                true => {
                    sets += 1;
                    sets - 1
                }
                false => self.get(parent)?,
            };
            self.set(member, number)?;
        }
        Ok(sets)
    }
}

fn failed(dir: &Path, e: std::io::Error) -> Error {
    Error::io(dir, "keep numbers of basins in a temporary file", e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_those_in_memory(
            n in 1u64..300, pairs in prop::collection::vec((0u64..300, 0u64..300), 0..300),
        ) {
            let dir = tempfile::tempdir().unwrap();
            let mut sets = Numbers::sets(dir.path(), n).unwrap();
            let mut smallest: Vec<u64> = (0..n).collect();
            for (a, b) in pairs.into_iter().map(|(a, b)| (a % n, b % n)) {
                sets.union(a, b).unwrap();
                let [a, b] = [a, b].map(|i| smallest[i as usize]);
                smallest.iter_mut().filter(|s| **s == a.max(b)).for_each(|s| *s = a.min(b));
            }
            for i in 0..n {
                prop_assert_eq!(sets.find(i).unwrap(), smallest[i as usize]);
            }
            let mut roots = smallest.clone();
            roots.sort_unstable();
            roots.dedup();
            prop_assert_eq!(sets.number_sets().unwrap(), roots.len() as u64);
            for (i, root) in smallest.iter().enumerate() {
                let number = roots.binary_search(root).unwrap() as u64;
                prop_assert_eq!(sets.get(i as u64).unwrap(), number);
            }
        }
    }

    #[test]
    fn pages_come_back_from_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let n = (3 * SLOTS * PAGE) as u64 + 5;
        let mut list = Numbers::new(dir.path()).unwrap();
        for i in 0..n {
            assert_eq!(list.push(7 * i).unwrap(), i);
        }
        for i in (0..n).step_by(97).chain((0..n).rev().step_by(101)) {
            let number = list.get(i).unwrap();
            assert!(number == 7 * i || number == 7 * i + 1, "{i} {number}");
            list.set(i, 7 * i + 1).unwrap();
        }
        assert_eq!(list.len(), n);
    }
}
