//! Members of tifffile's description by which people state the size of a voxel or a scale of samples. tifffile itself
//! gives them no meaning: those of one meaning are taken, the others are named in a warning.

use crate::error::{Error, Result};
use crate::grid::length::tidy;
use crate::volume::Dtype;
use crate::volume::adapters::values::Values;
use crate::volume::formats::tiff::stack::About;
use crate::volume::stated::cf::{self, Attribute};
use crate::volume::stated::size::Step;
use crate::volume::stated::written::{self, Name, Written, plain};
use serde_json::{Map, Value};
use std::path::Path;

/// Names, without what separates words, that say the size of a voxel, and how many axes a single number is of: 0 if
/// of z alone.
const SIZES: [(&str, usize); 8] = [
    ("voxelsize", 3),
    ("voxelspacing", 3),
    ("elementsize", 3),
    ("elementspacing", 3),
    ("physicalsize", 3),
    ("pixelsize", 2),
    ("pixelspacing", 2),
    ("spacing", 0),
];

/// Parts of names that may say a size.
const MAYBE_SIZES: [&str; 14] = [
    "spacing",
    "voxel",
    "pixelsize",
    "pixelwidth",
    "pixelheight",
    "pixeldepth",
    "resolution",
    "physicalsize",
    "elementsize",
    "thickness",
    "sampling",
    "step",
    "pixdim",
    "zoom",
];

/// Parts of names that may say which values samples stand for.
const MAYBE_VALUES: [&str; 12] = [
    "scale",
    "scaling",
    "slope",
    "intercept",
    "offset",
    "gain",
    "calib",
    "multiplier",
    "bias",
    "nodata",
    "fillvalue",
    "missingvalue",
];

/// What a member states: of one axis, or of some.
struct Sized<'a> {
    name: &'a str,
    steps: [Option<Step>; 3],
}

/// The members of a description besides those that tifffile writes.
pub(crate) struct Members<'a> {
    pub(crate) json: &'a Map<String, Value>,
    /// A letter for every number of the shape; empty if the axes have no names.
    pub(crate) axes: &'a str,
}

/// How many axes a single number of a size of this plain name is of, as [`SIZES`] has them.
fn count(base: &str) -> Option<usize> {
    SIZES.iter().find(|(n, _)| *n == base).map(|(_, n)| *n)
}

/// All numbers of a member, as it may be written.
fn numbers(value: &Value) -> Option<Vec<f64>> {
    match value {
        Value::Number(n) => Some(vec![tidy(n.as_f64()?)]),
        Value::Array(all) => {
            let numbers: Option<Vec<f64>> = all.iter().map(|v| v.as_f64().map(tidy)).collect();
            numbers.filter(|all| !all.is_empty())
        }
        _ => None,
    }
}

/// The numbers of an object with members x, y and z.
fn of_axes(value: &Value) -> Option<[Option<f64>; 3]> {
    let object = value.as_object()?;
    let axis = |name: &str| {
        let found = object.iter().find(|(key, _)| plain(key) == name);
        found.and_then(|(_, value)| value.as_f64()).map(tidy)
    };
    let all = ["x", "y", "z"].map(axis);
    (all.iter().flatten().count() == object.len()).then_some(all)
}

impl<'a> Members<'a> {
    /// All that may say something of sizes, to be compared between slices.
    pub(crate) fn of_sizes(&self) -> String {
        let maybe = |name: &str| plain(name).contains("unit") || maybe_size(name);
        let all = self.json.iter().filter(|(name, _)| maybe(name));
        all.map(|(name, value)| format!("{name}={value}\n"))
            .collect()
    }

    /// All members as attributes.
    fn written(&self) -> Written {
        let mut written = Written::default();
        for (name, value) in self.json {
            written.add_json(name, value);
        }
        written
    }

    /// The unit beside a size: of the member `name`, of those of this plain `base`, or of all.
    fn unit(&self, name: &str, base: &str) -> String {
        let unit = self.written().unit_beside(&[&plain(name), base]);
        let texts = unit.map(|unit| unit.texts).unwrap_or_default();
        match &texts[..] {
            [one, rest @ ..] if rest.iter().all(|other| other == one) => one.clone(),
            _ => String::new(),
        }
    }

    /// Sizes that members state of x, y and z. What may be a size and is not taken is a warning.
    pub(crate) fn steps(&self, about: &mut About) -> [Option<Step>; 3] {
        let mut found: Vec<Sized> = Vec::new();
        for (name, value) in self.json {
            match self.sized(name, value, about) {
                Some(steps) => found.push(Sized { name, steps }),
                None if !says_something(value) => {}
                None if maybe_size(name) => about.of_size(format!(
                    "the description by tifffile has the member \"{name}\" ({value}), which is not taken: give \
                     --spacing and --unit if it is the size of a voxel"
                )),
                None => {}
            }
        }
        let mut steps = [None, None, None];
        for (a, step) in steps.iter_mut().enumerate() {
            let mut own = found
                .iter()
                .filter_map(|f| Some((f.name, f.steps[a].as_ref()?)));
            let Some((name, first)) = own.next() else {
                continue;
            };
            if let Some((other, _)) = own.find(|(_, step)| !same(first, step)) {
                about.of_size(format!(
                    "the members \"{name}\" and \"{other}\" of the description by tifffile state sizes that differ: \
                     none is taken, give --spacing and --unit"
                ));
                return [None, None, None];
            }
            *step = Some(first.clone());
        }
        steps
    }

    fn sized(&self, name: &'a str, value: &Value, about: &mut About) -> Option<[Option<Step>; 3]> {
        let known = Name::among(name, |base| count(base).is_some())?;
        let (count, axis) = (count(&known.base)?, known.axis);
        let unit = known.unit.map(str::to_owned);
        let mut unit = unit.unwrap_or_else(|| self.unit(name, &known.base));
        // as in OME, whose names these are
        if unit.is_empty() && known.base == "physicalsize" {
            unit = "um".into();
        }
        let step = |size: f64| Some(Step::new(size, unit.clone()));
        if let Some(all) = of_axes(value) {
            return Some(all.map(|size| size.and_then(step)));
        }
        let all = numbers(value)?;
        let mut steps = [None, None, None];
        match (axis, &all[..]) {
            (Some(axis), [one]) => steps[axis] = step(*one),
            // ImageJ's distance of slices
            (None, [one]) if count == 0 => steps[2] = step(*one),
            (None, [one]) => (0..count).for_each(|a| steps[a] = step(*one)),
            (None, [one, rest @ ..]) if rest.iter().all(|n| n == one) && rest.len() < 3 => {
                (0..=rest.len()).for_each(|a| steps[a] = step(*one));
            }
            (None, several) => {
                let letters: Vec<char> = self.axes.chars().collect();
                let of_space: Vec<char> = letters
                    .iter()
                    .copied()
                    .filter(|c| "XYZ".contains(*c))
                    .collect();
                let named = match several.len() {
                    n if n == letters.len() => letters,
                    n if n == of_space.len() => of_space,
                    _ => return None,
                };
                for (letter, size) in named.iter().zip(several) {
                    if let Some(a) = "XYZ".chars().position(|c| c == *letter) {
                        steps[a] = step(*size);
                    }
                }
                about.of_size(format!(
                    "the member \"{name}\" of the description by tifffile ({value}) is taken in the order of its axes, \
                     {}: give --spacing X,Y,Z and --unit if that is wrong",
                    named.iter().collect::<String>()
                ));
            }
            _ => return None,
        }
        steps.iter().any(Option::is_some).then_some(steps)
    }

    /// The values that members state samples of `stored` to stand for.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the member's name if its meaning cannot be told.
    pub(crate) fn values(&self, path: &Path, stored: Dtype) -> Result<Option<Values>> {
        let packed = cf::values(path, stored, |name| Ok(self.json.get(name).map(attribute)))?;
        let no = |what: String| {
            let what = format!("a description by tifffile with {what}");
            let hint = "write the values themselves, or leave the member out";
            Error::unsupported(path, what, hint)
        };
        if packed.dtype != stored {
            return Err(no("the member _Unsigned".into()));
        }
        let pair = self.written().pair().map_err(no)?;
        written::with_scale(packed.values, pair).map_err(no)
    }

    /// Warns of members that may say which values samples stand for, and are not applied.
    pub(crate) fn vague(&self, about: &mut About) {
        for (name, value) in self.json {
            let part = |parts: &[&str]| parts.iter().any(|part| plain(name).contains(part));
            let nothing = [0.0, 1.0].iter().any(|n| value.as_f64() == Some(*n));
            if part(&MAYBE_VALUES)
                && !part(&["time", "origin", "position"])
                && !is_applied(name)
                && says_something(value)
                && !nothing
            {
                about.warnings.push(format!(
                    "the description by tifffile has the member \"{name}\" ({value}), which is not applied: if it is \
                     of the values, the threshold is in stored numbers"
                ).into());
            }
        }
    }
}

/// True for the members that [`Members::values`] applies.
fn is_applied(name: &str) -> bool {
    let mut pairs = written::PAIRS.iter().flat_map(|(a, b)| [*a, *b]);
    cf::NAMES.contains(&name) || pairs.any(|known| known == plain(name))
}

fn maybe_size(name: &str) -> bool {
    let name = plain(name);
    ["dx", "dy", "dz"].contains(&name.as_str())
        || MAYBE_SIZES.iter().any(|part| name.contains(part))
}

/// True for numbers, and texts and objects that hold some.
fn says_something(value: &Value) -> bool {
    match value {
        Value::Number(_) => true,
        Value::String(text) => text.contains(|c: char| c.is_ascii_digit()),
        Value::Array(all) => all.iter().any(says_something),
        Value::Object(all) => all.values().any(says_something),
        _ => false,
    }
}

/// True for two steps of one length.
fn same(a: &Step, b: &Step) -> bool {
    match (a.nanometres(), b.nanometres()) {
        (Some(a), Some(b)) => (a / b - 1.0).abs() < 1e-6,
        (None, None) => a == b,
        _ => false,
    }
}

/// A member as the conventions of CF take an attribute.
fn attribute(value: &Value) -> Attribute {
    let float = |v: &Value| !(v.is_i64() || v.is_u64());
    match (value, numbers(value)) {
        (Value::String(text), _) => Attribute::Text(text.clone()),
        (_, Some(values)) => Attribute::Numbers {
            values,
            float: value
                .as_array()
                .map_or(float(value), |all| all.iter().any(float)),
        },
        (other, None) => Attribute::Other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_sizes() {
        let parts = |name: &str| {
            let known = Name::among(name, |base| count(base).is_some())?;
            Some((count(&known.base)?, known.axis, known.unit))
        };
        for (name, expected) in [
            ("voxel_size", Some((3, None, None))),
            ("VoxelSize_um", Some((3, None, Some("um")))),
            ("pixel_size_nm", Some((2, None, Some("nm")))),
            ("PixelSizeUm", Some((2, None, Some("um")))),
            ("z_spacing", Some((0, Some(2), None))),
            ("voxel-size-x", Some((3, Some(0), None))),
            ("voxel_size_x_um", Some((3, Some(0), Some("um")))),
            ("spacing", Some((0, None, None))),
            ("resolution", None),
            ("sizes", None),
        ] {
            assert_eq!(parts(name), expected, "{name}");
        }
    }
}
