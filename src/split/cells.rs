//! What was found: the tree of saddles, and the cells of all rows.

use super::SlabGrid;
use super::ascent::Piece;
use super::graph::{RestEdge, RestTree, TreeSaddle};
use super::judge::{CURVE, Judge, curve};
use super::names::BasinNames;
use super::necks::{BasinTouch, Neck, NeckSorter};
use super::numbers::Numbers;
use super::store::Store;
use crate::error::Result;
use crate::sys::spill_file::SpillFile;
use std::path::{Path, PathBuf};

/// The tree of saddles while it grows.
#[derive(Debug)]
pub struct Tree {
    /// Says which saddles are necks.
    pub judge: Judge,
    /// All saddles of the tree.
    pub saddles: SpillFile,
    /// Basins that are one cell, by the places of their names.
    pub sets: Numbers,
}

impl Tree {
    /// Takes a saddle.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(&mut self, saddle: TreeSaddle, names: &BasinNames) -> Result<()> {
        if self.judge.joins(&saddle) {
            let [a, b] = saddle.basins.map(|name| names.place(name));
            self.sets.union(a, b)?;
        }
        self.saddles.push(&[saddle]).map(|_| ())
    }
}

/// What the passes over some slices have found.
pub struct Found {
    /// The basins.
    pub store: Store,
    /// What these are called.
    pub names: BasinNames,
    /// Saddles that are known to be of the tree.
    pub tree: Tree,
    /// Basins that touch, block by block.
    pub met: SpillFile,
    /// What is left of trees that go on elsewhere.
    pub rest: (Vec<RestTree>, Vec<RestEdge>),
    /// The most trees of basins that were in memory at once, between slabs.
    pub most_trees: u64,
}

impl Found {
    /// Of a whole volume: numbers parts and components by their first voxels.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn into_split(self, dir: &Path) -> Result<Split> {
        let Tree {
            judge,
            saddles,
            sets: mut cell_of,
        } = self.tree;
        let basins = self.names.count();
        let mut components = Numbers::sets(dir, basins)?;
        saddles.each(|saddle: TreeSaddle| {
            let [a, b] = saddle.basins;
            components.union(a, b).map(|_| ())
        })?;
        let (parts, joined) = (cell_of.number_sets()?, components.number_sets()?);
        let mut component_of = Numbers::new(dir)?;
        for basin in 0..basins {
            // a part's number is that of its first basin among the first ones
            if cell_of.get(basin)? == component_of.len() {
                component_of.push(components.get(basin)?)?;
            }
        }
        Ok(Split {
            dir: dir.to_path_buf(),
            component_of,
            counts: SplitCounts {
                parts,
                components: joined,
                basins,
                most_trees: self.most_trees,
            },
            curve: curve(joined, &judge.cuts),
            rows: SplitRows {
                grid: self.store.grid(),
                store: self.store,
                names: self.names,
                saddles,
                met: self.met,
                cell_of,
            },
        })
    }
}

/// Numbers of what was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SplitCounts {
    /// Cells after the split.
    pub parts: u64,
    /// Connected components of air: cells without the split.
    pub components: u64,
    /// Maxima of the distance.
    pub basins: u64,
    /// The most trees of basins that were in memory at once, between slabs.
    pub most_trees: u64,
}

/// Voxels of a row one after the other that are of one cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartPiece {
    /// The first one.
    pub start: u16,
    /// The last one.
    pub last: u16,
    /// The cell: from 1, by the smallest linear index of a voxel.
    pub part: u64,
}

/// The cells of some slices after the split, by rows.
#[derive(Debug)]
pub struct SplitRows {
    /// The slices.
    pub grid: SlabGrid,
    /// The basins.
    pub store: Store,
    /// What these are called.
    pub names: BasinNames,
    /// Saddles of the tree.
    pub saddles: SpillFile,
    /// Basins that touch, block by block.
    pub met: SpillFile,
    /// The cell of each basin, from 0, by the places of their names.
    pub cell_of: Numbers,
}

/// The cells of a volume after the split.
#[derive(Debug)]
pub struct Split {
    dir: PathBuf,
    rows: SplitRows,
    component_of: Numbers,
    counts: SplitCounts,
    curve: [(u32, u64); CURVE.len()],
}

impl Split {
    /// How many cells, components and basins there are.
    pub fn counts(&self) -> SplitCounts {
        self.counts
    }

    /// The number of cells for ratios of 0.5 to 0.95, in thousandths, with the other limits of the rule.
    pub fn curve(&self) -> &[(u32, u64)] {
        &self.curve
    }

    /// Bytes of the temporary files that hold rows and basins.
    pub fn stored_bytes(&self) -> u64 {
        self.rows.store.bytes()
    }

    /// The component that a cell is a part of; both from 1.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn component(&mut self, part: u64) -> Result<u64> {
        Ok(self.component_of.get(part - 1)? + 1)
    }

    /// As [`SplitRows::slab`].
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `each` returns.
    pub fn slab(
        &mut self,
        slab: u32,
        each: impl FnMut(u32, u32, &[PartPiece]) -> Result<()>,
    ) -> Result<()> {
        self.rows.slab(slab, each)
    }

    /// As [`SplitRows::necks`].
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `each` returns.
    pub fn necks(&mut self, each: impl FnMut(Neck) -> Result<()>) -> Result<()> {
        self.rows.necks(&self.dir, each)
    }

    /// The cells by rows.
    pub fn rows(&mut self) -> &mut SplitRows {
        &mut self.rows
    }
}

impl SplitRows {
    /// Hands on the cells of the slice below, row by row, as [`SplitRows::slab`] does; nothing if there is none.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `each` returns.
    pub fn below(
        &mut self,
        mut each: impl FnMut(u32, u32, &[PartPiece]) -> Result<()>,
    ) -> Result<()> {
        let mut parts = Vec::new();
        for basin in &self.names.below.basins {
            parts.push(self.cell_of.get(self.names.place(basin.number))? + 1);
        }
        let (rows, z) = (&self.names.below.rows, self.grid.slices[0].wrapping_sub(1));
        let mut out: Vec<PartPiece> = Vec::new();
        for row in 0..rows.len() {
            cells_of_row(rows.row(row), &parts, &mut out);
            each(row as u32, z, &out)?;
        }
        Ok(())
    }

    /// Hands on the cells of a slab, row by row: row, slice and pieces by rising x. Rows of a band come slice by slice,
    /// bands by rising y.
    pub fn slab(
        &mut self,
        slab: u32,
        mut each: impl FnMut(u32, u32, &[PartPiece]) -> Result<()>,
    ) -> Result<()> {
        let mut parts = Vec::new();
        for basin in self.store.basins(slab)? {
            let place = self.names.place(self.names.name(basin.number));
            parts.push(self.cell_of.get(place)? + 1);
        }
        let mut out: Vec<PartPiece> = Vec::new();
        for band in 0..self.grid.bands() {
            let rows = self.store.block(slab, band)?;
            let places = self
                .grid
                .slab(slab)
                .flat_map(|z| self.grid.rows(band).map(move |y| (y, z)));
            for (row, (y, z)) in places.enumerate() {
                cells_of_row(rows.row(row), &parts, &mut out);
                each(y, z, &out)?;
            }
        }
        Ok(())
    }

    /// Hands on the necks, by rising cells; temporary files lie in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `each` returns.
    pub fn necks(&mut self, dir: &Path, each: impl FnMut(Neck) -> Result<()>) -> Result<()> {
        let mut sorter = NeckSorter::new(dir)?;
        let (names, cell_of) = (&self.names, &mut self.cell_of);
        let mut push = |basins: [u64; 2], neck: Neck| {
            let [a, b] = basins.map(|name| names.place(name));
            sorter.push([cell_of.get(a)? + 1, cell_of.get(b)? + 1], neck)
        };
        self.saddles
            .each(|saddle: TreeSaddle| push(saddle.basins, saddle.neck()))?;
        self.met
            .each(|touch: BasinTouch| push(touch.basins, touch.neck()))?;
        sorter.finish(each)
    }
}

/// The cells of a row of basins, of which `parts` has the cells.
fn cells_of_row(row: &[Piece], parts: &[u64], out: &mut Vec<PartPiece>) {
    out.clear();
    for piece in row {
        let part = parts[piece.end as usize];
        match out.last_mut() {
            Some(last) if last.part == part && last.last.checked_add(1) == Some(piece.start) => {
                last.last = piece.last;
            }
            _ => out.push(PartPiece {
                start: piece.start,
                last: piece.last,
                part,
            }),
        }
    }
}
