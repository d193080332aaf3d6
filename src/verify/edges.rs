//! Matching of a piece's directed edges, and its connected parts.
//!
//! Edges are bucketed by their smaller vertex. A bucket holds four entries on the average and has eight
//! slots, so that nothing is counted before it is filled; what does not fit is spilled. Whether the
//! entries of a bucket pair up is asked of eight buckets at once and without a branch, by comparing each
//! slot with each other. Only buckets that do not pair up, those of the tile's border, are sorted and
//! walked, which finds what is wrong with them.
//!
//! Counting, sorting and walking all buckets was 28 % of the time of verifying a foam, with a mispredicted
//! branch or two for each; entering and comparing is 14 % of that time. Looking up falling edges among
//! rising ones was no faster than sorting: its branches cannot be predicted either.

use crate::cpu::dispatch;

/// Entries that a bucket holds before it spills, and buckets that lie side by side.
const SLOTS: usize = 8;

/// Eight buckets: the first slot of each, the second of each, and so on.
type Block = [[u32; SLOTS]; SLOTS];

/// What an entry says of its edge, in the two bits below its larger vertex: it runs up to the larger
/// vertex, down from it, or both ways, in two triangles; or the slot is free.
const RISES: u32 = 0;
const FALLS: u32 = 1;
const BOTH: u32 = 2;
const FREE: u32 = 3;

/// A block without entries: no two slots name the same vertex.
const EMPTY: Block = {
    let mut block = [[0; SLOTS]; SLOTS];
    let mut slot = 0;
    while slot < SLOTS {
        block[slot] = [((MAX_VERTICES + slot as u32) << 2) | FREE; SLOTS];
        slot += 1;
    }
    block
};

/// Vertices that an entry can tell from a free slot's: more than a GLB of 4 GiB has.
const MAX_VERTICES: u32 = (1 << 30) - SLOTS as u32;

/// Buffers that are kept from piece to piece.
#[derive(Default)]
pub(super) struct Edges {
    blocks: Vec<Block>,
    /// Entries of each bucket, spilled ones aside.
    counts: Vec<u8>,
    /// Entries for which there was no slot, with the bucket.
    spilled: Vec<(u32, u32)>,
    /// The buckets that do not pair up at sight.
    doubtful: Vec<u32>,
    bucket: Vec<u32>,
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
    /// Every index is below `vertices`, no triangle names a vertex twice; `vertices` is below
    /// 2^30 - 8, which a GLB of at most 4 GiB guarantees.
    pub fn match_up(&mut self, vertices: usize, triangles: &[[u32; 3]]) -> Matched {
        debug_assert!(vertices <= MAX_VERTICES as usize);
        self.fill(vertices, triangles);
        self.doubtful.clear();
        let (blocks, doubtful) = (&self.blocks, &mut self.doubtful);
        dispatch!(find_doubtful(blocks, doubtful));
        if !self.spilled.is_empty() {
            self.spilled.sort_unstable();
            doubtful.extend(self.spilled.iter().map(|s| s.0));
            doubtful.sort_unstable();
            doubtful.dedup();
        }
        self.open.clear();
        let mut out = Matched::default();
        let (mut spoilt, mut spilled) = (0, &self.spilled[..]);
        for &low in &self.doubtful {
            let own = spilled.partition_point(|s| s.0 == low);
            let (own, rest) = spilled.split_at(own);
            spilled = rest;
            let block = &self.blocks[low as usize / SLOTS];
            let slots = block.iter().map(|slot| slot[low as usize % SLOTS]);
            self.bucket.clear();
            for e in slots.chain(own.iter().map(|s| s.1)) {
                match e & 3 {
                    FREE => {}
                    BOTH => self.bucket.extend([e ^ BOTH | RISES, e ^ BOTH | FALLS]),
                    _ => self.bucket.push(e),
                }
            }
            self.bucket.sort_unstable();
            spoilt += walk(low, &self.bucket, &mut self.open, &mut out);
        }
        out.pairs = (3 * triangles.len() - self.open.len() - spoilt) as u64 / 2;
        out
    }

    /// Enters all edges in their buckets, and lets [`Edges::parent`] of every vertex with a smaller
    /// neighbour be one of those.
    ///
    /// A triangle of a strip shares its first edge with the one before: such an edge is entered once.
    fn fill(&mut self, vertices: usize, triangles: &[[u32; 3]]) {
        self.blocks.clear();
        self.blocks.resize(vertices.div_ceil(SLOTS), EMPTY);
        self.counts.clear();
        self.counts.resize(vertices, 0);
        self.spilled.clear();
        self.parent.clear();
        self.parent.extend(0..vertices as u32);
        let nexts = triangles.iter().skip(1).chain([&[u32::MAX; 3]]);
        let mut entered = false;
        for (&[a, b, c], &[d, e, _]) in triangles.iter().zip(nexts) {
            let (second, third) = ((d, e) == (c, b), (d, e) == (a, c));
            self.enter(a, b, false, !entered);
            self.enter(b, c, second, true);
            self.enter(c, a, third, true);
            entered = second | third;
        }
    }

    /// Enters the edge from `tail` to `head`, or both ways; does nothing unless `wanted`.
    #[inline(always)]
    fn enter(&mut self, tail: u32, head: u32, both: bool, wanted: bool) {
        let (low, high) = (tail.min(head), tail.max(head));
        let kind = if both { BOTH } else { u32::from(tail > head) };
        let entry = high << 2 | kind;
        self.parent[high as usize] = low;
        let count = &mut self.counts[low as usize];
        let slot = usize::from(*count);
        if slot < SLOTS {
            // written without asking, as what was there if it is not wanted
            let place = &mut self.blocks[low as usize / SLOTS][slot][low as usize % SLOTS];
            *place = if wanted { entry } else { *place };
            *count += u8::from(wanted);
        } else if wanted {
            self.spilled.push((low, entry));
        }
    }

    /// Finds the connected parts of the triangles that were matched up last; afterwards
    /// [`Edges::part`] tells a vertex's part.
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
        if roots < 2 {
            return;
        }
        for &[a, b, c] in triangles {
            let of = |v: u32| self.parent[v as usize];
            if of(a) == of(b) && of(b) == of(c) {
                continue;
            }
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

/// Appends the buckets of which an entry lacks its mate, or occurs more than once, rising.
#[inline(always)]
fn find_doubtful(blocks: &[Block], out: &mut Vec<u32>) {
    for (i, block) in blocks.iter().enumerate() {
        let bad = unpaired(block);
        if bad == [0; SLOTS] {
            continue;
        }
        let lanes = (0..SLOTS).filter(|&lane| bad[lane] != 0);
        out.extend(lanes.map(|lane| (i * SLOTS + lane) as u32));
    }
}

/// For each bucket of a block, 0 if its entries pair up: no edge occurs twice in the same direction,
/// and each occurs in both.
///
/// No two entries may name the same vertex but a rising and a falling edge; so an entry has one mate
/// at most, and if there are as many mates as edges that run one way, each has its own.
#[inline(always)]
fn unpaired(block: &Block) -> [u32; SLOTS] {
    let (mut same, mut mates) = ([0u32; SLOTS], [0u32; SLOTS]);
    for i in 0..SLOTS {
        for j in 0..i {
            for lane in 0..SLOTS {
                let differ = block[i][lane] ^ block[j][lane];
                same[lane] += u32::from(differ >> 2 == 0);
                mates[lane] += u32::from(differ == RISES ^ FALLS);
            }
        }
    }
    let mut one_way = [0u32; SLOTS];
    for slot in block {
        for lane in 0..SLOTS {
            one_way[lane] += u32::from(slot[lane] & BOTH == 0);
        }
    }
    std::array::from_fn(|l| (same[l] ^ mates[l]) | (one_way[l] ^ (2 * mates[l])))
}

/// Goes through a sorted bucket of edges that run one way each, and returns how many directed edges
/// lie neither alone nor beside their reverse.
fn walk(low: u32, mut rest: &[u32], open: &mut Vec<[u32; 2]>, out: &mut Matched) -> usize {
    let mut spoilt = 0;
    while let Some(&first) = rest.first() {
        let same = |e: &u32| e >> 2 == first >> 2;
        let count = rest.iter().take_while(|e| same(e)).count();
        let edge = if first & FALLS == 0 {
            [low, first >> 2]
        } else {
            [first >> 2, low]
        };
        match count {
            1 => open.push(edge),
            2 if rest[0] != rest[1] => {}
            2 => _ = out.same_way.get_or_insert(edge),
            _ => _ = out.crowded.get_or_insert(edge),
        }
        if count > 2 || (count == 2 && rest[0] == rest[1]) {
            spoilt += count;
        }
        rest = &rest[count..];
    }
    spoilt
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// What [`Edges::match_up`] finds, by sorting all edges.
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

    proptest! {
        #[test]
        fn edges_and_parts_are_those_of_the_slow_way(
            shapes in prop::collection::vec(shapes(), 0..8),
            turn in 0..3usize,
        ) {
            let mut triangles = shapes.concat();
            triangles.retain(|t| BTreeSet::from(*t).len() == 3);
            triangles.iter_mut().step_by(7).for_each(|t| t.rotate_left(turn));
            let mut edges = Edges::default();
            let matched = edges.match_up(40, &triangles);
            prop_assert_eq!((matched, edges.open.clone()), slow_match(&triangles));
            edges.connect(&triangles);
            let parts = slow_parts(40, &triangles);
            prop_assert_eq!((0..40).map(|v| edges.part(v)).collect::<Vec<_>>(), parts.clone());
            let own = BTreeSet::from_iter(parts).into_iter().collect::<Vec<_>>();
            prop_assert_eq!(edges.parts().collect::<Vec<_>>(), own);
        }

        #[test]
        fn blocks_pair_up_as_sorted_buckets_do(
            entries in prop::collection::vec((0..8usize, 0..4u32, 0..3u32), 0..24),
            mates in any::<bool>(),
        ) {
            let mut block = EMPTY;
            let mut buckets = [const { Vec::new() }; SLOTS];
            for (lane, vertex, kind) in entries {
                let kinds = if mates && kind != BOTH { vec![RISES, FALLS] } else { vec![kind] };
                for kind in kinds {
                    if buckets[lane].len() < SLOTS {
                        block[buckets[lane].len()][lane] = vertex << 2 | kind;
                        buckets[lane].push(vertex << 2 | kind);
                    }
                }
            }
            let paired = |bucket: &Vec<u32>| (0..4).all(|v| {
                let mut kinds: Vec<u32> = bucket.iter().filter(|e| *e >> 2 == v).map(|e| e & 3).collect();
                kinds.sort_unstable();
                matches!(kinds[..], [] | [RISES, FALLS] | [BOTH])
            });
            let slow = buckets.each_ref().map(paired);
            prop_assert_eq!(unpaired(&block).map(|bad| bad == 0), slow);
            prop_assert_eq!(dispatch!(unpaired(&block)).map(|bad| bad == 0), slow);
        }
    }

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
        edges.match_up(10, &triangles);
        edges.connect(&triangles);
        assert_eq!(edges.parts().collect::<Vec<_>>(), [0, 3]);
        assert_eq!((edges.part(6), edges.part(8)), (0, 3));
    }
}
