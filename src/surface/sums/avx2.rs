//! With AVX2: a corner is loaded as a vector, and those of eight triangles are put across.

use crate::measure::{AREA_STEPS, AreaScale};
use crate::strip::Triangle;
use crate::surface::sums::{AT_ONCE, STEPS, Sums};
use std::arch::x86_64::*;

/// Triangles at once.
const LANES: usize = 8;

/// Three coordinates of eight vectors.
type Vectors = [__m256; 3];

/// The sums of up to [`AT_ONCE`] triangles.
///
/// # Safety
/// The processor has AVX2, and the vertices' numbers are three for each corner named, and one more.
#[target_feature(enable = "avx2")]
pub unsafe fn sum(faces: &[Triangle], vertices: &[f32], area: &AreaScale) -> Sums<LANES> {
    debug_assert!(faces.len() <= AT_ONCE);
    let mut sums = Halves {
        volume6: [_mm256_setzero_pd(); 2],
        twice_area: [_mm256_setzero_pd(); 2],
        factors: area.factors.map(|factor| _mm256_set1_pd(factor)),
    };
    let (batches, rest) = faces.as_chunks();
    for batch in batches {
        // SAFETY: as promised
        unsafe { sums.add(batch, vertices) };
    }
    if !rest.is_empty() {
        // three times the same corner have neither volume nor area
        let mut batch = [Triangle::default(); LANES];
        batch[..rest.len()].copy_from_slice(rest);
        // SAFETY: as promised
        unsafe { sums.add(&batch, vertices) };
    }
    Sums {
        volume6: numbers(sums.volume6),
        twice_area: numbers(sums.twice_area),
    }
}

/// The numbers of two vectors.
#[target_feature(enable = "avx2")]
fn numbers(halves: [__m256d; 2]) -> [f64; LANES] {
    let mut all = [0.0; LANES];
    for (out, half) in all.as_chunks_mut::<4>().0.iter_mut().zip(halves) {
        // SAFETY: room for four
        unsafe { _mm256_storeu_pd(out.as_mut_ptr(), half) };
    }
    all
}

/// [`Sums`] of the first and the last four of eight.
struct Halves {
    volume6: [__m256d; 2],
    twice_area: [__m256d; 2],
    /// See [`AreaScale`].
    factors: [__m256d; 3],
}

impl Halves {
    /// # Safety
    /// As for [`sum`].
    #[target_feature(enable = "avx2")]
    unsafe fn add(&mut self, faces: &[Triangle; LANES], vertices: &[f32]) {
        let corner = |k: usize| {
            let corners = std::array::from_fn(|i| faces[i].corners()[k]);
            // SAFETY: as promised
            unsafe { load(vertices, corners) }
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let n = cross(minus(b, a), minus(c, a));
        for half in 0..2 {
            let (a, n) = (wide(a, half), wide(n, half));
            // a . (b x c) = a . ((b - a) x (c - a))
            self.volume6[half] = _mm256_add_pd(self.volume6[half], dot(a, n));
            let [x, y, z] = n;
            let [fx, fy, fz] = self.factors;
            let n = [
                _mm256_mul_pd(x, fx),
                _mm256_mul_pd(y, fy),
                _mm256_mul_pd(z, fz),
            ];
            let twice = round_area(_mm256_sqrt_pd(dot(n, n)));
            self.twice_area[half] = _mm256_add_pd(self.twice_area[half], twice);
        }
    }
}

/// The positions of eight vertices.
///
/// # Safety
/// As for [`sum`].
#[target_feature(enable = "avx2")]
unsafe fn load(vertices: &[f32], corners: [u32; LANES]) -> Vectors {
    let one = |i: usize| {
        let at = 3 * corners[i] as usize;
        debug_assert!(at + 4 <= vertices.len());
        // SAFETY: the three numbers of a vertex, and one behind them
        unsafe { _mm_loadu_ps(vertices.as_ptr().add(at)) }
    };
    let pair = |i: usize| _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(one(i)), one(i + 4));
    let (p, q, r, s) = (pair(0), pair(1), pair(2), pair(3));
    let (xy_pq, xy_rs) = (_mm256_unpacklo_ps(p, q), _mm256_unpacklo_ps(r, s));
    let (z_pq, z_rs) = (_mm256_unpackhi_ps(p, q), _mm256_unpackhi_ps(r, s));
    [
        _mm256_shuffle_ps::<0b01_00_01_00>(xy_pq, xy_rs),
        _mm256_shuffle_ps::<0b11_10_11_10>(xy_pq, xy_rs),
        _mm256_shuffle_ps::<0b01_00_01_00>(z_pq, z_rs),
    ]
}

#[target_feature(enable = "avx2")]
fn minus([ax, ay, az]: Vectors, [bx, by, bz]: Vectors) -> Vectors {
    [
        _mm256_sub_ps(ax, bx),
        _mm256_sub_ps(ay, by),
        _mm256_sub_ps(az, bz),
    ]
}

#[target_feature(enable = "avx2")]
fn cross(u: Vectors, v: Vectors) -> Vectors {
    let component =
        |l: usize, m: usize| _mm256_sub_ps(_mm256_mul_ps(u[l], v[m]), _mm256_mul_ps(u[m], v[l]));
    [component(1, 2), component(2, 0), component(0, 1)]
}

/// The first or the last four of them.
#[target_feature(enable = "avx2")]
fn wide(v: Vectors, half: usize) -> [__m256d; 3] {
    v.map(|v| match half {
        0 => _mm256_cvtps_pd(_mm256_castps256_ps128(v)),
        _ => _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(v)),
    })
}

#[target_feature(enable = "avx2")]
fn dot(a: [__m256d; 3], b: [__m256d; 3]) -> __m256d {
    let product = |k: usize| _mm256_mul_pd(a[k], b[k]);
    _mm256_add_pd(_mm256_add_pd(product(0), product(1)), product(2))
}

/// Lengths of area vectors, in squared voxels, as [`AreaScale::twice_area`] rounds them.
#[target_feature(enable = "avx2")]
fn round_area(lengths: __m256d) -> __m256d {
    let steps = _mm256_mul_pd(lengths, _mm256_set1_pd(STEPS * STEPS * AREA_STEPS));
    _mm256_floor_pd(_mm256_add_pd(steps, _mm256_set1_pd(0.5)))
}
