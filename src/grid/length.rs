//! Units of length as files spell them, exact conversion between them, and the sizes of voxels that follow from
//! what a file states of each axis.

use crate::grid::Unit;

/// A unit of length, as a whole number of femtometres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Length {
    femtometres: u64,
}

impl From<Unit> for Length {
    /// [`Unit::Voxel`] is no length and counts as the metre that glTF takes it for.
    fn from(unit: Unit) -> Self {
        let femtometres = match unit {
            Unit::Voxel | Unit::Metre => 1_000_000_000_000_000,
            Unit::Centimetre => 10_000_000_000_000,
            Unit::Millimetre => 1_000_000_000_000,
            Unit::Micrometre => 1_000_000_000,
            Unit::Nanometre => 1_000_000,
        };
        Length { femtometres }
    }
}

impl Length {
    /// The unit of this name: English words and symbols, also with the prefixes and escapes that microscopes,
    /// ImageJ, OME and UDUNITS write. `None` for what is no length, or not known.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let text = text.trim().trim_matches('"').trim();
        let text = text.replace("\\u00B5", "u").replace("\\u00b5", "u");
        let text = text.replace(['µ', 'μ'], "u");
        // of these, case tells a millionth or thousandth from a million
        if ["Mm", "Pm"].contains(&text.as_str()) {
            return None;
        }
        if let Ok(unit) = text.parse::<Unit>() {
            return (unit != Unit::Voxel).then(|| unit.into());
        }
        let name = text.to_lowercase();
        let name = name
            .strip_suffix('s')
            .filter(|n| n.len() > 2)
            .unwrap_or(&name);
        let femtometres = match name {
            "fm" | "femtometre" | "femtometer" => 1,
            "pm" | "picometre" | "picometer" => 1_000,
            "å" | "ångström" | "angstrom" | "ångstrom" | "angström" => 100_000,
            "dm" | "decimetre" | "decimeter" => 100_000_000_000_000,
            "km" | "kilometre" | "kilometer" => 1_000_000_000_000_000_000,
            "thou" | "mil" => 25_400_000_000,
            "in" | "inch" | "inche" => 25_400_000_000_000,
            "ft" | "foot" | "feet" => 304_800_000_000_000,
            "yd" | "yard" => 914_400_000_000_000,
            _ => return None,
        };
        Some(Length { femtometres })
    }

    /// The unit in which people read numbers of this one: itself where it is one of ours, else the next smaller
    /// of metre, millimetre, micrometre and nanometre, or the last of these.
    pub(crate) fn shown_in(self) -> Unit {
        let of_ours = [
            Unit::Metre,
            Unit::Centimetre,
            Unit::Millimetre,
            Unit::Micrometre,
            Unit::Nanometre,
        ];
        if let Some(same) = of_ours.into_iter().find(|u| Length::from(*u) == self) {
            return same;
        }
        let fits =
            |u: &Unit| *u != Unit::Centimetre && Length::from(*u).femtometres <= self.femtometres;
        of_ours.into_iter().find(fits).unwrap_or(Unit::Nanometre)
    }

    /// A number of this unit as a number of `unit`: the product in decimal, rounded once, so that 0.07 um are 70 nm
    /// and not 70.00000000000001.
    pub(crate) fn convert(self, value: f64, unit: Unit) -> f64 {
        let to = Length::from(unit).femtometres;
        if self.femtometres == to || value == 0.0 || !value.is_finite() {
            return value;
        }
        let (mantissa, exponent) = decimal(value);
        // units that numbers are shown in are powers of ten
        let exponent = exponent - to.ilog10() as i32;
        nearest(mantissa * i128::from(self.femtometres), exponent)
    }
}

/// The shortest decimal that reads as a finite number: it is the first times ten to the power of the second.
fn decimal(value: f64) -> (i128, i32) {
    let shortest = format!("{value:e}");
    let (digits, exponent) = shortest.split_once('e').unwrap_or((&shortest, "0"));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let mantissa = format!("{whole}{fraction}").parse::<i128>().unwrap_or(0);
    let exponent = exponent.parse::<i32>().unwrap_or(0) - fraction.len() as i32;
    (mantissa, exponent)
}

/// The number nearest to a decimal.
fn nearest(mantissa: i128, exponent: i32) -> f64 {
    format!("{mantissa}e{exponent}").parse().unwrap_or(f64::NAN)
}

/// The product of two stated numbers in decimal, rounded once: 0.1 times 3 is 0.3 and not 0.30000000000000004.
pub(crate) fn product(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 || !a.is_finite() || !b.is_finite() {
        return a * b;
    }
    let ((m, e), (n, f)) = (decimal(a), decimal(b));
    // at most 17 digits each
    nearest(m * n, e + f)
}

/// The sum of two stated numbers, likewise: 0.1 and 0.2 are 0.3.
#[cfg_attr(not(any(feature = "hdf5", feature = "zarr")), allow(dead_code))]
pub(crate) fn sum(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 || !a.is_finite() || !b.is_finite() {
        return a + b;
    }
    let ((m, e), (n, f)) = (decimal(a), decimal(b));
    let low = e.min(f);
    let shifted = |mantissa: i128, exponent: i32| {
        let power = 10i128.checked_pow(exponent.abs_diff(low))?;
        mantissa.checked_mul(power)
    };
    match (shifted(m, e), shifted(n, f)) {
        (Some(m), Some(n)) => m.checked_add(n).map_or(a + b, |sum| nearest(sum, low)),
        _ => a + b,
    }
}

/// The `f64` that reads as a single-precision number of a file does: 0.05 and not 0.05000000074505806.
pub(crate) fn shortest(value: f32) -> f64 {
    if value.is_finite() {
        value.to_string().parse().unwrap_or(f64::from(value))
    } else {
        f64::from(value)
    }
}

/// A number of a text, where it is a single-precision one written out in full: 0.05 for 0.05000000074505806.
pub(crate) fn tidy(value: f64) -> f64 {
    let single = value as f32;
    if f64::from(single) == value {
        shortest(single)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_known_in_every_spelling() {
        for (names, unit, size) in [
            (
                &[
                    "um",
                    "µm",
                    "μm",
                    "micron",
                    "Microns",
                    "\\u00B5m",
                    "micrometer",
                ][..],
                Unit::Micrometre,
                1.0,
            ),
            (&["mm", "Millimeters", "\"mm\""], Unit::Millimetre, 1.0),
            (
                &["Å", "Å", "angstrom", "Angstroms", "ångström"],
                Unit::Nanometre,
                0.1,
            ),
            (&["pm", "picometer"], Unit::Nanometre, 0.001),
            (&["in", "inch", "inches"], Unit::Millimetre, 25.4),
            (&["mil", "mils", "thou"], Unit::Micrometre, 25.4),
            (&["ft", "foot", "feet"], Unit::Millimetre, 304.8),
            (&["km", "kilometre"], Unit::Metre, 1000.0),
            (&["dm"], Unit::Millimetre, 100.0),
        ] {
            for name in names {
                let length = Length::parse(name).unwrap_or_else(|| panic!("{name}"));
                assert_eq!(length.convert(1.0, unit), size, "{name}");
            }
        }
        for name in [
            "", " ", "pixel", "voxels", "Mm", "Pm", "second", "foo", "s", "a.u.",
        ] {
            assert_eq!(Length::parse(name), None, "{name}");
        }
    }

    #[test]
    fn numbers_keep_their_decimals() {
        let of = |name: &str| Length::parse(name).unwrap();
        for (value, from, to, expected) in [
            (0.07, "um", Unit::Nanometre, 70.0),
            (0.03, "um", Unit::Nanometre, 30.0),
            (0.0005, "mm", Unit::Micrometre, 0.5),
            (1.1, "in", Unit::Millimetre, 27.94),
            (5000.0, "Å", Unit::Micrometre, 0.5),
            (-1.7e-6, "m", Unit::Micrometre, -1.7),
            (1e-300, "m", Unit::Nanometre, 1e-291),
            (
                1.7976931348623157e308,
                "nm",
                Unit::Metre,
                1.7976931348623157e299,
            ),
            (0.1, "mm", Unit::Millimetre, 0.1),
        ] {
            assert_eq!(of(from).convert(value, to), expected, "{value} {from}");
        }
        assert!(of("mm").convert(f64::NAN, Unit::Metre).is_nan());
    }

    #[test]
    fn products_and_sums_are_those_of_the_decimals() {
        for (a, b, expected) in [
            (0.1, 3.0, 0.3),
            (0.07, 100.0, 7.0),
            (-1.1, 1.1, -1.21),
            (1e-300, 1e300, 1.0),
            (1.2345678901234567, 9.876543210987654, 12.193263113702178),
            (0.0, 5.0, 0.0),
            (f64::INFINITY, 2.0, f64::INFINITY),
        ] {
            assert_eq!(product(a, b), expected, "{a} {b}");
            assert_eq!(product(b, a), expected, "{a} {b}");
        }
        for (a, b, expected) in [
            (0.1, 0.2, 0.3),
            (0.1, -0.1, 0.0),
            (-0.7, 0.1, -0.6),
            (1e300, 1.0, 1e300),
            (0.0, 0.1, 0.1),
            (1e-17, 1.0, 1.0),
            (f64::NEG_INFINITY, 1.0, f64::NEG_INFINITY),
        ] {
            assert_eq!(sum(a, b), expected, "{a} {b}");
            assert_eq!(sum(b, a), expected, "{a} {b}");
        }
        assert!(product(f64::NAN, 1.0).is_nan() && sum(f64::NAN, 1.0).is_nan());
    }

    #[test]
    fn units_are_shown_in_one_of_ours() {
        for (name, unit) in [
            ("cm", Unit::Centimetre),
            ("um", Unit::Micrometre),
            ("Å", Unit::Nanometre),
            ("pm", Unit::Nanometre),
            ("in", Unit::Millimetre),
            ("mil", Unit::Micrometre),
            ("dm", Unit::Millimetre),
            ("ft", Unit::Millimetre),
            ("km", Unit::Metre),
        ] {
            assert_eq!(Length::parse(name).unwrap().shown_in(), unit, "{name}");
        }
    }

    #[test]
    fn single_precision_reads_as_it_was_written() {
        assert_eq!(shortest(0.05), 0.05);
        assert_eq!(shortest(-1e-20), -1e-20);
        assert_eq!(shortest(f32::MAX), 3.4028235e38);
        assert!(shortest(f32::NAN).is_nan());
        assert_eq!(tidy(0.05000000074505806), 0.05);
        assert_eq!([0.05, 0.25, 1e300].map(tidy), [0.05, 0.25, 1e300]);
    }
}
