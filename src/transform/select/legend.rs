//! The legend of colours by value, as a picture.

use crate::error::{Error, Result};
use crate::manifest::ColourBy;
use crate::picture::Map;
use crate::picture::Picture;
use std::path::Path;

/// Its name in the tile set.
pub const FILE: &str = "legend.png";

/// Draws the map from left to right with its values, twice the size of the letters' pixels.
///
/// # Errors
/// [`Error::Io`] if it cannot be written.
pub fn write(path: &Path, legend: &ColourBy) -> Result<()> {
    let map = Map::named(&legend.map)?;
    Picture::legend(&legend.title(), [legend.min, legend.max], |v| map.at(v))
        .save(path)
        .map_err(|e| Error::io(path, "write the legend", e))
}
