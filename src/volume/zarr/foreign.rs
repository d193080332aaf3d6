//! Attributes of other writers than those of Zarr's own conventions: what they state is applied or refused.

use super::meta::Array;
use crate::error::{Error, Result};
use crate::volume::cf::Packed;
use crate::volume::values::Values;
use crate::volume::warning::Warning;
use crate::volume::written::{self, AXES, is_vague, not_applied};
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
    warnings: &mut Vec<Warning>,
) -> Result<()> {
    let no = |what: String| {
        let hint = "write the values themselves, or remove the attribute";
        Error::unsupported(folder, format!("a Zarr array with {what}"), hint)
    };
    let number = |name: &str| match &array.attributes[name] {
        Value::Null => Ok(None),
        value => match value.as_f64().filter(|n| n.is_finite()) {
            None => Err(format!("an attribute `{name}` that is {value}")),
            number => Ok(number),
        },
    };
    let pair = written::pair(number).map_err(no)?;
    let taken = pair.is_some();
    if let Some((linear, by)) = pair {
        let found = Values::linear(linear.slope, linear.intercept, &by);
        match (&packed.values, found) {
            (_, None) => {}
            (None, found) => packed.values = found,
            (Some(values), Some(_)) => {
                return Err(no(format!("both {} and {by}", values.stated_by)));
            }
        }
    }
    for (name, value) in array.attributes.as_object().into_iter().flatten() {
        let number = value.as_f64().filter(|&n| is_vague(name, n, taken));
        warnings.extend(number.map(|n| not_applied(&format!("`{name}`"), n)));
    }
    Ok(())
}
