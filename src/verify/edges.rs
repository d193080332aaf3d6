//! Matching of a piece's directed edges, and its connected parts.
//!
//! Edges are bits of their vertices' words, see [`super::marks`], from which it is counted how many lack
//! their reverse. Those of a sound piece all lie on the planes of the tile's faces, so they are looked
//! for among the triangles there. If they are not all there, or an edge occurs twice, all edges are
//! sorted and walked, which finds what is wrong.
//!
//! Counting, sorting and walking all edges was 28 % of the time of verifying a foam. Buckets of eight slots
//! for each vertex, compared slot by slot without a branch, were 14 % of that time; looking up falling
//! edges among rising ones was no faster than sorting: its branches cannot be predicted.

use super::facets::{BATCH, Facets};
use super::marks::{self, Balance, has_reverse};
use super::piece::{Piece, Vertex};
use crate::sys::simd::dispatch;
use crate::sys::unchecked::UncheckedMut;

/// The lowest bit of an entry of the sorted edges, below its larger vertex: the edge runs down
/// from it.
const FALLS: u64 = 1;

/// Buffers that are kept from piece to piece.
#[derive(Default)]
pub(super) struct Edges {
    /// For each vertex the bits of its edges, and what triangles say of it.
    words: Vec<u64>,
    balance: Balance,
    parent: Vec<u32>,
    /// Triangles that touch the planes of the tile's faces.
    rim: Vec<[u32; 3]>,
    /// All edges, sorted, if something is wrong with them.
    sorted: Vec<(u32, u64)>,
    /// The edges without a mate, as (tail, head), by their smaller and then their larger vertex.
    pub open: Vec<[u32; 2]>,
}

/// The result of matching, besides [`Edges::open`]. Edges are given as (tail, head).
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
    /// Forgets the last piece; vertices are below `vertices` from now on.
    pub fn begin(&mut self, vertices: usize) {
        self.words.clear();
        self.words.resize(vertices, 0);
        self.parent.clear();
        self.parent.extend(0..vertices as u32);
        self.rim.clear();
    }

    /// Enters the triangles of a batch; see [`Edges::enter`].
    #[inline(always)]
    pub fn enter_batch(&mut self, triangles: &[[u32; 3]; BATCH], facets: &Facets) {
        let mut ranked = [[0; BATCH]; 3];
        for (i, &[a, b, c]) in triangles.iter().enumerate() {
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            ranked[0][i] = low;
            ranked[1][i] = a ^ b ^ c ^ low ^ high;
            ranked[2][i] = high;
        }
        let largest = ranked[2].iter().fold(0, |a, &b| a.max(b)) as usize;
        assert!(largest < self.words.len().min(self.parent.len()));
        // SAFETY: no corner is larger
        let (mut words, mut parent) = unsafe {
            let words = UncheckedMut::new(&mut self.words);
            (words, UncheckedMut::new(&mut self.parent))
        };
        for (i, t) in triangles.iter().enumerate() {
            for k in 0..3 {
                *words.at_mut(t[k] as usize) |= facets.marks[k][i];
            }
            let [low, middle, high] = [0, 1, 2].map(|k| ranked[k][i]);
            *parent.at_mut(middle as usize) = low;
            *parent.at_mut(high as usize) = low;
        }
        if facets.rim.iter().fold(0, |any, r| any | r) < 0 {
            let touches = |&(_, r): &(_, &i32)| *r < 0;
            let rim = triangles.iter().zip(&facets.rim).filter(touches);
            self.rim.extend(rim.map(|(t, _)| *t));
        }
    }

    /// Enters a triangle: what it says of its corners, see [`marks::mark`], and that the larger two have
    /// a smaller neighbour, which becomes the parent of both.
    pub fn enter(&mut self, t: [u32; 3], marks: [u64; 3]) {
        for k in 0..3 {
            self.words[t[k] as usize] |= marks[k];
        }
        let mut ranked = t;
        ranked.sort_unstable();
        let [low, middle, high] = ranked;
        self.parent[middle as usize] = low;
        self.parent[high as usize] = low;
        self.rim.push(t);
    }

    /// The edges that were entered: the words and the parents.
    #[cfg(test)]
    pub fn entered(&self) -> (&[u64], &[u32]) {
        (&self.words, &self.parent)
    }

    /// Adds what was entered of vertices to their states, and counts edges.
    pub fn balance(&mut self, states: &mut [u8]) {
        self.balance = dispatch!(marks::balance(&self.words, states));
    }

    /// Matches the directed edges of the piece whose triangles were entered with their reverses.
    ///
    /// Each triangle lies in one cube and names no vertex twice. `distinct` is true if no two vertices are
    /// known to lie on one lattice edge.
    pub fn match_up(&mut self, piece: &Piece, distinct: bool) -> Matched {
        let edges = 3 * piece.triangles.len() as u64;
        if distinct && self.balance.directed == edges {
            self.find_open(&piece.points);
            let open = self.open.len() as u64;
            if open == self.balance.open {
                return Matched {
                    pairs: (edges - open) / 2,
                    ..Matched::default()
                };
            }
        }
        self.sort_and_walk(&piece.triangles)
    }

    /// Finds the edges at the rim that lack their reverse, if none was entered twice.
    fn find_open(&mut self, points: &[Vertex]) {
        self.open.clear();
        let end = |v: u32| (self.words[v as usize], points[v as usize][3]);
        for t in &self.rim {
            let ends = t.map(end);
            for k in 0..3 {
                let next = (k + 1) % 3;
                if !has_reverse([ends[k], ends[next]]) {
                    self.open.push([t[k], t[next]]);
                }
            }
        }
        let by_vertices = |&[a, b]: &[u32; 2]| (a.min(b), a.max(b));
        self.open.sort_unstable_by_key(by_vertices);
    }

    /// The result of [`Edges::match_up`], whatever the triangles are.
    fn sort_and_walk(&mut self, triangles: &[[u32; 3]]) -> Matched {
        self.sorted.clear();
        for &[a, b, c] in triangles {
            for (tail, head) in [(a, b), (b, c), (c, a)] {
                let entry = u64::from(tail.max(head)) << 1 | u64::from(tail > head);
                self.sorted.push((tail.min(head), entry));
            }
        }
        self.sorted.sort_unstable();
        self.open.clear();
        let mut out = Matched::default();
        let mut spoilt = 0;
        for same in self
            .sorted
            .chunk_by(|e, f| (e.0, e.1 >> 1) == (f.0, f.1 >> 1))
        {
            let (low, entry) = same[0];
            let high = (entry >> 1) as u32;
            let edge = if entry & FALLS == 0 {
                [low, high]
            } else {
                [high, low]
            };
            match same {
                [_] => self.open.push(edge),
                [first, second] if first != second => {}
                [_, _] => _ = out.same_way.get_or_insert(edge),
                _ => _ = out.crowded.get_or_insert(edge),
            }
            if same.len() > 2 || (same.len() == 2 && same[0] == same[1]) {
                spoilt += same.len();
            }
        }
        out.pairs = (3 * triangles.len() - self.open.len() - spoilt) as u64 / 2;
        out
    }

    /// Finds the connected parts of the triangles that were entered; afterwards [`Edges::part`] tells a
    /// vertex's part.
    ///
    /// Every vertex is joined to a smaller neighbour already, so only the smallest vertices of each
    /// neighbourhood are left to be joined where their neighbourhoods meet.
    pub fn connect(&mut self, triangles: &[[u32; 3]]) {
        let parent = &mut self.parent;
        let mut roots = 0;
        for v in 0..parent.len() {
            // that of a smaller vertex is a root already
            let root = parent[parent[v] as usize];
            parent[v] = root;
            roots += usize::from(root as usize == v);
        }
        for &[a, b, c] in triangles {
            if roots < 2 {
                return;
            }
            // most are seen to be in one part already by the parents of their corners, or by the parents of these
            let parents = |of: [u32; 3]| of.map(|v| self.parent[v as usize]);
            let is_one = |[a, b, c]: [u32; 3]| a == b && b == c;
            let known = parents([a, b, c]);
            if is_one(known) || is_one(parents(known)) {
                continue;
            }
            let (a, b, c) = (self.part(a), self.part(b), self.part(c));
            let root = a.min(b).min(c);
            for part in [a, b, c] {
                roots -= usize::from(self.parent[part as usize] != root);
                self.parent[part as usize] = root;
            }
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
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// The result of [`Edges::match_up`], by sorting all edges.
    fn slow_match(triangles: &[[u32; 3]]) -> (Matched, Vec<[u32; 2]>) {
        let mut all: BTreeMap<[u32; 2], Vec<bool>> = BTreeMap::new();
        for &[a, b, c] in triangles {
            for (a, b) in [(a, b), (b, c), (c, a)] {
                all.entry([a.min(b), a.max(b)]).or_default().push(a > b);
            }
        }
        let (mut out, mut open) = (Matched::default(), Vec::new());
        for ([low, high], mut falls) in all {
            falls.sort_unstable();
            let edge = if falls[0] { [high, low] } else { [low, high] };
            match falls[..] {
                [_] => open.push(edge),
                [false, true] => out.pairs += 1,
                [_, _] => _ = out.same_way.get_or_insert(edge),
                _ => _ = out.crowded.get_or_insert(edge),
            }
        }
        (out, open)
    }

    /// The smallest vertex of each vertex's part, by passing it on until nothing changes.
    fn slow_parts(vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
        let mut part: Vec<u32> = (0..vertices as u32).collect();
        loop {
            let before = part.clone();
            for t in triangles {
                let least = t.iter().map(|&i| part[i as usize]).min().unwrap_or(0);
                t.iter().for_each(|&i| part[i as usize] = least);
            }
            if part == before {
                return part;
            }
        }
    }

    /// A strip, a tetrahedron, or a pile of triangles around an edge, of vertices below 40.
    fn shapes() -> impl Strategy<Value = Vec<[u32; 3]>> {
        let strip = |w: Vec<u32>| {
            let turned = |(k, w): (usize, &[u32])| [w[k & 1], w[1 - (k & 1)], w[2]];
            w.windows(3).enumerate().map(turned).collect::<Vec<_>>()
        };
        prop_oneof![
            prop::collection::vec(0..40u32, 3..30).prop_map(strip),
            (0..40u32, 3..30u32)
                .prop_map(move |(first, n)| strip((first..40.min(first + n)).collect())),
            (0..37u32).prop_map(|i| {
                [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
                    .map(|t| t.map(|v| v + i))
                    .to_vec()
            }),
            (0..10u32).prop_map(|i| (11..25).map(|v| [i, v, v + 1]).collect()),
        ]
    }

    /// Enters triangles, of which only the numbers of their vertices are looked at.
    fn entered(vertices: usize, triangles: &[[u32; 3]]) -> Edges {
        let mut edges = Edges::default();
        edges.begin(vertices);
        triangles.iter().for_each(|t| edges.enter(*t, [0; 3]));
        edges
    }

    /// The lattice edges of 3 x 2 x 2 cubes as vertices, those of each cube.
    fn lattice() -> (Vec<Vertex>, Vec<Vec<u32>>) {
        let mut vertices: Vec<Vertex> = Vec::new();
        let cubes = (0..12).map(|i| [i % 3, i / 3 % 2, i / 6]);
        let edges_of = |cube: [i32; 3]| {
            (0..12)
                .map(|i| {
                    let (axis, mut at) = (i / 4, cube);
                    at[(axis + 1) % 3] += i as i32 & 1;
                    at[(axis + 2) % 3] += i as i32 >> 1 & 1;
                    let along: [i32; 3] = std::array::from_fn(|a| i32::from(a == axis));
                    let [x, y, z] = std::array::from_fn(|a| at[a] * 256 + 100 * along[a]);
                    let vertex = [x, y, z, marks::code(at, along)];
                    let known = vertices.iter().position(|v| *v == vertex);
                    known.unwrap_or_else(|| {
                        vertices.push(vertex);
                        vertices.len() - 1
                    }) as u32
                })
                .collect::<Vec<_>>()
        };
        let cubes = cubes.map(edges_of).collect();
        (vertices, cubes)
    }

    proptest! {
        #[test]
        fn edges_and_parts_are_those_of_the_slow_way(
            shapes in prop::collection::vec(shapes(), 0..8),
            turn in 0..3usize,
        ) {
            let mut triangles = shapes.concat();
            triangles.retain(|t| BTreeSet::from(*t).len() == 3);
            triangles.iter_mut().step_by(7).for_each(|t| t.rotate_left(turn));
            let mut edges = entered(40, &triangles);
            let matched = edges.sort_and_walk(&triangles);
            prop_assert_eq!((matched, edges.open.clone()), slow_match(&triangles));
            edges.connect(&triangles);
            let parts = slow_parts(40, &triangles);
            prop_assert_eq!((0..40).map(|v| edges.part(v)).collect::<Vec<_>>(), parts.clone());
            let own = BTreeSet::from_iter(parts).into_iter().collect::<Vec<_>>();
            prop_assert_eq!(edges.parts().collect::<Vec<_>>(), own);
        }

        #[test]
        fn bits_match_what_sorted_edges_do(
            shapes in prop::collection::vec((0..12usize, prop::sample::subsequence((0..12usize).collect::<Vec<_>>(), 4), any::<bool>()), 0..12),
            keep in prop_oneof![Just(100), 0..40usize],
            rim in any::<bool>(),
        ) {
            let (points, cubes) = lattice();
            let mut triangles = Vec::new();
            for (cube, picks, whole) in shapes {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| cubes[cube][picks[i]]);
                triangles.push([a, b, c]);
                if whole {
                    triangles.extend([[a, d, b], [b, d, c], [c, d, a]]);
                }
            }
            triangles.truncate(keep);
            let mut edges = Edges::default();
            edges.begin(points.len());
            for t in &triangles {
                let codes = t.map(|i| points[i as usize][3]);
                edges.enter(*t, std::array::from_fn(|k| {
                    marks::mark(codes[k], codes[(k + 1) % 3], codes[(k + 2) % 3], 0)
                }));
            }
            if !rim {
                edges.rim.clear();
            }
            edges.balance(&mut vec![0; points.len()]);
            let piece = Piece { points, triangles: triangles.clone(), ..Piece::default() };
            for distinct in [true, false] {
                let matched = edges.match_up(&piece, distinct);
                prop_assert_eq!((matched, edges.open.clone()), slow_match(&triangles));
            }
        }
    }

    fn run(vertices: usize, triangles: &[[u32; 3]]) -> (Matched, Vec<[u32; 2]>) {
        let mut edges = entered(vertices, triangles);
        let m = edges.sort_and_walk(triangles);
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
        let mut edges = entered(10, &triangles);
        edges.connect(&triangles);
        assert_eq!(edges.parts().collect::<Vec<_>>(), [0, 3]);
        assert_eq!((edges.part(6), edges.part(8)), (0, 3));
    }
}
