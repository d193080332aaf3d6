//! Which dataset of a file is meant, and what to say of the others.

use crate::error::{Error, Result};
use crate::volume::formats::hdf5::attributes::Attributes;
use crate::volume::formats::hdf5::axes::Axes;
use crate::volume::formats::hdf5::number::Number;
use crate::volume::formats::hdf5::place::Place;
use crate::volume::formats::hdf5::series::{self, Kind, Member};
use crate::volume::formats::hdf5::tree::{Item, Tree};
use crate::volume::formats::hdf5::{broken, described, judged, meaning};
use crate::volume::options::OpenOptions;
use hdf5_reader::error::Error as H5Error;
use hdf5_reader::{Dataset, Hdf5File};
use std::path::Path;

/// Names that a message lists.
const LISTED: usize = 30;

/// The dataset that is read.
pub(crate) struct Chosen {
    pub(crate) name: String,
    pub(crate) dataset: Dataset,
    pub(crate) how: (Number, Axes),
    /// Time and channel were chosen with the dataset.
    pub(crate) by_parts: bool,
    pub(crate) notes: Vec<String>,
}

/// The dataset that the options name, or the one that is a volume.
///
/// # Errors
/// [`Error::Usage`] with a list if there are several or none of the name, [`Error::Unsupported`] and
/// [`Error::Format`] for what is not read or damaged.
pub(crate) fn chosen(
    path: &Path,
    file: &Hdf5File,
    tree: &Tree,
    options: &OpenOptions,
) -> Result<Chosen> {
    if let Some(name) = &options.dataset {
        no_level(options)?;
        return named(path, file, tree, name);
    }
    if let Some((name, notes)) = series::choose(path, tree, options)? {
        let mut found = named(path, file, tree, &name)?;
        found.notes = notes;
        found.by_parts = Member::of(&name).is_some_and(|m| m.kind != Kind::Minc);
        return Ok(found);
    }
    no_level(options)?;
    only(path, file, tree)
}

fn no_level(options: &OpenOptions) -> Result<()> {
    match options.level {
        None => Ok(()),
        Some(level) => {
            let expected = "it with a file of several levels, and without --dataset";
            Err(Error::usage("--level", level.to_string(), expected))
        }
    }
}

/// The dataset of a name.
fn named(path: &Path, file: &Hdf5File, tree: &Tree, name: &str) -> Result<Chosen> {
    let full = format!("/{}", name.trim_matches('/'));
    let item = tree.items.iter().find(|(name, _)| *name == full);
    let (full, dataset) = match item.map(|(_, item)| item) {
        Some(Item::Dataset(dataset)) => (full, Dataset::clone(dataset)),
        Some(Item::Broken(error)) => return Err(broken(path, name, error)),
        Some(Item::External { file, path: of }) => {
            let what = format!("the link {name} to {of} of another file");
            return Err(Error::unsupported(
                path,
                what,
                format!("open {file} with --dataset {of}"),
            ));
        }
        Some(Item::Dangling(to)) => {
            let found = format!("the link {name} to {to}, which is not there");
            return Err(Error::format(path, found, "a dataset"));
        }
        // perhaps another name of one that is in the tree
        None => match file.dataset(name) {
            Ok(dataset) => {
                let own = tree
                    .name_at(dataset.address())
                    .map(|(name, _)| name.to_owned());
                (own.unwrap_or(full), dataset)
            }
            Err(H5Error::DatasetNotFound(_) | H5Error::GroupNotFound(_)) => {
                return Err(Error::usage("--dataset", name, list(file, tree)));
            }
            Err(e) if e.to_string().contains("not found") => {
                return Err(Error::usage("--dataset", name, list(file, tree)));
            }
            Err(e) => return Err(broken(path, name, &e)),
        },
    };
    let place = Place::of(file, tree, &full, &dataset);
    let how = judged(&place).map_err(|reason| {
        let what = format!("the HDF5 dataset {full}, {}", described(&place));
        Error::unsupported(path, what, format!("{reason}{}", advice(&reason)))
    })?;
    Ok(Chosen {
        name: full,
        dataset,
        how,
        by_parts: false,
        notes: Vec::new(),
    })
}

/// What to do about axes that are not known.
fn advice(reason: &str) -> &'static str {
    match reason.contains("does not state which") {
        true => {
            ": name them by the attribute DIMENSION_LABELS (as z, y, x, c) and give --channel or --time, or save \
             one channel or time as a dataset of its own"
        }
        false => "",
    }
}

/// The only volume of a file, or the one that it calls its default.
fn only(path: &Path, file: &Hdf5File, tree: &Tree) -> Result<Chosen> {
    let mut volumes: Vec<Chosen> = Vec::new();
    let mut unread = Vec::new();
    for (name, item) in &tree.items {
        match item {
            Item::Dataset(dataset) => {
                let place = Place::of(file, tree, name, dataset);
                if let Ok(how) = judged(&place) {
                    volumes.push(Chosen {
                        name: name.clone(),
                        dataset: Dataset::clone(dataset),
                        how,
                        by_parts: false,
                        notes: Vec::new(),
                    });
                }
            }
            Item::Broken(error) => unread.push((name, meaning(error).0)),
            _ => {}
        }
    }
    if volumes.len() > 1
        && let Some(default) = default(file)
        && let Some(at) = volumes.iter().position(|v| v.name == default)
    {
        let count = volumes.len();
        let mut found = volumes.swap_remove(at);
        found.notes.push(format!(
            "the file's default of {count} volumes: --dataset reads another one"
        ));
        return Ok(found);
    }
    let first = tree.items.first();
    match (volumes.len(), &tree.items[..]) {
        (1, _) => {
            let mut found = volumes.swap_remove(0);
            let lines = unread
                .iter()
                .take(LISTED)
                .map(|(name, what)| format!("{name} is not read: {what}"));
            found.notes.extend(lines);
            Ok(found)
        }
        (0, [(name, Item::Broken(error))]) => Err(broken(path, name, error)),
        (0, [(name, Item::Dataset(_))]) if first.is_some() => named(path, file, tree, name),
        (0, []) => Err(Error::format(path, "HDF5 without a dataset", "a volume")),
        (0, _) => Err(Error::format(
            path,
            "HDF5 without a volume",
            format!(
                "a dataset of three axes of numbers, but it has{}",
                lines(file, tree)
            ),
        )),
        (n, _) => {
            let found = format!("nothing, and {n} volumes in {}", path.display());
            Err(Error::usage("--dataset", found, list(file, tree)))
        }
    }
}

/// The dataset that NeXus files name as what to show first.
fn default(file: &Hdf5File) -> Option<String> {
    let mut group = file.root_group().ok()?;
    let mut path = String::new();
    for _ in 0..16 {
        let attributes = Attributes(group.attributes().ok()?);
        if let Some(next) = attributes.text("default") {
            path = match next.strip_prefix('/') {
                Some(whole) => format!("/{}", whole.trim_matches('/')),
                None => format!("{path}/{}", next.trim_matches('/')),
            };
            group = file.group(&path).ok()?;
        } else {
            let signal = attributes.text("signal")?;
            return Some(format!("{path}/{signal}"));
        }
    }
    None
}

fn list(file: &Hdf5File, tree: &Tree) -> String {
    format!("one of{}", lines(file, tree))
}

/// Everything that is in a file: volumes first, then what is larger, each with what keeps it from being a volume.
fn lines(file: &Hdf5File, tree: &Tree) -> String {
    let mut all: Vec<(bool, u64, String)> = Vec::new();
    for (name, item) in &tree.items {
        let (volume, size, text) = match item {
            Item::Dataset(dataset) => {
                let place = Place::of(file, tree, name, dataset);
                let size = dataset.num_elements().unwrap_or(0);
                match judged(&place) {
                    Ok(_) => (true, size, described(&place)),
                    Err(reason) => (
                        false,
                        size,
                        format!("{}, no volume: {reason}", described(&place)),
                    ),
                }
            }
            Item::Broken(error) => (false, 0, format!("not read: {}", meaning(error).0)),
            Item::External { file, path } => (
                false,
                0,
                format!("a link to {path} of another file, {file}: open that one"),
            ),
            Item::Dangling(to) => (false, 0, format!("a link to {to}, which is not there")),
        };
        all.push((!volume, u64::MAX - size, format!("\n  {name}: {text}")));
    }
    // by name among volumes and among what has the same size
    all.sort_by_key(|(other, size, _)| (*other, if *other { *size } else { 0 }));
    let more = all.len().saturating_sub(LISTED);
    let mut text: String = all
        .iter()
        .take(LISTED)
        .map(|(.., line)| line.as_str())
        .collect();
    if more > 0 || tree.cut {
        text += &format!(
            "\n  and {more} more{}",
            if tree.cut { " at least" } else { "" }
        );
    }
    text
}
