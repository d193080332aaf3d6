//! How a volume is cut into slabs and bands.

use super::distance::Block;
use crate::grid::Dims;
use std::ops::Range;

/// Slabs of slices, each cut into bands of rows: the result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlabGrid {
    /// Size of the volume; axes of one voxel are allowed.
    pub dims: Dims,
    /// The slices that are cut: the first one, and the one behind the last. All, or those of a part of the volume.
    pub slices: [u32; 2],
    /// Slices of a slab, from 1 on; the last one may have fewer.
    pub height: u32,
    /// Rows of a band, likewise.
    pub band: u32,
}

/// Bytes that a block takes for each voxel while it is worked on: steps along z, levels, ways, ends and what is left of
/// them.
const BLOCK_BYTES: u64 = 12;
/// Slices of a slab, where memory allows them.
const HEIGHT: u32 = 64;
/// The least rows of a band and slices of a slab that are worth their surroundings.
const LEAST: u32 = 16;

impl SlabGrid {
    /// Slabs and bands of which `threads` at once take not much more than `memory` bytes, besides what is kept of a
    /// slice.
    pub fn fitting(dims: Dims, memory: u64, threads: usize) -> Self {
        let [nx, ny, nz] = dims.0;
        let voxels = memory / (BLOCK_BYTES * threads.max(1) as u64);
        let bytes = |height: u32, band: u32| u64::from(nx) * u64::from(height) * u64::from(band);
        let mut grid = SlabGrid {
            dims,
            slices: [0, nz],
            height: HEIGHT.min(nz),
            band: ny,
        };
        while bytes(grid.height, grid.band) > voxels && grid.height > LEAST.min(nz) {
            grid.height = grid.height.div_ceil(2);
        }
        while bytes(grid.height, grid.band) > voxels && grid.band > LEAST.min(ny) {
            grid.band = grid.band.div_ceil(2);
        }
        grid
    }

    /// The same of these slices alone.
    pub fn of_slices(self, slices: Range<u32>) -> Self {
        SlabGrid {
            slices: [slices.start, slices.end],
            ..self
        }
    }

    /// Bytes of blocks that no more memory makes larger.
    pub fn most_bytes(dims: Dims, threads: usize) -> u64 {
        let [nx, ny, nz] = dims.0.map(u64::from);
        let slab = nx * ny * nz.min(HEIGHT.into());
        BLOCK_BYTES * (slab * threads.max(1) as u64).min(nx * ny * nz)
    }

    /// Bytes of the smallest block.
    pub fn least_bytes(dims: Dims) -> u64 {
        let [nx, ny, nz] = dims.0.map(u64::from);
        BLOCK_BYTES * nx * ny.min(LEAST.into()) * nz.min(LEAST.into())
    }

    /// Words of the bits of a row.
    pub fn row_words(&self) -> usize {
        (self.dims.0[0] as usize).div_ceil(64)
    }

    /// Number of slabs.
    pub fn slabs(&self) -> u32 {
        let [first, end] = self.slices;
        (end - first).div_ceil(self.height)
    }

    /// Number of bands of a slab.
    pub fn bands(&self) -> u32 {
        self.dims.0[1].div_ceil(self.band)
    }

    /// The slices of a slab.
    pub fn slab(&self, slab: u32) -> Range<u32> {
        let [first, end] = self.slices;
        let start = first + slab * self.height;
        start..(start + self.height).min(end)
    }

    /// The slab of a slice, and the slice's number in it.
    pub(super) fn slab_of(&self, z: u32) -> [u32; 2] {
        let at = z - self.slices[0];
        [at / self.height, at % self.height]
    }

    /// True if slices of the volume lie below these, and above them.
    pub(super) fn goes_on(&self) -> [bool; 2] {
        let [first, end] = self.slices;
        [first > 0, end < self.dims.0[2]]
    }

    /// The rows of a band.
    pub fn rows(&self, band: u32) -> Range<u32> {
        band * self.band..((band + 1) * self.band).min(self.dims.0[1])
    }

    /// All blocks, bands by rising y within slabs by rising z.
    pub(super) fn blocks(self) -> impl Iterator<Item = Block> {
        let of_slab = move |slab| {
            (0..self.bands()).map(move |band| Block {
                slab,
                y: self.rows(band),
                z: self.slab(slab),
            })
        };
        (0..self.slabs()).flat_map(of_slab)
    }

    /// Where a voxel lies, by its linear index.
    pub(super) fn place(&self, voxel: u64) -> Place {
        let [nx, ny, _] = self.dims.0.map(u64::from);
        Place {
            x: (voxel % nx) as u16,
            y: (voxel / nx % ny) as u32,
            z: (voxel / (nx * ny)) as u32,
        }
    }
}

/// Where a voxel lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub x: u16,
    pub y: u32,
    pub z: u32,
}
