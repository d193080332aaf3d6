//! The values that stored samples stand for, by the attributes of CF, NeXus and others.

use crate::error::{Error, Result};
use crate::grid::length::product;
use crate::volume::adapters::values::{Linear, Values};
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::number::Number;
use crate::volume::formats::hdf5::place::Place;
use crate::volume::stated::cf::{self, Attribute};
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{StatedScale, Written, sound, with_scale};
use hdf5_reader::Datatype;
use std::path::Path;

/// The numbers as the attributes have them read, and the values that they stand for.
///
/// # Errors
/// [`Error::Unsupported`] with the attribute's name if its meaning cannot be told.
pub(crate) fn values(
    path: &Path,
    place: &Place,
    number: Number,
    warnings: &mut Vec<Warning>,
) -> Result<(Number, Option<Values>)> {
    let packed = cf::values(path, number.dtype, |name| {
        Ok(attribute(&place.attributes, name))
    })?;
    let number = number.read_as(packed.dtype);
    let no = |what: String| {
        let hint = "write the values themselves, or remove the attribute";
        Error::unsupported(
            path,
            format!("the HDF5 dataset {} with {what}", place.name),
            hint,
        )
    };
    let written = place.attributes.written();
    let other = other(place, &written).map_err(no)?;
    written.vague(other.is_some(), "", warnings);
    for (group, attributes) in place.groups() {
        let of = format!(" of the group {group}");
        let taken = place.is_signal() && other.is_some();
        attributes.vague(taken, &of, warnings);
    }
    let values = with_scale(packed.values, other).map_err(no)?;
    Ok((number, values))
}

/// An attribute as the conventions of CF take it.
fn attribute(attributes: &Attributes, name: &str) -> Option<Attribute> {
    let found = attributes.get(name)?;
    let text = attributes.text(name);
    if let Some(text) = text.filter(|t| t.parse::<f64>().is_err()) {
        return Some(Attribute::Text(text));
    }
    Some(match attributes.numbers(name) {
        Some(values) => Attribute::Numbers {
            values,
            float: matches!(found.datatype, Datatype::FloatingPoint { .. }),
        },
        None => Attribute::Other(crate::volume::formats::hdf5::number::type_text(
            &found.datatype,
        )),
    })
}

/// A scale that is not that of CF, and who states it.
fn other(place: &Place, written: &Written) -> Result<Option<StatedScale>, String> {
    let pair = written.pair()?;
    let nexus = of_nexus(place)?;
    match (pair, nexus) {
        (Some(pair), Some(other)) if other.linear != Linear::SAME => match pair.linear {
            Linear::SAME => Ok(Some(other)),
            _ => Err(format!("both {} and {}", pair.by, other.by)),
        },
        (Some(pair), _) => Ok(Some(pair)),
        (None, nexus) => Ok(nexus),
    }
}

/// A factor or an offset of NeXus, and the name of who states it.
type Part = Option<(f64, String)>;

/// Where NeXus states factors and offsets of a dataset.
struct Nexus<'a> {
    place: &'a Place<'a>,
    folder: &'a str,
    name: &'a str,
}

impl Nexus<'_> {
    /// By an attribute of the dataset.
    fn own(&self, name: &str) -> Result<Part, String> {
        match self.place.attributes.number(name) {
            Some(n) if n.is_finite() => Ok(Some((n, name.to_owned()))),
            _ if self.place.attributes.has(name) => Err(no_number("an attribute", name)),
            _ => Ok(None),
        }
    }

    /// By a dataset in the same group.
    fn beside(&self, name: String) -> Result<Part, String> {
        let path = format!("{}/{name}", self.folder);
        let Ok(dataset) = self.place.file.dataset(&path) else {
            return Ok(None);
        };
        match numbers_of(&dataset).as_deref() {
            Some(&[one]) if one.is_finite() => Ok(Some((one, name))),
            _ => Err(no_number("a dataset", &name)),
        }
    }

    /// By a dataset in the same group and without the name of this one, which is of the group's signal.
    fn of_signal(&self, what: &str) -> Result<Part, String> {
        match self.place.is_signal() {
            true => self.beside(what.to_owned()),
            false => Ok(None),
        }
    }

    /// In all three ways, the one whose meaning is defined first.
    fn all(&self, what: &str) -> Result<[Part; 3], String> {
        Ok([
            self.beside(format!("{}_{what}", self.name))?,
            self.own(what)?,
            self.of_signal(what)?,
        ])
    }
}

fn no_number(what: &str, by: &str) -> String {
    format!("{what} {by} that is no number")
}

/// The scale by NeXus: attributes of the data, or datasets beside it. <https://manual.nexusformat.org/classes/base_classes/NXdata.html>
/// says of datasets with the data's name in front: value = (stored + offset) * factor.
fn of_nexus(place: &Place) -> Result<Option<StatedScale>, String> {
    let (folder, name) = place.name.rsplit_once('/').unwrap_or(("", place.name));
    let stated = Nexus {
        place,
        folder,
        name,
    };
    let factors = stated.all("scaling_factor")?;
    let nexus = factors.iter().any(Option::is_some) || place.group.text("NX_class").is_some();
    let offsets = match nexus {
        true => stated.all("offset")?,
        false => [const { None }; 3],
    };
    // those with the data's name in front are the ones whose order is defined
    let defined = !(factors[1..]
        .iter()
        .chain(&offsets[1..])
        .any(Option::is_some));
    let (factor, offset) = (one_of(factors)?, one_of(offsets)?);
    let by: Vec<&str> = [&factor, &offset]
        .into_iter()
        .flatten()
        .map(|(_, by)| by.as_str())
        .collect();
    if by.is_empty() {
        return Ok(None);
    }
    let f = factor.as_ref().map_or(1.0, |(f, _)| *f);
    let o = offset.as_ref().map_or(0.0, |(o, _)| *o);
    if f != 1.0 && o != 0.0 && !defined {
        return Err(format!(
            "{} {f} and {} {o}, of which NeXus does not state which is applied first (it does for datasets of the names \
             {name}_scaling_factor and {name}_offset: (stored + offset) * factor)",
            by[0], by[1]
        ));
    }
    let linear = Linear {
        slope: f,
        intercept: product(o, f),
    };
    sound(linear, by.join(" and ")).map(Some)
}

/// The one that is stated.
///
/// # Errors
/// Two that differ, for people.
fn one_of(parts: [Part; 3]) -> Result<Part, String> {
    let mut stated = parts.into_iter().flatten();
    let first = stated.next();
    match (&first, stated.next()) {
        (Some((a, by)), Some((b, its))) if *a != b => Err(format!("both {by} {a} and {its} {b}")),
        _ => Ok(first),
    }
}
