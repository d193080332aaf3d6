//! Thresholds that follow from a histogram.

use crate::error::Error;
use crate::volume::stats::histogram::Levels;
use crate::volume::stats::peaks::two_peaks;
use std::fmt;
use std::str::FromStr;

/// Bins of the triangle method for samples that are not counted one by one, as scikit-image has them.
const TRIANGLE_BINS: usize = 256;
/// More steps than Li's method ever takes.
const MOST_STEPS: usize = 10_000;

/// How a threshold is found in the histogram of a volume. Samples of at least the threshold are above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ThresholdMethod {
    /// The split into two classes with the largest variance between them (N. Otsu, A threshold selection method from
    /// gray-level histograms, 1979): good where the two heaps are of like size.
    Otsu,
    /// Half-way between the two peaks of the histogram: good where there is little of one phase.
    Peaks,
    /// Minimum cross entropy, by iteration (C. H. Li and P. K. S. Tam, An iterative algorithm for minimum cross entropy
    /// thresholding, 1998).
    Li,
    /// Farthest from the line between the peak and the far end of its longer tail (G. W. Zack, W. E. Rogers and
    /// S. A. Latt, Automatic measurement of sister chromatid exchange frequency, 1977): good for one heap with a tail.
    Triangle,
    /// So that this share of the samples, above 0 and below 1, is below: for a porosity that is known by other means.
    Porosity(f64),
}

impl ThresholdMethod {
    /// Those that need no number, in the order of the help.
    pub const PLAIN: [ThresholdMethod; 4] = [
        ThresholdMethod::Otsu,
        ThresholdMethod::Peaks,
        ThresholdMethod::Li,
        ThresholdMethod::Triangle,
    ];

    /// How the threshold was found, as it follows its value in a sentence.
    pub fn how(self) -> String {
        match self {
            ThresholdMethod::Otsu => "by Otsu's method".to_owned(),
            ThresholdMethod::Peaks => "half-way between the two peaks".to_owned(),
            ThresholdMethod::Li => "by Li's method".to_owned(),
            ThresholdMethod::Triangle => "by the triangle method".to_owned(),
            ThresholdMethod::Porosity(share) => format!("for a porosity of {} %", percent(share)),
        }
    }

    /// Why there may be none.
    pub fn why_none(self) -> &'static str {
        match self {
            ThresholdMethod::Peaks => "the histogram has no two peaks",
            _ => "no two finite samples differ",
        }
    }

    /// The threshold; `None` if fewer than two levels occur or, for peaks, if there are not two of them. `beyond` is the
    /// number of samples that are below any threshold and in no level: NaN and minus infinity.
    pub(crate) fn find(self, levels: &Levels, voxels: u64, beyond: u64) -> Option<f64> {
        match self {
            ThresholdMethod::Otsu => levels.otsu(),
            ThresholdMethod::Peaks => two_peaks(levels).values.map(|[a, b]| a / 2.0 + b / 2.0),
            ThresholdMethod::Li => li(levels),
            ThresholdMethod::Triangle => triangle(levels),
            ThresholdMethod::Porosity(share) => {
                share_below(levels, share * voxels as f64 - beyond as f64)
            }
        }
    }
}

/// A share in percent, in the digits that it was typed with.
fn percent(share: f64) -> f64 {
    (share * 100.0 * 1e9).round() / 1e9
}

impl fmt::Display for ThresholdMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ThresholdMethod::Otsu => f.write_str("otsu"),
            ThresholdMethod::Peaks => f.write_str("peaks"),
            ThresholdMethod::Li => f.write_str("li"),
            ThresholdMethod::Triangle => f.write_str("triangle"),
            ThresholdMethod::Porosity(share) => write!(f, "porosity={}%", percent(*share)),
        }
    }
}

impl FromStr for ThresholdMethod {
    type Err = Error;

    /// `otsu`, `peaks`, `li`, `triangle`, `porosity=31%` or `porosity=0.31`.
    fn from_str(text: &str) -> Result<Self, Error> {
        let lower = text.trim().to_ascii_lowercase();
        let plain = ThresholdMethod::PLAIN
            .into_iter()
            .find(|m| m.to_string() == lower);
        let porosity = || {
            let number = lower.strip_prefix("porosity=")?.trim();
            let share = match number.strip_suffix('%') {
                Some(percent) => percent.trim_end().parse::<f64>().ok()? / 100.0,
                None => number.parse().ok()?,
            };
            (share > 0.0 && share < 1.0).then_some(ThresholdMethod::Porosity(share))
        };
        plain.or_else(porosity).ok_or_else(|| {
            let expected = "otsu, peaks, li, triangle, or porosity=P% with P above 0 and below 100";
            Error::usage("--threshold", text, expected)
        })
    }
}

/// The split after level `i`, or the last one if no level above it occurs.
fn after(levels: &Levels, i: usize) -> Option<f64> {
    let splits = levels.occupied().zip(levels.occupied().skip(1));
    let (i, next) = splits.take_while(|(low, _)| *low <= i).last()?;
    Some(levels.between(i, next))
}

/// Li's threshold, from the mean on. As scikit-image iterates: to half a step where samples are counted one by one.
fn li(levels: &Levels) -> Option<f64> {
    let occupied = || levels.occupied();
    let (first, last) = (occupied().next()?, occupied().next_back()?);
    if first == last {
        return None;
    }
    // in steps above the smallest level: the logarithm needs positive means
    let mean = |range: &mut dyn Iterator<Item = usize>| {
        let (mut n, mut sum) = (0.0, 0.0);
        for i in range {
            n += levels.counts[i] as f64;
            sum += levels.counts[i] as f64 * (i - first) as f64;
        }
        sum / n
    };
    let tolerance = if levels.exact { 0.5 } else { 1e-6 };
    let mut next = mean(&mut occupied());
    for _ in 0..MOST_STEPS {
        let now = next;
        let above = mean(&mut occupied().filter(|&i| (i - first) as f64 > now));
        let below = mean(&mut occupied().filter(|&i| (i - first) as f64 <= now));
        if below == 0.0 || !above.is_finite() {
            break;
        }
        next = (below - above) / (libm::log(below) - libm::log(above));
        if (next - now).abs() <= tolerance {
            break;
        }
    }
    let centre = if levels.exact { 0.0 } else { 0.5 };
    Some(levels.low + levels.width * (first as f64 + centre + next))
}

/// The triangle method on single levels, or on 256 bins.
fn triangle(levels: &Levels) -> Option<f64> {
    if levels.exact || levels.counts.len() <= TRIANGLE_BINS {
        let level = triangle_level(&levels.counts)?;
        return after(levels, level);
    }
    let per = levels.counts.len().div_ceil(TRIANGLE_BINS);
    let counts: Vec<u64> = levels
        .counts
        .chunks(per)
        .map(|bin| bin.iter().sum())
        .collect();
    let coarse = Levels {
        counts,
        width: levels.width * per as f64,
        ..levels.clone()
    };
    // the centre of the bin, as scikit-image has it: half of the bin is above
    let level = triangle_level(&coarse.counts)?;
    Some(coarse.low + coarse.width * (level as f64 + 0.5))
}

/// The last level of the lower class.
fn triangle_level(counts: &[u64]) -> Option<usize> {
    let first = counts.iter().position(|&n| n > 0)?;
    let last = counts.iter().rposition(|&n| n > 0)?;
    if first == last {
        return None;
    }
    let tallest = *counts.iter().max()?;
    let peak = counts.iter().position(|&n| n == tallest)?;
    let right = peak - first < last - peak;
    let width = if right { last - peak } else { peak - first };
    // steps from the far end of the tail towards the peak
    let level = |step: usize| if right { last - step } else { first + step };
    let distance =
        |step: usize| tallest as f64 * step as f64 - width as f64 * counts[level(step)] as f64;
    let mut best = 0;
    for step in 1..width {
        if distance(step) > distance(best) {
            best = step;
        }
    }
    Some(level(best))
}

/// The split whose lower class has as nearly as possible `below` samples; inside a bin samples are taken as spread evenly.
fn share_below(levels: &Levels, below: f64) -> Option<f64> {
    let occupied = || levels.occupied();
    let (first, last) = (occupied().next()?, occupied().next_back()?);
    if first == last {
        return None;
    }
    let mut sum = 0.0;
    if !levels.exact {
        for i in occupied() {
            let count = levels.counts[i] as f64;
            if sum + count >= below || i == last {
                let inside = ((below - sum) / count).clamp(0.0, 1.0);
                return Some(levels.low + levels.width * (i as f64 + inside));
            }
            sum += count;
        }
    }
    let mut best: Option<(f64, f64)> = None;
    for (i, next) in occupied().zip(occupied().skip(1)) {
        sum += levels.counts[i] as f64;
        let off = (sum - below).abs();
        if best.is_none_or(|(least, _)| off < least) {
            best = Some((off, levels.between(i, next)));
        }
    }
    best.map(|(_, threshold)| threshold)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(counts: Vec<u64>) -> Levels {
        Levels {
            low: 10.0,
            width: 1.0,
            exact: true,
            counts,
        }
    }

    fn find(method: ThresholdMethod, counts: &[u64]) -> Option<f64> {
        method.find(&exact(counts.to_vec()), counts.iter().sum(), 0)
    }

    #[test]
    fn methods_are_typed_and_told_alike() {
        for method in ThresholdMethod::PLAIN {
            assert_eq!(
                method
                    .to_string()
                    .to_uppercase()
                    .parse::<ThresholdMethod>()
                    .unwrap(),
                method
            );
        }
        for (text, share, told) in [
            ("porosity=31%", 0.31, "porosity=31%"),
            ("porosity=0.07", 0.07, "porosity=7%"),
            ("Porosity= 12.5 %", 0.125, "porosity=12.5%"),
        ] {
            let method: ThresholdMethod = text.parse().unwrap();
            assert_eq!(
                (method, method.to_string()),
                (ThresholdMethod::Porosity(share), told.to_owned())
            );
        }
        for bad in [
            "",
            "otsu2",
            "porosity",
            "porosity=",
            "porosity=0",
            "porosity=100%",
            "porosity=nan",
            "porosity=31",
        ] {
            assert!(bad.parse::<ThresholdMethod>().is_err(), "{bad}");
        }
    }

    #[test]
    fn one_level_has_no_threshold() {
        let porosity = ThresholdMethod::Porosity(0.5);
        for method in ThresholdMethod::PLAIN.into_iter().chain([porosity]) {
            assert_eq!(find(method, &[0, 7, 0]), None, "{method}");
            assert_eq!(find(method, &[]), None, "{method}");
        }
    }

    /// Counts of 10, 11, ..., and what `threshold_li` and `threshold_triangle` of scikit-image 0.26 find in them.
    const GOLDEN: &[(&[u64], f64, f64)] = &[
        (&[5, 1], 10.166666666666666, 11.0),
        (&[9, 0, 0, 3], 10.75, 11.0),
        (&[1, 2, 3, 4, 5, 6, 7, 8, 9], 14.974980475758784, 17.0),
        (&[100, 3, 2, 1, 0, 0, 1], 10.149532710280374, 11.0),
        (
            &[0, 0, 1, 4, 90, 80, 3, 3, 2, 2, 1, 1, 1, 0, 0, 30, 50, 20],
            18.590851802232038,
            16.0,
        ),
        (
            &[
                1, 0, 0, 1, 39, 0, 33, 30, 6, 0, 0, 0, 5, 7, 0, 59, 0, 14, 58, 0, 0, 15,
            ],
            20.139382603433127,
            24.0,
        ),
        (
            &[25, 0, 0, 7, 39, 2, 0, 0, 3, 2, 0, 32, 3, 0, 12, 15],
            16.201740823081657,
            15.0,
        ),
        (
            &[12, 0, 0, 47, 0, 0, 41, 15, 11, 3, 4, 0, 0, 40, 6, 11],
            17.603206193789376,
            14.0,
        ),
        (
            &[
                27, 45, 0, 48, 0, 25, 31, 0, 4, 32, 0, 14, 29, 8, 0, 0, 0, 2, 0, 2, 51, 13,
            ],
            17.239738153628217,
            29.0,
        ),
        (&[56, 0, 3, 0, 0, 0, 48], 11.446536093386797, 11.0),
        (
            &[1, 0, 0, 15, 0, 0, 4, 0, 32, 0, 0, 0, 30, 40, 8, 48],
            19.448537809161515,
            24.0,
        ),
        (
            &[14, 0, 11, 0, 30, 53, 0, 0, 2, 1, 0, 14, 32],
            16.92629541627679,
            16.0,
        ),
    ];

    #[test]
    fn values_are_those_of_scikit_image() {
        for (counts, li, triangle) in GOLDEN {
            let found = find(ThresholdMethod::Li, counts).unwrap();
            assert!((found - li).abs() < 1e-4, "{counts:?}: {found}, not {li}");
            let found = find(ThresholdMethod::Triangle, counts).unwrap();
            // scikit-image tells the last level of the lower class
            let lower =
                |t: f64| (0..counts.len()).rfind(|&i| counts[i] > 0 && i as f64 + 10.0 <= t);
            // which may leave the upper class empty, where this does not
            let most = lower(10.0 + counts.len() as f64 - 2.0);
            assert_eq!(
                lower(found),
                lower(*triangle).min(most),
                "{counts:?}: {found}, not {triangle}"
            );
        }
    }

    proptest! {
        #[test]
        fn a_share_is_met_as_nearly_as_levels_allow(
            counts in prop::collection::vec(0u64..50, 2..40),
            share in 0.001f64..0.999,
            beyond in 0u64..20,
        ) {
            let levels = exact(counts.clone());
            let voxels = counts.iter().sum::<u64>() + beyond;
            let Some(t) = ThresholdMethod::Porosity(share).find(&levels, voxels, beyond) else {
                prop_assert!(counts.iter().filter(|n| **n > 0).count() < 2);
                return Ok(());
            };
            let off = |t: f64| (voxels as f64 - levels.above(t) - share * voxels as f64).abs();
            let occupied: Vec<usize> = (0..counts.len()).filter(|&i| counts[i] > 0).collect();
            for split in &occupied[1..] {
                prop_assert!(off(t) <= off(10.0 + *split as f64) + 1e-9);
            }
            prop_assert!(0.0 < levels.above(t) && levels.above(t) < (voxels - beyond) as f64);
        }

        #[test]
        fn bins_meet_a_share(
            counts in prop::collection::vec(1u64..50, 300..400),
            share in 0.01f64..0.99,
        ) {
            let voxels: u64 = counts.iter().sum();
            let levels = exact(counts);
            let bins = Levels { exact: false, low: levels.low - 0.5, ..levels.clone() };
            let t = ThresholdMethod::Porosity(share).find(&bins, voxels, 0).unwrap();
            prop_assert!((bins.above(t) - (1.0 - share) * voxels as f64).abs() < 1e-6 * voxels as f64);
        }

        /// Li's threshold is where another step leads to itself; of levels the iteration ends before that.
        #[test]
        fn li_stays_where_it_is(counts in prop::collection::vec(1u64..50, 3..400)) {
            let step = |t: f64, centre: f64| {
                let mean = |above: bool| {
                    let of = counts.iter().zip(0..).map(|(&n, i)| (n as f64, f64::from(i) + centre));
                    let of = of.filter(|(_, v)| (*v > t) == above);
                    let (n, sum) = of.fold((0.0, 0.0), |(n, sum), (m, v)| (n + m, sum + m * (v - centre)));
                    sum / n
                };
                let (low, high) = (mean(false), mean(true));
                if low == 0.0 { t } else { centre + (low - high) / (libm::log(low) - libm::log(high)) }
            };
            let voxels = counts.iter().sum();
            let levels = exact(counts.clone());
            let bins = Levels { exact: false, ..levels };
            let t = ThresholdMethod::Li.find(&bins, voxels, 0).unwrap() - bins.low;
            // the last step may have passed the middle of a bin
            prop_assert!([t, t - 2e-6, t + 2e-6].iter().any(|&t| (step(t, 0.5) - t).abs() <= 1e-5));
        }
    }
}
