//! Distances as integers: what a step along an axis weighs, how far a search reaches, and what is greater.

/// Weight of a step along the finest axis where spacings differ: shares of it are told apart to 3 %.
const FINEST: u32 = 16;

/// A step that weighs as much ends beyond the reach in any case, and products of slopes stay within 64 bits.
const HEAVIEST: u32 = 1 << 22;

/// How distances are counted, in integers: the *level* of a voxel is the least of
/// `wx dx^2 + wy dy^2 + wz dz^2` over all solid voxels, at most [`Metric::cap`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Metric {
    /// Weights of the squared steps along x, y and z; from `unit` on.
    weights: [u32; 3],
    /// The level of one step along the finest axis.
    unit: u32,
    /// Steps along the finest axis from which on distances are not told apart, 1 to 255.
    reach: u8,
}

impl Metric {
    /// The farthest that a search can reach.
    pub const REACH: u8 = u8::MAX;

    /// Weights for steps of 1 along each axis, up to `reach` steps of weight 1.
    ///
    /// # Panics
    /// If a weight or the reach is 0.
    pub fn new(weights: [u32; 3], reach: u8) -> Self {
        Metric::of_unit(weights, 1, reach)
    }

    fn of_unit(weights: [u32; 3], unit: u32, reach: u8) -> Self {
        assert!(unit > 0 && reach > 0 && weights.iter().all(|&w| w >= unit));
        Metric {
            weights: weights.map(|w| w.min(HEAVIEST)),
            unit,
            reach,
        }
    }

    /// The weights of voxels of this size: 1 if they are cubes, otherwise squares of the steps in sixteenths of the
    /// square of the finest one.
    ///
    /// `spacing` is finite and above 0.
    pub fn of_spacing(spacing: [f64; 3], reach: u8) -> Self {
        let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let weights = spacing.map(|s| {
            let ratio = s / finest;
            // conversions from floats end at the largest number
            (f64::from(FINEST) * ratio * ratio).round() as u32
        });
        match weights {
            [FINEST, FINEST, FINEST] => Metric::of_unit([1; 3], 1, reach),
            _ => Metric::of_unit(weights, FINEST, reach),
        }
    }

    /// Weights of the squared steps along x, y and z.
    pub fn weights(&self) -> [u32; 3] {
        self.weights
    }

    /// The levels of one step along x, y and z: weights, as far as distances are told apart.
    pub(super) fn step_levels(&self) -> [u32; 3] {
        self.weights.map(|weight| weight.min(self.cap()))
    }

    /// The level of one step along the finest axis.
    pub fn unit(&self) -> u32 {
        self.unit
    }

    /// Steps along the finest axis from which on distances are not told apart.
    pub fn reach(&self) -> u8 {
        self.reach
    }

    /// The greatest level; below 2^21.
    pub fn cap(&self) -> u32 {
        self.unit * u32::from(self.reach) * u32::from(self.reach)
    }

    /// The radius of a level, in steps along the finest axis.
    pub fn radius(&self, level: u32) -> f64 {
        (f64::from(level) / f64::from(self.unit)).sqrt()
    }

    /// The same in 1/256 of a step, rounded down.
    pub fn radius_256(&self, level: u32) -> u64 {
        ((u64::from(level) << 16) / u64::from(self.unit)).isqrt()
    }

    /// The square root of each level up to the cap, in 1/1024, rounded down: what slopes are made of.
    pub fn roots(&self) -> Vec<u32> {
        // exact: 2^20 times a level is, and roots that are no integers are far enough from these
        let root = |level: u32| (f64::from(level) * f64::from(1 << 20)).sqrt() as u32;
        (0..=self.cap()).map(root).collect()
    }
}

impl Default for Metric {
    fn default() -> Self {
        Metric::new([1; 3], Metric::REACH)
    }
}

/// A voxel by its place in the total order: the greater has the greater level or, of equal ones, the smaller index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Peak {
    /// Its level.
    pub level: u32,
    /// Its linear index.
    pub voxel: u64,
}

impl Ord for Peak {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.level, other.voxel).cmp(&(other.level, self.voxel))
    }
}

impl PartialOrd for Peak {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The highest pass between two basins: a pair of adjacent voxels, one in each. The greater has the greater lower
/// voxel or, of pairs with the same one, the upper voxel with the smaller index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Saddle {
    /// The lower voxel of the pair.
    pub low: Peak,
    /// Linear index of the upper one.
    pub high: u64,
}

impl Ord for Saddle {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let lower = self.low.cmp(&other.low);
        lower.then_with(|| other.high.cmp(&self.high))
    }
}

impl PartialOrd for Saddle {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Saddle {
    /// That of two adjacent voxels.
    #[inline(always)]
    pub fn of(a: Peak, b: Peak) -> Self {
        match a < b {
            true => Saddle {
                low: a,
                high: b.voxel,
            },
            false => Saddle {
                low: b,
                high: a.voxel,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_follow_the_spacing() {
        let of = |spacing| {
            let metric = Metric::of_spacing(spacing, 255);
            (metric.weights(), metric.unit(), metric.cap())
        };
        assert_eq!(of([0.02; 3]), ([1; 3], 1, 65_025));
        assert_eq!(of([0.02, 0.02, 0.0201]), ([1; 3], 1, 65_025));
        assert_eq!(of([2.0, 2.0, 5.0]), ([16, 16, 100], 16, 1_040_400));
        assert_eq!(of([1.0, 1.0, 1e9]).0, [16, 16, 1 << 22]);
        assert_eq!(Metric::of_spacing([3.0, 1.0, 1.0], 255).radius_256(64), 512);
    }

    #[test]
    fn roots_are_exact() {
        let metric = Metric::of_spacing([1.0, 1.0, 2.0], 255);
        for (level, &root) in metric.roots().iter().enumerate() {
            let (level, root) = ((level as u64) << 20, u64::from(root));
            assert!(root * root <= level && level < (root + 1) * (root + 1));
        }
        for level in 0..70_000 {
            let radius = Metric::default().radius_256(level);
            assert!(radius * radius <= u64::from(level) << 16);
            assert!(u64::from(level) << 16 < (radius + 1) * (radius + 1));
        }
    }
}
