//! How cells were cut from each other, and how many other ratios give.

use crate::manifest::{Manifest, PartsBy};
use serde::Serialize;

/// How the cells of a set were split at necks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SplitCells {
    /// Cut where the radius of an opening is at most this part of that of the smaller cell.
    pub ratio: f64,
    /// Not where the radius falls by less, in voxels of the finest axis.
    pub h: f64,
    /// Nor where the smaller radius is less, in the same unit.
    pub min_radius: f64,
    /// Cells of the whole set.
    pub cells: u64,
    /// Connected components of below voxels, of which cells are parts.
    pub components: u64,
    /// Cells for other ratios, by rising ratio.
    pub split_curve: Vec<CurvePoint>,
}

/// How many cells a ratio gives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurvePoint {
    /// The ratio.
    pub ratio: f64,
    /// Cells.
    pub cells: u64,
}

impl SplitCells {
    /// As the index states it; `None` if cells were not split.
    pub(super) fn of(manifest: &Manifest) -> Option<Self> {
        let Some(PartsBy::Split {
            ratio_permille,
            h_256,
            min_radius_256,
            curve,
            ..
        }) = &manifest.cells
        else {
            return None;
        };
        let point = |&[permille, cells]: &[u64; 2]| CurvePoint {
            ratio: permille as f64 / 1000.0,
            cells,
        };
        Some(SplitCells {
            ratio: f64::from(*ratio_permille) / 1000.0,
            h: f64::from(*h_256) / 256.0,
            min_radius: f64::from(*min_radius_256) / 256.0,
            cells: manifest.totals.cells,
            components: manifest.totals.components,
            split_curve: curve.iter().map(point).collect(),
        })
    }
}

/// What a user should know of cells that are parts of components, as the conversion says it.
pub(super) fn warning(manifest: &Manifest) -> Option<String> {
    let whole = manifest.selection.as_ref();
    let cells = whole.map_or(manifest.totals.cells, |selection| selection.of.cells);
    let parts = manifest.cells.as_ref()?;
    parts.warning(cells, manifest.region.is_some())
}
