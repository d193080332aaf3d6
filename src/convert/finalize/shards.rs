//! Ends layers whose tiles are finished: writes their shards and says that they are done.

use crate::checkpoint::Checkpointer;
use crate::convert::finalize::FinishSettings;
use crate::convert::finalize::rewrite::Anew;
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
    /// Tiles that the writers had got by then: all of these parts' are among them.
    pub handed: u64,
}

/// Ends layers, part by part.
pub struct LayerFinisher<'a> {
    settings: FinishSettings<'a>,
    set: &'a mut TilesetWriter,
    anew: Anew,
    checkpointer: &'a mut Checkpointer,
    progress: &'a dyn Progress,
}

impl<'a> LayerFinisher<'a> {
    /// Of a set of `layers`, some of which may be finished already.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn begin(
        settings: &FinishSettings<'a>,
        set: &'a mut TilesetWriter,
        checkpointer: &'a mut Checkpointer,
        layers: usize,
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        Ok(LayerFinisher {
            settings: *settings,
            anew: Anew::begin(settings.dir, checkpointer.finished(), layers as u32)?,
            set,
            checkpointer,
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
            self.set.add(tile, text)?;
        }
        if !part.last {
            return Ok(());
        }
        if let Some(writers) = self.settings.writers {
            writers.wait_for(handed)?;
        }
        self.set.end_layer(part.layer)?;
        self.anew.layer_done(part.layer, self.checkpointer)?;
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

    /// Ends all, after the last layer.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn end(self) -> Result<()> {
        self.anew.end(self.checkpointer)
    }
}
