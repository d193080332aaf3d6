//! Union-find whose root is always the smallest member.

/// Disjoint sets of 0..n.
#[derive(Debug, Clone, Default)]
pub struct UnionFind {
    parent: Vec<u32>,
}

impl UnionFind {
    /// `n` sets of one member each, in `memory`.
    pub fn new_in(mut memory: Vec<u32>, n: usize) -> Self {
        memory.clear();
        if memory.capacity() < n {
            // nothing is moved; a few more in case that the next time takes them: a tenth at most
            memory = Vec::with_capacity(n + n / 16);
        }
        memory.extend(0..n as u32);
        UnionFind { parent: memory }
    }

    /// `n` sets of one member each; reuses the memory.
    pub fn reset(&mut self, n: usize) {
        *self = Self::new_in(std::mem::take(&mut self.parent), n);
    }

    /// The smallest member of the set of `a`.
    pub fn find(&mut self, mut a: u32) -> u32 {
        loop {
            let parent = self.parent[a as usize];
            let grand = self.parent[parent as usize];
            // a root, or one below it, as most are
            if grand == parent {
                return parent;
            }
            // path halving
            self.parent[a as usize] = grand;
            a = grand;
        }
    }

    /// Joins the sets of `a` and `b`.
    pub fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.parent[high as usize] = low;
        }
    }

    /// The number of each member's set, in the same memory, and how many sets there are. Sets are numbered
    /// from 0 by their smallest members.
    pub fn into_numbers(mut self) -> (Vec<u32>, usize) {
        let mut sets = 0;
        for i in 0..self.parent.len() {
            let parent = self.parent[i] as usize;
            // parents are smaller than their children, so they have their numbers already
            self.parent[i] = if parent == i {
                sets += 1;
                sets - 1
            } else {
                self.parent[parent]
            };
        }
        (self.parent, sets as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_numbered_by_their_smallest_members(
            n in 1..200u32,
            pairs in prop::collection::vec((0..200u32, 0..200u32), 0..300),
        ) {
            let mut sets = UnionFind::new_in(vec![7; 50], n as usize);
            // the slow way: every member knows the smallest one of its set
            let mut smallest: Vec<u32> = (0..n).collect();
            for (a, b) in pairs.into_iter().map(|(a, b)| (a % n, b % n)) {
                sets.union(a, b);
                let [a, b] = [a, b].map(|i| smallest[i as usize]);
                smallest.iter_mut().filter(|s| **s == a.max(b)).for_each(|s| *s = a.min(b));
            }
            for i in 0..n {
                prop_assert_eq!(sets.find(i), smallest[i as usize]);
            }
            let mut roots = smallest.clone();
            roots.sort_unstable();
            roots.dedup();
            let number = |s: &u32| roots.binary_search(s).unwrap() as u32;
            let expected: Vec<u32> = smallest.iter().map(number).collect();
            prop_assert_eq!(sets.into_numbers(), (expected, roots.len()));
        }
    }
}
