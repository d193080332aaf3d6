//! The legend of colours by value, as a picture.

use crate::error::{Error, Result};
use crate::manifest::ColourBy;
use crate::picture::Map;
use crate::picture::{Picture, number};
use std::path::Path;

/// Its name in the tile set.
pub const FILE: &str = "legend.png";

/// Draws the map from left to right with its values, twice the size of the letters' pixels.
///
/// # Errors
/// [`Error::Io`] if it cannot be written.
pub fn write(path: &Path, legend: &ColourBy) -> Result<()> {
    const INK: [u8; 3] = [32, 32, 32];
    const BAR: [u32; 2] = [512, 40];
    const MARGIN: u32 = 80;
    let map = Map::named(&legend.map)?;
    let mut picture = Picture::new([BAR[0] + 2 * MARGIN, BAR[1] + 88], [255; 3]);
    let title = match legend.unit.as_str() {
        "" => legend.column.clone(),
        unit => format!("{} [{unit}]", legend.column),
    };
    picture.text([MARGIN, 12], &title, 2, INK);
    for x in 0..BAR[0] {
        let colour = map.at(f64::from(x) / f64::from(BAR[0] - 1));
        for y in 0..BAR[1] {
            picture.set([MARGIN + x, 40 + y], colour);
        }
    }
    for tick in 0..5u32 {
        let share = f64::from(tick) / 4.0;
        let x = MARGIN + tick * (BAR[0] - 1) / 4;
        for y in 0..6 {
            picture.set([x, 40 + BAR[1] + y], INK);
        }
        let value = number(legend.min + share * (legend.max - legend.min));
        let half = Picture::text_width(&value, 2) / 2;
        picture.text([x.saturating_sub(half), 52 + BAR[1]], &value, 2, INK);
    }
    picture
        .save(path)
        .map_err(|e| Error::io(path, "write the legend", e))
}
