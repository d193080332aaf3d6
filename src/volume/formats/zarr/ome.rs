//! OME-Zarr: the levels of pyramids, with their axes and where these lie.
//!
//! <https://ngff.openmicroscopy.org/0.4/>, <https://ngff.openmicroscopy.org/0.5/> and
//! <https://ngff.openmicroscopy.org/0.6/>.

use crate::error::{Error, Result};
use crate::volume::formats::zarr::transform::{Affine, Reader};
use crate::volume::stated::warning::Warning;
use serde_json::Value;
use std::path::Path;

/// Versions whose metadata are understood.
const VERSIONS: [&str; 6] = ["0.1", "0.2", "0.3", "0.4", "0.5", "0.6"];

/// A pyramid of a group.
#[derive(Debug)]
pub(crate) struct Pyramid {
    /// Finest first; at least one.
    pub(crate) levels: Vec<Level>,
    /// What is stated and not taken.
    pub(crate) warnings: Vec<Warning>,
}

/// One level of a pyramid.
#[derive(Debug)]
pub(crate) struct Level {
    /// Path of the array inside the group.
    pub(crate) path: String,
    pub(crate) place: Stated,
}

/// Where an array lies, as its pyramid states it.
#[derive(Debug)]
pub(crate) struct Stated {
    /// Axes of the coordinates that indices are turned into; those of the array if nothing turns them.
    pub(crate) axes: Vec<OmeAxis>,
    /// Nothing is said of the axes: they are those of the first versions.
    pub(crate) usual: bool,
    /// From indices to coordinates; none if that is not stated.
    pub(crate) affine: Result<Option<Affine>>,
}

/// An axis of coordinates.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct OmeAxis {
    pub(crate) name: String,
    /// `space`, `time`, `channel` or another word; empty if not stated.
    pub(crate) kind: String,
    pub(crate) unit: String,
}

/// The pyramids of a group; none if the attributes have no such.
///
/// # Errors
/// [`Error::Format`] if they contradict themselves.
pub(crate) fn pyramids(group: &Path, attributes: &Value) -> Result<Vec<Pyramid>> {
    let ome = &attributes["ome"];
    let (all, version) = match ome["multiscales"].is_array() {
        true => (&ome["multiscales"], &ome["version"]),
        false => (&attributes["multiscales"], &Value::Null),
    };
    let list = all.as_array().into_iter().flatten();
    list.map(|json| {
        let reader = Multiscale { group, json };
        let version = version.as_str().or(json["version"].as_str());
        reader.pyramid(version.unwrap_or_default())
    })
    .collect()
}

/// True if attributes are those of a group with pyramids.
pub(crate) fn has_pyramids(attributes: &Value) -> bool {
    let some = |v: &Value| v["multiscales"].as_array().is_some_and(|l| !l.is_empty());
    some(attributes) || some(&attributes["ome"])
}

struct Multiscale<'a> {
    group: &'a Path,
    json: &'a Value,
}

impl Multiscale<'_> {
    fn wrong(&self, found: impl Into<String>) -> Error {
        Error::format(self.group, found, "an OME-Zarr pyramid")
    }

    fn pyramid(&self, version: &str) -> Result<Pyramid> {
        let mut warnings = Vec::new();
        let known = |v: &&str| {
            let rest = version.strip_prefix(*v);
            rest.is_some_and(|r| !r.starts_with(|c: char| c.is_ascii_digit()))
        };
        if !version.is_empty() && !VERSIONS.iter().any(known) {
            let last = VERSIONS[VERSIONS.len() - 1];
            let text = "of OME-Zarr is not known: sizes are read as those of";
            warnings.push(format!("the version {version} {text} {last}").into());
        }
        let mut levels = Vec::new();
        let mut systems = Vec::new();
        for set in self.json["datasets"].as_array().into_iter().flatten() {
            let path = set["path"]
                .as_str()
                .unwrap_or_default()
                .trim_end_matches('/');
            let parts = path.split('/');
            if path.is_empty() || parts.into_iter().any(|p| matches!(p, "" | "..")) {
                return Err(self.wrong(format!("the path \"{path}\" of a level")));
            }
            let (place, system) = match self.json["coordinateSystems"].is_array() {
                true => self.in_system(&set["coordinateTransformations"]),
                false => (self.by_axes(&set["coordinateTransformations"]), None),
            };
            systems.extend(system);
            levels.push(Level {
                path: path.to_owned(),
                place,
            });
        }
        if levels.is_empty() {
            return Err(self.wrong("a pyramid without levels"));
        }
        systems.dedup();
        if let [first, second, ..] = &systems[..] {
            return Err(self.wrong(format!(
                "levels in the systems \"{first}\" and \"{second}\""
            )));
        }
        if let [system] = &systems[..] {
            warnings.extend(self.others(system).map(Warning::of_size));
        }
        Ok(Pyramid { levels, warnings })
    }

    /// Up to version 0.5: the axes are those of the array, and what all levels share comes last.
    fn by_axes(&self, own: &Value) -> Stated {
        let axes = match self.json["axes"].as_array() {
            Some(list) => list.iter().map(axis).collect(),
            // before version 0.3 they are always these
            None => ["t", "c", "z", "y", "x"].map(named).to_vec(),
        };
        let whole = &self.json["coordinateTransformations"];
        let stated = [own, whole]
            .iter()
            .any(|t| t.as_array().is_some_and(|t| !t.is_empty()));
        let affine = || {
            let reader = Reader { group: self.group };
            let first = reader.list(own, axes.len())?;
            let second = reader.list(whole, axes.len())?;
            self.of_all_axes(first.then(&second), &axes)
        };
        Stated {
            usual: self.json["axes"].is_null(),
            affine: if stated { affine().map(Some) } else { Ok(None) },
            axes,
        }
    }

    fn of_all_axes(&self, affine: Affine, axes: &[OmeAxis]) -> Result<Affine> {
        match affine.shift.len() == axes.len() {
            true => Ok(affine),
            false => Err(self.wrong(format!(
                "{} coordinates for {} axes",
                affine.shift.len(),
                axes.len()
            ))),
        }
    }

    /// From version 0.6 on: axes of the system that levels are placed in, and its name.
    fn in_system(&self, own: &Value) -> (Stated, Option<String>) {
        let systems = self.json["coordinateSystems"].as_array();
        let systems = systems.map(Vec::as_slice).unwrap_or_default();
        let list = own.as_array().map(Vec::as_slice).unwrap_or_default();
        let target = list.last().and_then(|step| name_of(&step["output"]));
        let of_name = |s: &&Value| target.is_none() || s["name"].as_str() == target.as_deref();
        let Some(system) = systems.iter().find(of_name) else {
            let found = format!(
                "no coordinate system \"{}\"",
                target.clone().unwrap_or_default()
            );
            let stated = Stated {
                axes: Vec::new(),
                usual: false,
                affine: Err(self.wrong(found)),
            };
            return (stated, target);
        };
        let axes: Vec<OmeAxis> = system["axes"]
            .as_array()
            .into_iter()
            .flatten()
            .map(axis)
            .collect();
        let name = system["name"].as_str().map(str::to_owned);
        let affine = match list {
            [] => Ok(None),
            [_] => Reader { group: self.group }
                .list(own, axes.len())
                .and_then(|affine| self.of_all_axes(affine, &axes))
                .map(Some),
            _ => Err(self.wrong(format!("{} transformations of a level", list.len()))),
        };
        let stated = Stated {
            axes,
            usual: false,
            affine,
        };
        (stated, name)
    }

    /// Transformations from the system of the levels to others, in words. These are other places of the same
    /// voxels; sizes are measured in that of the levels, as the specification advises.
    fn others(&self, system: &str) -> Option<String> {
        let steps = self.json["coordinateTransformations"].as_array()?.iter();
        let steps = steps.filter(|step| step["type"] != "identity");
        let words: Vec<String> = steps
            .map(|step| {
                let kind = step["type"].as_str().unwrap_or("without a type");
                let to = name_of(&step["output"]).unwrap_or_default();
                let from = name_of(&step["input"]).unwrap_or_default();
                format!("`{kind}` from \"{from}\" to \"{to}\"")
            })
            .collect();
        (!words.is_empty()).then(|| {
            format!(
                "sizes are those of the coordinate system \"{system}\"; not applied is the transformation {}: give \
                 --spacing and --unit if sizes are to be those of another system",
                words.join(" nor ")
            )
        })
    }
}

/// The name of a coordinate system, by itself or in an object.
fn name_of(json: &Value) -> Option<String> {
    let name = json.as_str().or(json["name"].as_str());
    name.filter(|n| !n.is_empty()).map(str::to_owned)
}

/// An axis; in version 0.3 they are names alone.
fn axis(json: &Value) -> OmeAxis {
    let text = |v: &Value| v.as_str().unwrap_or_default().to_owned();
    match json.as_str() {
        Some(name) => named(name),
        None => OmeAxis {
            name: text(&json["name"]),
            kind: text(&json["type"]).to_lowercase(),
            unit: text(&json["unit"]),
        },
    }
}

fn named(name: &str) -> OmeAxis {
    OmeAxis {
        name: name.to_owned(),
        ..OmeAxis::default()
    }
}
