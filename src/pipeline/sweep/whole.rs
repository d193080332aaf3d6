//! Slabs with all their bands in memory: voxels are read once, and one slab is prepared while the one before
//! it is meshed.

use super::{Known, Sweep, take_classes};
use crate::error::{Error, Result};
use crate::pipeline::band::Band;
use crate::pipeline::forward::{SlabTiles, State};
use crate::pipeline::keep::Keeper;
use crate::pipeline::parts::Parts;
use crate::volume::Voxel;

impl Sweep<'_> {
    /// Sweeps slabs from `layer` on with all their bands in memory. Returns the first layer that is
    /// left because it does not fit.
    ///
    /// What only one thread can do, ending a slab and joining the bands of the next, goes on beside the
    /// preparation of the one after that.
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
        let fresh = |parts: &Parts<T>| (0..bands).map(|_| parts.source.band()).collect::<Vec<_>>();
        let (mut now, mut next) = (fresh(parts), fresh(parts));
        let mut prepared = false;
        let mut meshed = None;
        while layer < layers && parts.mode.bands_at_once >= bands {
            if !prepared || self.progress.interrupted() {
                self.end_slab(parts, meshed.take(), state, keeper)?;
                self.check_interrupt()?;
                match self.prepare(&parts.source, &mut now, 0, layer) {
                    Err(error @ Error::TooDense { .. }) => {
                        parts.shrink(error)?;
                        (now, next) = (fresh(parts), fresh(parts));
                        continue;
                    }
                    other => other?,
                }
            }
            self.prefetch(&parts.source, layer + 1);
            let mut known = None;
            let before = meshed.take();
            let work = || {
                self.end_slab(parts, before, state, keeper)?;
                let mut settled = Vec::new();
                state.settle(&mut now, &mut settled)?;
                let known = known.insert(self.join(settled, layer, state)?);
                take_classes(&mut now, 0, &known.classes);
                self.mesh_slab(parts, &now, layer, state, known)
            };
            let (made, ahead) = if parts.mode.look_ahead && layer + 1 < layers {
                let ahead = || self.prepare(&parts.source, &mut next, 0, layer + 1);
                let (made, ahead) = rayon::join(work, ahead);
                (made, Some(ahead))
            } else {
                (work(), None)
            };
            prepared = match ahead {
                Some(Err(error @ Error::TooDense { .. })) => {
                    parts.shrink(error)?;
                    false
                }
                Some(other) => other.map(|()| true)?,
                None => false,
            };
            if !prepared || matches!(made, Err(Error::TooDense { .. })) {
                (next, prepared) = (fresh(parts), false);
            }
            let tiles = match (made, &known) {
                (Err(error @ Error::TooDense { .. }), None) => {
                    parts.shrink(error)?;
                    now = fresh(parts);
                    continue;
                }
                (Err(error @ Error::TooDense { .. }), Some(known)) => {
                    let bands = std::mem::take(&mut now);
                    let tiles = self.mesh_again(parts, bands, layer, state, (known, error))?;
                    now = fresh(parts);
                    tiles
                }
                (made, _) => made?,
            };
            let known = known.expect("what is meshed was joined");
            meshed = Some((layer, known, tiles));
            if prepared {
                std::mem::swap(&mut now, &mut next);
            }
            layer += 1;
        }
        self.end_slab(parts, meshed, state, keeper)?;
        // it takes the system some milliseconds to have so much back
        rayon::join(|| drop(now), || drop(next));
        Ok(layer)
    }

    /// Meshes a layer, all of whose bands are in memory.
    fn mesh_slab<T: Voxel>(
        &self,
        parts: &Parts<T>,
        bands: &[Band<T>],
        layer: u32,
        state: &mut State,
        known: &Known,
    ) -> Result<SlabTiles> {
        let gather = state.gather(&known.settled, &known.classes)?;
        self.mesh_bands(parts, bands, 0, layer, &gather)?;
        Ok(gather.into_tiles())
    }

    /// Meshes a layer for which there was not memory enough, with smaller modes until there is.
    fn mesh_again<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        bands: Vec<Band<T>>,
        layer: u32,
        state: &mut State,
        (known, mut error): (&Known, Error),
    ) -> Result<SlabTiles> {
        loop {
            // nothing but a smaller mode is left to make room
            parts.shrink(error)?;
            if (parts.mode.bands_at_once as usize) < bands.len() {
                drop(bands);
                return self.mesh_in_parts(parts, layer, state, known);
            }
            match self.mesh_slab(parts, &bands, layer, state, known) {
                Err(again @ Error::TooDense { .. }) => error = again,
                other => return other,
            }
        }
    }
}
