//! The samples of a piece that count: those that were measured, of a region only those inside.

use crate::error::Result;
use crate::volume::Volume;
use crate::volume::region::{RegionVoxels, for_each_stretch, row_words};
use crate::volume::stats::walk::Piece;
use std::ops::Range;

/// Calls `each` with the samples of a piece's own rows and slices, in stretches that were measured and lie in the region;
/// where all of the volume counts, all that was read is a single stretch.
///
/// # Errors
/// Those of the region.
pub(super) fn for_each_inside<T>(
    volume: &dyn Volume,
    region: Option<&RegionVoxels>,
    piece: &Piece,
    samples: &[T],
    mut each: impl FnMut(&[T]),
) -> Result<()> {
    let all_measured = volume.measured(piece.y.start, piece.z.start).is_none();
    if region.is_none() && all_measured {
        each(samples);
        return Ok(());
    }
    let nx = volume.header().dims.0[0];
    let words = row_words(nx);
    let mut inside = Vec::new();
    for (s, z) in piece.read_z.clone().enumerate() {
        if !piece.z.contains(&z) {
            continue;
        }
        if let Some(region) = region {
            region.rows(piece.y.clone(), z, &mut inside)?;
        }
        for (r, y) in piece.y.clone().enumerate() {
            let start = (s * piece.read_y.len() + r) * nx as usize;
            let measured = volume.measured(y, z).unwrap_or(0..nx);
            let mut counts = |x: Range<u32>| {
                let [from, to] = [x.start, x.end].map(|x| start + x as usize);
                each(&samples[from..to]);
            };
            match region {
                Some(_) => for_each_stretch(&inside[r * words..], &measured, |x, is_inside| {
                    if is_inside {
                        counts(x);
                    }
                }),
                None => counts(measured),
            }
        }
    }
    Ok(())
}

/// Number of voxels that were measured.
pub(crate) fn measured_voxels(volume: &dyn Volume) -> u64 {
    let [nx, ny, nz] = volume.header().dims.0;
    if volume.measured(0, 0).is_none() {
        return volume.header().dims.voxels();
    }
    let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| [y, z]));
    rows.map(|[y, z]| volume.measured(y, z).unwrap_or(0..nx).len() as u64)
        .sum()
}
