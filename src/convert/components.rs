//! Every component and surface of the volume, with the sums over its voxels and triangles.

use crate::convert::cells::GivenCells;
use crate::convert::label::{EndedComponents, Labelled};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::WrittenPiece;
use crate::convert::resolve::{ComponentId, Resolved};
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::id_set::IdRanks;
use crate::sys::spill_file::SpillFile;
use std::path::Path;

/// In the place of the component of a cell that has voxels in several.
pub const SEVERAL: u64 = u64::MAX;

/// Every component and surface of the volume, and the cells, where these are parts of components.
pub struct Components {
    /// Objects; record i has id i + 1.
    pub objects: RecordTable<ComponentRecord>,
    /// Cells, by the places of their ids.
    pub cells: RecordTable<ComponentRecord>,
    /// Surfaces; record i has id i + 1.
    pub surfaces: RecordTable<SurfaceRecord>,
    /// What there is where cells are given: without, each component of voxels below is a cell, and record i has id i + 1.
    pub given: Option<Given>,
}

/// What is known where cells are parts of components.
pub struct Given {
    /// Ids of the cells.
    pub ids: IdRanks,
    /// Components of voxels below; record i has id i + 1.
    pub components: RecordTable<ComponentRecord>,
    /// The component of each cell, by the places of their ids, or [`SEVERAL`].
    pub component_of: RecordTable<u64>,
    /// Where cells touch, by rising ids.
    pub contacts: SpillFile,
}

impl Given {
    /// The place of a cell.
    fn place(&self, cell: u64) -> u64 {
        self.ids.rank(cell).expect("cells of pieces have voxels")
    }
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
    cells: Option<&mut GivenCells>,
    memory: u64,
    work: &Path,
) -> Result<Components> {
    let of_each = FOR_EACH_TABLE.of(memory);
    let counts = resolved.counts;
    let table = |count| RecordTable::new(count, of_each, work);
    let given = match &cells {
        Some(cells) => Some(Given {
            ids: cells.ids.clone(),
            components: table(counts.cells)?,
            component_of: RecordTable::new(cells.ids.len(), of_each, work)?,
            contacts: SpillFile::new(work)?,
        }),
        None => None,
    };
    let cell_count = given.as_ref().map_or(counts.cells, |given| given.ids.len());
    let mut components = Components {
        objects: table(counts.objects)?,
        cells: table(cell_count)?,
        surfaces: RecordTable::new(counts.surfaces, of_each, work)?,
        given,
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
    if let Some(cells) = cells {
        components.add_cells(cells)?;
    }
    Ok(components)
}

impl Components {
    /// The record of a cell, by its id.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn cell(&self, id: u64) -> Result<ComponentRecord> {
        let place = self.given.as_ref().map_or(id - 1, |given| given.place(id));
        self.cells.get(place)
    }

    /// The table of components of voxels below, which are the cells unless these are given.
    fn below(&mut self) -> &mut RecordTable<ComponentRecord> {
        match &mut self.given {
            Some(given) => &mut given.components,
            None => &mut self.cells,
        }
    }

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
            let table = match above[class] {
                1 => &mut self.objects,
                _ => self.below(),
            };
            table.update(classes[class].id - 1, |record| record.voxels = voxels)
        })
    }

    /// Adds a tile: its pieces to their surfaces, and one to the number of tiles of all that they are part of.
    fn add_tile(&mut self, pieces: &[WrittenPiece]) -> Result<()> {
        let open = || pieces.iter().filter(|piece| !piece.is_cap());
        for piece in open() {
            let (ids, component) = (piece.ids, piece.component);
            self.surfaces.update(ids.surface - 1, |record| {
                record.mesh.merge(&piece.sums);
                (record.object, record.cell) = (ids.object, component);
                record.touches_border = u64::from(record.mesh.border_edges > 0);
            })?;
        }
        let distinct = |get: fn(&WrittenPiece) -> u64| {
            let mut ids: Vec<u64> = open().map(get).collect();
            ids.sort_unstable();
            ids.dedup();
            ids
        };
        for id in distinct(|piece| piece.ids.surface) {
            self.surfaces.update(id - 1, |r| r.tiles += 1)?;
        }
        for id in distinct(|piece| piece.ids.object) {
            self.objects.update(id - 1, |r| r.tiles += 1)?;
        }
        for id in distinct(|piece| piece.component) {
            self.below().update(id - 1, |r| r.tiles += 1)?;
        }
        let Some(given) = &self.given else {
            return Ok(());
        };
        for piece in open() {
            let place = given.place(piece.ids.cell);
            self.cells
                .update(place, |record| record.mesh.merge(&piece.sums))?;
        }
        for id in distinct(|piece| piece.ids.cell) {
            self.cells.update(given.place(id), |r| r.tiles += 1)?;
        }
        Ok(())
    }

    /// Adds every surface's sums to its object and component.
    fn add_meshes(&mut self) -> Result<()> {
        for i in 0..self.surfaces.len() {
            let surface = self.surfaces.get(i)?;
            let add = |record: &mut ComponentRecord| {
                record.mesh.merge(&surface.mesh);
                record.surfaces += 1;
            };
            self.objects.update(surface.object - 1, add)?;
            self.below().update(surface.cell - 1, add)?;
        }
        Ok(())
    }

    /// Enters the voxels of cells that are given, and where they touch.
    fn add_cells(&mut self, from: &mut GivenCells) -> Result<()> {
        let Some(given) = &mut self.given else {
            return Ok(());
        };
        let table = &mut self.cells;
        from.take_contacts(|contact| {
            given.contacts.push(&[contact])?;
            let mut cells = contact.cells.into_iter();
            cells.try_for_each(|cell| table.update(given.place(cell), |r| r.neighbours += 1))
        })?;
        given.contacts.mark()?;
        from.take_parts(|part| {
            let (place, component) = (given.place(part.cell), part.component);
            let whole = given.components.get(component - 1)?;
            table.update(place, |record| {
                // of several components, the first ones that are merged have no sums yet
                let first = record.voxels.voxels == 0;
                match first {
                    true => record.voxels = part.sums,
                    false => record.voxels.merge(&part.sums),
                }
                record.surfaces += whole.surfaces;
                if record.neighbours == 0 {
                    // then all of the component is in it
                    record.voxels.border_euler += whole.voxels.border_euler;
                }
            })?;
            given.component_of.update(place, |of| {
                *of = match *of {
                    0 => component,
                    _ => SEVERAL,
                }
            })
        })
    }
}
