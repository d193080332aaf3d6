//! Which cells border more than one object: their nodes have the object in their names.

use crate::error::{Error, Result};
use crate::table::Table;
use crate::tileset::TileSet;
use std::collections::HashMap;

/// A set of cells, in pages of 4,096: ids are dense, but those of a part are not.
#[derive(Debug, Default)]
pub(crate) struct Cells {
    pages: HashMap<u64, Box<[u64; 64]>>,
}

impl Cells {
    /// Adds a cell; false if it was there.
    fn insert(&mut self, cell: u64) -> bool {
        let page = self
            .pages
            .entry(cell / 4096)
            .or_insert_with(|| Box::new([0; 64]));
        let (word, bit) = ((cell / 64 % 64) as usize, 1 << (cell % 64));
        let new = page[word] & bit == 0;
        page[word] |= bit;
        new
    }

    /// True if the cell is in the set.
    pub fn contains(&self, cell: u64) -> bool {
        let page = self.pages.get(&(cell / 4096));
        page.is_some_and(|p| p[(cell / 64 % 64) as usize] & (1 << (cell % 64)) != 0)
    }
}

/// The cells with more than one surface, from the table of surfaces.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if the table is damaged.
pub(crate) fn several(set: &TileSet) -> Result<Cells> {
    let manifest = set.manifest();
    let mut table = Table::Surfaces.open(set.dir(), manifest)?;
    let path = table.path().to_path_buf();
    let Some(column) = table.column("cell") else {
        return Err(Error::format(path, "none", "a column cell"));
    };
    let [mut seen, mut several] = [Cells::default(), Cells::default()];
    while let Some(row) = table.next_row()? {
        let cell = row.whole(column)?;
        if !seen.insert(cell) {
            several.insert(cell);
        }
    }
    Ok(several)
}
