//! What the axes of an array stand for, by their names: one table for HDF5 and Zarr.

use crate::volume::stated::written::axis_letter;

/// What an axis stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// x, y or z: 0, 1 or 2.
    Space(usize),
    Time,
    Channel,
    /// Of projections.
    Angle,
    /// A name that says nothing of these, or none.
    Other,
}

/// x, y and z as messages call them.
pub(crate) const LETTERS: [&str; 3] = ["x", "y", "z"];

/// Names of x, y and z in use: of geometry, of pictures, and of maps.
const SPACE: [&[&str]; 3] = [
    &[
        "x",
        "xspace",
        "width",
        "w",
        "col",
        "cols",
        "column",
        "columns",
        "lon",
        "longitude",
    ],
    &["y", "yspace", "row", "rows", "h", "lat", "latitude"],
    &[
        "z", "zspace", "depth", "d", "plane", "planes", "pln", "slice", "slices", "lev", "level",
        "altitude",
    ],
];
const TIME: &[&str] = &[
    "t",
    "time",
    "times",
    "timepoint",
    "timepoints",
    "frame",
    "frames",
];
const CHANNEL: &[&str] = &[
    "c",
    "ch",
    "channel",
    "channels",
    "band",
    "bands",
    "wavelength",
    "energy",
    "rgb",
    "rgba",
    "sample",
    "samples",
    "s",
    "vector_dimension",
    "component",
    "components",
];
/// Parts of the names of axes along which a sample is turned.
const ANGLE: [&str; 6] = ["theta", "angle", "rotation", "projection", "omega", "phi"];

/// What axes stand for by their names, each of which may depend on the others.
pub(crate) fn roles<'a>(names: impl IntoIterator<Item = &'a str>) -> Vec<Role> {
    let plain = |name: &str| {
        let name = name.trim().to_lowercase();
        name.strip_prefix('/').map_or(name.clone(), str::to_owned)
    };
    let names: Vec<String> = names.into_iter().map(plain).collect();
    let has = |set: &[&str]| names.iter().any(|n| set.contains(&n.as_str()));
    // beside latitudes or y it is z, in pictures y
    let height = if has(SPACE[1]) && !has(SPACE[2]) {
        2
    } else {
        1
    };
    let of_name = |name: &str| {
        let space = SPACE.iter().position(|set| set.contains(&name));
        match space {
            _ if name == "height" => Role::Space(height),
            Some(a) => Role::Space(a),
            None if TIME.contains(&name) => Role::Time,
            None if CHANNEL.contains(&name) => Role::Channel,
            None if ANGLE.iter().any(|part| name.contains(part)) => Role::Angle,
            None => axis_letter(name).map_or(Role::Other, Role::Space),
        }
    };
    names.iter().map(|name| of_name(name)).collect()
}

/// True for a name that writers give to an axis that has none.
pub(crate) fn is_made_up(name: &str) -> bool {
    name.is_empty() || name.starts_with("dim_") || name.starts_with("phony_dim")
}
