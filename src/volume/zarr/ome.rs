//! OME-Zarr: the levels of a pyramid, with the names, units and steps of their axes.
//!
//! <https://ngff.openmicroscopy.org/0.4/> and <https://ngff.openmicroscopy.org/0.5/>.

use crate::error::{Error, Result};
use crate::grid::Unit;
use serde_json::Value;
use std::path::Path;

/// One level of the first pyramid of a group.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Level {
    /// Path of the array inside the group.
    pub(super) path: String,
    /// For each axis its name, unit, step and the place of index 0.
    pub(super) axes: Vec<Axis>,
}

/// An axis of an array.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    pub(super) name: String,
    pub(super) unit: Option<Unit>,
    pub(super) step: f64,
    pub(super) start: f64,
}

/// The levels, finest first; empty if the attributes are not those of a pyramid.
///
/// # Errors
/// [`Error::Format`] if they contradict themselves, [`Error::Unsupported`] for several pyramids.
pub(super) fn levels(path: &Path, attributes: &Value) -> Result<Vec<Level>> {
    let inside = &attributes["ome"]["multiscales"];
    let all = if inside.is_array() {
        inside
    } else {
        &attributes["multiscales"]
    };
    let pyramid = match all.as_array().map(Vec::as_slice) {
        None | Some([]) => return Ok(Vec::new()),
        Some([one]) => one,
        Some(several) => {
            let what = format!("an OME-Zarr of {} pyramids", several.len());
            return Err(Error::unsupported(
                path,
                what,
                "give --dataset with the path of an array",
            ));
        }
    };
    let names = axes(&pyramid["axes"]);
    let wrong = |found: String| Error::format(path, found, "an OME-Zarr pyramid");
    let whole = transformed(&pyramid["coordinateTransformations"]);
    let mut levels = Vec::new();
    for set in pyramid["datasets"].as_array().into_iter().flatten() {
        let inner = set["path"].as_str().unwrap_or_default();
        let parts = inner.split('/');
        if inner.is_empty() || parts.into_iter().any(|p| p.is_empty() || p == "..") {
            return Err(wrong(format!("the path \"{inner}\" of a level")));
        }
        let own = transformed(&set["coordinateTransformations"]);
        let count = names.len().max(own.0.len());
        let at = |list: &[f64], i: usize, default: f64| list.get(i).copied().unwrap_or(default);
        let axes = (0..count).map(|i| {
            let (name, unit) = names.get(i).cloned().unwrap_or_default();
            let (step, start) = (at(&own.0, i, 1.0), at(&own.1, i, 0.0));
            let (more, shift) = (at(&whole.0, i, 1.0), at(&whole.1, i, 0.0));
            Axis {
                name,
                unit,
                step: step * more,
                start: start * more + shift,
            }
        });
        let axes: Vec<Axis> = axes.collect();
        let sound = |a: &Axis| a.step.is_finite() && a.step > 0.0 && a.start.is_finite();
        if !axes.iter().all(sound) {
            return Err(wrong(format!("the scale {:?} of a level", own.0)));
        }
        levels.push(Level {
            path: inner.to_owned(),
            axes,
        });
    }
    match levels.is_empty() {
        true => Err(wrong("a pyramid without levels".into())),
        false => Ok(levels),
    }
}

/// Names and units. In version 0.3 axes are names alone, before that they are always t, c, z, y, x.
fn axes(json: &Value) -> Vec<(String, Option<Unit>)> {
    let Some(list) = json.as_array() else {
        return ["t", "c", "z", "y", "x"]
            .map(|n| (n.to_owned(), None))
            .into();
    };
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    list.iter()
        .map(|axis| match axis.is_string() {
            true => (text(axis), None),
            false => (text(&axis["name"]), text(&axis["unit"]).parse().ok()),
        })
        .collect()
}

/// Scale and translation, one after the other.
fn transformed(json: &Value) -> (Vec<f64>, Vec<f64>) {
    let (mut scale, mut shift): (Vec<f64>, Vec<f64>) = Default::default();
    for step in json.as_array().into_iter().flatten() {
        let list = |name: &str| -> Vec<f64> {
            let values = step[name].as_array().into_iter().flatten();
            values.map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
        };
        match step["type"].as_str() {
            Some("scale") => scale = list("scale"),
            Some("translation") => shift = list("translation"),
            _ => {}
        }
    }
    (scale, shift)
}
