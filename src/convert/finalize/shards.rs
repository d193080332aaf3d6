//! Ends layers whose tiles are finished: writes their shards and says that they are done.

use crate::checkpoint::Checkpointer;
use crate::error::Result;
use crate::manifest::{LayerRecord, TileEntry, Totals};
use crate::progress::Progress;
use crate::tileset::TilesetWriter;

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
}

/// Ends layers, part by part.
pub struct LayerFinisher<'a> {
    set: &'a mut TilesetWriter,
    checkpointer: &'a mut Checkpointer,
    progress: &'a dyn Progress,
}

impl<'a> LayerFinisher<'a> {
    /// Of a set, some layers of which may be finished already.
    pub fn begin(
        set: &'a mut TilesetWriter,
        checkpointer: &'a mut Checkpointer,
        progress: &'a dyn Progress,
    ) -> Self {
        LayerFinisher {
            set,
            checkpointer,
            progress,
        }
    }

    /// Layers that were finished before.
    pub fn finished(&self) -> u32 {
        self.checkpointer.finished()
    }

    /// Takes the next parts of layers. When one was the last of a layer, that is done.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn take(&mut self, made: FinishedBatch) -> Result<()> {
        let mut parts = made.parts.into_iter();
        parts.try_for_each(|part| self.take_part(part))
    }

    fn take_part(&mut self, part: Part) -> Result<()> {
        for (tile, text) in &part.tiles {
            self.set.add(tile, text)?;
        }
        if !part.last {
            return Ok(());
        }
        self.set.end_layer(part.layer)?;
        self.checkpointer.save_finished(part.layer + 1)?;
        self.checkpointer.disk().begin()?;
        self.progress.advance(1);
        Ok(())
    }

    /// Adds a layer that was finished before; without its entry if it has no tile.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(&mut self, layer: u32, finished: Option<FinishedLayer>) -> Result<()> {
        self.progress.advance(1);
        match finished {
            Some(finished) => self.set.add_layer(finished.entry, &finished.totals),
            None => self.set.end_layer(layer),
        }
    }
}
