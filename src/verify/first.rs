//! Where surfaces, cells and objects come first: by that they are numbered.

use super::marks::BITS;
use super::piece::Vertex;
use super::rim::cell_is_low;

/// The first vertex and voxels, by z, then y, then x; the largest number if there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct First {
    /// The first lattice edge with a vertex, by its lower voxel, then its axis.
    pub vertex: u64,
    /// The cell's first voxel at an end of a vertex's lattice edge, as [`voxel_key`]. If it is not the first of
    /// all, that is voxel (0, 0, 0): any other first voxel has another phase before it along some axis.
    pub below: u64,
    /// The same of the object.
    pub above: u64,
}

/// A number for a voxel that rises with z, then y, then x.
#[inline(always)]
pub(super) fn voxel_key([x, y, z]: [i32; 3]) -> u64 {
    (z as u64) << 32 | (y as u64) << 16 | x as u64
}

impl Default for First {
    fn default() -> Self {
        First {
            vertex: u64::MAX,
            below: u64::MAX,
            above: u64::MAX,
        }
    }
}

impl First {
    /// Of vertices whose cell and object begin at these slices at the lowest.
    pub fn of(points: &[Vertex], state: &[u8], slices: [u16; 2]) -> Self {
        let last = i32::from(slices[0].max(slices[1]));
        let mut out = First::default();
        for (&[x, y, z, code], &state) in points.iter().zip(state) {
            // all three come first in one of these slices
            if z >> 8 > last {
                continue;
            }
            let axis = code >> BITS;
            let mut ends = [[x >> 8, y >> 8, z >> 8]; 2];
            ends[1][axis as usize] += 1;
            let [low, high] = ends.map(voxel_key);
            let (below, above) = if cell_is_low(state) {
                (low, high)
            } else {
                (high, low)
            };
            out.add(&First {
                vertex: low << 2 | axis as u64,
                below,
                above,
            });
        }
        out
    }

    pub fn add(&mut self, other: &First) {
        self.vertex = self.vertex.min(other.vertex);
        self.below = self.below.min(other.below);
        self.above = self.above.min(other.above);
    }
}
