//! A band whose components are known: bits, runs, and the component of each run, as labelling has left them.

use crate::convert::label::KeptBand;
use crate::convert::label::KeptBands;
use crate::convert::resolve::{BandIds, ComponentId};
use crate::error::Result;
use crate::grid::Tiling;
use crate::labels::{Bits, RowKinds, Runs, Span};

/// A band; its buffers are used again.
#[derive(Debug, Default)]
pub struct KnownBand {
    /// Bits.
    pub bits: Bits,
    /// Runs.
    pub runs: Runs,
    /// Place in `components` of each run.
    pub class_of_run: Vec<u32>,
    /// The components of the whole volume that have voxels here.
    pub components: Vec<ComponentId>,
}

/// All bands of a volume that is labelled.
#[derive(Clone, Copy)]
pub struct KnownBands<'a> {
    /// The macrocubes.
    pub tiling: Tiling,
    /// The first layer whose bands there are.
    pub first: u32,
    /// Bits, and local components of runs.
    pub kept: &'a KeptBands,
    /// The components of the whole volume that these are.
    pub ids: &'a BandIds,
}

impl KnownBands<'_> {
    /// The number of band `ty` of layer `tz` among those that there are.
    pub fn number(&self, [ty, tz]: [u32; 2]) -> u64 {
        let [_, bands, _] = self.tiling.tiles();
        u64::from(tz - self.first) * u64::from(bands) + u64::from(ty)
    }

    /// Bytes that [`KnownBands::load`] takes for a band over `span`.
    pub fn bytes(kept: &KeptBand, span: &Span) -> u64 {
        let words = (span.nx as usize).div_ceil(64) * span.rows() * span.slices();
        // 8 bytes of bits, and again while they are read, 4 of run numbers; a class for each run, and its label while
        // that is read; the number of each component, and its place
        20 * words as u64 + 8 * kept.runs() + 40 * kept.components()
    }

    /// Fills `band` with the band of this number over `span`, whose rows are of these kinds.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(
        &self,
        number: u64,
        kept: &KeptBand,
        kinds: &RowKinds,
        span: Span,
        band: &mut KnownBand,
    ) -> Result<()> {
        let mixed = self.kept.mixed(kept)?;
        kinds.fill(&mut band.bits, span, &mixed);
        drop(mixed);
        band.runs.number(&band.bits);
        let class_of = self.classes(number, band)?;
        band.class_of_run.clear();
        band.class_of_run.reserve_exact(band.runs.count);
        match kept.has_surface() {
            true => self.kept.labels(kept, |label| {
                band.class_of_run.push(class_of[label as usize]);
            }),
            false => {
                band.class_of_run.resize(band.runs.count, class_of[0]);
                Ok(())
            }
        }
    }

    /// Finds the components of a band, and returns the place of each local one among them.
    fn classes(&self, number: u64, band: &mut KnownBand) -> Result<Vec<u32>> {
        let of_local = self.ids.get(number)?;
        let mut order: Vec<u32> = (0..of_local.len() as u32).collect();
        order.sort_unstable_by_key(|&local| of_local[local as usize].surface);
        let mut class_of = vec![0; of_local.len()];
        band.components.clear();
        for local in order {
            let id = of_local[local as usize];
            if band.components.last() != Some(&id) {
                band.components.push(id);
            }
            class_of[local as usize] = band.components.len() as u32 - 1;
        }
        Ok(class_of)
    }
}
