//! Matching of a piece's directed edges, and its connected parts.
//!
//! Edges are bucketed by their smaller vertex with a counting sort; a bucket holds about six and is
//! sorted by itself, so no hash table and no large sort is needed. Looking up falling edges among
//! rising ones does less work, but was slower: its branches cannot be predicted.

/// Buffers that are kept from piece to piece.
#[derive(Default)]
pub(super) struct Edges {
    starts: Vec<u32>,
    /// Per directed edge, in its bucket: the larger vertex times two, plus 1 if it is the tail.
    ends: Vec<u32>,
    parent: Vec<u32>,
    /// The edges without a mate, as (tail, head).
    pub open: Vec<[u32; 2]>,
}

/// What matching found, besides [`Edges::open`]. Edges are given as (tail, head).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Matched {
    /// Edges with their reverse.
    pub pairs: u64,
    /// An edge of two triangles that run along it the same way.
    pub same_way: Option<[u32; 2]>,
    /// An edge of more than two triangles.
    pub crowded: Option<[u32; 2]>,
}

impl Edges {
    /// Matches the directed edges of `triangles` over `vertices` vertices with their reverses.
    ///
    /// Every index is below `vertices`; `vertices` is below 2^31 and there are fewer than 2^32 / 3
    /// triangles, which a GLB of at most 4 GiB guarantees.
    pub fn match_up(&mut self, vertices: usize, triangles: &[[u32; 3]]) -> Matched {
        debug_assert!(vertices < 1 << 31 && triangles.len() < (u32::MAX / 3) as usize);
        self.fill(vertices, triangles);
        self.open.clear();
        let mut out = Matched::default();
        let mut start = 0;
        for low in 0..vertices as u32 {
            // after filling, starts[v] is the end of bucket v
            let end = self.starts[low as usize] as usize;
            let bucket = &mut self.ends[start..end];
            start = end;
            bucket.sort_unstable();
            let mut rest = &*bucket;
            while let Some(&first) = rest.first() {
                let same = |e: &u32| e >> 1 == first >> 1;
                let count = rest.iter().take_while(|e| same(e)).count();
                let edge = if first & 1 == 0 {
                    [low, first >> 1]
                } else {
                    [first >> 1, low]
                };
                match count {
                    1 => self.open.push(edge),
                    2 if rest[0] != rest[1] => out.pairs += 1,
                    2 => _ = out.same_way.get_or_insert(edge),
                    _ => _ = out.crowded.get_or_insert(edge),
                }
                rest = &rest[count..];
            }
        }
        out
    }

    fn fill(&mut self, vertices: usize, triangles: &[[u32; 3]]) {
        let starts = &mut self.starts;
        starts.clear();
        starts.resize(vertices + 1, 0);
        let sides = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)];
        for &t in triangles {
            for (a, b) in sides(t) {
                starts[a.min(b) as usize + 1] += 1;
            }
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        self.ends.clear();
        self.ends.resize(triangles.len() * 3, 0);
        for &t in triangles {
            for (a, b) in sides(t) {
                let place = &mut starts[a.min(b) as usize];
                self.ends[*place as usize] = a.max(b) << 1 | u32::from(a > b);
                *place += 1;
            }
        }
    }

    /// Finds the connected parts of `triangles`; afterwards [`Edges::part`] tells a vertex's part.
    pub fn connect(&mut self, vertices: usize, triangles: &[[u32; 3]]) {
        self.parent.clear();
        self.parent.extend(0..vertices as u32);
        for &[a, b, c] in triangles {
            let (a, b, c) = (self.part(a), self.part(b), self.part(c));
            let root = a.min(b).min(c);
            self.parent[a as usize] = root;
            self.parent[b as usize] = root;
            self.parent[c as usize] = root;
        }
    }

    /// The smallest vertex of the part that vertex `v` belongs to.
    #[inline]
    pub fn part(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let up = self.parent[v as usize];
            self.parent[v as usize] = self.parent[up as usize];
            v = up;
        }
        v
    }

    /// The parts' smallest vertices, rising.
    pub fn parts(&self) -> impl Iterator<Item = u32> {
        let own = |&(i, &p): &(usize, &u32)| i as u32 == p;
        self.parent.iter().enumerate().filter(own).map(|(_, &p)| p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(vertices: usize, triangles: &[[u32; 3]]) -> (Matched, Vec<[u32; 2]>) {
        let mut edges = Edges::default();
        let m = edges.match_up(vertices, triangles);
        (m, edges.open.clone())
    }

    #[test]
    fn a_tetrahedron_is_closed() {
        let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        let (m, open) = run(4, &faces);
        assert_eq!((m.pairs, m.same_way, m.crowded), (6, None, None));
        assert!(open.is_empty());
        let (m, open) = run(4, &faces[1..]);
        assert_eq!((m.pairs, m.same_way, m.crowded), (3, None, None));
        assert_eq!(open, [[1, 0], [0, 2], [2, 1]]);
    }

    #[test]
    fn repeats_are_seen_whichever_way_they_run() {
        let same = run(4, &[[0, 1, 2], [0, 1, 3]]).0;
        assert_eq!((same.same_way, same.crowded), (Some([0, 1]), None));
        let three = run(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]).0;
        assert_eq!((three.same_way, three.crowded), (None, Some([0, 1])));
        let four = run(6, &[[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]]).0;
        assert_eq!(four.crowded, Some([0, 1]));
    }

    #[test]
    fn parts_are_those_of_a_slow_flood() {
        let triangles = [[5, 3, 4], [0, 1, 2], [2, 6, 1], [7, 8, 9], [9, 3, 7]];
        let mut edges = Edges::default();
        edges.connect(10, &triangles);
        assert_eq!(edges.parts().collect::<Vec<_>>(), [0, 3]);
        assert_eq!((edges.part(6), edges.part(8)), (0, 3));
    }
}
