//! Sets of numbers that are dense, or nearly.

use std::collections::HashMap;

/// A set of numbers, in pages of 4,096: ids are dense, but those of a part are not.
#[derive(Debug, Default)]
pub struct IdSet {
    pages: HashMap<u64, Box<[u64; 64]>>,
    count: u64,
}

impl IdSet {
    /// Adds a number; false if it was there.
    pub fn insert(&mut self, id: u64) -> bool {
        let page = self
            .pages
            .entry(id / 4096)
            .or_insert_with(|| Box::new([0; 64]));
        let (word, bit) = ((id / 64 % 64) as usize, 1 << (id % 64));
        let new = page[word] & bit == 0;
        page[word] |= bit;
        self.count += u64::from(new);
        new
    }

    /// True if the number is in the set.
    pub fn contains(&self, id: u64) -> bool {
        let page = self.pages.get(&(id / 4096));
        page.is_some_and(|p| p[(id / 64 % 64) as usize] & (1 << (id % 64)) != 0)
    }

    /// How many numbers there are.
    pub fn len(&self) -> u64 {
        self.count
    }
}
