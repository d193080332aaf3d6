//! Shards, tile by tile: a layer of a porous scan may have millions of pieces, and memory holds one tile's.

use super::shard_text::{ShardFault, ShardText};
use super::{Shard, TileEntry};
use crate::error::{Error, Result};
use crate::store::File;
use std::io::BufReader;
use std::path::PathBuf;

/// Bytes that are read at a time.
const BUFFER: usize = 1 << 16;

/// The tiles of a layer, each read when it is asked for.
#[derive(Debug)]
pub struct ShardTiles {
    path: PathBuf,
    /// The layer that it should be.
    z: u32,
    text: Option<ShardText<BufReader<File>>>,
}

impl ShardTiles {
    /// Of the shard at `path`, a regular file, of layer `z`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn open(path: PathBuf, z: u32) -> Result<Self> {
        let file = File::open(&path).map_err(|e| Error::io(&path, "read the shard", e))?;
        let text = Some(ShardText::new(BufReader::with_capacity(BUFFER, file)));
        Ok(ShardTiles { path, z, text })
    }

    fn fail(&self, fault: ShardFault) -> Error {
        match fault {
            ShardFault::Io(e) => Error::io(&self.path, "read the shard", e),
            ShardFault::Json(found) => Error::format(&self.path, found, "a tile set's index"),
        }
    }
}

impl Iterator for ShardTiles {
    type Item = Result<TileEntry>;

    /// The next tile.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] if it is not the shard of that layer; it is over then.
    fn next(&mut self) -> Option<Self::Item> {
        let text = self.text.as_mut()?;
        let found = text.next_tile();
        let z = text.z().filter(|&z| z != self.z);
        if let (Ok(_), Some(z)) = (&found, z) {
            self.text = None;
            let [found, expected] = [z, self.z].map(|z| format!("layer {z}"));
            return Some(Err(Error::format(&self.path, found, expected)));
        }
        let found = found.map_err(|fault| self.fail(fault)).transpose();
        if !matches!(found, Some(Ok(_))) {
            self.text = None;
        }
        found
    }
}

impl Shard {
    /// All tiles of a shard at once.
    ///
    /// # Errors
    /// Those of [`ShardTiles`].
    pub(super) fn collect(tiles: ShardTiles) -> Result<Self> {
        let z = tiles.z;
        let tiles = tiles.collect::<Result<_>>()?;
        Ok(Shard { z, tiles })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::entry_text;
    use crate::manifest::shard_text::tests::tile;
    use crate::manifest::{ShardWriter, checksum_text};

    #[test]
    fn a_shard_comes_back_as_it_was_written() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("index")).unwrap();
        for tiles in [
            vec![],
            vec![tile(0, 0)],
            vec![tile(0, 3), tile(5, 2000), tile(6, 0)],
        ] {
            let mut writer = ShardWriter::create(dir.path(), 7).unwrap();
            tiles
                .iter()
                .for_each(|t| writer.write(t, &entry_text(t)).unwrap());
            let (layer, totals) = writer.finish().unwrap();
            let layer = layer.layer();
            let path = dir.path().join(&layer.path);
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(layer.path, "index/z0007.json");
            assert_eq!(
                (layer.bytes, layer.tiles),
                (bytes.len() as u64, tiles.len() as u64)
            );
            assert_eq!(layer.checksum, checksum_text(crc32fast::hash(&bytes)));
            assert_eq!(totals.triangles, tiles.len() as u64);
            let shard = Shard { z: 7, tiles };
            let whole = [&serde_json::to_vec(&shard).unwrap()[..], b"\n"].concat();
            assert_eq!(bytes, whole);
            assert_eq!(
                Shard::collect(ShardTiles::open(path.clone(), 7).unwrap()).unwrap(),
                shard
            );
            let other = ShardTiles::open(path, 8).unwrap().next().unwrap();
            assert!(other.unwrap_err().to_string().contains("layer 7"));
        }
    }
}
