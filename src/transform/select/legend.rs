//! The legend of colours by value, as a picture and as SVG.

use crate::error::{Error, Result};
use crate::manifest::{ColourBy, LEGEND, LEGEND_SVG};
use crate::picture::{ColourBar, Map};
use crate::sys::files::write_file;
use std::path::Path;

/// Draws the map from left to right with its values, and writes both files into a directory.
///
/// # Errors
/// [`Error::Io`] if they cannot be written.
pub fn write(dir: &Path, legend: &ColourBy) -> Result<()> {
    let map = Map::named(&legend.map)?;
    let bar = ColourBar {
        title: &legend.title(),
        ends: [legend.min, legend.max],
        colour: &|share| map.at(share),
    };
    let path = dir.join(LEGEND);
    let saved = bar.picture().save(&path);
    saved.map_err(|e| Error::io(&path, "write the legend", e))?;
    write_file(&dir.join(LEGEND_SVG), &[bar.svg().as_bytes()])
}
