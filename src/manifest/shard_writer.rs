//! Writes shards, tile by tile.

use super::{LayerRecord, TileEntry, Totals};
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Where the shard of a layer lies.
pub(crate) fn shard_path(layer: u32) -> String {
    format!("index/z{layer:04}.json")
}

/// Writes a layer's shard, tile by tile, and adds up its tiles. It gets its name when it is whole.
pub(crate) struct ShardWriter {
    dir: PathBuf,
    path: PathBuf,
    name: String,
    z: u32,
    file: BufWriter<File>,
    bytes: u64,
    crc: crc32fast::Hasher,
    totals: Totals,
}

impl ShardWriter {
    /// Of layer `z` of the tile set in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(dir: &Path, z: u32) -> Result<Self> {
        let name = shard_path(z);
        let path = dir.join(format!("{name}.new"));
        let file = File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
        let mut shard = ShardWriter {
            dir: dir.to_path_buf(),
            path,
            name,
            z,
            file: BufWriter::new(file),
            bytes: 0,
            crc: crc32fast::Hasher::new(),
            totals: Totals::default(),
        };
        shard.put(format!("{{\"z\":{z},\"tiles\":[").as_bytes())?;
        Ok(shard)
    }

    fn put(&mut self, text: &[u8]) -> Result<()> {
        self.bytes += text.len() as u64;
        self.crc.update(text);
        self.file
            .write_all(text)
            .map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Adds a tile, `text` as [`entry_text`] makes it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&mut self, tile: &TileEntry, text: &[u8]) -> Result<()> {
        if self.totals.tiles > 0 {
            self.put(b",")?;
        }
        self.put(text)?;
        self.totals.add_tile(tile);
        Ok(())
    }

    /// Ends it; returns the layer and its part of the totals: tiles, vertices, triangles, strips and bytes.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(mut self) -> Result<(LayerRecord, Totals)> {
        self.put(b"]}\n")?;
        self.file
            .flush()
            .map_err(|e| Error::io(&self.path, "write", e))?;
        let to = self.dir.join(&self.name);
        std::fs::rename(&self.path, &to).map_err(|e| Error::io(&to, "move into place", e))?;
        let layer = LayerRecord {
            z: self.z,
            crc: self.crc.finalize(),
            tiles: self.totals.tiles,
            bytes: self.bytes,
        };
        Ok((layer, self.totals))
    }
}

/// A tile as a shard has it.
pub(crate) fn entry_text(tile: &TileEntry) -> Vec<u8> {
    serde_json::to_vec(tile).expect("plain data serialises")
}
