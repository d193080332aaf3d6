//! Coordinate arrays beside an array, one for each axis and of its name, as xarray writes them.

use crate::grid::length;
use crate::volume::formats::zarr::meta::Array;
use crate::volume::formats::zarr::place::Line;
use crate::volume::formats::zarr::small;
use crate::volume::formats::zarr::store::{Node, node};
use crate::volume::stated::cf::Attribute;
use crate::volume::stated::size::shortest_near;
use crate::volume::stated::warning::Warning;
use serde_json::Value;
use std::path::Path;

/// Differences of neighbours may differ by this part of a step.
const UNEVEN: f64 = 1e-3;

/// What the coordinates of the axes x, y and z of an array state, and warnings of what is not taken.
pub(crate) fn lines(
    folder: &Path,
    array: &Array,
    axes: [usize; 3],
) -> ([Option<Line>; 3], Vec<Warning>) {
    let mut warnings = Vec::new();
    let mut counts = 0;
    let mut lines = axes.map(|axis| {
        let name = array.names.get(axis).filter(|n| !n.is_empty() && !n.contains('/') && *n != "..")?;
        match line(folder, name, array.shape[axis]) {
            Ok((line, count)) => {
                counts += usize::from(count);
                line
            }
            Err(why) => {
                warnings.push(Warning::of_size(format!(
                    "the coordinates of {name} {why}, so the size of a voxel is not taken: give --spacing and --unit"
                )));
                None
            }
        }
    });
    // numbers of voxels are no sizes
    if !warnings.is_empty() || counts == lines.iter().flatten().count() {
        lines = [const { None }; 3];
    }
    (lines, warnings)
}

/// The coordinates of an axis of `size` entries, and whether they are but the numbers of its entries; none if there
/// are none.
///
/// # Errors
/// Why they are no line.
fn line(folder: &Path, name: &str, size: u64) -> Result<(Option<Line>, bool), String> {
    let none = Ok((None, false));
    let Some(inner) = folder.parent().map(|group| group.join(name)) else {
        return none;
    };
    if inner == folder || !crate::store::is_dir(&inner) {
        return none;
    }
    let array = match node(&inner) {
        Ok(Node::Array(array)) => *array,
        Ok(_) => return none,
        Err(e) => return Err(format!("cannot be read ({e})")),
    };
    if array.shape != [size] {
        return Err(format!(
            "have the shape {:?}, not that of the axis, {size}",
            array.shape
        ));
    }
    let attributes = array.attributes.clone();
    let single = array.kind.size == 4;
    let mut values = small::read(&inner, array).map_err(|e| format!("cannot be read ({e})"))?;
    let number = |name: &str, default| attributes[name].as_f64().unwrap_or(default);
    let (slope, shift) = (number("scale_factor", 1.0), number("add_offset", 0.0));
    values
        .iter_mut()
        .for_each(|v| *v = length::sum(length::product(*v, slope), shift));
    let unit = attributes["units"].as_str().or(attributes["unit"].as_str());
    let unit = unit.unwrap_or_default().to_owned();
    let ([first, .., last], false) = (&values[..], values.iter().any(|v| !v.is_finite())) else {
        return none;
    };
    let step = step(*first, *last, size, single);
    let even = values.windows(2).all(|pair| {
        (pair[1] - pair[0] - step).abs() <= UNEVEN * step.abs() + slack(&values, single)
    });
    if step == 0.0 || !even {
        return Err("are not evenly spaced".into());
    }
    let indices = unit.is_empty() && (0..).zip(&values).all(|(i, v)| f64::from(i) == *v);
    let line = Line {
        step,
        start: shortest_near(*first, 2.0 * slack(&values, single)),
        unit,
    };
    Ok((Some(line), indices))
}

/// How much coordinates of these sizes are off by being rounded.
fn slack(values: &[f64], single: bool) -> f64 {
    let most = values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let epsilon = if single {
        f64::from(f32::EPSILON)
    } else {
        f64::EPSILON
    };
    2.0 * epsilon * most
}

/// The step with the fewest digits that leads from the first of `size` coordinates to the last.
fn step(first: f64, last: f64, size: u64, single: bool) -> f64 {
    let count = (size - 1) as f64;
    let exact = (last - first) / count;
    let slack = slack(&[first, last], single);
    let short = (0..17).map(|digits| format!("{exact:.digits$e}").parse().unwrap_or(exact));
    let mut fits = short.filter(|s: &f64| (s * count - (last - first)).abs() <= slack);
    fits.next().unwrap_or(exact)
}

/// The attributes that xarray's scales are in, by name: what [`crate::volume::stated::cf::values`] asks for.
pub(crate) fn attribute(array: &Array, name: &str) -> Option<Attribute> {
    let json = &array.attributes[name];
    if name == "_FillValue" && json.is_null() {
        return own_fill(array);
    }
    let number = |v: &Value| match v {
        Value::Bool(set) => Some(f64::from(u8::from(*set))),
        Value::String(text) => word(text),
        v => v.as_f64(),
    };
    match json {
        Value::Null => None,
        Value::String(text) if name == "_Unsigned" || number(json).is_none() => {
            Some(Attribute::Text(text.clone()))
        }
        Value::Array(list) => Some(match list.iter().map(number).collect() {
            Some(values) => Attribute::Numbers {
                values,
                float: list.iter().any(Value::is_f64),
            },
            None => Attribute::Other(json.to_string()),
        }),
        other => Some(match number(other) {
            Some(value) => Attribute::Numbers {
                values: vec![value],
                float: !matches!(other, Value::Bool(_)) && !other.is_u64() && !other.is_i64(),
            },
            None => Attribute::Other(other.to_string()),
        }),
    }
}

/// In Zarr 2, xarray takes the value of chunks that are not there for the `_FillValue`. That of other writers is 0,
/// which is a value like others, unless samples are packed.
fn own_fill(array: &Array) -> Option<Attribute> {
    let packed = ["scale_factor", "add_offset", "missing_value"];
    let packed = packed.iter().any(|name| !array.attributes[name].is_null());
    let fill = xarrays_fill(array).filter(|fill| *fill != 0.0 || packed)?;
    Some(Attribute::Numbers {
        values: vec![fill],
        float: false,
    })
}

/// The value that xarray takes for the `_FillValue` though no attribute says so.
fn xarrays_fill(array: &Array) -> Option<f64> {
    let xarrays = array.version == 2 && array.attributes["_ARRAY_DIMENSIONS"].is_array();
    let stated = !array.attributes["_FillValue"].is_null();
    array
        .fill
        .filter(|fill| xarrays && !stated && !fill.is_nan())
}

/// What is done with the value that xarray takes for the `_FillValue`.
pub(crate) fn fill_note(array: &Array) -> Option<String> {
    let fill = xarrays_fill(array)?;
    Some(match own_fill(array) {
        Some(_) => {
            format!("stored {fill}, the fill_value of the array, is no value, as xarray reads it")
        }
        None => format!(
            "stored {fill}, the fill_value of the array, is read as it is; xarray takes it for no value"
        ),
    })
}

/// A number in text: a word of JSON's, or eight bytes in base64, as xarray writes `_FillValue` in Zarr 3.
fn word(text: &str) -> Option<f64> {
    match text {
        "NaN" => return Some(f64::NAN),
        "Infinity" => return Some(f64::INFINITY),
        "-Infinity" => return Some(f64::NEG_INFINITY),
        _ => {}
    }
    let digits = text.strip_suffix('=').filter(|d| d.len() == 11)?;
    let mut bits = 0u128;
    for byte in digits.bytes() {
        let six = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u128::from(six);
    }
    // 11 digits have two bits more than eight bytes
    Some(f64::from_bits(((bits >> 2) as u64).swap_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_short() {
        assert_eq!(step(0.0, 0.1 * 27.0, 28, false), 0.1);
        assert_eq!(step(0.3, 0.3 + 0.1 * 9.0, 10, false), 0.1);
        assert_eq!(step(5.0, 4.45, 12, false), -0.05);
        assert_eq!(step(0.0, f64::from(0.1f32) * 10.0, 11, true), 0.1);
        let third = step(0.0, 11.0 / 3.0, 12, false);
        assert!((third - 1.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn numbers_in_text() {
        // base64.standard_b64encode(struct.pack("<d", v))
        assert_eq!(word("AAAAAAA4j0A="), Some(999.0));
        assert_eq!(word("AAAAAAAAAAA="), Some(0.0));
        assert!(word("AAAAAAAA+H8=").unwrap().is_nan());
        assert_eq!((word("none"), word("AAAAAAAA+H8")), (None, None));
    }
}
