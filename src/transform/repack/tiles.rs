//! The tiles and shards, layer by layer.

use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::manifest::{
    Form, Layer, Manifest, Primitives, ShardWriter, TileEntry, Totals, checksum_text,
};
use crate::progress::Progress;
use crate::sys::files::write_file;
use crate::tile::{TilePlace, recode, tile_path};
use crate::tileset::TileSet;
use crate::transform::repack::names::Cells;
use std::path::Path;

/// What all tiles have in common.
pub(crate) struct Repacker<'a> {
    pub set: &'a TileSet,
    /// Where to write.
    pub to: &'a Path,
    pub tiling: Tiling,
    pub form: Form,
    /// The cells that border more than one object.
    pub several: &'a Cells,
    pub progress: &'a dyn Progress,
}

impl Repacker<'_> {
    /// Writes all layers and brings the manifest's layers and sums up to date.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] if a tile or shard is damaged, [`Error::Interrupted`].
    pub fn run(&self, made: &mut Manifest) -> Result<()> {
        let layers = &self.set.manifest().layers;
        let total = layers.iter().map(|l| l.tiles).fold(0, u64::saturating_add);
        self.progress.begin("tiles", total);
        let t = made.totals;
        made.totals = Totals {
            strips: 0,
            strip_indices: 0,
            bytes: 0,
            ..t
        };
        made.layers.clear();
        for layer in layers {
            made.layers.push(self.layer(layer, &mut made.totals)?);
        }
        Ok(())
    }

    fn layer(&self, layer: &Layer, totals: &mut Totals) -> Result<Layer> {
        let dir = self.to.join(format!("tiles/z{:04}", layer.z));
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
        let make = |entry: TileEntry| {
            if self.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let made = self.tile(entry, layer.z)?;
            self.progress.advance(1);
            Ok(made)
        };
        let mut shard = ShardWriter::create(self.to, layer.z)?;
        let tiles = self.set.manifest().shard_tiles(self.set.dir(), layer)?;
        tiles.make_all(make, |tile| {
            totals.bytes += tile.bytes;
            // as the old index has it, which may say anything
            totals.strips = totals.strips.saturating_add(tile.strips);
            if tile.strips > 0 {
                totals.strip_indices += tile.indices;
            }
            shard.add(&tile)
        })?;
        shard.finish().map(|(layer, _)| layer.layer())
    }

    fn tile(&self, entry: TileEntry, z: u32) -> Result<TileEntry> {
        let tiles = self.tiling.tiles();
        let damaged = |found: String, expected: &str| {
            let path = self.set.dir().join(&entry.path);
            Error::format(path, found, expected).with_hint("`alvis verify` says more")
        };
        if entry.grid[2] != z || (0..3).any(|a| entry.grid[a] >= tiles[a]) {
            let found = format!("macrocube {:?}", entry.grid);
            return Err(damaged(found, "one of the layer and grid"));
        }
        let bytes = self.set.tile_bytes(&entry)?;
        let place = TilePlace {
            primitives: self.set.manifest().primitives,
            low: self.tiling.lowest(entry.grid),
            dims: self.tiling.dims.0,
        };
        let made = recode(&bytes, &place, &self.form, &|cell| {
            self.several.contains(cell)
        })
        .map_err(|e| damaged(e.to_string(), "a tile"))?;
        let path = tile_path(entry.grid);
        write_file(&self.to.join(&path), &[&made.file])?;
        Ok(TileEntry {
            path,
            strips: match self.form.primitives {
                Primitives::Strips => made.strips.unwrap_or(entry.strips),
                Primitives::Triangles => 0,
            },
            indices: made.indices,
            bytes: made.file.len() as u64,
            checksum: checksum_text(crc32fast::hash(&made.file)),
            ..entry
        })
    }
}
