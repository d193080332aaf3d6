//! What attributes of other writers than CF's state of an array, in HDF5 and Zarr: names of axes, and scales.

use super::values::Linear;

/// Attributes that name the axes of an array, as a list or as letters.
pub(super) const AXES: [&str; 15] = [
    "dimorder",
    "DIMENSION_LABELS",
    "axes",
    "axisLabels",
    "axislabels",
    "axis_labels",
    "axis_names",
    "axes_names",
    "axes_order",
    "_ARRAY_DIMENSIONS",
    "dims",
    "dimensions",
    "dim_order",
    "dimension_names",
    "dim_names",
];

/// Pairs of attributes whose names say that value = first * stored + second.
pub(super) const PAIRS: [(&str, &str); 4] = [
    ("RescaleSlope", "RescaleIntercept"),
    ("rescale_slope", "rescale_intercept"),
    ("scl_slope", "scl_inter"),
    ("slope", "intercept"),
];

/// Attributes, in small letters, that may be of the values, or of the size of a voxel, or of anything.
const VAGUE: [&str; 11] = [
    "scale",
    "scaling",
    "scalefactor",
    "multiplier",
    "gain",
    "offset",
    "calibration",
    "cal_slope",
    "cal_offset",
    "cal_intercept",
    "bias",
];

/// A scale, and the attributes that state it.
pub(super) type Stated = (Linear, String);

/// The scale that a pair of attributes states, if one does; `number` looks an attribute up, finite if it is there.
///
/// # Errors
/// Those of `number`, and a few words of what is stated if it is no scale, or if two scales are.
pub(super) fn pair(
    number: impl Fn(&str) -> Result<Option<f64>, String>,
) -> Result<Option<Stated>, String> {
    let mut found: Option<Stated> = None;
    for (slope, intercept) in PAIRS {
        let a = number(slope)?;
        // an intercept may be of anything
        let b = match a.is_some() || intercept != "intercept" {
            true => number(intercept)?,
            false => None,
        };
        if a.is_none() && b.is_none() {
            continue;
        }
        let linear = Linear {
            slope: a.unwrap_or(1.0),
            intercept: b.unwrap_or(0.0),
        };
        let stated = sound(linear, format!("{slope} and {intercept}"))?;
        found = match found {
            Some((known, by)) if known != Linear::SAME => {
                if linear != Linear::SAME {
                    return Err(format!("both {by} and {}", stated.1));
                }
                Some((known, by))
            }
            _ => Some(stated),
        };
    }
    Ok(found)
}

/// A scale under which stored numbers that differ keep apart.
///
/// # Errors
/// A few words of a scale that is none.
pub(super) fn sound(linear: Linear, by: String) -> Result<Stated, String> {
    if linear.slope == 0.0 || !linear.slope.is_finite() || !linear.intercept.is_finite() {
        return Err(format!("a scale of {} by {by}", linear.slope));
    }
    Ok((linear, by))
}

/// True for an attribute that may be a scale; `taken` says that one is applied, of which it may be a part.
pub(super) fn is_vague(name: &str, number: f64, taken: bool) -> bool {
    let name = name.to_lowercase();
    let nothing = number == 0.0 || number == 1.0 && !matches!(name.as_str(), "offset" | "bias");
    VAGUE.contains(&name.as_str()) && !nothing && !(taken && name == "offset")
}

/// What to say of such an attribute.
pub(super) fn not_applied(name: &str, number: f64) -> String {
    format!(
        "the attribute {name} ({number}) is not applied: if it is of the values, the threshold is in stored numbers"
    )
}
