//! What a user should know of a conversion that is done.

use crate::grid::Dims;
use crate::manifest::{Dust, Totals};
use crate::words::exact;

/// What makes its numbers other than they may be meant to be.
pub fn warnings(totals: &Totals, dims: Dims, threshold: f64, dust: Option<Dust>) -> Vec<String> {
    let mut warnings = Vec::new();
    let threshold = exact(threshold);
    let filled = dust.filter(|dust| match totals.voxels_above {
        0 => dust.objects > 0,
        above => dust.cells > 0 && above == dims.voxels(),
    });
    if let Some(dust) = filled {
        warnings.push(format!(
            "every part on one side of the threshold {threshold} has fewer than {} voxels and was left \
             out (--min-voxels): there is no surface",
            dust.min_voxels
        ));
    } else if totals.voxels_above == 0 {
        warnings.push(format!(
            "no voxel reaches the threshold {threshold}: the tile set is empty (`alvis info` shows \
             the range of the data)"
        ));
    } else if totals.voxels_above == dims.voxels() {
        warnings.push(format!(
            "every voxel reaches the threshold {threshold}: there is no surface inside the volume \
             (`alvis info` shows the range of the data)"
        ));
    }
    if totals.voxels_nan > 0 {
        warnings.push(format!(
            "{} samples are NaN; they count as below",
            totals.voxels_nan
        ));
    }
    warnings
}
