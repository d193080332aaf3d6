//! What a hierarchy holds, and what is stated of an array by the groups above it.

use crate::error::{Error, Result};
use crate::store;
use crate::volume::formats::folder::natural;
use crate::volume::formats::zarr::axes::{self, Axis};
use crate::volume::formats::zarr::meta::Array;
use crate::volume::formats::zarr::ome::{self, Pyramid};
use crate::volume::formats::zarr::store::{MAX_DEPTH, Node, node};
use std::path::Path;

/// More volumes and folders than are looked for.
const MAX_FOUND: usize = 10_000;
/// Names that a message lists.
const LISTED: usize = 30;

/// What is found below a group.
#[derive(Debug, Default)]
pub(crate) struct Found {
    /// Paths of pyramids, and of arrays beside them that may be volumes, in natural order.
    pub(crate) pyramids: Vec<String>,
    pub(crate) arrays: Vec<String>,
    /// Other arrays with their axes, and why some cannot be read.
    others: Vec<String>,
}

impl Found {
    /// Looks through all groups below a folder; levels of pyramids are not listed.
    pub(crate) fn below(root: &Path) -> Result<Found> {
        let mut found = Found::default();
        let mut folders = vec![(root.to_path_buf(), 0)];
        let mut count = 0;
        while let Some((folder, depth)) = folders.pop() {
            let inner = folder.strip_prefix(root).unwrap_or(&folder);
            let name = inner.display().to_string();
            match node(&folder) {
                Ok(Node::Array(array)) => {
                    found.array(name, &array);
                    continue;
                }
                Ok(Node::Group(attributes)) if depth > 0 && ome::has_pyramids(&attributes) => {
                    found.pyramids.push(name);
                    continue;
                }
                // an array that is not read is not the one that is meant, unless it is named
                Err(e) if depth > 0 => {
                    found.others.push(format!("{name} ({e})"));
                    continue;
                }
                Err(e) => return Err(e),
                Ok(_) => {}
            }
            let fail = |e| Error::io(&folder, "list", e);
            for entry in store::list(&folder).map_err(fail)? {
                let entry = entry.map_err(fail)?;
                count += 1;
                let path = folder.join(entry.name);
                // links are followed
                let is_dir = entry.is_dir || entry.is_link && path.is_dir();
                if depth < MAX_DEPTH && count < MAX_FOUND && is_dir {
                    folders.push((path, depth + 1));
                }
            }
        }
        for names in [&mut found.pyramids, &mut found.arrays, &mut found.others] {
            names.sort_by(|a, b| natural(a, b));
        }
        Ok(found)
    }

    fn array(&mut self, name: String, array: &Array) {
        let axes = axes_of(array);
        if axes::may_be_volume(&axes) {
            self.arrays.push(name);
        } else {
            self.others.push(format!("{name} ({})", axes::list(&axes)));
        }
    }

    /// Pyramids and arrays, for messages.
    pub(crate) fn list(&self) -> String {
        listed(&[&self.pyramids[..], &self.arrays].concat())
    }

    /// That there are none.
    pub(crate) fn nothing(&self, path: &Path) -> Error {
        let found = match self.others.is_empty() {
            true => "a Zarr group without an array".to_owned(),
            false => format!(
                "a Zarr group whose arrays are no volumes: {}",
                listed(&self.others)
            ),
        };
        Error::format(path, found, "a volume: an array with the axes z, y and x")
    }
}

/// Names, but not too many.
pub(crate) fn listed(names: &[String]) -> String {
    let more = match names.len().saturating_sub(LISTED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    let names = &names[..names.len().min(LISTED)];
    format!("{}{more}", names.join(", "))
}

/// What the groups above state of the array in a folder: the pyramid, and which of its levels it is.
pub(crate) fn above(folder: &Path) -> Result<Option<(Pyramid, usize)>> {
    for group in folder.ancestors().skip(1).take(MAX_DEPTH) {
        let attributes = match node(group) {
            Ok(Node::Group(attributes)) => attributes,
            Ok(Node::Nothing) => continue,
            _ => return Ok(None),
        };
        let inner = folder.strip_prefix(group).unwrap_or(folder);
        for pyramid in ome::pyramids(group, &attributes)? {
            let place = pyramid
                .levels
                .iter()
                .position(|level| Path::new(&level.path) == inner);
            if let Some(place) = place {
                return Ok(Some((pyramid, place)));
            }
        }
    }
    Ok(None)
}

/// The axes of an array by its own names.
fn axes_of(array: &Array) -> Vec<Axis> {
    let axis = |(i, &size): (usize, &u64)| Axis {
        name: array.names.get(i).cloned().unwrap_or_default(),
        kind: String::new(),
        size,
    };
    array.shape.iter().enumerate().map(axis).collect()
}
