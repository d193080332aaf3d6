//! The option `--threshold`: a value, or a method that finds it.

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::volume::{RegionVoxels, Statistics, ThresholdMethod, Volume, statistics};
use std::path::Path;

/// What `--threshold` takes, as the help shows it.
pub const TAKES: &str = "T|METHOD";

/// A threshold, given or to be found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Threshold {
    /// This value.
    Value(f64),
    /// The value that this method finds.
    Method(ThresholdMethod),
}

/// A finite number, or a method.
pub fn threshold(text: &str) -> Result<Threshold, String> {
    if let Ok(method) = text.parse() {
        return Ok(Threshold::Method(method));
    }
    if text.trim().to_ascii_lowercase().starts_with("porosity") {
        let expected =
            "expected a share above 0 and below 100 %, as in porosity=31% or porosity=0.31";
        return Err(expected.to_owned());
    }
    super::parse::finite(text)
        .map(Threshold::Value)
        .map_err(|_| {
            "expected a finite number, or otsu, peaks, li, triangle or porosity=P%".to_string()
        })
}

impl Threshold {
    /// The value, for which a method reads all of the volume, or of its region.
    ///
    /// # Errors
    /// The volume's own, or [`Error::Usage`] if the method finds none.
    pub fn find(
        self,
        volume: &dyn Volume,
        region: Option<&RegionVoxels>,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<f64> {
        Ok(all(&[self], volume, region, path, progress)?[0])
    }
}

/// Several thresholds; however many methods there are, the volume is read for them once.
///
/// # Errors
/// As of [`Threshold::find`].
pub fn all(
    asked: &[Threshold],
    volume: &dyn Volume,
    region: Option<&RegionVoxels>,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Vec<f64>> {
    let mut read = None;
    let mut values = Vec::new();
    for &threshold in asked {
        values.push(match threshold {
            Threshold::Value(t) => t,
            Threshold::Method(method) => {
                let found = match read.take() {
                    Some(found) => found,
                    None => {
                        let found = statistics(volume, region, progress)?;
                        found.coarse().iter().for_each(|text| progress.warn(text));
                        found
                    }
                };
                let found = read.insert(found);
                let value = of(found, method, path)?;
                let clipped = found.clipped();
                let clipped = clipped.filter(|_| method == ThresholdMethod::Peaks);
                missed(found, method, value)
                    .iter()
                    .chain(&clipped)
                    .for_each(|text| progress.warn(text));
                value
            }
        });
    }
    Ok(values)
}

/// Says so if a porosity that was asked for is not what the threshold gives.
pub fn missed(found: &Statistics, method: ThresholdMethod, value: f64) -> Option<String> {
    /// What a porosity may be off, as a share.
    const OFF: f64 = 0.005;
    let ThresholdMethod::Porosity(share) = method else {
        return None;
    };
    let below = 1.0 - found.share_above(value);
    ((below - share).abs() > OFF).then(|| {
        format!(
            "{method} is not to be had: no threshold parts the samples so; at {value}, which is nearest, {:.2} % of the \
             voxels are below",
            100.0 * below
        )
    })
}

/// The threshold that a method finds in what is known of a volume.
///
/// # Errors
/// [`Error::Usage`] if it finds none.
pub fn of(found: &Statistics, method: ThresholdMethod, path: &Path) -> Result<f64> {
    found.threshold(method).ok_or_else(|| {
        let why = found.why_none(method);
        Error::usage(
            "--threshold",
            format!("{method}, but in {} {why}", path.display()),
            "a number, or another method",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_and_methods_are_read() {
        assert_eq!(
            threshold("OTSU"),
            Ok(Threshold::Method(ThresholdMethod::Otsu))
        );
        assert_eq!(threshold("-1e3"), Ok(Threshold::Value(-1000.0)));
        assert_eq!(
            threshold("porosity=31%"),
            Ok(Threshold::Method(ThresholdMethod::Porosity(0.31)))
        );
        for bad in ["nan", "inf", "otsu2", ""] {
            assert!(threshold(bad).unwrap_err().contains("otsu"), "{bad}");
        }
        for bad in ["porosity", "porosity=0", "porosity=100%", "porosity=31"] {
            assert!(threshold(bad).unwrap_err().contains("below 100 %"), "{bad}");
        }
    }
}
