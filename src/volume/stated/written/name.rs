//! Names of attributes that hold the size of a voxel.

use crate::volume::stated::written::plain;

/// Names of the size of a voxel, in plain spelling.
const SURE: [&str; 14] = [
    "elementsize",
    "voxelsize",
    "voxelsizes",
    "voxelspacing",
    "voxeldimensions",
    "voxelresolution",
    "voxelpitch",
    "voxellength",
    "pixelsize",
    "pixelspacing",
    "pixelresolution",
    "pixelresolutiondimensions",
    "pixelpitch",
    "voxelsizevalue",
];

/// Names of what is the size of a voxel where it has a unit of length, and may be anything else where not.
const UNSURE: [&str; 6] = [
    "resolution",
    "spacing",
    "scale",
    "transformscale",
    "gridspacing",
    "samplingdistance",
];

/// Endings of names that are units, longest first.
const ENDINGS: [(&str, &str); 15] = [
    ("micrometers", "um"),
    ("micrometres", "um"),
    ("millimeters", "mm"),
    ("millimetres", "mm"),
    ("micrometer", "um"),
    ("micrometre", "um"),
    ("millimeter", "mm"),
    ("millimetre", "mm"),
    ("microns", "um"),
    ("micron", "um"),
    ("um", "um"),
    ("mm", "mm"),
    ("nm", "nm"),
    ("cm", "cm"),
    ("m", "m"),
];

/// What the name of an attribute says.
#[derive(Debug, PartialEq)]
pub(crate) struct Name {
    /// Without the unit and the axis.
    pub(crate) base: String,
    pub(crate) unit: Option<&'static str>,
    pub(crate) axis: Option<usize>,
    pub(crate) sure: bool,
}

impl Name {
    /// The parts of a name that may be of a size in attributes of arrays; `None` for other names.
    pub(crate) fn of(name: &str) -> Option<Name> {
        Name::among(name, |base| SURE.contains(&base) || UNSURE.contains(&base))
    }

    /// The parts of a name whose base is one of those that `known` tells; `None` for other names.
    pub(crate) fn among(name: &str, known: impl Fn(&str) -> bool) -> Option<Name> {
        let whole = plain(name);
        let letter = |text: &str| {
            let (last, rest) = (text.chars().last()?, &text[..text.len() - 1]);
            Some((rest.to_owned(), "xyz".find(last)?))
        };
        let unit = |text: &str| {
            let found = ENDINGS
                .iter()
                .find_map(|(end, unit)| Some((text.strip_suffix(end)?, *unit)));
            found.map(|(rest, unit)| (rest.to_owned(), unit))
        };
        // `voxel_size`, and the same with `_um`, `_x`, `_x_um` or `_um_x` behind it, or `x_` in front
        let mut forms = vec![(whole.clone(), None, None)];
        forms.extend(unit(&whole).map(|(base, u)| (base, Some(u), None)));
        for (base, of_unit, _) in forms.clone() {
            forms.extend(letter(&base).map(|(rest, a)| (rest, of_unit, Some(a))));
            let front = base.chars().next().and_then(|c| "xyz".find(c));
            forms.extend(front.map(|a| (base[1..].to_owned(), of_unit, Some(a))));
        }
        if let Some((rest, a)) = letter(&whole)
            && let Some((base, u)) = unit(&rest)
        {
            forms.push((base, Some(u), Some(a)));
        }
        forms.into_iter().find_map(|(base, unit, axis)| {
            known(&base).then(|| Name {
                sure: SURE.contains(&base.as_str()),
                base,
                unit,
                axis,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_hold_units_and_axes() {
        let name = |name: &str| Name::of(name).map(|n| (n.unit, n.axis, n.sure));
        assert_eq!(name("element_size_um"), Some((Some("um"), None, true)));
        assert_eq!(name("VoxelSize"), Some((None, None, true)));
        assert_eq!(name("Voxel Size [\u{b5}m]"), Some((Some("um"), None, true)));
        assert_eq!(name("resolution_nm"), Some((Some("nm"), None, false)));
        assert_eq!(name("voxelSizeX"), Some((None, Some(0), true)));
        assert_eq!(name("pixel_size_z_mm"), Some((Some("mm"), Some(2), true)));
        assert_eq!(name("pixel_size_mm_y"), Some((Some("mm"), Some(1), true)));
        assert_eq!(name("x_spacing"), Some((None, Some(0), false)));
        assert_eq!(
            ["sum", "maximum", "x", "size", "scales"].map(name),
            [None; 5]
        );
    }
}
