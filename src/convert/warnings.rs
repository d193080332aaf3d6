//! What a user should know of a conversion that is done.

use crate::grid::Dims;
use crate::manifest::{Dust, PartsBy, Totals};
use crate::words::{exact, things};

/// Share of the cells by which their number may differ between two ratios, a twentieth above and below the one that was asked
/// for, without a word: with necks it hardly changes at all.
const STEEP: f64 = 0.1;

/// What a user should know of cells that are parts of components.
///
/// `in_region` if there is a region of interest, which leaves out air around the sample.
pub fn warnings_of_parts(parts: &PartsBy, cells: u64, in_region: bool) -> Option<String> {
    match parts {
        PartsBy::Labels { unlabelled, .. } => unlabelled.map(|voxels| {
            format!(
                "{} below the threshold with label 0: together one more cell, with the largest id",
                things(voxels, "voxel")
            )
        }),
        PartsBy::Split {
            ratio_permille,
            curve,
            ..
        } => {
            let own = u64::from(*ratio_permille);
            let below = curve.iter().rev().find(|point| point[0] + 50 <= own)?;
            let above = curve.iter().find(|point| point[0] >= own + 50)?;
            let ratio = |permille: u64| permille as f64 / 1000.0;
            let differ = above[1].saturating_sub(below[1]) as f64;
            let around = match in_region {
                true => "",
                false => {
                    "; of a round sample in air, of which the air is split too, --roi cylinder leaves that out"
                }
            };
            (differ > STEEP * cells as f64).then(|| {
                format!(
                    "the number of cells hangs on the ratio: {} at {}, {} at {}; this structure has no clear necks (see \
                     `alvis cells OUT --split-curve`){around}",
                    below[1],
                    ratio(below[0]),
                    above[1],
                    ratio(above[0])
                )
            })
        }
    }
}

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
