//! What a table of cells or objects sums up to.

use super::query::Query;
use super::reader::TableReader;
use crate::error::{Error, Result};
use crate::manifest::Manifest;
use serde::Serialize;

/// Bins of a histogram.
const BINS: usize = 32;

/// Sums over the chosen rows of a table of cells or objects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Rows chosen.
    pub count: u64,
    /// Rows of the table.
    pub of: u64,
    /// Share of below voxels in the grid, 0 to 1; for a part of a tile set that of the whole.
    pub porosity: f64,
    /// Share of the chosen rows' voxels in the grid, 0 to 1.
    pub volume_fraction: f64,
    /// Rows that touch the grid's outer faces and may go on outside.
    pub border: Border,
    /// Distribution of the diameter of the ball with the same volume; absent if no row is chosen.
    pub equivalent_diameter: Option<Distribution>,
    /// Median of Wadell's sphericity of the rows that have one.
    pub sphericity_median: Option<f64>,
}

/// Rows at the border.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Border {
    /// How many.
    pub count: u64,
    /// Share of the chosen rows, 0 to 1.
    pub share: f64,
}

/// A distribution in two weights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Distribution {
    /// Unit of the values.
    pub unit: String,
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

/// Sums up the rows that `query` keeps, whatever its order. Memory: 24 bytes per row.
///
/// # Errors
/// [`Error::Usage`] for a table without `voxels` and `equivalent_diameter`, such as that of
/// surfaces; what reading returns.
pub fn summarise(table: &mut TableReader, query: &Query, manifest: &Manifest) -> Result<Summary> {
    let column = |name: &str| {
        table.column(name).ok_or_else(|| {
            Error::usage(
                "--summary",
                format!("a table without the column {name}"),
                "the table of cells or objects",
            )
        })
    };
    let (voxels, volume) = (column("voxels")?, column("volume")?);
    let (diameter, border) = (column("equivalent_diameter")?, column("touches_border")?);
    let sphericity = column("sphericity")?;
    let unit = table.columns()[diameter].unit.clone();
    let mut sizes: Vec<(f64, f64)> = Vec::new();
    let mut round: Vec<f64> = Vec::new();
    let (mut count, mut of, mut at_border, mut voxel_sum) = (0u64, 0u64, 0u64, 0.0);
    while let Some(row) = table.next_row()? {
        of += 1;
        if !query.keeps(&row)? {
            continue;
        }
        count += 1;
        voxel_sum += row.number(voxels)?.unwrap_or(0.0);
        at_border += u64::from(row.number(border)?.is_some_and(|v| v != 0.0));
        if let (Some(d), Some(v)) = (row.number(diameter)?, row.number(volume)?) {
            sizes.push((d, v.max(0.0)));
        }
        round.extend(row.number(sphericity)?);
    }
    round.sort_by(f64::total_cmp);
    let all = manifest.grid.dims.voxels() as f64;
    let above = match &manifest.selection {
        Some(part) => part.of.voxels_above,
        None => manifest.totals.voxels_above,
    };
    Ok(Summary {
        count,
        of,
        porosity: 1.0 - above as f64 / all,
        volume_fraction: voxel_sum / all,
        border: Border {
            count: at_border,
            share: at_border as f64 / (count.max(1)) as f64,
        },
        equivalent_diameter: distribution(sizes, unit),
        sphericity_median: quantile(&round, 0.5),
    })
}

/// The distribution of values with their weights.
fn distribution(mut sizes: Vec<(f64, f64)>, unit: String) -> Option<Distribution> {
    sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let values: Vec<f64> = sizes.iter().map(|s| s.0).collect();
    let (min, max) = (*values.first()?, *values.last()?);
    let at = |q| quantile(&values, q).unwrap_or(min);
    let (mean, sd) = moments(sizes.iter().map(|s| (s.0, 1.0)));
    let number = Spread {
        min,
        q1: at(0.25),
        median: at(0.5),
        q3: at(0.75),
        max,
        mean,
        sd,
    };
    let [q1, median, q3] = [0.25, 0.5, 0.75].map(|q| weighted_quantile(&sizes, q));
    let (mean, sd) = moments(sizes.iter().copied());
    let volume = Spread {
        min,
        q1,
        median,
        q3,
        max,
        mean,
        sd,
    };
    let mut bins = vec![0; BINS];
    for v in values {
        let share = if max > min {
            (v - min) / (max - min)
        } else {
            0.0
        };
        bins[((share * BINS as f64) as usize).min(BINS - 1)] += 1;
    }
    Some(Distribution {
        unit,
        number,
        volume,
        histogram: Histogram { min, max, bins },
    })
}

/// A quantile of sorted values, interpolated as numpy's `linear` does (type 7 of Hyndman and Fan,
/// The American Statistician 50, 1996).
fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
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

/// Weighted mean and standard deviation, by the stable update of West (CACM 22, 1979).
fn moments(values: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let (mut weight, mut mean, mut square) = (0.0, 0.0, 0.0);
    for (value, w) in values.filter(|v| v.1 > 0.0) {
        weight += w;
        let away = value - mean;
        mean += away * w / weight;
        square += w * away * (value - mean);
    }
    (mean, (square / weight).sqrt())
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
        assert_eq!(distribution(Vec::new(), String::new()), None);
    }
}
