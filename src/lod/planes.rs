//! The planes of a node: where it ends, and where its children meet. All nodes of a level lie in one grid, so whether
//! a vertex lies on a plane of its level is the same for all nodes that have it.

use crate::grid::{LATTICE, Tiling};

/// Bits of a vertex: the lower planes of x, y and z, then the upper ones.
pub type OnPlanes = u8;

/// The planes of a node in lattice steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planes {
    /// The lower ones.
    pub low: [i32; 3],
    /// The upper ones.
    pub high: [i32; 3],
    /// Where children meet; the same as the upper one where there is one child along an axis.
    pub middle: [i32; 3],
    /// Those that are faces of the volume.
    pub faces: OnPlanes,
}

impl Planes {
    /// Of the node at `place` in the grid of a level, whose nodes are 2^`level` macrocubes wide.
    pub fn of(tiling: Tiling, level: u32, place: [u32; 3]) -> Self {
        let at = |a: usize, tile: u64| {
            let cubes = tile * u64::from(tiling.macrocube[a]);
            let end = u64::from(tiling.dims.0[a] - 1);
            (cubes.min(end) * u64::from(LATTICE)) as i32
        };
        let first = |a: usize| u64::from(place[a]) << level;
        let low = std::array::from_fn(|a| at(a, first(a)));
        let high = std::array::from_fn(|a| at(a, first(a) + (1 << level)));
        let middle = std::array::from_fn(|a| at(a, first(a) + (1 << (level - 1))));
        let end: [i32; 3] = std::array::from_fn(|a| at(a, u64::MAX >> 32));
        let mut faces = 0;
        for a in 0..3 {
            faces |= OnPlanes::from(low[a] == 0) << a;
            faces |= OnPlanes::from(high[a] == end[a]) << (3 + a);
        }
        Planes {
            low,
            high,
            middle,
            faces,
        }
    }

    /// Which of the node's own planes a vertex lies on.
    #[inline]
    pub fn bits(&self, p: [i32; 3]) -> OnPlanes {
        let mut bits = 0;
        for a in 0..3 {
            bits |= OnPlanes::from(p[a] == self.low[a]) << a;
            bits |= OnPlanes::from(p[a] == self.high[a]) << (3 + a);
        }
        bits
    }

    /// True for a vertex on a plane of the node or of a child.
    #[inline]
    pub fn is_on_any(&self, p: [i32; 3]) -> bool {
        (0..3).any(|a| p[a] == self.low[a] || p[a] == self.high[a] || p[a] == self.middle[a])
    }

    /// The multiple of `step` next to a value along an axis that lies strictly between the planes; between them or on
    /// them where there is none strictly between.
    pub fn between(&self, axis: usize, value: f64, step: i32) -> i32 {
        let (low, high) = (self.low[axis], self.high[axis]);
        let inner = if high - low >= 2 * step { step } else { 0 };
        let steps = (value / f64::from(step)).round() as i32;
        (steps * step).clamp(low + inner, high - inner)
    }

    /// The next place of whole steps. What lies between planes does not come to lie on one, which others would have to
    /// know; caps lie outside of them.
    pub fn rounded(&self, p: [i32; 3], step: i32) -> [i32; 3] {
        std::array::from_fn(|a| match self.low[a] < p[a] && p[a] < self.high[a] {
            true => self.between(a, f64::from(p[a]), step),
            false => (p[a] + step / 2).div_euclid(step) * step,
        })
    }
}

/// The axis of the plane that a bit stands for.
pub fn axis_of(bit: OnPlanes) -> usize {
    bit.trailing_zeros() as usize % 3
}

/// How many axes have a plane.
pub fn axes(bits: OnPlanes) -> u32 {
    ((bits | bits >> 3) & 7).count_ones()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;

    #[test]
    fn planes_are_those_of_the_level_cut_at_the_volume() {
        let tiling = Tiling {
            dims: Dims([200, 65, 66]),
            macrocube: [32; 3],
        };
        let planes = Planes::of(tiling, 1, [1, 0, 1]);
        assert_eq!(planes.low, [64, 0, 64].map(|v| v * 256));
        assert_eq!(planes.high, [128, 64, 65].map(|v| v * 256));
        assert_eq!(planes.middle, [96, 32, 65].map(|v| v * 256));
        assert_eq!(planes.faces, 0b110_010);
        let bits = planes.bits([64 * 256, 64 * 256, 5]);
        assert_eq!((bits, axes(bits)), (0b010_001, 2));
        assert_eq!(axis_of(0b010_000), 1);
        assert_eq!(planes.between(1, 1e9, 4), 64 * 256 - 4);
        assert_eq!(planes.between(2, -5.0, 256), 64 * 256);
    }
}
