//! The tables as Parquet, compared value by value with those in CSV, which are compared with the surface.

use super::code::Code;
use super::ledger::Kind;
use super::report::Issues;
use super::table_files::{Files, columns, is_whole};
use super::tile::Context;
use crate::store::File;
use parquet::basic::{Repetition, Type as Physical};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use std::io::{BufRead, BufReader, Lines};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The most bytes that a column of a group of rows may unpack to: this program writes an eighth of a mebibyte.
const COLUMN_BYTES: i64 = 1 << 26;

/// What is wrong with a file: the kind, and the message.
type Fault = (Code, String);

/// A column's name, and the power of the unit of length that it has.
type Column = (&'static str, u32);

/// Compares the Parquet files that the index names with the CSV files.
pub(super) fn check(cx: &Context, issues: &mut Issues) {
    let Some(files) = Files::parquet(cx.manifest) else {
        return;
    };
    let more = [Kind::Component, Kind::Neck, Kind::Wall];
    for kind in Kind::ALL.into_iter().chain(more) {
        let Some((path, file, true)) = files.open(cx.root, kind, issues) else {
            continue;
        };
        // what is wrong with that file has been reported
        let csv = Files::csv(cx.manifest).open(cx.root, kind, &mut Issues::new(1));
        let Some((_, csv, _)) = csv else {
            continue;
        };
        let columns = columns(kind, cx.manifest);
        // counts of what cells of a component cut from each other
        let may_lack: &[&str] = match (cx.manifest.cells.is_some(), kind) {
            (true, Kind::Cell) => &["euler_characteristic", "component"],
            (true, Kind::Surface) => &["euler_characteristic"],
            _ => &[],
        };
        // a damaged file may be more than its reader bears
        let compared = catch_unwind(AssertUnwindSafe(|| compare(&columns, may_lack, file, csv)));
        let fault = compared.unwrap_or_else(|_| Some(syntax("what cannot be read")));
        if let Some((code, message)) = fault {
            issues.add(code, path, message);
        }
    }
}

fn syntax(found: impl std::fmt::Display) -> Fault {
    let message = format!("found {found}, expected the table in Parquet");
    (Code::TableSyntax, message)
}

/// The first difference between the two files of a table, of whose whole numbers those in the columns `may_lack` may be
/// missing.
fn compare(columns: &[Column], may_lack: &[&str], parquet: File, csv: File) -> Option<Fault> {
    match differ(columns, may_lack, parquet, csv) {
        Ok(fault) => fault,
        Err(e) => Some(syntax(e)),
    }
}

fn differ(
    columns: &[Column],
    may_lack: &[&str],
    parquet: File,
    csv: File,
) -> Result<Option<Fault>, ParquetError> {
    let reader = SerializedFileReader::new(parquet.on_disk()?)?;
    if let Some(fault) = wrong_columns(columns, may_lack, reader.metadata()) {
        return Ok(Some(fault));
    }
    let mut lines = BufReader::new(csv).lines();
    lines.next();
    let mut count = 0u64;
    for row in reader.get_row_iter(None)? {
        let row = row?;
        count += 1;
        let Some(Ok(line)) = lines.next() else {
            let message = format!("found more than the {} rows of the CSV file", count - 1);
            return Ok(Some((Code::TableRows, message)));
        };
        let mut texts = line.split(',');
        for (name, field) in row.get_column_iter() {
            let text = texts.next().unwrap_or_default();
            if !is_same(field, text) {
                let message = format!(
                    "row {count}: found {name} {field}, expected {text:?} as in the CSV file"
                );
                return Ok(Some((Code::TableValue, message)));
            }
        }
    }
    Ok(missing_rows(count, lines))
}

fn missing_rows(count: u64, lines: Lines<BufReader<File>>) -> Option<Fault> {
    let more = lines.map_while(Result::ok).count();
    let message = format!("found {count} rows, expected {more} more as in the CSV file");
    (more > 0).then_some((Code::TableRows, message))
}

/// A column of the file: its name, its type and whether it may lack values.
type Found<'a> = (&'a str, Option<Physical>, Option<Repetition>);

/// Columns of other names or types, or parts too large to be unpacked.
fn wrong_columns(columns: &[Column], may_lack: &[&str], file: &ParquetMetaData) -> Option<Fault> {
    let schema = file.file_metadata().schema();
    let found: Vec<Found> = schema
        .get_fields()
        .iter()
        .map(|field| {
            let info = field.get_basic_info();
            let primitive = field.is_primitive().then(|| field.get_physical_type());
            (
                field.name(),
                primitive,
                info.has_repetition().then(|| info.repetition()),
            )
        })
        .collect();
    let expected: Vec<Found> = columns
        .iter()
        .map(|(name, _)| {
            let (physical, repetition) = match *name {
                "touches_border" | "thin" | "neighbour" => {
                    (Physical::BOOLEAN, Repetition::REQUIRED)
                }
                name if may_lack.contains(&name) => (Physical::INT64, Repetition::OPTIONAL),
                name if is_whole(name) => (Physical::INT64, Repetition::REQUIRED),
                _ => (Physical::DOUBLE, Repetition::OPTIONAL),
            };
            (*name, Some(physical), Some(repetition))
        })
        .collect();
    let differs = |(found, expected): &(&Found, &Found)| found != expected;
    if let Some((found, expected)) = found.iter().zip(&expected).find(differs) {
        let message = format!("found the column {found:?}, expected {expected:?}");
        return Some((Code::TableSyntax, message));
    }
    if found.len() != expected.len() {
        let message = format!("found {} columns, expected {}", found.len(), expected.len());
        return Some((Code::TableSyntax, message));
    }
    let parts = file.row_groups().iter().flat_map(|group| group.columns());
    let mut sizes = parts.map(|column| column.uncompressed_size());
    let large = sizes.find(|bytes| !(0..=COLUMN_BYTES).contains(bytes))?;
    let message = format!("found {large} bytes of a column, expected {COLUMN_BYTES} at most");
    Some((Code::TableSyntax, message))
}

fn is_same(field: &Field, text: &str) -> bool {
    match field {
        Field::Null => text.is_empty(),
        Field::Bool(value) => text == if *value { "1" } else { "0" },
        Field::Long(value) => text.parse() == Ok(*value),
        Field::Double(value) => text
            .parse()
            .is_ok_and(|text: f64| text.to_bits() == value.to_bits()),
        _ => false,
    }
}
