//! Range, histogram and Otsu's threshold of a volume, in one or two streamed passes.

use crate::error::Result;
use crate::progress::Progress;
use crate::volume::region::RegionVoxels;
use crate::volume::stats::histogram::{BINS, Levels};
use crate::volume::stats::inside::for_each_inside;
use crate::volume::stats::peaks::two_peaks;
use crate::volume::stats::threshold::ThresholdMethod;
use crate::volume::stats::walk::{Piece, Walk};
use crate::volume::{Dtype, Volume, Voxel, with_voxel_type};
use crate::words::{count, number};

/// Bins that nearly all samples have at least where a threshold found in them is fine.
const FINE: usize = 1024;

/// What the samples of a volume are like.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// All samples that count.
    pub voxels: u64,
    /// NaN samples.
    pub nan: u64,
    /// Samples of minus infinity.
    pub negative_infinite: u64,
    /// Samples of plus infinity.
    pub positive_infinite: u64,
    /// Smallest and largest finite sample; `None` if none is finite.
    pub range: Option<[f64; 2]>,
    /// Finite samples in 256 equal bins over `range`; the last bin holds its upper end too. Empty
    /// if no sample is finite.
    pub histogram: Vec<u64>,
    /// Otsu's threshold: `v >= otsu` is the upper class. It lies midway between the two sample
    /// values that it separates; where those are neighbouring integers t and t+1, scikit-image's
    /// `threshold_otsu` is t. Exact for integers whose range is below 65,536; others are counted
    /// in 65,536 bins over the range. `None` if all finite samples are the same.
    pub otsu: Option<f64>,
    levels: Option<Levels>,
}

impl Statistics {
    /// The histogram in so many columns to draw, without the gaps that integers make in bins of any other width, and
    /// the values where the first one begins and the last one ends. `None` if no sample is finite.
    pub(crate) fn columns(&self, columns: usize) -> Option<(Vec<f64>, [f64; 2])> {
        Some(self.levels.as_ref()?.columns(self.range?, columns))
    }

    /// Number of samples v with `v >= threshold`: exact where `otsu` is, otherwise an estimate.
    pub fn voxels_above(&self, threshold: f64) -> u64 {
        let finite = self.levels.as_ref().map_or(0.0, |l| l.above(threshold));
        let infinite = if threshold.is_nan() {
            0
        } else {
            self.positive_infinite
        };
        finite.round() as u64 + infinite
    }

    /// The threshold that a method finds; `None` if no two finite samples differ, or the histogram has no two peaks.
    /// Exact for integers whose range is below 65,536; others are counted in 65,536 bins over the range.
    pub fn threshold(&self, method: ThresholdMethod) -> Option<f64> {
        let below = self.nan + self.negative_infinite;
        method.find(self.levels.as_ref()?, self.voxels, below)
    }

    /// Why thresholds found in these samples and shares of them are rough; `None` if they are not. Wide types are counted
    /// in bins of equal width over all of the range, so that a few samples far from all others leave few bins for those.
    pub fn coarse(&self) -> Option<String> {
        let bins = self.levels.as_ref()?.bins_of_most()?;
        (bins < FINE).then(|| {
            format!(
                "the histogram is coarse: nearly all samples lie in {bins} of its {BINS} bins, since a few lie far from \
                 them, so thresholds found in it and shares above are rough: cut these off with --clamp A,B"
            )
        })
    }

    /// The two peaks of the histogram, by rising value; `None` if it has only one.
    pub fn peaks(&self) -> Option<[f64; 2]> {
        two_peaks(self.levels.as_ref()?).values
    }

    /// Says which values at the ends of the range are taken for clipped ones and not for a peak; `None` if none are, or if
    /// there are no two peaks without them.
    pub fn clipped(&self) -> Option<String> {
        self.peaks().and_then(|_| self.spikes())
    }

    /// Why a method finds no threshold in these samples.
    pub fn why_none(&self, method: ThresholdMethod) -> String {
        let spikes = self.spikes().filter(|_| method == ThresholdMethod::Peaks);
        let spikes = spikes.map_or(String::new(), |text| format!(" ({text})"));
        format!("{}{spikes}", method.why_none())
    }

    /// Says which values at the ends of the range are no peaks.
    fn spikes(&self) -> Option<String> {
        let (clipped, ends) = (two_peaks(self.levels.as_ref()?).clipped, self.range?);
        let each = clipped
            .iter()
            .map(|s| format!("{} samples of {}", count(s.samples), number(ends[s.end], 6)));
        let each: Vec<String> = each.collect();
        (!each.is_empty()).then(|| {
            format!(
                "{} are taken for clipped or filled ones, not for a peak: a single value at an end of the range is none \
                 of a material",
                each.join(" and ")
            )
        })
    }

    /// True if samples are counted by their values, and not in bins.
    pub fn is_exact(&self) -> bool {
        self.levels.as_ref().is_none_or(|levels| levels.exact)
    }

    /// Share of all samples that are above a threshold, 0 to 1: as exact as [`Statistics::voxels_above`].
    pub fn share_above(&self, threshold: f64) -> f64 {
        self.voxels_above(threshold) as f64 / self.voxels as f64
    }
}

/// Reads a volume once (types of 8 and 16 bits) or twice (wider types) and describes the samples that were measured, of a
/// region only those inside. Threads hold 2 MiB of samples each, or a row if that is more.
///
/// # Errors
/// The volume's own, and the region's; [`crate::Error::Interrupted`].
pub fn statistics(
    volume: &dyn Volume,
    region: Option<&RegionVoxels>,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let pass = Pass {
        volume,
        region,
        walk: Walk::whole(volume, 0),
        progress,
    };
    match volume.header().dtype {
        Dtype::U8 => pass.counted::<u8, 256>(|bits| bits, 0.0),
        Dtype::I8 => pass.counted::<i8, 256>(|bits| bits ^ 0x80, -128.0),
        Dtype::U16 => pass.counted::<u16, 65_536>(|bits| bits, 0.0),
        Dtype::I16 => pass.counted::<i16, 65_536>(|bits| bits ^ 0x8000, -32_768.0),
        wide => with_voxel_type!(wide, T => pass.binned::<T>()),
    }
}

/// What is read, and how.
struct Pass<'a> {
    volume: &'a dyn Volume,
    region: Option<&'a RegionVoxels>,
    walk: Walk,
    progress: &'a dyn Progress,
}

impl Pass<'_> {
    /// Reads all samples that count and folds stretches of them.
    fn fold<T: Voxel, A: Send>(
        &self,
        new: impl Fn() -> A + Send + Sync,
        add: impl Fn(&mut A, &[T]) + Send + Sync,
        merge: impl Fn(A, A) -> A + Send + Sync,
    ) -> Result<A> {
        let add = |sum: &mut A, piece: &Piece, samples: &[T]| {
            for_each_inside(self.volume, self.region, piece, samples, |inside| {
                add(sum, inside)
            })
        };
        self.walk.fold(self.volume, self.progress, new, add, merge)
    }

    /// Counts every value of a small type. `rank` turns a sample's bits into its rank, 0 for the
    /// type's smallest value `low`.
    fn counted<T: Voxel, const N: usize>(
        &self,
        rank: impl Fn(usize) -> usize,
        low: f64,
    ) -> Result<Statistics> {
        self.progress.begin("histogram", self.walk.pieces());
        let by_bits = self.fold(
            || vec![0u64; N],
            |counts: &mut Vec<u64>, samples: &[T]| count_bits(samples, counts),
            add_counts,
        )?;
        let mut counts = vec![0; N];
        for (bits, n) in by_bits.into_iter().enumerate() {
            counts[rank(bits)] = n;
        }
        let voxels = counts.iter().sum();
        if voxels == 0 {
            return Ok(describe(Range::default(), None));
        }
        let first = counts.iter().position(|&n| n > 0).unwrap_or(0);
        let last = counts.iter().rposition(|&n| n > 0).unwrap_or(0);
        let levels = Levels {
            low: low + first as f64,
            width: 1.0,
            exact: true,
            counts: counts[first..=last].to_vec(),
        };
        Ok(describe(
            Range {
                voxels,
                min: low + first as f64,
                max: low + last as f64,
                ..Range::default()
            },
            Some(levels),
        ))
    }

    /// First the range, then bins over it.
    fn binned<T: Voxel>(&self) -> Result<Statistics> {
        self.progress.begin("range", self.walk.pieces());
        let range = self.fold(
            Range::default,
            |range: &mut Range, samples: &[T]| samples.iter().for_each(|v| range.add(v.to_f64())),
            Range::merge,
        )?;
        if range.min > range.max {
            return Ok(describe(range, None));
        }
        let exact = !T::DTYPE.is_float() && range.max - range.min < BINS as f64;
        // halves, since the distance of two finite numbers may not be finite
        let (low, half) = (range.min, range.max / 2.0 - range.min / 2.0);
        let (bins, scale) = match exact {
            true => (half as usize * 2 + 2, 2.0),
            false => (BINS, BINS as f64 / half),
        };
        self.progress.begin("histogram", self.walk.pieces());
        let counts = self.fold(
            || vec![0u64; bins],
            |counts: &mut Vec<u64>, samples: &[T]| {
                for v in samples.iter().map(|v| v.to_f64()).filter(|v| v.is_finite()) {
                    // 0 x infinity, if all values are the same, becomes 0
                    let bin = (v / 2.0 - low / 2.0) * scale;
                    counts[(bin as usize).min(bins - 1)] += 1;
                }
            },
            add_counts,
        )?;
        let width = if exact {
            1.0
        } else {
            (half / BINS as f64 * 2.0).max(f64::MIN_POSITIVE)
        };
        let levels = Levels {
            low,
            width,
            exact,
            counts,
        };
        Ok(describe(range, Some(levels)))
    }
}

/// Counts samples of 1 or 2 bytes by their bits.
fn count_bits<T: Voxel>(samples: &[T], counts: &mut [u64]) {
    if size_of::<T>() == 1 {
        let bytes: &[u8] = bytemuck::cast_slice(samples);
        bytes.iter().for_each(|&b| counts[usize::from(b)] += 1);
    } else {
        let words: &[u16] = bytemuck::cast_slice(samples);
        words.iter().for_each(|&w| counts[usize::from(w)] += 1);
    }
}

fn add_counts(mut a: Vec<u64>, b: Vec<u64>) -> Vec<u64> {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
}

/// The range of samples and those outside of any range.
#[derive(Debug, Clone, Copy)]
struct Range {
    voxels: u64,
    nan: u64,
    negative: u64,
    positive: u64,
    min: f64,
    max: f64,
}

impl Default for Range {
    fn default() -> Self {
        Range {
            voxels: 0,
            nan: 0,
            negative: 0,
            positive: 0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
        }
    }
}

impl Range {
    fn add(&mut self, v: f64) {
        self.voxels += 1;
        if v.is_finite() {
            self.min = self.min.min(v);
            self.max = self.max.max(v);
        } else if v.is_nan() {
            self.nan += 1;
        } else if v > 0.0 {
            self.positive += 1;
        } else {
            self.negative += 1;
        }
    }

    fn merge(self, other: Self) -> Self {
        Range {
            voxels: self.voxels + other.voxels,
            nan: self.nan + other.nan,
            negative: self.negative + other.negative,
            positive: self.positive + other.positive,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }
}

fn describe(range: Range, levels: Option<Levels>) -> Statistics {
    let ends = levels.as_ref().map(|_| [range.min, range.max]);
    let histogram = levels
        .as_ref()
        .zip(ends)
        .map(|(l, ends)| l.rebin(ends, 256));
    Statistics {
        voxels: range.voxels,
        nan: range.nan,
        negative_infinite: range.negative,
        positive_infinite: range.positive,
        range: ends,
        histogram: histogram.unwrap_or_default(),
        otsu: levels.as_ref().and_then(Levels::otsu),
        levels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;
    use proptest::prelude::*;

    fn of<T: Voxel>(samples: Vec<T>) -> Statistics {
        let volume = MemoryVolume::new(
            Dims([2, 2, samples.len() as u32 / 4]),
            Placement::default(),
            samples,
        );
        statistics(&volume.unwrap(), None, &Quiet).unwrap()
    }

    fn check_exact<T: Voxel>(samples: Vec<T>) -> Statistics {
        let stats = of(samples.clone());
        let values: Vec<f64> = samples.iter().map(|v| v.to_f64()).collect();
        let min = values.iter().copied().fold(f64::INFINITY, f64::min);
        let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert_eq!(stats.range, Some([min, max]));
        assert_eq!(stats.voxels, samples.len() as u64);
        assert_eq!(stats.histogram.iter().sum::<u64>(), stats.voxels);
        for t in values.iter().flat_map(|v| [*v - 0.5, *v, *v + 0.5]) {
            let above = values.iter().filter(|v| **v >= t).count() as u64;
            assert_eq!(stats.voxels_above(t), above, "{t}");
        }
        stats
    }

    proptest! {
        #[test]
        fn integers_are_counted_exactly(seed in prop::collection::vec(any::<i16>(), 8..=8)) {
            let a = check_exact(seed.clone());
            let shifted = seed.iter().map(|&v| i32::from(v) + 1_000_000).collect();
            let b = check_exact::<i32>(shifted);
            prop_assert_eq!(a.otsu.map(|t| t + 1e6), b.otsu);
            let unsigned = seed.iter().map(|&v| (i32::from(v) + 32_768) as u16).collect();
            let c = check_exact::<u16>(unsigned);
            prop_assert_eq!(a.otsu.map(|t| t + 32_768.0), c.otsu);
            let bytes = check_exact::<i8>(seed.iter().map(|&v| v as i8).collect());
            let ubytes: Vec<u8> = seed.iter().map(|&v| (v as i8 as u8) ^ 0x80).collect();
            prop_assert_eq!(bytes.otsu.map(|t| t + 128.0), check_exact(ubytes).otsu);
        }

        #[test]
        fn floats_never_fail(bits in prop::collection::vec(any::<u64>(), 8..=8)) {
            let stats = of::<f64>(bits.iter().map(|&b| f64::from_bits(b)).collect());
            let finite = 8 - stats.nan - stats.negative_infinite - stats.positive_infinite;
            prop_assert_eq!(stats.histogram.iter().sum::<u64>(), finite);
            let floats = bits.iter().map(|&b| f32::from_bits(b as u32)).collect();
            prop_assert_eq!(of::<f32>(floats).voxels, 8);
        }
    }

    #[test]
    fn what_is_not_finite_is_counted_apart() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let stats = of(vec![nan, inf, -inf, 1.0, 2.0, 2.0, inf, 1.0]);
        assert_eq!(
            (stats.nan, stats.positive_infinite, stats.negative_infinite),
            (1, 2, 1)
        );
        assert_eq!(stats.range, Some([1.0, 2.0]));
        assert_eq!(stats.voxels_above(1.5), 4);
        assert!((stats.otsu.unwrap() - 1.5).abs() < 1e-4);
        let none = of(vec![nan; 8]);
        assert_eq!(
            (none.range, none.otsu, none.voxels_above(0.0)),
            (None, None, 0)
        );
        let same = of(vec![3.0f32; 8]);
        assert_eq!((same.range, same.otsu), (Some([3.0, 3.0]), None));
        assert_eq!(same.histogram[0], 8);
        // one sample far away
        let mut far: Vec<f32> = (0..40_000).map(|i| (i % 1000) as f32 / 1000.0).collect();
        assert_eq!(of(far.clone()).coarse(), None);
        far[7] = 1e5;
        assert!(of(far.clone()).coarse().unwrap().contains("--clamp"));
        // nor where all samples are the same
        assert_eq!(of(vec![5000.0f32; 16]).coarse(), None);
        // what is counted one by one is never coarse
        let mut counted: Vec<u16> = far.iter().map(|v| (v * 10.0) as u16).collect();
        counted[7] = u16::MAX;
        assert_eq!(of(counted).coarse(), None);
        // two values are two bins, wherever they are
        assert_eq!(of([0.5f32, 2.5].repeat(8)).coarse(), None);
        let wide = of(vec![
            f64::MAX,
            f64::MIN,
            0.0,
            0.0,
            f64::MAX,
            f64::MIN,
            0.0,
            1.0,
        ]);
        assert_eq!(wide.histogram.iter().sum::<u64>(), 8);
    }

    /// In bins, too, a clipped value is told as it is, and not as where its bin begins.
    #[test]
    fn a_clipped_value_is_told_as_it_is() {
        for top in [65_535.0f32, 1.0] {
            let heap = |middle: f32, i: u32| {
                let spread = (i % 40 + i / 40 % 40 + i / 1600 % 40) as f32 / 1200.0;
                (middle - 0.05 + spread) * top
            };
            let mut samples: Vec<f32> = (0..40_000).map(|i| heap(0.25, i)).collect();
            samples.extend((0..20_000).map(|i| heap(0.6, i)));
            samples.extend([top; 6000]);
            let clipped = of(samples).clipped().unwrap();
            let told = format!("6,000 samples of {top} are");
            assert!(clipped.starts_with(&told), "{clipped}");
        }
    }
}
