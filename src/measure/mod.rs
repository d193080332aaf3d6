//! Sums from which the measures of cells, objects and surfaces follow.

mod sums;

pub use sums::{AreaScale, MeshSums, VoxelSums};
