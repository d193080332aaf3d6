//! A histogram as it is seen in columns, smoothed, and the peaks of these.

use crate::volume::filters::gaussian_kernel;
use crate::volume::stats::histogram::Levels;
use std::ops::Range;

/// Columns that the histogram is seen in: fine enough for a threshold, coarse enough to be smooth.
const COLUMNS: usize = 256;
/// The standard deviation of the smoothing, in columns of 256.
const SIGMA: f64 = 2.0;
/// The same in columns of any number where gaps of whole levels are not equally wide.
const LEAST_SIGMA: f64 = 1.5;
/// The share of samples at either end that does not widen the view: single voxels far outside of all others.
const STRAY: f64 = 1e-4;
/// Levels that make a histogram with gaps; fewer are values of their own, as those of a mask.
pub(super) const LEAST_TEETH: usize = 16;

/// The histogram in columns.
pub(super) struct Seen {
    /// The value in the middle of column 0.
    pub low: f64,
    /// The distance of the middles.
    pub width: f64,
    /// Samples in a column.
    pub heights: Vec<f64>,
    /// The standard deviation of the smoothing, in columns.
    pub sigma: f64,
}

/// Counts as they are spread over the levels around them, so that a histogram with regular gaps, as of samples of few
/// bits that were stretched, has no peak at each of its teeth.
struct Spread {
    /// Where the samples of the levels that occur begin and end, level i reaching from i to i + 1, and how many.
    teeth: Vec<(Range<f64>, f64)>,
    /// Some levels between them do not occur.
    has_gaps: bool,
}

impl Spread {
    /// Samples reach half-way to the next level that occurs, if that is no farther than is usual.
    fn of(counts: &[u64]) -> Spread {
        let occupied: Vec<usize> = (0..counts.len()).filter(|&i| counts[i] > 0).collect();
        let mut gaps: Vec<usize> = occupied.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_unstable();
        let has_gaps = occupied.len() >= LEAST_TEETH && gaps.last().is_some_and(|&gap| gap > 1);
        // no farther than to the next one as a rule: beyond that there is nothing
        let most = match has_gaps {
            true => gaps[gaps.len() / 2] as f64,
            false => 0.5,
        };
        let reach = |gap: Option<usize>| gap.map_or(0.5, |gap| (gap as f64 / 2.0).min(most));
        let teeth = occupied.iter().enumerate().map(|(k, &i)| {
            let before = k.checked_sub(1).map(|k| i - occupied[k]);
            let after = occupied.get(k + 1).map(|next| next - i);
            let middle = i as f64 + 0.5;
            (
                middle - reach(before)..middle + reach(after),
                counts[i] as f64,
            )
        });
        Spread {
            teeth: teeth.collect(),
            has_gaps,
        }
    }

    /// Samples in a range.
    fn sum(&self, range: Range<f64>) -> f64 {
        let first = self
            .teeth
            .partition_point(|(tooth, _)| tooth.end <= range.start);
        let inside = self.teeth[first..]
            .iter()
            .take_while(|(tooth, _)| tooth.start < range.end);
        let share = |tooth: &Range<f64>| {
            let both = tooth.end.min(range.end) - tooth.start.max(range.start);
            both / (tooth.end - tooth.start)
        };
        inside.map(|(tooth, count)| count * share(tooth)).sum()
    }
}

impl Seen {
    /// `None` of an empty one.
    pub fn of(levels: &Levels) -> Option<Seen> {
        let seen = levels.without_ends(STRAY)?;
        let first = *seen.start();
        let inside = levels.counts.get(seen)?;
        let columns = COLUMNS.min(inside.len());
        let per = inside.len() as f64 / columns as f64;
        let spread = Spread::of(inside);
        let heights = (0..columns).map(|c| spread.sum(c as f64 * per..(c + 1) as f64 * per));
        let step = levels.width * per;
        let start = levels.low + levels.width * first as f64;
        // a level lies in the middle of its own width, a bin begins at its edge
        let edge = if levels.exact {
            start - levels.width / 2.0
        } else {
            start
        };
        let least = if spread.has_gaps { LEAST_SIGMA } else { 0.0 };
        Some(Seen {
            low: edge + step / 2.0,
            width: step,
            heights: heights.collect(),
            sigma: (SIGMA * columns as f64 / COLUMNS as f64).max(least),
        })
    }
}

/// Smoothed by a Gaussian; ends are continued.
pub(super) fn smoothed(heights: &[f64], sigma: f64) -> Vec<f64> {
    let weights: Vec<f64> = gaussian_kernel::weights(sigma);
    let last = heights.len() - 1;
    let pair = |i: usize, d: usize| heights[i.saturating_sub(d)] + heights[(i + d).min(last)];
    let tails = |i: usize| (1..weights.len()).map(move |d| (i, d));
    (0..heights.len())
        .map(|i| {
            weights[0] * heights[i] + tails(i).map(|(i, d)| weights[d] * pair(i, d)).sum::<f64>()
        })
        .collect()
}

/// A column that is taller than its neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    pub column: usize,
    pub height: f64,
    pub prominence: f64,
}

/// All peaks. Of a plateau the first column counts; the tallest peak stands out by all of its height.
pub(super) fn prominences(heights: &[f64]) -> Vec<Peak> {
    // true if column b is a taller one than a
    let taller = |a: usize, b: usize| heights[b] > heights[a] || heights[b] == heights[a] && b < a;
    let is_peak = |&i: &usize| {
        (i == 0 || taller(i - 1, i))
            && (i + 1 == heights.len() || taller(i + 1, i))
            && heights[i] > 0.0
    };
    // the lowest column on the way to a taller one
    let valley = |from: usize, way: &mut dyn Iterator<Item = usize>| {
        let mut lowest = heights[from];
        for i in way {
            if taller(from, i) {
                return Some(lowest);
            }
            lowest = lowest.min(heights[i]);
        }
        None
    };
    let peaks = (0..heights.len()).filter(is_peak).map(|i| {
        let left = valley(i, &mut (0..i).rev());
        let right = valley(i, &mut (i + 1..heights.len()));
        let base = match (left, right) {
            (Some(a), Some(b)) => a.max(b),
            (a, b) => a.or(b).unwrap_or(0.0),
        };
        Peak {
            column: i,
            height: heights[i],
            prominence: heights[i] - base,
        }
    });
    peaks.collect()
}
