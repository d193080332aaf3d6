//! Sets of ids, and which cells border more than one object: their nodes have the object in their names.

use crate::error::{Error, Result};
use crate::table::Table;
use crate::tileset::TileSet;
use std::collections::HashMap;

/// A set of ids, in pages of 4,096: ids are dense, but those of a part are not.
#[derive(Debug, Default)]
pub(crate) struct Ids {
    pages: HashMap<u64, Box<[u64; 64]>>,
}

impl Ids {
    /// Adds an id; false if it was there.
    pub fn insert(&mut self, id: u64) -> bool {
        let page = self
            .pages
            .entry(id / 4096)
            .or_insert_with(|| Box::new([0; 64]));
        let (word, bit) = ((id / 64 % 64) as usize, 1 << (id % 64));
        let new = page[word] & bit == 0;
        page[word] |= bit;
        new
    }

    /// True if the id is in the set.
    pub fn contains(&self, id: u64) -> bool {
        let page = self.pages.get(&(id / 4096));
        page.is_some_and(|p| p[(id / 64 % 64) as usize] & (1 << (id % 64)) != 0)
    }
}

/// The cells with more than one surface, from the table of surfaces.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if the table is damaged.
pub(crate) fn several(set: &TileSet) -> Result<Ids> {
    let manifest = set.manifest();
    let mut table = Table::Surfaces.open(set.dir(), manifest)?;
    let path = table.path().to_path_buf();
    let Some(column) = table.column("cell") else {
        return Err(Error::format(path, "none", "a column cell"));
    };
    let [mut seen, mut several] = [Ids::default(), Ids::default()];
    while let Some(row) = table.next_row()? {
        let cell = row.whole(column)?;
        if !seen.insert(cell) {
            several.insert(cell);
        }
    }
    Ok(several)
}
