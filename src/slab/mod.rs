//! The part of a volume that is in memory: voxels of a band of a slab, and their bits.
//!
//! A *slab* is what one layer of macrocubes needs; a *band* is one row of its macrocubes along y,
//! over the full width of the grid. Neighbouring bands share a row of voxels and neighbouring slabs
//! a slice, so everything about a cube, and every pair of adjacent voxels, lies within one band.

mod bits;
mod voxels;

pub use bits::Bits;
pub use voxels::{Span, Voxels};
