//! The cells of a tile set, as far as they are compared.

use super::matching::{Extent, Place};
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::manifest::Manifest;
use crate::table::{Query, Row, Table, TableReader};
use std::path::Path;

/// A cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    pub id: u64,
    pub place: Place,
    pub volume: f64,
    pub sphericity: Option<f64>,
    pub elongation: Option<f64>,
    pub flatness: Option<f64>,
    pub touches_border: bool,
    /// The condition holds for it.
    pub chosen: bool,
}

/// What a tile set has.
#[derive(Debug)]
pub struct Body {
    /// By rising id.
    pub cells: Vec<Cell>,
}

/// Where a row of cells or objects lies.
struct PlaceColumns {
    min: [usize; 3],
    max: [usize; 3],
    centroid: [usize; 3],
    /// Half a voxel along the axes of the world: tables have the centres of voxels.
    margin: [f64; 3],
}

impl PlaceColumns {
    /// Of a table in the unit of `placement`.
    fn of(table: &TableReader, placement: &Placement) -> Result<Self> {
        let find = |name: String| table.own_column(&name);
        let three = |start: &str| -> Result<[usize; 3]> {
            Ok([
                find(format!("{start}_x"))?,
                find(format!("{start}_y"))?,
                find(format!("{start}_z"))?,
            ])
        };
        let margin = std::array::from_fn(|world| {
            let along =
                (0..3).map(|a| (placement.directions[a][world] * placement.spacing[a]).abs());
            along.sum::<f64>() / 2.0
        });
        Ok(PlaceColumns {
            min: three("min")?,
            max: three("max")?,
            centroid: three("centroid")?,
            margin,
        })
    }

    fn place(&self, row: &Row) -> Result<Place> {
        let three = |columns: [usize; 3]| -> Result<[f64; 3]> {
            let mut values = [0.0; 3];
            for (value, column) in values.iter_mut().zip(columns) {
                *value = row.number(column)?.unwrap_or(f64::NAN);
            }
            Ok(values)
        };
        let (min, max) = (three(self.min)?, three(self.max)?);
        let extent = Extent {
            min: std::array::from_fn(|i| min[i] - self.margin[i]),
            max: std::array::from_fn(|i| max[i] + self.margin[i]),
        };
        Ok(Place {
            extent,
            centroid: three(self.centroid)?,
        })
    }
}

impl Body {
    /// Reads the cells with their lengths in a unit.
    pub fn read(
        dir: &Path,
        manifest: &Manifest,
        unit: Unit,
        condition: Option<&str>,
    ) -> Result<Body> {
        let placement = manifest.measured().in_unit(unit)?;
        let table = Table::Cells.open(dir, manifest)?;
        let mut table = table.in_unit(manifest.measured().unit, unit);
        let query = Query::default().filter(condition, table.columns())?;
        let places = PlaceColumns::of(&table, &placement)?;
        let find = |name: &str| table.own_column(name);
        let (id, voxels, border) = (find("id")?, find("voxels")?, find("touches_border")?);
        let (sphericity, elongation) = (find("sphericity")?, find("elongation")?);
        let flatness = find("flatness")?;
        // of the size of a voxel in this unit, as the tables of a set in it have them
        let voxel: f64 = placement.spacing.iter().product();
        let mut cells = Vec::new();
        while let Some(row) = table.next_row()? {
            cells.push(Cell {
                id: row.whole(id)?,
                place: places.place(&row)?,
                volume: row.whole(voxels)? as f64 * voxel,
                sphericity: row.number(sphericity)?,
                elongation: row.number(elongation)?,
                flatness: row.number(flatness)?,
                touches_border: row.whole(border)? != 0,
                chosen: query.keeps(&row)?,
            });
        }
        let of = Table::Cells.total(manifest);
        if cells.len() as u64 != of {
            let expected = format!("{of}, as index.json has it");
            return Err(Error::format(
                table.path(),
                format!("{} rows", cells.len()),
                expected,
            ));
        }
        Ok(Body { cells })
    }

    /// The number of chosen cells.
    pub fn chosen(&self) -> u64 {
        self.cells.iter().filter(|c| c.chosen).count() as u64
    }

    /// The number of those that touch the border.
    pub fn at_border(&self) -> u64 {
        let chosen = self.cells.iter().filter(|c| c.chosen && c.touches_border);
        chosen.count() as u64
    }

    /// The volume of chosen cells, of all or of whole ones.
    pub fn volume(&self, whole: bool) -> f64 {
        let chosen = self.cells.iter().filter(|c| c.chosen);
        let chosen = chosen.filter(|c| !whole || !c.touches_border);
        // an empty sum of floats is -0
        chosen.map(|c| c.volume).sum::<f64>() + 0.0
    }
}

/// The box around all objects of a tile set, with its lengths in a unit; `None` if there is no object.
pub fn around_objects(dir: &Path, manifest: &Manifest, unit: Unit) -> Result<Option<Extent>> {
    let placement = manifest.measured().in_unit(unit)?;
    let table = Table::Objects.open(dir, manifest)?;
    let mut table = table.in_unit(manifest.measured().unit, unit);
    let places = PlaceColumns::of(&table, &placement)?;
    let mut around: Option<Extent> = None;
    while let Some(row) = table.next_row()? {
        let extent = places.place(&row)?.extent;
        around = Some(around.map_or(extent, |a| a.around(extent)));
    }
    Ok(around)
}
