//! Connected components of above voxels (objects) and below voxels (cells), out of core.
//!
//! 1. `runs`: rows of bits become runs of equal voxels, numbered so that the run of a voxel
//!    is a population count away.
//! 2. `label`: union-find over the runs of one band; local components with their voxel sums.
//! 3. `band`: what a band tells its neighbours; components that are whole in it leave memory.
//! 4. `classes`: bands of a slab and the slab before it are joined to classes; components that can
//!    no longer grow leave memory.
//! 5. `next`: classes that turn out to be one in the next slab.
//! 6. `births`: which classes are a component of their own in the end, hence the final ids.

mod band;
mod births;
mod border;
mod classes;
mod label;
mod next;
mod runs;
mod unionfind;

pub use band::{BandComponents, BandEdges};
pub use births::{Births, Unfiled};
pub use border::add_border_euler;
pub use classes::{Classes, KnownBand, PhaseBirths, SlabClasses};
pub use label::{Labels, LocalComponent, label_runs, sum_voxels};
pub use next::{Fate, Fates};
pub use runs::{RowRuns, Run, Runs};
