//! Which cells border more than one object: their nodes have the object in their names.

use crate::error::{Error, Result};
use crate::sys::id_set::IdSet;
use crate::table::Table;
use crate::tileset::TileSet;

/// The cells with more than one surface, from the table of surfaces.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if the table is damaged.
pub(crate) fn several(set: &TileSet) -> Result<IdSet> {
    let manifest = set.manifest();
    let mut table = Table::Surfaces.open(set.dir(), manifest)?;
    let path = table.path().to_path_buf();
    let Some(column) = table.column("cell") else {
        return Err(Error::format(path, "none", "a column cell"));
    };
    let [mut seen, mut several] = [IdSet::default(), IdSet::default()];
    while let Some(row) = table.next_row()? {
        let cell = row.whole(column)?;
        if !seen.insert(cell) {
            several.insert(cell);
        }
    }
    Ok(several)
}
