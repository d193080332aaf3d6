//! The forward sweep: one pass over the volume that labels, meshes and writes the tiles' geometry.
//!
//! Ids are not known yet, so tiles carry classes of their slab, in temporary tables, and their JSON
//! chunk is only room.
//!
//! While memory allows, all bands of a slab are in memory, voxels are read once, and the next slab is
//! read and labelled as soon as threads find no tile of this one to make. If not, or where a slab turns out
//! denser than planned, a slab is done in parts: read once to label it and once more to mesh it. The result
//! is the same.
//!
//! Where components of a slab often turn out to be one in the next slab, as those of a porous rock do, tiles are
//! made only when that one is labelled, if there is memory for both: pieces of surfaces that turn out to be one are
//! written as one then.

mod band;
mod collect;
mod in_parts;
mod mode;
mod scheduler;
mod slab;
mod slab_memory;
mod small_components;
pub(crate) mod state;
pub(crate) mod surfaces;
pub(crate) mod tile_writer;
mod tiles;
mod whole_slabs;
mod workers;
mod workspace_pool;

use crate::checkpoint::{Checkpointer, Marks, TILES};
use crate::convert::conversion::Conversion;
use crate::convert::memory::WRITES;
use crate::convert::plan::Plan;
use crate::convert::scan::band::{BandSource, SealedBand};
use crate::convert::scan::collect::SlabTiles;
use crate::convert::scan::mode::{Mode, Parts};
use crate::convert::scan::slab_memory::SlabMemory;
use crate::convert::scan::small_components::{Filter, SMALL_CELLS, SMALL_OBJECTS};
use crate::convert::scan::state::{ScanOutput, ScanState, SlabLabels};
use crate::convert::scan::tile_writer::TileWriter;
use crate::convert::scan::workspace_pool::WorkspacePool;
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Placement};
use crate::progress::Progress;
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::volume::{RegionVoxels, Volume, Voxel, spool_beside};
use std::sync::Arc;

/// What a scan leaves.
pub struct Scanned {
    /// What is known of components, surfaces and tiles.
    pub output: ScanOutput,
    /// The last layer, still to be committed.
    pub last_layer: UncommittedLayer,
}

/// Scans the grid: all tiles but those that are made again, and what is known of their pieces.
///
/// # Errors
/// As of [`Sweep::run`].
pub fn scan(
    job: &Conversion,
    memory: &Arc<MemoryPool>,
    writer: &TileWriter,
    checkpointer: &mut Checkpointer,
) -> Result<Scanned> {
    let work = &writer.dir;
    let (grid, options, plan) = (job.grid, job.options, job.plan);
    let [x, y, layers] = plan.tiling.tiles();
    let measured = options.measured(&grid.header().placement)?;
    job.progress
        .begin("tiles", [x, y, layers].map(u64::from).iter().product());
    let mut run = |volume: &dyn Volume| {
        let sweep = Sweep {
            volume,
            plan,
            memory,
            threshold: options.threshold,
            rule: options.ambiguous,
            region: job.region,
            measured,
            cap: options.cap,
            min_voxels: options.min_voxels,
            writer,
            progress: job.progress,
        };
        sweep.run(checkpointer)
    };
    // a slab's bands are read one by one, each through all its slices
    let forward_only = y == 1 && options.min_voxels < 2;
    match grid.decoded_once(work)? {
        Some(once) => run(&*once),
        None if grid.random_access() || forward_only => run(grid),
        None => spool_beside(grid, work, run),
    }
}

/// What stays the same during a sweep.
pub struct Sweep<'a> {
    /// The grid's samples.
    pub volume: &'a dyn Volume,
    /// The cut.
    pub plan: &'a Plan,
    /// The memory of the conversion.
    pub memory: &'a Arc<MemoryPool>,
    /// The iso value.
    pub threshold: f64,
    /// Which voxels an ambiguous face joins.
    pub rule: Ambiguous,
    /// The region of interest of the grid, if there is one.
    pub region: Option<&'a RegionVoxels>,
    /// Where the grid lies, in the unit of measures.
    pub measured: Placement,
    /// Close the surface outside the volume.
    pub cap: bool,
    /// Components of fewer voxels are left out.
    pub min_voxels: u64,
    /// Writes tiles.
    pub writer: &'a TileWriter,
    /// Hears of every layer.
    pub progress: &'a dyn Progress,
}

/// The last layer of a sweep, some of whose tiles may be on their way to the disk.
pub struct UncommittedLayer {
    writers: Option<BackgroundWriters>,
    /// Tiles that have to be written before it is kept; `None` if it is.
    tiles: Option<u64>,
}

impl UncommittedLayer {
    /// Commits it, when threads that have nothing else to do have helped to write its tiles.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn commit(self, checkpointer: &mut Checkpointer) -> Result<()> {
        let Some(tiles) = self.tiles else {
            return Ok(());
        };
        if let Some(writers) = &self.writers {
            let written = rayon::broadcast(|_| writers.wait_for(tiles));
            written.into_iter().collect::<Result<()>>()?;
        }
        checkpointer.commit()
    }
}

/// What goes over from slab to slab.
pub struct Carried<'a> {
    /// What is known of components, surfaces and tiles.
    pub state: &'a mut ScanState,
    /// Keeps it.
    pub checkpointer: &'a mut Checkpointer,
}

/// A slab whose tiles are made.
pub struct MadeSlab<'a> {
    /// Its layer.
    pub layer: u32,
    /// What joining its bands has found.
    pub known: &'a SlabLabels,
    /// Its tiles.
    pub tiles: SlabTiles,
}

impl Sweep<'_> {
    /// Runs the sweep for the volume's sample type, from where `checkpointer` says on. The last layer is still to be kept.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::TooDense`] if the volume is too dense for the limit,
    /// [`Error::Interrupted`], and those of [`Volume::read_box`].
    pub fn run(&self, checkpointer: &mut Checkpointer) -> Result<Scanned> {
        crate::volume::with_voxel_type!(
            self.volume.header().dtype, T => self.run_typed::<T>(checkpointer))
    }

    fn run_typed<T: Voxel + Default>(&self, checkpointer: &mut Checkpointer) -> Result<Scanned> {
        let mut filters = Vec::new();
        if self.min_voxels > 1 {
            for search in [SMALL_OBJECTS, SMALL_CELLS] {
                let parts = &mut self.parts(&filters);
                parts.source.is_search = true;
                let filter = self.find_dust::<T>(parts, search, checkpointer)?;
                filters.push(filter);
            }
        }
        let (mut state, first) = self.begin(checkpointer)?;
        if let [objects, cells] = &filters[..] {
            state.forward.dust = [objects, cells].map(|f| (f.components, f.voxels));
        }
        let mut parts = self.parts::<T>(&filters);
        let writes = MemoryReservation::new(self.memory, WRITES);
        parts.writers = BackgroundWriters::new(self.plan.in_flight, self.plan.body, writes);
        let carried = &mut Carried {
            state: &mut state,
            checkpointer,
        };
        let tiles = self.sweep_layers(&mut parts, first, carried)?;
        let writers = parts.writers;
        Ok(Scanned {
            output: state.forward,
            last_layer: UncommittedLayer { writers, tiles },
        })
    }

    /// Sweeps all layers from `layer` on. Returns how many tiles have to be written before the last one is kept, if it
    /// is not kept yet.
    fn sweep_layers<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        mut layer: u32,
        carried: &mut Carried,
    ) -> Result<Option<u64>> {
        let [x, y, layers] = self.plan.tiling.tiles();
        let done = [x, y, layer].map(u64::from).iter().product();
        self.progress.advance(done);
        self.prefetch(&parts.source, layer);
        let mut tiles = None;
        while layer < layers {
            (layer, tiles) = self.sweep_whole_slabs(parts, layer, carried)?;
            if layer < layers {
                self.sweep_slab_in_parts(parts, layer, carried)?;
                layer += 1;
            }
        }
        Ok(tiles)
    }

    /// The state before the first layer to do, and that layer.
    fn begin(&self, checkpointer: &mut Checkpointer) -> Result<(ScanState, u32)> {
        let files = checkpointer.files(TILES);
        let memory = SlabMemory::new(self.memory, self.plan.front)?;
        let Some(mut at) = checkpointer.take(TILES) else {
            return Ok((ScanState::new(&files, memory)?, 0));
        };
        let state = ScanState::load(&files, &at.marks, &mut at.state, memory)?;
        let state =
            state.filter(|s| at.state.is_empty() && s.forward.slabs.len() == at.layer as usize);
        Ok((state.ok_or_else(|| checkpointer.damaged())?, at.layer))
    }

    fn parts<'a, T: Voxel>(&'a self, filters: &'a [Filter]) -> Parts<'a, T> {
        let Plan {
            bands_at_once,
            ahead,
            next_slab,
            ..
        } = *self.plan;
        Parts {
            source: BandSource {
                volume: self.volume,
                ceil: T::ceil_from(self.threshold),
                rule: self.rule,
                tiling: self.plan.tiling,
                region: self.region,
                measured: self.measured,
                is_search: false,
                filters,
                memory: self.memory,
            },
            pool: WorkspacePool::new(self.memory),
            mode: Mode {
                bands_at_once,
                ahead,
                next_slab,
            },
            writers: None,
        }
    }

    /// Joins the sealed bands of a layer.
    ///
    /// # Errors
    /// As of [`ScanState::join`].
    pub fn join(
        &self,
        sealed: Vec<SealedBand>,
        layer: u32,
        state: &mut ScanState,
    ) -> Result<SlabLabels> {
        let last = layer + 1 == self.plan.tiling.tiles()[2];
        state.join(layer, sealed, last)
    }

    /// Ends a slab. What follows of it is ready to be kept once its tiles are written, too.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn end_slab<T: Voxel>(
        &self,
        parts: &Parts<T>,
        slab: MadeSlab,
        carried: &mut Carried,
    ) -> Result<()> {
        let Carried {
            state,
            checkpointer,
        } = carried;
        let MadeSlab {
            layer,
            known,
            tiles,
        } = slab;
        state.finish_slab(layer, known, tiles)?;
        let (files, mut marks) = (checkpointer.files(TILES), Marks::default());
        state.mark(&files, &mut marks, &known.after)?;
        checkpointer.stage(TILES, layer + 1, &marks, |out| {
            state.save(out, &known.after)
        })?;
        self.release(&parts.source, layer);
        Ok(())
    }

    fn check_interrupt(&self) -> Result<()> {
        if self.progress.interrupted() {
            Err(Error::Interrupted)
        } else {
            Ok(())
        }
    }

    fn prefetch<T: Voxel>(&self, source: &BandSource<T>, layer: u32) {
        if layer < self.plan.tiling.tiles()[2] {
            source.volume.prefetch(
                source
                    .span(0, layer)
                    .with_neighbours(self.plan.tiling.dims)
                    .z,
            );
        }
    }

    /// Gives back the slices that no later slab needs.
    pub fn release<T: Voxel>(&self, source: &BandSource<T>, layer: u32) {
        let z = source.span(0, layer).z;
        source
            .volume
            .release(z.start.saturating_sub(1)..z.end.saturating_sub(2).max(z.start));
    }
}

#[cfg(test)]
mod tests;
