//! What a table of cells or objects sums up to.

use super::Table;
use super::edge::{Body, Columns, Corrected, EdgeCorrection, Weights};
use super::moments::Moments;
use super::outside::{Air, Outside, Reach, find};
use super::query::Query;
use super::reader::TableReader;
use crate::error::{Error, Result};
use crate::grid::Fill;
use crate::manifest::Manifest;
use serde::Serialize;
use std::path::Path;

/// Bins of a histogram.
const BINS: usize = 32;

/// Sums over the chosen rows of a table of cells or objects. Cells that count as air around the sample, see
/// [`Outside`], are no rows here.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Rows chosen.
    pub count: u64,
    /// Rows of the table.
    pub of: u64,
    /// The rows chosen, by the name of the table.
    #[serde(flatten)]
    pub counts: Counts,
    /// Share of below voxels, 0 to 1, in what [`Summary::porosity_of`] says; for a part of a tile set that of the
    /// whole. Absent if that has no voxels.
    pub porosity: Option<f64>,
    /// What porosity and volume fraction are shares of.
    pub porosity_of: PorosityOf,
    /// Which cells count as air around the sample.
    pub outside: Outside,
    /// How many these are.
    pub outside_cells: u64,
    /// Their voxels.
    pub outside_voxels: u64,
    /// Share of the chosen rows' voxels, 0 to 1, in the same; absent if that has no voxels.
    pub volume_fraction: Option<f64>,
    /// Rows that touch the grid's outer faces and may go on outside.
    pub border: Border,
    /// Distribution of the diameter of the ball with the same volume, of rows that do not touch the border;
    /// absent if there is none.
    pub equivalent_diameter: Option<Distribution>,
    /// Median of Wadell's sphericity of the rows that have one; those at the border have none.
    pub sphericity_median: Option<f64>,
    /// Chosen rows by volume of the sample, corrected for those that the border cuts; absent if [`EdgeCorrection`] does
    /// not apply.
    pub number_density: Option<f64>,
    /// Their mean volume, corrected in the same way.
    pub mean_volume_corrected: Option<f64>,
    /// How both were corrected, or why they were not.
    pub edge_correction: EdgeCorrection,
    /// What makes the numbers doubtful.
    pub warnings: Vec<String>,
}

/// What a porosity is a share of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum PorosityOf {
    /// All voxels of the grid.
    #[serde(rename = "grid")]
    Grid,
    /// The voxels of the grid but those of the cells that count as outside.
    #[serde(rename = "grid without outside")]
    GridWithoutOutside,
    /// The voxels of the region of interest.
    #[serde(rename = "region")]
    Region,
}

/// Voxels of the grid outside of the region of interest, and those of them that are taken for air.
struct Around {
    voxels: f64,
    air: f64,
}

impl Around {
    fn of(manifest: &Manifest) -> Self {
        let Some(region) = &manifest.region else {
            return Around {
                voxels: 0.0,
                air: 0.0,
            };
        };
        let voxels = region.outside(manifest.grid.dims) as f64;
        let air = match region.fill {
            Fill::Air => voxels,
            Fill::Material => 0.0,
        };
        Around { voxels, air }
    }

    /// True if rows of this table may hold voxels outside of the region.
    fn is_in(&self, which: Table) -> bool {
        self.voxels > 0.0 && (which == Table::Cells) == (self.air > 0.0)
    }

    fn warning(&self, which: Table) -> String {
        let other = match which {
            Table::Cells => "material",
            _ => "air",
        };
        format!(
            "{} at the border hold what is outside of the region as well, so there is no volume of them: a conversion \
             with --roi-fill {other} gives it",
            which.name()
        )
    }
}

/// Rows chosen: all, those that do not touch the grid's outer faces, and those that do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(untagged)]
#[allow(missing_docs)]
pub enum Counts {
    /// Of cells.
    Cells {
        cells: u64,
        cells_whole: u64,
        cells_border: u64,
    },
    /// Of objects.
    Objects {
        objects: u64,
        objects_whole: u64,
        objects_border: u64,
    },
}

/// Rows at the border.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Border {
    /// How many.
    pub count: u64,
    /// Share of the chosen rows, 0 to 1; absent if there are none.
    pub share: Option<f64>,
}

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

/// Sums up the rows of cells or objects that `query` keeps, whatever its order. Memory: 24 bytes per row that does
/// not touch the border.
///
/// # Errors
/// [`Error::Usage`] for the table of surfaces, or if cells that count as outside may be missing in a part of a tile
/// set; what reading returns.
pub fn summarise(
    dir: &Path,
    manifest: &Manifest,
    which: Table,
    query: &Query,
    outside: Outside,
) -> Result<Summary> {
    let (above, all_cells) = match &manifest.selection {
        Some(part) => (part.of.voxels_above, part.of.cells),
        None => (manifest.totals.voxels_above, manifest.totals.cells),
    };
    if outside != Outside::None && manifest.totals.cells != all_cells {
        let found = format!(
            "border-cell for a part of a tile set, with {} of {all_cells} cells",
            manifest.totals.cells
        );
        return Err(Error::usage("--outside", found, "the whole tile set"));
    }
    let around = Around::of(manifest);
    if outside != Outside::None && around.voxels > 0.0 {
        let found = "border-cell for tiles of a region of interest";
        let expected = "none: what is outside of the region does not count anyway";
        return Err(Error::usage("--outside", found, expected));
    }
    let all = manifest.grid.dims.voxels() as f64 - around.voxels;
    let below = manifest.grid.dims.voxels() as f64 - above as f64 - around.air;
    let mut cells = Table::Cells.open(dir, manifest)?;
    let air = match manifest.region {
        None => Air::find(&mut cells, manifest, outside, below)?,
        Some(_) => Air::default(),
    };
    let left_out = which == Table::Cells && outside != Outside::None;
    let (rows, weights) = Rows::read(&mut which.open(dir, manifest)?, query, manifest, left_out)?;
    let Corrected {
        number_density,
        mean_volume,
        correction,
    } = weights.finish(manifest, which, air.cells);
    let rest = all - air.voxels;
    let share = |voxels: f64| (rest > 0.0).then(|| voxels / rest);
    Ok(Summary {
        count: rows.count,
        of: rows.of,
        counts: rows.counts(which),
        porosity: share(below - air.voxels),
        porosity_of: match outside {
            Outside::None if manifest.region.is_some() => PorosityOf::Region,
            Outside::None => PorosityOf::Grid,
            Outside::BorderCell => PorosityOf::GridWithoutOutside,
        },
        outside,
        outside_cells: air.cells,
        outside_voxels: air.voxels as u64,
        volume_fraction: share(rows.voxels).filter(|_| !around.is_in(which)),
        border: Border {
            count: rows.border,
            share: (rows.count > 0).then(|| rows.border as f64 / rows.count as f64),
        },
        sphericity_median: quantile(&rows.round, 0.5),
        equivalent_diameter: distribution(rows.sizes, rows.unit),
        number_density,
        mean_volume_corrected: mean_volume,
        warnings: match around.is_in(which) {
            true => vec![around.warning(which)],
            false => warnings(&air, outside, rest),
        }
        .into_iter()
        .chain(correction.warning(which))
        .collect(),
        edge_correction: correction,
    })
}

/// What a user should know of the porosity, which is of `rest` voxels.
fn warnings(air: &Air, outside: Outside, rest: f64) -> Vec<String> {
    let mut all = Vec::new();
    match (outside, air.likely) {
        (Outside::None, Some((id, share))) => all.push(format!(
            "cell {id} has {:.1} % of the air and reaches all four sides of the grid: if it is the air around a \
             sample, leave it out of porosity and volumes by --outside border-cell, or convert with --roi",
            100.0 * share
        )),
        (Outside::BorderCell, _) if air.cells == 0 => all.push(
            "no cell reaches four faces of the grid: none was taken as the air around a sample"
                .to_owned(),
        ),
        _ => {}
    }
    if let Some(id) = air.at_an_edge {
        all.push(format!(
            "{} of the cells that were taken as outside, as cell {id}, reach two opposite faces of the grid and two \
             that meet: a pore at an edge of the grid that is as long as the grid does so too; if they are pores, use \
             a larger crop or --outside none",
            air.at_edges
        ));
    }
    if rest <= 0.0 {
        all.push(
            "all voxels of the grid are taken as outside: there is no porosity and no share of what is left"
                .to_owned(),
        );
    }
    all
}

/// What is gathered from rows.
#[derive(Default)]
struct Rows {
    count: u64,
    of: u64,
    border: u64,
    voxels: f64,
    /// Diameters and volumes of those that do not touch the border.
    sizes: Vec<(f64, f64)>,
    unit: String,
    /// Their sphericities, rising.
    round: Vec<f64>,
}

impl Rows {
    /// Reads a table; air around the sample may be left out.
    fn read(
        table: &mut TableReader,
        query: &Query,
        manifest: &Manifest,
        without_outside: bool,
    ) -> Result<(Self, Weights)> {
        let (voxels, volume) = (find(table, "voxels")?, find(table, "volume")?);
        let diameter = find(table, "equivalent_diameter")?;
        let border = find(table, "touches_border")?;
        let sphericity = find(table, "sphericity")?;
        let reach = Reach::new(table, manifest)?;
        let columns = Columns::of(table)?;
        let mut weights = Weights::of(manifest, &columns);
        let mut rows = Rows {
            unit: table.columns()[diameter].unit.clone(),
            ..Rows::default()
        };
        while let Some(row) = table.next_row()? {
            if without_outside && reach.is_outside(&row)? {
                continue;
            }
            rows.of += 1;
            if !query.keeps(&row)? {
                continue;
            }
            rows.count += 1;
            rows.voxels += row.number(voxels)?.unwrap_or(0.0);
            let at_border = row.number(border)?.is_some_and(|v| v != 0.0);
            if let Some(body) = Body::read(&row, &columns, at_border)? {
                weights.add(&body);
            }
            // what the grid cuts is smaller here than it is
            if at_border {
                rows.border += 1;
                continue;
            }
            if let (Some(d), Some(v)) = (row.number(diameter)?, row.number(volume)?) {
                rows.sizes.push((d, v.max(0.0)));
            }
            rows.round.extend(row.number(sphericity)?);
        }
        rows.round.sort_by(f64::total_cmp);
        Ok((rows, weights))
    }

    fn counts(&self, which: Table) -> Counts {
        let (all, whole, border) = (self.count, self.count - self.border, self.border);
        match which {
            Table::Objects => Counts::Objects {
                objects: all,
                objects_whole: whole,
                objects_border: border,
            },
            _ => Counts::Cells {
                cells: all,
                cells_whole: whole,
                cells_border: border,
            },
        }
    }
}

/// The distribution of values with their weights.
fn distribution(mut sizes: Vec<(f64, f64)>, unit: String) -> Option<Distribution> {
    sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let values: Vec<f64> = sizes.iter().map(|s| s.0).collect();
    let (min, max) = (*values.first()?, *values.last()?);
    let at = |q| quantile(&values, q).unwrap_or(min);
    let by_number = Moments::of(sizes.iter().map(|s| (s.0, 1.0)));
    let number = Spread {
        min,
        q1: at(0.25),
        median: at(0.5),
        q3: at(0.75),
        max,
        mean: by_number.mean(),
        sd: by_number.sd(),
    };
    let [q1, median, q3] = [0.25, 0.5, 0.75].map(|q| weighted_quantile(&sizes, q));
    let by_volume = Moments::of(sizes.iter().copied());
    let volume = Spread {
        min,
        q1,
        median,
        q3,
        max,
        mean: by_volume.mean(),
        sd: by_volume.sd(),
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
        mean: number.mean,
        sd: number.sd,
        median: number.median,
        by_volume_median: volume.median,
        number,
        volume,
        histogram: Histogram { min, max, bins },
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
        assert_eq!(distribution(Vec::new(), String::new()), None);
    }
}
