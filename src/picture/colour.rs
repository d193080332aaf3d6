//! Colours by name and colours by value.

use crate::error::{Error, Result};
use colorous::Gradient;

/// The colour maps, all of rising or at least even lightness but turbo, which shows most detail.
const MAPS: [(&str, Gradient); 6] = [
    ("viridis", colorous::VIRIDIS),
    ("magma", colorous::MAGMA),
    ("plasma", colorous::PLASMA),
    ("inferno", colorous::INFERNO),
    ("cividis", colorous::CIVIDIS),
    ("turbo", colorous::TURBO),
];

/// Colours that a map is cut into, so that a tile needs few materials.
pub const STEPS: usize = 256;

/// A colour map.
#[derive(Debug, Clone, Copy)]
pub struct Map {
    name: &'static str,
    gradient: Gradient,
}

impl Default for Map {
    fn default() -> Self {
        let (name, gradient) = MAPS[0];
        Map { name, gradient }
    }
}

impl Map {
    /// The names of all maps.
    pub fn names() -> [&'static str; 6] {
        MAPS.map(|(name, _)| name)
    }

    /// The map of a name.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none.
    pub fn named(name: &str) -> Result<Map> {
        match MAPS.iter().find(|(known, _)| *known == name) {
            Some(&(name, gradient)) => Ok(Map { name, gradient }),
            None => Err(Error::usage("--map", name, Self::names().join(", "))),
        }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The colour at `share`, from 0 for the first to 1 for the last; what is beyond takes the
    /// nearest.
    pub fn at(&self, share: f64) -> [u8; 3] {
        let step = (share.clamp(0.0, 1.0) * (STEPS - 1) as f64).round() as usize;
        let c = self.gradient.eval_rational(step, STEPS);
        [c.r, c.g, c.b]
    }
}

/// Reads a CSS colour: a name, `#rrggbb`, `rgb(...)` and the like.
///
/// # Errors
/// [`Error::Usage`] if it is none, or is transparent.
pub fn parse_colour(option: &str, text: &str) -> Result<[u8; 3]> {
    let bad = || Error::usage(option, text, "a CSS colour, such as orange or #ff8800");
    let colour = csscolorparser::parse(text.trim()).map_err(|_| bad())?;
    let [r, g, b, a] = colour.to_rgba8();
    if a != 255 {
        return Err(bad());
    }
    Ok([r, g, b])
}

/// `#rrggbb`.
pub fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_read() {
        for (text, colour) in [
            ("red", [255, 0, 0]),
            (" Green", [0, 128, 0]),
            ("#ff8800", [255, 136, 0]),
            ("#abc", [170, 187, 204]),
            ("rgb(1, 2, 3)", [1, 2, 3]),
        ] {
            assert_eq!(parse_colour("--paint", text).unwrap(), colour, "{text}");
        }
        for bad in ["", "reddish", "#ff88", "#ff880080", "transparent", "µ"] {
            assert!(parse_colour("--paint", bad).is_err(), "{bad}");
        }
        assert_eq!(hex([255, 136, 0]), "#ff8800");
    }

    #[test]
    fn maps_run_from_their_first_to_their_last_colour() {
        // the ends of matplotlib's maps
        for (name, first, last) in [
            ("viridis", [68, 1, 84], [253, 231, 37]),
            ("magma", [0, 0, 4], [252, 253, 191]),
        ] {
            let map = Map::named(name).unwrap();
            assert_eq!((map.at(0.0), map.at(1.0)), (first, last));
            assert_eq!((map.at(-1.0), map.at(f64::INFINITY)), (first, last));
        }
        assert!(Map::named("jet").unwrap_err().to_string().contains("turbo"));
    }
}
