//! The values that stored samples stand for, by the attributes of CF, NeXus and others.

use crate::error::{Error, Result};
use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::number::Number;
use crate::volume::formats::hdf5::place::Place;
use crate::volume::stated::cf::{self, Attribute};
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{Stated, Written, sound};
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
        attributes.vague(false, &of, warnings);
    }
    let Some((linear, by)) = other else {
        return Ok((number, packed.values));
    };
    let values = match packed.values {
        None => Values::linear(linear.slope, linear.intercept, &by),
        Some(values) if values.scale == Scale::All(Linear::SAME) => Some(Values {
            scale: Scale::All(linear),
            stated_by: format!("{by}; {}", values.stated_by),
            ..values
        }),
        Some(values) => return Err(no(format!("both {} and {by}", values.stated_by))),
    };
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
fn other(place: &Place, written: &Written) -> Result<Option<Stated>, String> {
    let pair = written.pair()?;
    if pair.is_some() {
        return Ok(pair);
    }
    let own = |name: &str| match place.attributes.number(name) {
        Some(n) if n.is_finite() => Ok(Some(n)),
        _ if place.attributes.has(name) => Err(format!("an attribute {name} that is no number")),
        _ => Ok(None),
    };
    // NeXus: attributes of the data, or datasets beside it
    let (folder, name) = place.name.rsplit_once('/').unwrap_or(("", place.name));
    let beside = |what: &str| {
        let dataset = place
            .file
            .dataset(&format!("{folder}/{name}_{what}"))
            .ok()?;
        match numbers_of(&dataset)?[..] {
            [one] => Some(one),
            _ => None,
        }
    };
    let factor = own("scaling_factor")?.or_else(|| beside("scaling_factor"));
    let nexus = factor.is_some() || place.group.text("NX_class").is_some();
    let offset = match nexus {
        true => place
            .attributes
            .number("offset")
            .or_else(|| beside("offset")),
        false => None,
    };
    match (factor, offset) {
        (None, None) => Ok(None),
        (Some(f), Some(o)) if f != 1.0 && o != 0.0 => Err(format!(
            "scaling_factor {f} and offset {o}, of which NeXus does not state which is applied first"
        )),
        (f, o) => {
            let linear = Linear {
                slope: f.unwrap_or(1.0),
                intercept: o.unwrap_or(0.0),
            };
            let by = match (f, o) {
                (Some(_), None) => "scaling_factor",
                (None, _) => "offset",
                _ => "scaling_factor and offset",
            };
            sound(linear, by.to_owned()).map(Some)
        }
    }
}
