//! Every component, cell and surface of the volume, with the sums over its voxels and triangles.

use crate::convert::cells::{
    CellIds, CellInComponent, GivenCells, KnownCells, Opening, each_in_component,
};
use crate::convert::id_places::IdPlaces;
use crate::convert::label::{EndedComponents, Labelled};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::WrittenPiece;
use crate::convert::resolve::{ComponentId, Each, Resolved};
use crate::convert::walls::CellWalls;
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// In the place of the component of a cell that has voxels in several.
pub const SEVERAL: u64 = u64::MAX;
/// Pairs of a cell and an object that are sorted in memory.
const ROOM: usize = 1 << 16;

/// Every component and surface of the volume, and the cells, where these are parts of components. Of a part of the
/// volume, those that begin there, and of those that go on there what is there.
pub struct Components {
    /// Objects, by their places.
    pub objects: RecordTable<ComponentRecord>,
    /// Cells, by the places of their ids.
    pub cells: RecordTable<ComponentRecord>,
    /// Surfaces, by their places.
    pub surfaces: RecordTable<SurfaceRecord>,
    /// The places of ids; of those of cells where none are given.
    pub places: Each<IdPlaces>,
    /// Tables of these have titles: they are those of the whole volume, or the first part of them.
    pub has_titles: bool,
    /// What there is where cells are given: without, each component of voxels below is a cell, and record i has id i + 1.
    pub given: Option<Given>,
    /// The walls between cells, if these were asked for.
    pub walls: Option<CellWalls>,
}

/// What more is known of a cell that is a part of a component.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub struct PartRecord {
    /// The component, or [`SEVERAL`].
    pub component: u64,
    /// Radius of its widest opening; 0 if that is not known, or there is none.
    pub largest_neck: f64,
    /// Place of its first surface: all surfaces of a cell follow each other by objects.
    first_surface: u64,
    /// Euler characteristics of the borders of the components that it has voxels in, where labels give cells in parts of the
    /// volume.
    pub borders: i64,
}

impl PartRecord {
    /// Adds what is known of the cell elsewhere, but for its first surface.
    pub fn merge(&mut self, other: &PartRecord) {
        self.component = match (self.component, other.component) {
            (one, 0) => one,
            (0, other) => other,
            (one, other) if one == other => one,
            _ => SEVERAL,
        };
        self.largest_neck = self.largest_neck.max(other.largest_neck);
        self.borders += other.borders;
    }
}

/// What is known where cells are parts of components.
pub struct Given {
    /// The cells.
    pub cells: KnownCells,
    /// Components of voxels below.
    pub components: RecordTable<ComponentRecord>,
    /// The places of their ids.
    pub places: IdPlaces,
    /// What more is known of each cell, by the places of their ids.
    pub parts: RecordTable<PartRecord>,
}

impl Given {
    /// The place of a cell.
    fn place(&self, cell: u64) -> u64 {
        self.cells.ids.place(cell)
    }
}

/// A cell and an object that have a surface between them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
struct Pair {
    cell: u64,
    object: u64,
}

impl Keyed for Pair {
    fn key(&self) -> [u64; 2] {
        [self.cell, self.object]
    }
}

/// What is summed up.
pub struct SumUp<'a> {
    /// What labelling has found.
    pub labelled: &'a mut Labelled,
    /// What components that is.
    pub resolved: &'a mut Resolved,
    /// What meshing has found of their surfaces.
    pub meshed: &'a mut MeshOutput,
    /// Where the records of their ids are to lie.
    pub places: Each<IdPlaces>,
}

/// Sums up what labelling has found of components and meshing of their surfaces; tables larger than `memory` bytes go to
/// temporary files in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn sum_up(
    input: SumUp,
    cells: Option<GivenCells>,
    memory: u64,
    work: &Path,
) -> Result<Components> {
    let SumUp {
        labelled,
        resolved,
        meshed,
        mut places,
    } = input;
    let of_each = FOR_EACH_TABLE.of(memory);
    let table = |count| RecordTable::new(count, of_each, work);
    let mut in_components = None;
    let mut components = match cells {
        None => Components::none_yet(places, memory, work)?,
        Some(GivenCells { known, parts, .. }) => {
            in_components = Some(parts);
            let count = known.ids.len();
            let given = Given {
                components: table(places.cells.len())?,
                places: std::mem::take(&mut places.cells),
                parts: RecordTable::new(count, of_each, work)?,
                cells: known,
            };
            let mut components = Components {
                objects: table(places.objects.len())?,
                cells: table(count)?,
                surfaces: RecordTable::new(0, of_each, work)?,
                places,
                has_titles: true,
                given: Some(given),
                walls: None,
            };
            components.number_surfaces(meshed, of_each, work)?;
            components
        }
    };
    for layer in meshed.layers().each() {
        let slab = labelled.slabs.get(layer)?;
        let classes = resolved.classes(layer)?;
        let above = labelled.spool.get(&slab.above)?;
        for ended in slab.ended(&mut labelled.spool)? {
            components.add_ended(&mut labelled.spool, &ended, &above, &classes)?;
        }
        for tile in meshed.tiles(layer)? {
            components.add_tile(&tile.pieces(&mut meshed.spool)?)?;
        }
    }
    components.add_meshes()?;
    if let Some(parts) = in_components {
        components.add_given(parts)?;
    }
    Ok(components)
}

impl Components {
    /// Without anything of components that have these places yet.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if a temporary file fails.
    pub fn none_yet(places: Each<IdPlaces>, memory: u64, work: &Path) -> Result<Self> {
        let of_each = FOR_EACH_TABLE.of(memory);
        Ok(Components {
            objects: RecordTable::new(places.objects.len(), of_each, work)?,
            cells: RecordTable::new(places.cells.len(), of_each, work)?,
            surfaces: RecordTable::new(places.surfaces.len(), of_each, work)?,
            places,
            has_titles: true,
            given: None,
            walls: None,
        })
    }

    /// The record of a cell, by its id.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn cell(&self, id: u64) -> Result<ComponentRecord> {
        self.cells.get(self.place_of_cell(id))
    }

    /// The place of a cell in the table, by its id.
    pub fn place_of_cell(&self, id: u64) -> u64 {
        match &self.given {
            Some(given) => given.place(id),
            None => self.places.cells.of(id),
        }
    }

    /// The id of the cell in a place of the table.
    pub fn id_of_cell(&self, place: u64) -> u64 {
        match &self.given {
            Some(given) => given.cells.ids.id(place),
            None => self.places.cells.id(place),
        }
    }

    /// The id of the surface that a piece, which is no cap, is part of: where cells are given, that between the cell and
    /// the object.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn surface_of(&self, piece: &WrittenPiece) -> Result<u64> {
        let Some(given) = &self.given else {
            return Ok(piece.ids.surface);
        };
        let place = given.place(piece.ids.cell);
        let [mut low, mut high] = match place < given.cells.ids.own() || self.is_numbered_here() {
            true => {
                let first = given.parts.get(place)?.first_surface;
                [first, first + self.cells.get(place)?.surfaces]
            }
            // of cells of other parts of the volume, some surfaces are here, behind all others
            false => [self.places.surfaces.own, self.surfaces.len()],
        };
        let key = [piece.ids.cell, piece.ids.object];
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            let found = self.surfaces.get(middle)?;
            match [found.cell, found.object] <= key {
                true => low = middle,
                false => high = middle,
            }
        }
        Ok(self.places.surfaces.id(low))
    }

    /// How many cells begin in this part of the volume: the first records of their table.
    pub fn own_cells(&self) -> u64 {
        match &self.given {
            Some(given) => given.cells.ids.own(),
            None => self.places.cells.own,
        }
    }

    /// True if surfaces are numbered by what is in this part of the volume alone.
    fn is_numbered_here(&self) -> bool {
        self.places.surfaces.own == self.surfaces.len()
    }

    /// Numbers surfaces by cells, then objects.
    fn number_surfaces(&mut self, meshed: &mut MeshOutput, memory: u64, work: &Path) -> Result<()> {
        let mut sorter = Sorter::new(work, ROOM)?;
        for layer in meshed.layers().each() {
            for tile in meshed.tiles(layer)? {
                for piece in tile.pieces(&mut meshed.spool)? {
                    if !piece.is_cap() {
                        let (cell, object) = (piece.ids.cell, piece.ids.object);
                        sorter.push(Pair { cell, object })?;
                    }
                }
            }
        }
        let mut pairs = SpillFile::new(work)?;
        let mut count = 0;
        let same = |_: &mut Pair, _: &Pair| ();
        sorter.finish_merged(same, |pair| {
            count += 1;
            pairs.push(&[pair]).map(|_| ())
        })?;
        pairs.mark()?;
        self.surfaces = RecordTable::new(count, memory, work)?;
        self.places.surfaces = IdPlaces::all(count);
        let given = self.given.as_mut().expect("surfaces of given cells");
        let ids = &given.cells.ids;
        let (mut surface, mut before) = (0, 0);
        pairs.each(|Pair { cell, object }| {
            let place = ids.place(cell);
            self.surfaces
                .update(surface, |r| (r.cell, r.object) = (cell, object))?;
            self.cells.update(place, |record| record.surfaces += 1)?;
            if cell != before {
                before = cell;
                let parts = &mut given.parts;
                parts.update(place, |part| part.first_surface = surface)?;
            }
            surface += 1;
            Ok(())
        })
    }

    /// The table of components of one phase, and the place of one of them: those of voxels below are the cells unless
    /// these are given.
    fn component(&mut self, above: bool, id: u64) -> (&mut RecordTable<ComponentRecord>, u64) {
        match (above, &mut self.given) {
            (true, _) => (&mut self.objects, self.places.objects.of(id)),
            (false, Some(given)) => (&mut given.components, given.places.of(id)),
            (false, None) => (&mut self.cells, self.places.cells.of(id)),
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
            let (table, place) = self.component(above[class] == 1, classes[class].id);
            table.update(place, |record| record.add_voxels(&voxels))
        })
    }

    /// Adds a tile: its pieces to their surfaces, and one to the number of tiles of all that they are part of.
    fn add_tile(&mut self, pieces: &[WrittenPiece]) -> Result<()> {
        let open = || pieces.iter().filter(|piece| !piece.is_cap());
        let mut surfaces = Vec::with_capacity(pieces.len());
        for piece in open() {
            let (ids, surface) = (piece.ids, self.surface_of(piece)?);
            surfaces.push(surface);
            let place = self.places.surfaces.of(surface);
            self.surfaces.update(place, |record| {
                record.mesh.merge(&piece.sums);
                (record.object, record.cell) = (ids.object, ids.cell);
                record.touches_border = u64::from(record.mesh.border_edges > 0);
            })?;
            if let Some(given) = &mut self.given {
                let place = given.places.of(piece.component);
                let component = &mut given.components;
                component.update(place, |r| r.mesh.merge(&piece.sums))?;
            }
        }
        let sorted = |mut ids: Vec<u64>| {
            ids.sort_unstable();
            ids.dedup();
            ids
        };
        let distinct = |get: fn(&WrittenPiece) -> u64| sorted(open().map(get).collect());
        for surface in sorted(surfaces) {
            let place = self.places.surfaces.of(surface);
            self.surfaces.update(place, |r| r.tiles += 1)?;
        }
        for object in distinct(|piece| piece.ids.object) {
            let place = self.places.objects.of(object);
            self.objects.update(place, |r| r.tiles += 1)?;
        }
        for cell in distinct(|piece| piece.ids.cell) {
            let place = self.place_of_cell(cell);
            self.cells.update(place, |r| r.tiles += 1)?;
        }
        if let Some(given) = &mut self.given {
            for component in distinct(|piece| piece.component) {
                let place = given.places.of(component);
                given.components.update(place, |r| r.tiles += 1)?;
            }
        }
        Ok(())
    }

    /// Adds every surface's sums to its object and cell. It is counted where it begins.
    fn add_meshes(&mut self) -> Result<()> {
        let is_given = self.given.is_some();
        for i in 0..self.surfaces.len() {
            let surface = self.surfaces.get(i)?;
            if surface.object == 0 {
                // it has no triangle in this part
                continue;
            }
            let counted = u64::from(i < self.places.surfaces.own);
            let add = |record: &mut ComponentRecord, count: u64| {
                record.mesh.merge(&surface.mesh);
                record.surfaces += count;
            };
            let of_cell = if is_given { 0 } else { counted };
            let place = self.place_of_cell(surface.cell);
            self.cells.update(place, |record| add(record, of_cell))?;
            let place = self.places.objects.of(surface.object);
            self.objects.update(place, |record| add(record, counted))?;
        }
        Ok(())
    }

    /// Enters the voxels of cells that are given, and where they touch.
    fn add_given(&mut self, in_components: Sorter<CellInComponent>) -> Result<()> {
        let given = self.given.as_mut().expect("given cells");
        let Given {
            cells:
                KnownCells {
                    ids,
                    openings,
                    pairs,
                    ..
                },
            components,
            places,
            parts,
        } = given;
        let table = &mut self.cells;
        openings.each(|opening: Opening| {
            opening.cells.into_iter().try_for_each(|cell| {
                let place = ids.place(cell);
                table.update(place, |record| record.necks += 1)?;
                // NaN is not larger than anything
                parts.update(place, |part| {
                    part.largest_neck = part.largest_neck.max(opening.radius);
                })
            })
        })?;
        each_in_component(in_components, |part| {
            let (place, component) = (ids.place(part.cell), part.component);
            table.update(place, |record| record.add_voxels(&part.sums))?;
            if let Some(pairs) = pairs {
                pairs.push(&[[part.cell, component]])?;
            }
            if matches!(ids, CellIds::Ranked(_)) {
                let whole = components.get(places.of(component))?;
                let border = whole.voxels.border_euler;
                table.update(place, |record| add_border(record, border))?;
            }
            parts.update(place, |part| {
                part.component = match part.component {
                    0 => component,
                    _ => SEVERAL,
                }
            })
        })
    }

    /// Enters what only components know of cells that have no openings, once all is known of both, unless that was done when
    /// the cells were summed up.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add_borders(&mut self) -> Result<()> {
        let Some(given) = &self.given else {
            return Ok(());
        };
        for place in 0..self.cells.len() {
            let part = given.parts.get(place)?;
            let border = match &given.cells.ids {
                CellIds::Ranked(_) => return Ok(()),
                CellIds::Listed(_) => part.borders,
                CellIds::Placed(_) if part.component == 0 => 0,
                CellIds::Placed(_) => {
                    let whole = given.components.get(given.places.of(part.component))?;
                    whole.voxels.border_euler
                }
            };
            self.cells
                .update(place, |record| add_border(record, border))?;
        }
        Ok(())
    }

    /// Notes where the surfaces of each cell begin, of those that are numbered in this part of the volume.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn note_first_surfaces(&mut self) -> Result<()> {
        let given = self.given.as_mut().expect("surfaces of given cells");
        let mut before = 0;
        for surface in 0..self.places.surfaces.own {
            let cell = self.surfaces.get(surface)?.cell;
            if cell != before {
                before = cell;
                let place = given.place(cell);
                let parts = &mut given.parts;
                parts.update(place, |part| part.first_surface = surface)?;
            }
        }
        Ok(())
    }
}

/// Adds what is known of the border of a component to a cell of it, which has all of it unless it has openings.
fn add_border(cell: &mut ComponentRecord, border: i64) {
    if cell.necks == 0 {
        cell.voxels.border_euler += border;
    }
}
