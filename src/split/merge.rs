//! Joins what the parts of a volume have found by themselves. Parts come by rising z; in memory is what two of them share,
//! and the trees of basins of one slice that still can change. Sets of basins are in files.

use super::graph::{Arrival, Graph, NeckRule, RestEdge, RestTree, TreeSaddle};
use super::judge::{CURVE, Judge, curve};
use super::metric::{Metric, Peak};
use super::names::SliceBelow;
use super::numbers::Numbers;
use super::seam::{BasinSeam, OpenBasin};
use crate::error::Result;
use crate::grid::Dims;
use std::path::Path;

/// Why two parts do not fit each other, in words.
pub type Misfit = String;

/// The name of the first basin of each part, and how many names there are, for parts with so many basins: each begins at a
/// multiple of 64, so that bits of parts can be written behind each other.
pub fn first_names(counts: &[u64]) -> (Vec<u64>, u64) {
    let mut next = 0;
    let first = |&count: &u64| {
        let first = next;
        next += count.next_multiple_of(64);
        first
    };
    (counts.iter().map(first).collect(), next)
}

/// Joins the basins of parts.
#[derive(Debug)]
pub struct BasinMerger {
    dims: Dims,
    /// The name of the first basin of each part.
    first: Vec<u64>,
    sets: Numbers,
    /// Voxel and level of the maximum of each set, by its root.
    peaks: [Numbers; 2],
    /// How many basins turned out to be one with others.
    joined: u64,
}

impl BasinMerger {
    /// Of parts with so many basins each; temporary files lie in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(dims: Dims, counts: &[u64], dir: &Path) -> Result<Self> {
        let (first, names) = first_names(counts);
        let list = || Numbers::sets(dir, names);
        Ok(BasinMerger {
            dims,
            first,
            sets: list()?,
            peaks: [list()?, list()?],
            joined: 0,
        })
    }

    fn name(&self, part: usize, seam: &BasinSeam, place: u64) -> u64 {
        self.first[part] + seam.open[place as usize].number
    }

    /// Joins the ways that go on between a part and the one above it. The inner error tells why these do not fit.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn join(
        &mut self,
        part: usize,
        below: &BasinSeam,
        above: &BasinSeam,
    ) -> Result<std::result::Result<(), Misfit>> {
        let [nx, ny, _] = self.dims.0.map(u64::from);
        let at = |voxel: u64| ((voxel / nx % ny) as usize, (voxel % nx) as u16);
        let misfit = |voxel: u64| {
            let (y, x) = at(voxel);
            let z = voxel / (nx * ny);
            Ok(Err(format!(
                "a way to voxel {x}, {y}, {z} in one of them, which is in no basin of the other"
            )))
        };
        for &[voxel, from] in &below.up {
            let (y, x) = at(voxel);
            let Some(to) = above.first.at(y, x) else {
                return misfit(voxel);
            };
            let ends = [
                self.name(part, below, from),
                self.name(part + 1, above, to.into()),
            ];
            self.union(ends)?;
        }
        for &[voxel, from] in &above.down {
            let (y, x) = at(voxel);
            let Some(to) = below.last.at(y, x) else {
                return misfit(voxel);
            };
            let ends = [
                self.name(part, below, to.into()),
                self.name(part + 1, above, from),
            ];
            self.union(ends)?;
        }
        Ok(Ok(()))
    }

    fn union(&mut self, [a, b]: [u64; 2]) -> Result<()> {
        self.joined += u64::from(self.sets.union(a, b)?.is_some());
        Ok(())
    }

    /// How many basins there are in all, once all parts are joined.
    pub fn basins(&self, counts: &[u64]) -> u64 {
        counts.iter().sum::<u64>() - self.joined
    }

    /// Notes the maxima that a part knows, once all are joined.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn note_peaks(&mut self, part: usize, seam: &BasinSeam) -> Result<()> {
        for open in seam.open.iter().filter(|open| open.peak_level > 0) {
            let root = self.sets.find(self.first[part] + open.number)?;
            self.peaks[0].set(root, open.peak_voxel)?;
            self.peaks[1].set(root, open.peak_level.into())?;
        }
        Ok(())
    }

    /// What the open basins of a part are called in the whole volume, and where their maxima are, once all are noted.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn named(&mut self, part: usize, seam: &BasinSeam) -> Result<Vec<OpenBasin>> {
        let mut named = Vec::with_capacity(seam.open.len());
        for open in &seam.open {
            let root = self.sets.find(self.first[part] + open.number)?;
            let [voxel, level] = [self.peaks[0].get(root)?, self.peaks[1].get(root)?];
            let peak = Peak {
                level: level as u32,
                voxel,
            };
            named.push(OpenBasin::new(root, (level > 0).then_some(peak)));
        }
        Ok(named)
    }
}

/// What a part is to know of the one below it, of whose open basins `named` is known.
pub fn slice_below(seam: BasinSeam, named: Vec<OpenBasin>) -> SliceBelow {
    // those of its first slice alone are not met
    let mut used = vec![u32::MAX; named.len()];
    let mut basins = Vec::new();
    let mut rows = seam.last;
    for piece in &mut rows.pieces {
        let place = &mut used[piece.end as usize];
        if *place == u32::MAX {
            *place = basins.len() as u32;
            basins.push(named[piece.end as usize]);
        }
        piece.end = *place;
    }
    SliceBelow { rows, basins }
}

/// Joins the cells of parts, and decides what none of them could.
#[derive(Debug)]
pub struct CellMerger {
    /// Counts the necks that parts have found, too.
    pub judge: Judge,
    sets: Numbers,
    graph: Graph,
}

impl CellMerger {
    /// Of basins with so many names; temporary files lie in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(rule: NeckRule, metric: Metric, names: u64, dir: &Path) -> Result<Self> {
        Ok(CellMerger {
            judge: Judge::new(rule, metric),
            sets: Numbers::sets(dir, names)?,
            graph: Graph::default(),
        })
    }

    /// Joins two basins that are of one cell. Tells `retire` the first basin that no cell begins with any more.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `retire` returns.
    pub fn join(
        &mut self,
        [a, b]: [u64; 2],
        retire: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        self.sets.union(a, b)?.map_or(Ok(()), retire)
    }

    /// Takes what is left of the trees of the next part, and tells `each` of saddles that are of the tree.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what the others return.
    pub fn add(
        &mut self,
        trees: &[RestTree],
        edges: impl Iterator<Item = RestEdge>,
        retire: &mut dyn FnMut(u64) -> Result<()>,
        each: &mut dyn FnMut(TreeSaddle) -> Result<()>,
    ) -> Result<()> {
        self.graph.begin_slab(trees.iter().map(|tree| Arrival {
            basin: tree.basin.number,
            peak: tree.basin.peak(),
            live: tree.live == 1,
        }));
        edges.for_each(|edge| self.graph.meet(edge.trees, edge.edge()));
        let (judge, sets) = (&mut self.judge, &mut self.sets);
        self.graph.end_slab(|saddle| {
            if judge.joins(&saddle) {
                let [a, b] = saddle.basins;
                sets.union(a, b)?.map_or(Ok(()), &mut *retire)?;
            }
            each(saddle)
        })
    }

    /// The most trees that were in memory at once, between parts.
    pub fn most_trees(&self) -> usize {
        self.graph.most_trees()
    }

    /// The first basin of the cell of a basin.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn first_of(&mut self, basin: u64) -> Result<u64> {
        self.sets.find(basin)
    }

    /// The number of cells of so many basins at each ratio of the curve, in thousandths, and at that of the rule.
    pub fn cells(&self, basins: u64) -> ([(u32, u64); CURVE.len()], u64) {
        let components = basins - self.judge.saddles;
        (
            curve(components, &self.judge.cuts),
            components + self.judge.necks,
        )
    }
}
