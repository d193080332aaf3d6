//! How far voxels reach along the axes of the world where these are not those of the grid.

use super::Placement;
use bytemuck::{Pod, Zeroable};

/// The lower and upper ends, along the world's axes, of voxels' centres that were added. They do not depend on the
/// order of adding: ends are kept as whole numbers that are ordered as the coordinates are.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Extent {
    low: [i64; 3],
    high: [i64; 3],
}

impl Default for Extent {
    fn default() -> Self {
        Extent {
            low: [i64::MAX; 3],
            high: [i64::MIN; 3],
        }
    }
}

/// A whole number that is ordered as numbers are by [`f64::total_cmp`]; its own inverse on the bits.
fn ordered(bits: i64) -> i64 {
    bits ^ ((bits >> 63) as u64 >> 1) as i64
}

impl Extent {
    /// Adds the centre of a voxel, given by its step from voxel (0, 0, 0), see [`Placement::step`].
    #[inline]
    pub fn add(&mut self, step: [f64; 3]) {
        let at = step.map(|v| ordered(v.to_bits() as i64));
        for r in 0..3 {
            self.low[r] = self.low[r].min(at[r]);
            self.high[r] = self.high[r].max(at[r]);
        }
    }

    /// Adds the ends of other voxels.
    #[inline]
    pub fn merge(&mut self, other: &Extent) {
        for r in 0..3 {
            self.low[r] = self.low[r].min(other.low[r]);
            self.high[r] = self.high[r].max(other.high[r]);
        }
    }

    /// The box in world coordinates, lower and upper ends: exactly those of the voxels' centres as
    /// [`Placement::world`] has them. Without any voxel the numbers mean nothing.
    pub fn world(&self, place: &Placement) -> [[f64; 3]; 2] {
        [self.low, self.high].map(|end| {
            std::array::from_fn(|r| place.origin[r] + f64::from_bits(ordered(end[r]) as u64))
        })
    }

    /// As words.
    pub fn words(&self) -> [u64; 6] {
        bytemuck::cast(*self)
    }

    /// What [`Extent::words`] made.
    pub fn from_words(words: [u64; 6]) -> Self {
        bytemuck::cast(words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ends_are_those_of_the_points(
            steps in prop::collection::vec(prop::array::uniform3(-1e3..1e3f64), 1..20), cut in 0..20usize,
        ) {
            let place = Placement { origin: [7.5, -3.0, 1e3], ..Placement::default() };
            let mut parts = [Extent::default(); 2];
            for (i, step) in steps.iter().enumerate() {
                parts[usize::from(i < cut)].add(*step);
            }
            let [mut all, other] = parts;
            all.merge(&other);
            let found = Extent::from_words(all.words()).world(&place);
            for r in 0..3 {
                let along = steps.iter().map(|s| place.origin[r] + s[r]);
                prop_assert_eq!(found[0][r], along.clone().fold(f64::INFINITY, f64::min));
                prop_assert_eq!(found[1][r], along.fold(f64::NEG_INFINITY, f64::max));
            }
        }
    }
}
