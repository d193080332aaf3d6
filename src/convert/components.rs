//! Every component and surface of the volume, with the sums over its voxels and triangles.

use crate::convert::cells::{GivenCells, Opening};
use crate::convert::label::{EndedComponents, Labelled};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::WrittenPiece;
use crate::convert::resolve::{ComponentId, Resolved};
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
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

/// What more is known of a cell that is a part of a component.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PartRecord {
    /// The component, or [`SEVERAL`].
    pub component: u64,
    /// Radius of its widest opening; 0 if that is not known, or there is none.
    pub largest_neck: f64,
}

/// What is known where cells are parts of components.
pub struct Given {
    /// The cells.
    pub cells: GivenCells,
    /// Components of voxels below; record i has id i + 1.
    pub components: RecordTable<ComponentRecord>,
    /// What more is known of each cell, by the places of their ids.
    pub parts: RecordTable<PartRecord>,
}

impl Given {
    /// The place of a cell.
    fn place(&self, cell: u64) -> u64 {
        self.cells
            .ids
            .rank(cell)
            .expect("cells of pieces have voxels")
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
    cells: Option<GivenCells>,
    memory: u64,
    work: &Path,
) -> Result<Components> {
    let of_each = FOR_EACH_TABLE.of(memory);
    let counts = resolved.counts;
    let table = |count| RecordTable::new(count, of_each, work);
    let given = match cells {
        Some(cells) => Some(Given {
            components: table(counts.cells)?,
            parts: RecordTable::new(cells.ids.len(), of_each, work)?,
            cells,
        }),
        None => None,
    };
    let cell_count = given
        .as_ref()
        .map_or(counts.cells, |given| given.cells.ids.len());
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
    components.add_cells()?;
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
    fn add_cells(&mut self) -> Result<()> {
        let Some(Given {
            cells: from,
            components,
            parts,
        }) = &mut self.given
        else {
            return Ok(());
        };
        let (table, ids) = (&mut self.cells, from.ids.clone());
        let place_of = |cell| ids.rank(cell).expect("cells have voxels");
        from.openings.each(|opening: Opening| {
            opening.cells.into_iter().try_for_each(|cell| {
                let place = place_of(cell);
                table.update(place, |record| record.necks += 1)?;
                // NaN is not larger than anything
                parts.update(place, |part| {
                    part.largest_neck = part.largest_neck.max(opening.radius);
                })
            })
        })?;
        from.take_parts(|part| {
            let (place, component) = (place_of(part.cell), part.component);
            let whole = components.get(component - 1)?;
            table.update(place, |record| {
                // of several components, the first ones that are merged have no sums yet
                let first = record.voxels.voxels == 0;
                match first {
                    true => record.voxels = part.sums,
                    false => record.voxels.merge(&part.sums),
                }
                record.surfaces += whole.surfaces;
                if record.necks == 0 {
                    // then all of the component is in it
                    record.voxels.border_euler += whole.voxels.border_euler;
                }
            })?;
            parts.update(place, |part| {
                part.component = match part.component {
                    0 => component,
                    _ => SEVERAL,
                }
            })
        })
    }
}
