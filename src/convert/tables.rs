//! The tables of cells, objects and surfaces as CSV files.

use crate::convert::cells::Opening;
use crate::convert::components::{Components, SEVERAL};
use crate::convert::finalize::Stop;
use crate::convert::id_places::IdPlaces;
use crate::convert::walls::JudgedWall;
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::manifest::{COMPONENTS, NECKS, WALLS};
use crate::measure::{
    AreaScale, COMPONENT_COLUMNS, Column, ComponentRecord, Field, Measures, MoreOfCell,
    NECK_COLUMNS, NeckRow, RecordTable, SURFACE_COLUMNS, SurfaceRow, WALL_COLUMNS, WallRow,
    more_columns,
};
use crate::sys::spill_file::SpillFile;
use rayon::prelude::*;
use std::fmt::{Display, Write as _};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// `mm^2` for a power of 2, nothing for 0.
pub fn unit_text(unit: Unit, power: u32) -> String {
    match power {
        0 => String::new(),
        1 => unit.name().to_string(),
        p => format!("{}^{p}", unit.name()),
    }
}

/// The smallest spacing.
fn finest(place: &Placement) -> f64 {
    place.spacing.into_iter().fold(f64::INFINITY, f64::min)
}

/// Titles of columns, with commas between them.
fn titles<T>(columns: &[Column<T>], unit: Unit) -> String {
    let titles = columns.iter().map(|column| match column.power {
        0 => column.name.to_string(),
        power => format!("{} [{}]", column.name, unit_text(unit, power)),
    });
    titles.collect::<Vec<_>>().join(",")
}

/// The same behind that of the id.
fn header<T>(columns: &[Column<T>], unit: Unit) -> String {
    format!("id,{}", titles(columns, unit))
}

/// Writes the fields of a row.
struct Row<'a> {
    text: &'a mut String,
    started: bool,
}

impl Row<'_> {
    fn put(&mut self, value: impl Display) {
        self.separate();
        write!(self.text, "{value}").expect("a string takes all");
    }

    fn put_text(&mut self, text: &str) {
        self.separate();
        self.text.push_str(text);
    }

    fn separate(&mut self) {
        if std::mem::replace(&mut self.started, true) {
            self.text.push(',');
        }
    }

    /// The fields of all columns; empty where they have no meaning.
    fn put_all<T>(&mut self, columns: &[Column<T>], of: &T) {
        for column in columns {
            match column.get.of(of).meaningful() {
                Some(Field::Count(v)) => self.put(v),
                Some(Field::Signed(v)) => self.put(v),
                Some(Field::Flag(v)) => self.put(u8::from(v)),
                Some(Field::Real(v)) => match plain(v, &mut zmij::Buffer::new()) {
                    Some(digits) => self.put_text(digits),
                    None => self.put(v),
                },
                None => self.put_text(""),
            }
        }
    }
}

/// The shortest text of a finite number, as the tiles' JSON has it, in a third of the time that [`Display`]
/// takes; `None` if it is so large or small that it would get an exponent.
fn plain(value: f64, buffer: &mut zmij::Buffer) -> Option<&str> {
    let digits = buffer.format_finite(value);
    (!digits.contains('e')).then(|| digits.strip_suffix(".0").unwrap_or(digits))
}

/// Writes the tables of cells, objects and surfaces side by side, where cells are parts of components also those of
/// components and necks, and that of walls if it was asked for; returns their bytes. Of a part of a volume, their rows of
/// the components that begin there, with the titles in those of the first part.
pub fn write_tables(
    work: &Path,
    components: &Components,
    placement: &Placement,
    stop: &Stop,
) -> Result<u64> {
    let (cells, (objects, surfaces)) = rayon::join(
        || -> Result<u64> {
            let mut bytes = write_cells(&work.join("cells.csv"), components, placement, stop)?;
            if let Some(given) = &components.given {
                let rows = OfPhase {
                    table: &given.components,
                    ids: &given.places,
                    above: false,
                    has_titles: components.has_titles,
                };
                bytes += write_components(&work.join(COMPONENTS), &rows, placement, stop)?;
                let openings = ListOf {
                    records: &given.cells.openings,
                    has_titles: components.has_titles,
                };
                bytes += write_necks(&work.join(NECKS), openings, placement)?;
            }
            bytes += write_walls(&work.join(WALLS), components, placement)?;
            Ok(bytes)
        },
        || {
            let path = work.join("objects.csv");
            let rows = OfPhase {
                table: &components.objects,
                ids: &components.places.objects,
                above: true,
                has_titles: components.has_titles,
            };
            let objects = write_components(&path, &rows, placement, stop);
            let path = work.join("surfaces.csv");
            let surfaces = write_surfaces(&path, components, placement, stop);
            (objects, surfaces)
        },
    );
    Ok(cells? + objects? + surfaces?)
}

/// Writes `cells.csv` and returns its size.
fn write_cells(
    path: &Path,
    components: &Components,
    place: &Placement,
    stop: &Stop,
) -> Result<u64> {
    let more = more_columns(components.given.is_some(), components.walls.is_some());
    let mut head = header(&COMPONENT_COLUMNS, place.unit);
    if !more.is_empty() {
        head = format!("{head},{}", titles(&more, place.unit));
    }
    let rows = Rows {
        table: &components.cells,
        count: components.own_cells(),
    };
    let titles = components.has_titles.then_some(&head);
    write_rows(path, titles, rows, stop, |i, record, row| {
        row.put(components.id_of_cell(i));
        row.put_all(&COMPONENT_COLUMNS, &Measures::of(record, place, false));
        row.put_all(&more, &more_of(components, i, record, place)?);
        Ok(())
    })
}

/// What more is known of the cell in place `i`.
fn more_of(
    components: &Components,
    i: u64,
    record: &ComponentRecord,
    place: &Placement,
) -> Result<MoreOfCell> {
    let mut more = MoreOfCell::default();
    if let Some(given) = &components.given {
        let known = given.parts.get(i)?;
        more.component = (known.component != SEVERAL).then_some(known.component);
        more.necks = record.necks;
        more.largest_neck = (known.largest_neck > 0.0).then_some(known.largest_neck);
    }
    if let Some(walls) = &components.walls {
        let known = walls.of_cells.get(i)?;
        more.neighbours = known.neighbours;
        let thickness = known.thickness * finest(place);
        more.wall_thickness = (known.area_steps > 0).then_some(thickness);
    }
    Ok(more)
}

/// Writes `necks.csv` and returns its size.
fn write_necks(path: &Path, openings: ListOf, place: &Placement) -> Result<u64> {
    let known = |value: f64| (!value.is_nan()).then_some(value);
    write_list(
        path,
        &NECK_COLUMNS,
        openings,
        place.unit,
        |opening: Opening| NeckRow {
            cells: opening.cells,
            radius: known(opening.radius),
            ratio: known(opening.ratio),
            place: known(opening.place[0]).map(|_| place.world(opening.place)),
            area: opening.area,
        },
    )
}

/// Writes `walls.csv`, if walls are known, and returns its size.
fn write_walls(path: &Path, components: &Components, place: &Placement) -> Result<u64> {
    let Some(known) = &components.walls else {
        return Ok(0);
    };
    let finest = finest(place);
    let walls = ListOf {
        records: &known.walls,
        has_titles: components.has_titles,
    };
    write_list(path, &WALL_COLUMNS, walls, place.unit, |judged| {
        let JudgedWall { wall, neighbour } = judged;
        WallRow {
            cells: wall.cells,
            area: wall.area(place.spacing),
            thickness: wall.thickness * finest,
            chords: wall.chords,
            thin: 2 * wall.thin > wall.area_steps,
            neighbour: neighbour == 1,
        }
    })
}

/// Records that get a row each.
#[derive(Clone, Copy)]
struct ListOf<'a> {
    records: &'a SpillFile,
    has_titles: bool,
}

/// Writes a table without ids and returns its size.
fn write_list<T: bytemuck::Pod, R>(
    path: &Path,
    columns: &[Column<R>],
    list: ListOf,
    unit: Unit,
    row_of: impl Fn(T) -> R,
) -> Result<u64> {
    let failed = |e| Error::io(path, "write", e);
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    let mut out = BufWriter::new(file);
    let mut bytes = 0;
    let mut text = String::new();
    if list.has_titles {
        text = titles(columns, unit);
        text.push('\n');
    }
    let mut put = |text: &mut String| {
        bytes += text.len() as u64;
        let put = out.write_all(text.as_bytes()).map_err(failed);
        text.clear();
        put
    };
    put(&mut text)?;
    list.records.each(|record: T| {
        let started = false;
        Row {
            text: &mut text,
            started,
        }
        .put_all(columns, &row_of(record));
        text.push('\n');
        put(&mut text)
    })?;
    out.flush().map_err(failed)?;
    Ok(bytes)
}

/// Components of one phase, of which a table has the rows.
struct OfPhase<'a> {
    table: &'a RecordTable<ComponentRecord>,
    /// Their ids; those of this part of the volume have rows.
    ids: &'a IdPlaces,
    above: bool,
    has_titles: bool,
}

/// Writes `cells.csv` or, of what is above, `objects.csv`, or the same for components, and returns its size.
fn write_components(path: &Path, of: &OfPhase, place: &Placement, stop: &Stop) -> Result<u64> {
    let (ids, above) = (of.ids, of.above);
    let titles = header(&COMPONENT_COLUMNS, place.unit);
    let rows = Rows {
        table: of.table,
        count: ids.own,
    };
    write_rows(
        path,
        of.has_titles.then_some(&titles),
        rows,
        stop,
        |i, record, row| {
            row.put(ids.id(i));
            row.put_all(&COMPONENT_COLUMNS, &Measures::of(record, place, above));
            Ok(())
        },
    )
}

/// Writes `surfaces.csv` and returns its size.
fn write_surfaces(
    path: &Path,
    components: &Components,
    place: &Placement,
    stop: &Stop,
) -> Result<u64> {
    let scale = AreaScale::new(place.spacing);
    let ids = &components.places.surfaces;
    let titles = header(&SURFACE_COLUMNS, place.unit);
    let rows = Rows {
        table: &components.surfaces,
        count: ids.own,
    };
    write_rows(
        path,
        components.has_titles.then_some(&titles),
        rows,
        stop,
        |i, record, row| {
            row.put(ids.id(i));
            let is_cut = match components.given {
                Some(_) => components.cell(record.cell)?.necks > 0,
                None => false,
            };
            let surface = SurfaceRow {
                record: *record,
                area: scale.area(record.mesh.area),
                euler_characteristic: (!is_cut).then(|| record.mesh.euler_characteristic()),
            };
            row.put_all(&SURFACE_COLUMNS, &surface);
            Ok(())
        },
    )
}

/// Rows that a thread formats in turn.
const EACH: usize = 64;
/// Texts of as many rows that are formatted beside the writing of as many before.
const PARTS: usize = 32;

/// The records of a table that get rows: the first ones.
#[derive(Clone, Copy)]
struct Rows<'a, T> {
    table: &'a RecordTable<T>,
    count: u64,
}

/// Writes a table, without titles if none are given.
fn write_rows<T: bytemuck::Pod + Send + Sync>(
    path: &Path,
    titles: Option<&String>,
    Rows { table, count: rows }: Rows<T>,
    stop: &Stop,
    fill: impl Fn(u64, &T, &mut Row) -> Result<()> + Sync,
) -> Result<u64> {
    let failed = |e| Error::io(path, "write", e);
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    let mut out = BufWriter::new(file);
    let mut bytes = 0;
    if let Some(titles) = titles {
        writeln!(out, "{titles}").map_err(failed)?;
        bytes = titles.len() as u64 + 1;
    }
    let format = |first: u64| {
        let mut text = String::new();
        for i in first..rows.min(first + EACH as u64) {
            let (text, started) = (&mut text, false);
            fill(i, &table.get(i)?, &mut Row { text, started })?;
            text.push('\n');
        }
        Ok(text)
    };
    let mut write = |texts: Vec<String>| {
        texts.iter().try_for_each(|text| {
            bytes += text.len() as u64;
            out.write_all(text.as_bytes()).map_err(failed)
        })
    };
    let mut behind = Vec::new();
    for first in (0..rows).step_by(PARTS * EACH) {
        if stop() {
            return Err(Error::Interrupted);
        }
        let parts: Vec<u64> = (first..rows).step_by(EACH).take(PARTS).collect();
        let formatted = || {
            parts
                .into_par_iter()
                .map(format)
                .collect::<Result<Vec<_>>>()
        };
        let (written, texts) = rayon::join(|| write(behind), formatted);
        written?;
        behind = texts?;
    }
    write(behind)?;
    out.flush().map_err(failed)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_shortest(value: f64) {
        if let Some(text) = plain(value, &mut zmij::Buffer::new()) {
            assert_eq!(text.parse::<f64>().unwrap().to_bits(), value.to_bits());
            // of two that are as short and as near, it may be the other one
            assert_eq!(text.len(), value.to_string().len());
        }
    }

    proptest! {
        #[test]
        fn numbers_are_read_as_they_were_and_as_short_as_displayed(bits in any::<u64>(), value in -1e6..1e6f64, whole in any::<i32>()) {
            for v in [f64::from_bits(bits), value, value * 1e-5, value * 1e6, whole.into(), f64::from(whole) / 256.0] {
                if v.is_finite() {
                    is_shortest(v);
                }
            }
        }
    }

    #[test]
    fn numbers_of_usual_sizes_are_written_fast() {
        for v in [0.0, -0.0, 1.0, -1.5, 0.1, 1e-4, 123_456.789, 1e15] {
            is_shortest(v);
            assert!(plain(v, &mut zmij::Buffer::new()).is_some(), "{v}");
        }
        assert_eq!(plain(1e300, &mut zmij::Buffer::new()), None);
    }
}
