//! Slabs with all their bands in memory: voxels are read once, and one slab is prepared while the one before
//! it is meshed.

use super::ahead::Ahead;
use super::{Known, Sweep, take_classes};
use crate::error::{Error, Result};
use crate::pipeline::band::Band;
use crate::pipeline::forward::{Gather, State};
use crate::pipeline::keep::Keeper;
use crate::pipeline::parts::Parts;
use crate::volume::Voxel;
use std::sync::Arc;

impl Sweep<'_> {
    /// Sweeps slabs from `layer` on with all their bands in memory. Returns the first layer that is
    /// left because it does not fit.
    ///
    /// What only one thread can do, ending a slab and joining the bands of the next, goes on beside the
    /// preparation of the first bands after that. The others follow in the memory of bands whose tiles are
    /// all made.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub(super) fn sweep_whole_slabs<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        mut layer: u32,
        state: &mut State,
        keeper: &mut Keeper,
    ) -> Result<u32> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        let (mut prepared, mut spare) = (None, Vec::new());
        let mut meshed = None;
        while layer < layers && parts.mode.bands_at_once >= bands {
            let ready = prepared.take().filter(|_| !self.progress.interrupted());
            let mut slab: Vec<Band<T>> = match ready {
                Some(slab) => slab,
                None => {
                    self.end_slab(parts, meshed.take(), state, keeper)?;
                    self.check_interrupt()?;
                    let memory = std::mem::take(&mut spare);
                    let Some(slab) = self.prepare_slab(parts, layer, memory)? else {
                        continue;
                    };
                    slab
                }
            };
            let ahead = self.look_ahead(parts, layer, std::mem::take(&mut spare));
            let mut known = None;
            let before = meshed.take();
            let work = || {
                self.end_slab(parts, before, state, keeper)?;
                let mut settled = Vec::new();
                state.settle(&mut slab, &mut settled)?;
                let known = known.insert(self.join(settled, layer, state)?);
                take_classes(&mut slab, 0, &known.classes);
                let gather = state.gather(&known.settled, &known.classes)?;
                self.mesh_slab(parts, slab, layer, &gather, &ahead)?;
                Ok(gather.into_tiles())
            };
            let (made, ()) = rayon::join(work, || ahead.begin(self.plan.bands_ahead()));
            match ahead.finish() {
                Err(error @ Error::TooDense { .. }) => parts.shrink(error)?,
                other => (prepared, spare) = other?,
            }
            let tiles = match made {
                Err(error @ Error::TooDense { .. }) => {
                    (prepared, spare) = (None, Vec::new());
                    parts.shrink(error)?;
                    let Some(known) = &known else { continue };
                    self.mesh_in_parts(parts, layer, state, known)?
                }
                other => other?,
            };
            let known: Known = known.expect("what is meshed was joined");
            meshed = Some((layer, known, tiles));
            layer += 1;
        }
        self.end_slab(parts, meshed, state, keeper)?;
        Ok(layer)
    }

    /// Prepares all bands of a layer, in the memory of `spare` first. `None` if they do not fit; then
    /// `parts` has a smaller mode.
    fn prepare_slab<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        spare: Vec<Band<T>>,
    ) -> Result<Option<Vec<Band<T>>>> {
        let mut slab = spare;
        slab.resize_with(self.plan.tiling.tiles()[1] as usize, || parts.source.band());
        match self.prepare(&parts.source, &mut slab, 0, layer) {
            Err(error @ Error::TooDense { .. }) => {
                drop(slab);
                parts.shrink(error).map(|()| None)
            }
            other => other.map(|()| Some(slab)),
        }
    }

    /// What prepares the slab after that of `layer`, if there is one and memory for it.
    fn look_ahead<'a, T: Voxel + Default>(
        &self,
        parts: &'a Parts<'a, T>,
        layer: u32,
        spare: Vec<Band<T>>,
    ) -> Ahead<'a, T> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        self.prefetch(&parts.source, layer + 1);
        let look_ahead = parts.mode.look_ahead && layer + 1 < layers;
        let next = (layer + 1, if look_ahead { bands } else { 0 });
        let keep = layer + 1 + u32::from(look_ahead) < layers;
        Ahead::new(&parts.source, next, spare, keep)
    }

    /// Meshes a layer whose classes the bands have, and hands each one to `ahead` when its tiles are made.
    fn mesh_slab<T: Voxel + Default>(
        &self,
        parts: &Parts<T>,
        slab: Vec<Band<T>>,
        layer: u32,
        gather: &Gather,
        ahead: &Ahead<T>,
    ) -> Result<()> {
        let slab = slab.into_iter().map(Arc::new).collect();
        self.mesh_bands(parts, slab, (0, layer), gather, |band| {
            if let Some(band) = Arc::into_inner(band) {
                ahead.prepare_in(band);
            }
        })
    }
}
