//! The air around a sample among the cells of a tile set.

use super::reader::{Row, TableReader};
use super::{Chosen, Table};
use crate::error::{Error, Result};
use crate::grid::{Fill, Placement, Shape};
use crate::manifest::Manifest;
use crate::words::things;
use serde::Serialize;
use std::path::Path;

/// Which cells count as the air around the sample, and not as its pores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outside {
    /// No cell: all air in the grid is that of pores.
    #[default]
    None,
    /// Cells that reach four or more of the grid's six faces. A pore that the grid cuts reaches three at most,
    /// unless it is as long as the grid; air around a sample that touches some faces still reaches four.
    BorderCell,
}

/// Faces of the grid that a cell reaches to count as air around the sample.
const FACES: usize = 4;

/// Tells by a row's box which ends of the grid's own box it reaches. A row of a rotated grid reaches the box only
/// at the grid's corners, so it never seems to reach more faces than it does.
#[derive(Debug, Clone)]
pub(super) struct Reach {
    /// Where a row has the lower and the upper ends of its box, and whether it touches the border.
    columns: [[usize; 3]; 2],
    border: usize,
    /// The box of the grid's voxels.
    grid: [[f64; 3]; 2],
    /// What two ends may differ by and be the same.
    slack: f64,
    /// World axes along which the grid's x and y run, even if only in part.
    sides: [bool; 3],
    /// Each axis of the grid runs along one of the world, so that what reaches an end of the box reaches a face.
    is_aligned: bool,
}

impl Reach {
    /// For a table of cells or objects.
    ///
    /// # Errors
    /// [`Error::Usage`] if the table has no boxes.
    pub fn new(table: &TableReader, manifest: &Manifest) -> Result<Self> {
        let place = &manifest.measured();
        let last = manifest.grid.dims.0.map(|n| f64::from(n - 1));
        let grid = place.box_around([[0.0; 3], last]);
        let names = [["min_x", "min_y", "min_z"], ["max_x", "max_y", "max_z"]];
        let mut columns = [[0; 3]; 2];
        for (columns, names) in columns.iter_mut().zip(names) {
            for (column, name) in columns.iter_mut().zip(names) {
                *column = find(table, name)?;
            }
        }
        Ok(Reach {
            columns,
            border: find(table, "touches_border")?,
            grid,
            slack: slack(place, &grid),
            sides: std::array::from_fn(|r| (0..2).any(|a| place.directions[a][r] != 0.0)),
            is_aligned: place
                .directions
                .iter()
                .all(|axis| axis.iter().filter(|v| **v != 0.0).count() == 1),
        })
    }

    /// Which of the grid's ends along x, y and z, lower and upper, a row's box reaches; none unless it touches the
    /// border.
    fn ends(&self, row: &Row) -> Result<[[bool; 3]; 2]> {
        let mut reached = [[false; 3]; 2];
        if row.number(self.border)?.is_none_or(|v| v == 0.0) {
            return Ok(reached);
        }
        for side in 0..2 {
            for r in 0..3 {
                let value = row.number(self.columns[side][r])?;
                reached[side][r] =
                    value.is_some_and(|v| (v - self.grid[side][r]).abs() <= self.slack);
            }
        }
        Ok(reached)
    }

    /// True if a row is air around the sample by the rule [`Outside::BorderCell`].
    ///
    /// # Errors
    /// What reading returns.
    pub fn is_outside(&self, row: &Row) -> Result<bool> {
        let reached = self.ends(row)?;
        Ok(reached.as_flattened().iter().filter(|r| **r).count() >= FACES)
    }

    /// True if a row reaches both ends of the grid along one axis alone, and one along each other.
    fn lies_along_an_edge(&self, row: &Row) -> Result<bool> {
        let [lower, upper] = self.ends(row)?;
        let both = (0..3).filter(|&r| lower[r] && upper[r]).count();
        Ok(both == 1 && (0..3).all(|r| lower[r] || upper[r]))
    }

    /// True if a row's box leaves that of the voxels inside of a region, or, where this is not known, if it touches the
    /// border.
    fn may_leave(&self, row: &Row, inside: Option<&[[f64; 3]; 2]>) -> Result<bool> {
        let Some(inside) = inside else {
            return Ok(row.number(self.border)?.is_some_and(|v| v != 0.0));
        };
        for r in 0..3 {
            let [low, high] = [0, 1].map(|side| row.number(self.columns[side][r]));
            let leaves = low?.is_some_and(|v| v < inside[0][r] - self.slack)
                || high?.is_some_and(|v| v > inside[1][r] + self.slack);
            if leaves {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// True if a row reaches all four sides of the grid, across x and y.
    fn reaches_all_sides(&self, row: &Row) -> Result<bool> {
        let reached = self.ends(row)?;
        Ok((0..3).all(|r| !self.sides[r] || (reached[0][r] && reached[1][r])))
    }
}

/// Rounding of a number that was written and read again, and a part of a voxel that is none.
fn slack(place: &Placement, grid: &[[f64; 3]; 2]) -> f64 {
    let largest = grid
        .as_flattened()
        .iter()
        .fold(0.0, |l: f64, v| l.max(v.abs()));
    let step = place
        .spacing
        .iter()
        .fold(f64::INFINITY, |s: f64, &v| s.min(v));
    1e-12 * largest + 1e-6 * step
}

/// What a user should know of rows that were chosen from a tile set of a region of interest: which of them hold what is
/// outside of it, and so are not the sample's alone. `None` if none does, or all rows were taken. `omit` says that all
/// but those that are chosen were taken.
///
/// # Errors
/// What reading returns.
pub fn warn_of_outside(
    dir: &Path,
    manifest: &Manifest,
    chosen: &Chosen,
    omit: bool,
) -> Result<Option<String>> {
    let Some(region) = &manifest.region else {
        return Ok(None);
    };
    let (of, air) = match region.fill {
        Fill::Material => (Table::Objects, "air"),
        Fill::Air => (Table::Cells, "material"),
    };
    if chosen.is_all() || chosen.table != of || region.outside(manifest.grid.dims) == 0 {
        return Ok(None);
    }
    let mut table = of.open(dir, manifest)?;
    let query = chosen.query(&table)?;
    let reach = Reach::new(&table, manifest)?;
    let id = find(&table, "id")?;
    let inside = inside(manifest);
    let (mut first, mut more) = (None, 0);
    while let Some(row) = table.next_row()? {
        if query.keeps(&row)? == omit || !reach.may_leave(&row, inside.as_ref())? {
            continue;
        }
        match first {
            None => first = Some(row.whole(id)?),
            Some(_) => more += 1,
        }
    }
    let others = match more {
        0 => String::new(),
        n => format!(" (and {} more)", things(n, of.singular())),
    };
    let verb = match inside {
        Some(_) => "reaches outside",
        None => "touches the border and may reach outside",
    };
    Ok(first.map(|id| {
        format!(
            "{} {id}{others} {verb} of the region of interest, where everything counts as {}: it is not that of the sample \
             alone; a conversion with --roi-fill {air} makes that",
            of.singular(),
            region.fill
        )
    }))
}

/// What a user should know of rows that were chosen from a tile set, or of all its objects: that the faces of the volume
/// cut some of them, so that their mesh is open there. `None` if no face does, or if they are taken with their caps, as
/// `with_caps` says.
///
/// # Errors
/// What reading returns.
pub fn warn_of_open(
    dir: &Path,
    manifest: &Manifest,
    chosen: &Chosen,
    with_caps: bool,
) -> Result<Option<String>> {
    if with_caps {
        return Ok(None);
    }
    let (of, cut) = match chosen.is_all() {
        false => (
            chosen.table,
            cut(chosen.table, Some(chosen), dir, manifest)?,
        ),
        true => {
            let cells = cut(Table::Cells, None, dir, manifest)?;
            let objects = cut(Table::Objects, None, dir, manifest)?;
            // where a face cuts the surface, it cuts a cell and an object
            (Table::Objects, if cells.rows > 0 { objects } else { cells })
        }
    };
    let verb = if cut.is_sure { "is" } else { "may be" };
    let hint = match manifest.cap {
        false => "a conversion with --cap closes it",
        true => "caps are of objects, and come with all cells of an object alone",
    };
    Ok((cut.rows > 0).then(|| {
        let cut = things(cut.rows, of.singular());
        format!("the mesh {verb} open at the faces of the volume, which cut {cut}: {hint}")
    }))
}

/// What the faces of the volume cut.
struct Cut {
    rows: u64,
    /// It cannot be the edge of a region alone.
    is_sure: bool,
}

/// Rows of a table, those that are chosen of it or all, which the faces of the volume cut.
fn cut(of: Table, chosen: Option<&Chosen>, dir: &Path, manifest: &Manifest) -> Result<Cut> {
    let mut table = of.open(dir, manifest)?;
    let query = chosen.map(|chosen| chosen.query(&table)).transpose()?;
    let is_surface = of == Table::Surfaces;
    // of surfaces, edges without a mate; the edge of a region is a border, too, and the mesh is closed there
    let border = find(
        &table,
        if is_surface {
            "border_edges"
        } else {
            "touches_border"
        },
    )?;
    let reach = match &manifest.region {
        Some(_) if !is_surface => {
            Some(Reach::new(&table, manifest)?).filter(|reach| reach.is_aligned)
        }
        _ => None,
    };
    let mut rows = 0;
    while let Some(row) = table.next_row()? {
        let is_cut = match &reach {
            Some(reach) => reach.ends(&row)?.as_flattened().contains(&true),
            None => row.number(border)?.is_some_and(|v| v != 0.0),
        };
        let taken = query.as_ref().map_or(Ok(true), |query| query.keeps(&row))?;
        rows += u64::from(is_cut && taken);
    }
    Ok(Cut {
        rows,
        is_sure: is_surface || manifest.region.is_none() || reach.is_some(),
    })
}

/// The box around the voxels of the grid that are in a cylinder which ends inside of the grid; `None` if that cannot be
/// told.
fn inside(manifest: &Manifest) -> Option<[[f64; 3]; 2]> {
    let Shape::Cylinder(cylinder) = &manifest.region.as_ref()?.shape else {
        return None;
    };
    let start = manifest.source.crop.as_ref().map_or([0; 3], |c| c.start());
    let last = manifest.grid.dims.0.map(|n| f64::from(n - 1));
    let mut ends = [[0.0; 3], last];
    for a in 0..2 {
        let centre = cylinder.centre[a] - f64::from(start[a]);
        ends[0][a] = (centre - cylinder.radius).ceil().max(0.0);
        ends[1][a] = (centre + cylinder.radius).floor().min(last[a]);
    }
    // what is outside is in one piece then, in each slice, and reaches all sides
    let is_within = (0..2).all(|a| ends[0][a] > 0.0 && ends[1][a] < last[a]);
    is_within.then(|| manifest.measured().box_around(ends))
}

/// A cell of a tile set, as far as sums over its surface need it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellRow {
    pub id: u64,
    pub voxels: u64,
    /// In the unit of the tables; 0 if the table has none.
    pub volume: f64,
    pub at_border: bool,
    /// It counts as air around the sample.
    pub outside: bool,
}

/// Calls `each` for all cells of the tile set in `dir`.
///
/// # Errors
/// What reading returns; [`Error::Usage`] if a column is missing.
pub(crate) fn each_cell(
    dir: &Path,
    manifest: &Manifest,
    outside: Outside,
    mut each: impl FnMut(CellRow),
) -> Result<()> {
    let mut table = Table::Cells.open(dir, manifest)?;
    let reach = Reach::new(&table, manifest)?;
    let [id, voxels, volume] = ["id", "voxels", "volume"].map(|name| find(&table, name));
    let (id, voxels, volume) = (id?, voxels?, volume?);
    while let Some(row) = table.next_row()? {
        each(CellRow {
            id: row.whole(id)?,
            voxels: row.whole(voxels)?,
            volume: row.number(volume)?.unwrap_or(0.0),
            at_border: row.number(reach.border)?.is_some_and(|v| v != 0.0),
            outside: outside == Outside::BorderCell && reach.is_outside(&row)?,
        });
    }
    Ok(())
}

/// The position of a column that a summary needs.
///
/// # Errors
/// [`Error::Usage`].
pub(super) fn find(table: &TableReader, name: &str) -> Result<usize> {
    table.column(name).ok_or_else(|| {
        Error::usage(
            "--summary",
            format!("a table without the column {name}"),
            "the table of cells or objects",
        )
    })
}

/// What is known of the air around the sample.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Air {
    /// Cells that count as such.
    pub cells: u64,
    /// Their voxels.
    pub voxels: f64,
    /// A cell that looks like it, whether it counts or not: it reaches all four sides and has most of all below
    /// voxels. With its share of those.
    pub likely: Option<(u64, f64)>,
    /// How many of [`Air::cells`] reach both ends along one axis alone, as a pore along an edge of the grid does, and
    /// the first of them.
    pub at_edges: u64,
    pub at_an_edge: Option<u64>,
}

impl Air {
    /// Reads the table of all cells of a grid with `below` voxels below the threshold.
    ///
    /// # Errors
    /// What reading returns.
    pub fn find(
        cells: &mut TableReader,
        manifest: &Manifest,
        outside: Outside,
        below: f64,
    ) -> Result<Self> {
        let reach = Reach::new(cells, manifest)?;
        let (id, voxels) = (find(cells, "id")?, find(cells, "voxels")?);
        let mut air = Air::default();
        while let Some(row) = cells.next_row()? {
            let of_row = row.number(voxels)?.unwrap_or(0.0);
            if outside == Outside::BorderCell && reach.is_outside(&row)? {
                air.cells += 1;
                air.voxels += of_row;
                if reach.lies_along_an_edge(&row)? {
                    air.at_edges += 1;
                    air.at_an_edge = air.at_an_edge.or(Some(row.whole(id)?));
                }
            }
            if 2.0 * of_row > below && reach.reaches_all_sides(&row)? {
                air.likely = Some((row.whole(id)?, of_row / below));
            }
        }
        Ok(air)
    }
}
