//! Rows of tables for the page: columns as numbers, one row as it is, and which rows a condition holds for.

use crate::error::{Error, Result};
use crate::sys::temp_file::unnamed;
use crate::table::{Column, Query, Table, find_column};
use crate::tile::PieceIds;
use crate::tileset::TileSet;
use crate::view::put;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Rows that are gathered before they are written.
const TOGETHER: usize = 1 << 16;
/// Bytes before the columns.
const HEADER: u64 = 16;
/// Columns that are sent at once.
const MOST_COLUMNS: usize = 64;
/// Tiles that are named of a row at most.
const TILES: usize = 4096;

/// The table of a name.
pub fn table(name: &str) -> Option<Table> {
    Table::ALL.into_iter().find(|table| table.name() == name)
}

/// Numbers in a file without a name, to be read from its beginning.
pub struct Columns {
    /// The file.
    pub file: File,
    /// Bytes of it.
    pub length: u64,
}

/// Ids and columns of a table: a header of 16 bytes, ids of 32 bits, zeros up to a multiple of 8 bytes, then each column as
/// floats of 64 bits, NaN where there is no value. They lie in a temporary file, whatever the number of rows.
///
/// # Errors
/// [`Error::Usage`] for a column that is not there; [`Error::Io`] and [`Error::Format`] of the table.
pub fn columns(set: &TileSet, table: Table, names: &[&str]) -> Result<Columns> {
    if names.len() > MOST_COLUMNS {
        let expected = format!("{MOST_COLUMNS} at most");
        return Err(Error::usage(
            "columns",
            format!("{} of them", names.len()),
            expected,
        ));
    }
    let mut reader = table.open(set.dir(), set.manifest())?;
    let chosen: Vec<usize> = names
        .iter()
        .map(|name| find_column("columns", name, reader.columns()))
        .collect::<Result<_>>()?;
    let (id, path) = (reader.own_column("id")?, reader.path().to_path_buf());
    // the index tells how many rows there are, which says where columns begin
    let rows = u64::from(short(&path, table.total(set.manifest()))?);
    let dir = std::env::temp_dir();
    let failed = |e| Error::io(&dir, "write a temporary file", e);
    let mut out = Gathered {
        file: unnamed(&dir).map_err(failed)?,
        rows,
        done: 0,
        ids: Vec::new(),
        values: vec![Vec::new(); chosen.len()],
    };
    let mut read = 0;
    while let Some(row) = reader.next_row()? {
        read += 1;
        if read > rows {
            break;
        }
        out.ids.push(short(&path, row.whole(id)?)?);
        for (values, &column) in out.values.iter_mut().zip(&chosen) {
            values.push(row.number(column)?.unwrap_or(f64::NAN));
        }
        if out.ids.len() == TOGETHER {
            out.write().map_err(failed)?;
        }
    }
    if read != rows {
        let found = match read > rows {
            true => "more rows".to_owned(),
            false => format!("{read} rows"),
        };
        let expected = format!("{rows} rows as in the index");
        return Err(Error::format(&path, found, expected));
    }
    out.write().map_err(failed)?;
    out.finish(chosen.len()).map_err(failed)
}

/// Columns of which a part is in memory.
struct Gathered {
    file: File,
    rows: u64,
    /// Rows that are written.
    done: u64,
    /// The next ids.
    ids: Vec<u32>,
    /// The next values of each column.
    values: Vec<Vec<f64>>,
}

impl Gathered {
    fn write(&mut self) -> std::io::Result<()> {
        let more = self.ids.len() as u64;
        let bytes: Vec<u8> = self.ids.drain(..).flat_map(u32::to_le_bytes).collect();
        self.file.write_all_at(&bytes, HEADER + 4 * self.done)?;
        let first = self.values_at();
        for (column, values) in (0u64..).zip(&mut self.values) {
            let bytes: Vec<u8> = values.drain(..).flat_map(f64::to_le_bytes).collect();
            let at = first + 8 * (column * self.rows + self.done);
            self.file.write_all_at(&bytes, at)?;
        }
        self.done += more;
        Ok(())
    }

    /// Where the columns begin.
    fn values_at(&self) -> u64 {
        (HEADER + 4 * self.rows).next_multiple_of(8)
    }

    fn finish(mut self, columns: usize) -> std::io::Result<Columns> {
        let mut head = Vec::new();
        put(
            &mut head,
            &[
                u32::from_le_bytes(*b"ALVC"),
                2,
                self.rows as u32,
                columns as u32,
            ],
        );
        self.file.write_all_at(&head, 0)?;
        let length = self.values_at() + 8 * self.rows * columns as u64;
        self.file.set_len(length)?;
        self.file.seek(SeekFrom::Start(0))?;
        Ok(Columns {
            length,
            file: self.file,
        })
    }
}

/// An id, or a number of rows, as the page takes it.
fn short(path: &Path, number: u64) -> Result<u32> {
    u32::try_from(number).map_err(|_| {
        let expected = "ids and rows that 32 bits can count";
        Error::format(path, number.to_string(), expected)
    })
}

/// What is asked of a table.
#[derive(Debug, Clone, Copy, Default)]
pub struct Asked<'a> {
    /// As `alvis cells --where` takes it.
    pub condition: Option<&'a str>,
    /// As `--sort` takes it.
    pub sort: Option<&'a str>,
    /// As `--descending`.
    pub descending: bool,
}

/// The ids of rows in order: a header of 12 bytes, then 32 bits each.
///
/// # Errors
/// [`Error::Usage`] for an expression that cannot be; [`Error::Io`] and [`Error::Format`] of the table.
pub fn query(set: &TileSet, table: Table, asked: &Asked) -> Result<Vec<u8>> {
    let mut reader = table.open(set.dir(), set.manifest())?;
    let columns = reader.columns();
    let query = Query::default().filter(asked.condition, columns)?;
    let query = query.sort(asked.sort, asked.descending, columns)?;
    let ids = query.ids(&mut reader)?;
    let mut out = Vec::with_capacity(12 + 4 * ids.len());
    put(
        &mut out,
        &[u32::from_le_bytes(*b"ALVQ"), 1, ids.len() as u32],
    );
    for id in ids {
        out.extend(short(reader.path(), id)?.to_le_bytes());
    }
    Ok(out)
}

/// A row with its exact values, and the macrocubes of the tiles that have triangles of it. `None` if there is none with
/// this id.
///
/// # Errors
/// [`Error::Io`] and [`Error::Format`] of the table and the index.
pub fn row(set: &TileSet, table: Table, id: u64) -> Result<Option<Value>> {
    let mut reader = table.open(set.dir(), set.manifest())?;
    let all = reader.columns().to_vec();
    let count = reader.column("tiles");
    let Some(row) = reader.find(id)? else {
        return Ok(None);
    };
    let value = |(i, c): (usize, &Column)| -> Result<Value> {
        Ok(json!({"name": c.name, "unit": c.unit, "value": row.json(i)?}))
    };
    let columns: Vec<Value> = all.iter().enumerate().map(value).collect::<Result<_>>()?;
    let count = count.map(|column| row.whole(column)).transpose()?;
    let most = count.map_or(TILES, |n| n.min(TILES as u64) as usize);
    let tiles = tiles_of(set, table, id, most)?;
    Ok(Some(json!({"columns": columns, "tiles": tiles})))
}

/// The macrocubes of the first tiles that have triangles of a row.
fn tiles_of(set: &TileSet, table: Table, id: u64, most: usize) -> Result<Vec<[u32; 3]>> {
    let mut found = Vec::new();
    let mut tiles = set.tiles();
    while found.len() < most
        && let Some(entry) = tiles.next().transpose()?
    {
        if entry
            .groups
            .iter()
            .any(|group| PieceIds::from(group).of(table) == id)
        {
            found.push(entry.grid);
        }
    }
    Ok(found)
}
