//! Sets of numbers that are dense, or nearly.

use std::collections::HashMap;
use std::sync::Arc;

/// A set of numbers, in pages of 4,096: ids are dense, but those of a part are not.
#[derive(Debug, Default, Clone)]
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

    /// True if a number is in both.
    pub fn meets(&self, other: &IdSet) -> bool {
        self.pages.iter().any(|(number, page)| {
            let other = other.pages.get(number);
            other.is_some_and(|other| page.iter().zip(other.iter()).any(|(a, b)| a & b != 0))
        })
    }
}

/// A page of an [`IdSet`] among all of them.
#[derive(Debug)]
struct RankedPage {
    number: u64,
    /// Members of the pages before it.
    before: u64,
    members: Box<[u64; 64]>,
}

/// The places of the numbers of an [`IdSet`] in their order, from 0.
#[derive(Debug, Default, Clone)]
pub struct IdRanks {
    /// By rising number.
    pages: Arc<[RankedPage]>,
    count: u64,
}

impl IdSet {
    /// The places of all numbers.
    pub fn into_ranks(self) -> IdRanks {
        let mut pages: Vec<_> = self.pages.into_iter().collect();
        pages.sort_unstable_by_key(|&(number, _)| number);
        let mut before = 0;
        let pages = pages.into_iter().map(|(number, members)| {
            let words = members.iter().map(|word| u64::from(word.count_ones()));
            let count = words.sum::<u64>();
            before += count;
            RankedPage {
                number,
                before: before - count,
                members,
            }
        });
        IdRanks {
            pages: pages.collect(),
            count: self.count,
        }
    }
}

impl IdRanks {
    /// How many numbers there are.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// The place of a number; `None` if it is not in the set.
    pub fn rank(&self, id: u64) -> Option<u64> {
        let pages = &self.pages;
        let at = pages.binary_search_by_key(&(id / 4096), |page| page.number);
        let RankedPage {
            before,
            members: page,
            ..
        } = &pages[at.ok()?];
        let (word, bit) = ((id / 64 % 64) as usize, 1u64 << (id % 64));
        if page[word] & bit == 0 {
            return None;
        }
        let words = page[..word].iter().map(|w| u64::from(w.count_ones()));
        Some(before + words.sum::<u64>() + u64::from((page[word] & (bit - 1)).count_ones()))
    }

    /// The number in a place, which is below [`IdRanks::len`].
    pub fn id(&self, rank: u64) -> u64 {
        let at = self.pages.partition_point(|page| page.before <= rank) - 1;
        let RankedPage {
            number,
            before,
            members: page,
        } = &self.pages[at];
        let mut left = rank - before;
        for (word, &bits) in (0..).zip(page.iter()) {
            let here = u64::from(bits.count_ones());
            if left < here {
                let mut bits = bits;
                for _ in 0..left {
                    bits &= bits - 1;
                }
                return 4096 * number + 64 * word + u64::from(bits.trailing_zeros());
            }
            left -= here;
        }
        unreachable!("pages have their members")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ranks_are_places_in_order(mut ids in prop::collection::vec(prop_oneof![0u64..300, 0u64..1 << 40], 1..200)) {
            let mut set = IdSet::default();
            for &id in &ids {
                set.insert(id);
            }
            ids.sort_unstable();
            ids.dedup();
            let ranks = set.into_ranks();
            prop_assert_eq!(ranks.len(), ids.len() as u64);
            for (rank, &id) in (0..).zip(&ids) {
                prop_assert_eq!(ranks.rank(id), Some(rank));
                prop_assert_eq!(ranks.id(rank), id);
                if !ids.contains(&(id + 1)) {
                    prop_assert_eq!(ranks.rank(id + 1), None);
                }
            }
        }
    }
}
