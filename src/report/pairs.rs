//! Necks and walls between cells, where a set has tables of them.

use crate::error::Result;
use crate::table::{Histogram, Spread, TableReader};
use crate::tileset::TileSet;
use serde::Serialize;

/// The most necks that are listed.
const WIDEST: usize = 10;

/// Openings between cells.
#[derive(Debug, Clone, Serialize)]
pub struct Necks {
    /// How many.
    pub count: u64,
    /// Unit of radii.
    pub unit: String,
    /// How their radii are distributed; absent without any.
    pub neck_radius: Option<Spread>,
    /// By the radius of the smaller cell.
    pub ratio: Option<Spread>,
    /// The widest ones: the leaks.
    pub widest: Vec<Neck>,
}

/// One opening.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Neck {
    /// The two cells.
    pub cell_a: u64,
    #[allow(missing_docs)]
    pub cell_b: u64,
    /// Radius of the largest ball that passes.
    pub neck_radius: f64,
    /// The same by the radius of the smaller cell; absent where the cells were not cut from each other.
    pub ratio: Option<f64>,
    /// Where it is.
    pub at: [f64; 3],
}

/// Walls between cells: those that make neighbours.
#[derive(Debug, Clone, Serialize)]
pub struct Walls {
    /// How many.
    pub count: u64,
    /// Those of them that are thinner than the scan resolves.
    pub thin: u64,
    /// Pairs of cells whose wall is too small or too thick to make them neighbours; they count in nothing else.
    pub left_out: u64,
    /// Unit of thickness.
    pub unit: String,
    /// How thick they are, each counting by its area; absent without any.
    pub wall_thickness: Option<Spread>,
    /// Walls in equal bins of thickness, and their areas (as `volumes`).
    pub histogram: Option<Histogram>,
    /// Sum of their areas.
    pub wall_area: f64,
}

/// Opens a table of pairs of cells, if the set has it.
fn open(set: &TileSet, path: &Option<String>) -> Result<Option<TableReader>> {
    let Some(path) = path else {
        return Ok(None);
    };
    TableReader::open_keyed(&set.path(path)?, "cell_a").map(Some)
}

fn spread(mut values: Vec<f64>) -> Option<Spread> {
    values.sort_by(f64::total_cmp);
    Spread::of(&values)
}

/// What the table of necks sums up to; `None` without one. Openings of cells of labels have no radius, and count in number
/// alone. Takes 16 bytes for each.
///
/// # Errors
/// What reading returns.
pub fn necks(set: &TileSet) -> Result<Option<Necks>> {
    let Some(mut table) = open(set, &set.manifest().tables.necks)? else {
        return Ok(None);
    };
    let columns = ["cell_a", "cell_b", "neck_radius", "ratio", "x", "y", "z"];
    let columns: Vec<usize> = columns
        .iter()
        .map(|name| table.own_column(name))
        .collect::<Result<_>>()?;
    let unit = table.columns()[columns[2]].unit.clone();
    let (mut count, mut radii, mut ratios, mut widest) = (0, Vec::new(), Vec::new(), Vec::new());
    while let Some(row) = table.next_row()? {
        count += 1;
        let number = |i: usize| row.number(columns[i]);
        let (Some(neck_radius), Some(x), Some(y), Some(z)) =
            (number(2)?, number(4)?, number(5)?, number(6)?)
        else {
            continue;
        };
        let neck = Neck {
            cell_a: row.whole(columns[0])?,
            cell_b: row.whole(columns[1])?,
            neck_radius,
            ratio: number(3)?,
            at: [x, y, z],
        };
        radii.push(neck.neck_radius);
        ratios.extend(neck.ratio);
        widest.push(neck);
        if widest.len() > 4 * WIDEST {
            keep_widest(&mut widest);
        }
    }
    keep_widest(&mut widest);
    Ok(Some(Necks {
        count,
        unit,
        neck_radius: spread(radii),
        ratio: spread(ratios),
        widest,
    }))
}

fn keep_widest(necks: &mut Vec<Neck>) {
    necks.sort_by(|a, b| {
        let by_radius = b.neck_radius.total_cmp(&a.neck_radius);
        by_radius.then((a.cell_a, a.cell_b).cmp(&(b.cell_a, b.cell_b)))
    });
    necks.truncate(WIDEST);
}

/// What the table of walls sums up to; `None` without one. Takes 16 bytes for each.
///
/// # Errors
/// What reading returns.
pub fn walls(set: &TileSet) -> Result<Option<Walls>> {
    let Some(mut table) = open(set, &set.manifest().tables.walls)? else {
        return Ok(None);
    };
    let columns = ["wall_thickness", "wall_area", "thin", "neighbour"];
    let columns: Vec<usize> = columns
        .iter()
        .map(|name| table.own_column(name))
        .collect::<Result<_>>()?;
    let unit = table.columns()[columns[0]].unit.clone();
    let (mut thin, mut left_out) = (0, 0);
    let mut walls: Vec<(f64, f64)> = Vec::new();
    while let Some(row) = table.next_row()? {
        let number = |i: usize| Ok(row.number(columns[i])?.unwrap_or(0.0));
        if number(3)? == 0.0 {
            left_out += 1;
            continue;
        }
        thin += u64::from(number(2)? == 1.0);
        walls.push((number(0)?, number(1)?));
    }
    walls.sort_by(|a, b| a.0.total_cmp(&b.0));
    let by_area = Spread::weighted(&walls);
    Ok(Some(Walls {
        count: walls.len() as u64,
        thin,
        left_out,
        unit,
        histogram: by_area.map(|s| Histogram::of(&walls, [s.min, s.max])),
        wall_thickness: by_area,
        wall_area: walls.iter().map(|wall| wall.1).sum(),
    }))
}
