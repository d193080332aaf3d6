//! The files of the tables, read row by row.

use super::code::Code;
use super::components;
use super::files;
use super::ledger::Kind;
use super::report::Issues;
use super::tile::Context;
use crate::manifest::{Manifest, TableChecksums, checksum_of};
use crate::store::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The longest line that is read.
const MAX_LINE: u64 = 1 << 16;

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

/// The columns of the table of walls.
const WALL: [(&str, u32); 7] = [
    ("cell_a", 0),
    ("cell_b", 0),
    ("wall_area", 2),
    ("wall_thickness", 1),
    ("chords", 0),
    ("thin", 0),
    ("neighbour", 0),
];

/// The columns of the table of cells that walls give, which stand behind the first one of parts, and at the end.
const OF_WALLS: [(&str, u32); 2] = [("neighbours", 0), ("wall_thickness", 1)];

/// The columns of a table, as they stand in its files.
pub(super) fn columns(kind: Kind, manifest: &Manifest) -> Vec<(&'static str, u32)> {
    let mut columns = match kind {
        Kind::Surface => SURFACE.to_vec(),
        Kind::Neck => NECK.to_vec(),
        Kind::Wall => WALL.to_vec(),
        _ => components::COLUMNS.to_vec(),
    };
    if kind != Kind::Cell {
        return columns;
    }
    if manifest.cells.is_some() {
        columns.extend(PART);
    }
    if manifest.tables.walls.is_some() {
        let [neighbours, thickness] = OF_WALLS;
        columns.insert(neighbours_at(manifest), neighbours);
        columns.push(thickness);
    }
    columns
}

/// Where the neighbours of cells stand.
fn neighbours_at(manifest: &Manifest) -> usize {
    components::COLUMNS.len() + usize::from(manifest.cells.is_some())
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
const KINDS: usize = 6;

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
                tables.walls.as_deref(),
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
                tables.components.as_deref(),
                tables.necks.as_deref(),
                tables.walls.as_deref(),
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
        all.walls.as_deref(),
    ]
}

/// The lines of a table, one after the other.
pub(super) struct Lines {
    pub path: String,
    input: BufReader<File>,
    /// Number of the last one.
    pub line: u64,
    columns: Vec<(&'static str, u32)>,
    /// Where the neighbours of cells stand, if there are such.
    neighbours: Option<usize>,
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
            columns: columns(kind, manifest),
            neighbours: (kind == Kind::Cell && manifest.tables.walls.is_some())
                .then(|| neighbours_at(manifest)),
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

    /// The next line; `None` at the end, or if it cannot be read, which is an issue.
    pub fn next_line(&mut self, issues: &mut Issues) -> Option<String> {
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
        self.fields(&line, issues)
    }

    /// The fields of a line, of which those that walls give come last; `None` if it is damaged, which is an issue.
    pub fn fields(&mut self, line: &str, issues: &mut Issues) -> Option<Vec<Option<f64>>> {
        let mut row = Row::read(line, &self.columns);
        if let Some(message) = row.bad {
            return self.stop(&message, issues);
        }
        if let Some(at) = self.neighbours {
            let last = row.values.len() - 1;
            row.values[at..last].rotate_left(1);
        }
        Some(row.values)
    }

    /// Where among the fields of a row those that walls give are: neighbours, and the thickness of walls.
    pub fn walls_at(&self) -> [usize; 2] {
        [self.columns.len() - 2, self.columns.len() - 1]
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
const WHOLE: [&str; 18] = [
    "id",
    "component",
    "neighbours",
    "necks",
    "chords",
    "thin",
    "neighbour",
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
