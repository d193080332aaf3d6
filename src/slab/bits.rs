//! One bit per voxel: above or below.

use crate::cpu::dispatch;
use crate::slab::{Span, Voxels};
use crate::volume::Voxel;
use std::slice::ChunksExactMut;

/// The bits of a band: bit `x % 64` of word `x / 64` of row (y, z) is set iff voxel (x, y, z) is
/// above. Bits beyond the row's end are 0.
#[derive(Debug, Clone, Default)]
pub struct Bits {
    /// The voxels covered: all of x, the band's rows and slices without gradient neighbours.
    pub span: Span,
    /// Words per row.
    pub row_words: usize,
    /// Row-major: slices, rows, words.
    pub words: Vec<u64>,
}

impl Bits {
    /// Classifies the rows and slices `span` of `voxels`; `ceil` is the threshold from
    /// [`Voxel::ceil_from`]. Buffers are reused.
    pub fn classify<T: Voxel>(&mut self, voxels: &Voxels<T>, span: Span, ceil: Option<T>) {
        self.row_words = (span.nx as usize).div_ceil(64);
        self.words.clear();
        self.words
            .resize(self.row_words * span.rows() * span.slices(), 0);
        self.span = span;
        let span = &self.span;
        let Some(ceil) = ceil else { return };
        let mut out = self.words.chunks_exact_mut(self.row_words);
        for z in span.z.clone() {
            let rows = span.y.clone().map(|y| voxels.row(y, z));
            dispatch!(classify_rows(rows, ceil, &mut out));
        }
    }

    /// The words of local row `r` of local slice `s`.
    pub fn row(&self, s: usize, r: usize) -> &[u64] {
        let start = (s * self.span.rows() + r) * self.row_words;
        &self.words[start..start + self.row_words]
    }
}

/// Classifies some rows, one chunk of words for each.
#[inline(always)]
fn classify_rows<'a, T: Voxel>(
    rows: impl Iterator<Item = &'a [T]>,
    ceil: T,
    out: &mut ChunksExactMut<u64>,
) {
    for row in rows {
        classify_row(row, ceil, out.next().expect("one chunk per row"));
    }
}

/// Sets bit x of `out` iff `row[x] >= ceil`; NaN is below. `out` has `row.len().div_ceil(64)` words.
#[inline(always)]
pub fn classify_row<T: Voxel>(row: &[T], ceil: T, out: &mut [u64]) {
    let mut chunks = row.chunks_exact(64);
    for (chunk, word) in (&mut chunks).zip(out.iter_mut()) {
        // bytes of 0 or 1 first: compilers turn this loop into wide compares
        let mut flags = [0u8; 64];
        for (flag, &v) in flags.iter_mut().zip(chunk) {
            *flag = u8::from(v >= ceil);
        }
        let (groups, _) = flags.as_chunks::<8>();
        *word = groups
            .iter()
            .enumerate()
            .fold(0, |w, (i, g)| w | gather(*g) << (8 * i));
    }
    let tail = chunks.remainder();
    if !tail.is_empty() {
        out[row.len() / 64] = tail
            .iter()
            .enumerate()
            .fold(0, |w, (i, &v)| w | u64::from(v >= ceil) << i);
    }
}

/// Eight bytes of 0 or 1 to eight bits: the product moves byte i's bit to bit 56 + i, no two terms
/// meet in one place.
fn gather(flags: [u8; 8]) -> u64 {
    u64::from_le_bytes(flags).wrapping_mul(0x0102_0408_1020_4080) >> 56
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_of_any_length_equal_the_plain_comparison(row in prop::collection::vec(any::<u16>(), 1..300), t in any::<u16>()) {
            let mut out = vec![0; row.len().div_ceil(64)];
            classify_row(&row, t, &mut out);
            for (x, &v) in row.iter().enumerate() {
                prop_assert_eq!(out[x / 64] >> (x % 64) & 1 == 1, v >= t);
            }
            if row.len() % 64 != 0 {
                prop_assert_eq!(out[row.len() / 64] >> (row.len() % 64), 0);
            }
        }

        #[test]
        fn nan_is_below(row in prop::collection::vec(prop::num::f32::ANY, 1..130)) {
            let mut out = vec![0; row.len().div_ceil(64)];
            classify_row(&row, 0.25, &mut out);
            for (x, &v) in row.iter().enumerate() {
                prop_assert_eq!(out[x / 64] >> (x % 64) & 1 == 1, v >= 0.25);
            }
        }
    }
}
