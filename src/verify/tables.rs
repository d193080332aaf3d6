//! The tables, compared row by row with the rebuilt surface.

use super::bodies::{Body, euler_of};
use super::code::Code;
use super::components::{
    self, AREA, BORDER, ComponentRows, MESH_VOLUME, TILES, VOXELS, Wrong, compare,
};
use super::extras;
use super::files;
use super::laws::may_be_cut;
use super::ledger::{Group, Kind};
use super::piece::Sums;
use super::report::Issues;
use super::tile::Context;
use crate::manifest::{Manifest, TableChecksums, checksum_of};
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
/// Relative error of areas by the rounding of sums alone.
const ROUNDING: f64 = 1e-11;
/// Half the area of the largest face of a box of one lattice step, below which no surface is, in [`TRIANGLE_ERROR`]s.
const LEAST_SURFACE: f64 = 0.5 / 65_536.0 / TRIANGLE_ERROR;
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

/// The columns of the table of cells behind those of components, where cells are parts of these.
const PART: [(&str, u32); 3] = [("component", 0), ("necks", 0), ("largest_neck", 1)];

/// The columns of the table of necks.
const NECK: [(&str, u32); 8] = [
    ("cell_a", 0),
    ("cell_b", 0),
    ("neck_radius", 1),
    ("ratio", 0),
    ("x", 1),
    ("y", 1),
    ("z", 1),
    ("neck_area", 2),
];

/// The columns of a table, of a set whose cells are the components, or with `parts` are parts of them.
pub(super) fn columns(kind: Kind, parts: bool) -> Vec<(&'static str, u32)> {
    let mut columns = match kind {
        Kind::Surface => SURFACE.to_vec(),
        Kind::Neck => NECK.to_vec(),
        _ => components::COLUMNS.to_vec(),
    };
    match kind {
        Kind::Cell if parts => columns.extend(PART),
        _ => {}
    }
    columns
}

/// A column's name with its unit, as a header has it.
fn title(&(name, power): &(&str, u32), unit: &str) -> String {
    match power {
        0 => name.to_owned(),
        1 => format!("{name} [{unit}]"),
        p => format!("{name} [{unit}^{p}]"),
    }
}

/// The files of the tables in one format, as the index names them, by their kinds.
pub(super) struct Files<'m> {
    paths: [Option<&'m str>; KINDS],
    checksums: Option<[Option<&'m str>; KINDS]>,
    /// Where the index has them.
    at: &'static str,
    /// What their names end with.
    ending: &'static str,
}

/// How many kinds of tables there are.
const KINDS: usize = 5;

impl<'m> Files<'m> {
    /// In CSV.
    pub fn csv(manifest: &'m Manifest) -> Self {
        let tables = &manifest.tables;
        Files {
            paths: [
                Some(&tables.surfaces),
                Some(&tables.cells),
                Some(&tables.objects),
                tables.components.as_deref(),
                tables.necks.as_deref(),
            ],
            checksums: tables.checksums.as_ref().map(in_order),
            at: "index.json#/tables",
            ending: "csv",
        }
    }

    /// In Parquet, if there are such.
    pub fn parquet(manifest: &'m Manifest) -> Option<Self> {
        let tables = manifest.tables.parquet.as_ref()?;
        Some(Files {
            paths: [
                Some(&tables.surfaces),
                Some(&tables.cells),
                Some(&tables.objects),
                None,
                None,
            ],
            checksums: tables.checksums.as_ref().map(in_order),
            at: "index.json#/tables/parquet",
            ending: "parquet",
        })
    }

    /// Opens that of a kind, whose checksum is compared: its path, the file, and whether the checksum is right. `None` if
    /// it is missing or has another name, or the set has none of that kind.
    pub fn open(
        &self,
        root: &Path,
        kind: Kind,
        issues: &mut Issues,
    ) -> Option<(&'m str, File, bool)> {
        let path = self.paths[kind as usize]?;
        let at = format!("{}/{}", self.at, kind.plural());
        let real = files::resolve(root, path, &at, issues)?;
        let named = format!("{}.{}", kind.plural(), self.ending);
        if path != named {
            let message = format!("found {path}, expected {named}");
            issues.add(Code::PathName, at, message);
            return None;
        }
        let mut is_right = true;
        if let Some(stated) = self.checksums.and_then(|all| all[kind as usize])
            && let Ok(found) = files::open(&real).and_then(checksum_of)
            && found != stated
        {
            let message = format!("found {found}, expected {stated} as in index.json#/tables");
            issues.add(Code::Checksum, path, message);
            is_right = false;
        }
        match files::open(&real) {
            Ok(file) => Some((path, file, is_right)),
            Err(e) => {
                issues.add(Code::MissingFile, path, format!("cannot be read: {e}"));
                None
            }
        }
    }
}

fn in_order(all: &TableChecksums) -> [Option<&str>; KINDS] {
    [
        Some(&all.surfaces),
        Some(&all.cells),
        Some(&all.objects),
        all.components.as_deref(),
        all.necks.as_deref(),
    ]
}

/// The lines of a table, one after the other.
pub(super) struct Lines {
    pub path: String,
    input: BufReader<File>,
    /// Number of the last one.
    pub line: u64,
    columns: Vec<(&'static str, u32)>,
    /// There is no line that can be read.
    pub done: bool,
    /// That is so since something was wrong.
    pub damaged: bool,
}

impl Lines {
    /// Opens the table of a kind and reads its header. `None` if it is missing or has none.
    pub fn open(cx: &Context, kind: Kind, issues: &mut Issues) -> Option<Self> {
        let manifest = cx.manifest;
        let (path, file, _) = Files::csv(manifest).open(cx.root, kind, issues)?;
        let unit = manifest.measured().unit.name();
        let mut lines = Lines {
            path: path.to_owned(),
            input: BufReader::new(file),
            line: 0,
            columns: columns(kind, manifest.cells.is_some()),
            done: false,
            damaged: false,
        };
        let header = lines.next_line(issues)?;
        let titles: Vec<String> = lines.columns.iter().map(|c| title(c, unit)).collect();
        let expected = titles.join(",");
        if header == expected {
            return Some(lines);
        }
        let message = format!("found the header {header:?}, expected {expected:?}");
        issues.add(Code::TableSyntax, path, message);
        None
    }

    fn next_line(&mut self, issues: &mut Issues) -> Option<String> {
        let mut text = String::new();
        self.line += 1;
        let mut limited = (&mut self.input).take(MAX_LINE);
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
        if text.pop() != Some('\n') {
            return self.stop(
                "found the end of the file, expected that of the line",
                issues,
            );
        }
        Some(text)
    }

    /// Gives up on the table.
    fn stop<T>(&mut self, message: &str, issues: &mut Issues) -> Option<T> {
        issues.add(Code::TableSyntax, self.place(), message);
        self.give_up();
        None
    }

    /// Reads no more: the rest says nothing.
    pub fn give_up(&mut self) {
        self.done = true;
        self.damaged = true;
    }

    /// Where the last line is, for messages.
    pub fn place(&self) -> String {
        format!("{}:{}", self.path, self.line)
    }

    /// The fields of the next line; `None` at the end, or if it is damaged, which is an issue.
    pub fn next_row(&mut self, issues: &mut Issues) -> Option<Vec<Option<f64>>> {
        if self.done {
            return None;
        }
        let line = self.next_line(issues)?;
        let row = Row::read(&line, &self.columns);
        match row.bad {
            Some(message) => self.stop(&message, issues),
            None => Some(row.values),
        }
    }
}

/// A table that is being read.
pub(super) struct Table {
    kind: Kind,
    pub lines: Lines,
    /// Unit of length.
    unit: &'static str,
    exact: Exactness,
    /// True for bodies of a selected subset that may lack surfaces: their measures are those of the whole set.
    of_subset: bool,
    /// Any row may be one that the edge of a mask cuts.
    edge_unknown: bool,
    /// Cells are parts of components.
    of_parts: bool,
}

impl Table {
    /// As of [`Lines::open`].
    pub fn open(cx: &Context, kind: Kind, issues: &mut Issues) -> Option<Self> {
        let manifest = cx.manifest;
        Some(Table {
            kind,
            lines: Lines::open(cx, kind, issues)?,
            unit: manifest.measured().unit.name(),
            exact: Exactness::of(manifest),
            of_subset: may_be_cut(manifest, kind),
            edge_unknown: cx.edge.is_unknown(),
            of_parts: manifest.cells.is_some(),
        })
    }

    /// Compares the next row with the surfaces of the next id, and the body that they bound, if they do. Returns the
    /// row if it is of that id.
    pub fn check(
        &mut self,
        group: &Group,
        body: Option<&Body>,
        components: &mut ComponentRows,
        issues: &mut Issues,
    ) -> Option<Vec<Option<f64>>> {
        if self.lines.done {
            return None;
        }
        let Some(line) = self.lines.next_line(issues) else {
            if self.lines.done && self.lines.line > 0 {
                let message = format!("found no row for {} {}", self.kind.name(), group.id);
                issues.add(Code::TableRows, &self.lines.path, message);
            }
            return None;
        };
        let row = Row::read(&line, &self.lines.columns);
        if let Some(message) = row.bad {
            return self.lines.stop(&message, issues);
        }
        if row.values[0] != Some(group.id as f64) {
            let path = self.lines.place();
            let message = format!(
                "found id {}, expected {} {}: a row for each, by rising id",
                row.values[0].unwrap_or(f64::NAN),
                self.kind.name(),
                group.id
            );
            issues.add(Code::TableRows, path, message);
            self.lines.done = true;
            return None;
        }
        let mut wrong = Vec::new();
        match self.kind {
            Kind::Surface => self.surface(&row.values, group, &mut wrong),
            kind => {
                components.check_row(kind, &row.values, &mut wrong);
                self.component(&row.values, group, body, components, &mut wrong);
            }
        }
        if self.kind == Kind::Cell && group.parts > 0 {
            self.check_extras(&row.values, group, issues);
        }
        if !wrong.is_empty() {
            let message = format!("{} {}: {}", self.kind.name(), group.id, wrong.join("; "));
            issues.add(Code::TableValue, self.lines.place(), message);
        }
        Some(row.values)
    }

    /// Compares a row with the measures in the extras of the cell's pieces.
    fn check_extras(&self, row: &components::Row, group: &Group, issues: &mut Issues) {
        let found = &group.total;
        let carried = (!found.mixed).then_some(found.measures);
        let place = self.lines.place();
        check_carried(row, carried, self.unit, group.id, &place, issues);
    }

    /// Compares a row of cells, components or objects with the sums over its surfaces and its body.
    pub fn component(
        &self,
        row: &components::Row,
        group: &Group,
        body: Option<&Body>,
        components: &ComponentRows,
        wrong: &mut Wrong,
    ) {
        let total = &group.total;
        let own_tiles = match self.kind {
            Kind::Cell | Kind::Component => total.cell_tiles,
            _ => total.object_tiles,
        };
        if self.of_subset && self.is_cut(row, group, body) {
            let least = |at: usize, found: f64| row[at].is_some_and(|v| v >= found);
            let area = total.sums.area - self.area_error(&total.sums);
            if !least(AREA, area) || !least(TILES, own_tiles as f64) {
                wrong.push("its surfaces have more area, or lie in more tiles".to_owned());
            }
            if !components.holds(self.kind, row, &total.sums.inside) {
                wrong.push("its surfaces reach beyond its box".to_owned());
            }
            return;
        }
        let Some(body) = body else {
            wrong.push("its surfaces bound no body of voxels".to_owned());
            return;
        };
        let error = self.area_error(&total.sums);
        compare("area", row[AREA], total.sums.area, error, wrong);
        let sign = if self.kind.is_below() { -1.0 } else { 1.0 };
        let found = sign * total.sums.volume6 as f64 * self.exact.sixth;
        let said_to_touch = row[BORDER] == Some(1.0);
        let touches = body.touches || (self.edge_unknown && said_to_touch);
        match (touches, row[MESH_VOLUME]) {
            (true, Some(v)) => wrong.push(format!("mesh_volume {v}, expected none: it is open")),
            (true, None) => {}
            (false, volume) => {
                compare(
                    "mesh_volume",
                    volume,
                    found,
                    VOLUME_ERROR * found.abs(),
                    wrong,
                );
            }
        }
        compare("tiles", row[TILES], own_tiles as f64, 0.0, wrong);
        compare(
            "touches_border",
            row[BORDER],
            f64::from(u8::from(touches)),
            0.0,
            wrong,
        );
        components.check_body(row, body, wrong);
    }

    /// True if the row is that of a body that has more surfaces than are known here: then these bound another number of
    /// voxels, and have less area. The least surface, around a corner of one voxel, shows in the area unless there are so
    /// many triangles that rounding may hide it.
    fn is_cut(&self, row: &components::Row, group: &Group, body: Option<&Body>) -> bool {
        let sums = &group.total.sums;
        let rounding = ROUNDING * sums.area + self.exact.triangle_error * sums.triangles as f64;
        let same_area = row[AREA].is_some_and(|v| (v - sums.area).abs() <= rounding);
        let Some(body) = body else {
            return !same_area;
        };
        let same_voxels = row[VOXELS] == Some(body.moments.voxels as f64);
        !same_voxels && (!same_area || rounding >= self.exact.triangle_error * LEAST_SURFACE)
    }

    fn area_error(&self, sums: &Sums) -> f64 {
        self.exact.area_error(sums.area, sums.triangles)
    }

    /// A row of surfaces.
    fn surface(&self, row: &components::Row, group: &Group, wrong: &mut Wrong) {
        let sums = &group.total.sums;
        let ids = group.total.ids;
        let euler = euler_of(sums) as f64;
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
            // of the surface of a cell that others touch it has no meaning
            let may_lack = self.of_parts && name == "euler_characteristic";
            if !(may_lack && stated.is_none()) {
                compare(name, *stated, value, error, wrong);
            }
        }
    }

    /// Expects the end of the table, after `rows` more rows without a surface.
    pub fn finish(&mut self, rows: u64, issues: &mut Issues) {
        let mut found = 0u64;
        while !self.lines.done {
            found += u64::from(self.lines.next_line(issues).is_some());
        }
        if found != rows {
            let message = format!("found {found} rows after those with a surface, expected {rows}");
            issues.add(Code::TableRows, &self.lines.path, message);
        }
    }
}

/// How exact the numbers of a set are.
pub(super) struct Exactness {
    /// Physical volume of a lattice cell, over 6.
    sixth: f64,
    /// [`TRIANGLE_ERROR`] in physical units.
    triangle_error: f64,
}

impl Exactness {
    pub fn of(manifest: &Manifest) -> Self {
        let spacing = manifest.measured().spacing;
        let voxel: f64 = spacing.iter().product();
        let thinnest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        Exactness {
            sixth: voxel / 6.0 / f64::from(1 << 24),
            triangle_error: voxel / thinnest * TRIANGLE_ERROR,
        }
    }

    /// The error that the area of so many triangles may have.
    pub fn area_error(&self, area: f64, triangles: u64) -> f64 {
        AREA_ERROR * area + self.triangle_error * triangles as f64
    }
}

/// Compares the row of a cell, which is at `place`, with the hash of the measures on its pieces, which is missing if they
/// differ.
pub(super) fn check_carried(
    row: &components::Row,
    carried: Option<u64>,
    unit: &'static str,
    cell: u64,
    place: &str,
    issues: &mut Issues,
) {
    let mut stated = Measured {
        unit: Some(unit),
        ..Measured::default()
    };
    for (value, name) in stated.values.iter_mut().zip(MEASURES) {
        let at = components::COLUMNS.iter().position(|c| c.0 == name);
        *value = at.and_then(|at| row[at]).unwrap_or(f64::NAN);
    }
    if carried != Some(extras::hash(&stated)) {
        let message = match carried {
            None => format!("the measures on pieces of cell {cell} differ from piece to piece"),
            Some(_) => format!("the measures on pieces of cell {cell} are not those of {place}"),
        };
        issues.add(Code::CarriedMeasure, "tiles", message);
    }
}

/// The fields of a row, in the order of [`columns`]; an empty one is `None`.
struct Row {
    values: Vec<Option<f64>>,
    bad: Option<String>,
}

impl Row {
    fn read(line: &str, columns: &[(&str, u32)]) -> Self {
        let fields = line.split(',');
        let mut row = Row {
            values: Vec::with_capacity(columns.len()),
            bad: None,
        };
        let count = fields.clone().count();
        if count != columns.len() {
            row.bad = Some(format!("found {count} fields, expected {}", columns.len()));
        }
        for (field, (name, _)) in fields.zip(columns) {
            row.take(field, name);
        }
        row
    }

    fn take(&mut self, field: &str, name: &str) {
        let is_whole = is_whole(name);
        // as they are written, so that every reader takes them for the same
        let value = field.parse::<f64>().ok();
        let value = value.filter(|v| v.is_finite() && is_plain(field, is_whole));
        if value.is_none() && !field.is_empty() {
            let expected = if is_whole {
                "a whole number"
            } else {
                "a number without exponent, plus, or zeros that say nothing"
            };
            self.bad = Some(format!("{name}: found {field:?}, expected {expected}"));
        }
        self.values.push(value);
    }
}

/// True if a number is written in digits as the tables have it: no plus and no exponent, nor zeros that say nothing.
fn is_plain(field: &str, is_whole: bool) -> bool {
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    let (whole, fraction) = match field.split_once('.') {
        None => (field, None),
        Some((whole, fraction)) => (whole, Some(fraction)),
    };
    let whole = whole.strip_prefix('-').unwrap_or(whole);
    let leads = whole.is_empty() || (whole.len() > 1 && whole.starts_with('0'));
    let trails = fraction.is_some_and(|f| is_whole || f.is_empty() || f.ends_with('0'));
    // a count has no sign, and of whole numbers no 0 has one
    let minus = is_whole && field == "-0";
    !minus && digits(whole) && digits(fraction.unwrap_or_default()) && !leads && !trails
}

/// The columns of whole numbers.
const WHOLE: [&str; 14] = [
    "id",
    "component",
    "necks",
    "cell_a",
    "cell_b",
    "cell",
    "object",
    "voxels",
    "triangles",
    "vertices",
    "euler_characteristic",
    "border_edges",
    "touches_border",
    "tiles",
];

/// True for columns of whole numbers.
pub(super) fn is_whole(name: &str) -> bool {
    WHOLE.contains(&name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::SURFACE_COLUMNS;

    #[test]
    fn columns_of_surfaces_are_those_of_the_producer() {
        let theirs = SURFACE_COLUMNS.iter().map(|c| (c.name, c.power));
        let all: Vec<_> = std::iter::once(("id", 0)).chain(theirs).collect();
        assert_eq!(SURFACE[..], all);
    }
}
