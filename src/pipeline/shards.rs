//! Ends layers whose tiles are finished: writes their shards and says that they are done.

use crate::error::{Error, Result};
use crate::manifest::{Layer, TileEntry, Totals, checksum_text};
use crate::pipeline::anew::Anew;
use crate::pipeline::finish::FinishSettings;
use crate::pipeline::keep::Keeper;
use crate::progress::Progress;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A finished layer.
pub struct FinishedLayer {
    /// Its entry in the manifest.
    pub entry: Layer,
    /// Its part of the totals: tiles, vertices, triangles, strips and bytes.
    pub totals: Totals,
}

/// Some tiles of a layer with their entries, also as JSON.
pub struct Part {
    /// The layer.
    pub layer: u32,
    /// The tiles.
    pub tiles: Vec<(TileEntry, Vec<u8>)>,
    /// No others of this layer come behind them.
    pub last: bool,
}

/// What was made of a batch of tiles.
#[derive(Default)]
pub struct FinishedBatch {
    /// Parts of layers.
    pub parts: Vec<Part>,
    /// Tiles that the writers had got by then: all of these parts' are among them.
    pub handed: u64,
}

/// Ends layers, part by part.
pub struct Ends<'a> {
    settings: FinishSettings<'a>,
    /// The shard of the layer at hand.
    open: Option<ShardWriter>,
    anew: Anew,
    layers: Vec<Layer>,
    keeper: &'a mut Keeper,
    totals: &'a mut Totals,
    progress: &'a dyn Progress,
}

impl<'a> Ends<'a> {
    /// Of a set of `layers`, some of which may be finished already.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(
        settings: &FinishSettings<'a>,
        keeper: &'a mut Keeper,
        layers: usize,
        totals: &'a mut Totals,
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        Ok(Ends {
            settings: *settings,
            open: None,
            anew: Anew::begin(settings.dir, keeper.finished(), layers as u32)?,
            layers: Vec::new(),
            keeper,
            totals,
            progress,
        })
    }

    /// Layers that were finished before.
    pub fn finished(&self) -> u32 {
        self.keeper.finished()
    }

    /// Takes the next parts of layers. When one was the last of a layer, all tiles of that are written.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn take(&mut self, made: FinishedBatch) -> Result<()> {
        let mut parts = made.parts.into_iter();
        parts.try_for_each(|part| self.take_part(part, made.handed))
    }

    fn take_part(&mut self, part: Part, handed: u64) -> Result<()> {
        for (tile, text) in &part.tiles {
            let shard = match &mut self.open {
                Some(shard) => shard,
                None => self
                    .open
                    .insert(ShardWriter::create(self.settings.dir, part.layer)?),
            };
            shard.write(tile, text)?;
        }
        if !part.last {
            return Ok(());
        }
        if let Some(writers) = self.settings.writers {
            writers.wait_for(handed)?;
        }
        let shard = self.open.take();
        let finished = shard.map(|s| s.finish(part.layer)).transpose()?;
        self.anew.layer_done(part.layer, self.keeper)?;
        self.add(finished);
        Ok(())
    }

    /// Adds a layer that is finished; `None` if it has no tile.
    pub fn add(&mut self, finished: Option<FinishedLayer>) {
        self.progress.advance(1);
        let Some(finished) = finished else { return };
        let (totals, part) = (&mut *self.totals, finished.totals);
        totals.tiles += part.tiles;
        totals.tile_vertices += part.tile_vertices;
        totals.triangles += part.triangles;
        totals.strips += part.strips;
        totals.strip_indices += part.strip_indices;
        totals.bytes += part.bytes;
        self.layers.push(finished.entry);
    }

    /// The layers with tiles, after all of them.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn end(self) -> Result<Vec<Layer>> {
        self.anew.end(self.keeper)?;
        Ok(self.layers)
    }
}

/// Where the shard of a layer lies.
pub fn shard_path(layer: u32) -> String {
    format!("index/z{layer:04}.json")
}

/// Writes a layer's shard, tile by tile, and adds up its tiles. It gets its name when it is whole.
struct ShardWriter {
    dir: PathBuf,
    path: PathBuf,
    name: String,
    file: BufWriter<File>,
    bytes: u64,
    crc: crc32fast::Hasher,
    totals: Totals,
}

impl ShardWriter {
    fn create(dir: &Path, layer: u32) -> Result<Self> {
        let name = shard_path(layer);
        let path = dir.join(format!("{name}.new"));
        let file = File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
        let mut shard = ShardWriter {
            dir: dir.to_path_buf(),
            path,
            name,
            file: BufWriter::new(file),
            bytes: 0,
            crc: crc32fast::Hasher::new(),
            totals: Totals::default(),
        };
        shard.put(format!("{{\"z\":{layer},\"tiles\":[").as_bytes())?;
        Ok(shard)
    }

    fn put(&mut self, text: &[u8]) -> Result<()> {
        self.bytes += text.len() as u64;
        self.crc.update(text);
        self.file
            .write_all(text)
            .map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Adds a tile, `text` in JSON.
    fn write(&mut self, tile: &TileEntry, text: &[u8]) -> Result<()> {
        if self.totals.tiles > 0 {
            self.put(b",")?;
        }
        self.put(text)?;
        self.totals.add_tile(tile);
        Ok(())
    }

    fn finish(mut self, layer: u32) -> Result<FinishedLayer> {
        self.put(b"]}\n")?;
        self.file
            .flush()
            .map_err(|e| Error::io(&self.path, "write", e))?;
        let to = self.dir.join(&self.name);
        std::fs::rename(&self.path, &to).map_err(|e| Error::io(&to, "move into place", e))?;
        let entry = Layer {
            z: layer,
            path: self.name,
            tiles: self.totals.tiles,
            bytes: self.bytes,
            checksum: checksum_text(self.crc.finalize()),
        };
        Ok(FinishedLayer {
            entry,
            totals: self.totals,
        })
    }
}
