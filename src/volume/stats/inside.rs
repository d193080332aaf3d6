//! The samples of a piece that count: all of them, or those in a region.

use crate::error::Result;
use crate::volume::region::{RegionVoxels, for_each_stretch, row_words};
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
            for_each_stretch(row, &(0..nx), |stretch, is_inside| {
                if is_inside {
                    let [from, to] = [stretch.start, stretch.end].map(|x| start + x as usize);
                    each(&samples[from..to]);
                }
            });
        }
    }
    Ok(())
}
