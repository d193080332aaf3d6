//! Rows of tables for the page: columns as numbers, one row as it is, and which rows a condition holds for.

use crate::error::{Error, Result};
use crate::manifest::Group;
use crate::sys::temp_file::unnamed;
use crate::table::{Column, Query, Table, find_column};
use crate::tileset::TileSet;
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
    [Table::Cells, Table::Objects, Table::Surfaces]
        .into_iter()
        .find(|table| table.name() == name)
}

/// Numbers in a file without a name, to be read from its beginning.
pub struct Columns {
    /// The file.
    pub file: File,
    /// Bytes of it.
    pub length: u64,
}

/// Ids and columns of a table: a header of 16 bytes, ids of 32 bits, then each column as floats of 32 bits, NaN where
/// there is no value. They lie in a temporary file, whatever the number of rows.
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
        waiting: vec![Vec::new(); 1 + chosen.len()],
    };
    let mut read = 0;
    while let Some(row) = reader.next_row()? {
        read += 1;
        if read > rows {
            break;
        }
        out.waiting[0].push(short(&path, row.whole(id)?)?);
        for (values, &column) in out.waiting[1..].iter_mut().zip(&chosen) {
            let value = row.number(column)?.map_or(f32::NAN, |v| v as f32);
            values.push(value.to_bits());
        }
        if out.waiting[0].len() == TOGETHER {
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
    /// The next values of each column, the ids first.
    waiting: Vec<Vec<u32>>,
}

impl Gathered {
    fn write(&mut self) -> std::io::Result<()> {
        let more = self.waiting[0].len() as u64;
        for (column, values) in (0u64..).zip(&mut self.waiting) {
            let bytes: Vec<u8> = values.drain(..).flat_map(u32::to_le_bytes).collect();
            let at = HEADER + 4 * (column * self.rows + self.done);
            self.file.write_all_at(&bytes, at)?;
        }
        self.done += more;
        Ok(())
    }

    fn finish(mut self, columns: usize) -> std::io::Result<Columns> {
        let words = [
            u32::from_le_bytes(*b"ALVC"),
            1,
            self.rows as u32,
            columns as u32,
        ];
        self.file.write_all_at(&bytes_of(&words), 0)?;
        self.file.seek(SeekFrom::Start(0))?;
        Ok(Columns {
            length: HEADER + 4 * self.rows * (1 + columns as u64),
            file: self.file,
        })
    }
}

fn bytes_of(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
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
    let columns = reader.columns().to_vec();
    let query = Query::default().filter(asked.condition, &columns)?.sort(
        asked.sort,
        asked.descending,
        &columns,
    )?;
    let ids = query.ids(&mut reader)?;
    let mut out = Vec::with_capacity(12 + 4 * ids.len());
    out.extend(bytes_of(&[
        u32::from_le_bytes(*b"ALVQ"),
        1,
        ids.len() as u32,
    ]));
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
    let Some(row) = reader.find(id)? else {
        return Ok(None);
    };
    let value = |(i, c): (usize, &Column)| -> Result<Value> {
        Ok(json!({"name": c.name, "unit": c.unit, "value": row.json(i)?}))
    };
    let columns: Vec<Value> = all.iter().enumerate().map(value).collect::<Result<_>>()?;
    let count = all.iter().position(|c| c.name == "tiles");
    let count = count.map(|column| row.whole(column)).transpose()?;
    let most = count.map_or(TILES, |n| n.min(TILES as u64) as usize);
    let tiles = tiles_of(set, table, id, most)?;
    Ok(Some(json!({"columns": columns, "tiles": tiles})))
}

/// The macrocubes of the first tiles that have triangles of a row.
fn tiles_of(set: &TileSet, table: Table, id: u64, most: usize) -> Result<Vec<[u32; 3]>> {
    let of = |group: &Group| match table {
        Table::Cells => group.cell,
        Table::Objects => group.object,
        Table::Surfaces => group.surface,
    };
    let mut found = Vec::new();
    let mut tiles = set.tiles();
    while found.len() < most
        && let Some(entry) = tiles.next().transpose()?
    {
        if entry.groups.iter().any(|group| of(group) == id) {
            found.push(entry.grid);
        }
    }
    Ok(found)
}
