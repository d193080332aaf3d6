//! Filters before the threshold, each a volume around a volume: a voxel is made of those within a radius of it.
//!
//! Its value depends on the volume alone, to the last bit: not on the box that is asked for, nor on what was read
//! before. Beyond the edges of the volume lie copies of its outermost voxels (`nearest` in `scipy.ndimage`).

mod gaussian_kernel;
pub(crate) mod median;
mod median_network;
mod neighbourhood;
mod ordered;
pub(crate) mod smooth;
#[cfg(test)]
mod tests;
