//! How values are distributed: where they lie, and how many of them.

use super::moments::Moments;
use serde::Serialize;

/// Bins of a histogram.
pub(crate) const BINS: usize = 32;

/// A distribution in two weights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distribution {
    /// Unit of the values.
    pub unit: String,
    /// Mean by number.
    pub mean: f64,
    /// Standard deviation by number.
    pub sd: f64,
    /// Median by number.
    pub median: f64,
    /// Median by volume.
    pub by_volume_median: f64,
    /// Every row counts the same. Quantiles are interpolated between neighbours.
    pub number: Spread,
    /// Every row counts by its volume. A quantile is the smallest value up to which the rows make
    /// that share of the volume.
    pub volume: Spread,
    /// Rows in equal bins from min to max.
    pub histogram: Histogram,
}

/// Equal bins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    /// Lower end of the first bin.
    pub min: f64,
    /// Upper end of the last bin.
    pub max: f64,
    /// Rows per bin.
    pub bins: Vec<u64>,
    /// Their volume per bin.
    pub volumes: Vec<f64>,
}

impl Histogram {
    /// Values with their volumes in bins between two ends, of which none lies outside.
    pub(crate) fn of(values: &[(f64, f64)], [min, max]: [f64; 2]) -> Self {
        let (mut bins, mut volumes) = (vec![0; BINS], vec![0.0; BINS]);
        for &(v, volume) in values {
            let share = if max > min {
                (v - min) / (max - min)
            } else {
                0.0
            };
            let bin = ((share * BINS as f64) as usize).min(BINS - 1);
            bins[bin] += 1;
            volumes[bin] += volume;
        }
        Histogram {
            min,
            max,
            bins,
            volumes,
        }
    }
}

/// Where values lie. `sd` is that of the rows themselves (divided by n, not n - 1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Smallest.
    pub min: f64,
    /// First quartile.
    pub q1: f64,
    /// Median.
    pub median: f64,
    /// Third quartile.
    pub q3: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

impl Spread {
    /// That of sorted values, each counting the same; `None` of no values.
    pub(crate) fn of(sorted: &[f64]) -> Option<Self> {
        let (min, max) = (*sorted.first()?, *sorted.last()?);
        let at = |q| quantile(sorted, q).unwrap_or(min);
        let moments = Moments::of(sorted.iter().map(|&v| (v, 1.0)));
        Some(Spread {
            min,
            q1: at(0.25),
            median: at(0.5),
            q3: at(0.75),
            max,
            mean: moments.mean(),
            sd: moments.sd(),
        })
    }

    /// That of sorted values, each counting by its weight: a quantile is the smallest value up to which the weights reach
    /// that share of their sum. `None` of no values.
    pub(crate) fn weighted(sorted: &[(f64, f64)]) -> Option<Self> {
        let [q1, median, q3] = [0.25, 0.5, 0.75].map(|q| weighted_quantile(sorted, q));
        let moments = Moments::of(sorted.iter().copied());
        Some(Spread {
            min: sorted.first()?.0,
            q1,
            median,
            q3,
            max: sorted.last()?.0,
            mean: moments.mean(),
            sd: moments.sd(),
        })
    }
}

/// The distribution of values with their weights.
pub(super) fn distribution(mut sizes: Vec<(f64, f64)>, unit: String) -> Option<Distribution> {
    sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let values: Vec<f64> = sizes.iter().map(|s| s.0).collect();
    let number = Spread::of(&values)?;
    let Spread { min, max, .. } = number;
    let volume = Spread::weighted(&sizes)?;
    let histogram = Histogram::of(&sizes, [min, max]);
    Some(Distribution {
        unit,
        mean: number.mean,
        sd: number.sd,
        median: number.median,
        by_volume_median: volume.median,
        number,
        volume,
        histogram,
    })
}

/// A quantile of sorted values, interpolated as numpy's `linear` does (type 7 of Hyndman and Fan,
/// The American Statistician 50, 1996).
pub(crate) fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let place = q * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (place.floor() as usize, place.ceil() as usize);
    Some(sorted[low] + (sorted[high] - sorted[low]) * place.fract())
}

/// The smallest of sorted values up to which the weights reach the share `q` of their sum.
fn weighted_quantile(sorted: &[(f64, f64)], q: f64) -> f64 {
    let goal = q * sorted.iter().map(|s| s.1).sum::<f64>();
    let mut sum = 0.0;
    for &(value, weight) in sorted {
        sum += weight;
        if sum >= goal {
            return value;
        }
    }
    sorted.last().map_or(f64::NAN, |s| s.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile([1, 2, 4, 8], [0.25, 0.5, 0.75])
        let v = [1.0, 2.0, 4.0, 8.0];
        let found = [0.25, 0.5, 0.75].map(|q| quantile(&v, q).unwrap());
        assert_eq!(found, [1.75, 3.0, 5.0]);
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.75), Some(3.0));
    }

    #[test]
    fn weights_count() {
        let sizes = vec![(4.0, 6.0), (1.0, 1.0), (2.0, 3.0)];
        let d = distribution(sizes, "mm".into()).unwrap();
        assert_eq!((d.number.mean, d.number.median), (7.0 / 3.0, 2.0));
        // the values 1, 2, 2, 2, 4, 4, 4, 4, 4, 4: numpy.mean, numpy.std
        assert!((d.volume.mean - 3.1).abs() < 1e-12);
        assert!((d.volume.sd - 1.135_781_669_160_054_8).abs() < 1e-12);
        assert_eq!((d.volume.q1, d.volume.median, d.volume.q3), (2.0, 4.0, 4.0));
        assert_eq!(d.histogram.bins.iter().sum::<u64>(), 3);
        assert_eq!((d.histogram.bins[0], d.histogram.bins[BINS - 1]), (1, 1));
        assert_eq!(d.histogram.volumes[0], 1.0);
        assert_eq!(d.histogram.volumes.iter().sum::<f64>(), 10.0);
        assert_eq!(distribution(Vec::new(), String::new()), None);
    }
}
