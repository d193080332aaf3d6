//! Records in the order of a key, more of them than memory holds: sorted parts in a file, which are merged.

use crate::error::Result;
use crate::sys::spill_file::{Place, SpillFile};
use bytemuck::Pod;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;
use std::path::Path;

/// What is sorted by.
pub trait Keyed: Pod {
    /// Two numbers, the first one first.
    fn key(&self) -> [u64; 2];
}

/// Takes records in any order.
#[derive(Debug)]
pub struct Sorter<T> {
    file: SpillFile,
    parts: Vec<Place<T>>,
    /// What is not yet in the file, and how many records may wait there.
    buffer: Vec<T>,
    room: usize,
}

/// A part that is being read.
struct Part<T> {
    /// Some of it, read into the same memory each time, and the next one of these.
    records: Vec<T>,
    next: usize,
    /// Where the rest begins and how long it is.
    rest: [u64; 2],
}

impl<T: Keyed> Sorter<T> {
    /// Without records; holds up to `room` of them in memory and a file in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(dir: &Path, room: usize) -> Result<Self> {
        Ok(Sorter {
            file: SpillFile::new(dir)?,
            parts: Vec::new(),
            buffer: Vec::new(),
            room: room.max(2),
        })
    }

    /// Takes a record.
    pub fn push(&mut self, record: T) -> Result<()> {
        self.buffer.push(record);
        match self.buffer.len() < self.room {
            true => Ok(()),
            false => self.spill(),
        }
    }

    fn spill(&mut self) -> Result<()> {
        self.buffer.sort_by_key(T::key);
        self.parts.push(self.file.push(&self.buffer)?);
        self.buffer.clear();
        Ok(())
    }

    /// Hands one record on for each key, in order: the first one, into which those that came later are merged.
    ///
    /// # Errors
    /// What `each` returns, too.
    pub fn finish_merged(
        self,
        merge: impl Fn(&mut T, &T),
        mut each: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let mut last: Option<T> = None;
        self.finish(|record| match &mut last {
            Some(last) if last.key() == record.key() => {
                merge(last, &record);
                Ok(())
            }
            _ => last.replace(record).map_or(Ok(()), &mut each),
        })?;
        last.map_or(Ok(()), each)
    }

    /// Hands all records on, in order; those with the same key in the order in which they came.
    pub fn finish(mut self, mut each: impl FnMut(T) -> Result<()>) -> Result<()> {
        if self.parts.is_empty() {
            self.buffer.sort_by_key(T::key);
            return self.buffer.into_iter().try_for_each(each);
        }
        self.spill()?;
        self.file.mark()?;
        self.buffer = Vec::new();
        let block = (self.room / self.parts.len()).max(1);
        let start = |place: &Place<T>| Part {
            records: Vec::new(),
            next: 0,
            rest: place.numbers(),
        };
        let mut parts: Vec<Part<T>> = self.parts.iter().map(start).collect();
        // the first record of each part that has any, and its key
        let mut heads = BinaryHeap::new();
        let mut next: Vec<Option<T>> = vec![None; parts.len()];
        for (i, part) in parts.iter_mut().enumerate() {
            next[i] = part.next(&self.file, block)?;
            heads.extend(next[i].map(|record| Reverse((record.key(), i))));
        }
        while let Some(mut head) = heads.peek_mut() {
            let Reverse((_, i)) = *head;
            each(next[i].take().expect("it has a key"))?;
            next[i] = parts[i].next(&self.file, block)?;
            match next[i] {
                Some(record) => *head = Reverse((record.key(), i)),
                None => drop(PeekMut::pop(head)),
            }
        }
        Ok(())
    }
}

impl<T: Keyed> Part<T> {
    fn next(&mut self, file: &SpillFile, block: usize) -> Result<Option<T>> {
        let [offset, len] = self.rest;
        if self.next == self.records.len() && len > 0 {
            let some = len.min(block as u64);
            self.records.resize(some as usize, T::zeroed());
            file.read_into(offset, bytemuck::cast_slice_mut(&mut self.records))?;
            self.rest = [offset + some * size_of::<T>() as u64, len - some];
            self.next = 0;
        }
        self.next += 1;
        Ok(self.records.get(self.next - 1).copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    impl Keyed for [u64; 3] {
        fn key(&self) -> [u64; 2] {
            [self[0], self[1]]
        }
    }

    proptest! {
        #[test]
        fn records_come_in_order(
            all in prop::collection::vec((0u64..6, 0u64..6), 0..200), room in 1usize..50,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let mut sorter = Sorter::new(dir.path(), room).unwrap();
            let mut expected = Vec::new();
            for (i, (a, b)) in all.into_iter().enumerate() {
                expected.push([a, b, i as u64]);
                sorter.push([a, b, i as u64]).unwrap();
            }
            expected.sort();
            let mut found = Vec::new();
            sorter.finish(|record| { found.push(record); Ok(()) }).unwrap();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn records_of_a_key_are_merged(
            all in prop::collection::vec((0u64..6, 0u64..6, 0u64..100), 0..200), room in 1usize..50,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let mut sorter = Sorter::new(dir.path(), room).unwrap();
            let mut expected = BTreeMap::new();
            for (a, b, n) in all {
                *expected.entry([a, b]).or_insert(0) += n;
                sorter.push([a, b, n]).unwrap();
            }
            let mut found = Vec::new();
            let merge = |sum: &mut [u64; 3], other: &[u64; 3]| sum[2] += other[2];
            sorter.finish_merged(merge, |record| { found.push(record); Ok(()) }).unwrap();
            let expected: Vec<_> = expected.into_iter().map(|([a, b], n)| [a, b, n]).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
