//! Porosity of boxes of growing size: from which size on a box stands for the whole.

use super::blocks::Blocks;
use serde::Serialize;

/// Porosity of boxes of one size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BoxPorosity {
    /// Mean length of the sides of the boxes, in the unit of the tables; they differ by a voxel at most.
    pub side: f64,
    /// The mean number of voxels of a box.
    pub voxels: f64,
    /// Porosity of the box in the middle, 0 to 1.
    pub centred: f64,
    /// How many boxes of this size lie side by side, as many as fit; they do not overlap.
    pub boxes: u64,
    /// Their mean porosity.
    pub mean: f64,
    /// Standard deviation of their porosities, by their number less one; absent for a single box.
    pub sd: Option<f64>,
    /// Least porosity of them.
    pub min: f64,
    /// Greatest.
    pub max: f64,
}

/// What each block holds: voxels that count, and pores among them; both with x fastest.
#[derive(Debug)]
pub struct Content<'a> {
    /// The blocks.
    pub blocks: &'a Blocks,
    /// Voxels that count.
    pub all: &'a [i64],
    /// Pores among them.
    pub pores: &'a [i64],
    /// Blocks, lower and upper ends, of the part of the grid in which boxes lie.
    pub within: [[usize; 2]; 3],
    /// Size of a voxel.
    pub spacing: [f64; 3],
}

/// Sums of blocks from the grid's first corner on.
struct Prefix {
    sums: Vec<i64>,
    counts: [usize; 3],
}

impl Prefix {
    fn new(values: &[i64], counts: [usize; 3]) -> Self {
        let [nx, ny, nz] = counts;
        let mut sums = vec![0; (nx + 1) * (ny + 1) * (nz + 1)];
        let at = |x: usize, y: usize, z: usize| x + (nx + 1) * (y + (ny + 1) * z);
        for z in 0..nz {
            for y in 0..ny {
                let mut row = 0;
                for x in 0..nx {
                    row += values[x + nx * (y + ny * z)];
                    let below = sums[at(x + 1, y + 1, z)];
                    let beside = sums[at(x + 1, y, z + 1)] - sums[at(x + 1, y, z)];
                    sums[at(x + 1, y + 1, z + 1)] = row + below + beside;
                }
            }
        }
        Prefix { sums, counts }
    }

    /// The sum of a box of blocks.
    fn sum(&self, start: [usize; 3], width: usize) -> i64 {
        let [nx, ny, _] = self.counts.map(|n| n + 1);
        let mut sum = 0;
        for corner in 0..8usize {
            let ends: [usize; 3] = std::array::from_fn(|a| start[a] + width * (corner >> a & 1));
            let value = self.sums[ends[0] + nx * (ends[1] + ny * ends[2])];
            let minus = (3 - corner.count_ones()) % 2 == 1;
            sum += if minus { -value } else { value };
        }
        sum
    }
}

/// Widths of boxes in blocks: 1, 2, 3, 4, 6, 8, 12, ... and the largest one.
fn widths(most: usize) -> Vec<usize> {
    let mut widths: Vec<usize> = (0..)
        .map(|n| match n {
            0 => 1,
            n if n % 2 == 1 => 2 << (n / 2),
            n => 3 << (n / 2 - 1),
        })
        .take_while(|w| *w < most)
        .collect();
    widths.push(most);
    widths
}

/// The porosity of boxes from a block up to the largest that fits. Boxes in which no voxel counts are none.
///
/// Source: J. Bear, Dynamics of Fluids in Porous Media, Elsevier, 1972, chapter 1 (representative elementary volume).
pub fn porosity_of_boxes(content: &Content) -> Vec<BoxPorosity> {
    let counts = content.blocks.counts();
    let [all, pores] = [content.all, content.pores].map(|v| Prefix::new(v, counts));
    let room = content.within.map(|[from, to]| to.saturating_sub(from));
    let most = room.into_iter().min().unwrap_or(0);
    if most == 0 {
        return Vec::new();
    }
    let of_width = |width| of_width(content, &all, &pores, width);
    widths(most).into_iter().filter_map(of_width).collect()
}

fn of_width(content: &Content, all: &Prefix, pores: &Prefix, width: usize) -> Option<BoxPorosity> {
    let share = |start: [usize; 3]| {
        let voxels = all.sum(start, width);
        (voxels > 0).then(|| pores.sum(start, width) as f64 / voxels as f64)
    };
    let room = content.within.map(|[from, to]| to - from);
    let middle: [usize; 3] = std::array::from_fn(|a| content.within[a][0] + (room[a] - width) / 2);
    let fit = room.map(|n| n / width);
    // boxes side by side, with what is left over on both sides
    let first: [usize; 3] =
        std::array::from_fn(|a| content.within[a][0] + (room[a] - fit[a] * width) / 2);
    let (mut found, mut sum, mut square) = (0u64, 0.0, 0.0);
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    for z in 0..fit[2] {
        for y in 0..fit[1] {
            for x in 0..fit[0] {
                let at = [x, y, z];
                let start = std::array::from_fn(|a| first[a] + at[a] * width);
                let Some(p) = share(start) else { continue };
                found += 1;
                let away = p - sum;
                sum += away / found as f64;
                square += away * (p - sum);
                (min, max) = (f64::min(min, p), f64::max(max, p));
            }
        }
    }
    let length = |a: usize| {
        let end = content.blocks.start(a, middle[a] + width);
        f64::from(end - content.blocks.start(a, middle[a]))
    };
    let lengths = [0, 1, 2].map(length);
    let sides: [f64; 3] = std::array::from_fn(|a| lengths[a] * content.spacing[a]);
    Some(BoxPorosity {
        side: libm::cbrt(sides.iter().product()),
        voxels: lengths.iter().product(),
        centred: share(middle)?,
        boxes: found,
        mean: sum,
        sd: (found > 1).then(|| (square / (found - 1) as f64).max(0.0).sqrt()),
        min,
        max,
    })
}
