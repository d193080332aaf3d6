//! The tiles of a slab whose bands are labelled: meshed, written, and gathered.

use crate::convert::finalize::batch_size::nodes_bytes;
use crate::convert::scan::Sweep;
use crate::convert::scan::band::Band;
use crate::convert::scan::mode::Parts;
use crate::convert::scan::slab::Slab;
use crate::convert::scan::surfaces::SurfacePart;
use crate::convert::scan::tile_writer::WrittenPiece;
use crate::convert::scan::workspace_pool::Workspace;
use crate::error::Result;
use crate::measure::{AreaScale, MeshSums};
use crate::surface::{BandView, MeshSettings, Sizes, TileBox, by_surface};
use crate::sys::background_writer::BackgroundWriters;
use crate::tile::MAX_NODES;
use crate::volume::Voxel;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::ops::Deref;

/// A tile to mesh.
pub struct TileJob<B> {
    /// Memory that this takes.
    pub bytes: u64,
    /// The band that it lies in.
    pub band: B,
    /// Its macrocube.
    pub grid: [u32; 3],
    /// Its cubes.
    pub tile: TileBox,
    /// There is something to mesh.
    pub has_surface: bool,
}

/// Places of tiles in their order.
pub type Turn = (Reverse<Option<u32>>, [u32; 2]);

impl<B> TileJob<B> {
    /// The order in which tiles of a slab are made: small ones last, so that no thread is left with a large one
    /// when the others have none; those of about the same size beside their neighbours.
    pub fn turn(&self) -> Turn {
        let [x, y, _] = self.grid;
        (Reverse(self.bytes.checked_ilog2()), [y, x])
    }
}

impl Sweep<'_> {
    /// Meshes all tiles of some bands of a layer, from band `first` on, and writes them, or hands them to the
    /// writers.
    ///
    /// # Errors
    /// As of [`Sweep::mesh_tile`].
    pub fn mesh_bands<T: Voxel>(
        &self,
        parts: &Parts<T>,
        bands: &[Band<T>],
        first: u32,
        layer: u32,
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
    pub fn tile_of<T: Voxel, B: Deref<Target = Band<T>>>(
        &self,
        band: B,
        grid: [u32; 3],
    ) -> TileJob<B> {
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
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`]; [`crate::Error::Usage`] if the tile would pass 4 GiB.
    pub fn mesh_tile<T: Voxel, B: Deref<Target = Band<T>>>(
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
                    self.write_tile(&job.tile, job.grid, workspace, writers, slab)?;
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
        tile: &TileBox,
        grid: [u32; 3],
        workspace: &mut Workspace,
        writers: Option<&BackgroundWriters>,
        slab: &Slab,
    ) -> Result<()> {
        let Workspace {
            mesh, stripifier, ..
        } = workspace;
        let provisional = slab.is_provisional(&mesh.pieces);
        let written = self
            .writer
            .write(mesh, grid, stripifier, writers, provisional);
        let (record, body) = written?;
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
}

/// Turns a band's labels of runs from local components into classes of the slab.
pub fn take_classes<T>(band: &mut Band<T>, class_of: &[u32]) {
    let labels = band.labels.of_run.iter_mut();
    labels.for_each(|label| *label = class_of[*label as usize]);
}
