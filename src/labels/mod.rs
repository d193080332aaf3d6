//! Connected components of above voxels (objects) and below voxels (cells), out of core.
//!
//! A *slab* is what one layer of macrocubes needs; a *band* is one row of its macrocubes along y,
//! over the full width of the grid. Neighbouring bands share a row of voxels and neighbouring slabs
//! a slice, so everything about a cube, and every pair of adjacent voxels, lies within one band.
//!
//! 1. `voxels`, `bits`: the band of a slab that is in memory, and which of its voxels are above.
//! 2. `runs`: rows of bits become runs of equal voxels, numbered so that the run of a voxel
//!    is a population count away.
//! 3. `label_band`: union-find over the runs of one band; local components with their voxel sums.
//!    `region_edge`: which of them the edge of a region of interest cuts off.
//! 4. `band_boundary`: what a band tells its neighbours; components that are whole in it leave memory.
//! 5. `slab_merge`: bands of a slab and the slab before it are joined to classes; components that can
//!    no longer grow leave memory.
//! 6. `surface_keys`: what numbers surfaces before there is any.
//! 7. `provisional`: which classes are a component of their own in the end, hence the final ids.
//! 8. `cell_rows`: which cell each voxel belongs to, where that is given and cells are parts of components.
//! 9. `kept_rows`: what is kept of a band for meshing, and which of its samples have to be read for that.

mod band_boundary;
mod bits;
mod border_euler;
mod cell_rows;
mod kept_rows;
mod label_band;
mod provisional;
mod read_labels;
mod region_edge;
mod runs;
mod slab_merge;
mod surface_keys;
mod union_find;
mod voxels;

pub use band_boundary::{BandComponents, BandFaces};
pub use bits::Bits;
pub use border_euler::add_border_euler;
pub use cell_rows::{BandCells, CellPiece, CellRows, CellRowsWriter, bytes_of_rows, label_below_0};
pub use kept_rows::{NeededRows, RowKinds, RowStretch};
pub use label_band::{Labels, LocalComponent, label_runs, sum_voxels};
pub use provisional::{ProvisionalLabels, Ranks};
pub use read_labels::LabelSums;
pub use region_edge::{
    InsideBand, for_each_open_face, for_each_region_edge, note_outside, note_region_edge,
};
pub use runs::{RowRuns, Run, Runs};
pub use slab_merge::{BandInput, CarriedComponents, PhaseLabels, SlabComponents};
pub use surface_keys::keys_on_top;
pub use union_find::UnionFind;
pub use voxels::{Span, Voxels};
