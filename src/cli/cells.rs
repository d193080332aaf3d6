//! `alvis cells`: the tables of a tile set, filtered, sorted and summed up.

use super::args::Common;
use super::necks::{self, Pairs};
use super::output::LongText;
use super::summary_text::Sums;
use super::{Outcome, output, summary_text};
use crate::error::{Error, Result};
use crate::manifest::Manifest;
use crate::progress::Progress;
use crate::structure::{self, Structure, Wanted};
use crate::table::{
    Chosen, Column, Outside, Query, Row, Table, TableReader, find_column, summarise,
    summarise_surfaces, warn_of_outside,
};
use crate::tileset::TileSet;
use crate::words::measure;
use clap::{Args, ValueEnum, ValueHint};
use serde_json::json;
use std::path::PathBuf;

/// Rows and columns of a table for people, unless they ask for others.
const ROWS: usize = 20;
const COLUMNS: [&str; 15] = [
    "id",
    "cell",
    "object",
    "triangles",
    "volume",
    "area",
    "equivalent_diameter",
    "sphericity",
    "form_factor",
    "touches_border",
    "tiles",
    "component",
    "neighbours",
    "necks",
    "wall_thickness",
];

/// What follows the options in the long help; a test holds that all columns are there.
const LONG_HELP: &str = "\
Examples:
  alvis cells OUT --where 'not touches_border' --sort -volume --top 10
  alvis cells OUT --where 'sphericity > 0.9 and volume > 0.01' --format csv
  alvis cells OUT --objects --largest 3
  alvis cells OUT --summary --outside border-cell

Columns of cells and objects; lengths are in the unit of the tables:
  id                    number by the first voxel, from 1 on
  voxels, volume        number of voxels; the same times the size of one
  mesh_volume           volume inside the triangles; none at the border
  area                  area of the triangles
  equivalent_diameter   diameter of the ball with this volume
  sphericity            area of the ball with this mesh volume / area: 1 is a ball
  form_factor           36 pi mesh_volume^2 / area^3: the cube of sphericity
  centroid_x, _y, _z    mean place of the voxels
  min_x, _y, _z         lower ends of the box of its voxels' centres
  max_x, _y, _z         upper ends of it
  axis_a, _b, _c        semi-axes of the ellipsoid with the same second moments
  elongation, flatness  axis_b / axis_a; axis_c / axis_b: 1 is round
  orientation_x, _y, _z direction of the longest axis
  euler_characteristic  1 for a ball, 0 for a ring, 2 for a hollow ball
  touches_border        it reaches the border of the grid and may go on outside
  tiles                 number of tiles that have triangles of it
Columns of surfaces (--surfaces):
  id, cell, object      its number, and what lies on its two sides
  triangles, vertices, area, euler_characteristic
  border_edges          edges at the border of the grid
  touches_border, tiles as above
More of cells that are parts of components (alvis convert --split or --labels):
  component             the connected part of the air that it is a part of: id in components.csv
  necks, largest_neck   cells that it is open to; radius of the widest opening
More of cells of sets made with alvis convert --walls:
  neighbours            cells that it has an opening or a wall to, very small and very thick walls left out
  wall_thickness        median thickness of its walls by area; walls.csv has each of them
Columns of openings (--necks):
  cell_a, cell_b        the two cells
  neck_radius           distance from the narrowest place on the widest way to the wall; with --split
  ratio                 that over the radius of the smaller cell, where they were cut from each other
  x, y, z               the narrowest place; with labels the middle of the faces that the cells share
  neck_area             area of the opening as seen along its mean direction: a flat one has all of it, a closed one,
                        of a cell around another, has 0
Columns of walls (--walls):
  cell_a, cell_b        the two cells
  wall_area             area of what lies between them
  wall_thickness        median of its thickness over its chords: lines of voxels from one cell to the other
  chords                how many these are
  thin                  most of them are shorter than 2 voxels: thinner than the scan shows
  neighbour             it makes the two neighbours: it is neither very small nor much thicker than their other walls";

/// Form of the rows, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormatArg {
    /// A few columns, the first 20 rows unless --top says otherwise
    Table,
    /// As in the tile set's CSV files
    Csv,
    /// One JSON object
    Json,
}

/// Which cells are air around the sample, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OutsideArg {
    /// Cells that reach four or more of the grid's six faces; a pore that the grid cuts reaches three at most, unless it is as long as the grid
    BorderCell,
    /// No cell
    None,
}

impl From<OutsideArg> for Outside {
    fn from(rule: OutsideArg) -> Self {
        match rule {
            OutsideArg::BorderCell => Outside::BorderCell,
            OutsideArg::None => Outside::None,
        }
    }
}

/// List the cells of a tile set, or sum them up
///
/// Conditions and keys are expressions over the columns: comparisons (< <= > >= == !=), and, or,
/// not, + - * / ^, parentheses, abs, sqrt, cbrt, exp, log, log10, min, max. touches_border is a
/// condition by itself. A comparison with a missing value is false; missing(column) asks for one.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis cells OUT --where 'not touches_border' --sort -volume --top 10\n  \
    alvis cells OUT --where 'sphericity > 0.9 and volume > 0.01' --format csv\n  \
    alvis cells OUT --summary --outside border-cell\n\n\
    What the columns mean: alvis cells --help")]
#[command(after_long_help = LONG_HELP)]
pub struct CellsArgs {
    /// The directory of the tile set
    #[arg(value_hint = ValueHint::DirPath)]
    out: PathBuf,
    /// List objects (connected above voxels) instead of cells
    #[arg(long, conflicts_with = "surfaces")]
    objects: bool,
    /// List surfaces (connected triangles) instead of cells
    #[arg(long)]
    surfaces: bool,
    /// List the openings between cells of one component: of sets made with --split or --labels
    #[arg(long, conflicts_with_all = ["objects", "surfaces", "largest", "summary"])]
    necks: bool,
    /// List the walls between cells: of sets made with --walls
    #[arg(long, conflicts_with_all = ["objects", "surfaces", "necks", "largest", "summary"])]
    walls: bool,
    /// Print how many cells other ratios of --split give
    #[arg(long, conflicts_with_all = ["objects", "surfaces", "necks", "walls", "largest", "summary", "condition", "sort", "top", "columns"])]
    split_curve: bool,
    /// Only rows for which this holds
    #[arg(long = "where", value_name = "EXPR", allow_hyphen_values = true)]
    condition: Option<String>,
    /// Only the N largest of these: by volume, of surfaces by area; the largest comes first unless --sort says otherwise
    #[arg(long, value_name = "N", value_parser = super::chosen::at_least_one)]
    largest: Option<usize>,
    /// Sort by a column or an expression, rising; -COLUMN falls. Missing values come last
    #[arg(long, value_name = "KEY", allow_hyphen_values = true)]
    sort: Option<String>,
    /// Sort the other way round
    #[arg(long, requires = "sort")]
    descending: bool,
    /// At most this many rows
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    top: Option<usize>,
    /// These columns only, with commas between them
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    columns: Vec<String>,
    /// Form of the rows [default: table, or json with --json]
    #[arg(long, value_name = "FORM", conflicts_with = "json")]
    format: Option<FormatArg>,
    /// Sum the rows up: porosity, distribution of diameters, sphericity
    ///
    /// Rows at the border of the grid, or of the region of interest, are cut by it and smaller than they are: they count in the numbers of rows and
    /// in porosity, but in no distribution. Number density and mean volume are corrected for them (Miles and Lantuejoul). Anisotropy is of the surface of all
    /// cells, for which the tiles are read; it is left out where rows are chosen.
    #[arg(long, conflicts_with_all = ["sort", "top", "columns"])]
    summary: bool,
    /// Which cells are air around the sample, not pores: left out of porosity and of the rows
    ///
    /// Pores that are open to that air are part of it. A pore network that runs through the whole grid reaches its
    /// faces, too: do not leave out that.
    ///
    /// Goes with --summary; none unless it is given.
    #[arg(long, value_name = "RULE")]
    outside: Option<OutsideArg>,
    #[command(flatten)]
    common: Common,
}

impl CellsArgs {
    pub fn run(self) -> Result<Outcome> {
        // not for clap to find: it lets --columns, which conflicts with --summary, do away with that
        if self.outside.is_some() && !self.summary {
            let expected = "it together with --summary";
            return Err(Error::usage("--outside", "it alone", expected));
        }
        if self.surfaces && self.outside.is_some() {
            let expected = "it for cells, or with --objects: surfaces have no volume";
            return Err(Error::usage("--outside", "it with --surfaces", expected));
        }
        if self.outside == Some(OutsideArg::BorderCell) && self.largest.is_some() {
            let expected = "one of the two: the largest cell may be what is outside";
            return Err(Error::usage("--largest", "it with --outside", expected));
        }
        let manifest = Manifest::open(&self.out)?;
        if self.split_curve {
            let warn = |text: &str| self.common.start().warn(text);
            return necks::print_curve(&self.out, &manifest, self.common.json, warn);
        }
        let which = self.table();
        let pairs = self.pairs();
        let mut table = match pairs {
            Some(pairs) => pairs.open(&self.out, &manifest)?,
            None => which.open(&self.out, &manifest)?,
        };
        let columns = table.columns().to_vec();
        let query = self.query(which, &table)?;
        let format = match self.format {
            _ if self.common.json => FormatArg::Json,
            Some(format) => format,
            None => FormatArg::Table,
        };
        if self.summary {
            self.print_summary(&query, &manifest, format)?;
            return Ok(Outcome::Done);
        }
        let shown = self.shown(&columns, format)?;
        if let Some(warning) = self.outside(which, &manifest)? {
            self.common.start().warn(&warning);
        }
        match format {
            FormatArg::Table => {
                let rows = self.top.unwrap_or(ROWS);
                if !print_table(&mut table, query, rows, &shown)? && rows > 0 {
                    let all = match pairs {
                        Some(pairs) => pairs.all(&manifest),
                        None => output::things(which.total(&manifest), which.singular()),
                    };
                    output::print(&format!("0 of {all}\n"))?;
                }
            }
            FormatArg::Csv => print_csv(&mut table, query.top(self.top), &shown)?,
            FormatArg::Json => {
                let name = pairs.map_or(which.name(), Pairs::name);
                print_rows(&mut table, query.top(self.top), &shown, name)?;
            }
        }
        Ok(Outcome::Done)
    }

    fn chosen(&self, which: Table) -> Chosen {
        Chosen {
            table: which,
            condition: self.condition.clone(),
            largest: self.largest,
        }
    }

    /// What the user should know of the largest rows, if these are asked for.
    fn outside(&self, which: Table, manifest: &Manifest) -> Result<Option<String>> {
        match self.largest {
            Some(_) => warn_of_outside(&self.out, manifest, &self.chosen(which), false),
            None => Ok(None),
        }
    }

    /// Which rows, and in which order.
    fn query(&self, which: Table, table: &TableReader) -> Result<Query> {
        let chosen = self.chosen(which);
        let (key, falls) = match (&self.sort, self.largest) {
            (None, Some(_)) => (Some(which.size()), true),
            (key, _) => (key.as_deref(), self.descending),
        };
        chosen.query(table)?.sort(key, falls, table.columns())
    }

    /// The pairs of cells that are listed instead of cells.
    fn pairs(&self) -> Option<Pairs> {
        match (self.necks, self.walls) {
            (true, _) => Some(Pairs::Necks),
            (_, true) => Some(Pairs::Walls),
            _ => None,
        }
    }

    fn table(&self) -> Table {
        Table::asked(self.objects, self.surfaces)
    }

    /// The positions of the columns to show.
    fn shown(&self, columns: &[Column], format: FormatArg) -> Result<Vec<usize>> {
        let find = |name: &str| columns.iter().position(|c| c.is_named(name));
        if self.columns.is_empty() {
            return Ok(match format {
                FormatArg::Table if self.pairs().is_none() => {
                    COLUMNS.into_iter().filter_map(find).collect()
                }
                _ => (0..columns.len()).collect(),
            });
        }
        let wanted = self.columns.iter();
        wanted
            .map(|name| find_column("--columns", name, columns))
            .collect()
    }

    /// The orientation of the surface, from the tiles. Tables alone have sums, too: tiles that cannot be read are no
    /// failure.
    fn structure(&self, outside: Outside, console: &dyn Progress) -> Result<Option<Structure>> {
        let wanted = Wanted {
            outside,
            ..Wanted::default()
        };
        let set = TileSet::open(&self.out)?;
        match structure::structure(&set, &wanted, console) {
            Err(Error::Interrupted) => Err(Error::Interrupted),
            Err(e) => {
                console.warn(&format!(
                    "there is no anisotropy, since the tiles cannot be read: {e}"
                ));
                Ok(None)
            }
            Ok(structure) => Ok(Some(structure)),
        }
    }

    fn print_summary(&self, query: &Query, manifest: &Manifest, format: FormatArg) -> Result<()> {
        if format == FormatArg::Csv {
            return Err(Error::usage(
                "--format",
                "csv with --summary",
                "table or json",
            ));
        }
        if self.surfaces {
            let summary = summarise_surfaces(&self.out, manifest, query)?;
            let console = self.common.start();
            summary.warnings.iter().for_each(|w| console.warn(w));
            drop(console);
            return match format {
                FormatArg::Json => output::print_json(&summary),
                _ => output::print(&summary_text::of_surfaces(&summary)),
            };
        }
        let outside = self.outside.map_or(Outside::None, Into::into);
        let summary = summarise(&self.out, manifest, self.table(), query, outside)?;
        let console = self.common.start();
        summary.warnings.iter().for_each(|w| console.warn(w));
        let structure = match self.chosen(self.table()) == Chosen::default() {
            true => self.structure(outside, &console)?,
            false => None,
        };
        drop(console);
        let sums = Sums {
            summary: &summary,
            surface_of: structure.as_ref().map(|s| s.surface_of),
            fabric: structure.as_ref().and_then(|s| s.fabric.as_ref()),
            mean_intercept_length: structure
                .as_ref()
                .and_then(|s| s.mean_intercept_length.as_ref()),
        };
        match format {
            FormatArg::Json => output::print_json(&sums),
            _ => output::print(&summary_text::text(&sums, self.table())),
        }
    }
}

/// Rows as CSV, as the tile set's own tables have them.
fn print_csv(table: &mut TableReader, query: Query, shown: &[usize]) -> Result<()> {
    let mut out = LongText::default();
    let header: Vec<String> = shown.iter().map(|&c| table.columns()[c].header()).collect();
    out.push(&(header.join(",") + "\n"))?;
    query.run(table, |row| {
        let fields: Vec<&str> = shown.iter().map(|&c| row.text(c)).collect::<Result<_>>()?;
        out.push(&(fields.join(",") + "\n"))
    })?;
    out.finish()
}

/// Rows as one JSON object, a line for each.
fn print_rows(table: &mut TableReader, query: Query, shown: &[usize], name: &str) -> Result<()> {
    let columns: Vec<Column> = shown.iter().map(|&c| table.columns()[c].clone()).collect();
    let mut out = LongText::default();
    out.push(&format!(
        "{{\"columns\": {},\n\"{}\": [",
        json!(columns),
        name
    ))?;
    let mut separator = "\n";
    query.run(table, |row| {
        out.push(separator)?;
        separator = ",\n";
        out.push(&object(row, &columns, shown)?)
    })?;
    out.push("\n]}\n")?;
    out.finish()
}

/// One row as a JSON object, in the order of the columns.
fn object(row: &Row, columns: &[Column], shown: &[usize]) -> Result<String> {
    let mut fields = Vec::with_capacity(shown.len());
    for (column, &c) in columns.iter().zip(shown) {
        fields.push(format!("{}: {}", json!(column.name), row.json(c)?));
    }
    Ok(format!("{{{}}}", fields.join(", ")))
}

/// A name on lines that end after `_`, or a single one, so that columns are not wider than their numbers.
fn title(name: &str) -> Vec<&str> {
    const WIDE: usize = 10;
    match name.len() > WIDE {
        true => name.split_inclusive('_').collect(),
        false => vec![name],
    }
}

/// The lines above a table: names, then units if there are any.
fn head(columns: &[Column], line: &dyn Fn(Vec<String>) -> String) -> String {
    let titles: Vec<Vec<&str>> = columns.iter().map(|c| title(&c.name)).collect();
    let lines = titles.iter().map(Vec::len).max().unwrap_or(0);
    let part =
        |title: &Vec<&str>, n: usize| title.get(n).map_or(String::new(), |t| (*t).to_owned());
    let mut text: String = (0..lines)
        .map(|n| line(titles.iter().map(|title| part(title, n)).collect()))
        .collect();
    let unit = |c: &Column| match c.unit.as_str() {
        "" => String::new(),
        unit => format!("[{unit}]"),
    };
    if columns.iter().any(|c| !c.unit.is_empty()) {
        text += &line(columns.iter().map(unit).collect());
    }
    text
}

/// Rows in columns that are as wide as their names and units, or as a number. Returns true if there are any.
fn print_table(
    table: &mut TableReader,
    query: Query,
    rows: usize,
    shown: &[usize],
) -> Result<bool> {
    const NUMBER: usize = 9;
    let columns: Vec<Column> = shown.iter().map(|&c| table.columns()[c].clone()).collect();
    let width = |c: &Column| {
        let title = title(&c.name).iter().map(|t| t.len()).max().unwrap_or(0);
        let least = match c.name.as_str() {
            "id" | "cell" | "object" => 7,
            "tiles" | "touches_border" => 5,
            _ => NUMBER,
        };
        least.max(title).max(c.unit.len() + 2)
    };
    let mut out = LongText::default();
    let line = |cells: Vec<String>| {
        let padded = columns.iter().zip(cells);
        let cells: Vec<String> = padded.map(|(c, t)| format!("{t:>0$}", width(c))).collect();
        format!("{}\n", cells.join(" ").trim_end())
    };
    let cell = |row: &Row, column: &Column, place: usize| {
        Ok(match row.number(place)? {
            None => "-".to_string(),
            Some(v) if column.is_condition() => (if v == 0.0 { "no" } else { "yes" }).into(),
            Some(v) => measure(v),
        })
    };
    // one row more tells that there are more
    let mut printed = 0;
    let mut more = false;
    query.top(rows.checked_add(1)).run(table, |row| {
        if printed == rows {
            more = true;
            return Ok(());
        }
        if printed == 0 {
            out.push(&head(&columns, &line))?;
        }
        printed += 1;
        let cells = columns.iter().zip(shown);
        let cells = cells.map(|(column, &place)| cell(row, column, place));
        out.push(&line(cells.collect::<Result<_>>()?))
    })?;
    if more {
        out.push("... (more with --top N; all with --format csv or json)\n")?;
    }
    out.finish()?;
    Ok(printed > 0)
}
