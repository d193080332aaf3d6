//! Measures of cells, objects and surfaces.
//!
//! While the volume streams by, every component carries integer sums over its voxels
//! ([`VoxelSums`]) and every surface integer sums over its triangles ([`MeshSums`]). What users read
//! follows from them at the end ([`Measures`]).

mod columns;
mod component;
mod eigen;
mod in_tiles;
mod sums;
mod table;

pub use columns::{
    CARRIED, CARRIED_COLUMNS, COMPONENT_COLUMNS, Column, Field, Get, MEASURES, MoreOfCell,
    NECK_COLUMNS, NeckRow, SURFACE_COLUMNS, SurfaceRow, WALL_COLUMNS, WallRow, more_columns,
};
pub use component::{ComponentRecord, Measures, SurfaceRecord};
pub use eigen::eigen_symmetric;
pub use in_tiles::Measured;
pub use sums::{AREA_STEPS, AreaScale, MeshSums, Row, VoxelSums, power_sums};
pub use table::RecordTable;
