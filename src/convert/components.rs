//! Every component and surface of the volume, with the sums over its voxels and triangles.

use crate::convert::label::{EndedComponents, Labelled};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::WrittenPiece;
use crate::convert::resolve::{ComponentId, Ids, Resolved};
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::spill_file::SpillFile;
use std::path::Path;

/// Every component and surface of the volume; record i has id i + 1.
pub struct Components {
    /// Objects.
    pub objects: RecordTable<ComponentRecord>,
    /// Cells.
    pub cells: RecordTable<ComponentRecord>,
    /// Surfaces.
    pub surfaces: RecordTable<SurfaceRecord>,
}

/// Sums up what labelling has found of components and meshing of their surfaces; tables larger than `memory` bytes go to
/// temporary files in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn sum_up(
    labelled: &mut Labelled,
    resolved: &mut Resolved,
    meshed: &mut MeshOutput,
    memory: u64,
    work: &Path,
) -> Result<Components> {
    let of_each = FOR_EACH_TABLE.of(memory);
    let counts = resolved.counts;
    let mut components = Components {
        objects: RecordTable::new(counts.objects, of_each, work)?,
        cells: RecordTable::new(counts.cells, of_each, work)?,
        surfaces: RecordTable::new(counts.surfaces, of_each, work)?,
    };
    for layer in 0..meshed.layers() {
        let slab = labelled
            .slabs
            .get(layer as usize)?
            .expect("one for each layer");
        let classes = resolved.classes(layer.into())?;
        let above = labelled.spool.get(&slab.above)?;
        for ended in slab.ended(&mut labelled.spool)? {
            components.add_ended(&mut labelled.spool, &ended, &above, &classes)?;
        }
        for tile in meshed.tiles(layer)? {
            components.add_tile(&tile.pieces(&mut meshed.spool)?)?;
        }
    }
    components.add_meshes()?;
    Ok(components)
}

impl Components {
    /// Enters components that have ended, given the phases and components of all classes.
    fn add_ended(
        &mut self,
        spool: &mut SpillFile,
        ended: &EndedComponents,
        above: &[u8],
        classes: &[ComponentId],
    ) -> Result<()> {
        let class_of = spool.get(&ended.classes)?;
        let mut class_of = class_of.iter();
        spool.for_each(&ended.sums, |voxels| {
            let class = *class_of.next().expect("as many as there are sums") as usize;
            let table = if above[class] == 1 {
                &mut self.objects
            } else {
                &mut self.cells
            };
            table.update(classes[class].id - 1, |record| record.voxels = voxels)
        })
    }

    /// Adds a tile: its pieces to their surfaces, and one to the number of tiles of all that they are part of.
    fn add_tile(&mut self, pieces: &[WrittenPiece]) -> Result<()> {
        let open = || pieces.iter().filter(|piece| !piece.is_cap());
        for piece in open() {
            let ids = piece.ids;
            self.surfaces.update(ids.surface - 1, |record| {
                record.mesh.merge(&piece.sums);
                (record.object, record.cell) = (ids.object, ids.cell);
                record.touches_border = u64::from(record.mesh.border_edges > 0);
                record.tiles += 1;
            })?;
        }
        let distinct = |get: fn(&Ids) -> u64| {
            let mut ids: Vec<u64> = open().map(|piece| get(&piece.ids)).collect();
            ids.sort_unstable();
            ids.dedup();
            ids
        };
        for id in distinct(|ids| ids.object) {
            self.objects.update(id - 1, |r| r.tiles += 1)?;
        }
        for id in distinct(|ids| ids.cell) {
            self.cells.update(id - 1, |r| r.tiles += 1)?;
        }
        Ok(())
    }

    /// Adds every surface's sums to its object and cell.
    fn add_meshes(&mut self) -> Result<()> {
        for i in 0..self.surfaces.len() {
            let surface = self.surfaces.get(i)?;
            for (table, id) in [
                (&mut self.objects, surface.object),
                (&mut self.cells, surface.cell),
            ] {
                table.update(id - 1, |record| {
                    record.mesh.merge(&surface.mesh);
                    record.surfaces += 1;
                })?;
            }
        }
        Ok(())
    }
}
