//! A table as Parquet: the columns and values of its CSV file, with types.
//!
//! | column | type |
//! |---|---|
//! | counts, ids | INT64; null where the CSV file has nothing, of cells that are parts of components |
//! | `touches_border`, `thin`, `neighbour` | BOOLEAN |
//! | others | DOUBLE, null where the CSV file has nothing |
//!
//! Names are without units; these are in the file's metadata under `alvis`, as JSON: `{"table": "cells", "units":
//! {"volume": "mm^3", ...}}`.

use super::{TableReader, column::Column};
use crate::error::{Error, Result};
use parquet::basic::{Compression, Repetition, Type as Physical};
use parquet::data_type::{BoolType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// The key of the metadata.
const KEY: &str = "alvis";
/// Rows of a group, which is in memory whole: some 4 MB of 28 columns.
const GROUP: usize = 1 << 14;

/// The values of a column in a group of rows.
enum Values {
    Whole(Vec<i64>),
    /// Those of columns that may have none.
    Optional(Vec<i64>, Vec<i16>),
    Condition(Vec<bool>),
    /// Numbers, and for each row whether it has one.
    Real(Vec<f64>, Vec<i16>),
}

impl Values {
    /// Of a column; `parts` is true in tables of sets whose cells are parts of components.
    fn of(column: &Column, parts: bool) -> Self {
        if parts && column.may_lack_whole() {
            return Values::Optional(Vec::with_capacity(GROUP), Vec::with_capacity(GROUP));
        }
        match (column.is_condition(), column.is_whole()) {
            (true, _) => Values::Condition(Vec::with_capacity(GROUP)),
            (_, true) => Values::Whole(Vec::with_capacity(GROUP)),
            _ => Values::Real(Vec::with_capacity(GROUP), Vec::with_capacity(GROUP)),
        }
    }

    fn schema(&self, name: &str) -> parquet::errors::Result<Type> {
        let (physical, repetition) = match self {
            Values::Whole(_) => (Physical::INT64, Repetition::REQUIRED),
            Values::Optional(..) => (Physical::INT64, Repetition::OPTIONAL),
            Values::Condition(_) => (Physical::BOOLEAN, Repetition::REQUIRED),
            Values::Real(..) => (Physical::DOUBLE, Repetition::OPTIONAL),
        };
        let field = Type::primitive_type_builder(name, physical);
        field.with_repetition(repetition).build()
    }

    fn clear(&mut self) {
        match self {
            Values::Whole(values) => values.clear(),
            Values::Condition(values) => values.clear(),
            Values::Optional(values, present) => {
                values.clear();
                present.clear();
            }
            Values::Real(values, present) => {
                values.clear();
                present.clear();
            }
        }
    }
}

/// Writes the table in the CSV file `csv`, of this name and with this first column, to a new file, where `parts` is true of
/// a set whose cells are parts of components; returns its bytes. Memory is that of some thousand rows, and of a few
/// kilobytes for each such part of the table.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if it is no table of this program.
pub fn write_parquet(
    csv: &Path,
    path: &Path,
    (table, key): (&str, &str),
    parts: bool,
) -> Result<u64> {
    let mut reader = TableReader::open_keyed(csv, key)?;
    let columns = reader.columns().to_vec();
    let mut values: Vec<Values> = columns.iter().map(|c| Values::of(c, parts)).collect();
    let failed = |e: ParquetError| Error::io(path, "write", std::io::Error::other(e));
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    let mut out = begin(file, table, &columns, &values).map_err(failed)?;
    loop {
        let rows = fill(&mut reader, &mut values)?;
        if rows > 0 {
            put(&mut out, &values).map_err(failed)?;
        }
        if rows < GROUP {
            break;
        }
    }
    out.finish().map_err(failed)?;
    Ok(out.bytes_written() as u64)
}

fn begin(
    file: File,
    table: &str,
    columns: &[Column],
    values: &[Values],
) -> parquet::errors::Result<SerializedFileWriter<File>> {
    let fields = columns.iter().zip(values);
    let fields = fields.map(|(column, values)| values.schema(&column.name).map(Arc::new));
    let schema = Type::group_type_builder(table)
        .with_fields(fields.collect::<parquet::errors::Result<_>>()?)
        .build()?;
    let with_unit = columns.iter().filter(|column| !column.unit.is_empty());
    let units: serde_json::Map<_, _> = with_unit
        .map(|column| (column.name.clone(), column.unit.clone().into()))
        .collect();
    let about = serde_json::json!({ "table": table, "units": units });
    let properties = WriterProperties::builder()
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("alvis ", env!("CARGO_PKG_VERSION")).into())
        .set_key_value_metadata(Some(vec![KeyValue::new(KEY.into(), about.to_string())]))
        // hardly any number comes twice
        .set_dictionary_enabled(false);
    SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties.build()))
}

/// Replaces the values by those of the next rows; returns how many these are.
fn fill(reader: &mut TableReader, values: &mut [Values]) -> Result<usize> {
    values.iter_mut().for_each(Values::clear);
    for rows in 0..GROUP {
        let Some(row) = reader.next_row()? else {
            return Ok(rows);
        };
        for (i, values) in values.iter_mut().enumerate() {
            match values {
                Values::Whole(values) => values.push(row.signed(i)?),
                Values::Condition(values) => values.push(row.number(i)? == Some(1.0)),
                Values::Optional(values, present) => {
                    let is_there = row.number(i)?.is_some();
                    if is_there {
                        values.push(row.signed(i)?);
                    }
                    present.push(i16::from(is_there));
                }
                Values::Real(values, present) => {
                    let value = row.number(i)?;
                    values.extend(value);
                    present.push(i16::from(value.is_some()));
                }
            }
        }
    }
    Ok(GROUP)
}

fn put(out: &mut SerializedFileWriter<File>, values: &[Values]) -> parquet::errors::Result<()> {
    let mut group = out.next_row_group()?;
    for values in values {
        let mut column = group.next_column()?.expect("the schema has each column");
        match values {
            Values::Whole(values) => column.typed::<Int64Type>().write_batch(values, None, None),
            Values::Condition(values) => column.typed::<BoolType>().write_batch(values, None, None),
            Values::Optional(values, present) => {
                let column = column.typed::<Int64Type>();
                column.write_batch(values, Some(present), None)
            }
            Values::Real(values, present) => {
                let column = column.typed::<DoubleType>();
                column.write_batch(values, Some(present), None)
            }
        }?;
        column.close()?;
    }
    group.close().map(|_| ())
}
