//! What attributes of other writers than CF's state of an array, in HDF5 and Zarr: the order of its axes, sizes of
//! voxels and scales of values. What is certain is applied; of everything else that may change numbers a user is told.

mod name;
mod place;
mod quantity;
pub(crate) mod size;
mod unit;

#[cfg(feature = "hdf5")]
pub(crate) use place::is_turn;
#[cfg(feature = "zarr")]
pub(crate) use size::SizeFound;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
pub(crate) use size::{Grid, size};

pub(crate) use name::Name;

use crate::volume::adapters::values::{Linear, Scale, Values};
use crate::volume::stated::warning::Warning;

/// Attributes that name the axes of an array, as a list or as letters, in plain spelling.
pub(crate) const AXES: [&str; 14] = [
    "dimorder",
    "dimensionlabels",
    "axes",
    "axislabels",
    "axeslabels",
    "axisnames",
    "axesnames",
    "axesorder",
    "arraydimensions",
    "dims",
    "dimensions",
    "dimensionnames",
    "dimnames",
    "dimlabels",
];

/// Attributes of an order that may count from the first axis or from the last, in plain spelling.
const ORDERS: [&str; 10] = [
    "order",
    "dimensionorder",
    "axisorder",
    "memoryorder",
    "memorylayout",
    "arrayorder",
    "arraylayout",
    "storageorder",
    "dataorder",
    "indexorder",
];

/// Pairs of attributes, in plain spelling, whose names say that value = first * stored + second.
pub(crate) const PAIRS: [(&str, &str); 7] = [
    ("rescaleslope", "rescaleintercept"),
    ("sclslope", "sclinter"),
    ("slope", "intercept"),
    ("calibrationslope", "calibrationintercept"),
    // of FITS
    ("bscale", "bzero"),
    // of openPMD, which has no second
    ("unitsi", "unitsioffset"),
    ("scalefactor", "addoffset"),
];

/// Names of CF itself.
const CF: [&str; 2] = ["scale_factor", "add_offset"];

/// Attributes, in plain spelling, that may be of the values, or of the size of a voxel, or of anything.
const VAGUE: [&str; 17] = [
    "scale",
    "datascale",
    "valuescale",
    "intensityscale",
    "greyscale",
    "grayscale",
    "scalingfactor",
    "offset",
    "dataoffset",
    "valueoffset",
    "intensityoffset",
    "caloffset",
    "calibrationoffset",
    "calibrationscale",
    "calibrationconstant",
    "calibrationcoefficient",
    "calibrationcoefficients",
];

/// Endings of such names, whatever is in front: `mu_scaling`, `density_slope`, `hu_intercept`, `camera_gain`.
const VAGUE_ENDS: [&str; 12] = [
    "scaling",
    "scalefactor",
    "scalingfactor",
    "scalefactors",
    "multiplier",
    "gain",
    "addoffset",
    "slope",
    "intercept",
    "calibration",
    "calibrationfactor",
    "bias",
];

/// A scale, and the attributes that state it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StatedScale {
    pub(crate) linear: Linear,
    pub(crate) by: String,
}

/// What an attribute holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Held {
    /// At least one.
    Numbers(Vec<f64>),
    /// At least one.
    Texts(Vec<String>),
    Other,
}

impl std::fmt::Display for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Held::Numbers(all) => {
                let all: Vec<String> = all.iter().map(f64::to_string).collect();
                f.write_str(&all.join(", "))
            }
            Held::Texts(all) => write!(f, "\"{}\"", all.join("\", \"")),
            Held::Other => f.write_str("neither number nor text"),
        }
    }
}

/// A name in plain spelling, without regard to case and to what divides its words: `voxelsize` for `voxel_size`,
/// `VoxelSize` and `voxel size`.
pub(crate) fn plain(name: &str) -> String {
    let letters = name.chars().flat_map(char::to_lowercase);
    let letters = letters.filter(|c| c.is_alphanumeric());
    let ascii = letters.map(|c| if matches!(c, 'µ' | 'μ') { 'u' } else { c });
    ascii.collect()
}

/// x, y or z (0, 1 or 2) for a name of several words of which one is that letter, as `voxel_x` or `z (mm)`.
pub(crate) fn axis_letter(name: &str) -> Option<usize> {
    let words = name.split(|c: char| !c.is_alphanumeric());
    let mut letters = words.filter_map(|w| {
        ["x", "y", "z"]
            .iter()
            .position(|l| w.eq_ignore_ascii_case(l))
    });
    let first = letters.next()?;
    letters.next().is_none().then_some(first)
}

/// The attributes of an array or of a group.
#[derive(Debug, Default)]
pub(crate) struct Written(Vec<(String, Held)>);

impl Written {
    pub(crate) fn add(&mut self, name: &str, held: Held) {
        self.0.push((name.to_owned(), held));
    }

    /// Adds all of another under names behind this one.
    #[cfg(feature = "hdf5")]
    pub(crate) fn add_below(&mut self, name: &str, other: Written) {
        let below = other.0.into_iter();
        self.0
            .extend(below.map(|(own, held)| (format!("{name}.{own}"), held)));
    }

    /// Adds what JSON holds; members of an object have its name in front of theirs, unless that says nothing.
    pub(crate) fn add_json(&mut self, name: &str, value: &serde_json::Value) {
        use serde_json::Value;
        let held = match value {
            Value::Null => return,
            Value::Object(members) => {
                for (member, value) in members {
                    let name = match plain(name).as_str() {
                        "" | "metadata" | "meta" | "attributes" | "attrs" | "info"
                        | "properties" => member.clone(),
                        _ => format!("{name}.{member}"),
                    };
                    self.add_json(&name, value);
                }
                return;
            }
            Value::Number(n) => n.as_f64().map(|n| Held::Numbers(vec![n])),
            Value::String(text) => Some(Held::Texts(vec![text.clone()])),
            Value::Array(all) if !all.is_empty() => {
                let numbers: Option<Vec<f64>> = all.iter().map(Value::as_f64).collect();
                let text = |v: &Value| v.as_str().map(str::to_owned);
                let texts = || all.iter().map(text).collect::<Option<Vec<String>>>();
                numbers
                    .map(Held::Numbers)
                    .or_else(|| texts().map(Held::Texts))
            }
            _ => None,
        };
        self.add(name, held.unwrap_or(Held::Other));
    }

    /// The attribute of a plain spelling, with its name.
    pub(crate) fn like(&self, spelling: &str) -> Option<(&str, &Held)> {
        let found = self.0.iter().find(|(name, _)| plain(name) == spelling);
        found.map(|(name, held)| (name.as_str(), held))
    }

    /// The text of the attribute `units` or `unit`, if there is one.
    #[cfg(feature = "hdf5")]
    pub(crate) fn unit(&self) -> Option<String> {
        match self.like("units").or_else(|| self.like("unit"))?.1 {
            Held::Texts(texts) => texts.first().cloned(),
            _ => None,
        }
    }

    /// The number of an attribute, with its name.
    ///
    /// # Errors
    /// A few words of an attribute that is there and is no finite number.
    fn number(&self, spelling: &str) -> Result<Option<(&str, f64)>, String> {
        let Some((name, held)) = self.like(spelling) else {
            return Ok(None);
        };
        match held.number().filter(|n| n.is_finite()) {
            Some(number) => Ok(Some((name, number))),
            None => Err(format!("an attribute `{name}` that is no number ({held})")),
        }
    }

    /// Why the order of the axes cannot be told, if attributes state another than z, y, x by letters or in words.
    pub(crate) fn vague_order(&self) -> Option<String> {
        self.0.iter().find_map(|(name, held)| {
            let Held::Texts(texts) = held else { return None };
            let text = texts.concat();
            let letters: String = text.to_lowercase().chars().filter(|c| c.is_alphabetic()).collect();
            let space: String = letters.chars().filter(|c| "xyz".contains(*c)).collect();
            let turned = letters == "f"
                || ["fortran", "colmajor", "columnmajor", "colmaj", "ijk"].contains(&letters.as_str())
                || letters.starts_with("fortran")
                || space.len() == 3 && space != "zyx" && letters.len() <= 5;
            (ORDERS.contains(&plain(name).as_str()) && turned).then(|| {
                format!(
                    "its attribute {name} is {text}, which may count from the first axis or from the last"
                )
            })
        })
    }

    /// The scale that a pair of attributes states, if one does.
    ///
    /// # Errors
    /// A few words of what is stated if it is no scale, or if two scales are.
    pub(crate) fn pair(&self) -> Result<Option<StatedScale>, String> {
        let mut found: Option<StatedScale> = None;
        for (slope, intercept) in PAIRS {
            // those of CF itself are read as CF says, and half of them in another spelling may be of anything
            let cf = slope == "scalefactor";
            let own = |part: &(&str, f64)| !cf || !CF.contains(&part.0);
            let [a, b] = match [self.number(slope), self.number(intercept)] {
                [Ok(a), Ok(b)] => [a.filter(own), b.filter(own)],
                _ if cf => continue,
                // an intercept without a slope that is no number is that of something else
                [Ok(None), Err(_)] if intercept == "intercept" => continue,
                [Err(_), Ok(None)] if slope == "unitsi" => continue,
                [a, b] => [a?, b?],
            };
            let by: Vec<&str> = [a, b].into_iter().flatten().map(|(name, _)| name).collect();
            if by.is_empty() || cf && by.len() < 2 {
                continue;
            }
            let linear = Linear {
                slope: a.map_or(1.0, |a| a.1),
                intercept: b.map_or(0.0, |b| b.1),
            };
            let stated = sound(linear, by.join(" and "))?;
            found = match found {
                Some(known) if known.linear != Linear::SAME => {
                    if linear != Linear::SAME {
                        return Err(format!("both {} and {}", known.by, stated.by));
                    }
                    Some(known)
                }
                _ => Some(stated),
            };
        }
        Ok(found)
    }

    /// Warns of attributes that may be a scale and are not taken as one; `taken` says that one is applied, of which
    /// they may be a part, and `of` where they are if not at the array.
    pub(crate) fn vague(&self, taken: bool, of: &str, warnings: &mut Vec<Warning>) {
        for (name, held) in &self.0 {
            let own = plain(name);
            let pair = PAIRS.iter().any(|p| [p.0, p.1].contains(&own.as_str()));
            let half = ["scalefactor", "addoffset"].contains(&own.as_str());
            let read = CF.contains(&name.as_str()) || pair && !half && held.number().is_some();
            // CF is read at the array; of a group more may be about anything
            let known = match of.is_empty() {
                true => is_vague(&own, held) && !read,
                false => pair && own != "unitsi" || own == "scalingfactor",
            };
            let numbers = held.numbers().filter(|_| known);
            let Some(numbers) = numbers else {
                continue;
            };
            let shift = ["offset", "bias", "inter"]
                .iter()
                .any(|part| own.contains(part));
            let nothing = numbers.iter().all(|n| *n == 0.0 || *n == 1.0 && !shift);
            let part = ["offset", "addoffset", "scalefactor", "scalingfactor"];
            if nothing || taken && part.contains(&own.as_str()) {
                continue;
            }
            warnings.push(Warning::from(format!(
                "the attribute {name} ({held}){of} is not applied: if it is of the values, the threshold is in stored \
                 numbers"
            )));
        }
    }
}

/// True for an attribute that may be a scale of the values, or a part of one. A list of numbers is none if its name
/// may be that of a place or of the size of a voxel.
fn is_vague(own: &str, held: &Held) -> bool {
    let of_values = VAGUE_ENDS.iter().any(|end| own.ends_with(end));
    match held.number() {
        Some(_) => of_values || VAGUE.contains(&own),
        None => of_values && Name::of(own).is_none(),
    }
}

impl Held {
    /// The numbers that it is, perhaps one in text.
    fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Held::Numbers(all) => Some(all.clone()),
            _ => self.number().map(|n| vec![n]),
        }
    }

    /// The number that it is, perhaps in text.
    fn number(&self) -> Option<f64> {
        match self {
            Held::Numbers(all) => <[f64; 1]>::try_from(&all[..]).ok().map(|[n]| n),
            Held::Texts(all) => match &all[..] {
                [one] => one.trim().parse().ok(),
                _ => None,
            },
            Held::Other => None,
        }
    }
}

/// The values of samples of which CF's attributes state some, and other ones a scale. A scale of 1 and 0 states nothing.
///
/// # Errors
/// A few words of two scales.
pub(crate) fn with_scale(
    cf: Option<Values>,
    other: Option<StatedScale>,
) -> Result<Option<Values>, String> {
    let Some(StatedScale { linear, by }) = other.filter(|other| other.linear != Linear::SAME)
    else {
        return Ok(cf);
    };
    match cf {
        None => Ok(Values::linear(linear.slope, linear.intercept, &by)),
        Some(values) if values.scale == Scale::All(Linear::SAME) => Ok(Some(Values {
            scale: Scale::All(linear),
            stated_by: format!("{by}; {}", values.stated_by),
            ..values
        })),
        Some(values) => Err(format!("both {} and {by}", values.stated_by)),
    }
}

/// A scale under which stored numbers that differ keep apart.
///
/// # Errors
/// A few words of a scale that is none.
pub(crate) fn sound(linear: Linear, by: String) -> Result<StatedScale, String> {
    if linear.slope == 0.0 || !linear.slope.is_finite() || !linear.intercept.is_finite() {
        return Err(format!("a scale of {} by {by}", linear.slope));
    }
    Ok(StatedScale { linear, by })
}

/// Chunks of an array that are not in the file.
pub(crate) struct Missing {
    /// `None` if nobody counted.
    pub(crate) count: Option<u64>,
    /// Chunks of the array.
    pub(crate) total: u64,
}

/// Says that chunks are not in the file: a warning if none is there.
pub(crate) fn missing(
    chunks: Missing,
    fill: &str,
    notes: &mut Vec<String>,
    warnings: &mut Vec<Warning>,
) {
    let total = chunks.total;
    match chunks.count {
        Some(0) => {}
        Some(n) if n == total => {
            let what = match total {
                1 => "no sample is there".into(),
                _ => format!("none of the {total} chunks is there"),
            };
            warnings.push(format!("{what}: all are the fill value {fill}").into());
        }
        Some(n) => notes.push(format!(
            "{n} of {total} chunks are missing and read as the fill value {fill}"
        )),
        None => notes.push(format!(
            "chunks that are missing are read as the fill value {fill}; among {total} they were not looked for"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_joins_what_cf_states_of_samples_without_value() {
        let linear = |slope| Linear {
            slope,
            intercept: 0.0,
        };
        let stated = |slope| {
            Some(StatedScale {
                linear: linear(slope),
                by: "slope".into(),
            })
        };
        let cf = |slope| Values {
            scale: Scale::All(linear(slope)),
            nothing: vec![-1.0],
            valid: None,
            stated_by: "_FillValue".into(),
        };
        assert_eq!(with_scale(None, None), Ok(None));
        // a scale that changes nothing contradicts none
        assert_eq!(with_scale(Some(cf(2.0)), stated(1.0)), Ok(Some(cf(2.0))));
        let both = Values {
            scale: Scale::All(linear(3.0)),
            stated_by: "slope; _FillValue".into(),
            ..cf(1.0)
        };
        assert_eq!(with_scale(Some(cf(1.0)), stated(3.0)), Ok(Some(both)));
        assert!(with_scale(Some(cf(2.0)), stated(3.0)).is_err());
    }
}
