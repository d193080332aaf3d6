//! The tables of a tile set: rows of cells, objects or surfaces, conditions on them, and what they
//! sum up to.
//!
//! # Expressions
//! A condition such as `volume > 0.5 and not touches_border` or a key such as `area / volume` is an
//! [`Expr`] over the columns of a table:
//!
//! | weakest first | |
//! |---|---|
//! | `or`, <code>&#124;&#124;</code> | either condition |
//! | `and`, `&&` | both conditions |
//! | `not`, `!` | the opposite |
//! | `<` `<=` `>` `>=` `==` (or `=`) `!=` | comparison of two numbers; they do not chain |
//! | `+` `-`, then `*` `/` | arithmetic, from left to right |
//! | `-x` | the negative |
//! | `x ^ y` | power, from right to left: `-2^2` is -4 |
//! | `( )`, `abs` `sqrt` `cbrt` `exp` `log` `log10` `min` `max` `missing` | |
//!
//! Words may be written in capitals. Names are columns, `true` and `false`; a column may be followed by its unit, as in
//! the head of a table: `volume [mm^3]`. `touches_border` is a condition by itself; `==` and `!=`
//! also compare conditions with each other and with 0 and 1. `log` is the natural logarithm; `min`
//! and `max` take two values or more.
//!
//! A value may be *missing*: the table has none (the mesh volume of an open cell), or the result is
//! not a finite number (`1 / 0`). Arithmetic with a missing value is missing, **every comparison with
//! a missing value is false** (`!=` too), and `missing(x)` asks for it. So `not (sphericity < 0.9)`
//! holds for a cell without a sphericity, and `sphericity >= 0.9` does not.

mod chosen;
mod column;
mod edge;
mod expr;
mod lex;
mod moments;
mod outside;
mod parquet;
mod parse;
mod query;
mod reader;
mod spread;
mod summary;
mod summary_surfaces;

pub use crate::manifest::Table;
pub use chosen::Chosen;
pub use column::{Column, find_column};
pub use edge::EdgeCorrection;
pub use expr::{Expr, Kind};
pub(crate) use outside::each_cell;
pub use outside::{Outside, warn_of_open, warn_of_outside};
pub(crate) use parquet::write_parquet;
pub use query::{Query, Selected};
pub use reader::{Row, TableReader};
pub use spread::{Distribution, Histogram, Spread};
pub use summary::{Border, Counts, PorosityOf, Summary, summarise};
pub use summary_surfaces::{SurfaceSummary, summarise_surfaces};

pub(crate) use spread::quantile;

use crate::error::Result;
use crate::manifest::{Manifest, file_inside};
use std::path::Path;

impl Table {
    /// The one that is asked for: cells, unless it is another.
    pub(crate) fn asked(objects: bool, surfaces: bool) -> Table {
        match (objects, surfaces) {
            (true, _) => Table::Objects,
            (_, true) => Table::Surfaces,
            _ => Table::Cells,
        }
    }

    /// `cells`, `objects` or `surfaces`.
    pub fn name(self) -> &'static str {
        match self {
            Table::Cells => "cells",
            Table::Objects => "objects",
            Table::Surfaces => "surfaces",
        }
    }

    /// `cell`, `object` or `surface`.
    pub fn singular(self) -> &'static str {
        match self {
            Table::Cells => "cell",
            Table::Objects => "object",
            Table::Surfaces => "surface",
        }
    }

    /// The column by which its rows are small or large.
    pub fn size(self) -> &'static str {
        match self {
            Table::Cells | Table::Objects => "volume",
            Table::Surfaces => "area",
        }
    }

    /// How many rows it has by the index.
    pub fn total(self, manifest: &Manifest) -> u64 {
        match self {
            Table::Cells => manifest.totals.cells,
            Table::Objects => manifest.totals.objects,
            Table::Surfaces => manifest.totals.surfaces,
        }
    }

    /// Opens the table of the tile set in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and [`crate::Error::Format`] if it is not a table.
    pub fn open(self, dir: &Path, manifest: &Manifest) -> Result<TableReader> {
        let tables = &manifest.tables;
        let path = match self {
            Table::Cells => &tables.cells,
            Table::Objects => &tables.objects,
            Table::Surfaces => &tables.surfaces,
        };
        TableReader::open(&file_inside(dir, path, "open the table")?)
    }
}
