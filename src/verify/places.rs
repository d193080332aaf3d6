//! Positions of a piece, a batch at a time: what [`super::piece`] asks of each, without a branch.
//!
//! A batch in which anything is wrong is left to the code that takes positions one by one, which the
//! results of a batch are held against in the tests.
//!
//! Coordinates are asked as they lie, 48 side by side, which finds the vertices' codes as well.

use super::marks::{BITS, STARTS, STEPS};
use super::piece::{Region, Vertex};

/// Positions of a batch.
pub(super) const BATCH: usize = 16;

/// Where the vertices of a batch lie.
pub(super) struct Places {
    pub points: [Vertex; BATCH],
    /// The axes of their lattice edges.
    pub axes: [u8; BATCH],
    /// How many of them the tile is the first to have.
    pub owned: u64,
}

/// Coordinates of a batch, as they lie in memory: each lane keeps to one axis.
type Lanes<T> = [T; 3 * BATCH];

/// Constants that coordinates are compared with, and summands of their vertices' sums, lane by lane.
pub(super) struct Limits {
    lo: Lanes<i32>,
    hi: Lanes<i32>,
    first_owned: Lanes<i32>,
    steps: Lanes<i32>,
    /// The summand of a coordinate that is no whole number of voxels.
    inside: Lanes<i32>,
}

impl Limits {
    pub fn new(region: &Region) -> Self {
        let lanes = |v: [i32; 3]| std::array::from_fn(|i| v[i % 3]);
        let inside = std::array::from_fn(|a| 1 << COUNT | (a as i32) << AXIS | STARTS[a]);
        Limits {
            lo: lanes(region.lo),
            hi: lanes(region.hi),
            first_owned: lanes(region.first_owned()),
            steps: lanes(STEPS),
            inside: lanes(inside),
        }
    }
}

/// The summand of a coordinate that is no whole number of voxels in a vertex's sum, besides its part of the
/// code: one to how many there are, and the axis.
const COUNT: u32 = 8;
const AXIS: u32 = 12;
/// One where a coordinate lies before those that the tile owns.
const FOREIGN: u32 = 16;

/// The places of vertices of a surface, in voxels; `None` unless each lies strictly inside a lattice
/// edge of the region.
///
/// What is asked of coordinates alone is asked of all 48 side by side; each gives a number in which every
/// question has its bits, and the three of a vertex are added up.
#[inline(always)]
pub(super) fn places(positions: &[[f32; 3]; BATCH], limits: &Limits) -> Option<Places> {
    // one more, so that four can be taken of every vertex
    let (mut q, mut parts) = ([0; 3 * BATCH + 1], [0; 3 * BATCH]);
    let mut wrong = [0; 3 * BATCH];
    let all = positions.as_flattened();
    for i in 0..3 * BATCH {
        let scaled = all[i] * 256.0;
        // `as` saturates and maps NaN to 0, so equality also rules out what does not fit
        let c = scaled as i32;
        let beyond = i32::from(c < limits.lo[i]) | i32::from(c > limits.hi[i]);
        wrong[i] = beyond | i32::from(c as f32 != scaled);
        let inside = if c & 255 != 0 { limits.inside[i] } else { 0 };
        let foreign = i32::from(c < limits.first_owned[i]) << FOREIGN;
        parts[i] = ((c >> 8).wrapping_mul(limits.steps[i]) & 63) + foreign + inside;
        q[i] = c;
    }
    if wrong.iter().fold(0, |any, w| any | w) != 0 {
        return None;
    }
    let mut out = Places {
        points: [[0; 4]; BATCH],
        axes: [0; BATCH],
        owned: 0,
    };
    let (mut codes, mut owned) = ([0; BATCH], 0);
    // 0 if each has one
    let mut counts = 0;
    for i in 0..BATCH {
        let sum = parts[3 * i] + parts[3 * i + 1] + parts[3 * i + 2];
        counts |= (sum >> COUNT & 3) ^ 1;
        let axis = sum >> AXIS & 3;
        codes[i] = axis << BITS | sum & 63;
        out.axes[i] = axis as u8;
        owned += i32::from(sum >> FOREIGN == 0);
    }
    out.owned = owned as u64;
    for (i, point) in out.points.iter_mut().enumerate() {
        *point = [q[3 * i], q[3 * i + 1], q[3 * i + 2], q[3 * i + 3]];
        point[3] = codes[i];
    }
    (counts == 0).then_some(out)
}

/// The smallest and the largest coordinates; those of `i32` turned round if there is no point.
#[inline(always)]
pub(super) fn bounds(points: &[Vertex]) -> [[i32; 3]; 2] {
    // eight points side by side: then every lane keeps to one axis
    const LANES: usize = 8 * size_of::<Vertex>() / size_of::<i32>();
    let (mut lo, mut hi) = ([i32::MAX; LANES], [i32::MIN; LANES]);
    let (chunks, rest) = points.as_flattened().as_chunks::<LANES>();
    for chunk in chunks {
        for i in 0..LANES {
            lo[i] = lo[i].min(chunk[i]);
            hi[i] = hi[i].max(chunk[i]);
        }
    }
    for (i, &c) in rest.iter().enumerate() {
        lo[i] = lo[i].min(c);
        hi[i] = hi[i].max(c);
    }
    let lanes = |a: usize| (a..LANES).step_by(4);
    let of = |a: usize| {
        let fold = |(l, h): (i32, i32), i: usize| (l.min(lo[i]), h.max(hi[i]));
        lanes(a).fold((i32::MAX, i32::MIN), fold)
    };
    let all: [(i32, i32); 3] = std::array::from_fn(of);
    [all.map(|b| b.0), all.map(|b| b.1)]
}
