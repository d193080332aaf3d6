//! How many voxels of a set of voxels lie in each slice and each block of the grid, from where its surface crosses.

use super::blocks::{BlockCounts, Blocks};
use super::crossings::Crossing;

/// Sums over crossings of a set of voxels. They are whole numbers, so their order does not show.
///
/// Along a row, a voxel is in the set if the last one is, plus the number of crossings from it on that leave the set,
/// minus that of those that enter it. So each crossing adds to the voxels before it, and sums over slices and blocks follow
/// from sums over crossings.
#[derive(Debug, Clone)]
pub struct Occupied {
    dims: [i64; 3],
    /// Of rows: signs by x, and voxels before crossings, with their signs, by y and by z.
    signs_x: Vec<i64>,
    before_y: Vec<i64>,
    before_z: Vec<i64>,
    /// Of the last plane across x: signs by y, and voxels before crossings by z.
    plane_signs_y: Vec<i64>,
    plane_before_z: Vec<i64>,
    /// Of its last line: signs by z.
    line_signs_z: Vec<i64>,
    blocks: BlockCounts,
}

/// The voxels of a set in each slice across x, y and z, and in each block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Counts {
    /// By the axis that slices lie across.
    pub slices: [Vec<i64>; 3],
    /// By x fastest.
    pub blocks: Vec<i64>,
    /// By z: 1 if the last voxel of the slice is in the set, else 0.
    pub corners: Vec<i64>,
}

impl Occupied {
    /// For a grid of so many voxels, cut to blocks.
    pub fn new(dims: [u32; 3], blocks: &Blocks) -> Self {
        let zeros = |axis: usize| vec![0; dims[axis] as usize];
        Occupied {
            dims: dims.map(i64::from),
            signs_x: zeros(0),
            before_y: zeros(1),
            before_z: zeros(2),
            plane_signs_y: zeros(1),
            plane_before_z: zeros(2),
            line_signs_z: zeros(2),
            blocks: BlockCounts::new(blocks),
        }
    }

    /// Adds a crossing; `leaves` says that the voxel at its lower end is in the set.
    #[inline]
    pub fn add(&mut self, crossing: &Crossing, leaves: bool, blocks: &Blocks) {
        let sign = if leaves { 1 } else { -1 };
        let [x, y, z] = crossing.voxel.map(usize::from);
        match crossing.axis {
            0 => {
                let before = sign * (x as i64 + 1);
                self.signs_x[x] += sign;
                self.before_y[y] += before;
                self.before_z[z] += before;
            }
            1 => {
                self.plane_signs_y[y] += sign;
                self.plane_before_z[z] += sign * (y as i64 + 1);
            }
            _ => self.line_signs_z[z] += sign,
        }
        self.blocks.add(crossing, sign, blocks);
    }

    /// The voxels of a set of `known` voxels; `None` if the crossings are not those of such a set.
    pub fn finish(self, known: u64, blocks: &Blocks) -> Option<Counts> {
        let voxels: i64 = self.dims.iter().product();
        let without: i64 = self.slices(0)[2].iter().sum();
        let last = match i64::try_from(known).ok()? - without {
            0 => 0,
            rest if rest == voxels => 1,
            _ => return None,
        };
        let slices = self.slices(last);
        let possible = |counts: &Vec<i64>, axis: usize| {
            let most = voxels / self.dims[axis];
            counts.iter().all(|n| (0..=most).contains(n))
        };
        if !(0..3).all(|axis| possible(&slices[axis], axis)) {
            return None;
        }
        Some(Counts {
            slices,
            blocks: self.blocks.finish(last, blocks),
            corners: from_the_end(&self.line_signs_z, last),
        })
    }

    /// Voxels by slice, if the grid's last voxel is in the set (1) or not (0).
    fn slices(&self, last: i64) -> [Vec<i64>; 3] {
        let [nx, ny, _] = self.dims;
        let line = from_the_end(&self.line_signs_z, last);
        let in_line: i64 = line.iter().sum();
        let plane_by_z: Vec<i64> = std::iter::zip(&self.plane_before_z, &line)
            .map(|(before, end)| before + ny * end)
            .collect();
        let plane_by_y = from_the_end(&self.plane_signs_y, in_line);
        let in_plane: i64 = plane_by_z.iter().sum();
        let rows = |before: &[i64], ends: &[i64]| -> Vec<i64> {
            std::iter::zip(before, ends)
                .map(|(before, end)| before + nx * end)
                .collect()
        };
        [
            from_the_end(&self.signs_x, in_plane),
            rows(&self.before_y, &plane_by_y),
            rows(&self.before_z, &plane_by_z),
        ]
    }
}

/// Sums from each place to the end, and one more number.
pub fn from_the_end(signs: &[i64], last: i64) -> Vec<i64> {
    let mut sums = signs.to_vec();
    let mut sum = last;
    for value in sums.iter_mut().rev() {
        sum += *value;
        *value = sum;
    }
    sums
}
