//! The two peaks of a histogram.

use crate::volume::stats::columns::{LEAST_TEETH, Peak, Seen, prominences, smoothed};
use crate::volume::stats::histogram::Levels;

/// How much of its height a peak has to stand out from the valley beside it.
const LEAST_PROMINENCE: f64 = 0.1;
/// The same in standard deviations of a count of its height, so that ripples of noise are none.
const LEAST_SIGNIFICANCE: f64 = 5.0;

/// How much taller a spike at an end of the range is than any level near it.
const SPIKE: u64 = 8;
/// The same where levels do not fall away from it, as those of a narrow heap do: half of a heap was clipped.
const CLIPPED_HEAP: u64 = 2;
/// The share of the range in which a spike is the only tall level.
const NEAR: usize = 64;
/// The share of the samples that has to be left without spikes for these to be none of the materials.
const LEAST_REST: f64 = 0.2;

/// The two peaks of a histogram.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Peaks {
    /// Their values, rising; `None` if there is only one.
    pub(crate) values: Option<[f64; 2]>,
    /// Spikes at the ends of the range that would have been peaks.
    pub(crate) clipped: Vec<Spike>,
}

/// An end of the range that far more samples have than values near it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Spike {
    /// 0 the lowest value of all, 1 the highest.
    pub(crate) end: usize,
    /// Samples that have it, or are in its bin.
    pub(crate) samples: u64,
}

/// The values of the tallest peak and of the one beside it that stands out most.
///
/// The histogram is seen in 256 columns and smoothed; the prominence of a peak is its height above the higher of the
/// valleys that part it from taller ones, and is compared with the square root of the height, as counts scatter.
///
/// A single value at an end of the range that is far more frequent than all near it is what a detector or a program
/// clipped or filled, and no peak: with a single peak inside of the range there are no two.
pub(crate) fn two_peaks(levels: &Levels) -> Peaks {
    let all = SeenPeaks::of(levels).and_then(|seen| seen.both());
    let [first, last] = spikes(levels);
    let without = [vec![last, first], vec![last], vec![first]].into_iter();
    let without = without.filter_map(|ends| ends.into_iter().collect::<Option<Vec<usize>>>());
    let mut lone = None;
    for spikes in without {
        let mut rest = levels.clone();
        spikes.iter().for_each(|&i| rest.counts[i] = 0);
        let [of_rest, of_all] = [&rest, levels].map(|l| l.counts.iter().sum::<u64>() as f64);
        let Some(seen) = SeenPeaks::of(&rest).filter(|_| of_rest >= LEAST_REST * of_all) else {
            continue;
        };
        // a heap that only rises towards the spike belongs to it
        let ends = [first, last].map(|end| end.is_some_and(|end| spikes.contains(&end)));
        let at_ends = seen.at_ends();
        if (ends[0] && at_ends[0]) || (ends[1] && at_ends[1]) {
            continue;
        }
        let clipped = || {
            let clipped = spikes.iter().map(|&i| Spike {
                end: usize::from(Some(i) == last),
                samples: levels.counts[i],
            });
            clipped.collect()
        };
        let Some(values) = seen.both() else {
            // one at an end is as a spike is, and none of the two may be told from the other
            if !at_ends.contains(&true) {
                lone = lone.or_else(|| Some(clipped()));
            }
            continue;
        };
        let same = |all: [f64; 2]| {
            let off = |i: usize| (all[i] - values[i]).abs();
            off(0).max(off(1)) <= 3.0 * seen.width
        };
        return match all.filter(|all| same(*all)) {
            Some(_) => Peaks {
                values: all,
                clipped: Vec::new(),
            },
            None => Peaks {
                values: Some(values),
                clipped: clipped(),
            },
        };
    }
    Peaks {
        values: all.filter(|_| lone.is_none()),
        clipped: lone.unwrap_or_default(),
    }
}

/// The first and the last level that occurs, where that is a spike.
fn spikes(levels: &Levels) -> [Option<usize>; 2] {
    let occupied = levels.occupied().take(LEAST_TEETH).count();
    let ends = levels.occupied().next().zip(levels.occupied().next_back());
    let Some((first, last)) = ends.filter(|_| occupied == LEAST_TEETH) else {
        return [None; 2];
    };
    let reach = ((last - first) / NEAR).max(3);
    // those near it, by rising distance
    let tall = |end: usize, near: &[u64]| {
        let most = near.iter().max().copied().unwrap_or(0).max(1);
        let third = near.len().div_ceil(3);
        let sum = |part: &[u64]| part.iter().sum::<u64>();
        let rises = sum(&near[..third]) <= sum(&near[near.len() - third..]);
        let times = if rises { CLIPPED_HEAP } else { SPIKE };
        (levels.counts[end] > times * most).then_some(end)
    };
    let mut below = levels.counts[last - reach..last].to_vec();
    below.reverse();
    [
        tall(first, &levels.counts[first + 1..=first + reach]),
        tall(last, &below),
    ]
}

/// The peaks as they are seen.
struct SeenPeaks {
    /// The columns of the tallest one and, if there is one, of that beside it, rising.
    columns: Vec<usize>,
    /// The value in the middle of column 0.
    low: f64,
    /// The width of a column.
    width: f64,
    /// The last column.
    last: usize,
}

impl SeenPeaks {
    /// `None` if no value occurs.
    fn of(levels: &Levels) -> Option<Self> {
        let seen = Seen::of(levels)?;
        let heights = smoothed(&seen.heights, seen.sigma);
        let peaks = prominences(&heights);
        let significance = |p: &Peak| p.prominence / (p.height + 1.0).sqrt();
        let tallest = peaks
            .iter()
            .max_by(|a, b| a.prominence.total_cmp(&b.prominence))?;
        let second = peaks
            .iter()
            .filter(|p| p.column != tallest.column)
            .filter(|p| {
                p.prominence >= LEAST_PROMINENCE * p.height && significance(p) >= LEAST_SIGNIFICANCE
            })
            .max_by(|a, b| significance(a).total_cmp(&significance(b)));
        let both = [Some(tallest), second].into_iter().flatten();
        let mut columns: Vec<usize> = both.map(|peak| peak.column).collect();
        columns.sort_unstable();
        Some(SeenPeaks {
            columns,
            low: seen.low,
            width: seen.width,
            last: heights.len() - 1,
        })
    }

    /// The values of two.
    fn both(&self) -> Option<[f64; 2]> {
        let [a, b] = self.columns[..] else {
            return None;
        };
        Some([a, b].map(|column| self.low + self.width * column as f64))
    }

    /// The lowest one is the first column that is seen, the highest one the last.
    fn at_ends(&self) -> [bool; 2] {
        [
            self.columns.first() == Some(&0),
            self.columns.last() == Some(&self.last),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn levels(exact: bool, low: f64, width: f64, counts: Vec<u64>) -> Levels {
        Levels {
            low,
            width,
            exact,
            counts,
        }
    }

    fn values(levels: &Levels) -> Option<[f64; 2]> {
        two_peaks(levels).values
    }

    /// Counts of a sum of bells: centre, standard deviation, samples.
    fn bells(n: usize, of: &[[f64; 3]]) -> Vec<u64> {
        let at = |i: usize| {
            of.iter().map(move |[centre, sigma, samples]| {
                let x = (i as f64 - centre) / sigma;
                samples / sigma / 2.5066 * libm::exp(-0.5 * x * x)
            })
        };
        (0..n).map(|i| at(i).sum::<f64>().round() as u64).collect()
    }

    #[test]
    fn two_values_are_values() {
        let mut counts = vec![0; 256];
        (counts[0], counts[255]) = (1_000_000, 300);
        assert_eq!(values(&levels(true, 0.0, 1.0, counts)), Some([0.0, 255.0]));
        assert_eq!(values(&levels(true, 3.0, 1.0, vec![90, 40])), None);
        assert_eq!(
            values(&levels(true, 3.0, 1.0, vec![90, 0, 40])),
            Some([3.0, 5.0])
        );
        assert_eq!(values(&levels(true, 3.0, 1.0, vec![90])), None);
        assert_eq!(values(&levels(true, 0.0, 1.0, vec![])), None);
    }

    #[test]
    fn a_little_metal_in_much_air_is_seen() {
        let counts = bells(65_536, &[[10_000.0, 1500.0, 5e7], [50_000.0, 2500.0, 1e6]]);
        for exact in [true, false] {
            let [a, b] = values(&levels(exact, 0.0, 1.0, counts.clone())).unwrap();
            assert!(
                (a - 10_000.0).abs() < 260.0 && (b - 50_000.0).abs() < 260.0,
                "{a} {b}"
            );
        }
        // single voxels far away do not matter
        let mut hot = counts.clone();
        hot.resize(1 << 20, 0);
        *hot.last_mut().unwrap() = 3;
        let [a, b] = values(&levels(true, 0.0, 1.0, hot)).unwrap();
        assert!(
            (a - 10_000.0).abs() < 260.0 && (b - 50_000.0).abs() < 260.0,
            "{a} {b}"
        );
    }

    fn spike(end: usize, samples: u64) -> Spike {
        Spike { end, samples }
    }

    #[test]
    fn a_clipped_end_of_the_range_is_no_peak() {
        let counts = bells(256, &[[70.0, 9.0, 1e6], [170.0, 12.0, 3e5]]);
        let plain = values(&levels(true, 0.0, 1.0, counts.clone())).unwrap();
        for (ends, saturated) in [
            (vec![(255, 200_000)], vec![spike(1, 200_000)]),
            (vec![(0, 900_000)], vec![spike(0, 900_000)]),
            (
                vec![(0, 400_000), (255, 90_000)],
                vec![spike(1, 90_000), spike(0, 400_000)],
            ),
        ] {
            let mut clipped = counts.clone();
            ends.iter().for_each(|(at, n)| clipped[*at] += n);
            let found = two_peaks(&levels(true, 0.0, 1.0, clipped));
            assert_eq!(found.clipped, saturated);
            let off = |i: usize| (found.values.unwrap()[i] - plain[i]).abs();
            assert!(off(0) < 2.0 && off(1) < 2.0, "{found:?}");
        }
        // of 16 bits
        let mut wide = bells(65_536, &[[9000.0, 1500.0, 5e7], [40_000.0, 2500.0, 5e6]]);
        wide[65_535] = 4_000_000;
        let found = two_peaks(&levels(true, 0.0, 1.0, wide));
        assert_eq!(found.clipped, [spike(1, 4_000_000)]);
        assert!(
            (found.values.unwrap()[1] - 40_000.0).abs() < 600.0,
            "{found:?}"
        );
        // air whose noise was cut off below 0 is a material
        let mut air = bells(256, &[[0.0, 6.0, 1e6], [150.0, 12.0, 3e5]]);
        air[0] += 500_000;
        let found = two_peaks(&levels(true, 0.0, 1.0, air.clone()));
        assert!(
            found.clipped.is_empty() && found.values.unwrap()[0] < 3.0,
            "{found:?}"
        );
        // and is one still if the other end is saturated
        air[255] = 100_000;
        let found = two_peaks(&levels(true, 0.0, 1.0, air));
        assert_eq!(found.clipped, [spike(1, 100_000)]);
        assert!((found.values.unwrap()[1] - 150.0).abs() < 3.0, "{found:?}");
        // two values with a few between, as of a phantom without noise
        let mut sharp = vec![40; 256];
        (sharp[0], sharp[255]) = (1_000_000, 90_000);
        let found = two_peaks(&levels(true, 0.0, 1.0, sharp));
        assert!(found.clipped.is_empty(), "{found:?}");
    }

    /// Beside one heap a fill is no material, nor is what was cut off from the foot of the heap.
    #[test]
    fn a_spike_beside_one_heap_is_no_second_peak() {
        let heap = bells(256, &[[150.0, 20.0, 1e6]]);
        for (end, samples) in [(0, 300_000), (0, 2_000_000), (255, 300_000)] {
            let mut filled = heap.clone();
            filled[end] += samples;
            let found = two_peaks(&levels(true, 0.0, 1.0, filled));
            assert_eq!(found.values, None, "{end} {samples}");
            assert_eq!(found.clipped, [spike(end / 255, samples)]);
        }
        // a few samples without a peak above it
        let mut cut = bells(256, &[[50.0, 25.0, 1e6]]);
        let below: u64 = cut.drain(..20).sum();
        cut[0] += below;
        cut.iter_mut().skip(90).for_each(|n| *n += 20);
        let clipped = spike(0, cut[0]);
        let found = two_peaks(&levels(true, 20.0, 1.0, cut));
        assert_eq!(found.values, None);
        assert_eq!(found.clipped, [clipped]);
    }

    /// What is below the range has its end: few samples to many.
    #[test]
    fn half_a_clipped_heap_is_no_spike() {
        for sigma in [10.0, 15.0, 20.0, 25.0, 30.0] {
            for lowest in [1.4, 1.6, 1.8, 2.0, 2.2, 2.4] {
                let air = lowest * sigma;
                let all = bells(
                    512,
                    &[[256.0 + air, sigma, 7e5], [256.0 + 170.0, 20.0, 3e5]],
                );
                let mut counts = all[256..].to_vec();
                counts[0] += all[..256].iter().sum::<u64>();
                let case = format!("{sigma} {lowest}");
                for mirrored in [false, true] {
                    let found = values(&levels(true, 0.0, 1.0, counts.clone())).unwrap();
                    let [low, high] = if mirrored {
                        [255.0 - found[1], 255.0 - found[0]]
                    } else {
                        found
                    };
                    assert!(
                        (low - air).abs() < 4.0 && (high - 170.0).abs() < 4.0,
                        "{case}: {found:?}"
                    );
                    counts.reverse();
                }
            }
        }
    }

    #[test]
    fn one_bell_is_one_peak() {
        let counts = bells(256, &[[100.0, 20.0, 1e6]]);
        assert_eq!(values(&levels(true, 0.0, 1.0, counts)), None);
    }

    /// Values that were multiplied leave gaps between them.
    #[test]
    fn teeth_are_no_peaks() {
        for factor in [1.3, 1.7, 2.0, 3.0, 5.0, 8.0, 37.0, 256.0] {
            let stretched = |counts: Vec<u64>| {
                let at = |i: usize| (i as f64 * factor).round() as usize;
                let mut out = vec![0; at(counts.len()) + 1];
                for (i, n) in counts.iter().enumerate() {
                    out[at(i)] += n;
                }
                levels(true, 0.0, 1.0, out)
            };
            for wide in [48, 256, 1200] {
                let n = wide as f64;
                let one = bells(wide, &[[0.5 * n, 0.1 * n, 1e6]]);
                assert_eq!(values(&stretched(one)), None, "{factor} {wide}");
                let two = bells(
                    wide,
                    &[[0.25 * n, 0.07 * n, 1e6], [0.75 * n, 0.07 * n, 1e5]],
                );
                let [a, b] = values(&stretched(two)).unwrap();
                let off = |found: f64, share: f64| (found / factor / n - share).abs();
                assert!(
                    off(a, 0.25) < 0.02 && off(b, 0.75) < 0.02,
                    "{factor} {wide}: {a} {b}"
                );
            }
        }
    }

    #[test]
    fn prominence_is_the_height_above_the_higher_valley() {
        let peaks = prominences(&[1.0, 5.0, 2.0, 9.0, 3.0, 4.0, 4.0, 0.0, 1.0]);
        let found: Vec<_> = peaks.iter().map(|p| (p.column, p.prominence)).collect();
        assert_eq!(found, [(1, 3.0), (3, 9.0), (5, 1.0), (8, 1.0)]);
    }

    proptest! {
        /// A mirrored histogram has mirrored peaks, and one that is moved has moved ones.
        #[test]
        fn peaks_move_with_the_histogram(a in 30.0f64..100.0, gap in 60.0f64..120.0, share in 0.05f64..0.95) {
            let counts = bells(256, &[[a, 8.0, 1e6 * share], [a + gap, 8.0, 1e6 * (1.0 - share)]]);
            let two = values(&levels(true, 0.0, 1.0, counts.clone())).unwrap();
            prop_assert!((two[0] - a).abs() < 1.5 && (two[1] - a - gap).abs() < 1.5, "{:?}", two);
            let moved = values(&levels(true, -500.0, 2.0, counts.clone())).unwrap();
            prop_assert_eq!(moved, two.map(|v| 2.0 * v - 500.0));
            let back: Vec<u64> = counts.iter().rev().copied().collect();
            let mirrored = values(&levels(true, 0.0, 1.0, back)).unwrap();
            prop_assert!((255.0 - mirrored[1] - two[0]).abs() < 1.01 && (255.0 - mirrored[0] - two[1]).abs() < 1.01);
        }
    }
}
