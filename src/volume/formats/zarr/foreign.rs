//! Attributes of other writers than those of Zarr's own conventions: what they state is applied or refused.

use crate::error::{Error, Result};
use crate::volume::adapters::values::Values;
use crate::volume::formats::zarr::meta::Array;
use crate::volume::formats::zarr::store::{MAX_DEPTH, Node, node};
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{self, AXES, Grid, SizeFound, Written, plain};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Names in a group beyond these are not looked at.
const MAX_LOOKED_AT: usize = 256;

/// Checks that no attribute states another order of the axes than z, y, x.
///
/// # Errors
/// [`Error::Unsupported`] with the attribute's name if one does.
pub(crate) fn no_other_order(folder: &Path, array: &Array) -> Result<()> {
    let hint = "name its axes in `_ARRAY_DIMENSIONS` (Zarr 2) or `dimension_names` (Zarr 3)";
    for (name, value) in array.attributes.as_object().into_iter().flatten() {
        if name != "axistags" && !AXES.contains(&&*plain(name)) {
            continue;
        }
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
            return Err(Error::unsupported(folder, what, hint));
        }
    }
    match written(&array.attributes).vague_order() {
        Some(why) => {
            let what = format!("a Zarr array whose order of axes cannot be told: {why}");
            Err(Error::unsupported(folder, what, hint))
        }
        None => Ok(()),
    }
}

/// The keys of the tags of axes, one after the other.
fn keys(tags: &Value) -> String {
    let axes = tags["axes"].as_array().into_iter().flatten();
    axes.filter_map(|axis| axis["key"].as_str()).collect()
}

/// The values by CF's attributes, with a scale that others state by pairs of names. Warns of attributes whose meaning
/// cannot be told.
///
/// # Errors
/// [`Error::Unsupported`] if two scales are stated, or a part of one is no number.
pub(crate) fn scale(
    folder: &Path,
    array: &Array,
    cf: Option<Values>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Values>> {
    let no = |what: String| {
        let hint = "write the values themselves, or remove the attribute";
        Error::unsupported(folder, format!("a Zarr array with {what}"), hint)
    };
    let written = written(&array.attributes);
    let pair = written.pair().map_err(no)?;
    written.vague(pair.is_some(), "", warnings);
    for (group, attributes) in groups(folder) {
        attributes.vague(
            false,
            &format!(" of the group {}", name_of(&group)),
            warnings,
        );
    }
    written::with_scale(cf, pair).map_err(no)
}

/// What attributes hold.
fn written(json: &Value) -> Written {
    let mut written = Written::default();
    written.add_json("", json);
    written
}

/// The groups that an array is in, the nearest first, with their attributes.
fn groups(folder: &Path) -> impl Iterator<Item = (PathBuf, Written)> {
    let above = folder.ancestors().skip(1).take(MAX_DEPTH);
    above.map_while(|group| match node(group) {
        Ok(Node::Group(attributes)) => Some((group.to_path_buf(), written(&attributes))),
        _ => None,
    })
}

/// The last part of a path.
fn name_of(folder: &Path) -> String {
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    name.to_string_lossy().into_owned()
}

/// The size of a voxel by the attributes of an array, or of the nearest group that states any.
pub(crate) fn size(folder: &Path, array: &Array, grid: Grid) -> SizeFound {
    let mut found = written::size(&written(&array.attributes), grid, "");
    for (group, attributes) in groups(folder) {
        if found.steps.is_some() || !found.warnings.is_empty() {
            break;
        }
        let of = format!(" of the group {}", name_of(&group));
        found = written::size(&attributes, grid, &of);
        if found.steps.is_some() && others(&group, array) {
            found = found.of_several();
        }
    }
    found
}

/// Warns of attributes that may place or turn the grid and are not applied.
pub(crate) fn placed(folder: &Path, array: &Array, warnings: &mut Vec<Warning>) {
    written(&array.attributes).placed("", warnings);
    for (group, attributes) in groups(folder) {
        let of = format!(" of the group {}", name_of(&group));
        attributes.placed(&of, warnings);
    }
}

/// True if a group holds another array of three axes or more, of another shape.
fn others(group: &Path, array: &Array) -> bool {
    let inside = crate::store::list(group).into_iter().flatten().flatten();
    inside
        .take(MAX_LOOKED_AT)
        .any(|entry| match node(&group.join(entry.name)) {
            Ok(Node::Array(other)) => other.shape.len() >= 3 && other.shape != array.shape,
            _ => false,
        })
}
