//! Union-find whose root is always the smallest member.

/// Gives an empty array room for `n` elements, and a few more in case that the next time takes them: a tenth
/// at most. Nothing is moved.
pub(super) fn make_room(array: &mut Vec<u32>, n: usize) {
    if array.capacity() < n {
        *array = Vec::with_capacity(n + n / 16);
    }
}

/// Disjoint sets of 0..n.
#[derive(Debug, Clone, Default)]
pub struct UnionFind {
    parent: Vec<u32>,
}

impl UnionFind {
    /// `n` sets of one member each; reuses the memory.
    pub fn reset(&mut self, n: usize) {
        self.parent.clear();
        make_room(&mut self.parent, n);
        self.parent.extend(0..n as u32);
    }

    /// The smallest member of the set of `a`.
    pub fn find(&mut self, mut a: u32) -> u32 {
        // path halving
        while self.parent[a as usize] != a {
            let grand = self.parent[self.parent[a as usize] as usize];
            self.parent[a as usize] = grand;
            a = grand;
        }
        a
    }

    /// Joins the sets of `a` and `b`.
    pub fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.parent[high as usize] = low;
        }
    }

    /// Calls `each(member, root)` for every member by rising number, compressing all paths.
    pub fn flatten(&mut self, mut each: impl FnMut(u32, u32)) {
        for i in 0..self.parent.len() as u32 {
            // parents are smaller than their children, so they are roots already
            let root = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = root;
            each(i, root);
        }
    }
}
