//! Corners fetched as vectors and put across, with AVX2.

use super::{BATCH, Corners, Vertex};
use std::arch::x86_64::*;

/// Corners that are put across at once.
const AT_ONCE: usize = 8;

/// The corners of a batch by coordinate.
///
/// # Safety
/// The processor has AVX2, and all corners are points.
#[target_feature(enable = "avx2")]
#[inline]
pub unsafe fn corners(points: &[Vertex], triangles: &[[u32; 3]; BATCH]) -> Corners {
    let mut out = [[[0; BATCH]; 4]; 3];
    for (k, out) in out.iter_mut().enumerate() {
        for first in (0..BATCH).step_by(AT_ONCE) {
            let one = |i: usize| {
                let corner = triangles[first + i][k] as usize;
                debug_assert!(corner < points.len());
                // SAFETY: the corner is a point, of four numbers
                unsafe { _mm_loadu_si128(points.as_ptr().add(corner).cast()) }
            };
            let pair =
                |i: usize| _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(one(i)), one(i + 4));
            let (p, q, r, s) = (pair(0), pair(1), pair(2), pair(3));
            let (xy_pq, xy_rs) = (_mm256_unpacklo_epi32(p, q), _mm256_unpacklo_epi32(r, s));
            let (zc_pq, zc_rs) = (_mm256_unpackhi_epi32(p, q), _mm256_unpackhi_epi32(r, s));
            let coordinates = [
                _mm256_unpacklo_epi64(xy_pq, xy_rs),
                _mm256_unpackhi_epi64(xy_pq, xy_rs),
                _mm256_unpacklo_epi64(zc_pq, zc_rs),
                _mm256_unpackhi_epi64(zc_pq, zc_rs),
            ];
            for (lanes, eight) in out.iter_mut().zip(coordinates) {
                let lanes = &mut lanes[first..first + AT_ONCE];
                // SAFETY: room for eight numbers
                unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), eight) };
            }
        }
    }
    out
}
