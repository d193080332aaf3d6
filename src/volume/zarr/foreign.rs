//! Attributes of other writers than those of Zarr's own conventions: what they state is applied or refused.

use super::meta::Array;
use crate::error::{Error, Result};
use crate::volume::cf::{AXES, PAIRS, Packed, VAGUE};
use crate::volume::values::Values;
use serde_json::Value;
use std::path::Path;

/// Checks that no attribute states another order of the axes than z, y, x.
///
/// # Errors
/// [`Error::Unsupported`] with the attribute's name if one does.
pub(super) fn no_other_order(folder: &Path, array: &Array) -> Result<()> {
    for name in AXES.into_iter().chain(["axistags"]) {
        let value = &array.attributes[name];
        let order: String = match value {
            Value::String(text) if name != "axistags" => text.clone(),
            Value::String(text) => keys(&serde_json::from_str(text).unwrap_or(Value::Null)),
            Value::Array(list) => list.iter().filter_map(Value::as_str).collect(),
            other => keys(other),
        };
        let letters = order.to_lowercase();
        let space: String = letters.chars().filter(|c| "xyz".contains(*c)).collect();
        if space.len() == 3 && space != "zyx" && "xyz".chars().all(|c| space.contains(c)) {
            let what = format!(
                "a Zarr array whose attribute `{name}` states another order of axes ({value})"
            );
            let hint =
                "name its axes in `_ARRAY_DIMENSIONS` (Zarr 2) or `dimension_names` (Zarr 3)";
            return Err(Error::unsupported(folder, what, hint));
        }
    }
    Ok(())
}

/// The keys of the tags of axes, one after the other.
fn keys(tags: &Value) -> String {
    let axes = tags["axes"].as_array().into_iter().flatten();
    axes.filter_map(|axis| axis["key"].as_str()).collect()
}

/// Applies a scale that attributes state by pairs of names, and warns of those whose meaning cannot be told.
///
/// # Errors
/// [`Error::Unsupported`] if two scales are stated, or a part of one is no number.
pub(super) fn scale(
    folder: &Path,
    array: &Array,
    packed: &mut Packed,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let hint = "write the values themselves, or remove the attribute";
    let mut taken = false;
    for (slope, intercept) in PAIRS {
        let number = |name: &str, default: f64| match &array.attributes[name] {
            Value::Null => Ok(default),
            value => value.as_f64().filter(|n| n.is_finite()).ok_or_else(|| {
                let what = format!("a Zarr array whose attribute `{name}` is {value}");
                Error::unsupported(folder, what, hint)
            }),
        };
        let stated = !array.attributes[slope].is_null()
            || !array.attributes[intercept].is_null() && intercept != "intercept";
        if !stated {
            continue;
        }
        let by = format!("{slope} and {intercept}");
        let found = Values::linear(number(slope, 1.0)?, number(intercept, 0.0)?, &by);
        match (&packed.values, found) {
            (_, None) => {}
            (None, Some(_)) if number(slope, 1.0)? == 0.0 => {
                let what = format!("a Zarr array whose attribute `{slope}` is 0");
                return Err(Error::unsupported(folder, what, hint));
            }
            (None, found) => packed.values = found,
            (Some(values), Some(_)) => {
                let what = format!("a Zarr array with both {} and {by}", values.stated_by);
                return Err(Error::unsupported(folder, what, hint));
            }
        }
        taken = true;
    }
    for (name, value) in array.attributes.as_object().into_iter().flatten() {
        let lower = name.to_lowercase();
        let Some(number) = value.as_f64() else {
            continue;
        };
        let nothing =
            number == 0.0 || number == 1.0 && !matches!(lower.as_str(), "offset" | "bias");
        if VAGUE.contains(&lower.as_str()) && !nothing && !(taken && lower == "offset") {
            warnings.push(format!(
                "the attribute `{name}` ({number}) is not applied: if it is of the values, the threshold is in stored \
                 numbers"
            ));
        }
    }
    Ok(())
}
