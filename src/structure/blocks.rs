//! Blocks that cover the grid, as nearly cubes as whole voxels allow, and how many voxels of a set each has.

use super::crossings::Crossing;

/// Blocks along the shortest axis of the grid, if it has as many voxels.
const ALONG_SHORTEST: f64 = 32.0;
/// The most blocks: all that is kept of each takes some 90 bytes.
const MOST: f64 = (1u32 << 18) as f64;

/// How blocks cover a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocks {
    /// First voxel of each block along each axis, and the end of the last one.
    starts: [Vec<u32>; 3],
    /// The block of each voxel along each axis.
    of_voxel: [Vec<u32>; 3],
}

impl Blocks {
    /// Those of a grid of so many voxels of these sizes.
    pub fn new(dims: [u32; 3], spacing: [f64; 3]) -> Self {
        let sides: [f64; 3] = std::array::from_fn(|a| f64::from(dims[a]) * spacing[a]);
        let shortest = sides.into_iter().fold(f64::INFINITY, f64::min);
        let coarsest = spacing.into_iter().fold(0.0, f64::max);
        let mut side = (shortest / ALONG_SHORTEST).max(coarsest);
        let count = |side: f64| -> [u32; 3] {
            std::array::from_fn(|a| ((sides[a] / side).round() as u32).clamp(1, dims[a]))
        };
        while count(side).map(f64::from).iter().product::<f64>() > MOST {
            side *= 1.25;
        }
        let counts = count(side);
        let starts: [Vec<u32>; 3] = std::array::from_fn(|a| {
            let n = u64::from(counts[a]);
            let at = |b: u64| (b * u64::from(dims[a]) / n) as u32;
            (0..=n).map(at).collect()
        });
        let of_voxel = std::array::from_fn(|a| {
            let lengths = starts[a].windows(2).map(|w| (w[1] - w[0]) as usize);
            let blocks = lengths.enumerate();
            blocks
                .flat_map(|(b, length)| std::iter::repeat_n(b as u32, length))
                .collect()
        });
        Blocks { starts, of_voxel }
    }

    /// Blocks along each axis.
    pub fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|a| self.starts[a].len() - 1)
    }

    /// The first voxel of block `b` along an axis, or the end of the grid.
    pub fn start(&self, axis: usize, b: usize) -> u32 {
        self.starts[axis][b]
    }

    /// The block of a voxel along an axis.
    pub fn of(&self, axis: usize, voxel: u32) -> usize {
        self.of_voxel[axis][voxel as usize] as usize
    }

    /// The voxels of a block.
    pub fn voxels(&self, block: [usize; 3]) -> i64 {
        (0..3).map(|a| self.length(a, block[a])).product()
    }

    /// The voxels of a block along an axis.
    pub fn length(&self, axis: usize, b: usize) -> i64 {
        i64::from(self.starts[axis][b + 1] - self.starts[axis][b])
    }

    /// The block of a voxel along an axis, and how many of its voxels come up to this one.
    fn place(&self, axis: usize, voxel: u16) -> (usize, i64) {
        let block = self.of_voxel[axis][usize::from(voxel)] as usize;
        let start = self.starts[axis][block];
        (block, i64::from(voxel) + 1 - i64::from(start))
    }
}

/// Signs of crossings and voxels before them inside their block.
#[derive(Debug, Clone, Default)]
struct Sums {
    signs: Vec<i64>,
    before: Vec<i64>,
}

impl Sums {
    fn new(length: usize) -> Self {
        Sums {
            signs: vec![0; length],
            before: vec![0; length],
        }
    }

    fn add(&mut self, at: usize, sign: i64, up_to: i64) {
        self.signs[at] += sign;
        self.before[at] += sign * up_to;
    }
}

/// Sums over the crossings of a set of voxels by block; see [`super::air::Occupied`].
#[derive(Debug, Clone)]
pub struct BlockCounts {
    rows: Sums,
    plane: Sums,
    line: Sums,
}

impl BlockCounts {
    /// For these blocks.
    pub fn new(blocks: &Blocks) -> Self {
        let [bx, by, bz] = blocks.counts();
        BlockCounts {
            rows: Sums::new(bx * by * bz),
            plane: Sums::new(by * bz),
            line: Sums::new(bz),
        }
    }

    /// Adds a crossing with its sign.
    #[inline]
    pub fn add(&mut self, crossing: &Crossing, sign: i64, blocks: &Blocks) {
        let [bx, by, _] = blocks.counts();
        let [x, y, z] = crossing.voxel;
        let block = |axis: usize, voxel: u16| blocks.place(axis, voxel).0;
        match crossing.axis {
            0 => {
                let (at, up_to) = blocks.place(0, x);
                let at = at + bx * (block(1, y) + by * block(2, z));
                self.rows.add(at, sign, up_to);
            }
            1 => {
                let (at, up_to) = blocks.place(1, y);
                self.plane.add(at + by * block(2, z), sign, up_to);
            }
            _ => {
                let (at, up_to) = blocks.place(2, z);
                self.line.add(at, sign, up_to);
            }
        }
    }

    /// Voxels of the set in each block, x fastest, if the grid's last voxel is in it (1) or not (0).
    pub fn finish(&self, last: i64, blocks: &Blocks) -> Vec<i64> {
        let [bx, by, bz] = blocks.counts();
        let mut counts = vec![0; bx * by * bz];
        let mut at_end = last;
        for z in (0..bz).rev() {
            let line = self.line.before[z] + blocks.length(2, z) * at_end;
            at_end += self.line.signs[z];
            let mut ends = line;
            for y in (0..by).rev() {
                let at = y + by * z;
                let plane = self.plane.before[at] + blocks.length(1, y) * ends;
                ends += self.plane.signs[at];
                let mut ends = plane;
                for x in (0..bx).rev() {
                    let at = x + bx * at;
                    counts[at] = self.rows.before[at] + blocks.length(0, x) * ends;
                    ends += self.rows.signs[at];
                }
            }
        }
        counts
    }
}
