//! Values of options, from text. Messages say what was expected; the parser adds option and value.

use super::filters::FilterArg;
use crate::error::Error;
use crate::error::Result;
use crate::grid::{Crop, Dims, Unit};
use bytesize::ByteSize;
use std::str::FromStr;

/// Three items with commas between them, or an `x`, as names of files often have it.
fn three<T: FromStr>(text: &str, expected: &str) -> Result<[T; 3], String> {
    let between = if text.contains(',') { ',' } else { 'x' };
    let items: Vec<T> = text
        .split(between)
        .map(|item| item.trim().parse().map_err(|_| expected.to_string()))
        .collect::<Result<_, _>>()?;
    items.try_into().map_err(|_| expected.to_string())
}

/// `x,y,z` in voxels; the range is checked where the volume is opened.
pub fn dims(text: &str) -> Result<[u64; 3], String> {
    three(text, "expected three numbers of voxels, as in 512,512,300")
}

/// `x,y,z`, or one number for all axes.
pub fn spacing(text: &str) -> Result<[f64; 3], String> {
    const EXPECTED: &str = "expected three numbers above 0, as in 0.5,0.5,2, or one for all axes";
    let values = match text.trim().parse() {
        Ok(all) => [all; 3],
        Err(_) => three(text, EXPECTED)?,
    };
    if values.iter().all(|v: &f64| v.is_finite() && *v > 0.0) {
        Ok(values)
    } else {
        Err(EXPECTED.to_string())
    }
}

/// `x,y,z` in voxels, above 0.
pub fn lengths(text: &str) -> Result<[f64; 3], String> {
    three(text, "expected three numbers, as in 40,30,20")
}

/// One number of cubes for all axes, or `x,y,z`.
pub fn macrocube(text: &str) -> Result<[u32; 3], String> {
    const EXPECTED: &str = "expected a number of cubes, as in 64, or three, as in 64,64,32";
    let values = match text.trim().parse() {
        Ok(all) => [all; 3],
        Err(_) => three(text, EXPECTED)?,
    };
    if values.contains(&0) {
        Err(EXPECTED.to_string())
    } else {
        Ok(values)
    }
}

/// A ratio of radii from 0.001 to 1, in thousandths.
pub fn ratio(text: &str) -> Result<u32, String> {
    let hint = "; to have none, put --split behind the names of files";
    let expected = |_| format!("expected a ratio of radii from 0.001 to 1{hint}");
    another_ratio(text).map_err(expected)
}

/// The same where there has to be one.
pub fn another_ratio(text: &str) -> Result<u32, String> {
    let expected = "expected a ratio of radii from 0.001 to 1, as 0.7";
    let value = text.trim().parse::<f64>().ok();
    let thousandths = value
        .map(|v| v * 1000.0)
        .filter(|v| (1.0..=1000.0).contains(v));
    thousandths.map_or(Err(expected.to_owned()), |v| Ok(v.round() as u32))
}

/// Voxels, from 0 on, in 1/256.
pub fn voxels_256(text: &str) -> Result<u32, String> {
    let value = text.trim().parse::<f64>().ok();
    let steps = value
        .map(|v| v * 256.0)
        .filter(|v| (0.0..=65_536.0).contains(v));
    let expected = "expected a number of voxels from 0 to 256";
    steps.map_or(Err(expected.to_owned()), |v| Ok(v.round() as u32))
}

/// A unit of length by its short name or English word.
pub fn length_unit(text: &str) -> Result<Unit, String> {
    let unit = text.parse().ok().filter(|unit| *unit != Unit::Voxel);
    unit.ok_or_else(|| "expected m, cm, mm, um or nm".to_string())
}

/// A unit's short name or English word.
pub fn unit(text: &str) -> Result<Unit, String> {
    text.parse()
        .map_err(|_| "expected voxel, m, cm, mm, um or nm".to_string())
}

/// A number of bytes: `2g` is 2 * 10^9, `2GiB` is 2 * 2^30.
pub fn bytes(text: &str) -> Result<u64, String> {
    let size: ByteSize = text
        .trim()
        .parse()
        .map_err(|_| "expected a number of bytes, as in 1GiB, 800MB or 1073741824".to_string())?;
    Ok(size.as_u64())
}

/// What a filter of this name takes; of a smoothing also a length, as in `20um`.
pub fn filter(name: &'static str) -> impl Fn(&str) -> Result<FilterArg, String> + Clone {
    move |text| {
        let read = format!("{name} {text}").parse().map(FilterArg::Known);
        read.or_else(|error: Error| match (length(text), error) {
            (Some((length, unit)), _) if name == "smooth" => Ok(FilterArg::Smooth { length, unit }),
            (_, Error::Usage { expected, .. }) if name == "smooth" => {
                Err(format!("expected {expected}, or a length, as in 20um"))
            }
            (_, Error::Usage { expected, .. }) => Err(format!("expected {expected}")),
            (_, other) => Err(other.to_string()),
        })
    }
}

/// A number above 0 with a unit of length behind it.
fn length(text: &str) -> Option<(f64, Unit)> {
    let unit = |c: char| c.is_alphabetic() && !"eE".contains(c);
    let (number, unit) = text.split_at(text.find(unit)?);
    let number = number.trim().parse().ok()?;
    let unit = length_unit(unit).ok()?;
    (f64::is_finite(number) && number > 0.0).then_some((number, unit))
}

/// A finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(v) if f64::is_finite(v) => Ok(v),
        _ => Err("expected a finite number".to_string()),
    }
}

/// A box of voxels of which bounds may be left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CropArg([(Option<u32>, Option<u32>); 3]);

/// `x0:x1,y0:y1,z0:z1`; any bound may be missing.
pub fn crop(text: &str) -> Result<CropArg, String> {
    const EXPECTED: &str =
        "expected x0:x1,y0:y1,z0:z1 (half-open, a missing bound is the volume's)";
    let bound = |t: &str| match t.trim() {
        "" => Ok(None),
        t => t.parse().map(Some).map_err(|_| EXPECTED.to_string()),
    };
    let ranges: Vec<_> = text
        .split(',')
        .map(|range| {
            let (low, high) = range.split_once(':').ok_or(EXPECTED)?;
            Ok((bound(low)?, bound(high)?))
        })
        .collect::<Result<_, String>>()?;
    let ranges = ranges.try_into().map_err(|_| EXPECTED.to_string())?;
    Ok(CropArg(ranges))
}

impl CropArg {
    /// The box in a volume of this size.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if it leaves the volume or has fewer than 2 voxels along an axis.
    pub fn resolve(&self, dims: Dims) -> Result<Crop> {
        let [x, y, z] = std::array::from_fn(|a| {
            let (low, high) = self.0[a];
            low.unwrap_or(0)..high.unwrap_or(dims.0[a])
        });
        let crop = Crop { x, y, z };
        crop.dims_in(dims).map(|_| crop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read() {
        assert_eq!(dims("512,512, 300"), Ok([512, 512, 300]));
        assert_eq!(dims("512x512 x 300"), Ok([512, 512, 300]));
        assert_eq!(spacing("0.5"), Ok([0.5; 3]));
        assert_eq!(spacing("0.5x0.5x2"), Ok([0.5, 0.5, 2.0]));
        assert_eq!(spacing("1,2,3e-1"), Ok([1.0, 2.0, 0.3]));
        assert_eq!(macrocube("64"), Ok([64; 3]));
        assert_eq!(macrocube("64,32,16"), Ok([64, 32, 16]));
        assert_eq!(bytes("2g"), Ok(2_000_000_000));
        assert_eq!(bytes("2GiB"), Ok(1 << 31));
        assert_eq!(bytes("1.5 MiB"), Ok(3 << 19));
        assert_eq!(bytes("4096"), Ok(4096));
    }

    #[test]
    fn nonsense_is_refused() {
        for bad in [
            "", "1,2", "1,2,3,4", "a,b,c", "-1,2,3", "1;2;3", "1x2", "x", "1x2,3", "0x10x1x2",
        ] {
            assert!(dims(bad).is_err(), "{bad}");
            assert!(macrocube(bad).is_err(), "{bad}");
        }
        for bad in ["0,1,1", "nan", "inf,1,1", "-1", ""] {
            assert!(spacing(bad).is_err(), "{bad}");
        }
        for bad in ["nan", "inf", "otsu", ""] {
            assert!(finite(bad).is_err(), "{bad}");
        }
        for bad in ["", "1parsec", "-1", "GiB"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
        assert!(macrocube("0").is_err() && macrocube("64,0,64").is_err());
    }

    #[test]
    fn bounds_of_a_crop_may_be_missing() {
        let d = Dims([10, 20, 30]);
        let whole = crop(":,:,:").unwrap().resolve(d).unwrap();
        assert_eq!(whole, Crop::whole(d));
        let part = crop("2:,:7,3:9").unwrap().resolve(d).unwrap();
        assert_eq!((part.x, part.y, part.z), (2..10, 0..7, 3..9));
        for bad in ["", "1:2", "1,2,3", "a:b,:,:", "-1:4,:,:", ":,:,:,:"] {
            assert!(crop(bad).is_err(), "{bad}");
        }
        for bad in ["0:11,:,:", "5:6,:,:", "6:5,:,:", "10:,:,:"] {
            assert!(crop(bad).unwrap().resolve(d).is_err(), "{bad}");
        }
    }
}
