//! What a preview shows, and what it tells of it.

use super::labels::LabelVolume;
use super::slice::Axis;
use crate::picture::Map;
use crate::table::Chosen;
use crate::volume::{RegionVoxels, Stamp};
use serde::Serialize;
use std::path::PathBuf;

/// What a preview shows.
#[derive(Debug, Clone)]
pub struct PreviewOptions {
    /// The axis that the slice lies across.
    pub axis: Axis,
    /// Its voxel along that axis; the middle one without.
    pub at: Option<u32>,
    /// Draw the contours of these thresholds, of several in a panel each, side by side; with `tiles`, theirs is drawn
    /// without one.
    pub thresholds: Vec<f64>,
    /// What found each of them, as `otsu`; empty for those that were given.
    pub names: Vec<String>,
    /// The sample that voxels outside of `region` have at each of them, as a conversion would give it; with `tiles` they
    /// have that of the tiles.
    pub fills: Vec<f64>,
    /// A tile set of the volume, to colour its cells, objects or surfaces.
    pub tiles: Option<PathBuf>,
    /// The labels that its cells were made by, which tell the cell of each voxel.
    pub labels: Option<LabelVolume>,
    /// Colour them by this column or expression; without, as the tiles are painted, or by their ids.
    pub colour_by: Option<String>,
    /// The map for that.
    pub map: Map,
    /// Values of the map's first and last colour; those of the table without.
    pub range: Option<[f64; 2]>,
    /// What to colour: cells or objects are filled, of surfaces the outlines are drawn, instead of the contour.
    pub chosen: Chosen,
    /// Samples that are black and white; the 0.5th and 99.5th percentile of the slice without.
    pub window: Option<[f64; 2]>,
    /// Pixels per voxel along the axis of smaller spacing; as many as fit 1024 without.
    pub scale: Option<u32>,
    /// The slice alone, without caption, scale bar and legends.
    pub plain: bool,
    /// The samples tell the two phases alone, so there is no legend of them.
    pub phases_only: bool,
    /// The region of interest of the volume, which is outlined; what is outside is pale. With a tile set it is that of the
    /// tiles.
    pub region: Option<RegionVoxels>,
    /// What tells whether the volume is changed while it is read, see [`crate::volume::stamp`].
    pub input: Stamp,
}

impl Default for PreviewOptions {
    fn default() -> Self {
        PreviewOptions {
            axis: Axis::Z,
            at: None,
            thresholds: Vec::new(),
            names: Vec::new(),
            fills: Vec::new(),
            tiles: None,
            labels: None,
            colour_by: None,
            map: Map::default(),
            range: None,
            chosen: Chosen::default(),
            window: None,
            scale: None,
            plain: false,
            phases_only: false,
            region: None,
            input: Stamp::default(),
        }
    }
}

/// What a preview shows; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PreviewReport {
    /// The axis that the slice lies across.
    pub axis: Axis,
    /// Its voxel along that axis.
    pub at: u32,
    /// Width and height of the picture in pixels.
    pub size: [u32; 2],
    /// Upper left pixel of the slice in it, of the first one where there are several.
    pub slice_corner: [u32; 2],
    /// Width and height of the slice in pixels.
    pub slice_size: [u32; 2],
    /// Samples that are black and white; absent if no sample is finite.
    pub window: Option<[f64; 2]>,
    /// Threshold of the contour, of the first one where there are several; of outlines without one that of the tiles.
    pub threshold: Option<f64>,
    /// The slices side by side; empty unless there are several thresholds.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub panels: Vec<Panel>,
    /// Number of cells that are coloured; absent without tiles, or if others are coloured.
    pub cells: Option<u64>,
    /// Number of cells that are hatched, since their values mean nothing: those that the volume's faces cut, if a measure
    /// gives the colours; absent without tiles, or if others are coloured.
    pub cells_without_value: Option<u64>,
    /// The same two numbers of objects, if these are coloured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<u64>,
    #[allow(missing_docs)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects_without_value: Option<u64>,
    /// The same two numbers of surfaces, if these are coloured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surfaces: Option<u64>,
    #[allow(missing_docs)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surfaces_without_value: Option<u64>,
    /// Values of the map's first and last colour; absent if colours do not follow values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Things the user should know; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// One of several slices side by side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Panel {
    /// Threshold of its contour.
    pub threshold: f64,
    /// The share of the slice's voxels above it, 0 to 1; of those in the region of interest, if there is one.
    pub share_above: f64,
    /// Upper left pixel of the slice in the picture.
    pub corner: [u32; 2],
}
