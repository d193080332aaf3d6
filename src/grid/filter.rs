//! What is done to the samples of a volume before they are compared with the threshold: names, numbers, and what
//! becomes of the grid. The samples themselves are filtered in `volume`.

use super::length::product;
use super::{Dims, Dtype, Placement};
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The most filters of a volume: each is a volume around the one before it.
pub const MAX_FILTERS: usize = 16;

/// A filter, with what it is told. As text it is the name and, after a blank, the numbers: `clamp 10,200`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", rename_all = "lowercase", deny_unknown_fields)]
pub enum Filter {
    /// Dark becomes bright. Whole numbers change places with those at the other end of their type: v becomes 255 - v
    /// in u8 and -1 - v in i16. Floats change their sign.
    Invert {},
    /// Values below `low` become `low`, those above `high` become `high`; NaN stays. Of whole numbers the bounds are
    /// the smallest and the largest between the two.
    Clamp {
        /// Finite.
        low: f64,
        /// Finite, and not below `low`.
        high: f64,
    },
    /// Each block of `factor` x `factor` x `factor` voxels becomes its mean: of whole numbers the nearest one, of two
    /// the even one. NaN counts for nothing; a block of nothing else is NaN. Voxels at the far faces that fill no
    /// block are left out.
    Downsample {
        /// 2 to 16.
        factor: u32,
    },
    /// Each value becomes the mean of those around it with the weights of a Gaussian: `scipy.ndimage.gaussian_filter`
    /// with mode `nearest`, cut at 4 standard deviations. The values are floats then, f64 where they were f64, else
    /// f32. What is not finite stays where it is and counts for no other voxel.
    Smooth {
        /// Standard deviations.
        sigma: Sigma,
    },
    /// Each value becomes the median of the cube of 2 `radius` + 1 voxels around it: `scipy.ndimage.median_filter` with
    /// mode `nearest`. NaN stays where it is and counts for no other voxel.
    Median {
        /// 1 or 2.
        radius: u32,
    },
}

/// Standard deviations along x, y and z in voxels, 0 to 32 and not all 0. In JSON and as text one number where they
/// are the same.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "OneOrThree", into = "OneOrThree")]
pub struct Sigma(pub [f64; 3]);

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum OneOrThree {
    One(f64),
    Three([f64; 3]),
}

impl From<OneOrThree> for Sigma {
    fn from(numbers: OneOrThree) -> Self {
        match numbers {
            OneOrThree::One(all) => Sigma([all; 3]),
            OneOrThree::Three(each) => Sigma(each),
        }
    }
}

impl From<Sigma> for OneOrThree {
    fn from(Sigma(each): Sigma) -> Self {
        match each == [each[0]; 3] {
            true => OneOrThree::One(each[0]),
            false => OneOrThree::Three(each),
        }
    }
}

impl fmt::Display for Sigma {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match OneOrThree::from(*self) {
            OneOrThree::One(all) => write!(f, "{all}"),
            OneOrThree::Three([x, y, z]) => write!(f, "{x},{y},{z}"),
        }
    }
}

/// The largest standard deviation.
const MAX_SIGMA: f64 = 32.0;

/// Names of filters, and what each takes, for messages.
const TAKES: [(&str, &str); 5] = [
    ("invert", "nothing"),
    (
        "clamp",
        "two finite numbers, as in 10,200, the first not above the second",
    ),
    (
        "downsample",
        "a whole number of voxels from 2 to 16, as in 2",
    ),
    (
        "smooth",
        "a number of voxels above 0 and up to 32, as in 1.5, or one for each axis",
    ),
    ("median", "1 or 2 voxels"),
];

impl Filter {
    /// The name, which is that of the option without its dashes.
    pub fn name(&self) -> &'static str {
        match self {
            Filter::Invert {} => "invert",
            Filter::Clamp { .. } => "clamp",
            Filter::Downsample { .. } => "downsample",
            Filter::Smooth { .. } => "smooth",
            Filter::Median { .. } => "median",
        }
    }

    /// Refuses numbers that are out of range.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self) -> Result<()> {
        let good = match *self {
            Filter::Invert {} => true,
            Filter::Clamp { low, high } => low.is_finite() && high.is_finite() && low <= high,
            Filter::Downsample { factor } => (2..=16).contains(&factor),
            Filter::Smooth { sigma: Sigma(each) } => {
                each.iter().all(|s| (0.0..=MAX_SIGMA).contains(s)) && each != [0.0; 3]
            }
            Filter::Median { radius } => (1..=2).contains(&radius),
        };
        match good {
            true => Ok(()),
            false => Err(self.refused(&self.values(), takes(self.name()).unwrap_or_default())),
        }
    }

    /// The size of what it makes of a volume of this size.
    ///
    /// # Errors
    /// [`Error::Usage`] if that is none.
    pub fn dims(&self, dims: Dims) -> Result<Dims> {
        let Filter::Downsample { factor } = *self else {
            return Ok(dims);
        };
        Dims::new(dims.0.map(|n| u64::from(n / factor.max(1)))).map_err(|_| {
            let expected = "a factor that leaves at least 2 voxels along each axis";
            self.refused(&format!("{factor} for {dims} voxels"), expected)
        })
    }

    /// The type of what it makes of samples of this type.
    pub fn dtype(&self, dtype: Dtype) -> Dtype {
        match self {
            Filter::Smooth { .. } if dtype == Dtype::F64 => Dtype::F64,
            Filter::Smooth { .. } => Dtype::F32,
            _ => dtype,
        }
    }

    /// Where the voxels lie that it makes of voxels in this place: one that stands for a block in the middle of it.
    pub fn placement(&self, place: Placement) -> Placement {
        let Filter::Downsample { factor } = *self else {
            return place;
        };
        let factor = f64::from(factor);
        Placement {
            spacing: place.spacing.map(|size| product(size, factor)),
            origin: place.world([(factor - 1.0) / 2.0; 3]),
            ..place
        }
    }

    /// How many times longer voxels become along each axis.
    pub fn factor(&self) -> u32 {
        match *self {
            Filter::Downsample { factor } => factor,
            _ => 1,
        }
    }

    /// The numbers that it is told, as they are typed; nothing for one that takes none.
    pub fn values(&self) -> String {
        match self {
            Filter::Invert {} => String::new(),
            Filter::Clamp { low, high } => format!("{low},{high}"),
            Filter::Downsample { factor } => factor.to_string(),
            Filter::Smooth { sigma } => sigma.to_string(),
            Filter::Median { radius } => radius.to_string(),
        }
    }

    /// An error that names the option.
    pub(crate) fn refused(&self, found: &str, expected: impl Into<String>) -> Error {
        Error::usage(format!("--{}", self.name()), found, expected)
    }
}

/// What the filter of a name takes.
fn takes(name: &str) -> Option<&'static str> {
    let known = TAKES.iter().find(|(known, _)| *known == name);
    known.map(|(_, takes)| *takes)
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.values().as_str() {
            "" => f.write_str(self.name()),
            values => write!(f, "{} {values}", self.name()),
        }
    }
}

impl FromStr for Filter {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (name, value) = text.split_once(' ').unwrap_or((text, ""));
        let Some(expected) = takes(name) else {
            let names = TAKES.map(|(name, _)| name).join(", ");
            return Err(Error::usage("filter", text, format!("one of {names}")));
        };
        let value = value.trim();
        let read = match name {
            "clamp" => numbers(value).map(|[low, high]| Filter::Clamp { low, high }),
            "downsample" => whole(value).map(|factor| Filter::Downsample { factor }),
            "smooth" => {
                let one = numbers(value).map(|[all]| [all; 3]);
                let sigma = one.or_else(|| numbers(value)).map(Sigma);
                sigma.map(|sigma| Filter::Smooth { sigma })
            }
            "median" => whole(value).map(|radius| Filter::Median { radius }),
            _ => value.is_empty().then_some(Filter::Invert {}),
        };
        read.filter(|filter| filter.check().is_ok())
            .ok_or_else(|| Error::usage(format!("--{name}"), value, expected))
    }
}

/// So many numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let each = text.split(',').map(|number| number.trim().parse().ok());
    each.collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// A whole number.
fn whole(text: &str) -> Option<u32> {
    text.parse().ok()
}

/// Filters as text, in their order, with commas between them; `none` if there is none.
pub fn filters_text(filters: &[Filter]) -> String {
    let texts: Vec<String> = filters.iter().map(Filter::to_string).collect();
    match texts.as_slice() {
        [] => "none".to_owned(),
        texts => texts.join(", "),
    }
}

/// Refuses filters with numbers that are out of range, and too many.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_filters(filters: &[Filter]) -> Result<()> {
    if filters.len() > MAX_FILTERS {
        let found = format!("{} of them", filters.len());
        let expected = format!("at most {MAX_FILTERS}");
        return Err(Error::usage("filters", found, expected));
    }
    filters.iter().try_for_each(Filter::check)
}

/// The size of what filters make of a volume, in their order.
///
/// # Errors
/// [`Error::Usage`] if that is none.
pub fn filtered_dims(dims: Dims, filters: &[Filter]) -> Result<Dims> {
    filters.iter().try_fold(dims, |dims, f| f.dims(dims))
}

/// The type of what filters make of samples, in their order.
pub fn filtered_dtype(dtype: Dtype, filters: &[Filter]) -> Dtype {
    filters.iter().fold(dtype, |dtype, f| f.dtype(dtype))
}

/// Filters that a volume has been through, at least one, and what it was before.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// In the order in which they were applied.
    pub filters: Vec<Filter>,
    /// Its size before.
    pub dims: Dims,
    /// Its type of samples before.
    pub dtype: Dtype,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;

    #[test]
    fn texts_read_back() {
        for text in [
            "invert",
            "clamp 10,200",
            "clamp -0.5,0.5",
            "downsample 2",
            "smooth 1.5",
            "smooth 2,2,0.5",
            "median 2",
        ] {
            let filter: Filter = text.parse().unwrap();
            assert_eq!(filter.to_string(), text);
            let json = serde_json::to_string(&filter).unwrap();
            assert_eq!(serde_json::from_str::<Filter>(&json).unwrap(), filter);
        }
        let json = r#"{"name":"clamp","low":1.0,"high":2.0}"#;
        let one: Filter = serde_json::from_str(r#"{"name":"smooth","sigma":1}"#).unwrap();
        let json_of_one = serde_json::to_string(&one).unwrap();
        assert_eq!(
            (one.to_string().as_str(), json_of_one.as_str()),
            ("smooth 1", r#"{"name":"smooth","sigma":1.0}"#)
        );
        let clamp: Filter = "clamp 1, 2".parse().unwrap();
        assert_eq!(serde_json::to_string(&clamp).unwrap(), json);
    }

    #[test]
    fn bad_values_are_refused() {
        for (text, part) in [
            ("invert 3", "--invert: found 3, expected nothing"),
            ("clamp 5,1", "--clamp: found 5,1, expected two finite"),
            ("clamp 5", "two finite numbers"),
            ("clamp nan,1", "two finite numbers"),
            ("clamp 0,inf", "two finite numbers"),
            ("downsample 1", "from 2 to 16"),
            ("downsample 17", "from 2 to 16"),
            ("downsample 2.5", "from 2 to 16"),
            ("downsample -2", "from 2 to 16"),
            ("downsample", "from 2 to 16"),
            ("smooth 0", "above 0 and up to 32"),
            ("smooth -1", "above 0 and up to 32"),
            ("smooth nan", "above 0 and up to 32"),
            ("smooth 33", "above 0 and up to 32"),
            ("smooth 1,2", "or one for each axis"),
            ("median 3", "--median: found 3, expected 1 or 2 voxels"),
            (
                "sharpen 2",
                "one of invert, clamp, downsample, smooth, median",
            ),
        ] {
            let message = text.parse::<Filter>().unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
        for json in [
            r#"{"name":"sharpen"}"#,
            r#"{"name":"invert","factor":2}"#,
            r#"{"name":"downsample"}"#,
            r#"{"name":"downsample","factor":2,"low":1}"#,
            r#"{"name":"smooth","sigma":[1,2]}"#,
            r#"{"name":"smooth","sigma":"1"}"#,
        ] {
            assert!(serde_json::from_str::<Filter>(json).is_err(), "{json}");
        }
        let many = vec![Filter::Invert {}; MAX_FILTERS + 1];
        assert!(check_filters(&many[1..]).is_ok() && check_filters(&many).is_err());
        assert!(check_filters(&[Filter::Downsample { factor: 0 }]).is_err());
    }

    #[test]
    fn a_voxel_of_a_block_lies_in_its_middle() {
        let half = Filter::Downsample { factor: 2 };
        assert_eq!(half.dims(Dims([9, 8, 4])).unwrap(), Dims([4, 4, 2]));
        let message = half.dims(Dims([9, 8, 3])).unwrap_err().to_string();
        assert!(message.contains("2 for 9 x 8 x 3 voxels"), "{message}");
        let place = Placement {
            spacing: [0.1, 0.25, 2.0],
            unit: Unit::Millimetre,
            origin: [10.0, -3.0, 0.5],
            // x runs down, y to the left
            directions: [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let third = Filter::Downsample { factor: 3 };
        let found = third.placement(place);
        assert_eq!(
            found.spacing,
            [0.1 * 3.0, 0.75, 6.0].map(|v: f64| (v * 1e9).round() / 1e9)
        );
        assert_eq!(found.origin, [9.75, -3.1, 2.5]);
        assert_eq!(
            (found.unit, found.directions),
            (place.unit, place.directions)
        );
        assert_eq!(Filter::Invert {}.placement(place), place);
        let list = [half, third, Filter::Invert {}];
        assert_eq!(
            filtered_dims(Dims([25, 24, 12]), &list).unwrap(),
            Dims([4, 4, 2])
        );
        assert_eq!(filters_text(&list), "downsample 2, downsample 3, invert");
    }
}
