//! Tiles in another form.

use crate::manifest::{Form, Primitives, TileEntry, checksum_text};
use crate::tile::read::ReadError;
use crate::tile::{TilePlace, recode, tile_path};
use crate::transform::ids::Ids;
use crate::transform::new_tiles::{MakeTile, NewTile};

/// Writes tiles in another form.
pub(crate) struct Recoder<'a> {
    pub form: Form,
    /// The cells that border more than one object.
    pub several: &'a Ids,
}

impl MakeTile for Recoder<'_> {
    type Sums = ();

    fn wants(&self, _: &TileEntry) -> bool {
        true
    }

    fn make(
        &self,
        entry: TileEntry,
        bytes: &[u8],
        place: &TilePlace,
    ) -> Result<Option<NewTile<()>>, ReadError> {
        let several = |cell| self.several.contains(cell);
        let made = recode(bytes, place, &self.form, &several)?;
        let entry = TileEntry {
            path: tile_path(entry.grid),
            strips: match self.form.primitives {
                Primitives::Strips => made.strips.unwrap_or(entry.strips),
                Primitives::Triangles => 0,
            },
            indices: made.indices,
            bytes: made.file.len() as u64,
            checksum: checksum_text(crc32fast::hash(&made.file)),
            ..entry
        };
        Ok(Some(NewTile {
            entry,
            file: made.file,
            sums: (),
        }))
    }
}
