//! What a table of cells or objects sums up to.

use super::Table;
use super::edge::{Body, Columns, Corrected, EdgeCorrection, Weights};
use super::outside::{Air, Outside, Reach, find};
use super::query::Query;
use super::reader::TableReader;
use super::spread::{Distribution, Spread, distribution, quantile};
use crate::error::{Error, Result};
use crate::grid::Fill;
use crate::manifest::Manifest;
use serde::Serialize;
use std::path::Path;

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
    /// How many neighbours rows have that do not touch the border; absent without a table of walls.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<Spread>,
    /// How thick the walls of these rows are, each by the median of its own; absent likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_thickness: Option<Spread>,
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

/// Sums up the rows of cells or objects that `query` keeps, whatever its order. Memory: 24 bytes per row that does
/// not touch the border, and 16 more with a table of walls.
///
/// # Errors
/// [`Error::Usage`] for the table of surfaces, which [`super::summarise_surfaces`] sums up, or if cells that count as outside may be missing in a part of a tile
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
        neighbours: Spread::of(&rows.neighbours),
        wall_thickness: Spread::of(&rows.wall_thickness),
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
    /// Their neighbours and the thickness of their walls, rising; none without a table of walls.
    neighbours: Vec<f64>,
    wall_thickness: Vec<f64>,
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
        let place = |name: &str| table.columns().iter().position(|c| c.is_named(name));
        let [neighbours, wall_thickness] = ["neighbours", "wall_thickness"].map(place);
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
            let known = |at: Option<usize>| at.map_or(Ok(None), |at| row.number(at));
            rows.neighbours.extend(known(neighbours)?);
            rows.wall_thickness.extend(known(wall_thickness)?);
        }
        for sorted in [
            &mut rows.round,
            &mut rows.neighbours,
            &mut rows.wall_thickness,
        ] {
            sorted.sort_by(f64::total_cmp);
        }
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
