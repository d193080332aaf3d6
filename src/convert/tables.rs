//! The tables of cells, objects and surfaces as CSV files.

use crate::convert::finalize::Stop;
use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::measure::{AreaScale, ComponentRecord, Measures, RecordTable, SurfaceRecord};
use rayon::prelude::*;
use std::fmt::{Display, Write as _};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Columns of `cells.csv` and `objects.csv` with the power of the unit of length they have.
pub const COMPONENT_COLUMNS: [(&str, u32); 28] = [
    ("id", 0),
    ("voxels", 0),
    ("volume", 3),
    ("mesh_volume", 3),
    ("area", 2),
    ("equivalent_diameter", 1),
    ("sphericity", 0),
    ("form_factor", 0),
    ("centroid_x", 1),
    ("centroid_y", 1),
    ("centroid_z", 1),
    ("min_x", 1),
    ("min_y", 1),
    ("min_z", 1),
    ("max_x", 1),
    ("max_y", 1),
    ("max_z", 1),
    ("axis_a", 1),
    ("axis_b", 1),
    ("axis_c", 1),
    ("elongation", 0),
    ("flatness", 0),
    ("orientation_x", 0),
    ("orientation_y", 0),
    ("orientation_z", 0),
    ("euler_characteristic", 0),
    ("touches_border", 0),
    ("tiles", 0),
];

/// Columns of `surfaces.csv`.
pub const SURFACE_COLUMNS: [(&str, u32); 10] = [
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

/// `mm^2` for a power of 2, nothing for 0.
pub fn unit_text(unit: Unit, power: u32) -> String {
    match power {
        0 => String::new(),
        1 => unit.name().to_string(),
        p => format!("{}^{p}", unit.name()),
    }
}

fn header(columns: &[(&str, u32)], unit: Unit) -> String {
    let names: Vec<String> = columns
        .iter()
        .map(|&(name, power)| match power {
            0 => name.to_string(),
            _ => format!("{name} [{}]", unit_text(unit, power)),
        })
        .collect();
    names.join(",")
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

    /// A number as CSV has it: empty if it has no meaning.
    fn number(&mut self, value: Option<f64>) {
        match value.filter(|v| v.is_finite()) {
            Some(v) => match plain(v, &mut zmij::Buffer::new()) {
                Some(digits) => self.put_text(digits),
                None => self.put(v),
            },
            None => self.put_text(""),
        }
    }
}

/// The shortest text of a finite number, as the tiles' JSON has it, in a third of the time that [`Display`]
/// takes; `None` if it is so large or small that it would get an exponent.
fn plain(value: f64, buffer: &mut zmij::Buffer) -> Option<&str> {
    let digits = buffer.format_finite(value);
    (!digits.contains('e')).then(|| digits.strip_suffix(".0").unwrap_or(digits))
}

/// Writes `cells.csv` or `objects.csv` and returns its size.
///
/// # Errors
/// [`Error::Io`]; [`Error::Interrupted`] if it is to stop.
pub fn write_components(
    path: &Path,
    table: &RecordTable<ComponentRecord>,
    (place, above): (&Placement, bool),
    stop: &Stop,
) -> Result<u64> {
    write_rows(
        (path, stop),
        &header(&COMPONENT_COLUMNS, place.unit),
        table,
        |id, record, row| {
            let m = Measures::of(record, place, above);
            row.put(id);
            row.put(m.voxels);
            row.number(Some(m.volume));
            row.number(m.mesh_volume);
            row.number(Some(m.area));
            row.number(Some(m.equivalent_diameter));
            row.number(m.sphericity);
            row.number(m.form_factor);
            for &v in [m.centroid, m.min, m.max, m.axes].as_flattened() {
                row.number(Some(v));
            }
            row.number(Some(m.elongation));
            row.number(Some(m.flatness));
            for v in m.orientation {
                row.number(Some(v));
            }
            row.put(m.euler_characteristic);
            row.put(u8::from(m.touches_border));
            row.put(m.tiles);
        },
    )
}

/// Writes `surfaces.csv` and returns its size.
///
/// # Errors
/// [`Error::Io`]; [`Error::Interrupted`] if it is to stop.
pub fn write_surfaces(
    path: &Path,
    table: &RecordTable<SurfaceRecord>,
    place: &Placement,
    stop: &Stop,
) -> Result<u64> {
    let scale = AreaScale::new(place.spacing);
    write_rows(
        (path, stop),
        &header(&SURFACE_COLUMNS, place.unit),
        table,
        |id, record, row| {
            row.put(id);
            row.put(record.cell);
            row.put(record.object);
            row.put(record.mesh.triangles);
            row.put(record.mesh.vertices);
            row.number(Some(scale.area(record.mesh.area)));
            row.put(record.mesh.euler_characteristic());
            row.put(record.mesh.border_edges);
            row.put(record.touches_border);
            row.put(record.tiles);
        },
    )
}

/// Rows that a thread formats in turn.
const EACH: usize = 64;
/// Texts of as many rows that are formatted beside the writing of as many before.
const PARTS: usize = 32;

fn write_rows<T: bytemuck::Pod + Send + Sync>(
    (path, stop): (&Path, &Stop),
    header: &str,
    table: &RecordTable<T>,
    fill: impl Fn(u64, &T, &mut Row) + Sync,
) -> Result<u64> {
    let failed = |e| Error::io(path, "write", e);
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    let mut out = BufWriter::new(file);
    writeln!(out, "{header}").map_err(failed)?;
    let mut bytes = header.len() as u64 + 1;
    let rows = table.len();
    let format = |first: u64| {
        let mut text = String::new();
        for i in first..rows.min(first + EACH as u64) {
            let (text, started) = (&mut text, false);
            fill(i + 1, &table.get(i)?, &mut Row { text, started });
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
