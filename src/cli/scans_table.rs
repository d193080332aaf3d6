//! The table of several scans: what was done to each, and what came out.

use crate::error::{Error, Result};
use crate::grid::filters_text;
use crate::manifest::{MANIFEST, Manifest, PartsBy};
use crate::sys::atomic_file::NewFile;
use crate::table::{Outside, PorosityOf, Query, Table, summarise};
use crate::words::{exact, measure, one_line, things};
use csv_core::ReadFieldResult;
use serde::Serialize;
use serde_json::Value;
use std::collections::HashSet;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Its name.
pub const FILE: &str = "scans.csv";

/// What stands before a text that a spreadsheet would take for a formula.
const GUARD: char = '\'';

/// The places of two columns.
const TILE_SET: usize = 1;
const STATUS: usize = 2;

/// The columns in their order; each is a member of a [`Row`] as JSON.
const COLUMNS: [&str; 38] = [
    "scan",
    "tile_set",
    "status",
    "error",
    "threshold_method",
    "threshold",
    "filters",
    "crop",
    "roi",
    "ambiguous",
    "cap",
    "min_voxels",
    "split",
    "split_h",
    "split_min_radius",
    "spacing_x",
    "spacing_y",
    "spacing_z",
    "unit",
    "dims_x",
    "dims_y",
    "dims_z",
    "tiles",
    "triangles",
    "objects",
    "cells",
    "cells_whole",
    "components",
    "necks",
    "walls",
    "surfaces",
    "porosity",
    "porosity_of",
    "table_unit",
    "equivalent_diameter_mean",
    "equivalent_diameter_median",
    "neighbours_mean",
    "wall_thickness_median",
];

/// What became of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Its tile set is whole.
    Done,
    /// It could not be converted.
    Failed,
    /// It was being converted when the user asked to stop.
    Stopped,
    /// It was not begun.
    Waiting,
}

impl Status {
    /// As the table has it.
    pub fn name(self) -> &'static str {
        match self {
            Status::Done => "done",
            Status::Failed => "failed",
            Status::Stopped => "stopped",
            Status::Waiting => "waiting",
        }
    }
}

/// A scan.
#[derive(Debug, Serialize)]
pub struct Row {
    /// The volume as it was typed.
    pub scan: String,
    /// The name of the directory of its tiles, which lies beside the table.
    pub tile_set: String,
    pub status: Status,
    /// Why it is not done.
    pub error: Option<String>,
    /// What is known of it once it is done.
    #[serde(flatten)]
    pub facts: Option<Facts>,
}

impl Row {
    /// A scan that was not begun.
    pub fn new(scan: String, name: &str) -> Self {
        Row {
            scan,
            tile_set: name.to_owned(),
            status: Status::Waiting,
            error: None,
            facts: None,
        }
    }

    /// The same once it is done.
    pub fn done(self, facts: Facts) -> Self {
        Row {
            status: Status::Done,
            facts: Some(facts),
            ..self
        }
    }
}

/// How cells are split at necks.
#[derive(Debug, Serialize)]
struct Rule {
    split: f64,
    /// In voxels of the finest axis, as the next one.
    split_h: f64,
    split_min_radius: f64,
}

impl Rule {
    fn of(parts: &PartsBy) -> Option<Self> {
        let PartsBy::Split {
            ratio_permille,
            h_256,
            min_radius_256,
            ..
        } = parts
        else {
            return None;
        };
        Some(Rule {
            split: f64::from(*ratio_permille) / 1000.0,
            split_h: f64::from(*h_256) / 256.0,
            split_min_radius: f64::from(*min_radius_256) / 256.0,
        })
    }
}

/// Settings and sums of a tile set. All of them are in it, so that one that was made before has the same.
#[derive(Debug, Serialize)]
pub struct Facts {
    threshold_method: String,
    threshold: f64,
    filters: String,
    crop: Option<String>,
    /// The region of interest, and what is outside of it.
    roi: Option<String>,
    ambiguous: crate::grid::Ambiguous,
    cap: bool,
    min_voxels: u64,
    /// The ratio of radii at which cells are split, and what else the rule says, if they are.
    #[serde(flatten)]
    rule: Option<Rule>,
    spacing_x: f64,
    spacing_y: f64,
    spacing_z: f64,
    unit: String,
    dims_x: u32,
    dims_y: u32,
    dims_z: u32,
    tiles: u64,
    triangles: u64,
    objects: u64,
    cells: u64,
    /// Those that the faces of the grid do not cut, of which the diameters are.
    cells_whole: u64,
    /// Those that cells are parts of, and the openings between cells, if cells are parts.
    components: Option<u64>,
    necks: Option<u64>,
    /// Pairs of cells with a wall between them, if these were looked for.
    walls: Option<u64>,
    surfaces: u64,
    porosity: Option<f64>,
    porosity_of: PorosityOf,
    table_unit: String,
    equivalent_diameter_mean: Option<f64>,
    equivalent_diameter_median: Option<f64>,
    /// Of whole cells, likewise.
    neighbours_mean: Option<f64>,
    wall_thickness_median: Option<f64>,
}

impl Facts {
    /// Those of the tile set in `out`, whose threshold was found so.
    pub fn of(out: &Path, threshold_method: String) -> Result<Self> {
        let m = Manifest::open(out)?;
        let query = Query::default();
        let sums = summarise(out, &m, Table::Cells, &query, Outside::None)?;
        let [spacing_x, spacing_y, spacing_z] = m.placement.spacing;
        let [dims_x, dims_y, dims_z] = m.grid.dims.0;
        let diameter = sums.equivalent_diameter.as_ref();
        Ok(Facts {
            threshold_method,
            threshold: m.threshold,
            filters: filters_text(&m.filters),
            crop: m.source.crop.as_ref().map(ToString::to_string),
            roi: m.region.as_ref().map(ToString::to_string),
            ambiguous: m.ambiguous,
            cap: m.cap,
            min_voxels: m.dust.map_or(0, |dust| dust.min_voxels),
            rule: m.cells.as_ref().and_then(Rule::of),
            spacing_x,
            spacing_y,
            spacing_z,
            unit: m.placement.unit.to_string(),
            dims_x,
            dims_y,
            dims_z,
            tiles: m.totals.tiles,
            triangles: m.totals.triangles,
            objects: m.totals.objects,
            cells: m.totals.cells,
            cells_whole: sums.count - sums.border.count,
            components: m.cells.as_ref().map(|_| m.totals.components),
            necks: m.cells.as_ref().map(|_| m.totals.necks),
            walls: m.tables.walls.as_ref().map(|_| m.totals.walls),
            surfaces: m.totals.surfaces,
            porosity: sums.porosity,
            porosity_of: sums.porosity_of,
            table_unit: m.measured().unit.to_string(),
            equivalent_diameter_mean: diameter.map(|d| d.mean),
            equivalent_diameter_median: diameter.map(|d| d.median),
            neighbours_mean: sums.neighbours.as_ref().map(|n| n.mean),
            wall_thickness_median: sums.wall_thickness.as_ref().map(|t| t.median),
        })
    }

    /// In a line.
    pub fn line(&self) -> String {
        let mut text = format!(
            "threshold {}, {}, {}",
            exact(self.threshold),
            things(self.objects, "object"),
            things(self.cells, "cell")
        );
        if let Some(porosity) = self.porosity {
            text += &format!(", porosity {} %", measure(100.0 * porosity));
        }
        text
    }
}

/// The table in a directory, of which rows are replaced one by one. Rows of other tile sets stay as they are.
#[derive(Debug)]
pub struct ScansTable {
    path: PathBuf,
    /// The fields of rows as the file has them, but for quotes.
    rows: Vec<Vec<String>>,
}

impl ScansTable {
    /// The one in a directory, or an empty one.
    ///
    /// # Errors
    /// [`Error::Format`] if the file of that name is no such table, unless it is to be replaced; [`Error::Io`].
    pub fn open(dir: &Path, force: bool) -> Result<Self> {
        let path = dir.join(FILE);
        let text = match std::fs::read(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
            Err(e) => return Err(Error::io(&path, "read", e)),
        };
        let mut rows = parsed(&text);
        let is_ours = |row: &Vec<String>| row.len() == COLUMNS.len();
        if !rows.is_empty() && rows[0] == COLUMNS && rows.iter().all(is_ours) {
            rows.remove(0);
        } else if force || text.is_empty() {
            rows.clear();
        } else {
            let expected = format!("a table of scans, with the columns {}", COLUMNS.join(","));
            let hint = "move it away, give --force to replace it, or another directory";
            return Err(Error::format(&path, "something else", expected).with_hint(hint));
        }
        Ok(ScansTable { path, rows })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn place(&self, tile_set: &str) -> Option<usize> {
        let name = guarded(tile_set);
        self.rows.iter().position(|row| row[TILE_SET] == name)
    }

    /// True if it says that a tile set is done.
    pub fn is_done(&self, tile_set: &str) -> bool {
        let row = self.place(tile_set).map(|at| &self.rows[at]);
        row.is_some_and(|row| row[STATUS] == Status::Done.name())
    }

    /// Puts a row in the place of that of the same tile set, or behind all others.
    pub fn put(&mut self, row: &Row) {
        let value = serde_json::to_value(row).unwrap_or_default();
        let fields = COLUMNS.iter().map(|name| text(&value[*name])).collect();
        match self.place(&row.tile_set) {
            Some(at) => self.rows[at] = fields,
            None => self.rows.push(fields),
        }
    }

    /// Drops the rows of tile sets that are said to be done and are not in the directory any more.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn drop_gone(&mut self) -> Result<()> {
        let dir = self.path.parent().unwrap_or(Path::new(""));
        let failed = |e| Error::io(dir, "read the directory", e);
        let mut there = HashSet::new();
        for entry in std::fs::read_dir(dir).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if entry.path().join(MANIFEST).exists() {
                // as it stands in a row, which does not tell the name itself
                there.insert(guarded(&entry.file_name().to_string_lossy()));
            }
        }
        let done = Status::Done.name();
        self.rows
            .retain(|row| row[STATUS] != done || there.contains(&row[TILE_SET]));
        Ok(())
    }

    /// Writes the table, whole or not at all, over one that is there.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self) -> Result<()> {
        let mut text = COLUMNS.join(",") + "\n";
        for row in &self.rows {
            let fields: Vec<String> = row.iter().map(|field| quoted(field)).collect();
            text += &(fields.join(",") + "\n");
        }
        let failed = |e| Error::io(&self.path, "write", e);
        let mut file = NewFile::create(&self.path).map_err(failed)?;
        file.write_all(text.as_bytes()).map_err(failed)?;
        file.keep(true).map_err(failed)
    }
}

/// The fields of the rows of CSV.
fn parsed(mut text: &[u8]) -> Vec<Vec<String>> {
    let mut reader = csv_core::Reader::new();
    let (mut rows, mut row, mut field) = (Vec::new(), Vec::new(), Vec::new());
    let mut part = [0; 1024];
    loop {
        // once all is read, an empty text tells the reader so
        let (result, read, written) = reader.read_field(text, &mut part);
        text = &text[read..];
        field.extend_from_slice(&part[..written]);
        match result {
            ReadFieldResult::InputEmpty | ReadFieldResult::OutputFull => {}
            ReadFieldResult::End => return rows,
            ReadFieldResult::Field { record_end } => {
                let whole = std::mem::take(&mut field);
                row.push(String::from_utf8_lossy(&whole).into_owned());
                if record_end {
                    rows.push(std::mem::take(&mut row));
                }
            }
        }
    }
}

/// A text that spreadsheets do not take for a formula: one that begins as one does gets an apostrophe before it, as does
/// one that begins with that. It is in one line.
fn guarded(text: &str) -> String {
    let text = one_line(text);
    match text.starts_with(['=', '+', '-', '@', GUARD]) {
        true => format!("{GUARD}{text}"),
        false => text,
    }
}

/// A value as a field without quotes; numbers as the tables of tile sets have them.
fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::Bool(is) => u8::from(*is).to_string(),
        Value::String(text) => guarded(text),
        Value::Number(n) if n.is_u64() => n.to_string(),
        other => other.as_f64().map_or_else(String::new, |v| v.to_string()),
    }
}

/// A field as CSV has it.
fn quoted(field: &str) -> String {
    match field.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", field.replace('"', "\"\"")),
        false => field.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    #[test]
    fn fields_are_quoted_where_they_have_to_be() {
        let texts = [json!("a,b"), json!("say \"x\""), json!("a b")].map(|v| quoted(&text(&v)));
        assert_eq!(texts, ["\"a,b\"", "\"say \"\"x\"\"\"", "a b"]);
        let numbers = [json!(3), json!(1.0), json!(-1e-7), json!(null), json!(true)];
        assert_eq!(numbers.map(|v| text(&v)), ["3", "1", "-0.0000001", "", "1"]);
        let formulas = ["=1+2", "-3", "@a", "'=b", "a=b", "a\nb"].map(guarded);
        assert_eq!(formulas, ["'=1+2", "'-3", "'@a", "''=b", "a=b", "a\\nb"]);
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(names in prop::collection::vec("[-a-c=,'\"\\n ]{0,9}", 1..6)) {
            let dir = tempfile::tempdir().unwrap();
            let mut table = ScansTable::open(dir.path(), false).unwrap();
            for name in &names {
                table.put(&Row::new(format!("{name}.raw"), name));
            }
            table.write().unwrap();
            let again = ScansTable::open(dir.path(), false).unwrap();
            prop_assert_eq!(&again.rows, &table.rows);
            for name in &names {
                prop_assert!(again.place(name).is_some());
            }
        }
    }
}
