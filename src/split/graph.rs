//! Which basins are one cell: the tree of greatest saddles, cut at necks.
//!
//! Kruskal's algorithm takes saddles, the greatest first. Where two trees meet, the one with the lower peak ends; the
//! two basins at the saddle become one cell unless the saddle is a neck. A slab after the other gives the same: a tree
//! that no basin of the slabs to come belongs to knows all its saddles, and if the greatest of them leads to a tree
//! whose peak is known to be higher, it ends there whatever comes. Then it is joined to that one and forgotten, so that
//! memory follows the last slice and not the number of basins.

use super::metric::{Metric, Peak, Saddle};
use super::necks::Neck;
use super::seam::OpenBasin;
use super::touches::Mixer;
use crate::error::{Error, Result};
use std::collections::{BTreeMap, HashMap};

/// When a saddle is a neck.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NeckRule {
    /// Basins are one cell if the radius of the saddle is more than so many thousandths of that of the lower peak; 1 to
    /// 1000.
    pub ratio_permille: u32,
    /// They are one cell if the radius falls by less than this from the lower peak to the saddle, in 1/256 of a step
    /// along the finest axis.
    pub h_256: u32,
    /// They are one cell if the lower peak's radius is less than this, in the same unit.
    pub min_radius_256: u32,
}

impl Default for NeckRule {
    fn default() -> Self {
        NeckRule {
            ratio_permille: 800,
            h_256: 128,
            min_radius_256: 0,
        }
    }
}

impl NeckRule {
    /// Refuses a ratio out of range.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self) -> Result<()> {
        if (1..=1000).contains(&self.ratio_permille) {
            return Ok(());
        }
        let found = f64::from(self.ratio_permille) / 1000.0;
        let expected = "a ratio of radii above 0, at most 1, in steps of 0.001";
        Err(Error::usage("--split", found.to_string(), expected))
    }

    /// True if the basins at a saddle of this level are one cell; `peak` is the lower of the two peaks.
    pub fn joins(&self, metric: &Metric, saddle: u32, peak: u32) -> bool {
        let ratio = u64::from(self.ratio_permille);
        let [at_peak, at_saddle] = [peak, saddle].map(|level| metric.radius_256(level));
        u64::from(saddle) * 1_000_000 > ratio * ratio * u64::from(peak)
            || at_peak - at_saddle < u64::from(self.h_256)
            || at_peak < u64::from(self.min_radius_256)
    }
}

/// A saddle at which two trees became one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct TreeSaddle {
    /// The basins at it.
    pub basins: [u64; 2],
    /// Linear index of the lower voxel.
    pub low: u64,
    /// Its level.
    pub level: u32,
    /// The level of the lower peak of the two trees.
    pub peak: u32,
}

impl TreeSaddle {
    /// As a neck, of which the cells are not known.
    pub fn neck(&self) -> Neck {
        Neck {
            cells: [0; 2],
            voxel: self.low,
            level: self.level,
            peak: self.peak,
            faces: [0; 3],
        }
    }
}

/// A basin in a slab.
#[derive(Debug, Clone, Copy)]
pub struct Arrival {
    /// Its number.
    pub basin: u64,
    /// Its maximum, in the slab in which it lies.
    pub peak: Option<Peak>,
    /// True if it has a voxel in the slab's last slice, and there are slabs behind it.
    pub live: bool,
}

/// A pass between two trees.
#[derive(Debug, Clone, Copy)]
pub struct Edge {
    /// The basins at it.
    pub basins: [u64; 2],
    /// Its place in the order of all.
    pub saddle: Saddle,
}

/// What is left of a tree whose end is not known yet: the basin that may go on elsewhere, or else that with which the tree
/// began, and the highest peak that is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RestTree {
    /// Its name: no other tree has it, but for what is left elsewhere of the same one.
    pub basin: OpenBasin,
    /// 1 if a basin of it may go on in slices to come.
    pub live: u64,
}

/// The greatest saddle between two of these trees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RestEdge {
    /// The names of the trees.
    pub trees: [u64; 2],
    /// The basins at the saddle.
    pub basins: [u64; 2],
    voxels: [u64; 2],
    level: u32,
    reserved: u32,
}

impl RestEdge {
    fn new(trees: [u64; 2], Edge { basins, saddle }: Edge) -> Self {
        RestEdge {
            trees,
            basins,
            voxels: [saddle.low.voxel, saddle.high],
            level: saddle.low.level,
            reserved: 0,
        }
    }

    /// The pass.
    pub fn edge(&self) -> Edge {
        let [voxel, high] = self.voxels;
        let level = self.level;
        Edge {
            basins: self.basins,
            saddle: Saddle {
                low: Peak { level, voxel },
                high,
            },
        }
    }
}

/// A tree, and the greatest saddle to each of its neighbours.
#[derive(Debug, Default)]
struct Tree {
    /// The basin with which it began; that which is live, if one is.
    name: u64,
    /// The highest peak that is known.
    top: Option<Peak>,
    /// True if one of its basins may go on in slabs to come; no more than one does.
    live: bool,
    edges: HashMap<u32, Edge, Mixer>,
    order: BTreeMap<Saddle, u32>,
}

impl Tree {
    fn insert(&mut self, other: u32, edge: Edge) {
        if let Some(known) = self.edges.get(&other) {
            if known.saddle >= edge.saddle {
                return;
            }
            self.order.remove(&known.saddle);
        }
        self.edges.insert(other, edge);
        self.order.insert(edge.saddle, other);
    }

    fn remove(&mut self, other: u32) {
        if let Some(edge) = self.edges.remove(&other) {
            self.order.remove(&edge.saddle);
        }
    }
}

/// The graph of basins and saddles, as far as it can still change.
#[derive(Debug, Default)]
pub struct Graph {
    trees: Vec<Option<Tree>>,
    free: Vec<u32>,
    /// Trees of the basins of the slab, and of those that were live before it.
    tree_of: HashMap<u64, u32, Mixer>,
    /// The most trees at once.
    most: usize,
}

impl Graph {
    /// The most trees that were in memory at once, between slabs.
    pub fn most_trees(&self) -> usize {
        self.most
    }

    /// A slab begins, with these basins; one may come several times.
    pub fn begin_slab(&mut self, arrivals: impl Iterator<Item = Arrival>) {
        for &tree in self.tree_of.values() {
            tree_mut(&mut self.trees, tree).live = false;
        }
        for arrival in arrivals {
            let place = *self.tree_of.entry(arrival.basin).or_insert_with(|| {
                self.free.pop().unwrap_or_else(|| {
                    self.trees.push(None);
                    self.trees.len() as u32 - 1
                })
            });
            let tree = self.trees[place as usize].get_or_insert_with(|| Tree {
                name: arrival.basin,
                ..Tree::default()
            });
            tree.top = tree.top.max(arrival.peak);
            tree.live |= arrival.live;
        }
    }

    /// Two basins of the slab, or one of it and one that was live before it, touch.
    pub fn touch(&mut self, basins: [u64; 2], saddle: Saddle) {
        self.meet(basins, Edge { basins, saddle });
    }

    /// The trees of these names meet there; they are as they were left after other slabs.
    pub fn meet(&mut self, trees: [u64; 2], edge: Edge) {
        let [a, b] = trees.map(|tree| self.tree_of[&tree]);
        tree_mut(&mut self.trees, a).insert(b, edge);
        tree_mut(&mut self.trees, b).insert(a, edge);
    }

    /// The slab ends: whatever cannot change any more is decided and told to `each`.
    ///
    /// # Errors
    /// What `each` returns.
    pub fn end_slab(&mut self, mut each: impl FnMut(TreeSaddle) -> Result<()>) -> Result<()> {
        let is_done = |tree: &Option<Tree>| tree.as_ref().is_some_and(|tree| !tree.live);
        let mut todo: Vec<u32> = (0..self.trees.len() as u32)
            .filter(|&tree| is_done(&self.trees[tree as usize]))
            .collect();
        while let Some(place) = todo.pop() {
            if !is_done(&self.trees[place as usize]) {
                continue;
            }
            let tree = tree_mut(&mut self.trees, place);
            let Some((_, &other)) = tree.order.last_key_value() else {
                // whole, and alone
                self.trees[place as usize] = None;
                self.free.push(place);
                continue;
            };
            let (edge, top) = (tree.edges[&other], tree.top.expect("it is whole"));
            let higher = tree_mut(&mut self.trees, other).top;
            if higher.is_none_or(|higher| higher < top) {
                continue;
            }
            each(TreeSaddle {
                basins: edge.basins,
                low: edge.saddle.low.voxel,
                level: edge.saddle.low.level,
                peak: top.level,
            })?;
            todo.extend(self.join(place, other));
        }
        let trees = &self.trees;
        self.tree_of
            .retain(|_, tree| trees[*tree as usize].as_ref().is_some_and(|tree| tree.live));
        self.most = self.most.max(self.trees.len() - self.free.len());
        Ok(())
    }

    /// What is left when no slab comes here any more, but trees may go on elsewhere: those that are live, and those of which
    /// it is not known where they end. `is_live` tells whether a basin may go on in slices to come.
    pub fn into_rest(self, is_live: impl Fn(u64) -> bool) -> (Vec<RestTree>, Vec<RestEdge>) {
        let (mut trees, mut edges) = (Vec::new(), Vec::new());
        for (place, tree) in (0..).zip(&self.trees) {
            let Some(tree) = tree else { continue };
            trees.push(RestTree {
                basin: OpenBasin::new(tree.name, tree.top),
                live: u64::from(is_live(tree.name)),
            });
            for (&other, &edge) in tree.edges.iter().filter(|(other, _)| place < **other) {
                let met = self.trees[other as usize].as_ref();
                let trees = [tree.name, met.expect("a tree that is known").name];
                edges.push(RestEdge::new(trees, edge));
            }
        }
        trees.sort_unstable_by_key(|tree| tree.basin.number);
        edges.sort_unstable_by_key(|edge| edge.trees);
        (trees, edges)
    }

    /// Joins a tree to another one and forgets it; returns the trees whose neighbours changed.
    fn join(&mut self, place: u32, into: u32) -> Vec<u32> {
        let ended = self.trees[place as usize].take().expect("it is there");
        self.free.push(place);
        tree_mut(&mut self.trees, into).remove(place);
        let mut changed = vec![into];
        for (other, edge) in ended.edges {
            if other == into {
                continue;
            }
            changed.push(other);
            let tree = tree_mut(&mut self.trees, other);
            tree.remove(place);
            tree.insert(into, edge);
            tree_mut(&mut self.trees, into).insert(other, edge);
        }
        changed
    }
}

fn tree_mut(trees: &mut [Option<Tree>], place: u32) -> &mut Tree {
    trees[place as usize]
        .as_mut()
        .expect("a tree that is known")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Kruskal's algorithm on all saddles at once; `peaks` has one for each basin.
    fn batch(peaks: &[Peak], edges: &[Edge]) -> Vec<TreeSaddle> {
        let mut edges = edges.to_vec();
        edges.sort_by_key(|edge| std::cmp::Reverse(edge.saddle));
        let mut tree_of: Vec<usize> = (0..peaks.len()).collect();
        let mut found = Vec::new();
        for Edge { basins, saddle } in edges {
            let [a, b] = basins.map(|basin| tree_of[basin as usize]);
            if a == b {
                continue;
            }
            // the highest peak names the tree
            let (high, low) = if peaks[a] > peaks[b] { (a, b) } else { (b, a) };
            found.push(TreeSaddle {
                basins,
                low: saddle.low.voxel,
                level: saddle.low.level,
                peak: peaks[low].level,
            });
            let ended = tree_of.iter_mut().filter(|tree| **tree == low);
            ended.for_each(|tree| *tree = high);
        }
        found.sort_by_key(|saddle| saddle.basins);
        found
    }

    /// A basin: its first slice, how many more it has, in which of them the peak lies, and how high that is.
    type Drawn = (u32, u32, u32, u32);

    /// Slabs of `height` slices, one after the other. Edges have the slice in which they are seen.
    fn streamed(
        basins: &[Drawn],
        peaks: &[Peak],
        edges: &[(u32, Edge)],
        height: u32,
    ) -> Vec<TreeSaddle> {
        let (mut graph, mut found) = (Graph::default(), Vec::new());
        let slabs = 32u32.div_ceil(height);
        for slab in 0..slabs {
            let slices = slab * height..(slab + 1) * height;
            let there = (0..basins.len()).filter(|&i| {
                let (first, more, ..) = basins[i];
                first < slices.end && first + more >= slices.start
            });
            let arrival = |i: usize| {
                let (first, more, peak, _) = basins[i];
                let peak = slices
                    .contains(&(first + peak % (more + 1)))
                    .then_some(peaks[i]);
                Arrival {
                    basin: i as u64,
                    peak,
                    live: first + more + 1 >= slices.end && slab + 1 < slabs,
                }
            };
            graph.begin_slab(there.map(arrival));
            for (_, edge) in edges.iter().filter(|(z, _)| slices.contains(z)) {
                graph.touch(edge.basins, edge.saddle);
            }
            let each = |saddle| {
                found.push(saddle);
                Ok(())
            };
            graph.end_slab(each).unwrap();
        }
        assert_eq!(
            graph.trees.len(),
            graph.free.len(),
            "all are forgotten in the end"
        );
        found.sort_by_key(|saddle| saddle.basins);
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1500))]

        #[test]
        fn slab_by_slab_gives_the_tree_of_all_saddles(
            basins in prop::collection::vec((0u32..24, 0u32..8, 0u32..8, 1u32..12), 1..40),
            pairs in prop::collection::vec((0usize..40, 0usize..40, 0u32..8, 1u32..12), 0..120),
            height in 1u32..40,
        ) {
            let level = |i: usize| basins[i].3;
            let peaks: Vec<Peak> =
                (0..basins.len()).map(|i| Peak { level: level(i), voxel: 7 * i as u64 % 41 }).collect();
            let mut edges: Vec<(u32, Edge)> = Vec::new();
            for (at, (a, b, z, most)) in pairs.into_iter().enumerate() {
                let (a, b) = (a % basins.len(), b % basins.len());
                let from = basins[a].0.max(basins[b].0);
                let to = (basins[a].0 + basins[a].1).min(basins[b].0 + basins[b].1);
                // they touch in a slice that both have, or the last one of one the first one of the other
                if a == b || from > to + 1 {
                    continue;
                }
                let z = (from + z % (to + 2 - from)).min(from.max(to));
                let saddle = Saddle {
                    low: Peak { level: most.min(level(a)).min(level(b)), voxel: 1000 + at as u64 / 2 },
                    high: 2000 + at as u64,
                };
                edges.push((z, Edge { basins: [a.min(b) as u64, a.max(b) as u64], saddle }));
            }
            let all: Vec<Edge> = edges.iter().map(|edge| edge.1).collect();
            prop_assert_eq!(streamed(&basins, &peaks, &edges, height), batch(&peaks, &all));
        }
    }
}
