//! Slabs with all their bands in memory: voxels are read once, and threads go on to the bands of the next slab
//! when no tile of this one is left.

use crate::convert::scan::mode::Parts;
use crate::convert::scan::scheduler::Stop;
use crate::convert::scan::workers::SlabWorkers;
use crate::convert::scan::{Carried, Sweep};
use crate::error::Result;
use crate::volume::Voxel;

impl Sweep<'_> {
    /// Sweeps slabs from `layer` on with all their bands in memory. Returns the first layer that is
    /// left because it does not fit, and, if none is, how many tiles have to be written before the last one is kept.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub(crate) fn sweep_whole_slabs<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        mut layer: u32,
        carried: &mut Carried,
    ) -> Result<(u32, Option<u64>)> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        while layer < layers && parts.mode.bands_at_once >= bands {
            let line = SlabWorkers::new(self, parts, layer, carried);
            let stop = match line.run()? {
                Ok(uncommitted) => return Ok((layers, uncommitted)),
                Err(stop) => stop,
            };
            let Stop { known, error, .. } = stop;
            parts.shrink(error)?;
            layer = stop.layer;
            for known in known {
                self.mesh_and_end(parts, layer, &known, carried)?;
                layer += 1;
            }
        }
        Ok((layer, None))
    }
}
