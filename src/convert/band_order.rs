//! The bands of a volume by number, how far work on its layers has come, and whether it goes on.

use crate::error::{Error, Result};

/// Layers that end one after the other, and their bands.
#[derive(Debug)]
pub struct BandOrder {
    /// Bands of a layer.
    pub bands: u32,
    /// Layers of the volume.
    pub layers: u32,
    /// The next layer to end.
    pub layer: u32,
    /// The layer in hand when it was interrupted, which is the last to be begun.
    pub last: Option<u32>,
    failed: Option<Error>,
}

impl BandOrder {
    /// Begins with `layer`.
    pub fn new([bands, layers]: [u32; 2], layer: u32) -> Self {
        BandOrder {
            bands,
            layers,
            layer,
            last: None,
            failed: None,
        }
    }

    /// The number of a layer's first band: by layer, then y.
    pub fn first_of(&self, layer: u32) -> u64 {
        u64::from(layer) * u64::from(self.bands)
    }

    /// The place (y, layer) of a band.
    pub fn place(&self, number: u64) -> [u32; 2] {
        let bands = u64::from(self.bands);
        [(number % bands) as u32, (number / bands) as u32]
    }

    /// The number of the band at a place.
    pub fn number(&self, [ty, layer]: [u32; 2]) -> u64 {
        self.first_of(layer) + u64::from(ty)
    }

    /// True if all has ended or something has failed; to be `interrupted` is to fail once the layer in hand has ended.
    pub fn is_over(&mut self, interrupted: bool) -> bool {
        if interrupted && self.layer < self.layers {
            // to end the layer in hand takes less time than to come back to it
            self.last.get_or_insert(self.layer);
        }
        if self.last.is_some_and(|last| self.layer > last) && self.layer < self.layers {
            self.fail(Error::Interrupted);
        }
        self.failed.is_some() || self.layer == self.layers
    }

    /// Something has failed; nothing new is begun.
    pub fn fail(&mut self, error: Error) {
        self.failed.get_or_insert(error);
    }

    /// How it came out, when no thread has anything in hand.
    ///
    /// # Errors
    /// What has failed.
    pub fn outcome(self) -> Result<()> {
        self.failed.map_or(Ok(()), Err)
    }
}
