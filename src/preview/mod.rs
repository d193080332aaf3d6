//! A slice of a volume as a picture: grey values, the threshold's contour, the cells in colour.
//!
//! A pixel block is a voxel, whatever the spacing. In a slice across z, x runs to the right and y
//! down; across y, x runs to the right and z down; across x, y runs to the right and z down.

mod cells;
mod draw;
mod slice;

pub use slice::{Axis, Slice};

use crate::error::{Error, Result};
use crate::grid::Ambiguous;
use crate::manifest::Manifest;
use crate::picture::Map;
use crate::volume::{Cropped, Stamp, Volume};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The most pixels of a picture.
const MOST: u64 = 1 << 28;
/// Pixels that the longer side gets if no scale is given and the slice is smaller.
const COMFORT: u32 = 1024;

/// What a preview shows.
#[derive(Debug, Clone)]
pub struct PreviewOptions {
    /// The axis that the slice lies across.
    pub axis: Axis,
    /// Its voxel along that axis; the middle one without.
    pub at: Option<u32>,
    /// Draw the contour of this threshold; with `tiles`, theirs is drawn without one.
    pub threshold: Option<f64>,
    /// A tile set of the volume, to colour its cells.
    pub tiles: Option<PathBuf>,
    /// Colour cells by this column or expression; by their ids without.
    pub colour_by: Option<String>,
    /// The map for that.
    pub map: Map,
    /// Samples that are black and white; the 0.5th and 99.5th percentile of the slice without.
    pub window: Option<[f64; 2]>,
    /// Pixels per voxel and axis; as many as fit 1024 without.
    pub scale: Option<u32>,
    /// What tells whether the volume is changed while it is read, see [`crate::volume::stamp`].
    pub input: Stamp,
}

impl Default for PreviewOptions {
    fn default() -> Self {
        PreviewOptions {
            axis: Axis::Z,
            at: None,
            threshold: None,
            tiles: None,
            colour_by: None,
            map: Map::default(),
            window: None,
            scale: None,
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
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Samples that are black and white; absent if no sample is finite.
    pub window: Option<[f64; 2]>,
    /// Threshold of the contour.
    pub threshold: Option<f64>,
    /// Number of cells that are coloured; absent without tiles.
    pub cells: Option<u64>,
    /// Things the user should know; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// Draws a slice of a volume and writes it as PNG. Memory: some 16 bytes per voxel of the slice, 3
/// per pixel, and a tile.
///
/// With a tile set, the slice is one of the grid that the tiles cover, and below regions of the slice
/// take the cell of the surface at their rim. A region without a rim in the slice, or whose surface
/// is not in the tile set, stays grey.
///
/// # Errors
/// [`Error::Usage`] if the slice is outside the volume, the picture would pass 2^28 pixels, or the
/// tile set is that of another volume; [`Error::InputChanged`]; [`Error::Io`]; [`Error::Format`].
pub fn preview(
    volume: &dyn Volume,
    path: &Path,
    options: &PreviewOptions,
) -> Result<PreviewReport> {
    let manifest = options.tiles.as_deref().map(Manifest::open).transpose()?;
    let cropped;
    let grid: &dyn Volume = match &manifest {
        Some(m) => {
            let found = volume.header().dims;
            if found != m.source.dims {
                let expected = format!(
                    "the volume of {} that the tiles were made from",
                    m.source.dims
                );
                return Err(Error::usage(
                    "--tiles",
                    format!("a volume of {found}"),
                    expected,
                ));
            }
            match &m.source.crop {
                Some(crop) => {
                    cropped = Cropped::new(Box::new(volume), crop)?;
                    &cropped
                }
                None => volume,
            }
        }
        None => volume,
    };
    let dims = grid.header().dims.0;
    let axis = options.axis;
    let at = options.at.unwrap_or(dims[axis as usize] / 2);
    let size = axis.plane().map(|a| dims[a]);
    let scale = scale(size, options.scale)?;
    let slice = Slice::read(grid, axis, at)?;
    let window = options.window.or_else(|| slice.window());
    let threshold = options.threshold.or(manifest.as_ref().map(|m| m.threshold));
    let colours = match (&options.tiles, &manifest) {
        (Some(dir), Some(m)) => Some(cells::colours(dir, m, &slice, options)?),
        _ => None,
    };
    let mut picture = draw::grey(&slice, window, colours.as_ref(), scale);
    if let Some(t) = threshold {
        let rule = manifest
            .as_ref()
            .map_or(Ambiguous::Separate, |m| m.ambiguous);
        draw::contour(&mut picture, &slice, (t, rule), scale);
    }
    // before the picture takes the place of another one
    let warnings = options.input.check()?.into_iter().collect();
    picture
        .save(path)
        .map_err(|e| Error::io(path, "write the picture", e))?;
    Ok(PreviewReport {
        axis,
        at,
        size: size.map(|n| n * scale),
        window,
        threshold,
        cells: colours.map(|c| c.count()),
        warnings,
    })
}

/// Pixels per voxel.
fn scale(size: [u32; 2], asked: Option<u32>) -> Result<u32> {
    let longer = size[0].max(size[1]).max(1);
    let scale = asked.unwrap_or((COMFORT / longer).clamp(1, 16));
    let pixels = size.map(|n| u64::from(n) * u64::from(scale));
    if scale == 0 || pixels[0].saturating_mul(pixels[1]) > MOST {
        return Err(Error::usage(
            "--scale",
            format!("{} x {} pixels", pixels[0], pixels[1]),
            format!("1 to {MOST} pixels"),
        ));
    }
    Ok(scale)
}
