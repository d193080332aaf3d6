//! Zarr of version 2 and 3 in a folder: one array, or an OME-Zarr pyramid.
//!
//! The volume is the axes z, y and x, by the names that OME-Zarr, xarray or the array itself states, or else the last
//! ones; of channels and times one is read, others must have one entry. Sizes are those of OME-Zarr or of xarray's
//! coordinates, values those of the CF conventions. Only the chunks that are asked for are read and unpacked.

mod axes;
mod chunk;
mod codec;
mod coordinates;
mod count;
mod descriptor;
mod files;
mod filter;
mod find;
mod foreign;
mod kind;
mod meta;
mod ome;
mod place;
mod small;
mod store;
mod transform;

use crate::error::{Error, Result};
use crate::volume::descriptor::VolumeDescriptor;
use crate::volume::format::Format;
use crate::volume::formats::optional;
use crate::volume::options::OpenOptions;
use descriptor::Source;
use find::Found;
use meta::Array;
use ome::Pyramid;
use std::path::{Path, PathBuf};
use store::{Node, node};

/// The format.
pub(crate) const FORMAT: Format = Format {
    looks: Some(|path, _| store::is_zarr(path)),
    parse: Some(|input, options| parse(input.path, options)),
    ..optional::zarr::FORMAT
};

/// Opens the array in a folder, or the one in its groups that the options name.
///
/// # Errors
/// [`Error::Usage`] with the list if there are several arrays, levels, channels or times and none is named rightly;
/// [`Error::Unsupported`] by name for types, codecs and transformations, [`Error::Format`] for damaged metadata.
pub(crate) fn parse(path: &Path, options: &OpenOptions) -> Result<VolumeDescriptor> {
    let root = store::absolute(path)?;
    let mut folder = root.clone();
    if let Some(name) = &options.dataset {
        if name.split('/').any(|part| part == "..") {
            return Err(Error::usage("--dataset", name, "a path inside the Zarr"));
        }
        folder.push(name.trim_matches('/'));
    }
    let opening = Opening { path, options };
    match node(&folder)? {
        Node::Array(array) => opening.array(folder, *array, Vec::new()),
        Node::Group(attributes) => {
            let pyramids = ome::pyramids(&folder, &attributes)?;
            opening.group(&root, &folder, pyramids)
        }
        Node::Nothing => {
            let found = options.dataset.as_deref().unwrap_or_default();
            let names = Found::below(&root)?.list();
            Err(Error::usage("--dataset", found, format!("one of {names}")))
        }
    }
}

/// What is opened, and how.
struct Opening<'a> {
    path: &'a Path,
    options: &'a OpenOptions,
}

impl Opening<'_> {
    /// The pyramid of a group, or the only volume in the groups below it.
    fn group(
        &self,
        root: &Path,
        folder: &Path,
        mut pyramids: Vec<Pyramid>,
    ) -> Result<VolumeDescriptor> {
        if pyramids.len() == 1 {
            return self.level(folder, pyramids.swap_remove(0), Vec::new());
        }
        let inner = |name: &str| {
            let whole = folder.join(name);
            let inner = whole.strip_prefix(root).unwrap_or(&whole);
            inner.display().to_string()
        };
        let which = |count: String, names: String| {
            let found = format!("nothing, and {count} in {}", self.path.display());
            Err(Error::usage("--dataset", found, format!("one of {names}")))
        };
        if pyramids.len() > 1 {
            let first = pyramids.iter().map(|p| inner(&p.levels[0].path));
            let names: Vec<String> = first.collect();
            return which(format!("{} pyramids", names.len()), find::listed(&names));
        }
        let found = Found::below(folder)?;
        let name = match (&found.pyramids[..], &found.arrays[..]) {
            ([], []) => return Err(found.nothing(self.path)),
            ([name], []) | ([], [name]) => name,
            (several, arrays) => {
                let count = match (several.len(), arrays.len()) {
                    (0, n) => format!("{n} arrays"),
                    (n, 0) => format!("{n} pyramids"),
                    (n, m) => format!("{n} pyramids and {m} arrays beside them"),
                };
                let names = [several, arrays].concat();
                let names: Vec<String> = names.iter().map(|name| inner(name)).collect();
                return which(count, find::listed(&names));
            }
        };
        let whole = folder.join(name);
        match node(&whole)? {
            Node::Array(array) => self.array(whole, *array, vec![format!("array {}", inner(name))]),
            Node::Group(attributes) => {
                let mut pyramids = ome::pyramids(&whole, &attributes)?;
                match pyramids.len() {
                    1 => self.level(
                        &whole,
                        pyramids.swap_remove(0),
                        vec![format!("pyramid {}", inner(name))],
                    ),
                    _ => self.group(root, &whole, pyramids),
                }
            }
            Node::Nothing => Err(Error::format(whole, "no array", "an array")),
        }
    }

    /// A level of a pyramid.
    fn level(
        &self,
        group: &Path,
        mut pyramid: Pyramid,
        mut notes: Vec<String>,
    ) -> Result<VolumeDescriptor> {
        let count = pyramid.levels.len();
        let wanted = self.options.level.unwrap_or(0);
        if wanted as usize >= count {
            let expected = format!("0 to {}, as {} has levels", count - 1, self.path.display());
            return Err(Error::usage("--level", wanted.to_string(), expected));
        }
        let level = pyramid.levels.swap_remove(wanted as usize);
        let inner = group.join(&level.path);
        let Node::Array(array) = node(&inner)? else {
            return Err(Error::format(inner, "no array", "a level of the pyramid"));
        };
        notes.push(format!("level {wanted} of {count} (0 is the finest)"));
        let source = Source {
            folder: inner,
            array: *array,
            stated: Some(level.place),
            notes,
            warnings: pyramid.warnings,
        };
        source.descriptor(self.path, self.options)
    }

    /// An array by itself, which may be a level of a pyramid in a group above.
    fn array(
        &self,
        folder: PathBuf,
        array: Array,
        mut notes: Vec<String>,
    ) -> Result<VolumeDescriptor> {
        if let Some(level) = self.options.level {
            let expected = "it with an OME-Zarr pyramid";
            return Err(Error::usage("--level", level.to_string(), expected));
        }
        let Some((mut pyramid, place)) = find::above(&folder)? else {
            let source = Source {
                folder,
                array,
                stated: None,
                notes,
                warnings: Vec::new(),
            };
            return source.descriptor(self.path, self.options);
        };
        let count = pyramid.levels.len();
        notes.push(format!(
            "level {place} of {count} (0 is the finest) of the pyramid above it"
        ));
        let level = pyramid.levels.swap_remove(place);
        let source = Source {
            folder,
            array,
            stated: Some(level.place),
            notes,
            warnings: pyramid.warnings,
        };
        source.descriptor(self.path, self.options)
    }
}
