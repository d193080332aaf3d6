//! A dataset and what is around it: the names of its axes by the conventions of those who write HDF5, and its coordinates.

use crate::grid::length::Length;
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::axes::Names;
use crate::volume::formats::hdf5::image;
use crate::volume::formats::hdf5::tree::{Item, Tree};
use crate::volume::stated::written::{AXES, Held, Written, is_turn, plain};
use hdf5_reader::attribute_api::Attribute;
use hdf5_reader::{Dataset, Hdf5File};

/// Datasets of more numbers state no size of a voxel.
const FEW: u64 = 8;
/// And of more no matrix that places a grid.
const MATRIX: u64 = 16;

/// A dataset and what is around it.
pub(crate) struct Place<'a> {
    pub(crate) file: &'a Hdf5File,
    pub(crate) tree: &'a Tree,
    pub(crate) name: &'a str,
    pub(crate) dataset: &'a Dataset,
    pub(crate) attributes: Attributes,
    /// Of the group that the dataset is in.
    pub(crate) group: Attributes,
}

impl<'a> Place<'a> {
    pub(crate) fn of(
        file: &'a Hdf5File,
        tree: &'a Tree,
        name: &'a str,
        dataset: &'a Dataset,
    ) -> Place<'a> {
        let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
        let group = file.group(folder).and_then(|group| group.attributes());
        Place {
            file,
            tree,
            name,
            dataset,
            attributes: Attributes(dataset.attributes()),
            group: Attributes(group.unwrap_or_default()),
        }
    }

    /// Why an array of the Data Exchange format or of NXtomo is no volume: beside it is an angle, or a kind, of each
    /// image, or it is one of their images for correction.
    pub(crate) fn projections(&self) -> Option<String> {
        let (folder, own) = self.name.rsplit_once('/')?;
        if matches!(own, "data_white" | "data_dark") {
            return Some("these are images without the sample or without the beam".into());
        }
        let shape = self.dataset.shape();
        let many = shape.first().filter(|&&n| n > 1 && shape.len() >= 3)?;
        let beside = |name: &&&str| {
            let found = self.file.dataset(&format!("{folder}/{name}"));
            found.is_ok_and(|found| found.shape() == [*many])
        };
        let name = ["theta", "rotation_angle", "image_key"]
            .iter()
            .find(beside)?;
        let text = "these are projections: there is one";
        Some(format!("{text} {name} beside them for each of {many}"))
    }

    /// The names of the dataset's axes, by every convention that states any.
    pub(crate) fn names(&self) -> Vec<Names> {
        let n = self.dataset.ndim();
        let mut all = Vec::new();
        let attributes = &self.attributes;
        if let Some(text) = attributes.text("axistags") {
            all.extend(axistags(&text).and_then(|tags| {
                let names = tags.into_iter().map(|t| t.0).collect();
                Names::new(names, n, "the attribute axistags")
            }));
        }
        let scales: Vec<String> = (0..n)
            .map(|a| self.scale(a).map_or(String::new(), |s| s.0))
            .collect();
        all.extend(Names::new(scales, n, "the list of dimensions"));
        let of_axes = |a: &&Attribute| AXES.contains(&&*plain(&a.name));
        for Attribute { name, .. } in attributes.0.iter().filter(of_axes) {
            let by = format!("the attribute {name}");
            let texts = attributes.texts(name);
            all.extend(match &texts[..] {
                [one] => Names::split(one, n, &by),
                _ => Names::new(texts, n, &by),
            });
        }
        if self.is_signal() {
            let texts = self.group.texts("axes");
            let by = "the attribute axes of its group";
            all.extend(match &texts[..] {
                [one] => Names::split(one, n, by),
                _ => Names::new(texts, n, by),
            });
        }
        all.extend(self.tuples());
        all.extend(image::names(self));
        all
    }

    /// What to say of attributes that name another number of axes than the dataset has.
    pub(crate) fn other_names(&self) -> Vec<String> {
        let n = self.dataset.ndim();
        let of_axes = |a: &&Attribute| AXES.contains(&&*plain(&a.name));
        let of_axes = self.attributes.0.iter().filter(of_axes);
        let other = of_axes.filter_map(|Attribute { name, .. }| {
            let texts = self.attributes.texts(name);
            let count = texts.len();
            (count > 1 && count != n).then(|| {
                format!(
                    "the attribute {name} ({}) names {count} axes of {n} and is not taken",
                    texts.join(", ")
                )
            })
        });
        other.collect()
    }

    /// The groups that the dataset is in, the nearest first, with what their attributes and small datasets hold.
    pub(crate) fn groups(&self) -> impl Iterator<Item = (String, Written)> {
        let mut name = self.name;
        std::iter::from_fn(move || {
            name = name.rsplit_once('/')?.0;
            let group = self.file.group(name).and_then(|group| group.attributes());
            let mut written = Attributes(group.unwrap_or_default()).written();
            self.beside(name, &mut written);
            let shown = if name.is_empty() { "/" } else { name };
            Some((shown.to_owned(), written))
        })
    }

    /// Adds the datasets of a few numbers in a group, which say what attributes might, with attributes of their own.
    fn beside(&self, group: &str, written: &mut Written) {
        for (name, item) in &self.tree.items {
            let own = name
                .strip_prefix(group)
                .and_then(|own| own.strip_prefix('/'));
            let (Some(own), Item::Dataset(dataset)) = (own.filter(|own| !own.contains('/')), item)
            else {
                continue;
            };
            let most = if is_turn(own) { MATRIX } else { FEW };
            let few = dataset
                .num_elements()
                .is_ok_and(|n| (1..=most).contains(&n));
            if let Some(numbers) = few.then(|| numbers_of(dataset)).flatten() {
                written.add(own, Held::Numbers(numbers));
                written.add_below(own, Attributes(dataset.attributes()).written());
            }
        }
    }

    /// True if a group holds another array of three axes or more, of another shape.
    pub(crate) fn others(&self, group: &str) -> bool {
        let front = format!("{}/", group.trim_end_matches('/'));
        self.tree.items.iter().any(|(name, item)| match item {
            Item::Dataset(other) if name.starts_with(&front) => {
                other.ndim() >= 3 && other.shape() != self.dataset.shape()
            }
            _ => false,
        })
    }

    /// True for the data of a NeXus group of data.
    pub(crate) fn is_signal(&self) -> bool {
        let own = self.name.rsplit('/').next().unwrap_or_default();
        self.group
            .text("signal")
            .is_some_and(|signal| signal == own)
            || (!self.group.has("signal") && self.attributes.has("signal"))
    }

    /// DREAM.3D's tuples, x first, and their components.
    fn tuples(&self) -> Option<Names> {
        let mut tuples = self.attributes.numbers("TupleDimensions")?;
        tuples.reverse();
        let shape = self.dataset.shape();
        let stated = shape.iter().zip(&tuples).all(|(&n, &t)| n as f64 == t);
        (tuples.len() == 3 && shape.len() > 3 && stated).then_some(())?;
        let mut names: Vec<String> = ["z", "y", "x", "c"].map(String::from).into();
        names.resize_with(shape.len(), || "other".into());
        Names::new(names, shape.len(), "the attribute TupleDimensions")
    }

    /// Name and dataset of the dimension scale of an axis.
    fn scale(&self, axis: usize) -> Option<(String, Dataset)> {
        let list = self.attributes.get("DIMENSION_LIST")?;
        let size = self.dataset.vlen_reference_size();
        let reference = list.raw_data.chunks_exact(size).nth(axis)?;
        let bytes = self
            .dataset
            .resolve_vlen_reference_bytes(reference, 8)
            .ok()?;
        let address = u64::from_le_bytes(*bytes.first_chunk()?);
        let (name, dataset) = self.tree.name_at(address)?;
        let own = name.rsplit('/').next().unwrap_or_default();
        Some((own.to_owned(), dataset.clone()))
    }

    /// The dataset of coordinates along an axis, with its name.
    pub(crate) fn coordinates(&self, axis: usize) -> Option<(String, Dataset)> {
        if let Some(found) = self.scale(axis) {
            return Some(found);
        }
        if !self.is_signal() {
            return None;
        }
        let texts = self.group.texts("axes");
        let names = match &texts[..] {
            [one] => Names::split(one, self.dataset.ndim(), "")?.names,
            _ => texts,
        };
        let name = names.get(axis)?.clone();
        let folder = self.name.rsplit_once('/').map_or("", |(folder, _)| folder);
        let dataset = self.file.dataset(&format!("{folder}/{name}")).ok()?;
        Some((name, dataset))
    }
}

/// Key, resolution and unit of each tag of vigra's and ilastik's JSON.
pub(crate) fn axistags(text: &str) -> Option<Vec<(String, f64, String)>> {
    let json: serde_json::Value = serde_json::from_str(text).ok()?;
    let tags = json["axes"].as_array()?.iter().map(|tag| {
        let key = tag["key"].as_str()?.to_owned();
        let unit = tag["description"].as_str().unwrap_or_default().trim();
        let unit = if Length::parse(unit).is_some() {
            unit
        } else {
            ""
        };
        Some((
            key,
            tag["resolution"].as_f64().unwrap_or(0.0),
            unit.to_owned(),
        ))
    });
    tags.collect()
}
