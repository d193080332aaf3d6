//! Ends layers whose tiles are finished: writes their shards and says that they are done.

use crate::checkpoint::Checkpointer;
use crate::convert::finalize::FinishSettings;
use crate::convert::finalize::rewrite::Anew;
use crate::error::Result;
use crate::manifest::{LayerRecord, ShardWriter, TileEntry, Totals};
use crate::progress::Progress;
use crate::sys::spill_file::SpillFile;
use std::path::Path;

/// A finished layer.
pub struct FinishedLayer {
    /// Its entry in the manifest.
    pub entry: LayerRecord,
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
pub struct LayerFinisher<'a> {
    settings: FinishSettings<'a>,
    /// The shard of the layer at hand.
    open: Option<ShardWriter>,
    anew: Anew,
    layers: Layers,
    checkpointer: &'a mut Checkpointer,
    totals: &'a mut Totals,
    progress: &'a dyn Progress,
}

impl<'a> LayerFinisher<'a> {
    /// Of a set of `layers`, some of which may be finished already.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn begin(
        settings: &FinishSettings<'a>,
        checkpointer: &'a mut Checkpointer,
        layers: usize,
        totals: &'a mut Totals,
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        Ok(LayerFinisher {
            settings: *settings,
            open: None,
            anew: Anew::begin(settings.dir, checkpointer.finished(), layers as u32)?,
            layers: Layers::new(settings.dir)?,
            checkpointer,
            totals,
            progress,
        })
    }

    /// Layers that were finished before.
    pub fn finished(&self) -> u32 {
        self.checkpointer.finished()
    }

    /// Takes the next parts of layers. When one was the last of a layer, all tiles of that are written.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
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
        let finished = shard.map(ShardWriter::finish).transpose()?;
        self.anew.layer_done(part.layer, self.checkpointer)?;
        self.add(finished.map(|(entry, totals)| FinishedLayer { entry, totals }))
    }

    /// Adds a layer that is finished; `None` if it has no tile.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(&mut self, finished: Option<FinishedLayer>) -> Result<()> {
        self.progress.advance(1);
        let Some(finished) = finished else {
            return Ok(());
        };
        let (totals, part) = (&mut *self.totals, finished.totals);
        totals.tiles += part.tiles;
        totals.tile_vertices += part.tile_vertices;
        totals.triangles += part.triangles;
        totals.strips += part.strips;
        totals.strip_indices += part.strip_indices;
        totals.bytes += part.bytes;
        self.layers.push(finished.entry)
    }

    /// The layers with tiles, after all of them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn end(self) -> Result<Layers> {
        self.anew.end(self.checkpointer)?;
        Ok(self.layers)
    }
}

/// The layers that have tiles, by rising z, in a file.
pub struct Layers {
    spool: SpillFile,
    /// Bytes of their shards.
    pub bytes: u64,
}

impl Layers {
    fn new(dir: &Path) -> Result<Self> {
        Ok(Layers {
            spool: SpillFile::new(dir)?,
            bytes: 0,
        })
    }

    fn push(&mut self, layer: LayerRecord) -> Result<()> {
        self.bytes += layer.bytes;
        self.spool.push(&[layer]).map(|_| ())
    }

    /// Calls `each` with all of them.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `each` returns.
    pub fn for_each(&mut self, each: impl FnMut(LayerRecord) -> Result<()>) -> Result<()> {
        let all = self.spool.everything().expect("it holds nothing else");
        self.spool.for_each(&all, each)
    }
}
