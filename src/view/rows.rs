//! Rows of tables for the page: columns as numbers, one row as it is, and which rows a condition holds for.

use crate::error::{Error, Result};
use crate::sys::temp_file::unnamed;
use crate::table::{Query, Row, Table, TableReader, find_column};
use crate::tileset::TileSet;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::os::unix::fs::FileExt;

/// Rows that are gathered before they are written.
const TOGETHER: usize = 1 << 16;
/// Bytes before the columns.
const HEADER: u64 = 16;
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
    let mut reader = table.open(set.dir(), set.manifest())?;
    let chosen: Vec<usize> = names
        .iter()
        .map(|name| find_column("columns", name, reader.columns()))
        .collect::<Result<_>>()?;
    let id = reader.own_column("id")?;
    // the index tells how many rows there are, which says where columns begin
    let rows = table.total(set.manifest());
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
        out.waiting[0].push(short_id(&reader_path(set, table), row.whole(id)?)?);
        for (values, &column) in out.waiting[1..].iter_mut().zip(&chosen) {
            let value = row.number(column)?.map_or(f32::NAN, |v| v as f32);
            values.push(value.to_bits());
        }
        if out.waiting[0].len() == TOGETHER {
            out.write().map_err(failed)?;
        }
    }
    if read != rows {
        let found = if read > rows {
            "more rows".to_owned()
        } else {
            format!("{read} rows")
        };
        return Err(Error::format(
            reader.path(),
            found,
            format!("{rows} rows as in the index"),
        ));
    }
    out.write().map_err(failed)?;
    out.finish(chosen.len()).map_err(failed)
}

fn reader_path(set: &TileSet, table: Table) -> std::path::PathBuf {
    set.dir().join(table.file())
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
            u32::try_from(self.rows).unwrap_or(u32::MAX),
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

fn short_id(path: &std::path::Path, id: u64) -> Result<u32> {
    u32::try_from(id).map_err(|_| Error::format(path, format!("the id {id}"), "ids of 32 bits"))
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
        out.extend(short_id(reader.path(), id)?.to_le_bytes());
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
    let column = reader.own_column("id")?;
    let Some(columns) = values(&mut reader, column, id)? else {
        return Ok(None);
    };
    let mut tiles = Vec::new();
    for entry in set.tiles() {
        let entry = entry?;
        let of = |group: &crate::manifest::Group| match table {
            Table::Cells => group.cell,
            Table::Objects => group.object,
            Table::Surfaces => group.surface,
        };
        if entry.groups.iter().any(|group| of(group) == id) {
            tiles.push(entry.grid);
        }
        if tiles.len() == TILES {
            break;
        }
    }
    Ok(Some(json!({"columns": columns, "tiles": tiles})))
}

fn values(reader: &mut TableReader, column: usize, id: u64) -> Result<Option<Vec<Value>>> {
    let columns = reader.columns().to_vec();
    while let Some(row) = reader.next_row()? {
        if row.whole(column)? == id {
            let value = |(i, c): (usize, &crate::table::Column)| -> Result<Value> {
                Ok(json!({"name": c.name, "unit": c.unit, "value": Row::json(&row, i)?}))
            };
            return columns
                .iter()
                .enumerate()
                .map(value)
                .collect::<Result<_>>()
                .map(Some);
        }
    }
    Ok(None)
}
