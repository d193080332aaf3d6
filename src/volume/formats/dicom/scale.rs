//! The scale of a frame's stored numbers: the rescale, or, where that changes nothing, the mapping to real-world values
//! or the scaling of a dose.

use crate::error::{Error, Result};
use crate::volume::formats::dicom::element::Elements;
use crate::volume::formats::dicom::frame::{Context, Groups, Rescale, Stated};
use crate::volume::formats::dicom::tag;

/// The scale that a file states for a frame.
pub(crate) struct Scale {
    pub(crate) rescale: Rescale,
    /// Where it is stated; empty if stored numbers are the values.
    pub(crate) by: &'static str,
    /// What a user should know of it.
    pub(crate) remark: Option<&'static str>,
}

const REAL_WORLD: &str = "RealWorldValueMapping";

impl Context<'_> {
    /// # Errors
    /// [`Error::Unsupported`] for a table of values and for several mappings that differ, [`Error::Format`] for
    /// numbers that are no scale.
    pub(crate) fn scale(&self, groups: &Groups) -> Result<Scale> {
        let rescale = self.rescale(groups)?;
        let mappings = groups.items(tag::REAL_WORLD);
        if rescale != Rescale::NONE {
            let differs = mappings.iter().any(|item| linear(item) != Some(rescale));
            return Ok(Scale {
                rescale,
                by: "RescaleSlope and RescaleIntercept",
                remark: differs.then_some(
                    "the file's RealWorldValueMapping is not applied, since it states a rescale too",
                ),
            });
        }
        let dose = self.set.number(tag::DOSE_SCALING);
        match (mappings, dose) {
            ([], None) => Ok(Scale {
                rescale,
                by: "",
                remark: None,
            }),
            ([], Some(slope)) => Ok(Scale {
                rescale: self.checked(slope, 0.0, "DoseGridScaling")?,
                by: "DoseGridScaling",
                remark: None,
            }),
            _ => self.real_world(mappings),
        }
    }

    /// Which elements on values a frame has.
    pub(crate) fn stated(&self, groups: &Groups) -> Stated {
        let text = |tag: u32| {
            let set = groups.find(tag::PIXEL_VALUES, tag);
            set.map_or(String::new(), |set| set.text(tag).trim().to_owned())
        };
        let mapping = groups.items(tag::REAL_WORLD).first();
        let code = mapping.and_then(|item| item.items(tag::REAL_UNITS).first());
        let dose = self.set.number(tag::DOSE_SCALING).is_some();
        let there = |tag: u32| !text(tag).is_empty();
        Stated {
            scale: [
                there(tag::SLOPE),
                there(tag::INTERCEPT),
                mapping.is_some(),
                dose,
            ],
            units: [
                text(tag::RESCALE_TYPE),
                self.set.text(tag::UNITS),
                code.map_or(String::new(), |code| code.text(tag::CODE_VALUE)),
                self.set.text(tag::DOSE_UNITS),
            ],
        }
    }

    fn rescale(&self, groups: &Groups) -> Result<Rescale> {
        let get = |tag: u32, default: f64| match groups.find(tag::PIXEL_VALUES, tag) {
            None => Ok(default),
            Some(set) if set.text(tag).is_empty() => Ok(default),
            Some(set) => set.number(tag).ok_or_else(|| {
                let found = format!("the rescale of \"{}\"", set.text(tag));
                self.wrong(found, "a finite number")
            }),
        };
        self.checked(get(tag::SLOPE, 1.0)?, get(tag::INTERCEPT, 0.0)?, "rescale")
    }

    fn checked(&self, slope: f64, intercept: f64, what: &str) -> Result<Rescale> {
        if slope == 0.0 || !slope.is_finite() || !intercept.is_finite() {
            let found = format!("a {what} slope of {slope} and intercept of {intercept}");
            return Err(self.wrong(found, "finite numbers, and a slope other than 0"));
        }
        Ok(Rescale { slope, intercept })
    }

    /// The one scale of these mappings.
    fn real_world(&self, mappings: &[Elements]) -> Result<Scale> {
        let no = |what: &str| {
            let what = format!("a DICOM image with {what} ({REAL_WORLD})");
            Error::unsupported(self.path, what, "convert it to plain values")
        };
        let mut scales = mappings.iter().map(linear);
        let Some(Some(first)) = scales.next() else {
            return Err(no("a table of values"));
        };
        if scales.any(|other| other != Some(first)) {
            return Err(no("several scales of its values"));
        }
        let same = first == Rescale::NONE;
        let whole = same || mappings.iter().any(|item| self.covers(item));
        Ok(Scale {
            rescale: self.checked(first.slope, first.intercept, REAL_WORLD)?,
            by: if same { "" } else { REAL_WORLD },
            remark: (!whole).then_some(
                "the file's RealWorldValueMapping is stated for a part of the stored numbers, and applied to all",
            ),
        })
    }

    /// True if a mapping is stated for every number that the stored bits can be.
    fn covers(&self, item: &Elements) -> bool {
        let bits = self.set.short(tag::BITS_STORED).unwrap_or(16).clamp(1, 32);
        let signed = self.set.short(tag::SIGNED) == Some(1);
        let (low, high) = match signed {
            true => (-(1i64 << (bits - 1)), (1i64 << (bits - 1)) - 1),
            false => (0, (1i64 << bits) - 1),
        };
        let end = |wide: u32, narrow: u32| {
            let short = item.short(narrow).map(|v| match signed {
                true => f64::from(v as i16),
                false => f64::from(v),
            });
            item.double(wide).or(short)
        };
        let first = end(tag::REAL_FIRST, tag::REAL_FIRST_SHORT);
        let last = end(tag::REAL_LAST, tag::REAL_LAST_SHORT);
        match (first, last) {
            (Some(first), Some(last)) => first <= low as f64 && last >= high as f64,
            _ => true,
        }
    }
}

/// The slope and intercept of a mapping; `None` if it is a table.
fn linear(item: &Elements) -> Option<Rescale> {
    if item.has(tag::REAL_LOOKUP) {
        return None;
    }
    Some(Rescale {
        slope: item.double(tag::REAL_SLOPE)?,
        intercept: item.double(tag::REAL_INTERCEPT)?,
    })
}
