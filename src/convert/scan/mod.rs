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
mod mode;
mod scheduler;
mod slab;
mod small_components;
pub(crate) mod state;
pub(crate) mod surfaces;
pub(crate) mod tile_writer;
mod whole_slabs;
mod workers;
mod workspace_pool;

use crate::checkpoint::{Checkpointer, Marks, TILES};
use crate::convert::conversion::Conversion;
use crate::convert::finalize::batch_size::nodes_bytes;
use crate::convert::memory::WRITES;
use crate::convert::plan::Plan;
use crate::convert::scan::band::{Band, BandSource, SealedBand};
use crate::convert::scan::collect::{SlabTiles, TileCollector};
use crate::convert::scan::mode::{Mode, Parts};
use crate::convert::scan::small_components::Filter;
use crate::convert::scan::state::{ScanOutput, ScanState, SlabLabels};
use crate::convert::scan::surfaces::SurfacePart;
use crate::convert::scan::tile_writer::{TileWriter, WrittenPiece};
use crate::convert::scan::workspace_pool::{Workspace, WorkspacePool};
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Placement};
use crate::measure::{AreaScale, MeshSums};
use crate::progress::Progress;
use crate::surface::{BandView, MeshSettings, Sizes, TileBox, by_surface};
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::tile::MAX_NODES;
use crate::volume::{Volume, Voxel, spool_beside};
use rayon::prelude::*;
use slab::Slab;
use std::cmp::Reverse;
use std::ops::Deref;
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

/// A tile to mesh.
struct TileJob<B> {
    /// Memory that this takes.
    bytes: u64,
    /// The band that it lies in.
    band: B,
    grid: [u32; 3],
    tile: TileBox,
    /// There is something to mesh.
    has_surface: bool,
}

/// Places of tiles in their order.
type Turn = (Reverse<Option<u32>>, [u32; 2]);

impl<B> TileJob<B> {
    /// The order in which tiles of a slab are made: small ones last, so that no thread is left with a large one
    /// when the others have none; those of about the same size beside their neighbours.
    fn turn(&self) -> Turn {
        let [x, y, _] = self.grid;
        (Reverse(self.bytes.checked_ilog2()), [y, x])
    }
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
            for (sweep, above) in [true, false].into_iter().enumerate() {
                let parts = &mut self.parts(&filters);
                let filter = self.find_dust::<T>(parts, (sweep, above), checkpointer)?;
                filters.push(filter);
            }
        }
        let (mut state, mut layer) = self.begin(checkpointer)?;
        if let [objects, cells] = &filters[..] {
            state.forward.dust = [objects, cells].map(|f| (f.components, f.voxels));
        }
        let mut parts = self.parts::<T>(&filters);
        let writes = MemoryReservation::new(self.memory, WRITES);
        parts.writers = BackgroundWriters::new(self.plan.in_flight, self.plan.body, writes);
        let layers = self.plan.tiling.tiles()[2];
        let [x, y, _] = self.plan.tiling.tiles().map(u64::from);
        self.progress.advance(u64::from(layer) * x * y);
        self.prefetch(&parts.source, layer);
        let mut tiles = None;
        while layer < layers {
            (layer, tiles) = self.sweep_whole_slabs(&mut parts, layer, &mut state, checkpointer)?;
            if layer < layers {
                self.sweep_slab_in_parts(&mut parts, layer, &mut state, checkpointer)?;
                layer += 1;
            }
        }
        let writers = parts.writers;
        Ok(Scanned {
            output: state.forward,
            last_layer: UncommittedLayer { writers, tiles },
        })
    }

    /// The state before the first layer to do, and that layer.
    fn begin(&self, checkpointer: &mut Checkpointer) -> Result<(ScanState, u32)> {
        let memory = self.memory;
        let files = checkpointer.files(TILES);
        let Some(mut at) = checkpointer.take(TILES) else {
            return Ok((ScanState::new(&files, memory, self.plan.front)?, 0));
        };
        let state = ScanState::load(&files, &at.marks, &mut at.state, memory, self.plan.front)?;
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
                measured: self.measured,
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

    /// Ends a slab whose tiles are made. What follows of it is ready to be kept once they are written, too.
    fn end_slab<T: Voxel>(
        &self,
        parts: &Parts<T>,
        (layer, known, tiles): (u32, &SlabLabels, SlabTiles),
        state: &mut ScanState,
        checkpointer: &mut Checkpointer,
    ) -> Result<()> {
        state.finish_slab(layer, known, tiles)?;
        let (files, mut marks) = (checkpointer.files(TILES), Marks::default());
        state.mark(&files, &mut marks, &known.after)?;
        checkpointer.stage(TILES, layer + 1, &marks, |out| {
            state.save(out, &known.after)
        })?;
        self.release(&parts.source, layer);
        Ok(())
    }

    /// Sweeps one slab a few bands at a time.
    fn sweep_slab_in_parts<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        state: &mut ScanState,
        checkpointer: &mut Checkpointer,
    ) -> Result<()> {
        let sealed = self.seal_in_parts(parts, layer, state)?;
        let known = self.join(sealed, layer, state)?;
        self.mesh_and_end(parts, layer, state, (&known, checkpointer))
    }

    /// Makes the tiles of a layer whose classes are known, and keeps it. What comes before it has ended.
    fn mesh_and_end<T: Voxel + Default>(
        &self,
        parts: &mut Parts<T>,
        layer: u32,
        state: &mut ScanState,
        (known, checkpointer): (&SlabLabels, &mut Checkpointer),
    ) -> Result<()> {
        let tiles = self.mesh_in_parts(parts, layer, state, known)?;
        self.end_slab(parts, (layer, known, tiles), state, checkpointer)?;
        // before anybody relies on its tiles
        parts
            .writers
            .as_ref()
            .map_or(Ok(()), BackgroundWriters::wait)?;
        checkpointer.commit()
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
                self.mesh_bands(parts, part, (first, layer), &slab)
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

    fn check_interrupt(&self) -> Result<()> {
        if self.progress.interrupted() {
            Err(Error::Interrupted)
        } else {
            Ok(())
        }
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

    /// Meshes all tiles of some bands of a layer, from band `first` on, and writes them, or hands them to the
    /// writers.
    fn mesh_bands<T: Voxel>(
        &self,
        parts: &Parts<T>,
        bands: &[Band<T>],
        (first, layer): (u32, u32),
        slab: &Slab,
    ) -> Result<()> {
        let tiles_x = self.plan.tiling.tiles()[0];
        let places = (0..bands.len() as u32 * tiles_x).into_par_iter();
        let jobs = places.map(|i| {
            let (ty, tx) = (i / tiles_x, i % tiles_x);
            self.tile_of(&bands[ty as usize], [tx, first + ty, layer])
        });
        let mut jobs: Vec<TileJob<&Band<T>>> = jobs.collect();
        jobs.sort_unstable_by_key(TileJob::turn);
        let jobs = jobs.into_iter().par_bridge();
        jobs.try_for_each(|job| self.mesh_tile(parts, &job, slab))
    }

    /// A tile of a band.
    fn tile_of<T: Voxel, B: Deref<Target = Band<T>>>(&self, band: B, grid: [u32; 3]) -> TileJob<B> {
        let tile = TileBox::of(self.plan.tiling, grid);
        let sizes = Sizes::of(&band.bits, &tile);
        TileJob {
            bytes: sizes.bytes(&tile, self.plan.per_triangle),
            has_surface: sizes.vertices > 0 || self.cap,
            band,
            grid,
            tile,
        }
    }

    /// Meshes a tile and writes it, if it has any surface.
    fn mesh_tile<T: Voxel, B: Deref<Target = Band<T>>>(
        &self,
        parts: &Parts<T>,
        job: &TileJob<B>,
        slab: &Slab,
    ) -> Result<()> {
        let settings = MeshSettings {
            threshold: self.threshold,
            rule: self.rule,
            cap: self.cap,
            area: AreaScale::new(parts.source.volume.header().placement.spacing),
        };
        let view = BandView {
            voxels: &job.band.voxels,
            bits: &job.band.bits,
            runs: &job.band.runs,
            class_of_run: &job.band.labels.of_run,
            carry_over: slab.carry_over(),
        };
        if job.has_surface {
            parts.pool.with(job.bytes, |workspace| {
                let Workspace { mesher, mesh, .. } = workspace;
                if mesher.mesh(&view, &job.tile, &settings, mesh) {
                    let writers = parts.writers.as_ref();
                    self.write_tile((&job.tile, job.grid), workspace, writers, slab)?;
                }
                Ok(())
            })?;
        }
        self.progress.advance(1);
        Ok(())
    }

    /// Writes the workspace's mesh and tells what gathers the slab's tiles of it.
    fn write_tile(
        &self,
        (tile, grid): (&TileBox, [u32; 3]),
        workspace: &mut Workspace,
        writers: Option<&BackgroundWriters>,
        slab: &Slab,
    ) -> Result<()> {
        let Workspace {
            mesh, stripifier, ..
        } = workspace;
        let how = (writers, slab.is_provisional(&mesh.pieces));
        let (record, body) = self.writer.write(mesh, grid, stripifier, how)?;
        // now, and not when all of the volume has been swept; others have no more nodes than always fit
        let nodes = body.pieces.len();
        if nodes > MAX_NODES && !self.writer.head.merges(nodes) {
            self.plan.check_finishing(nodes_bytes(&record))?;
        }
        let mut caps = MeshSums::default();
        mesh.pieces
            .iter()
            .filter(|p| p.is_cap())
            .for_each(|p| caps.merge(&p.sums));
        let mut bodies = body.pieces.into_iter();
        let order = by_surface(&mesh.pieces).into_iter();
        let pieces = order.map(|number| {
            let piece = &mesh.pieces[number];
            let is_first = piece.first as usize == number;
            let written = is_first.then(|| {
                let body = bodies.next().expect("one for each surface");
                WrittenPiece::new(piece, body)
            });
            let part = (!piece.is_cap()).then(|| SurfacePart {
                object: piece.object,
                cell: piece.cell,
                whole: tile.is_inside(piece.min, piece.max),
                key: piece.key,
                sums: piece.sums,
            });
            (written, part)
        });
        slab.gather.add(record, pieces, &caps)
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

/// Turns a band's labels of runs from local components into classes of the slab.
fn take_classes<T>(band: &mut Band<T>, class_of: &[u32]) {
    let labels = band.labels.of_run.iter_mut();
    labels.for_each(|label| *label = class_of[*label as usize]);
}

#[cfg(test)]
mod tests;
