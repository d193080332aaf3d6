//! Cells that leak into each other, cut at their necks.
//!
//! One threshold joins the bubbles of a foam whose walls have holes to one component. Here, each voxel of air goes up
//! to where the walls are farther away, until it is at a maximum: the voxels that end at the same one are a *basin*.
//! Basins that touch are one cell unless the radius of the opening between them is small against that of the smaller
//! one: then it is a *neck*. Squared distances are integers and all voxels are in one order, so the result depends on
//! the volume alone, and not on how it is cut, on threads or on memory.
//!
//! 1. `bits`: the bits of the volume on the disk, and how far each column has been without a solid voxel, before and
//!    behind each slab. From these, each part of a slab computes its exact distances alone.
//! 2. `distance`: the levels, which are squared distances, of a block; `metric`: how they are counted and compared.
//! 3. `ascent`: where each voxel goes up to, and where its way ends in the block.
//! 4. `basins`: ends of blocks are joined across bands and slabs; `store`: which voxels lead to which basin, by rows,
//!    on the disk; `numbers`: which basins turned out to be one.
//! 5. `touches`: a second pass over the blocks finds the greatest saddle of each pair of basins.
//! 6. `graph`: the tree of these saddles, cut at necks, while slabs come in.
//! 7. `necks`: the necks with their openings, by cells.
//!
//! Parts of a volume do this by themselves (`part`). What they share is joined (`merge`): states of columns before
//! 1, basins after 4 (`seam`, which have names then, `names`), and what is left of trees after 6.
//!
//! The steepest way up and the tree of saddles follow the watershed by topographic distance (Meyer, "Topographic
//! distance and watershed lines", Signal Processing 38, 1994) and the merge tree of level sets (Carr, Snoeyink and Axen,
//! "Computing contour trees in all dimensions", Computational Geometry 24, 2003).

mod ascent;
mod basins;
mod bits;
mod cells;
mod distance;
mod graph;
mod grid;
mod judge;
mod merge;
mod metric;
mod names;
mod necks;
mod numbers;
mod part;
mod run;
mod seam;
mod store;
#[cfg(test)]
mod tests;
mod touches;

pub use bits::{Beside, Passage, pass};
pub use cells::{PartPiece, Split, SplitCounts, SplitRows};
pub use graph::{NeckRule, RestEdge, RestTree, TreeSaddle};
pub use grid::SlabGrid;
pub use merge::{BasinMerger, CellMerger, first_names, slice_below};
pub use metric::Metric;
pub use names::{BasinNames, SliceBelow};
pub use necks::Neck;
pub use part::{
    BASIN_FILES, BasinsFound, JOIN_FILES, KnownBasins, SADDLE_FILES, SaddlesFound, find_basins,
    find_saddles, rows_of,
};
pub use run::split;
pub use seam::{BasinSeam, OpenBasin};

use crate::error::{Error, Result};
use crate::grid::Ambiguous;

/// Where the bits of a volume come from.
pub trait BitSource {
    /// Writes the bits of slice `z` to `words`: rows by y, each of whole words, voxel x in bit x % 64 of word x / 64; 1
    /// is solid, and so are no bits beyond a row's end. Slices are asked for once each, by rising z.
    ///
    /// # Errors
    /// Whatever keeps them from being had.
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()>;
}

/// How cells are split.
#[derive(Debug, Clone, Copy)]
pub struct SplitOptions {
    /// When an opening is a neck.
    pub rule: NeckRule,
    /// Which voxels are neighbours: those of cells, 18 for [`Ambiguous::Separate`] and 6 for [`Ambiguous::Join`].
    pub ambiguous: Ambiguous,
    /// How distances are counted.
    pub metric: Metric,
    /// How the volume is cut. It does not change the result.
    pub grid: SlabGrid,
    /// Threads; 0 for one per core.
    pub threads: usize,
}

impl SplitOptions {
    /// The usual rule for a volume that is cut like this.
    pub fn new(grid: SlabGrid) -> Self {
        SplitOptions {
            rule: NeckRule::default(),
            ambiguous: Ambiguous::default(),
            metric: Metric::default(),
            grid,
            threads: 0,
        }
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the option.
    pub fn check(&self) -> Result<()> {
        self.rule.check()?;
        let (grid, dims) = (self.grid, self.grid.dims);
        if dims.0.contains(&0)
            || dims.0[0] > crate::grid::MAX_DIM
            || grid.height == 0
            || grid.band == 0
        {
            let found = format!(
                "{dims} in slabs of {} and bands of {}",
                grid.height, grid.band
            );
            return Err(Error::usage("grid", found, "slabs and bands of a volume"));
        }
        Ok(())
    }
}
