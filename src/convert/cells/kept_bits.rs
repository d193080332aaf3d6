//! The bits of a volume that is labelled, slice by slice.

use crate::convert::label::{KeptBand, KeptBands, span_of};
use crate::convert::layers::Layers;
use crate::error::Result;
use crate::grid::Tiling;
use crate::labels::{RowKinds, Span};
use crate::split::BitSource;

/// The bits that labelling has kept, slice by slice.
pub struct KeptBits<'a> {
    tiling: Tiling,
    layers: Layers,
    kept: &'a KeptBands,
    /// The layer at hand.
    layer: Option<Layer>,
}

/// What is known of the bands of a layer.
struct Layer {
    tz: u32,
    bands: Vec<(Span, KeptBand, RowKinds)>,
}

impl<'a> KeptBits<'a> {
    /// Of these layers.
    pub fn new(tiling: Tiling, layers: Layers, kept: &'a KeptBands) -> Self {
        KeptBits {
            tiling,
            layers,
            kept,
            layer: None,
        }
    }

    /// The bands of a layer.
    fn layer(&mut self, tz: u32) -> Result<&Layer> {
        if self.layer.as_ref().is_none_or(|layer| layer.tz != tz) {
            let (stored, tiling) = (self.kept, self.tiling);
            let [_, bands, _] = tiling.tiles();
            let before = u64::from(tz - self.layers.first) * u64::from(bands);
            let band = |ty: u32| {
                let span = span_of(tiling, ty, tz);
                let kept = stored.get(before + u64::from(ty))?;
                let kinds = stored.kinds(&kept, &span)?;
                Ok((span, kept, kinds))
            };
            let bands = (0..bands).map(band).collect::<Result<_>>()?;
            self.layer = Some(Layer { tz, bands });
        }
        Ok(self.layer.as_ref().expect("it was read"))
    }
}

impl BitSource for KeptBits<'_> {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
        let stored = self.kept;
        // the last slice of all is that of no layer of its own
        let tz = (z / self.tiling.macrocube[2]).min(self.layers.end - 1);
        let layer = self.layer(tz)?;
        for (span, kept, kinds) in &layer.bands {
            let row_words = (span.nx as usize).div_ceil(64);
            let first = (z - span.z.start) as usize * span.rows();
            let rows = first..first + span.rows();
            let mixed = kinds.mixed_before(rows.start)..kinds.mixed_before(rows.end);
            let mixed = stored.mixed_rows(kept, mixed, row_words)?;
            // the row that bands share comes from both
            let at = span.y.start as usize * row_words;
            let out = &mut words[at..][..span.rows() * row_words];
            kinds.fill_rows(rows, span.nx, &mixed, out);
        }
        Ok(())
    }
}
