//! MINC 2: images of medical scanners in HDF5.
//!
//! <https://en.wikibooks.org/wiki/MINC/Reference/MINC2.0_File_Format_Reference>: stored integers in `valid_range`
//! stand for values from `image-min` to `image-max`, which may be others for each slice; each axis has a dataset
//! of its own with its step, start and direction.

use crate::grid::length::{product, sum};
use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::geometry::{Along, Geometry};
use crate::volume::formats::hdf5::number::Number;
use crate::volume::formats::hdf5::place::Place;
use crate::volume::stated::warning::Warning;
use hdf5_reader::Dataset;

/// The level of an image of MINC by its name; `None` for other datasets.
pub(crate) fn level(name: &str) -> Option<u32> {
    let number = name.strip_prefix("/minc-2.0/image/")?;
    number.strip_suffix("/image")?.parse().ok()
}

/// Steps, starts and directions of x, y and z.
///
/// # Errors
/// What is missing or wrong, for people.
pub(crate) fn geometry(place: &Place, axes: [usize; 3]) -> Result<Geometry, String> {
    let order = order(&place.attributes, place.dataset.ndim());
    let mut geometry = Geometry::default();
    let mut directions = [[0.0; 3]; 3];
    for (a, axis) in axes.into_iter().enumerate() {
        directions[a][a] = 1.0;
        let Some(name) = order.get(axis) else {
            return Err("an image without the attribute dimorder".into());
        };
        let Ok(dataset) = place.file.dataset(&format!("/minc-2.0/dimensions/{name}")) else {
            geometry.warnings.push(Warning::of_size(format!(
                "the file has no dimension {name}: give --spacing and --unit"
            )));
            continue;
        };
        let of = Attributes(dataset.attributes());
        if of
            .text("spacing")
            .is_some_and(|text| text.starts_with("irregular"))
        {
            geometry
                .uneven
                .get_or_insert(format!("slices along {name} that are not evenly spaced"));
        }
        if let Some(direction) = direction(&of, name)? {
            directions[a] = direction;
        }
        geometry.along[a] = Some(steps(place, axis, &of, name)?);
    }
    geometry.directions = Some(directions);
    if place
        .attributes
        .text("complete")
        .is_some_and(|t| t.starts_with("false"))
    {
        geometry
            .warnings
            .push("the file says of its image that it is not complete".into());
    }
    Ok(geometry)
}

/// The direction of an axis, as a unit vector; `None` if its dataset does not state it.
fn direction(of: &Attributes, name: &str) -> Result<Option<[f64; 3]>, String> {
    let Some(cosines) = of.numbers("direction_cosines") else {
        return Ok(None);
    };
    let wrong = || format!("{name} with the direction {cosines:?}");
    let &[x, y, z] = &cosines[..] else {
        return Err(wrong());
    };
    let length = (x * x + y * y + z * z).sqrt();
    if !(length.is_finite() && length > 0.0) {
        return Err(wrong());
    }
    Ok(Some([x, y, z].map(|v| v / length)))
}

/// Step, start and unit of an axis of the image, by the dataset of that axis.
fn steps(place: &Place, axis: usize, of: &Attributes, name: &str) -> Result<Along, String> {
    let n = place.dataset.shape()[axis] as f64;
    // a level is coarser by this, about the same middle
    let coarser = of.number("length").filter(|_| level(place.name) != Some(0));
    let coarser = coarser.map_or(1.0, |length| length / n);
    // what is absent is 1, by the format
    let step = of.number("step").unwrap_or(1.0);
    let start = of.number("start").unwrap_or(0.0);
    let start = sum(start, product(coarser - 1.0, product(step, 0.5)));
    if step == 0.0 || !step.is_finite() || !start.is_finite() {
        return Err(format!("{name} with the step {step} and the start {start}"));
    }
    let unit = of.text("units").unwrap_or_default();
    Ok(Along {
        start,
        falls: step < 0.0,
        ..Along::of(product(step.abs(), coarser), &unit)
    })
}

/// Names of the axes of a dataset.
fn order(attributes: &Attributes, axes: usize) -> Vec<String> {
    let text = attributes.text("dimorder").unwrap_or_default();
    let names = text.split(',').map(|n| n.trim().to_owned());
    // there may be more than axes, as leftovers
    names.filter(|n| !n.is_empty()).take(axes).collect()
}

/// The values that stored integers stand for; floating-point numbers are values. `entry` is the one along each
/// axis of the array but x, y and z.
///
/// # Errors
/// What is missing or wrong, for people.
pub(crate) fn values(
    place: &Place,
    axes: [usize; 3],
    entry: &[u64],
    number: &Number,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Values>, String> {
    let Some(all) = number.range() else {
        return match number.dtype.is_float() && number.is_wide() {
            true => Err("integers of 64 bits".into()),
            false => Ok(None),
        };
    };
    let stated = place.attributes.text("signtype");
    if stated.is_some_and(|t| t.starts_with("signed") != (all[0] < 0.0)) {
        warnings.push(
            "the attribute signtype contradicts the type of the samples, which is taken".into(),
        );
    }
    let folder = place.name.rsplit_once('/').map_or("", |(folder, _)| folder);
    let ends =
        ["image-min", "image-max"].map(|n| place.file.dataset(&format!("{folder}/{n}")).ok());
    let [Some(low), Some(high)] = ends else {
        if ends.iter().any(Option::is_some) {
            return Err("one of image-min and image-max without the other".into());
        }
        warnings.push(
            "the image has no image-min and image-max: values are taken as they are stored".into(),
        );
        return Ok(None);
    };
    let valid = valid_range(&place.attributes, all)?;
    let low = along(&low, place, axes, entry)?;
    let high = along(&high, place, axes, entry)?;
    let scale = scale(low, high, valid)?;
    Ok(Some(Values {
        scale,
        nothing: Vec::new(),
        valid: (valid != all).then_some(valid),
        stated_by: "valid_range, image-min and image-max".into(),
    }))
}

/// The scale under which the `valid` stored numbers stand for values from `low` to `high`.
fn scale(low: Bounds, high: Bounds, valid: [f64; 2]) -> Result<Scale, String> {
    if low.axis != high.axis || low.values.len() != high.values.len() {
        return Err("image-min and image-max of different axes".into());
    }
    let [from, to] = valid;
    let ends = low.values.iter().zip(&high.values);
    let scales = ends.map(|(&low, &high)| {
        let slope = (high - low) / (to - from);
        Linear {
            slope,
            intercept: low - from * slope,
        }
    });
    let scales: Vec<Linear> = scales.collect();
    if scales
        .iter()
        .any(|s| !(s.slope.is_finite() && s.intercept.is_finite()))
    {
        return Err("image-min and image-max that are not finite".into());
    }
    match (low.axis, &scales[..]) {
        (Some(axis), _) => Ok(Scale::Slices {
            axis,
            all: scales.into(),
        }),
        (None, [one]) => Ok(Scale::All(*one)),
        _ => Err("image-min and image-max without an order of axes".into()),
    }
}

/// Stored numbers that stand for values: those that the image states, or all of its type.
fn valid_range(attributes: &Attributes, all: [f64; 2]) -> Result<[f64; 2], String> {
    let range = match attributes.numbers("valid_range") {
        Some(range) => range,
        None => {
            let end = |name, other| attributes.number(name).unwrap_or(other);
            vec![end("valid_min", all[0]), end("valid_max", all[1])]
        }
    };
    match range[..] {
        [low, high] if all[0] <= low && low < high && high <= all[1] => Ok([low, high]),
        _ => Err(format!(
            "valid_range {range:?} of samples from {} to {}",
            all[0], all[1]
        )),
    }
}

/// The numbers of image-min or image-max.
struct Bounds {
    values: Vec<f64>,
    /// Which of x, y and z they are along; `None` for one number of the whole image.
    axis: Option<usize>,
}

/// Reads the dataset image-min or image-max.
fn along(
    dataset: &Dataset,
    place: &Place,
    axes: [usize; 3],
    entry: &[u64],
) -> Result<Bounds, String> {
    let name = dataset.name();
    let numbers =
        numbers_of(dataset).ok_or_else(|| format!("{name} that is no list of numbers"))?;
    let shape = dataset.shape();
    let own = order(&Attributes(dataset.attributes()), shape.len());
    if own.len() != shape.len() {
        return match numbers[..] {
            [one] => Ok(Bounds {
                values: vec![one],
                axis: None,
            }),
            _ => Err(format!("{name} without the attribute dimorder")),
        };
    }
    let of_image = order(&place.attributes, place.dataset.ndim());
    let mut stride = 1;
    let (mut first, mut space) = (0, None);
    for (at, axis) in own.iter().enumerate().rev() {
        let axis = of_image.iter().position(|n| n == axis);
        let axis = axis.filter(|&a| place.dataset.shape()[a] == shape[at]);
        let axis = axis.ok_or_else(|| format!("{name} of other axes than the image"))?;
        match axes.iter().position(|&a| a == axis) {
            Some(a) if space.is_none() => space = Some((a, stride)),
            Some(_) => return Err(format!("{name} of several axes of space")),
            None => first += entry[axis] as usize * stride,
        }
        stride *= shape[at] as usize;
    }
    let picked = |n: usize, stride: usize| (0..n).map(|i| numbers[first + i * stride]).collect();
    Ok(match space {
        Some((a, stride)) => Bounds {
            values: picked(place.dataset.shape()[axes[a]] as usize, stride),
            axis: Some(a),
        },
        None => Bounds {
            values: picked(1, 0),
            axis: None,
        },
    })
}
