//! The tables of cells, objects and surfaces as CSV files.

use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::measure::{AreaScale, ComponentRecord, Measures, RecordTable, SurfaceRecord};
use rayon::prelude::*;
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

/// A number as CSV has it: empty if it has no meaning.
fn number(value: Option<f64>) -> String {
    value
        .filter(|v| v.is_finite())
        .map_or(String::new(), |v| format!("{v}"))
}

/// Writes `cells.csv` or `objects.csv` and returns its size.
///
/// # Errors
/// [`Error::Io`].
pub fn write_components(
    path: &Path,
    table: &RecordTable<ComponentRecord>,
    place: &Placement,
    above: bool,
) -> Result<u64> {
    write_rows(
        path,
        &header(&COMPONENT_COLUMNS, place.unit),
        table,
        |id, record| {
            let m = Measures::of(record, place, above);
            let mut row = vec![id.to_string(), m.voxels.to_string()];
            row.extend(
                [
                    Some(m.volume),
                    m.mesh_volume,
                    Some(m.area),
                    Some(m.equivalent_diameter),
                    m.sphericity,
                    m.form_factor,
                ]
                .map(number),
            );
            for triple in [m.centroid, m.min, m.max, m.axes] {
                row.extend(triple.map(|v| number(Some(v))));
            }
            row.extend([m.elongation, m.flatness].map(|v| number(Some(v))));
            row.extend(m.orientation.map(|v| number(Some(v))));
            row.push(m.euler_characteristic.to_string());
            row.push(u8::from(m.touches_border).to_string());
            row.push(m.tiles.to_string());
            row
        },
    )
}

/// Writes `surfaces.csv` and returns its size.
///
/// # Errors
/// [`Error::Io`].
pub fn write_surfaces(
    path: &Path,
    table: &RecordTable<SurfaceRecord>,
    place: &Placement,
) -> Result<u64> {
    let scale = AreaScale::new(place.spacing);
    write_rows(
        path,
        &header(&SURFACE_COLUMNS, place.unit),
        table,
        |id, record| {
            vec![
                id.to_string(),
                record.cell.to_string(),
                record.object.to_string(),
                record.mesh.triangles.to_string(),
                record.mesh.vertices.to_string(),
                number(Some(scale.area(record.mesh.area))),
                record.mesh.euler_characteristic().to_string(),
                record.mesh.border_edges.to_string(),
                record.touches_border.to_string(),
                record.tiles.to_string(),
            ]
        },
    )
}

/// Rows that are in memory at once.
const AT_ONCE: u64 = 4096;
/// Rows that a thread formats in turn.
const EACH: usize = 128;

fn write_rows<T: bytemuck::Pod + Sync>(
    path: &Path,
    header: &str,
    table: &RecordTable<T>,
    row: impl Fn(u64, &T) -> Vec<String> + Sync,
) -> Result<u64> {
    let failed = |e| Error::io(path, "write", e);
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    let mut out = BufWriter::new(file);
    writeln!(out, "{header}").map_err(failed)?;
    let mut bytes = header.len() as u64 + 1;
    let mut first = 0;
    while first < table.len() {
        let end = table.len().min(first + AT_ONCE);
        let records: Vec<T> = (first..end).map(|i| table.get(i)).collect::<Result<_>>()?;
        let parts = records.par_chunks(EACH).enumerate().map(|(part, records)| {
            let id = first + (part * EACH) as u64 + 1;
            let lines = records
                .iter()
                .zip(id..)
                .map(|(r, id)| row(id, r).join(",") + "\n");
            lines.collect::<String>()
        });
        for part in parts.collect::<Vec<_>>() {
            bytes += part.len() as u64;
            out.write_all(part.as_bytes()).map_err(failed)?;
        }
        first = end;
    }
    out.flush().map_err(failed)?;
    Ok(bytes)
}
