//! Basins: the ends of ways across bands and slabs.
//!
//! A way that leaves its block ends at a voxel beside it, and goes on as the way of that voxel. Per slab, ends that turn
//! out to be one, and basins that came over from the slab before, are joined to *classes*. Only classes of the last
//! slice are kept for the next slab. Numbers of classes rise with their first voxels, as those of components do; which
//! are one basin in the end, a file knows.

use super::SlabGrid;
use super::ascent::{End, Ends, RowPieces};
use super::distance::Block;
use super::grid::Place;
use super::metric::Peak;
use super::numbers::Numbers;
use super::seam::BasinSeam;
use crate::error::Result;
use crate::labels::UnionFind;

/// What the join of a slab has to know of a band.
#[derive(Debug)]
pub struct BandEnds {
    ends: Vec<End>,
    /// Rows of the first and of the last slice.
    slices: [RowPieces; 2],
    /// The first and the last row, of each slice.
    rows: [RowPieces; 2],
}

impl BandEnds {
    /// Takes what is needed of a block; the pieces go elsewhere.
    pub fn of(ends: Ends, block: &Block) -> (Self, RowPieces) {
        let (rows, slices) = (block.y.len(), block.z.len());
        let some = |rows: &mut dyn Iterator<Item = usize>| {
            let mut some = RowPieces::new();
            for row in rows {
                some.push_row(ends.pieces.row(row), |end| end);
            }
            some
        };
        let first_of = |s: usize| s * rows;
        let kept = BandEnds {
            slices: [0, slices - 1].map(|s| some(&mut (first_of(s)..first_of(s + 1)))),
            rows: [0, rows - 1].map(|r| some(&mut (0..slices).map(|s| first_of(s) + r))),
            ends: ends.ends,
        };
        (kept, ends.pieces)
    }
}

/// What a class is behind its slab.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Class {
    /// Its number; others may turn out to be the same basin.
    pub number: u64,
    /// Its maximum, in the slab in which it lies.
    pub peak: Option<Peak>,
    /// True if it has a voxel in the last slice.
    pub live: bool,
}

/// The classes of a slab.
#[derive(Debug, Default)]
pub struct SlabClasses {
    /// By rising number.
    pub classes: Vec<Class>,
    /// Per band, the class of each end.
    pub of_end: Vec<Vec<u32>>,
}

/// Ends outside of a slab: band and end.
#[derive(Debug, Default)]
struct Leaving {
    up: Vec<(usize, u32)>,
    down: Vec<(usize, u32)>,
}

/// What is kept between slabs.
#[derive(Debug)]
pub struct Carried {
    grid: SlabGrid,
    /// Numbers of the classes that touch the last slice, rising.
    live: Vec<u64>,
    /// Their voxels there, per band.
    last_slice: Vec<RowPieces>,
    /// Ways that leave the last slice upwards: the voxels to which they go, and whose they are.
    upwards: Vec<(u64, u32)>,
    /// What is below the first slab.
    below: FirstSlice,
    sets: UnionFind,
}

/// The first slice of all slabs, with numbers of classes.
#[derive(Debug, Default)]
struct FirstSlice {
    rows: RowPieces,
    /// The class of each number in the rows.
    classes: Vec<u64>,
    /// Ways that leave it downwards: the voxels to which they go, and the classes whose they are.
    downwards: Vec<[u64; 2]>,
}

impl Carried {
    /// Nothing, before the first slab.
    pub fn new(grid: SlabGrid) -> Self {
        Carried {
            grid,
            live: Vec::new(),
            last_slice: Vec::new(),
            upwards: Vec::new(),
            below: FirstSlice::default(),
            sets: UnionFind::default(),
        }
    }

    /// What reaches the first slice and the last one, of slabs of which all are joined; `basins` has the basin of each class.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the file of numbers fails.
    pub fn seam(&mut self, basins: &mut Numbers) -> Result<BasinSeam> {
        let mut of_class = |classes: &[u64]| -> Result<Vec<u64>> {
            classes.iter().map(|&class| basins.get(class)).collect()
        };
        let FirstSlice {
            rows,
            classes,
            downwards,
        } = std::mem::take(&mut self.below);
        let [low, high] = [of_class(&classes)?, of_class(&self.live)?];
        let targets = |exits: &[[u64; 2]]| exits.iter().map(|exit| exit[0]).collect::<Vec<u64>>();
        let leave: Vec<u64> = downwards.iter().map(|exit| exit[1]).collect();
        let down = targets(&downwards).into_iter().zip(of_class(&leave)?);
        let up = self.upwards.iter();
        let up: Vec<[u64; 2]> = up
            .map(|&(voxel, live)| [voxel, high[live as usize]])
            .collect();
        let mut last = RowPieces::new();
        for rows in &self.last_slice {
            (0..rows.len()).for_each(|row| last.push_row(rows.row(row), |live| live));
        }
        let down = down.map(|(voxel, basin)| [voxel, basin]).collect();
        Ok(BasinSeam::of((rows, low), (last, high), down, up))
    }

    /// Joins the bands of a slab, by rising y, to classes and goes on to the next slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the file of numbers fails.
    pub fn join(
        &mut self,
        slab: u32,
        mut bands: Vec<BandEnds>,
        numbers: &mut Numbers,
    ) -> Result<SlabClasses> {
        let mut first_node = vec![self.live.len() as u32];
        for band in &bands {
            first_node.push(first_node.last().expect("not empty") + band.ends.len() as u32);
        }
        let nodes = *first_node.last().expect("not empty");
        self.sets.reset(nodes as usize);
        let Leaving { up, down } = self.follow(slab, &bands, &first_node);
        let mut found = self.number(&bands, &first_node, numbers)?;
        if slab == 0 && self.grid.goes_on()[0] {
            self.keep_first(&bands, &found, &down);
        }
        let node_class =
            |found: &SlabClasses, band: usize, end: u32| found.of_end[band][end as usize];
        for (b, band) in bands.iter().enumerate() {
            for piece in &band.slices[1].pieces {
                let class = node_class(&found, b, piece.end);
                found.classes[class as usize].live = true;
            }
        }
        self.keep(&mut bands, &found, up);
        Ok(found)
    }

    /// Joins ways that leave a block to those that they go on as. Returns those that leave the slab to where none was.
    fn follow(&mut self, slab: u32, bands: &[BandEnds], first_node: &[u32]) -> Leaving {
        let slices = self.grid.slab(slab);
        let node = |grid: &SlabGrid, voxel: u64| {
            let Place { x, y, z } = grid.place(voxel);
            let b = (y / grid.band) as usize;
            let (band, rows) = (&bands[b], grid.rows(b as u32));
            let (r, s) = ((y - rows.start) as usize, (z - slices.start) as usize);
            let end = if z == slices.start {
                band.slices[0].at(r, x)
            } else {
                let row = &band.rows[usize::from(y != rows.start)];
                row.at(s, x)
            };
            first_node[b] + end.expect("ways go to air")
        };
        for (voxel, live) in std::mem::take(&mut self.upwards) {
            self.sets.union(live, node(&self.grid, voxel));
        }
        let mut leaving = Leaving::default();
        for (b, band) in bands.iter().enumerate() {
            for (end, target) in band.ends.iter().enumerate() {
                let Place { x, y, z } = self.grid.place(target.voxel);
                if target.level > 0 {
                    continue;
                }
                let own = first_node[b] + end as u32;
                if z < slices.start && slab == 0 {
                    leaving.down.push((b, end as u32));
                } else if z < slices.start {
                    let below = y / self.grid.band;
                    let row = (y - self.grid.rows(below).start) as usize;
                    let live = self.last_slice[below as usize].at(row, x);
                    self.sets.union(live.expect("ways go to air"), own);
                } else if z < slices.end {
                    self.sets.union(own, node(&self.grid, target.voxel));
                } else {
                    leaving.up.push((b, end as u32));
                }
            }
        }
        leaving
    }

    /// Numbers the sets: those that came over keep the smallest of their numbers, new ones follow by their first voxels.
    fn number(
        &mut self,
        bands: &[BandEnds],
        first_node: &[u32],
        numbers: &mut Numbers,
    ) -> Result<SlabClasses> {
        let carried = self.live.len() as u32;
        let nodes = *first_node.last().expect("not empty") as usize;
        let mut class_of_root = vec![u32::MAX; nodes];
        let mut found = SlabClasses::default();
        let class = |number| Class {
            number,
            peak: None,
            live: false,
        };
        for node in 0..carried {
            let root = self.sets.find(node);
            if root == node {
                class_of_root[node as usize] = found.classes.len() as u32;
                found.classes.push(class(self.live[node as usize]));
            } else {
                numbers.union(self.live[root as usize], self.live[node as usize])?;
            }
        }
        let mut fresh: Vec<(u64, u32)> = Vec::new();
        let all = bands.iter().flat_map(|band| &band.ends);
        for (node, end) in (carried..).zip(all) {
            let root = self.sets.find(node);
            if root < carried {
                continue;
            }
            if root == node {
                // its place in the list, until it has a class
                class_of_root[root as usize] = fresh.len() as u32;
                fresh.push((end.first, root));
            } else {
                let first = &mut fresh[class_of_root[root as usize] as usize].0;
                *first = end.first.min(*first);
            }
        }
        fresh.sort_unstable();
        for (_, root) in fresh {
            class_of_root[root as usize] = found.classes.len() as u32;
            let number = numbers.push_set()?;
            found.classes.push(class(number));
        }
        for (band, range) in bands.iter().zip(first_node.windows(2)) {
            let of_node = |node| class_of_root[self.sets.find(node) as usize];
            let of_end: Vec<u32> = (range[0]..range[1]).map(of_node).collect();
            for (end, &class) in band.ends.iter().zip(&of_end) {
                if let Some(peak) = end.peak() {
                    let before = found.classes[class as usize].peak.replace(peak);
                    debug_assert_eq!(before, None, "a basin has one maximum");
                }
            }
            found.of_end.push(of_end);
        }
        Ok(found)
    }

    /// Keeps the classes of the first slice of all.
    fn keep_first(&mut self, bands: &[BandEnds], found: &SlabClasses, down: &[(usize, u32)]) {
        let class = |band: usize, end: u32| found.of_end[band][end as usize];
        let mut rows = RowPieces::new();
        for (b, band) in bands.iter().enumerate() {
            let first = &band.slices[0];
            (0..first.len()).for_each(|row| rows.push_row(first.row(row), |end| class(b, end)));
        }
        let exit = |&(b, end): &(usize, u32)| {
            let number = found.classes[class(b, end) as usize].number;
            [bands[b].ends[end as usize].voxel, number]
        };
        self.below = FirstSlice {
            rows,
            classes: found.classes.iter().map(|class| class.number).collect(),
            downwards: down.iter().map(exit).collect(),
        };
    }

    /// Keeps the classes of the last slice, renumbered among themselves.
    fn keep(&mut self, bands: &mut [BandEnds], found: &SlabClasses, leaving: Vec<(usize, u32)>) {
        let mut live_of = vec![u32::MAX; found.classes.len()];
        self.live.clear();
        for (class, live_of) in found.classes.iter().zip(&mut live_of) {
            if class.live {
                *live_of = self.live.len() as u32;
                self.live.push(class.number);
            }
        }
        let live = |band: usize, end: u32| live_of[found.of_end[band][end as usize] as usize];
        self.upwards = leaving
            .into_iter()
            .map(|(b, end)| (bands[b].ends[end as usize].voxel, live(b, end)))
            .collect();
        self.last_slice.clear();
        for (b, band) in bands.iter_mut().enumerate() {
            let last = std::mem::take(&mut band.slices[1]);
            self.last_slice.push(renamed(&last, |end| live(b, end)));
        }
    }
}

/// The same pieces with other numbers; those that go on with each other become one.
pub fn renamed(rows: &RowPieces, mut name: impl FnMut(u32) -> u32) -> RowPieces {
    let mut out = RowPieces::new();
    for row in 0..rows.len() {
        out.push_row(rows.row(row), &mut name);
    }
    out
}
