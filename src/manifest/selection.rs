//! How a tile set was chosen from another one, and how it is painted.

use serde::{Deserialize, Serialize};

/// The picture of colours of a painted set.
pub(crate) const LEGEND: &str = "legend.png";
/// The same as a drawing, which the index does not name, and which sets may lack.
pub(crate) const LEGEND_SVG: &str = "legend.svg";

/// One of the tables of a tile set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Table {
    /// Cells: connected below voxels.
    #[default]
    Cells,
    /// Objects: connected above voxels.
    Objects,
    /// Surfaces: connected triangles.
    Surfaces,
}

impl Table {
    /// All, in this order.
    pub const ALL: [Table; 3] = [Table::Cells, Table::Objects, Table::Surfaces];

    /// `cells.csv`, `objects.csv` or `surfaces.csv`: its file in tile sets that this program writes.
    pub fn file(self) -> &'static str {
        match self {
            Table::Cells => "cells.csv",
            Table::Objects => "objects.csv",
            Table::Surfaces => "surfaces.csv",
        }
    }

    /// `cells.parquet`, `objects.parquet` or `surfaces.parquet`: the same as Parquet.
    pub fn parquet_file(self) -> &'static str {
        match self {
            Table::Cells => "cells.parquet",
            Table::Objects => "objects.parquet",
            Table::Surfaces => "surfaces.parquet",
        }
    }

    /// True for the table that an index does not name.
    fn is_cells(&self) -> bool {
        *self == Table::Cells
    }
}

/// Which rows of a table were kept.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Step {
    /// The condition; absent if all rows were taken.
    #[serde(rename = "where")]
    pub condition: Option<String>,
    /// True if the rows that the condition and `largest` choose were left out, not kept.
    pub omit: bool,
    /// The table that the condition is on; absent if it is that of cells.
    #[serde(default, skip_serializing_if = "Table::is_cells")]
    pub table: Table,
    /// Only so many rows were chosen of those for which the condition holds: the largest by volume, of surfaces by area.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest: Option<u64>,
}

impl Step {
    /// True unless all rows are kept.
    pub fn chooses(&self) -> bool {
        self.condition.is_some() || self.largest.is_some()
    }
}

/// What makes a tile set a part of another one, or a painted copy of it: the pieces of some cells, objects or surfaces.
///
/// Ids and measures are those of the whole, so ids have gaps, and the laws of whole surfaces that count
/// components do not hold. Surfaces are kept or left out as wholes, so edges still meet. Cells are there with all their
/// surfaces if cells were chosen, objects if objects were; of the others the tables have those that kept a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// The last choice; the colours are on its table.
    #[serde(flatten)]
    pub last: Step,
    /// What was chosen before that, in this order, where one choice cannot say it all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub before: Vec<Step>,
    /// Cells, objects or surfaces of one colour, later entries over earlier ones.
    pub painted: Vec<Paint>,
    /// Colours by the values of a column.
    pub colour_by: Option<ColourBy>,
    /// What the whole had.
    pub of: WholeTotals,
}

impl Selection {
    /// All choices in their order.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.before.iter().chain([&self.last])
    }
}

/// What is painted in one colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Paint {
    /// The condition, or `best:N` or `worst:N`.
    #[serde(rename = "where")]
    pub condition: String,
    /// `#rrggbb`, sRGB.
    pub colour: String,
    /// How many of those kept it holds for.
    #[serde(flatten)]
    pub count: Painted,
}

/// How many cells, objects or surfaces are painted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Painted {
    /// Cells.
    Cells(u64),
    /// Objects.
    Objects(u64),
    /// Surfaces.
    Surfaces(u64),
}

impl Painted {
    /// So many rows of a table.
    pub fn of(table: Table, count: u64) -> Painted {
        match table {
            Table::Cells => Painted::Cells(count),
            Table::Objects => Painted::Objects(count),
            Table::Surfaces => Painted::Surfaces(count),
        }
    }

    /// How many.
    pub fn count(self) -> u64 {
        match self {
            Painted::Cells(n) | Painted::Objects(n) | Painted::Surfaces(n) => n,
        }
    }
}

/// Colours by a value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ColourBy {
    /// The column, or an expression over columns.
    pub column: String,
    /// Its unit, or nothing.
    pub unit: String,
    /// Name of the colour map.
    pub map: String,
    /// Value of the map's first colour.
    pub min: f64,
    /// Value of the map's last colour.
    pub max: f64,
    /// Colours at equal steps from min to max: `#rrggbb`, sRGB.
    pub colours: Vec<String>,
    /// Path of a picture of the map with its values.
    pub legend: String,
}

impl ColourBy {
    /// The column with its unit.
    pub fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.column.clone(),
            unit => format!("{} [{unit}]", self.column),
        }
    }
}

/// Counts of the tile set that another was chosen from, or of the first one if that was chosen too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WholeTotals {
    /// Cells.
    pub cells: u64,
    /// Objects.
    pub objects: u64,
    /// Surfaces.
    pub surfaces: u64,
    /// Above voxels of the grid.
    pub voxels_above: u64,
}

impl WholeTotals {
    /// How many rows a table had.
    pub fn of(&self, table: Table) -> u64 {
        match table {
            Table::Cells => self.cells,
            Table::Objects => self.objects,
            Table::Surfaces => self.surfaces,
        }
    }
}
