//! The tables, row by row beside the rebuilt surface.

use super::code::Code;
use super::files;
use super::ledger::{Group, Kind};
use super::piece::Sums;
use super::report::Issues;
use crate::manifest::Manifest;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The longest line that is read.
const MAX_LINE: u64 = 1 << 16;
/// Relative error that areas, sums of square roots in any order, may have.
const AREA_ERROR: f64 = 1e-6;
/// Error that each triangle may add to an area, in voxel faces (of the largest face, with anisotropic
/// spacing): twice its area is rounded to 1/65,536 of a squared lattice step.
const TRIANGLE_ERROR: f64 = 1.0 / (4.0 * 65_536.0 * 65_536.0);
/// Relative error that volumes, exact up to their decimal form, may have.
const VOLUME_ERROR: f64 = 1e-9;

/// The columns that are compared, by kind of table.
fn columns(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Surface => &[
            "id",
            "cell",
            "object",
            "triangles",
            "vertices",
            "area",
            "euler_characteristic",
            "touches_border",
        ],
        _ => &["id", "area", "mesh_volume", "touches_border", "tiles"],
    }
}

/// A table that is being read.
pub(super) struct Table {
    kind: Kind,
    path: String,
    lines: BufReader<File>,
    /// Where in a row each of [`columns`] stands.
    places: Vec<usize>,
    line: u64,
    /// Physical volume of a lattice cell, over 6.
    sixth: f64,
    /// True for objects of a part: they may have lost surfaces, their measures are those of the whole.
    partial: bool,
    /// [`TRIANGLE_ERROR`] in physical units.
    triangle_error: f64,
    done: bool,
}

impl Table {
    /// Opens the table of a kind and reads its header. `None` if it is missing or has none.
    pub fn open(root: &Path, manifest: &Manifest, kind: Kind, issues: &mut Issues) -> Option<Self> {
        let path = match kind {
            Kind::Surface => &manifest.tables.surfaces,
            Kind::Cell => &manifest.tables.cells,
            Kind::Object => &manifest.tables.objects,
        };
        let at = format!("index.json#/tables/{}", kind.plural());
        let real = files::resolve(root, path, &at, issues)?;
        let file = match File::open(&real) {
            Ok(file) => file,
            Err(e) => {
                issues.add(Code::MissingFile, path, format!("cannot be read: {e}"));
                return None;
            }
        };
        let spacing = manifest.placement.spacing;
        let voxel: f64 = spacing.iter().product();
        let thinnest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let mut table = Table {
            kind,
            path: path.clone(),
            lines: BufReader::new(file),
            places: Vec::new(),
            line: 0,
            sixth: voxel / 6.0 / f64::from(1 << 24),
            partial: kind == Kind::Object && manifest.is_part(),
            triangle_error: voxel / thinnest * TRIANGLE_ERROR,
            done: false,
        };
        let header = table.next_line(issues)?;
        let names: Vec<&str> = header
            .split(',')
            .map(|f| f.split_once(" [").map_or(f, |(name, _)| name).trim())
            .collect();
        for wanted in columns(kind) {
            match names.iter().position(|n| n == wanted) {
                Some(place) => table.places.push(place),
                None => {
                    let message =
                        format!("found the header {header:?}, expected a column {wanted}");
                    issues.add(Code::TableSyntax, path, message);
                    return None;
                }
            }
        }
        Some(table)
    }

    fn next_line(&mut self, issues: &mut Issues) -> Option<String> {
        let mut text = String::new();
        self.line += 1;
        let mut limited = (&mut self.lines).take(MAX_LINE);
        match limited.read_line(&mut text) {
            Ok(0) => {
                self.done = true;
                if self.line == 1 {
                    issues.add(
                        Code::TableSyntax,
                        &self.path,
                        "found an empty file, expected a header",
                    );
                }
                return None;
            }
            Ok(n) if (n as u64) < MAX_LINE => {}
            Ok(_) => return self.stop("found a line of more than 64 KiB", issues),
            Err(e) => return self.stop(&e.to_string(), issues),
        }
        text.truncate(text.trim_end_matches(['\n', '\r']).len());
        Some(text)
    }

    /// Gives up on the table.
    fn stop<T>(&mut self, message: &str, issues: &mut Issues) -> Option<T> {
        let path = format!("{}:{}", self.path, self.line);
        issues.add(Code::TableSyntax, path, message);
        self.done = true;
        None
    }

    /// Compares the next row with the surfaces of the next id.
    pub fn check(&mut self, group: &Group, issues: &mut Issues) {
        if self.done {
            return;
        }
        let Some(line) = self.next_line(issues) else {
            if self.done && self.line > 0 {
                let message = format!("found no row for {} {}", self.kind.name(), group.id);
                issues.add(Code::TableRows, &self.path, message);
            }
            return;
        };
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let mut row = Row {
            values: Vec::new(),
            bad: None,
        };
        for (&place, name) in self.places.iter().zip(columns(self.kind)) {
            row.take(fields.get(place).copied(), name);
        }
        if let Some(message) = row.bad {
            self.stop::<()>(&message, issues);
            return;
        }
        if row.values[0] != Some(group.id as f64) {
            let path = format!("{}:{}", self.path, self.line);
            let message = format!(
                "found id {}, expected {} {}: a row for each, by rising id",
                row.values[0].unwrap_or(f64::NAN),
                self.kind.name(),
                group.id
            );
            issues.add(Code::TableRows, path, message);
            self.done = true;
            return;
        }
        let mut wrong = Vec::new();
        match self.kind {
            Kind::Surface => self.surface(&row, group, &mut wrong),
            kind => self.region(&row, group, kind, &mut wrong),
        }
        if !wrong.is_empty() {
            let path = format!("{}:{}", self.path, self.line);
            let message = format!("{} {}: {}", self.kind.name(), group.id, wrong.join("; "));
            issues.add(Code::TableValue, path, message);
        }
    }

    /// A row of cells or objects.
    fn region(&self, row: &Row, group: &Group, kind: Kind, wrong: &mut Vec<String>) {
        let [_, area, volume, border, tiles] = row.values[..] else {
            return;
        };
        let total = &group.total;
        let open = border == Some(1.0);
        if !open && total.sums.border > 0 {
            wrong.push("touches_border is false, its surface meets the volume's faces".to_owned());
        }
        if self.partial {
            return;
        }
        // the area of an open one may be left out as meaningless
        if !(open && area.is_none()) {
            let error = self.area_error(&total.sums);
            compare("area", area, total.sums.area, error, wrong);
        }
        let sign = if kind == Kind::Cell { -1.0 } else { 1.0 };
        let found = sign * total.sums.volume6 as f64 * self.sixth;
        match (open, volume) {
            (true, Some(v)) => wrong.push(format!("mesh_volume {v}, expected none: it is open")),
            (true, None) => {}
            (false, _) => {
                let error = VOLUME_ERROR * found.abs();
                compare("mesh_volume", volume, found, error, wrong);
            }
        }
        let own = if kind == Kind::Cell {
            total.cell_tiles
        } else {
            total.object_tiles
        };
        compare("tiles", tiles, own as f64, 0.0, wrong);
    }

    fn area_error(&self, sums: &Sums) -> f64 {
        AREA_ERROR * sums.area + self.triangle_error * sums.triangles as f64
    }

    /// A row of surfaces.
    fn surface(&self, row: &Row, group: &Group, wrong: &mut Vec<String>) {
        let sums = &group.total.sums;
        let ids = group.total.ids;
        let euler =
            sums.vertices as f64 - (sums.edges + sums.border) as f64 + sums.triangles as f64;
        let found = [
            ("cell", ids.cell as f64, 0.0),
            ("object", ids.object as f64, 0.0),
            ("triangles", sums.triangles as f64, 0.0),
            ("vertices", sums.vertices as f64, 0.0),
            ("area", sums.area, self.area_error(sums)),
            ("euler_characteristic", euler, 0.0),
            ("touches_border", f64::from(u8::from(sums.border > 0)), 0.0),
        ];
        for ((name, value, error), stated) in found.into_iter().zip(&row.values[1..]) {
            compare(name, *stated, value, error, wrong);
        }
    }

    /// Expects the end of the table, after `rows` more rows without a surface.
    pub fn finish(&mut self, rows: u64, issues: &mut Issues) {
        let mut found = 0u64;
        while !self.done {
            match self.next_line(issues) {
                Some(line) if !line.trim().is_empty() => found += 1,
                _ => {}
            }
        }
        if found != rows {
            let message = format!("found {found} rows after those with a surface, expected {rows}");
            issues.add(Code::TableRows, &self.path, message);
        }
    }
}

fn compare(name: &str, stated: Option<f64>, found: f64, error: f64, wrong: &mut Vec<String>) {
    let close = |s: f64| (s - found).abs() <= error;
    if !stated.is_some_and(close) {
        let stated = stated.map_or("nothing".to_owned(), |s| s.to_string());
        wrong.push(format!("{name} {stated}, the surface has {found}"));
    }
}

/// The compared fields of a row; an empty one is `None`, true is 1.
struct Row {
    values: Vec<Option<f64>>,
    bad: Option<String>,
}

impl Row {
    fn take(&mut self, field: Option<&str>, name: &str) {
        let value = match field {
            Some("") => None,
            Some("true") => Some(1.0),
            Some("false") => Some(0.0),
            Some(text) => match text.parse::<f64>() {
                Ok(v) if v.is_finite() => Some(v),
                _ => {
                    self.bad = Some(format!("{name}: found {text:?}, expected a number"));
                    None
                }
            },
            None => {
                self.bad = Some(format!("found no field for {name}"));
                None
            }
        };
        self.values.push(value);
    }
}
