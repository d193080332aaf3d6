//! The samples of a piece that count: all of them, or those in a region.

use crate::error::Result;
use crate::volume::region::{RegionVoxels, row_words};
use crate::volume::stats::walk::Piece;

/// Calls `each` with the samples of a piece's own rows and slices, in stretches that lie in the region; without one all
/// that was read is a single stretch.
///
/// # Errors
/// Those of the region.
pub(super) fn for_each_inside<T>(
    region: Option<&RegionVoxels>,
    piece: &Piece,
    samples: &[T],
    mut each: impl FnMut(&[T]),
) -> Result<()> {
    let Some(region) = region else {
        each(samples);
        return Ok(());
    };
    let nx = region.dims().0[0];
    let words = row_words(nx);
    let mut inside = Vec::new();
    for (s, z) in piece.read_z.clone().enumerate() {
        if !piece.z.contains(&z) {
            continue;
        }
        region.rows(piece.y.clone(), z, &mut inside)?;
        for (r, row) in inside.chunks_exact(words).enumerate() {
            let start = (s * piece.read_y.len() + r) * nx as usize;
            stretches(row, &samples[start..start + nx as usize], &mut each);
        }
    }
    Ok(())
}

/// The samples of a row whose bits are set, in stretches.
fn stretches<T>(bits: &[u64], row: &[T], each: &mut impl FnMut(&[T])) {
    let bit = |x: usize| bits[x / 64] >> (x % 64) & 1 == 1;
    let mut x = 0;
    while x < row.len() {
        let word = bits[x / 64] >> (x % 64);
        if word & 1 == 0 {
            x += (word.trailing_zeros() as usize).clamp(1, 64 - x % 64);
            continue;
        }
        let start = x;
        while x < row.len() && bit(x) {
            let ones = (bits[x / 64] >> (x % 64)).trailing_ones() as usize;
            x = (x + ones.max(1)).min(row.len());
        }
        each(&row[start..x]);
    }
}
