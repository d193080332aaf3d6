//! Zarr of version 2 and 3 in a folder: one array, or an OME-Zarr pyramid.
//!
//! The volume is the last three axes (z, y, x), or those of these names; others must have one entry.
//! Only the chunks that are asked for are read and unpacked.

mod chunk;
mod codec;
mod meta;
mod ome;

use super::layout::{Recipe, Samples};
use super::open::OpenOptions;
use super::paged::MAX_CHUNK;
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Unit};
use crate::manifest::{Origin, Provenance};
use chunk::ZarrChunks;
use meta::{Array, Meta};
use ome::{Axis, Level};
use serde_json::Value;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Longer metadata are damaged.
const MAX_JSON: u64 = 16 << 20;
/// Groups in groups beyond this are not looked into.
const MAX_DEPTH: u32 = 6;
/// More arrays than a message can name.
const MAX_ARRAYS: usize = 200;

/// True for a folder that holds an array or group.
pub(super) fn is_zarr(path: &Path) -> bool {
    [".zarray", ".zgroup", "zarr.json"]
        .iter()
        .any(|name| path.join(name).is_file())
}

/// What a folder holds.
enum Node {
    Array(Box<Array>),
    Group(Value),
    Nothing,
}

/// The JSON of a file; `None` if there is none.
fn json(path: &Path) -> Result<Option<Value>> {
    let fail = |e| Error::io(path, "read", e);
    let file = match File::open(path) {
        Ok(file) => file,
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(e) => return Err(fail(e)),
    };
    let mut bytes = Vec::new();
    file.take(MAX_JSON).read_to_end(&mut bytes).map_err(fail)?;
    let value = serde_json::from_slice(&bytes)
        .map_err(|e| Error::format(path, format!("metadata with {e}"), "JSON"))?;
    Ok(Some(value))
}

/// Looks at a folder.
fn node(folder: &Path) -> Result<Node> {
    let path = folder.join("zarr.json");
    if let Some(json) = json(&path)? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return match json["node_type"].as_str() {
            Some("array") => Ok(Node::Array(Box::new(meta.version_3()?))),
            Some("group") => Ok(Node::Group(json["attributes"].clone())),
            other => Err(Error::format(
                &path,
                format!("{other:?}"),
                "an array or group",
            )),
        };
    }
    let path = folder.join(".zarray");
    if let Some(json) = json(&path)? {
        let meta = Meta {
            path: &path,
            json: &json,
        };
        return Ok(Node::Array(Box::new(meta.version_2()?)));
    }
    if !folder.join(".zgroup").is_file() {
        return Ok(Node::Nothing);
    }
    let attributes = json(&folder.join(".zattrs"))?;
    Ok(Node::Group(attributes.unwrap_or(Value::Null)))
}

/// Opens the array in a folder, or the one in its groups that the options name.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several arrays or levels and none is named rightly;
/// [`Error::Unsupported`] by name for types and codecs, [`Error::Format`] for damaged metadata.
pub(super) fn parse(path: &Path, options: &OpenOptions) -> Result<Recipe> {
    let mut folder = path.to_path_buf();
    if let Some(name) = &options.dataset {
        if name.split('/').any(|part| part == "..") {
            return Err(Error::usage("--dataset", name, "a path inside the Zarr"));
        }
        folder.push(name.trim_matches('/'));
    }
    match node(&folder)? {
        Node::Array(array) => {
            no_level(options)?;
            recipe(path, folder, *array, None, Vec::new())
        }
        Node::Group(attributes) => {
            let levels = ome::levels(&folder, &attributes)?;
            if levels.is_empty() {
                no_level(options)?;
                return only(path, &folder);
            }
            level(path, &folder, levels, options.level.unwrap_or(0))
        }
        Node::Nothing => {
            let found = options.dataset.as_deref().unwrap_or_default();
            let names = arrays(path, path)?.join(", ");
            Err(Error::usage("--dataset", found, format!("one of {names}")))
        }
    }
}

fn no_level(options: &OpenOptions) -> Result<()> {
    match options.level {
        Some(level) => Err(Error::usage(
            "--level",
            level.to_string(),
            "it with an OME-Zarr pyramid",
        )),
        None => Ok(()),
    }
}

/// A level of a pyramid.
fn level(path: &Path, folder: &Path, levels: Vec<Level>, wanted: u32) -> Result<Recipe> {
    let count = levels.len();
    let Some(level) = levels.into_iter().nth(wanted as usize) else {
        let expected = format!("0 to {}, as {} has levels", count - 1, path.display());
        return Err(Error::usage("--level", wanted.to_string(), expected));
    };
    let inner = folder.join(&level.path);
    let Node::Array(array) = node(&inner)? else {
        return Err(Error::format(inner, "no array", "a level of the pyramid"));
    };
    let note = format!("level {wanted} of {count} (0 is the finest)");
    recipe(path, inner, *array, Some(level.axes), vec![note])
}

/// The only array with a volume in a group.
fn only(path: &Path, folder: &Path) -> Result<Recipe> {
    let names = arrays(folder, folder)?;
    let [name] = &names[..] else {
        if names.is_empty() {
            let found = "a Zarr group without an array of 3 axes";
            return Err(Error::format(path, found, "a volume"));
        }
        let found = format!("nothing, and {} arrays in {}", names.len(), path.display());
        let expected = format!("one of {}", names.join(", "));
        return Err(Error::usage("--dataset", found, expected));
    };
    let inner = folder.join(name);
    match node(&inner)? {
        Node::Array(array) => {
            let note = format!("array {name}");
            recipe(path, inner, *array, None, vec![note])
        }
        _ => Err(Error::format(inner, "no array", "an array")),
    }
}

/// Paths of the arrays below a folder that could be volumes.
fn arrays(root: &Path, folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    let mut folders = vec![(folder.to_path_buf(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        match node(&folder) {
            Ok(Node::Array(array)) => {
                if volume_axes(&array.shape, &array.names).is_some() && names.len() < MAX_ARRAYS {
                    let name = folder.strip_prefix(root).unwrap_or(&folder);
                    names.push(name.display().to_string());
                }
                continue;
            }
            // an array that is not read is not the one that is meant, unless it is named
            Err(_) => continue,
            Ok(_) => {}
        }
        let fail = |e| Error::io(&folder, "list", e);
        for entry in std::fs::read_dir(&folder).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            if depth < MAX_DEPTH && entry.file_type().map_err(fail)?.is_dir() {
                folders.push((entry.path(), depth + 1));
            }
        }
    }
    names.sort();
    Ok(names)
}

/// Which axes are x, y and z: those of these names, else the last ones. `None` if there are too few
/// or another one has more than one entry.
fn volume_axes(shape: &[u64], names: &[String]) -> Option<[usize; 3]> {
    let named = |name: &str| names.iter().position(|n| n.eq_ignore_ascii_case(name));
    let n = shape.len();
    let axes = match (named("x"), named("y"), named("z")) {
        (Some(x), Some(y), Some(z)) if names.len() == n => [x, y, z],
        _ if n >= 3 => [n - 1, n - 2, n - 3],
        _ => return None,
    };
    let single = |i: usize| axes.contains(&i) || shape[i] == 1;
    (0..n).all(single).then_some(axes)
}

fn recipe(
    path: &Path,
    folder: PathBuf,
    array: Array,
    axes: Option<Vec<Axis>>,
    notes: Vec<String>,
) -> Result<Recipe> {
    let names = match &axes {
        Some(axes) => axes.iter().map(|a| a.name.clone()).collect(),
        None => array.names.clone(),
    };
    let Some([x, y, z]) = volume_axes(&array.shape, &names) else {
        let what = format!("a Zarr array of shape {:?}", array.shape);
        let hint = "volumes have 3 axes with more than one entry: save one channel and time as an \
                    array of its own";
        return Err(Error::unsupported(path, what, hint));
    };
    let dims = Dims::new([x, y, z].map(|a| array.shape[a]))
        .map_err(|e| Error::format(path, format!("an array with {e}"), "a volume"))?;
    let sample = if array.half {
        2
    } else {
        array.dtype.bytes() as u64
    };
    let chunk = array
        .chunk
        .iter()
        .try_fold(sample, |n, &c| n.checked_mul(c));
    let Some(bytes) = chunk.filter(|&n| n <= MAX_CHUNK) else {
        let what = format!("a Zarr array with chunks of {:?}", array.chunk);
        return Err(Error::unsupported(
            path,
            what,
            "write it anew with smaller chunks",
        ));
    };
    let (placement, provenance) = place(axes.as_deref(), [x, y, z]);
    let (dtype, endian) = (array.dtype, array.coding.endian);
    let chunks = ZarrChunks::new(folder, array, dims, [x, y, z], bytes as usize);
    Ok(Recipe {
        endian: Some(endian),
        placement,
        provenance,
        notes,
        ..Recipe::new("zarr", dims, dtype, Samples::Chunks(Box::new(chunks)))
    })
}

/// Steps and units of the axes x, y and z; a unit only if it is the same for all.
fn place(axes: Option<&[Axis]>, volume: [usize; 3]) -> (Placement, Provenance) {
    let mut place = Placement::default();
    let mut from = Provenance::default();
    let axes = axes.and_then(|axes| {
        let [x, y, z] = volume.map(|a| axes.get(a));
        Some([x?, y?, z?])
    });
    let Some(axes) = axes else {
        return (place, from);
    };
    let units = axes.map(|a| a.unit.filter(|u| *u != Unit::Voxel));
    place.spacing = axes.map(|a| a.step);
    place.origin = axes.map(|a| a.start);
    (from.spacing, from.origin) = ([Origin::File; 3], Origin::File);
    if let [Some(unit), b, c] = units
        && (b, c) == (Some(unit), Some(unit))
    {
        place.unit = unit;
        from.unit = Origin::File;
    }
    (place, from)
}
