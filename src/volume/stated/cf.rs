//! The attributes of the CF conventions that say which values stored samples stand for, as NetCDF-4 files and
//! xarray's Zarrs have them.
//!
//! <https://cfconventions.org/cf-conventions/cf-conventions.html#packed-data> and
//! <https://docs.unidata.ucar.edu/nug/current/attribute_conventions.html>.

use crate::error::{Error, Result};
use crate::volume::Dtype;
use crate::volume::adapters::values::{Linear, Scale, Values};
use std::path::Path;

/// What an attribute holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Attribute {
    /// One number or several.
    Numbers {
        values: Vec<f64>,
        /// They are floating-point numbers, not integers.
        float: bool,
    },
    Text(String),
    /// Anything else, as a message names it.
    Other(String),
}

/// What the attributes of an array say of its samples.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Packed {
    /// The type as which stored bits are read: that of the array, or its kin with or without a sign.
    pub(crate) dtype: Dtype,
    /// `None` if stored samples are the values.
    pub(crate) values: Option<Values>,
}

/// The attributes that are looked up.
pub(crate) const NAMES: [&str; 8] = [
    "scale_factor",
    "add_offset",
    "_FillValue",
    "missing_value",
    "valid_min",
    "valid_max",
    "valid_range",
    "_Unsigned",
];

/// Values of samples of type `stored` by the attributes that `get` finds by name.
///
/// `scale_factor` and `add_offset` give value = stored * scale_factor + add_offset. Samples of `_FillValue` and
/// `missing_value`, and those outside of `valid_min`, `valid_max` or `valid_range`, stand for nothing. These are in
/// stored numbers, except that a range of floating-point numbers is one of values where integers are scaled.
/// `_Unsigned` turns signed integers into unsigned ones of the same bits, and `_FillValue` and the like with them.
///
/// # Errors
/// Those of `get`; [`Error::Unsupported`] with the attribute's name if its value has no such meaning.
pub(crate) fn values(
    path: &Path,
    stored: Dtype,
    get: impl FnMut(&str) -> Result<Option<Attribute>>,
) -> Result<Packed> {
    let found = NAMES.into_iter().zip(NAMES.map(get));
    let mut stated = Vec::new();
    for (name, attribute) in found {
        if let Some(attribute) = attribute? {
            stated.push((name, attribute));
        }
    }
    let reader = Stated { path, stated };
    let dtype = reader.dtype(stored)?;
    let as_stored = |v: f64| as_stored(v, stored, dtype);
    let one = |name| {
        reader.one(name, |v| {
            v.is_finite() && (v != 0.0 || name != "scale_factor")
        })
    };
    let scale = Linear {
        slope: one("scale_factor")?.unwrap_or(1.0),
        intercept: one("add_offset")?.unwrap_or(0.0),
    };
    let mut nothing = reader.list("_FillValue")?.0;
    nothing.extend(reader.list("missing_value")?.0);
    let mut nothing: Vec<f64> = nothing.into_iter().filter_map(as_stored).collect();
    // what is NaN already stands for nothing
    nothing.retain(|v| !v.is_nan());
    nothing.sort_by(f64::total_cmp);
    nothing.dedup();
    let valid = reader.valid(stored, dtype, scale)?;
    let same = scale == Linear::SAME && nothing.is_empty() && valid.is_none();
    Ok(Packed {
        dtype,
        values: (!same).then(|| Values {
            scale: Scale::All(scale),
            nothing,
            valid,
            stated_by: reader.names(),
        }),
    })
}

/// The attributes that are there.
struct Stated<'a> {
    path: &'a Path,
    stated: Vec<(&'static str, Attribute)>,
}

impl Stated<'_> {
    fn attribute(&self, name: &str) -> Option<&Attribute> {
        let of_name = self.stated.iter().find(|(n, _)| *n == name);
        of_name.map(|(_, attribute)| attribute)
    }

    fn no(&self, name: &str, found: &str) -> Error {
        let hint = "correct the attribute or remove it";
        Error::unsupported(
            self.path,
            format!("the attribute `{name}` of {found}"),
            hint,
        )
    }

    /// The numbers of an attribute, none if it is absent, and whether they are floating-point numbers.
    fn list(&self, name: &str) -> Result<(Vec<f64>, bool)> {
        match self.attribute(name) {
            None => Ok((Vec::new(), false)),
            Some(Attribute::Numbers { values, float }) => Ok((values.clone(), *float)),
            // as JSON has them
            Some(Attribute::Text(text)) => match text.as_str() {
                "NaN" => Ok((vec![f64::NAN], true)),
                "Infinity" => Ok((vec![f64::INFINITY], true)),
                "-Infinity" => Ok((vec![f64::NEG_INFINITY], true)),
                _ => Err(self.no(name, &format!("\"{text}\""))),
            },
            Some(Attribute::Other(found)) => Err(self.no(name, found)),
        }
    }

    /// The one number of an attribute.
    fn one(&self, name: &str, sound: impl Fn(f64) -> bool) -> Result<Option<f64>> {
        match (self.attribute(name), &self.list(name)?.0[..]) {
            (None, _) => Ok(None),
            (_, [v]) if sound(*v) => Ok(Some(*v)),
            (_, other) => Err(self.no(name, &format!("{other:?}"))),
        }
    }

    /// The type as which bits are read.
    fn dtype(&self, stored: Dtype) -> Result<Dtype> {
        let unsigned = match self.attribute("_Unsigned") {
            None => return Ok(stored),
            Some(Attribute::Text(text)) if text.eq_ignore_ascii_case("true") => true,
            Some(Attribute::Text(text)) if text.eq_ignore_ascii_case("false") => false,
            Some(Attribute::Numbers { values, .. }) if values[..] == [1.0] => true,
            Some(Attribute::Numbers { values, .. }) if values[..] == [0.0] => false,
            Some(other) => return Err(self.no("_Unsigned", &format!("{other:?}"))),
        };
        Ok(match (stored, unsigned) {
            (Dtype::I8, true) => Dtype::U8,
            (Dtype::I16, true) => Dtype::U16,
            (Dtype::I32, true) => Dtype::U32,
            (Dtype::U8, false) => Dtype::I8,
            (Dtype::U16, false) => Dtype::I16,
            (Dtype::U32, false) => Dtype::I32,
            _ => stored,
        })
    }

    /// The closed range of stored numbers that stand for values.
    fn valid(&self, stored: Dtype, dtype: Dtype, scale: Linear) -> Result<Option<[f64; 2]>> {
        let number = |v: f64| !v.is_nan();
        let mut ends = [
            ("valid_min", self.one("valid_min", number)?),
            ("valid_max", self.one("valid_max", number)?),
        ]
        .map(|(name, end)| end.map(|v| (v, matches!(self.list(name), Ok((_, true))))));
        if self.attribute("valid_range").is_some() {
            let (range, float) = self.list("valid_range")?;
            let [low, high] = range[..] else {
                return Err(self.no("valid_range", &format!("{range:?}")));
            };
            ends = [Some((low, float)), Some((high, float))];
        }
        if ends == [None; 2] {
            return Ok(None);
        }
        let integers = !stored.is_float();
        let of_values = |float: bool| float && integers && scale != Linear::SAME;
        let to_stored = |(v, float): (f64, bool)| match of_values(float) {
            true => whole((v - scale.intercept) / scale.slope),
            false => as_stored(v, stored, dtype).unwrap_or(v),
        };
        let mut ends = ends.map(|end| end.map(|end| (to_stored(end), of_values(end.1))));
        // a negative slope turns a range of values round
        let turned = |end: Option<(f64, bool)>| scale.slope < 0.0 && end.is_none_or(|e| e.1);
        if ends.into_iter().all(turned) {
            ends.reverse();
        }
        let low = ends[0].map_or(f64::NEG_INFINITY, |e| e.0);
        let high = ends[1].map_or(f64::INFINITY, |e| e.0);
        match low <= high {
            true => Ok(Some([low, high])),
            false => Err(self.no("valid_range", &format!("{low} to {high}"))),
        }
    }

    fn names(&self) -> String {
        let names: Vec<&str> = self.stated.iter().map(|(name, _)| *name).collect();
        match &names[..] {
            [] => String::new(),
            [one] => (*one).to_owned(),
            [front @ .., last] => format!("{} and {last}", front.join(", ")),
        }
    }
}

/// A stored number as it reads among samples of a type: `None` if none of them can be equal to it.
fn as_stored(value: f64, stored: Dtype, read_as: Dtype) -> Option<f64> {
    let span = (1u128 << (8 * stored.bytes())) as f64;
    let range = |dtype: Dtype| match dtype {
        Dtype::U8 | Dtype::U16 | Dtype::U32 => [0.0, span - 1.0],
        _ => [-span / 2.0, span / 2.0 - 1.0],
    };
    match read_as {
        Dtype::F64 => Some(value),
        Dtype::F32 => Some(f64::from(value as f32)),
        _ => {
            let [low, high] = range(read_as);
            let turned = match value {
                v if stored == read_as || (low..=high).contains(&v) => v,
                v if v < low => v + span,
                v => v - span,
            };
            ((low..=high).contains(&turned) && turned.fract() == 0.0).then_some(turned)
        }
    }
}

/// A quotient that is a whole number but for its rounding.
fn whole(value: f64) -> f64 {
    let near = value.round();
    if (value - near).abs() <= 1e-9 * near.abs().max(1.0) {
        near
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ints(values: &[i64]) -> Attribute {
        Attribute::Numbers {
            values: values.iter().map(|&v| v as f64).collect(),
            float: false,
        }
    }

    fn floats(values: &[f64]) -> Attribute {
        Attribute::Numbers {
            values: values.to_vec(),
            float: true,
        }
    }

    fn text(text: &str) -> Attribute {
        Attribute::Text(text.into())
    }

    fn packed(stored: Dtype, attributes: &[(&str, Attribute)]) -> Result<Packed> {
        values(Path::new("v.nc"), stored, |name| {
            let found = attributes.iter().find(|(n, _)| *n == name);
            Ok(found.map(|(_, a)| a.clone()))
        })
    }

    fn of(stored: Dtype, attributes: &[(&str, Attribute)]) -> Values {
        let packed = packed(stored, attributes).unwrap();
        packed.values.expect("values")
    }

    #[test]
    fn scales_and_fills() {
        let values = of(
            Dtype::I16,
            &[
                ("scale_factor", floats(&[0.5])),
                ("add_offset", ints(&[-3])),
                ("_FillValue", ints(&[-32768])),
                ("missing_value", ints(&[-1, -32768, 70_000])),
            ],
        );
        let scale = Linear {
            slope: 0.5,
            intercept: -3.0,
        };
        assert_eq!(values.scale, Scale::All(scale));
        assert_eq!(values.nothing, [-32768.0, -1.0], "70,000 is no i16");
        assert_eq!(values.valid, None);
        let by = "scale_factor, add_offset, _FillValue and missing_value";
        assert_eq!(values.stated_by, by);
        // a double in the attribute, the nearest single-precision number in the samples
        let values = of(Dtype::F32, &[("_FillValue", floats(&[1e20]))]);
        assert_eq!(values.nothing, [f64::from(1e20f32)]);
    }

    #[test]
    fn what_changes_nothing_is_no_scale() {
        for attributes in [
            &[][..],
            &[
                ("scale_factor", floats(&[1.0])),
                ("add_offset", floats(&[0.0])),
            ],
            &[("units", text("HU"))],
            &[("_FillValue", text("NaN"))],
            &[("_FillValue", floats(&[f64::NAN]))],
        ] {
            let packed = packed(Dtype::F32, attributes).unwrap();
            assert_eq!((packed.dtype, packed.values), (Dtype::F32, None));
        }
    }

    #[test]
    fn signs_are_turned_with_all_that_is_stored() {
        let attributes = [
            ("_Unsigned", text("true")),
            ("_FillValue", ints(&[-1])),
            ("valid_range", ints(&[0, -2])),
        ];
        let found = packed(Dtype::I8, &attributes).unwrap();
        let values = found.values.unwrap();
        assert_eq!((found.dtype, values.nothing), (Dtype::U8, vec![255.0]));
        assert_eq!(values.valid, Some([0.0, 254.0]));
        let signed = packed(Dtype::U16, &[("_Unsigned", text("false"))]).unwrap();
        assert_eq!((signed.dtype, signed.values), (Dtype::I16, None));
        let signed = [("_Unsigned", text("FALSE")), ("_FillValue", ints(&[255]))];
        assert_eq!(of(Dtype::U8, &signed).nothing, [-1.0]);
        let float = packed(Dtype::F32, &[("_Unsigned", text("true"))]).unwrap();
        assert_eq!(float.dtype, Dtype::F32);
    }

    #[test]
    fn ranges_are_of_stored_numbers_or_of_values() {
        let scale = ("scale_factor", floats(&[0.001]));
        let of_stored = [scale.clone(), ("valid_range", ints(&[10, 3000]))];
        assert_eq!(of(Dtype::I16, &of_stored).valid, Some([10.0, 3000.0]));
        let of_values = [scale.clone(), ("valid_range", floats(&[0.01, 3.0]))];
        assert_eq!(of(Dtype::I16, &of_values).valid, Some([10.0, 3000.0]));
        let turned = [
            ("scale_factor", floats(&[-0.5])),
            ("valid_max", floats(&[4.0])),
        ];
        assert_eq!(of(Dtype::I16, &turned).valid, Some([-8.0, f64::INFINITY]));
        let plain = [("valid_min", floats(&[2.0]))];
        assert_eq!(of(Dtype::U8, &plain).valid, Some([2.0, f64::INFINITY]));
        let float = [scale, ("valid_max", floats(&[9.0]))];
        assert_eq!(of(Dtype::F32, &float).valid, Some([f64::NEG_INFINITY, 9.0]));
    }

    #[test]
    fn what_has_no_meaning_is_refused_by_name() {
        for (name, attribute) in [
            ("scale_factor", floats(&[0.0])),
            ("scale_factor", floats(&[1.0, 2.0])),
            ("scale_factor", floats(&[])),
            ("scale_factor", text("0.1 of a unit")),
            ("add_offset", floats(&[f64::INFINITY])),
            ("_FillValue", text("none")),
            ("missing_value", Attribute::Other("a list".into())),
            ("valid_range", ints(&[1])),
            ("valid_range", ints(&[2, 1])),
            ("valid_min", floats(&[f64::NAN])),
            ("_Unsigned", text("perhaps")),
        ] {
            let error = packed(Dtype::U8, &[(name, attribute)]).unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            assert!(error.to_string().contains(name), "{error}");
        }
    }
}
