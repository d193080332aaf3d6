//! A sample seen from its axis: sums of samples in rings, sectors and slices around it.

use super::axis::Axis;
use super::slices::{SLICES, for_each_row};
use crate::error::Result;
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::f64::consts::TAU;
use std::ops::Range;

/// Sectors of a turn.
pub(super) const SECTORS: usize = 24;
/// Rings inside of the radius at most; wider ones are read from fewer voxels.
const RINGS: f64 = 256.0;

/// Sums of some samples.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, other: Sums) {
        self.n += other.n;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// NaN without samples.
    pub fn mean(&self) -> f64 {
        self.sum / self.n
    }

    /// Their standard deviation; NaN without samples.
    pub fn deviation(&self) -> f64 {
        let mean = self.mean();
        (self.squares / self.n - mean * mean).max(0.0).sqrt()
    }
}

/// What lies around an axis, from ring to ring: sums of all rings before one.
pub(super) struct Profile(Vec<Sums>);

impl Profile {
    /// The means of all rings.
    pub fn means(&self) -> Vec<f64> {
        (1..self.0.len())
            .map(|r| self.of(r - 1..r).mean())
            .collect()
    }

    /// The sums of some rings.
    pub fn of(&self, rings: Range<usize>) -> Sums {
        let [from, to] = [rings.start, rings.end].map(|r| self.0[r.min(self.0.len() - 1)]);
        Sums {
            n: to.n - from.n,
            sum: to.sum - from.sum,
            squares: to.squares - from.squares,
        }
    }
}

/// Samples around an axis, in some slices that are evenly spread.
pub(super) struct Rings {
    /// Voxels from ring to ring.
    pub width: f64,
    /// All rings.
    pub all: usize,
    /// Those slices, without any of one value.
    pub slices: Vec<u32>,
    /// By slice, sector and ring.
    sums: Vec<Sums>,
}

impl Rings {
    /// Reads slices of a range, the first and the last among them, around an axis and up to so many voxels beyond its rim.
    /// Where that is narrower or wider than in the middle of the range, rings are so, too: each is as far from the rim.
    ///
    /// # Errors
    /// The volume's; [`crate::Error::Interrupted`].
    pub fn read<T: Voxel>(
        volume: &dyn Volume,
        range: &Range<u32>,
        axis: &Axis,
        beyond: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let n = SLICES.min(range.len() as u32);
        let last = range.len() as u64 - 1;
        let place = |i: u32| u64::from(i) * last / u64::from(n - 1).max(1);
        let radius = axis.middle(range).radius;
        let width = (radius / RINGS).ceil().max(1.0);
        let mut rings = Rings {
            width,
            all: ((radius + beyond) / width).ceil() as usize,
            slices: Vec::new(),
            sums: Vec::new(),
        };
        progress.begin("rim", n.into());
        for z in (0..n).map(|i| range.start + place(i) as u32) {
            let start = rings.sums.len();
            rings
                .sums
                .resize(start + SECTORS * rings.all, Sums::default());
            let circle = axis.at(z.into());
            let of_slice = Slice {
                middle: circle.centre,
                wider: circle.radius - radius,
                width,
                sums: &mut rings.sums[start..],
            };
            match of_slice.read::<T>(volume, z, progress)? {
                true => rings.slices.push(z),
                false => rings.sums.truncate(start),
            }
            progress.advance(1);
        }
        Ok(rings)
    }

    /// Rings in this many voxels, one at least.
    pub fn count(&self, voxels: f64) -> usize {
        ((voxels / self.width).round() as usize).max(1)
    }

    /// What is seen in some of the slices, by their place in the list, and some sectors.
    pub fn profile(&self, slices: impl Iterator<Item = usize>, sectors: Range<usize>) -> Profile {
        let mut of_ring = vec![Sums::default(); self.all];
        for slice in slices {
            for sector in sectors.clone() {
                let start = (slice * SECTORS + sector) * self.all;
                let sums = &self.sums[start..start + self.all];
                let both = of_ring.iter_mut().zip(sums);
                both.for_each(|(sum, other)| sum.add(*other));
            }
        }
        let mut before = vec![Sums::default()];
        let mut sum = Sums::default();
        for ring in of_ring {
            sum.add(ring);
            before.push(sum);
        }
        Profile(before)
    }
}

/// The rings of one slice, in the making.
struct Slice<'a> {
    middle: [f64; 2],
    /// Voxels that its rim is further out than in the middle of all slices.
    wider: f64,
    width: f64,
    /// By sector and ring.
    sums: &'a mut [Sums],
}

impl Slice<'_> {
    /// False if all samples of the slice are of one value, or none is a number.
    fn read<T: Voxel>(self, volume: &dyn Volume, z: u32, progress: &dyn Progress) -> Result<bool> {
        let rings = self.sums.len() / SECTORS;
        let reach = rings as f64 * self.width + self.wider;
        let mut first = None;
        let mut differ = false;
        for_each_row::<T>(volume, z, progress, |y, row| {
            let numbers = row.iter().filter(|v| v.to_f64().is_finite());
            numbers.for_each(|v| differ |= v != first.get_or_insert(*v));
            let dy = f64::from(y) - self.middle[1];
            if !y.is_multiple_of(self.width as u32) || dy.abs() >= reach {
                return;
            }
            let half = (reach * reach - dy * dy).sqrt();
            let from = (self.middle[0] - half).max(0.0) as usize;
            for (x, v) in row
                .iter()
                .enumerate()
                .skip(from)
                .step_by(self.width as usize)
            {
                let dx = x as f64 - self.middle[0];
                if dx > half {
                    break;
                }
                let ring = ((libm::hypot(dx, dy) - self.wider) / self.width) as usize;
                let v = v.to_f64();
                if ring < rings && v.is_finite() {
                    let turn = libm::atan2(dy, dx) / TAU + 1.0;
                    let sector = (turn * SECTORS as f64) as usize % SECTORS;
                    self.sums[sector * rings + ring].add(Sums {
                        n: 1.0,
                        sum: v,
                        squares: v * v,
                    });
                }
            }
        })?;
        Ok(differ)
    }
}
