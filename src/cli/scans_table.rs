//! The table of several scans: what was done to each, and what came out.

use crate::error::{Error, Result};
use crate::grid::filters_text;
use crate::manifest::Manifest;
use crate::sys::atomic_file::NewFile;
use crate::table::{Outside, PorosityOf, Query, Table, summarise};
use crate::words::{measure, things};
use serde::Serialize;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Its name.
pub const FILE: &str = "scans.csv";

/// The columns in their order; each is a member of a [`Row`] as JSON.
const COLUMNS: [&str; 30] = [
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
    "surfaces",
    "porosity",
    "porosity_of",
    "table_unit",
    "equivalent_diameter_mean",
    "equivalent_diameter_median",
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
    surfaces: u64,
    porosity: Option<f64>,
    porosity_of: PorosityOf,
    table_unit: String,
    equivalent_diameter_mean: Option<f64>,
    equivalent_diameter_median: Option<f64>,
}

impl Facts {
    /// Those of the tile set in `out`, whose threshold was found so.
    pub fn of(out: &Path, threshold_method: String) -> Result<Self> {
        let m = Manifest::open(out)?;
        let query = Query::default();
        let sums = summarise(out, &m, Table::Cells, &query, Outside::None)?;
        let [spacing_x, spacing_y, spacing_z] = m.placement.spacing;
        let [dims_x, dims_y, dims_z] = m.grid.dims.0;
        let crop = m.source.crop.as_ref().map(|crop| {
            let axes = [&crop.x, &crop.y, &crop.z];
            axes.map(|a| format!("{}:{}", a.start, a.end)).join(",")
        });
        let diameter = sums.equivalent_diameter.as_ref();
        Ok(Facts {
            threshold_method,
            threshold: m.threshold,
            filters: filters_text(&m.filters),
            crop,
            roi: m.region.as_ref().map(ToString::to_string),
            ambiguous: m.ambiguous,
            cap: m.cap,
            min_voxels: m.dust.map_or(0, |dust| dust.min_voxels),
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
            surfaces: m.totals.surfaces,
            porosity: sums.porosity,
            porosity_of: sums.porosity_of,
            table_unit: m.measured().unit.to_string(),
            equivalent_diameter_mean: diameter.map(|d| d.mean),
            equivalent_diameter_median: diameter.map(|d| d.median),
        })
    }

    /// In a line.
    pub fn line(&self) -> String {
        let mut text = format!(
            "threshold {}, {}, {}",
            self.threshold,
            things(self.objects, "object"),
            things(self.cells, "cell")
        );
        if let Some(porosity) = self.porosity {
            text += &format!(", porosity {} %", measure(100.0 * porosity));
        }
        text
    }
}

/// Writes the table, whole or not at all, over one that is there.
///
/// # Errors
/// [`Error::Io`].
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let mut text = COLUMNS.join(",") + "\n";
    for row in rows {
        let row = serde_json::to_value(row).unwrap_or_default();
        let fields: Vec<String> = COLUMNS.iter().map(|name| field(&row[*name])).collect();
        text += &(fields.join(",") + "\n");
    }
    let failed = |e| Error::io(path, "write", e);
    let mut file = NewFile::create(path).map_err(failed)?;
    file.write_all(text.as_bytes()).map_err(failed)?;
    file.keep(true).map_err(failed)
}

/// A value as a field of CSV; numbers as the tables of tile sets have them.
fn field(value: &Value) -> String {
    let text = match value {
        Value::Null => String::new(),
        Value::Bool(is) => u8::from(*is).to_string(),
        Value::String(text) => text.clone(),
        Value::Number(n) if n.is_u64() => n.to_string(),
        other => other.as_f64().map_or_else(String::new, |v| v.to_string()),
    };
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn fields_are_quoted_where_they_have_to_be() {
        let texts = [json!("a,b"), json!("say \"x\""), json!("a b")].map(|v| field(&v));
        assert_eq!(texts, ["\"a,b\"", "\"say \"\"x\"\"\"", "a b"]);
        let numbers = [json!(3), json!(1.0), json!(1e-7), json!(null), json!(true)];
        assert_eq!(numbers.map(|v| field(&v)), ["3", "1", "0.0000001", "", "1"]);
    }
}
