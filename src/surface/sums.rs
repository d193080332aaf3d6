//! Volume, area and bounds of the surface pieces, many triangles at a time.
//!
//! With AVX2 spelled out, corners are loaded as vectors and put across.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod plain;

use crate::grid::LATTICE;
use crate::measure::AreaScale;
use crate::strip::Triangle;
use crate::surface::assign_pieces::Piece;
use crate::sys::simd::dispatch;

/// Lattice steps per voxel.
const STEPS: f64 = LATTICE as f64;

/// Triangles that are added up in floating-point numbers before these are added up as integers. Each number gets
/// one in eight of them at most, 512, and stays exact: six times a triangle's volume is below 2^43 cubed lattice
/// steps, twice its area in fixed-point steps below 2^36, and 64 bits hold all whole numbers up to 2^53.
const AT_ONCE: usize = 8 << 9;

/// Sums by the triangles' places in batches of them, exact: multiples of 2^-24 and whole numbers.
///
/// Differences of corners and area vectors are exact, too, since the corners of a triangle are a voxel apart at
/// most, and 32-bit floating-point numbers have 24 bits.
struct Sums<const LANES: usize> {
    /// Six times the volume, in voxels.
    volume6: [f64; LANES],
    /// See [`AreaScale::twice_area`].
    twice_area: [f64; LANES],
}

impl<const LANES: usize> Sums<LANES> {
    /// In cubed lattice steps, and steps of area.
    fn total(&self) -> (i128, u128) {
        let volume6 = self.volume6.map(|v| (v * (STEPS * STEPS * STEPS)) as i128);
        let twice_area = self.twice_area.map(|a| a as u128);
        (volume6.iter().sum(), twice_area.iter().sum())
    }
}

/// Adds up volume and area of each piece's triangles, and finds its bounds. `triangles` are those of the whole
/// tile, and so are `coordinates`: of each vertex three, in voxels, and at least one number more.
pub fn sum_pieces(
    pieces: &mut [Piece],
    coordinates: &[f32],
    triangles: &[Triangle],
    area: &AreaScale,
) {
    for piece in pieces {
        let first = 3 * piece.first_vertex as usize;
        let vertices = &coordinates[first..][..3 * piece.vertices as usize + 1];
        let (mut volume6, mut twice_area) = (0, 0);
        for faces in triangles[piece.faces()][1..].chunks(AT_ONCE) {
            // SAFETY: corners are vertices of their piece, and a piece with triangles has some
            let (volume, twice) = unsafe { sum(faces, vertices, area) };
            volume6 += volume;
            twice_area += twice;
        }
        (piece.min, piece.max) = bounds(vertices.as_chunks().0);
        piece.sums.volume6 = volume6;
        piece.sums.area = twice_area;
        piece.sums.triangles = u64::from(piece.triangles);
    }
}

/// Six times the volume and twice the area of up to [`AT_ONCE`] triangles.
///
/// # Safety
/// Their corners are below a third of the vertices' numbers, of which there is one more than thrice as many.
unsafe fn sum(faces: &[Triangle], vertices: &[f32], area: &AreaScale) -> (i128, u128) {
    #[cfg(target_arch = "x86_64")]
    if crate::sys::simd::is_fast() {
        // SAFETY: the processor has AVX2; the rest as promised
        return unsafe { avx2::sum(faces, vertices, area) }.total();
    }
    // SAFETY: as promised
    unsafe { plain::sum(faces, vertices, area) }.total()
}

/// Smallest and largest coordinates in lattice steps; `i32::MAX` and `i32::MIN` of none.
fn bounds(positions: &[[f32; 3]]) -> ([i32; 3], [i32; 3]) {
    dispatch!(bounds_inlined(positions))
}

/// Positions whose bounds are found at once: with eight, these stay in registers.
const AT_A_TIME: usize = 8;

#[inline(always)]
fn bounds_inlined(positions: &[[f32; 3]]) -> ([i32; 3], [i32; 3]) {
    let mut min = [[f32::INFINITY; 3]; AT_A_TIME];
    let mut max = [[f32::NEG_INFINITY; 3]; AT_A_TIME];
    let (batches, rest) = positions.as_chunks::<AT_A_TIME>();
    for batch in batches {
        widen(&mut min, &mut max, batch);
    }
    widen(&mut min, &mut max, rest);
    let fold = |all: [[f32; 3]; AT_A_TIME], pick: fn(f32, f32) -> f32| {
        let one = all
            .into_iter()
            .reduce(|a, b| [pick(a[0], b[0]), pick(a[1], b[1]), pick(a[2], b[2])]);
        one.unwrap_or_default().map(|v| (v * LATTICE as f32) as i32)
    };
    (fold(min, f32::min), fold(max, f32::max))
}

#[inline(always)]
fn widen(min: &mut [[f32; 3]; AT_A_TIME], max: &mut [[f32; 3]; AT_A_TIME], positions: &[[f32; 3]]) {
    let (min, max) = (min.as_flattened_mut(), max.as_flattened_mut());
    for ((min, max), &v) in min.iter_mut().zip(max).zip(positions.as_flattened()) {
        // no number is NaN
        *min = if v < *min { v } else { *min };
        *max = if v > *max { v } else { *max };
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
            let mut piece = Piece::new(0, 0);
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
            let mut coordinates = voxels.as_flattened().to_vec();
            coordinates.push(f32::NAN);
            sum_pieces(std::slice::from_mut(&mut piece), &coordinates, &triangles, &area);
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
            let faces = &triangles[skipped + 1..];
            // SAFETY: the corners are some of these vertices
            let plain = unsafe { plain::sum(faces, &coordinates[3 * first..], &area) };
            prop_assert_eq!(plain.total(), (volume6, twice_area));
            let [min, max] = [i64::min, i64::max].map(|pick: fn(i64, i64) -> i64| {
                let all = positions[first..].iter().map(|p| p.map(i64::from));
                all.reduce(|a, b| [0, 1, 2].map(|k| pick(a[k], b[k]))).unwrap()
            });
            prop_assert_eq!((piece.min.map(i64::from), piece.max.map(i64::from)), (min, max));
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
