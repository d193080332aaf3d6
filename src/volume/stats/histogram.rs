//! Counts of sample values, and Otsu's threshold on them.

use std::ops::RangeInclusive;

/// Bins for types whose values are too many to count one by one.
pub(crate) const BINS: usize = 65_536;

/// How often values occur, by rising value.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Levels {
    /// The value of level 0, or the lower edge of bin 0.
    pub(crate) low: f64,
    /// The distance of neighbouring levels, or the width of a bin; above 0.
    pub(crate) width: f64,
    /// Every level is one value; otherwise a bin of values.
    pub(crate) exact: bool,
    /// Samples per level.
    pub(crate) counts: Vec<u64>,
}

impl Levels {
    /// The levels that occur, from below.
    pub(crate) fn occupied(&self) -> impl DoubleEndedIterator<Item = usize> {
        (0..self.counts.len()).filter(|&i| self.counts[i] > 0)
    }

    /// The first and the last level that are left if no more than a share of the samples is cut off at either end;
    /// `None` without samples.
    pub(crate) fn without_ends(&self, share: f64) -> Option<RangeInclusive<usize>> {
        let most = (self.counts.iter().sum::<u64>() as f64 * share) as u64;
        let passes = |sum: &mut u64, n: u64| {
            *sum += n;
            *sum > most
        };
        let (mut low, mut high) = (0, 0);
        let first = self.counts.iter().position(|&n| passes(&mut low, n))?;
        let last = self.counts.iter().rposition(|&n| passes(&mut high, n))?;
        Some(first..=last)
    }

    /// How many bins lie between those that the lowest and the highest 0.1 % of the samples are in, both counted; `None`
    /// if levels are single values, if that is all of the range, or if all samples are in one bin.
    pub(crate) fn bins_of_most(&self) -> Option<usize> {
        let differ = self.occupied().nth(1).is_some();
        let most = self.without_ends(1e-3);
        let most = most.filter(|_| !self.exact && differ)?.count();
        (most < self.counts.len()).then_some(most)
    }

    /// The split after level `i`, whose next level that occurs is `next`: midway between levels, and of bins midway
    /// between the end of the one, which reaches up to the one after it, and the start of the other.
    pub(crate) fn between(&self, i: usize, next: usize) -> f64 {
        let top = if self.exact { i } else { i + 1 };
        self.low + self.width * ((top + next) as f64 / 2.0)
    }

    /// Otsu's threshold: the split into two classes with the largest variance between them
    /// (N. Otsu, A threshold selection method from gray-level histograms, 1979). The result lies
    /// midway between the largest level of the lower class and the smallest one of the upper class
    /// that occurs, so `v >= threshold` is the upper class, and a surface of a volume of two values
    /// lies midway between voxels. `None` if fewer than two levels occur.
    pub(crate) fn otsu(&self) -> Option<f64> {
        let occupied = || self.occupied();
        let total: f64 = self.counts.iter().map(|&n| n as f64).sum();
        let moment: f64 = occupied().map(|i| self.counts[i] as f64 * i as f64).sum();
        let (mut below, mut below_moment) = (0.0, 0.0);
        let mut best: Option<(f64, usize, usize)> = None;
        for (i, next) in occupied().zip(occupied().skip(1)) {
            below += self.counts[i] as f64;
            below_moment += self.counts[i] as f64 * i as f64;
            let above = total - below;
            let gap = below_moment / below - (moment - below_moment) / above;
            let variance = below * above * gap * gap;
            if best.is_none_or(|(v, ..)| variance > v) {
                best = Some((variance, i, next));
            }
        }
        let (_, i, next) = best?;
        Some(self.between(i, next))
    }

    /// Samples v with v >= threshold; for bins an estimate that takes a bin's samples as spread
    /// evenly.
    pub(crate) fn above(&self, threshold: f64) -> f64 {
        let at = (threshold - self.low) / self.width;
        let sum = |from: usize| {
            self.counts
                .get(from..)
                .unwrap_or_default()
                .iter()
                .sum::<u64>()
        };
        // casts of floats saturate; NaN is above nothing
        if at.is_nan() {
            0.0
        } else if self.exact {
            sum(at.ceil().max(0.0) as usize) as f64
        } else {
            let bin = at.floor().max(0.0) as usize;
            let share = 1.0 - (at - bin as f64).clamp(0.0, 1.0);
            let inside = self.counts.get(bin).copied().unwrap_or(0) as f64;
            inside * share + sum(bin.saturating_add(1)) as f64
        }
    }

    /// The same counts in `bins` equal bins from `min` to `max`, which all levels lie in.
    pub(crate) fn rebin(&self, [min, max]: [f64; 2], bins: usize) -> Vec<u64> {
        let mut out = vec![0; bins];
        let centre = if self.exact { 0.0 } else { 0.5 };
        for (i, &count) in self.counts.iter().enumerate().filter(|(_, n)| **n > 0) {
            let value = self.low + self.width * (i as f64 + centre);
            let at = (value / 2.0 - min / 2.0) / (max / 2.0 - min / 2.0) * bins as f64;
            // 0/0, if all values are the same, becomes 0
            out[(at as usize).min(bins - 1)] += count;
        }
        out
    }

    /// Counts in `bins` equal columns to draw, and the values where the first one begins and the last one ends.
    ///
    /// Integers reach half a step to either side, and a column shows the mean of those that begin in it, or the one
    /// that it is a part of, times what columns have on average: in plain counts, columns of four integers would
    /// tower above those of three, and there would be gaps if there are more columns than integers.
    pub(crate) fn columns(&self, [min, max]: [f64; 2], bins: usize) -> (Vec<f64>, [f64; 2]) {
        if !self.exact {
            let counts = self.rebin([min, max], bins);
            return (counts.iter().map(|&n| n as f64).collect(), [min, max]);
        }
        let integers = (max - min) as usize + 1;
        let average = integers as f64 / bins as f64;
        let heights = (0..bins).map(|column| {
            let first = column * integers / bins;
            let end = ((column + 1) * integers / bins).max(first + 1);
            let sum: u64 = self.counts[first..end].iter().sum();
            sum as f64 / (end - first) as f64 * average
        });
        (heights.collect(), [min - 0.5, max + 0.5])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(counts: Vec<u64>) -> Levels {
        Levels {
            low: 0.0,
            width: 1.0,
            exact: true,
            counts,
        }
    }

    /// The textbook's sum over all splits, each from scratch.
    fn slow_variance(counts: &[u64], split: usize) -> f64 {
        let stats = |range: &[u64], first: usize| {
            let n: f64 = range.iter().map(|&c| c as f64).sum();
            let m: f64 = range
                .iter()
                .zip(first..)
                .map(|(&c, i)| c as f64 * i as f64)
                .sum();
            (n, m / n)
        };
        let (n0, m0) = stats(&counts[..split], 0);
        let (n1, m1) = stats(&counts[split..], split);
        n0 * n1 * ((m0 - m1) * (m0 - m1))
    }

    proptest! {
        #[test]
        fn otsu_has_the_largest_variance(counts in prop::collection::vec(0u64..50, 2..40)) {
            let occupied = counts.iter().filter(|n| **n > 0).count();
            let otsu = exact(counts.clone()).otsu();
            prop_assert_eq!(otsu.is_some(), occupied > 1);
            if let Some(t) = otsu {
                let found = slow_variance(&counts, t.ceil() as usize);
                for split in 1..counts.len() {
                    let other = slow_variance(&counts, split);
                    prop_assert!(other.is_nan() || other <= found * (1.0 + 1e-9), "{} {}", t, split);
                }
            }
        }

        #[test]
        fn rebinning_keeps_the_sum(counts in prop::collection::vec(0u64..50, 2..400)) {
            let levels = exact(counts.clone());
            let out = levels.rebin([0.0, counts.len() as f64 - 1.0], 256);
            prop_assert_eq!(out.iter().sum::<u64>(), counts.iter().sum::<u64>());
        }
    }

    #[test]
    fn two_values_are_split_midway() {
        let mut counts = vec![0; 256];
        (counts[0], counts[255]) = (10, 3);
        assert_eq!(exact(counts.clone()).otsu(), Some(127.5));
        assert_eq!(exact(counts).above(127.5), 3.0);
        assert_eq!(exact(vec![0, 5]).otsu(), None);
    }

    #[test]
    fn above_is_exact_at_levels_and_even_in_bins() {
        let levels = exact(vec![1, 2, 3]);
        for (t, n) in [
            (-1.0, 6.0),
            (0.0, 6.0),
            (0.5, 5.0),
            (1.0, 5.0),
            (2.0, 3.0),
            (2.1, 0.0),
        ] {
            assert_eq!(levels.above(t), n, "{t}");
        }
        assert_eq!(levels.above(f64::NAN), 0.0);
        let bins = Levels {
            exact: false,
            ..levels
        };
        for (t, n) in [(-1.0, 6.0), (0.5, 5.5), (2.0, 3.0), (2.5, 1.5), (9.0, 0.0)] {
            assert_eq!(bins.above(t), n, "{t}");
        }
    }

    #[test]
    fn columns_are_as_even_as_the_counts() {
        for (integers, bins) in [(256, 78), (100, 78), (41, 78), (2, 78), (78, 78), (1, 5)] {
            let levels = exact(vec![7; integers]);
            let ends = [0.0, integers as f64 - 1.0];
            let (columns, edges) = levels.columns(ends, bins);
            assert_eq!(edges, [-0.5, integers as f64 - 0.5]);
            let mean = 7.0 * integers as f64 / bins as f64;
            assert_eq!(columns.len(), bins);
            assert!(columns.iter().all(|c| (c - mean).abs() < 1e-9));
        }
        // a mask is two halves
        let (columns, _) = exact(vec![10, 30]).columns([0.0, 1.0], 4);
        assert_eq!(columns, [5.0, 5.0, 15.0, 15.0]);
        let counts = vec![1, 0, 2, 5];
        let spread = Levels {
            exact: false,
            ..exact(counts)
        };
        let (columns, edges) = spread.columns([0.0, 4.0], 4);
        assert_eq!((columns, edges), (vec![1.0, 0.0, 2.0, 5.0], [0.0, 4.0]));
    }
}
