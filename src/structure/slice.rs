//! Which voxels of one slice are above, from where the surface crosses its rows.

use super::air::from_the_end;
use super::crossings::Crossing;

/// One slice across z, as bits.
#[derive(Debug, Clone)]
pub struct SliceBits {
    /// The slice.
    pub z: u16,
    /// Voxels along x and y.
    pub size: [u32; 2],
    /// For each row, a bit for each voxel: while it is gathered, whether the surface crosses behind it; in the end,
    /// whether it is above.
    words: Vec<u64>,
    /// Signs of crossings of the last column, by y.
    ends: Vec<i64>,
}

impl SliceBits {
    /// Slice `z` of rows of `size[0]` voxels. Takes a bit for each voxel.
    pub fn new(z: u16, size: [u32; 2]) -> Self {
        let words = size[0].div_ceil(64) as usize * size[1] as usize;
        SliceBits {
            z,
            size,
            words: vec![0; words],
            ends: vec![0; size[1] as usize],
        }
    }

    fn row(&self, y: usize) -> std::ops::Range<usize> {
        let words = self.size[0].div_ceil(64) as usize;
        y * words..(y + 1) * words
    }

    /// Adds a crossing; those of other slices do not count.
    pub fn add(&mut self, crossing: &Crossing) {
        let [x, y, z] = crossing.voxel;
        if z != self.z {
            return;
        }
        let y = usize::from(y);
        match crossing.axis {
            0 => {
                let start = self.row(y).start;
                self.words[start + usize::from(x) / 64] ^= 1 << (x % 64);
            }
            1 => self.ends[y] += if crossing.falls { 1 } else { -1 },
            _ => {}
        }
    }

    /// Makes crossings to voxels, given whether the last voxel of the slice is above (1) or not (0).
    pub fn finish(&mut self, corner: i64) {
        let ends = from_the_end(&self.ends, corner);
        for (y, end) in ends.into_iter().enumerate() {
            let row = self.row(y);
            let row = &mut self.words[row];
            let mut above = end != 0;
            for x in (0..self.size[0] as usize).rev() {
                above ^= row[x / 64] >> (x % 64) & 1 == 1;
                row[x / 64] &= !(1 << (x % 64));
                row[x / 64] |= u64::from(above) << (x % 64);
            }
        }
    }

    /// True if a voxel is above; one beyond the slice is not.
    pub fn above(&self, [x, y]: [u32; 2]) -> bool {
        let inside = x < self.size[0] && y < self.size[1];
        inside && self.words[self.row(y as usize).start + x as usize / 64] >> (x % 64) & 1 == 1
    }
}
