//! Slabs of which some bands are in memory at a time: read once to label them, once more to mesh them.

use crate::convert::scan::band::{Band, BandSource, SealedBand};
use crate::convert::scan::collect::{SlabTiles, TileCollector};
use crate::convert::scan::mode::Parts;
use crate::convert::scan::slab::Slab;
use crate::convert::scan::state::{ScanState, SlabLabels};
use crate::convert::scan::tiles::take_classes;
use crate::convert::scan::{Carried, MadeSlab, Sweep};
use crate::error::{Error, Result};
use crate::sys::background_writer::BackgroundWriters;
use crate::volume::Voxel;
use rayon::prelude::*;

impl Sweep<'_> {
    /// Sweeps one slab a few bands at a time.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub fn sweep_slab_in_parts<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        carried: &mut Carried,
    ) -> Result<()> {
        let sealed = self.seal_in_parts(parts, layer, carried.state)?;
        let known = self.join(sealed, layer, carried.state)?;
        self.mesh_and_end(parts, layer, &known, carried)
    }

    /// Makes the tiles of a layer whose classes are known, and keeps it. What comes before it has ended.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub fn mesh_and_end<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        known: &SlabLabels,
        carried: &mut Carried,
    ) -> Result<()> {
        let slab = MadeSlab {
            layer,
            known,
            tiles: self.mesh_in_parts(parts, layer, carried.state, known)?,
        };
        self.end_slab(parts, slab, carried)?;
        // before anybody relies on its tiles
        parts
            .writers
            .as_ref()
            .map_or(Ok(()), BackgroundWriters::wait)?;
        carried.checkpointer.commit()
    }

    /// Labels all bands of a layer, as many at a time as fit.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub fn seal_in_parts<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        state: &mut ScanState,
    ) -> Result<Vec<SealedBand>> {
        let mut sealed = Vec::new();
        self.for_each_part(parts, layer, |_, part, _| {
            state.seal(layer, part, &mut sealed)
        })?;
        Ok(sealed)
    }

    /// Meshes a layer whose classes are known, as many bands at a time as fit.
    fn mesh_in_parts<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        state: &mut ScanState,
        known: &SlabLabels,
    ) -> Result<SlabTiles> {
        loop {
            let gather = TileCollector::new(state);
            gather.begin(layer, known)?;
            let meshed = self.for_each_part(parts, layer, |parts, part, first| {
                let of_local = &known.classes.of_local[first as usize..];
                let bands = part.par_iter_mut().zip(of_local);
                bands.for_each(|(band, class_of)| take_classes(band, class_of));
                let slab = Slab {
                    classes: &known.classes,
                    next: None,
                    gather: &gather,
                };
                self.mesh_bands(parts, part, first, layer, &slab)
            });
            match meshed {
                // fewer bands leave more for what the slab has in tiles and surfaces
                Err(error @ Error::TooDense { .. }) => parts.shrink(error)?,
                other => return other.map(|()| gather.take()),
            }
        }
    }

    /// Prepares all bands of a layer, as many at a time as fit, and calls `each(bands, first)`.
    ///
    /// # Errors
    /// Those of [`Sweep::run`], and what `each` returns.
    pub fn for_each_part<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        mut each: impl FnMut(&Parts<T>, &mut [Band<T>], u32) -> Result<()>,
    ) -> Result<()> {
        let bands = self.plan.tiling.tiles()[1];
        let mut part: Vec<Band<T>> = Vec::new();
        let mut first = 0;
        while first < bands {
            self.check_interrupt()?;
            let count = parts.mode.bands_at_once.min(bands - first);
            part.truncate(count as usize);
            part.resize_with(count as usize, || parts.source.band());
            match self.prepare(&parts.source, &mut part, first, layer) {
                Err(error @ Error::TooDense { .. }) => {
                    part.clear();
                    parts.shrink(error)?;
                }
                other => {
                    other?;
                    each(parts, &mut part, first)?;
                    first += count;
                }
            }
        }
        Ok(())
    }

    fn prepare<T: Voxel>(
        &self,
        source: &BandSource<T>,
        bands: &mut [Band<T>],
        first: u32,
        layer: u32,
    ) -> Result<()> {
        bands
            .par_iter_mut()
            .enumerate()
            .with_max_len(1)
            .try_for_each(|(i, band)| source.prepare(first + i as u32, layer, band))
    }
}
