//! A table of a tile set: columns as NumPy arrays, and all of it by the Arrow C interface.

use crate::arrow::{ArrowArrayStream, ArrowSchema, Batch, Batches, Field, Kind, Values};
use crate::errors::exception;
use alvis::Result;
use alvis::table::{Column, TableReader};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use std::path::PathBuf;

/// Rows of a batch.
const BATCH: usize = 1 << 14;

/// A table of a tile set, read from its file whenever it is asked.
#[pyclass(frozen, module = "alvis._native")]
pub struct Table {
    path: PathBuf,
    /// The column that tells that it is such a table.
    key: &'static str,
    fields: Vec<Field>,
}

fn field(column: &Column) -> Field {
    Field {
        name: column.name.clone(),
        unit: column.unit.clone(),
        kind: match (column.is_condition(), column.is_whole()) {
            (true, _) => Kind::Condition,
            (_, true) if column.may_lack_whole() => Kind::WholeIfAny,
            (_, true) => Kind::Whole,
            _ => Kind::Real,
        },
    }
}

/// Reads rows in batches.
struct Reader {
    reader: TableReader,
    fields: Vec<Field>,
    /// Columns to read, of the file's.
    chosen: Vec<usize>,
}

impl Reader {
    fn read(&mut self) -> Result<Option<Batch>> {
        let mut columns: Vec<Values> = self.fields.iter().map(|f| Values::of(f.kind)).collect();
        let mut rows = 0;
        while rows < BATCH
            && let Some(row) = self.reader.next_row()?
        {
            for (&at, values) in self.chosen.iter().zip(&mut columns) {
                match values {
                    Values::Whole(values) => values.push(row.signed(at)?),
                    Values::WholeIfAny(values, there) => {
                        let value = row.signed_if_any(at)?;
                        values.push(value.unwrap_or(0));
                        there.push(value.is_some());
                    }
                    Values::Condition(bits) => bits.push(row.number(at)? == Some(1.0)),
                    Values::Real(values, there) => {
                        let value = row.number(at)?;
                        values.push(value.unwrap_or(f64::NAN));
                        there.push(value.is_some());
                    }
                }
            }
            rows += 1;
        }
        Ok((rows > 0).then_some(Batch { rows, columns }))
    }
}

impl Batches for Reader {
    fn fields(&self) -> &[Field] {
        &self.fields
    }

    fn next(&mut self) -> Result<Option<Batch>, String> {
        self.read().map_err(|error| error.to_string())
    }
}

impl Table {
    /// Of the file at a path, which has a column `key`.
    pub fn open(path: PathBuf, key: &'static str) -> Result<Self> {
        let reader = TableReader::open_keyed(&path, key)?;
        let fields = reader.columns().iter().map(field).collect();
        Ok(Table { path, key, fields })
    }

    fn reader(&self, chosen: Vec<usize>) -> Result<Reader> {
        let reader = TableReader::open_keyed(&self.path, self.key)?;
        let fields = chosen.iter().map(|&at| self.fields[at].clone()).collect();
        Ok(Reader {
            reader,
            fields,
            chosen,
        })
    }

    /// The values of one column.
    fn values(&self, at: usize) -> Result<Vec<f64>> {
        let mut reader = TableReader::open_keyed(&self.path, self.key)?;
        let mut values = Vec::new();
        while let Some(row) = reader.next_row()? {
            values.push(row.number(at)?.unwrap_or(f64::NAN));
        }
        Ok(values)
    }

    /// Those of a column of whole numbers; `None` if some are missing.
    fn whole(&self, at: usize) -> Result<Option<Vec<i64>>> {
        let may_lack = self.fields[at].kind == Kind::WholeIfAny;
        let mut reader = TableReader::open_keyed(&self.path, self.key)?;
        let mut values = Vec::new();
        while let Some(row) = reader.next_row()? {
            match may_lack {
                true => match row.signed_if_any(at)? {
                    Some(value) => values.push(value),
                    None => return Ok(None),
                },
                false => values.push(row.signed(at)?),
            }
        }
        Ok(Some(values))
    }

    /// A column as floats, with NaN where the table has nothing.
    fn floats<'py>(&self, py: Python<'py>, at: usize) -> PyResult<Bound<'py, PyAny>> {
        let values = py.detach(|| self.values(at));
        let values = values.map_err(|error| exception(py, &error))?;
        Ok(PyArray1::from_vec(py, values).into_any())
    }
}

#[pymethods]
impl Table {
    /// The names of the columns, each with its unit, which is empty for a plain number.
    #[getter]
    fn columns(&self) -> Vec<(String, String)> {
        let pairs = self.fields.iter();
        pairs.map(|f| (f.name.clone(), f.unit.clone())).collect()
    }

    /// A column as an array: int64, bool, or float64 with NaN where the table has nothing. `None` if there is no such.
    fn column<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(at) = self.fields.iter().position(|field| field.name == name) else {
            return Ok(None);
        };
        if self.fields[at].kind == Kind::Real {
            return self.floats(py, at).map(Some);
        }
        let values = py.detach(|| self.whole(at));
        let Some(values) = values.map_err(|error| exception(py, &error))? else {
            return self.floats(py, at).map(Some);
        };
        let array = PyArray1::from_vec(py, values);
        Ok(Some(match self.fields[at].kind {
            Kind::Condition => array.cast_array::<bool>(false)?.into_any(),
            _ => array.into_any(),
        }))
    }

    /// The table as a stream of the Arrow C interface.
    fn stream<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let reader = self.reader((0..self.fields.len()).collect());
        let reader = reader.map_err(|error| exception(py, &error))?;
        let stream = ArrowArrayStream::new(reader);
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }

    /// Its columns as a schema of the Arrow C interface.
    fn schema<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = ArrowSchema::table(&self.fields);
        PyCapsule::new_with_value(py, schema, c"arrow_schema")
    }
}
