//! The tables, row by row beside the rebuilt surface.

use super::carried;
use super::code::Code;
use super::files;
use super::ledger::{Group, Kind};
use super::piece::Sums;
use super::report::Issues;
use super::solids::{self, AREA, BORDER, MESH_VOLUME, Solids, TILES, Wrong, compare};
use crate::manifest::{Manifest, checksum_of};
use crate::tile::read::{MEASURES, Measured};
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

/// The columns of the table of surfaces, with the power of the unit of length that each has.
const SURFACE: [(&str, u32); 10] = [
    ("id", 0),
    ("cell", 0),
    ("object", 0),
    ("triangles", 0),
    ("vertices", 0),
    ("area", 2),
    ("euler_characteristic", 0),
    ("border_edges", 0),
    ("touches_border", 0),
    ("tiles", 0),
];

/// The columns of a table.
fn columns(kind: Kind) -> &'static [(&'static str, u32)] {
    match kind {
        Kind::Surface => &SURFACE,
        _ => &solids::COLUMNS,
    }
}

/// A column's name with its unit, as a header has it.
fn title(&(name, power): &(&str, u32), unit: &str) -> String {
    match power {
        0 => name.to_owned(),
        1 => format!("{name} [{unit}]"),
        p => format!("{name} [{unit}^{p}]"),
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
    /// Unit of length.
    unit: &'static str,
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
        if let Some(all) = &manifest.tables.checksums {
            let stated = match kind {
                Kind::Surface => &all.surfaces,
                Kind::Cell => &all.cells,
                Kind::Object => &all.objects,
            };
            if let Ok(found) = files::open(&real).and_then(checksum_of)
                && found != *stated
            {
                let message = format!("found {found}, expected {stated} as in index.json#/tables");
                issues.add(Code::Checksum, path, message);
            }
        }
        let file = match files::open(&real) {
            Ok(file) => file,
            Err(e) => {
                issues.add(Code::MissingFile, path, format!("cannot be read: {e}"));
                return None;
            }
        };
        let measured = manifest.measured();
        let spacing = measured.spacing;
        let voxel: f64 = spacing.iter().product();
        let thinnest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let mut table = Table {
            kind,
            path: path.clone(),
            lines: BufReader::new(file),
            places: Vec::new(),
            line: 0,
            unit: measured.unit.name(),
            sixth: voxel / 6.0 / f64::from(1 << 24),
            partial: kind == Kind::Object && manifest.is_part(),
            triangle_error: voxel / thinnest * TRIANGLE_ERROR,
            done: false,
        };
        let header = table.next_line(issues)?;
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        for wanted in columns(kind) {
            let wanted = title(wanted, table.unit);
            match names.iter().position(|n| *n == wanted) {
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
    pub fn check(&mut self, group: &Group, solids: &mut Solids, issues: &mut Issues) {
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
        for (&place, (name, _)) in self.places.iter().zip(columns(self.kind)) {
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
        let path = format!("{}:{}", self.path, self.line);
        match self.kind {
            Kind::Surface => self.surface(&row.values, group, &mut wrong),
            kind => {
                self.region(&row.values, group, kind, &mut wrong);
                solids.check((kind, &row.values, &path), group, self.partial, &mut wrong);
            }
        }
        if self.kind == Kind::Cell && group.parts > 0 {
            self.carried(&row.values, group, issues);
        }
        if !wrong.is_empty() {
            let message = format!("{} {}: {}", self.kind.name(), group.id, wrong.join("; "));
            issues.add(Code::TableValue, path, message);
        }
    }

    /// Compares a row with what the tiles carry on the cell's pieces.
    fn carried(&self, row: &solids::Row, group: &Group, issues: &mut Issues) {
        let mut stated = Measured {
            unit: Some(self.unit),
            ..Measured::default()
        };
        for (value, name) in stated.values.iter_mut().zip(MEASURES) {
            let at = solids::COLUMNS.iter().position(|c| c.0 == name);
            *value = at.and_then(|at| row[at]).unwrap_or(f64::NAN);
        }
        let found = &group.total;
        if found.mixed || found.measures != carried::hash(&stated) {
            let message = if found.mixed {
                format!(
                    "the measures on pieces of cell {} differ from piece to piece",
                    group.id
                )
            } else {
                format!(
                    "the measures on pieces of cell {} are not those of {}:{}",
                    group.id, self.path, self.line
                )
            };
            issues.add(Code::CarriedMeasure, "tiles", message);
        }
    }

    /// A row of cells or objects.
    fn region(&self, row: &solids::Row, group: &Group, kind: Kind, wrong: &mut Wrong) {
        let [area, volume, border, tiles] = [AREA, MESH_VOLUME, BORDER, TILES].map(|i| row[i]);
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
    fn surface(&self, row: &solids::Row, group: &Group, wrong: &mut Wrong) {
        let sums = &group.total.sums;
        let ids = group.total.ids;
        let euler = solids::euler_of(sums) as f64;
        let found = [
            ("cell", ids.cell as f64, 0.0),
            ("object", ids.object as f64, 0.0),
            ("triangles", sums.triangles as f64, 0.0),
            ("vertices", sums.vertices as f64, 0.0),
            ("area", sums.area, self.area_error(sums)),
            ("euler_characteristic", euler, 0.0),
            ("border_edges", sums.border as f64, 0.0),
            ("touches_border", f64::from(u8::from(sums.border > 0)), 0.0),
            ("tiles", group.total.tiles as f64, 0.0),
        ];
        for ((name, value, error), stated) in found.into_iter().zip(&row[1..]) {
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

/// The fields of a row, in the order of [`columns`]; an empty one is `None`, true is 1.
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
