//! The size of pixels from TIFF's resolution.

use crate::error::Result;
use crate::grid::Unit;
use crate::grid::length::Length;
use crate::volume::formats::tiff::ifd::{Directory, Ratio};
use crate::volume::stated::size::Step;

/// XResolution and YResolution as they stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Resolution {
    /// 1: no unit, 2: inch, 3: centimetre.
    pub(crate) unit: u64,
    pub(crate) x: Option<Ratio>,
    pub(crate) y: Option<Ratio>,
}

impl Resolution {
    pub(crate) fn read(dir: &Directory) -> Result<Self> {
        Ok(Resolution {
            unit: dir.number(296, 2)?,
            x: dir.ratio(282)?,
            y: dir.ratio(283)?,
        })
    }

    /// Pixels per `unit` as sizes of a pixel in that unit, whatever TIFF's own unit is.
    pub(crate) fn per(&self, unit: &str) -> [Option<Step>; 2] {
        [self.x, self.y].map(|ratio| ratio.map(|r| Step::new(size(r, 1, 1), unit)))
    }

    /// The size of a pixel in millimetres, if the resolution has a unit and may be that of a scan.
    pub(crate) fn millimetres(&self) -> Option<[f64; 2]> {
        let (Some(x), Some(y)) = (self.x, self.y) else {
            return None;
        };
        let one = |r: Ratio| r.above == r.below;
        let (above, below) = match self.unit {
            // one per inch or centimetre is what programs write that know of no size
            _ if one(x) && one(y) => return None,
            2 => (254, 10),
            3 => (10, 1),
            _ => return None,
        };
        Some([size(x, above, below), size(y, above, below)])
    }

    /// The size of a pixel by TIFF's own unit, as a number of another one, if that is a length.
    pub(crate) fn in_unit(&self, unit: &str) -> [Option<Step>; 2] {
        let shown = Length::parse(unit).map_or(Unit::Millimetre, Length::shown_in);
        let steps = self.millimetres().map(|size| {
            size.map(|s| {
                Some(Step::new(
                    Length::from(Unit::Millimetre).convert(s, shown),
                    shown.to_string(),
                ))
            })
        });
        steps.unwrap_or_default()
    }

    /// The dots per inch that screens and printers have, if this is such a resolution: programs that know nothing of
    /// the scan put it in.
    pub(crate) fn of_paper(&self) -> Option<f64> {
        let [x, y] = self.millimetres()?;
        let dpi = 25.4 / x;
        let usual = [
            72.0, 75.0, 90.0, 96.0, 100.0, 120.0, 150.0, 200.0, 300.0, 400.0, 600.0,
        ];
        let usual = usual.into_iter().chain([720.0, 1200.0, 1440.0, 2400.0]);
        let near = |usual: &f64| (dpi - usual).abs() < 0.002 * usual;
        usual.into_iter().find(near).filter(|_| x == y)
    }

    /// What to say of such a resolution.
    pub(crate) fn note_of_paper(&self) -> Option<String> {
        let dpi = self.of_paper()?;
        Some(format!(
            "a resolution of {dpi} dots per inch is taken for that of a screen or printer, not of the scan: give \
             --spacing and --unit if it is"
        ))
    }

    /// The steps along x, y and z that TIFF's own tags state, and a note if they are not taken.
    pub(crate) fn steps(&self) -> ([Option<Step>; 3], Option<String>) {
        if let Some(note) = self.note_of_paper() {
            return ([const { None }; 3], Some(note));
        }
        if let Some([x, y]) = self.millimetres() {
            return (
                [Some(Step::new(x, "mm")), Some(Step::new(y, "mm")), None],
                None,
            );
        }
        match (self.unit, self.x, self.y) {
            // without a unit it states the shape of pixels
            (1, Some(x), Some(y)) if x.above * y.below != y.above * x.below => {
                let [x, y] = self.per("");
                ([x, y, None], None)
            }
            _ => ([const { None }; 3], None),
        }
    }
}

/// `above / below` of the inverse of a fraction: a size from a resolution.
fn size(ratio: Ratio, above: u64, below: u64) -> f64 {
    // numbers of 32 bits and factors below 256: both products are exact in an f64
    let size = (ratio.below * above) as f64 / (ratio.above * below) as f64;
    // ImageJ cuts off what is beyond a millionth
    let cut = match ratio.below {
        1_000_000 if ratio.above >= 1000 => 1.0 / ratio.above as f64,
        _ => 0.0,
    };
    short(size, cut)
}

/// The decimal number that a size was written for: fractions of 32 bits, and the f32 on their way, do not hold it
/// exactly. `cut` is what the size may be too large by, as a part of it.
fn short(size: f64, cut: f64) -> f64 {
    // few digits that are met by chance are within what the fraction cannot tell
    for (digits, off) in [(8, 1e-9), (6, f64::from(f32::EPSILON))] {
        for digits in 0..digits {
            let near: f64 = format!("{size:.digits$e}").parse().unwrap_or(size);
            if near >= size * (1.0 - off.max(cut)) && near <= size * (1.0 + off) {
                return near;
            }
        }
    }
    size
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_that_were_meant() {
        for (above, below, expected) in [
            // by hand, by tifffile, by ImageJ (cut at a millionth), by libtiff (an f32)
            (20_000_000, 1_000_000, 0.05),
            (100, 13, 0.13),
            (7_692_307, 1_000_000, 0.13),
            (3333, 1_000_000, 300.0),
            (142_857, 1_000_000, 7.0),
            (2, 1, 0.5),
            (4_294_967_295, 558_345_748, 0.13),
            (3, 1, 1.0 / 3.0),
            (7, 1, 1.0 / 7.0),
            (72, 1, 1.0 / 72.0),
        ] {
            assert_eq!(
                size(Ratio { above, below }, 1, 1),
                expected,
                "{above}/{below}"
            );
        }
        // 0.13 mm in pixels per inch, as an f32; 26.41304 um in pixels per centimetre
        let inch = Ratio {
            above: 819_502_464,
            below: 4_194_304,
        };
        assert_eq!(size(inch, 254, 10), 0.13);
        let cm = Ratio {
            above: 125_000_000,
            below: 330_163,
        };
        assert_eq!(size(cm, 10, 1), 0.02641304);
    }

    #[test]
    fn paper_is_no_scan() {
        let of = |unit, above, below| {
            let ratio = Some(Ratio { above, below });
            Resolution {
                unit,
                x: ratio,
                y: ratio,
            }
        };
        assert_eq!(of(2, 300, 1).of_paper(), Some(300.0));
        assert_eq!(of(3, 1181, 10).of_paper(), Some(300.0));
        assert_eq!(of(2, 254, 1).of_paper(), None);
        assert_eq!(of(2, 254, 1).millimetres(), Some([0.1; 2]));
        assert_eq!(of(2, 1, 1).millimetres(), None);
        assert_eq!(of(1, 254, 1).millimetres(), None);
    }
}
