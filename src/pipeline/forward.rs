//! The forward sweep: one pass over the volume that labels, meshes and writes the tiles' geometry.
//!
//! Ids are not known yet, so tiles carry classes of their slab, in temporary tables, and their JSON
//! chunk is only room.

use crate::error::{Error, Result};
use crate::grid::Ambiguous;
use crate::measure::{AreaScale, MeshSums, VoxelSums};
use crate::mesh::{BandView, MeshSettings, TileBox, TileMesh, TileMesher};
use crate::pipeline::band::{Band, BandSource};
use crate::pipeline::plan::Plan;
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::surfaces::{SlabSurface, SlabSurfaces, SurfacePart, Surfaces};
use crate::pipeline::tilefile::{TileRecord, TileWriter, WrittenPiece};
use crate::progress::Progress;
use crate::segment::{Births, Classes, LocalComponent, PhaseBirths, SlabClasses};
use crate::volume::{Volume, Voxel};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;

/// A component that will not grow any more.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct FinishedComponent {
    /// Sums of its voxels.
    pub sums: VoxelSums,
    /// Its number.
    pub birth: u64,
    reserved: u64,
}

/// What the sweep leaves of one slab.
#[derive(Debug)]
pub struct SlabRecord {
    /// z index of its macrocubes.
    pub layer: u32,
    /// Number of each class.
    pub births: Place<u64>,
    /// 1 for objects, 0 for cells, per class.
    pub above: Place<u8>,
    /// See [`SlabClasses`].
    pub live: Place<u32>,
    /// See [`SlabClasses`].
    pub from_previous: Place<u32>,
    /// All surfaces.
    pub surfaces: Place<SlabSurface>,
    /// See [`SlabSurfaces`].
    pub surfaces_live: Place<u32>,
    /// See [`SlabSurfaces`].
    pub surfaces_from_previous: Place<u32>,
    /// The tiles, by y, then x.
    pub tiles: Place<TileRecord>,
    /// Their pieces, tile after tile.
    pub pieces: Place<WrittenPiece>,
}

/// What the whole sweep leaves.
pub struct Forward {
    /// The arrays of all slabs.
    pub spool: Spool,
    /// By rising z.
    pub slabs: Vec<SlabRecord>,
    /// Finished objects and cells, in the order of finishing.
    pub objects: Spool,
    /// Finished cells.
    pub cells: Spool,
    /// Numbers of objects and cells.
    pub births: PhaseBirths,
    /// Numbers of surfaces.
    pub surface_births: Births,
    /// NaN samples.
    pub nan: u64,
    /// Sums over all caps.
    pub caps: MeshSums,
}

/// What stays the same during a sweep.
pub struct Sweep<'a> {
    /// The grid's samples.
    pub volume: &'a dyn Volume,
    /// The cut.
    pub plan: &'a Plan,
    /// The iso value.
    pub threshold: f64,
    /// Which voxels an ambiguous face joins.
    pub rule: Ambiguous,
    /// Close the surface outside the volume.
    pub cap: bool,
    /// Writes tiles.
    pub writer: &'a TileWriter,
    /// Directory for temporary files.
    pub work: &'a Path,
    /// Hears of every layer.
    pub progress: &'a dyn Progress,
}

/// Buffers of one thread.
#[derive(Default)]
struct Workspace {
    mesher: TileMesher,
    mesh: TileMesh,
    writer: crate::pipeline::tilefile::TileBuffers,
}

/// The result of one tile.
struct TileResult {
    record: TileRecord,
    pieces: Vec<WrittenPiece>,
    /// What its pieces add to surfaces.
    parts: Vec<SurfacePart>,
    /// Sums over its caps.
    caps: MeshSums,
}

struct State {
    forward: Forward,
    classes: Classes,
    surfaces: Surfaces,
}

impl Sweep<'_> {
    /// Runs the sweep for the volume's sample type.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Memory`] if a tile's surface passes the plan, [`Error::Interrupted`],
    /// and those of [`Volume::read_box`].
    pub fn run(&self) -> Result<Forward> {
        crate::volume::with_voxel_type!(self.volume.header().dtype, T => self.run_typed::<T>())
    }

    fn run_typed<T: Voxel + Default>(&self) -> Result<Forward> {
        let spool = || Spool::new(self.work);
        let births = || Births::new(self.work);
        let mut state = State {
            forward: Forward {
                spool: spool()?,
                slabs: Vec::new(),
                objects: spool()?,
                cells: spool()?,
                births: PhaseBirths {
                    objects: births()?,
                    cells: births()?,
                },
                surface_births: births()?,
                nan: 0,
                caps: MeshSums::default(),
            },
            classes: Classes::default(),
            surfaces: Surfaces::default(),
        };
        let source = BandSource {
            volume: self.volume,
            ceil: T::ceil_from(self.threshold),
            rule: self.rule,
            tiling: self.plan.tiling,
        };
        let workspaces = Mutex::new(Vec::new());
        if self.plan.bands_at_once >= self.plan.tiling.tiles()[1] {
            self.sweep_whole_slabs::<T>(&source, &workspaces, &mut state)?;
        } else {
            self.sweep_in_parts::<T>(&source, &workspaces, &mut state)?;
        }
        Ok(state.forward)
    }

    /// All bands of a slab in memory: voxels are read once, the next slab while this one is meshed.
    fn sweep_whole_slabs<T: Voxel + Default>(
        &self,
        source: &BandSource<T>,
        workspaces: &Mutex<Vec<Workspace>>,
        state: &mut State,
    ) -> Result<()> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        let fresh = || (0..bands).map(|_| Band::<T>::default()).collect::<Vec<_>>();
        let (mut now, mut next) = (fresh(), Vec::new());
        if self.plan.look_ahead {
            next = fresh();
        }
        self.prefetch(source, 0);
        self.prepare(source, &mut now, 0, 0)?;
        for layer in 0..layers {
            self.check_interrupt()?;
            let classes = self.join(&now, layer, state)?;
            take_classes(&mut now, 0, &classes);
            self.prefetch(source, layer + 1);
            let more = layer + 1 < layers;
            let mesh = || self.mesh_bands(source, &now, 0, layer, workspaces);
            let tiles = if self.plan.look_ahead && more {
                let (tiles, read) =
                    rayon::join(mesh, || self.prepare(source, &mut next, 0, layer + 1));
                read?;
                tiles?
            } else {
                mesh()?
            };
            self.finish_slab(layer, &classes, tiles, state)?;
            self.release(source, layer);
            if self.plan.look_ahead {
                std::mem::swap(&mut now, &mut next);
            } else if more {
                self.prepare(source, &mut now, 0, layer + 1)?;
            }
        }
        Ok(())
    }

    /// A few bands in memory at a time: a slab is read once to label it and once more to mesh it.
    fn sweep_in_parts<T: Voxel + Default>(
        &self,
        source: &BandSource<T>,
        workspaces: &Mutex<Vec<Workspace>>,
        state: &mut State,
    ) -> Result<()> {
        let [_, bands, layers] = self.plan.tiling.tiles();
        let at_once = self.plan.bands_at_once;
        let mut part: Vec<Band<T>> = (0..at_once).map(|_| Band::default()).collect();
        for layer in 0..layers {
            let mut known = Vec::new();
            for first in (0..bands).step_by(at_once as usize) {
                self.check_interrupt()?;
                let count = at_once.min(bands - first) as usize;
                self.prepare(source, &mut part[..count], first, layer)?;
                for band in &mut part[..count] {
                    let components = std::mem::take(&mut band.labels.components);
                    known.push(Band {
                        edges: std::mem::take(&mut band.edges),
                        labels: crate::segment::Labels {
                            of_run: Vec::new(),
                            components,
                        },
                        nan: band.nan,
                        ..Band::<T>::default()
                    });
                }
            }
            let classes = self.join(&known, layer, state)?;
            drop(known);
            let mut tiles = Vec::new();
            for first in (0..bands).step_by(at_once as usize) {
                self.check_interrupt()?;
                let count = at_once.min(bands - first) as usize;
                self.prepare(source, &mut part[..count], first, layer)?;
                take_classes(&mut part[..count], first, &classes);
                let part = &part[..count];
                tiles.extend(self.mesh_bands(source, part, first, layer, workspaces)?);
            }
            self.finish_slab(layer, &classes, tiles, state)?;
            self.release(source, layer);
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

    fn join<T>(&self, bands: &[Band<T>], layer: u32, state: &mut State) -> Result<SlabClasses> {
        state.forward.nan += bands.iter().map(|b| b.nan).sum::<u64>();
        let edges: Vec<_> = bands.iter().map(|b| &b.edges).collect();
        let components: Vec<&[LocalComponent]> =
            bands.iter().map(|b| &b.labels.components[..]).collect();
        let mut classes = state
            .classes
            .join(&edges, &components, &mut state.forward.births)?;
        if layer + 1 == self.plan.tiling.tiles()[2] {
            classes.live.clear(); // nothing grows beyond the last slice
        }
        Ok(classes)
    }

    /// Meshes and writes all tiles of some bands; results by rising y, then x.
    fn mesh_bands<T: Voxel>(
        &self,
        source: &BandSource<T>,
        bands: &[Band<T>],
        first: u32,
        layer: u32,
        workspaces: &Mutex<Vec<Workspace>>,
    ) -> Result<Vec<TileResult>> {
        let tiles_x = self.plan.tiling.tiles()[0] as usize;
        let settings = MeshSettings {
            threshold: self.threshold,
            rule: self.rule,
            cap: self.cap,
            area: AreaScale::new(source.volume.header().placement.spacing),
            budget: self.plan.tile_budget / self.plan.threads as u64,
            limit: self.plan.limit,
            threads: self.plan.threads as u64,
        };
        let tiles: Result<Vec<Option<TileResult>>> = (0..bands.len() * tiles_x)
            .into_par_iter()
            .with_max_len(1)
            .map(|i| {
                let band = &bands[i / tiles_x];
                let ty = first + (i / tiles_x) as u32;
                let grid = [(i % tiles_x) as u32, ty, layer];
                let view = BandView {
                    voxels: &band.voxels,
                    bits: &band.bits,
                    runs: &band.runs,
                    class_of_run: &band.labels.of_run,
                };
                let pooled = workspaces.lock().expect("no thread panicked").pop();
                let mut workspace: Workspace = pooled.unwrap_or_default();
                let result = self.one_tile(&view, grid, &settings, &mut workspace);
                workspaces
                    .lock()
                    .expect("no thread panicked")
                    .push(workspace);
                self.progress.advance(1);
                result
            })
            .collect();
        Ok(tiles?.into_iter().flatten().collect())
    }

    fn one_tile<T: Voxel>(
        &self,
        view: &BandView<T>,
        grid: [u32; 3],
        settings: &MeshSettings,
        workspace: &mut Workspace,
    ) -> Result<Option<TileResult>> {
        let tile = TileBox::of(self.plan.tiling, grid);
        let mesh = &mut workspace.mesh;
        if !workspace.mesher.mesh(view, &tile, settings, mesh)? {
            return Ok(None);
        }
        let (record, pieces) = self.writer.write(mesh, grid, &mut workspace.writer)?;
        let open = mesh.pieces.iter().filter(|p| !p.cap);
        let parts = open
            .map(|p| SurfacePart {
                object: p.object,
                cell: p.cell,
                key: p.key,
                sums: p.sums,
            })
            .collect();
        let mut caps = MeshSums::default();
        mesh.pieces
            .iter()
            .filter(|p| p.cap)
            .for_each(|p| caps.merge(&p.sums));
        Ok(Some(TileResult {
            record,
            pieces,
            parts,
            caps,
        }))
    }

    /// Joins the slab's surfaces, writes off what has finished and spools the rest.
    fn finish_slab(
        &self,
        layer: u32,
        classes: &SlabClasses,
        tiles: Vec<TileResult>,
        state: &mut State,
    ) -> Result<()> {
        let forward = &mut state.forward;
        tiles.iter().for_each(|t| forward.caps.merge(&t.caps));
        let parts = tiles.iter().flat_map(|t| &t.parts).copied();
        let surfaces = state
            .surfaces
            .join(classes, parts, &mut forward.surface_births)?;
        let mut live = classes.live.iter().peekable();
        for (class, record) in classes.records.iter().enumerate() {
            if live.peek() == Some(&&(class as u32)) {
                live.next();
                continue;
            }
            let finished = FinishedComponent {
                sums: record.sums,
                birth: record.birth,
                reserved: 0,
            };
            let spool = if record.above {
                &mut forward.objects
            } else {
                &mut forward.cells
            };
            spool.push(&[finished])?;
        }
        let slab = self.spool_slab(layer, classes, &surfaces, tiles, &mut forward.spool)?;
        forward.slabs.push(slab);
        Ok(())
    }

    fn spool_slab(
        &self,
        layer: u32,
        classes: &SlabClasses,
        surfaces: &SlabSurfaces,
        tiles: Vec<TileResult>,
        spool: &mut Spool,
    ) -> Result<SlabRecord> {
        let births: Vec<u64> = classes.records.iter().map(|r| r.birth).collect();
        let above: Vec<u8> = classes.records.iter().map(|r| u8::from(r.above)).collect();
        let mut records = Vec::with_capacity(tiles.len());
        let mut all_pieces = Vec::new();
        for TileResult {
            record, mut pieces, ..
        } in tiles
        {
            records.push(record);
            for piece in pieces.iter_mut().filter(|p| !p.is_cap()) {
                piece.surface = surfaces.find(piece.object, piece.cell);
            }
            all_pieces.extend(pieces);
        }
        Ok(SlabRecord {
            layer,
            births: spool.push(&births)?,
            above: spool.push(&above)?,
            live: spool.push(&classes.live)?,
            from_previous: spool.push(&classes.from_previous)?,
            surfaces: spool.push(&surfaces.all)?,
            surfaces_live: spool.push(&surfaces.live)?,
            surfaces_from_previous: spool.push(&surfaces.from_previous)?,
            tiles: spool.push(&records)?,
            pieces: spool.push(&all_pieces)?,
        })
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
    fn release<T: Voxel>(&self, source: &BandSource<T>, layer: u32) {
        let z = source.span(0, layer).z;
        source
            .volume
            .release(z.start.saturating_sub(1)..z.end.saturating_sub(2).max(z.start));
    }
}

/// Turns the bands' labels of runs from local components into classes of the slab.
fn take_classes<T: Voxel>(bands: &mut [Band<T>], first: u32, classes: &SlabClasses) {
    bands.par_iter_mut().enumerate().for_each(|(i, band)| {
        let class_of = &classes.of_local[first as usize + i];
        band.labels
            .of_run
            .iter_mut()
            .for_each(|label| *label = class_of[*label as usize]);
    });
}
