//! Volume, area and bounds of the surface pieces, many triangles at a time: corners are gathered one by
//! one, arithmetic runs over arrays.
//!
//! Instructions per triangle, compiled for AVX2: 74 for sums one at a time, without bounds; 51 so, with them;
//! 40 without checks of the corners. One triangle at a time with its coordinates as a vector took longer.

use crate::cpu::dispatch;
use crate::grid::LATTICE;
use crate::measure::AreaScale;
use crate::mesh::pieces::Piece;
use crate::strip::Triangle;
use crate::unchecked::Unchecked;

/// Triangles or positions at once. With eight, compilers keep the gathered corners in registers, and the
/// arithmetic on them one by one.
const LANES: usize = 32;

/// Lattice steps per voxel.
const STEPS: f32 = LATTICE as f32;

/// One value for each of them.
type Lanes<T> = [T; LANES];

/// Triangles whose sums are exact: six times a triangle's volume is below 2^43, twice its area in
/// fixed-point steps below 2^36, and floating-point numbers hold all whole numbers up to 2^53.
const AT_ONCE: usize = LANES << 9;

/// Adds up volume and area of each piece's triangles, and finds its bounds; `positions` and `triangles` are
/// those of the whole tile.
pub fn sum_pieces(
    pieces: &mut [Piece],
    positions: &[[f32; 3]],
    triangles: &[Triangle],
    area: &AreaScale,
) {
    dispatch!(sum_inlined(pieces, positions, triangles, area));
}

#[inline(always)]
fn sum_inlined(
    pieces: &mut [Piece],
    positions: &[[f32; 3]],
    triangles: &[Triangle],
    area: &AreaScale,
) {
    for piece in pieces {
        let vertices = &positions[piece.first_vertex as usize..][..piece.vertices as usize];
        // SAFETY: corners are vertices of their piece, and a piece with triangles has some
        let places = unsafe { Unchecked::new(vertices) };
        let (mut volume6, mut twice_area) = (0, 0);
        for faces in triangles[piece.faces()][1..].chunks(AT_ONCE) {
            let mut sums = Sums::default();
            let (batches, rest) = faces.as_chunks();
            for batch in batches {
                sums.add(batch, places, area);
            }
            if !rest.is_empty() {
                // three times the same corner have neither volume nor area
                let mut batch = [Triangle::default(); LANES];
                batch[..rest.len()].copy_from_slice(rest);
                sums.add(&batch, places, area);
            }
            volume6 += sums
                .volume6
                .iter()
                .map(|&v| (v * f64::from(STEPS)) as i128)
                .sum::<i128>();
            twice_area += sums.twice_area.iter().map(|&a| a as u128).sum::<u128>();
        }
        (piece.min, piece.max) = bounds(vertices);
        piece.sums.volume6 = volume6;
        piece.sums.area = twice_area;
        piece.sums.triangles = u64::from(piece.triangles);
    }
}

#[inline(always)]
fn widen(min: &mut Lanes<[f32; 3]>, max: &mut Lanes<[f32; 3]>, positions: &[[f32; 3]]) {
    let (min, max) = (min.as_flattened_mut(), max.as_flattened_mut());
    for ((min, max), &v) in min.iter_mut().zip(max).zip(positions.as_flattened()) {
        // no number is NaN
        *min = if v < *min { v } else { *min };
        *max = if v > *max { v } else { *max };
    }
}

/// Smallest and largest coordinates in lattice steps; `i32::MAX` and `i32::MIN` of none.
#[inline(always)]
fn bounds(positions: &[[f32; 3]]) -> ([i32; 3], [i32; 3]) {
    let mut min = [[f32::INFINITY; 3]; LANES];
    let mut max = [[f32::NEG_INFINITY; 3]; LANES];
    let (batches, rest) = positions.as_chunks::<LANES>();
    for batch in batches {
        widen(&mut min, &mut max, batch);
    }
    widen(&mut min, &mut max, rest);
    let fold = |all: [[f32; 3]; LANES], pick: fn(f32, f32) -> f32| {
        let one = all
            .into_iter()
            .reduce(|a, b| [pick(a[0], b[0]), pick(a[1], b[1]), pick(a[2], b[2])]);
        one.unwrap_or_default().map(|v| (v * LATTICE as f32) as i32)
    };
    (fold(min, f32::min), fold(max, f32::max))
}

/// Sums by the triangles' places in their batches, exact: areas are whole numbers, and volumes, in voxels times
/// squared lattice steps, multiples of 1/256.
///
/// Differences of corners and area vectors are exact, too, since the corners of a triangle are a voxel apart at
/// most, and 32-bit floating-point numbers have 24 bits.
#[derive(Default)]
struct Sums {
    volume6: Lanes<f64>,
    twice_area: Lanes<f64>,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, faces: &Lanes<Triangle>, vertices: Unchecked<[f32; 3]>, area: &AreaScale) {
        let [mut a, mut b, mut c] = [[[0.0; LANES]; 3]; 3];
        for (i, face) in faces.iter().enumerate() {
            let [p, q, r] = face.corners();
            for (corner, vertex) in [(&mut a, p), (&mut b, q), (&mut c, r)] {
                let [x, y, z] = vertices.at(vertex as usize);
                (corner[0][i], corner[1][i], corner[2][i]) = (x, y, z);
            }
        }
        let [mut u, mut v, mut n] = [[[0.0; LANES]; 3]; 3];
        for k in 0..3 {
            for i in 0..LANES {
                u[k][i] = b[k][i] - a[k][i];
                v[k][i] = c[k][i] - a[k][i];
            }
        }
        for k in 0..3 {
            let (l, m) = ((k + 1) % 3, (k + 2) % 3);
            for i in 0..LANES {
                n[k][i] = (u[l][i] * v[m][i] - u[m][i] * v[l][i]) * (STEPS * STEPS);
            }
        }
        for i in 0..LANES {
            // a . (b x c) = a . ((b - a) x (c - a))
            let product = |k: usize| f64::from(a[k][i]) * f64::from(n[k][i]);
            self.volume6[i] += product(0) + product(1) + product(2);
        }
        for i in 0..LANES {
            self.twice_area[i] += area.twice_area([n[0][i], n[1][i], n[2][i]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::coordinate;
    use proptest::prelude::*;

    proptest! {
        /// Against one triangle after the other, in whole numbers.
        #[test]
        fn sums_are_those_of_each_triangle(
            positions in prop::collection::vec([-40_000..16_777_216i32, 0..300, 7_000..7_300], 3..50),
            picks in prop::collection::vec(any::<[prop::sample::Index; 3]>(), 0..60),
            spacing in [0.1..10.0f64, 0.1..10.0, 0.1..10.0],
        ) {
            // as close together as the corners of a cube are
            let positions: Vec<[i32; 3]> = positions
                .iter()
                .map(|p| [positions[0][0] + (p[0] & 0x1ff), p[1], p[2]])
                .collect();
            let voxels: Vec<_> = positions.iter().map(|p| p.map(coordinate)).collect();
            let (first, skipped) = (1, 5);
            let mut piece = Piece::new(0, 0, false);
            piece.first_vertex = first as u32;
            piece.vertices = (positions.len() - first) as u32;
            piece.first_triangle = skipped as u32;
            piece.triangles = picks.len() as u32;
            let none = [u32::MAX; 3];
            let mut triangles = vec![Triangle::new(none, none); skipped + 1];
            triangles.extend(picks.iter().map(|p| {
                let [a, b, c] = p.map(|i| i.index(positions.len() - first) as u32);
                Triangle::new([a, b, c], none)
            }));
            let area = AreaScale::new(spacing);
            sum_pieces(std::slice::from_mut(&mut piece), &voxels, &triangles, &area);
            let (mut volume6, mut twice_area) = (0i128, 0u128);
            for triangle in &triangles[skipped + 1..] {
                let [a, b, c] = triangle.corners().map(|i| glam::I64Vec3::from(positions[first + i as usize].map(i64::from)));
                volume6 += i128::from(a.dot(b.cross(c)));
                let n = (b - a).cross(c - a).to_array().map(|v| v as f32);
                twice_area += area.twice_area(n) as u128;
            }
            prop_assert_eq!(piece.sums.volume6, volume6);
            prop_assert_eq!(piece.sums.area, twice_area);
            prop_assert_eq!(piece.sums.triangles, picks.len() as u64);
        }
    }

    #[test]
    fn areas_are_rounded_to_steps() {
        let area = AreaScale::new([1.0, 1.0, 1.0]);
        assert_eq!(area.twice_area([0.0, 0.0, 0.0]), 0.0);
        assert_eq!(area.twice_area([3.0, 4.0, 0.0]), 5.0 * 65_536.0);
        for n in [
            [1.0, 1.0, 0.0],
            [1.0, 2.0, 3.0],
            [131_072.0, -131_072.0, 77.0],
            [0.0, -1.0, 1.0],
        ] {
            let exact = n.map(f64::from).iter().map(|v| v * v).sum::<f64>().sqrt() * 65_536.0;
            assert_eq!(area.twice_area(n), (exact + 0.5) as i64 as f64);
        }
    }
}
