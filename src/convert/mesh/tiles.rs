//! The tiles of a band: meshed and written.

use crate::convert::finalize::batch_size::nodes_bytes;
use crate::convert::mesh::Meshing;
use crate::convert::mesh::band::MeshBand;
use crate::convert::mesh::tile_writer::{TileRecord, WrittenPiece};
use crate::convert::mesh::workspace_pool::Workspace;
use crate::error::Result;
use crate::measure::{AreaScale, MeshSums};
use crate::surface::{BandView, CellsView, MeshSettings, Sizes, TileBox};
use crate::tile::MAX_NODES;
use crate::volume::Voxel;
use std::cell::RefCell;

/// A tile that is written.
pub struct WrittenTile {
    /// The tile.
    pub record: TileRecord,
    /// Its pieces.
    pub pieces: Vec<WrittenPiece>,
    /// Sums over its caps.
    pub caps: MeshSums,
}

impl Meshing<'_> {
    /// Meshes a tile of a band and writes it, if it has any surface.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`]; [`crate::Error::Usage`] if the tile would pass 4 GiB.
    pub fn mesh_tile<T: Voxel>(
        &self,
        band: &MeshBand<T>,
        grid: [u32; 3],
    ) -> Result<Option<WrittenTile>> {
        let options = self.job.options;
        let settings = MeshSettings {
            threshold: options.threshold,
            rule: options.ambiguous,
            cap: options.cap,
            area: AreaScale::new(self.volume.header().placement.spacing),
        };
        let tile = TileBox::of(self.job.plan.tiling, grid);
        let sizes = &band.sizes[grid[0] as usize];
        let per_triangle = self.job.plan.per_triangle;
        let mut bytes = sizes.bytes(&tile, per_triangle);
        if self.cells.is_some() {
            bytes += sizes.bytes_to_split();
        }
        let with_parts = |parts: &Sizes| bytes + parts.bytes_of_parts(per_triangle);
        let mut most = bytes;
        loop {
            let made = self.workspaces.with(most, |workspace| {
                let Workspace {
                    mesher, mesh, held, ..
                } = workspace;
                let held = RefCell::new(held);
                let fits = |parts: &Sizes| held.borrow_mut().grow_to(with_parts(parts)).is_ok();
                let view = BandView {
                    voxels: &band.voxels,
                    bits: &band.known.bits,
                    runs: &band.known.runs,
                    class_of_run: &band.known.class_of_run,
                    cells: self.cells.map(|_| CellsView {
                        of_voxels: &band.cells,
                        of_class: &band.cell_of_class,
                        fits: &fits,
                    }),
                };
                match mesher.mesh(&view, &tile, &settings, mesh) {
                    Ok(true) => self.write_tile(band, grid, workspace).map(Some).map(Ok),
                    Ok(false) => Ok(Ok(None)),
                    Err(parts) => Ok(Err(parts)),
                }
            })?;
            match made {
                Ok(made) => return Ok(made),
                // once more, when others have given back what they hold
                Err(parts) => most = with_parts(&parts),
            }
        }
    }

    /// Writes the workspace's mesh.
    fn write_tile<T>(
        &self,
        band: &MeshBand<T>,
        grid: [u32; 3],
        workspace: &mut Workspace,
    ) -> Result<WrittenTile> {
        let Workspace {
            mesh, stripifier, ..
        } = workspace;
        let writers = self.writers.as_ref();
        let (record, body) = self.writer.write(mesh, grid, stripifier, writers)?;
        // now, and not when all of the volume has been meshed; others have no more nodes than always fit
        let nodes = body.pieces.len();
        if nodes > MAX_NODES && !self.writer.head.merges(nodes) {
            self.job.plan.check_finishing(nodes_bytes(&record))?;
        }
        let mut caps = MeshSums::default();
        let mut pieces = Vec::with_capacity(nodes);
        for (piece, body) in mesh.pieces.iter().zip(body.pieces) {
            if piece.is_cap() {
                caps.merge(&piece.sums);
            }
            pieces.push(WrittenPiece::new(piece, body, &band.known.components));
        }
        Ok(WrittenTile {
            record,
            pieces,
            caps,
        })
    }
}
