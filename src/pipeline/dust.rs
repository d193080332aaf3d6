//! Leaves out components of few voxels (`--min-voxels`).
//!
//! A component that is left out is filled with the other phase, so that all laws hold on what
//! remains. Its size is known only when it has ended, so volumes with dust are swept three times:
//! to find small objects; to find small cells among what remains; to mesh. Filling small cells only
//! joins objects, so nothing small is left after that. Vertices do not move: every lattice edge out
//! of a component is crossed, and all of them go with it.

use crate::error::Result;
use crate::pipeline::forward::State;
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::sweep::{Parts, Sweep};
use crate::segment::{Runs, SlabClasses, for_each_run};
use crate::slab::Bits;
use crate::volume::Voxel;
use std::sync::Mutex;

/// Knows which components of one phase are to be filled.
#[derive(Debug)]
pub struct Filter {
    bands: u32,
    found: Mutex<Found>,
    /// Number of components.
    pub components: u64,
    /// Number of their voxels.
    pub voxels: u64,
}

#[derive(Debug)]
struct Found {
    spool: Spool,
    /// Class of each local component, per layer and band.
    class_of: Vec<Place<u32>>,
    /// 1 for each class that is to be filled, per layer.
    small: Vec<Place<u8>>,
}

/// What the reverse sweep needs of a slab.
struct Slab {
    voxels: Place<u64>,
    above: Place<u8>,
    live: Place<u32>,
    from_previous: Place<u32>,
}

impl Filter {
    /// Fills the small components of band `ty` of layer `tz`, whose runs have these labels.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the temporary file fails.
    pub fn fill(
        &self,
        [ty, tz]: [u32; 2],
        bits: &mut Bits,
        runs: &Runs,
        of_run: &[u32],
    ) -> Result<()> {
        debug_assert_eq!(runs.count, of_run.len());
        let (class_of, small) = {
            let mut found = self.found.lock().expect("no thread panicked");
            let Found {
                spool,
                class_of,
                small,
            } = &mut *found;
            let band = (tz * self.bands + ty) as usize;
            (spool.get(&class_of[band])?, spool.get(&small[tz as usize])?)
        };
        let nx = bits.span.nx;
        let mut run = 0;
        let mut flips: Vec<(u32, u32)> = Vec::new();
        for row in bits.words.chunks_exact_mut(bits.row_words) {
            for_each_run(row, nx, |start, end, _| {
                if small[class_of[of_run[run] as usize] as usize] == 1 {
                    flips.push((start, end));
                }
                run += 1;
            });
            for (start, end) in flips.drain(..) {
                for x in start..end {
                    row[x as usize / 64] ^= 1 << (x % 64);
                }
            }
        }
        Ok(())
    }
}

impl Sweep<'_> {
    /// Finds the objects (`above`) or cells of fewer than `min_voxels` voxels.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub fn find_dust<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        above: bool,
        min_voxels: u64,
    ) -> Result<Filter> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        let mut state = State::new(self.work, parts.source.budget, self.plan.front)?;
        let spool = Spool::new(self.work)?;
        let mut found = Found {
            spool,
            class_of: Vec::new(),
            small: Vec::new(),
        };
        let mut slabs = Vec::new();
        for layer in 0..layers {
            let settled = self.settle_in_parts(parts, layer, &mut state)?;
            let classes = state.join(&settled, layer + 1 == layers)?;
            for of_local in &classes.of_local {
                found.class_of.push(found.spool.push(of_local)?);
            }
            let voxels = state.class_voxels(&settled, &classes)?;
            slabs.push(Slab::new(&voxels, &classes, &mut found.spool)?);
            self.release(&parts.source, layer);
        }
        let mut filter = Filter {
            bands,
            found: Mutex::new(found),
            components: 0,
            voxels: 0,
        };
        filter.resolve(&slabs, above, min_voxels)?;
        Ok(filter)
    }
}

impl Slab {
    fn new(voxels: &[u64], classes: &SlabClasses, spool: &mut Spool) -> Result<Self> {
        Ok(Slab {
            voxels: spool.push(voxels)?,
            above: spool.push(&classes.above)?,
            live: spool.push(&classes.live)?,
            from_previous: spool.push(&classes.from_previous)?,
        })
    }
}

impl Filter {
    /// Decides, from the last slab back to the first, which classes are part of a small component.
    fn resolve(&mut self, slabs: &[Slab], above: bool, min_voxels: u64) -> Result<()> {
        let found = self.found.get_mut().expect("no thread panicked");
        let mut later: (Vec<u8>, Vec<u32>) = Default::default();
        for slab in slabs.iter().rev() {
            let voxels = found.spool.get(&slab.voxels)?;
            let phases = found.spool.get(&slab.above)?;
            let mut goes_on = vec![None; voxels.len()];
            for (&class, &successor) in found.spool.get(&slab.live)?.iter().zip(&later.1) {
                goes_on[class as usize] = Some(later.0[successor as usize]);
            }
            let mut small = Vec::with_capacity(voxels.len());
            for (class, &count) in voxels.iter().enumerate() {
                small.push(goes_on[class].unwrap_or_else(|| {
                    let is_small = (phases[class] == 1) == above && count < min_voxels;
                    if is_small {
                        self.components += 1;
                        self.voxels += count;
                    }
                    u8::from(is_small)
                }));
            }
            found.small.push(found.spool.push(&small)?);
            later = (small, found.spool.get(&slab.from_previous)?);
        }
        found.small.reverse();
        Ok(())
    }
}
