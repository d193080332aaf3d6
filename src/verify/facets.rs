//! Triangles of a piece, a batch at a time: what [`super::piece`] asks of each, without a branch.
//!
//! The corners of a batch lie in memory by coordinate, so that everything but fetching them is done
//! for eight triangles at once. A batch that holds a triangle with a flaw is left to the code that
//! takes them one by one, which the results of a batch are held against in the tests.
//!
//! Corners are fetched as vectors and put across, with AVX2 spelled out.

#[cfg(target_arch = "x86_64")]
mod avx2;

use super::marks::{BITS, mark};
use super::piece::{Region, Vertex};

/// Triangles of a batch.
pub(super) const BATCH: usize = 16;

type Lanes<T> = [T; BATCH];

/// The sums that a batch adds to a piece.
pub(super) struct Facets {
    /// Twice the physical area of each triangle.
    pub areas: Lanes<f64>,
    /// Six times the volume that all of them span with the origin.
    pub volume6: i64,
    /// The words of each triangle on its corners and their edges, see [`super::marks`].
    pub marks: [Lanes<u64>; 3],
    /// Below 0 for triangles that touch or cross the planes of the region's faces.
    pub rim: Lanes<i32>,
}

/// The sums over a batch, or `None` if a triangle does not lie in one cube or has no area.
///
/// `scale` turns the components of an area vector into twice the physical area. Coordinates are below
/// 2^25 by amount and components of area vectors are below 2^18, so that a volume is below 2^45 and
/// their sum below 2^49.
#[inline(always)]
pub(super) fn facets(
    points: &[Vertex],
    triangles: &[[u32; 3]; BATCH],
    scale: [f64; 3],
    region: &Region,
) -> Option<Facets> {
    let [p, q, r] = corners(points, triangles);
    // below 0 where the largest coordinate lies beyond the cube of the smallest
    let (mut beyond, mut rim) = ([0; BATCH], [0; BATCH]);
    let (mut e, mut f) = ([[0; BATCH]; 3], [[0; BATCH]; 3]);
    for a in 0..3 {
        for i in 0..BATCH {
            let (p, q, r) = (p[a][i], q[a][i], r[a][i]);
            let (min, max) = (p.min(q).min(r), p.max(q).max(r));
            beyond[i] |= (min & !255) + 256 - max;
            rim[i] |= (min - region.lo[a] - 1) | (region.hi[a] - 1 - max);
            e[a][i] = q - p;
            f[a][i] = r - p;
        }
    }
    if beyond.iter().fold(0, |all, b| all | b) < 0 {
        return None;
    }
    let (mut flat, mut squares) = ([0; BATCH], [0.0; BATCH]);
    let (mut normal, mut volumes) = ([[0; BATCH]; 3], [0; BATCH]);
    for a in 0..3 {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        for i in 0..BATCH {
            let n: i32 = e[b][i] * f[c][i] - e[c][i] * f[b][i];
            flat[i] |= n;
            normal[a][i] = n;
            volumes[i] += i64::from(p[a][i]) * i64::from(n);
            let x = f64::from(n) * scale[a];
            squares[i] += x * x;
        }
    }
    if flat.iter().fold(false, |any, &n| any | (n == 0)) {
        return None;
    }
    let codes = [p[3], q[3], r[3]];
    let mut all = [[0; BATCH]; 3];
    for k in 0..3 {
        let [own, next, last] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| codes[k]);
        for i in 0..BATCH {
            let along = match own[i] >> BITS {
                0 => normal[0][i],
                1 => normal[1][i],
                _ => normal[2][i],
            };
            all[k][i] = mark(own[i], next[i], last[i], along);
        }
    }
    Some(Facets {
        areas: squares.map(f64::sqrt),
        volume6: volumes.iter().sum(),
        marks: all,
        rim,
    })
}

/// The corners of a batch by coordinate: the first ones of all triangles, the second, the third.
type Corners = [[Lanes<i32>; 4]; 3];

/// Fetches the corners of a batch.
///
/// # Panics
/// If a corner is no point.
#[inline(always)]
fn corners(points: &[Vertex], triangles: &[[u32; 3]; BATCH]) -> Corners {
    let largest = triangles.as_flattened().iter().fold(0, |a, &b| a.max(b));
    assert!((largest as usize) < points.len(), "corners are points");
    #[cfg(target_arch = "x86_64")]
    if crate::sys::simd::is_fast() {
        // SAFETY: the processor has AVX2, and corners are points
        return unsafe { avx2::corners(points, triangles) };
    }
    plain_corners(points, triangles)
}

/// The same on any processor.
#[inline(always)]
fn plain_corners(points: &[Vertex], triangles: &[[u32; 3]; BATCH]) -> Corners {
    // fetched by two and taken apart side by side: it takes half the instructions
    let mut pairs = [[[0; BATCH]; 2]; 3];
    for (i, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            let [x, y, z, code] = points[t[k] as usize].map(|c| u64::from(c as u32));
            pairs[k][0][i] = x | y << 32;
            pairs[k][1][i] = z | code << 32;
        }
    }
    let mut lanes = [[[0; BATCH]; 4]; 3];
    for k in 0..3 {
        for a in 0..4 {
            for i in 0..BATCH {
                lanes[k][a][i] = (pairs[k][a / 2][i] >> (32 * (a % 2))) as i32;
            }
        }
    }
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn corners_are_those_points(
            points in prop::collection::vec(any::<Vertex>(), 1..40),
            picks in any::<[[prop::sample::Index; 3]; BATCH]>(),
        ) {
            let triangles = picks.map(|t| t.map(|i| i.index(points.len()) as u32));
            for found in [corners(&points, &triangles), plain_corners(&points, &triangles)] {
                for (i, t) in triangles.iter().enumerate() {
                    let own = found.map(|corner| corner.map(|lanes| lanes[i]));
                    prop_assert_eq!(own, t.map(|v| points[v as usize]));
                }
            }
        }
    }

    #[test]
    #[should_panic = "corners are points"]
    fn a_corner_that_is_no_point_is_not_fetched() {
        let mut triangles = [[0, 1, 2]; BATCH];
        triangles[BATCH - 1][1] = 3;
        corners(&[[0; 4]; 3], &triangles);
    }
}
