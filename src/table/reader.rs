//! A table as CSV, row by row.

mod find;

use super::column::Column;
use crate::error::{Error, Result};
use crate::grid::{Length, Unit};
use crate::store::File;
use csv_core::ReadRecordResult;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// The longest row in bytes, and the most columns: a table of this program has rows of some 600
/// bytes in 28 columns.
const ROW_BYTES: usize = 1 << 16;
const COLUMNS: usize = 1024;
/// Bytes read at a time, forward and for single rows here and there.
const BUFFER: usize = 1 << 16;
const ROW_BUFFER: usize = 1 << 10;

/// Reads a table forward; memory is that of one row.
pub struct TableReader {
    path: PathBuf,
    columns: Vec<Column>,
    input: BufReader<File>,
    core: csv_core::Reader,
    /// Bytes of the file that are consumed.
    offset: u64,
    /// Where the first row begins.
    first: u64,
    line: u64,
    fields: Vec<u8>,
    ends: Vec<usize>,
    convert: Option<Convert>,
}

/// How numbers become those of another unit of length.
#[derive(Debug, Clone)]
struct Convert {
    from: Length,
    to: Unit,
    /// The power of the unit that each column has.
    powers: Vec<usize>,
}

impl std::fmt::Debug for TableReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TableReader")
            .field("path", &self.path)
            .field("columns", &self.columns)
            .finish_non_exhaustive()
    }
}

/// One row of a table.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    path: &'a Path,
    columns: &'a [Column],
    fields: &'a [u8],
    ends: &'a [usize],
    convert: Option<&'a Convert>,
    line: u64,
    /// Byte of the file at which the row starts.
    pub offset: u64,
}

impl TableReader {
    /// Opens a CSV file whose first row names its columns; one of them is `id`.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Format`] if its head is not that of a table.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_keyed(path, "id")
    }

    /// The same for a file with a column `key` instead of `id`, as `cell_a` of the table of necks.
    ///
    /// # Errors
    /// As of [`TableReader::open`].
    pub fn open_keyed(path: &Path, key: &str) -> Result<Self> {
        Self::open_buffered(path, BUFFER, key)
    }

    /// The same table again, for [`TableReader::row_at`] in any order.
    ///
    /// # Errors
    /// As [`TableReader::open`].
    pub fn reopen(&self) -> Result<Self> {
        let key = self.columns.first().map_or("id", |c| c.name.as_str());
        Self::open_buffered(&self.path, ROW_BUFFER, key)
    }

    fn open_buffered(path: &Path, buffer: usize, key: &str) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "open the table", e))?;
        let mut reader = TableReader {
            path: path.to_path_buf(),
            columns: Vec::new(),
            input: BufReader::with_capacity(buffer, file),
            core: csv_core::Reader::new(),
            offset: 0,
            first: 0,
            line: 1,
            fields: vec![0; ROW_BYTES],
            ends: vec![0; COLUMNS],
            convert: None,
        };
        let bad = |found: String| {
            let expected = format!("a table with a column `{key}`");
            Err(Error::format(path, found, expected))
        };
        let Some((_, _, count, size)) = reader.record()? else {
            return bad("an empty file".into());
        };
        let Ok(text) = std::str::from_utf8(&reader.fields[..size]) else {
            return bad("a first row that is not text".into());
        };
        let mut columns: Vec<Column> = Vec::with_capacity(count);
        let mut start = 0;
        for &end in &reader.ends[..count] {
            // the ends of fields may fall inside a character only in a damaged file
            let Some(name) = text.get(start..end) else {
                return bad("a first row that is not text".into());
            };
            start = end;
            let column = Column::parse(name);
            if columns.iter().any(|c| c.name == column.name) {
                return bad(format!("the column {:?} twice", column.name));
            }
            columns.push(column);
        }
        if !columns.iter().any(|c| c.name == key) {
            return bad("none".into());
        }
        reader.columns = columns;
        reader.first = reader.offset;
        Ok(reader)
    }

    /// The same table with its numbers, and so conditions on them, in another unit of length than `from`, which its
    /// columns are in. Texts of fields stay.
    pub fn in_unit(mut self, from: Unit, to: Unit) -> Self {
        if from == to || [from, to].contains(&Unit::Voxel) {
            return self;
        }
        let names = [1, 2, 3].map(|power| {
            let name = |unit: Unit| match power {
                1 => unit.name().to_owned(),
                _ => format!("{}^{power}", unit.name()),
            };
            [name(from), name(to)]
        });
        let mut powers = Vec::with_capacity(self.columns.len());
        for column in &mut self.columns {
            let power = names.iter().position(|[from, _]| *from == column.unit);
            if let Some(power) = power {
                column.unit.clone_from(&names[power][1]);
            }
            powers.push(power.map_or(0, |power| power + 1));
        }
        let from = Length::from(from);
        self.convert = Some(Convert { from, to, powers });
        self
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The columns in order.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The position of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c.name == name)
    }

    /// The position of a column that every table of this kind has.
    ///
    /// # Errors
    /// [`Error::Format`] if this one has not.
    pub fn own_column(&self, name: &str) -> Result<usize> {
        self.column(name)
            .ok_or_else(|| Error::format(&self.path, "none", format!("a column {name}")))
    }

    /// The next row, or `None` at the end.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::Format`] with the line of a row that has too few or too many
    /// fields, or none that ends.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>> {
        let Some((offset, line, count, size)) = self.record()? else {
            return Ok(None);
        };
        if count != self.columns.len() {
            return Err(Error::format(
                &self.path,
                format!("{count} fields in line {line}"),
                format!("{} as in the first line", self.columns.len()),
            ));
        }
        Ok(Some(Row {
            path: &self.path,
            columns: &self.columns,
            fields: &self.fields[..size],
            ends: &self.ends[..count],
            convert: self.convert.as_ref(),
            line,
            offset,
        }))
    }

    /// The row that starts at byte `offset`, as an earlier [`Row::offset`] told.
    ///
    /// # Errors
    /// Those of [`TableReader::next_row`]; [`Error::Format`] if the file has shrunk.
    pub fn row_at(&mut self, offset: u64) -> Result<Row<'_>> {
        self.jump(offset)?;
        let path = self.path.clone();
        self.next_row()?
            .ok_or_else(|| Error::format(path, "its end", "the row that was there"))
    }

    fn jump(&mut self, offset: u64) -> Result<()> {
        let ahead = offset as i64 - self.offset as i64;
        self.input
            .seek_relative(ahead)
            .map_err(|e| Error::io(&self.path, "read the table", e))?;
        self.core.reset();
        self.offset = offset;
        Ok(())
    }

    /// Reads one record into `fields` and `ends`: its offset, line, number of fields and bytes.
    fn record(&mut self) -> Result<Option<(u64, u64, usize, usize)>> {
        let (mut size, mut count) = (0, 0);
        let (offset, line) = (self.offset, self.line);
        loop {
            let input = self
                .input
                .fill_buf()
                .map_err(|e| Error::io(&self.path, "read the table", e))?;
            let (result, read, written, ended) =
                self.core
                    .read_record(input, &mut self.fields[size..], &mut self.ends[count..]);
            self.input.consume(read);
            self.offset += read as u64;
            size += written;
            count += ended;
            match result {
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::Record => {
                    self.line = self.core.line();
                    return Ok(Some((offset, line, count, size)));
                }
                ReadRecordResult::End => return Ok(None),
                ReadRecordResult::OutputFull | ReadRecordResult::OutputEndsFull => {
                    return Err(Error::format(
                        &self.path,
                        format!("a longer row in line {line}"),
                        format!("rows of at most {ROW_BYTES} bytes and {COLUMNS} columns"),
                    ));
                }
            }
        }
    }
}

impl Convert {
    fn number(&self, column: usize, value: f64) -> f64 {
        (0..self.powers[column]).fold(value, |v, _| self.from.convert(v, self.to))
    }
}

impl<'a> Row<'a> {
    /// The bytes of field `column`.
    fn bytes(&self, column: usize) -> &'a [u8] {
        let start = column.checked_sub(1).map_or(0, |c| self.ends[c]);
        &self.fields[start..self.ends[column]]
    }

    /// The text of field `column`; empty if the value is missing.
    ///
    /// # Errors
    /// [`Error::Format`] if it is not UTF-8.
    pub fn text(&self, column: usize) -> Result<&'a str> {
        std::str::from_utf8(self.bytes(column))
            .map(str::trim)
            .map_err(|_| self.damage(column, "bytes that are not text"))
    }

    /// The number in field `column`, or `None` if the value is missing.
    ///
    /// # Errors
    /// [`Error::Format`] with line and column if it is not a finite number.
    pub fn number(&self, column: usize) -> Result<Option<f64>> {
        let text = self.text(column)?;
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(Some(self.convert.map_or(v, |c| c.number(column, v)))),
            _ => Err(self.damage(column, &format!("{text:?}"))),
        }
    }

    /// The whole number in field `column`.
    ///
    /// # Errors
    /// [`Error::Format`] with line and column if it is not a whole number from 0.
    pub fn whole(&self, column: usize) -> Result<u64> {
        let text = self.text(column)?;
        text.parse()
            .map_err(|_| self.damage(column, &format!("{text:?}")))
    }

    /// The whole number in field `column`, which may be below zero.
    ///
    /// # Errors
    /// [`Error::Format`] with line and column if it is none of 64 bits.
    pub fn signed(&self, column: usize) -> Result<i64> {
        let text = self.text(column)?;
        text.parse()
            .map_err(|_| self.damage(column, &format!("{text:?}")))
    }

    /// As [`signed`](Self::signed), of a field that may be empty.
    ///
    /// # Errors
    /// Those of [`signed`](Self::signed).
    pub fn signed_if_any(&self, column: usize) -> Result<Option<i64>> {
        match self.text(column)?.is_empty() {
            true => Ok(None),
            false => self.signed(column).map(Some),
        }
    }

    /// The value of field `column` as JSON: null if missing, a boolean for a condition, else a
    /// number.
    ///
    /// # Errors
    /// Those of [`Row::number`].
    pub fn json(&self, column: usize) -> Result<serde_json::Value> {
        let Some(v) = self.number(column)? else {
            return Ok(serde_json::Value::Null);
        };
        if self.columns[column].is_condition() {
            return Ok((v != 0.0).into());
        }
        let text = self.text(column)?;
        Ok(match (text.parse::<u64>(), text.parse::<i64>()) {
            (Ok(n), _) => n.into(),
            (_, Ok(n)) => n.into(),
            _ => v.into(),
        })
    }

    /// The row as a line of CSV without its end.
    ///
    /// # Errors
    /// [`Error::Format`] if a field is not text.
    pub fn line(&self) -> Result<String> {
        let fields: Vec<&str> = (0..self.columns.len())
            .map(|c| self.text(c))
            .collect::<Result<_>>()?;
        Ok(fields.join(","))
    }

    fn damage(&self, column: usize, found: &str) -> Error {
        Error::format(
            self.path,
            format!(
                "{found} in line {}, column {}",
                self.line, self.columns[column].name
            ),
            "a finite number or nothing",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn table(text: &[u8]) -> (tempfile::TempDir, Result<TableReader>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        let reader = TableReader::open(&path);
        (dir, reader)
    }

    #[test]
    fn rows_come_as_they_were_written() {
        let (_dir, reader) =
            table(b"id,volume [mm^3],touches_border\n1,0.5,0\n2,,1\r\n\n3,-1e3,1\n");
        let mut reader = reader.unwrap();
        assert_eq!(reader.columns()[1].unit, "mm^3");
        assert_eq!(reader.columns()[1].header(), "volume [mm^3]");
        let mut seen = Vec::new();
        let mut offsets = Vec::new();
        while let Some(row) = reader.next_row().unwrap() {
            seen.push((
                row.whole(0).unwrap(),
                row.number(1).unwrap(),
                row.json(2).unwrap(),
            ));
            offsets.push(row.offset);
        }
        assert_eq!(
            seen,
            [
                (1, Some(0.5), false.into()),
                (2, None, true.into()),
                (3, Some(-1000.0), true.into())
            ]
        );
        for (id, offset) in [(3, offsets[2]), (1, offsets[0]), (2, offsets[1])] {
            assert_eq!(reader.row_at(offset).unwrap().whole(0).unwrap(), id);
        }
        assert_eq!(reader.row_at(offsets[1]).unwrap().line().unwrap(), "2,,1");
    }

    #[test]
    fn damage_is_told_with_its_place() {
        for (text, part) in [
            (&b""[..], "empty"),
            (b"volume\n1\n", "`id`"),
            (b"id,id\n", "twice"),
            (b"\xff,id\n", "not text"),
        ] {
            let (_dir, reader) = table(text);
            let message = reader.unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        for (text, part) in [
            (&b"id,v\n1,2\n3\n"[..], "1 fields in line 3"),
            (b"id,v\n1,x\n", "line 2, column v"),
            (b"id,v\n1,nan\n", "line 2, column v"),
            (b"id,v\n1,\xff\n", "line 2, column v"),
        ] {
            let (_dir, reader) = table(text);
            let mut reader = reader.unwrap();
            let mut read = || -> Result<()> {
                while let Some(row) = reader.next_row()? {
                    row.number(1)?;
                }
                Ok(())
            };
            let message = read().unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        let long = [&b"id\n"[..], &vec![b'1'; 1 << 20]].concat();
        let (_dir, reader) = table(&long);
        assert!(reader.unwrap().next_row().is_err());
    }

    #[test]
    fn rows_are_found_by_id_whether_ids_rise_or_not() {
        let row = |id: u64| format!("{id},{}\n", "9".repeat(1 + id as usize % 50));
        let rising: Vec<u64> = (1..5000).map(|i| 3 * i).collect();
        let mixed: Vec<u64> = rising.iter().map(|i| i * 7919 % 15_013).collect();
        for ids in [&rising, &mixed, &vec![5], &vec![]] {
            let text: String = ids.iter().map(|&id| row(id)).collect();
            let (_dir, reader) = table(format!("id,v\n{text}").as_bytes());
            let mut reader = reader.unwrap();
            for id in ids
                .iter()
                .copied()
                .step_by(97)
                .chain([0, 1, 15_000, u64::MAX])
            {
                let found = reader
                    .find(id)
                    .unwrap()
                    .map(|row| row.line().unwrap() + "\n");
                assert_eq!(found, ids.contains(&id).then(|| row(id)), "{id}");
            }
            let mut all = 0;
            reader = reader.reopen().unwrap();
            while reader.next_row().unwrap().is_some() {
                all += 1;
            }
            assert_eq!(all, ids.len());
        }
        // an end of line in a field
        let text: String = (1..3000).map(|id| format!("{id},\"\n{id}\"\n")).collect();
        let (_dir, reader) = table(format!("id,v\n{text}").as_bytes());
        let mut reader = reader.unwrap();
        for id in [1, 2, 1500, 2999] {
            let row = reader.find(id).unwrap().unwrap();
            assert_eq!((row.whole(0).unwrap(), row.whole(1).unwrap()), (id, id));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            for text in [bytes.clone(), [&b"id,v\n"[..], &bytes].concat()] {
                let (_dir, reader) = table(&text);
                if let Ok(mut reader) = reader {
                    while let Ok(Some(row)) = reader.next_row() {
                        for c in 0..2.min(row.columns.len()) {
                            let _ = (row.number(c), row.json(c), row.whole(c));
                        }
                    }
                }
            }
        }
    }
}
