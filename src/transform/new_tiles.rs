//! The tiles of one set made of those of another, layer by layer.

use crate::error::{Error, Result};
use crate::manifest::{Layer, TileEntry, entry_text};
use crate::progress::Progress;
use crate::tile::TilePlace;
use crate::tile::read::ReadError;
use crate::tileset::{TileSet, TilesetWriter, write_tile};

/// A tile of the new set.
pub(crate) struct NewTile<S> {
    /// Its entry in the index.
    pub entry: TileEntry,
    /// Its file.
    pub file: Vec<u8>,
    /// What it adds to sums that entries do not have.
    pub sums: S,
}

/// What makes tiles of tiles.
pub(crate) trait MakeTile: Sync {
    /// What the new set sums up of a tile beside its entry.
    type Sums: Send;

    /// False if nothing of a tile goes into the new set, which its entry tells.
    fn wants(&self, entry: &TileEntry) -> bool;

    /// Makes a tile of the bytes of another; `None` if nothing of it is left.
    ///
    /// # Errors
    /// [`ReadError`] if the tile is damaged.
    fn make(
        &self,
        entry: TileEntry,
        bytes: &[u8],
        place: &TilePlace,
    ) -> Result<Option<NewTile<Self::Sums>>, ReadError>;
}

/// Makes all tiles of a set, in as many threads as there are, and writes them with their entries; calls `each` with
/// the sums of each tile. Memory is a few tiles per thread.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`] if a tile or shard is damaged, [`Error::Interrupted`].
pub(crate) fn make_tiles<M: MakeTile>(
    set: &TileSet,
    maker: &M,
    writer: &mut TilesetWriter,
    progress: &dyn Progress,
    mut each: impl FnMut(M::Sums),
) -> Result<()> {
    let source = Source {
        set,
        maker,
        progress,
    };
    let layers = &set.manifest().layers;
    let total = layers.iter().map(|l| l.tiles).fold(0, u64::saturating_add);
    progress.begin("tiles", total);
    let dir = writer.dir().to_path_buf();
    for layer in layers {
        let tiles = set.manifest().shard_tiles(set.dir(), layer)?;
        writer.make_layer_directory(layer.z)?;
        let make = |entry| {
            let made = source.make(entry, layer)?;
            if let Some(tile) = &made {
                write_tile(&dir, tile.entry.grid, &tile.file)?;
            }
            progress.advance(1);
            Ok(made.map(|tile| (tile.entry, tile.sums)))
        };
        tiles.make_all(make, |made| {
            let Some((entry, sums)) = made else {
                return Ok(());
            };
            each(sums);
            writer.add(&entry, &entry_text(&entry))
        })?;
        writer.end_layer(layer.z)?;
    }
    Ok(())
}

/// Where the tiles come from.
struct Source<'a, M> {
    set: &'a TileSet,
    maker: &'a M,
    progress: &'a dyn Progress,
}

impl<M: MakeTile> Source<'_, M> {
    /// Makes a tile of one of a layer.
    fn make(&self, entry: TileEntry, layer: &Layer) -> Result<Option<NewTile<M::Sums>>> {
        if self.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let manifest = self.set.manifest();
        let tiling = manifest.tiling();
        let path = self.set.dir().join(&entry.path);
        let damaged = |found: String, expected: &str| {
            Error::format(&path, found, expected).with_hint("`alvis verify` says more")
        };
        let (grid, tiles) = (entry.grid, tiling.tiles());
        if grid[2] != layer.z || (0..3).any(|a| grid[a] >= tiles[a]) {
            let found = format!("macrocube {grid:?}");
            return Err(damaged(found, "one of the layer and grid"));
        }
        if !self.maker.wants(&entry) {
            return Ok(None);
        }
        let bytes = self.set.tile_bytes(&entry)?;
        let place = TilePlace {
            primitives: manifest.primitives,
            low: tiling.lowest(grid),
            dims: tiling.dims.0,
        };
        let made = self.maker.make(entry, &bytes, &place);
        made.map_err(|e| damaged(e.to_string(), "a tile"))
    }
}
