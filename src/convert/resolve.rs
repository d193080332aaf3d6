//! The reverse sweep over the slabs' class maps: final ids and the sums of whole components.

use crate::convert::finalize::batches::{Ids, IdsOfSlab};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::scan::state::ScanOutput;
use crate::convert::scan::surfaces::SlabSurface;
use crate::convert::scan::tile_writer::WrittenPiece;
use crate::convert::slab_records::{EndedComponents, SlabRecord, Slabs};
use crate::error::Result;
use crate::labels::Ranks;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::spill_file::{Place, SpillFile};
use std::path::Path;

/// Final ids of all slabs, in their order, see [`IdsOfSlab`].
pub struct SpooledIds {
    /// How many slabs have been added: from the last one back to the first.
    len: usize,
    /// Where the ids of each lie.
    places: SpillFile,
    spool: SpillFile,
}

/// Offsets and lengths of a slab's arrays.
type Places = [u64; 6];

/// Every component and surface of the volume; record i has id i + 1.
pub struct Components {
    /// Objects.
    pub objects: RecordTable<ComponentRecord>,
    /// Cells.
    pub cells: RecordTable<ComponentRecord>,
    /// Surfaces.
    pub surfaces: RecordTable<SurfaceRecord>,
}

impl SpooledIds {
    /// None yet; they will be in a temporary file in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(dir: &Path) -> Result<Self> {
        Ok(SpooledIds {
            len: 0,
            places: SpillFile::new(dir)?,
            spool: SpillFile::new(dir)?,
        })
    }

    /// The ids of a slab by its number, once those of all have been added.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of(&mut self, slab: usize) -> Result<IdsOfSlab> {
        let offset = (self.len - 1 - slab) * size_of::<Places>();
        let places = self.places.get::<Places>(&Place::new(offset as u64, 1))?;
        let mut get = |i: usize| {
            let place = Place::new(places[0][2 * i], places[0][2 * i + 1] as usize);
            self.spool.get(&place)
        };
        Ok(IdsOfSlab {
            classes: get(0)?,
            surfaces: get(1)?,
            whole: get(2)?,
        })
    }

    /// Adds those of the slab before the one that was added last.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn push(&mut self, ids: &IdsOfSlab) -> Result<()> {
        let places = [
            self.spool.push(&ids.classes)?,
            self.spool.push(&ids.surfaces)?,
            self.spool.push(&ids.whole)?,
        ];
        let numbers = places.map(|place| place.numbers());
        let places: Places = std::array::from_fn(|i| numbers[i / 2][i % 2]);
        self.places.push(&[places])?;
        self.len += 1;
        Ok(())
    }
}

/// What resolving leaves.
pub struct Resolved {
    /// A record of each slab.
    pub slabs: Slabs,
    /// Their tiles and pieces.
    pub pieces: SpillFile,
    /// The ids of their classes and surfaces.
    pub ids: SpooledIds,
    /// The sums of all components.
    pub components: Components,
}

/// The ids of the slab after the one in hand.
#[derive(Default)]
struct Later {
    classes: Vec<u64>,
    carried_in: Vec<u32>,
    surfaces: Vec<u64>,
    surfaces_from_previous: Vec<u32>,
}

/// Resolves slab by slab, from the last one back to the first.
struct Resolver {
    /// The arrays of all slabs.
    spool: SpillFile,
    /// Surfaces that are whole in a tile.
    whole: SpillFile,
    object_ranks: Ranks,
    cell_ranks: Ranks,
    surface_ranks: Ranks,
    components: Components,
    later: Later,
}

/// Resolves all ids, and counts in how many tiles each component is; tables larger than `memory` bytes go to
/// temporary files in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn resolve(forward: ScanOutput, memory: u64, work: &Path) -> Result<Resolved> {
    let ScanOutput {
        spool,
        whole,
        mut slabs,
        provisional,
        surface_labels,
        ..
    } = forward;
    let object_ranks = provisional.objects.renumber()?;
    let cell_ranks = provisional.cells.renumber()?;
    let surface_ranks = surface_labels.renumber()?;
    let of_each = FOR_EACH_TABLE.of(memory);
    let mut resolver = Resolver {
        components: Components {
            objects: RecordTable::new(object_ranks.alive(), of_each, work)?,
            cells: RecordTable::new(cell_ranks.alive(), of_each, work)?,
            surfaces: RecordTable::new(surface_ranks.alive(), of_each, work)?,
        },
        spool,
        whole,
        object_ranks,
        cell_ranks,
        surface_ranks,
        later: Later::default(),
    };
    let mut ids = SpooledIds::new(work)?;
    for number in (0..slabs.len()).rev() {
        let slab = slabs.get(number)?.expect("there is one of each number");
        let of_slab = resolver.slab(&slab)?;
        ids.push(&of_slab)?;
        resolver.count_tiles(&slab, &of_slab)?;
        resolver.go_on(&slab, of_slab)?;
    }
    let mut components = resolver.components;
    components.add_meshes()?;
    Ok(Resolved {
        slabs,
        pieces: resolver.spool,
        ids,
        components,
    })
}

impl Resolver {
    /// The ids of a slab, and the records of what ends in it.
    fn slab(&mut self, slab: &SlabRecord) -> Result<IdsOfSlab> {
        let classes = self.classes(slab)?;
        let surfaces = self.surfaces(slab, &classes)?;
        let whole = self.whole_surfaces(slab, &classes)?;
        Ok(IdsOfSlab {
            classes,
            surfaces,
            whole,
        })
    }

    /// Ids of a slab's classes; enters the components that end in it.
    fn classes(&mut self, slab: &SlabRecord) -> Result<Vec<u64>> {
        let above = self.spool.get(&slab.above)?;
        let provisional = self.spool.get(&slab.provisional)?;
        let (objects, cells) = (&mut self.object_ranks, &mut self.cell_ranks);
        let own = |class: usize, provisional_id| match above[class] {
            1 => objects.id(provisional_id),
            _ => cells.id(provisional_id),
        };
        let successors = Successors {
            live: &self.spool.get(&slab.live)?,
            carried_in: &self.later.carried_in,
            ids: &self.later.classes,
        };
        let ids = successors.ids(&provisional, own)?;
        for ended in &slab.ended(&mut self.spool)? {
            let (components, spool) = (&mut self.components, &mut self.spool);
            components.add_ended(spool, ended, &above, &ids)?;
        }
        Ok(ids)
    }

    /// Ids of a slab's surfaces that are not whole in a tile; enters those that end in it.
    fn surfaces(&mut self, slab: &SlabRecord, classes: &[u64]) -> Result<Vec<u64>> {
        let surfaces = self.spool.get(&slab.surfaces)?;
        let provisional: Vec<u64> = surfaces.iter().map(|s| s.provisional_id).collect();
        let live = self.spool.get(&slab.surfaces_live)?;
        let successors = Successors {
            live: &live,
            carried_in: &self.later.surfaces_from_previous,
            ids: &self.later.surfaces,
        };
        let ranks = &mut self.surface_ranks;
        let ids = successors.ids(&provisional, |_, provisional_id| ranks.id(provisional_id))?;
        let mut goes_on = vec![false; surfaces.len()];
        for &i in &live {
            goes_on[i as usize] = true;
        }
        let ended = surfaces.iter().enumerate().filter(|(i, _)| !goes_on[*i]);
        for (i, surface) in ended {
            let record = surface_record(surface, classes);
            self.components.surfaces.set(ids[i] - 1, record)?;
        }
        Ok(ids)
    }

    /// Ids of a slab's surfaces that are whole in a tile; enters all of them.
    fn whole_surfaces(&mut self, slab: &SlabRecord, classes: &[u64]) -> Result<Vec<u64>> {
        let mut ids = self.spool.get(&slab.whole_labels)?;
        for id in &mut ids {
            *id = self.surface_ranks.id(*id)?;
        }
        let mut of = ids.iter();
        let surfaces = &mut self.components.surfaces;
        self.whole.for_each(&slab.whole, |surface| {
            let id = of.next().expect("as many as there are surfaces");
            surfaces.set(id - 1, surface_record(&surface, classes))
        })?;
        Ok(ids)
    }

    /// Counts the tiles of a slab.
    fn count_tiles(&mut self, slab: &SlabRecord, ids: &IdsOfSlab) -> Result<()> {
        for tile in self.spool.get(&slab.tiles)? {
            let pieces = tile.pieces(&mut self.spool)?;
            self.components.count_tile(&pieces, ids)?;
        }
        Ok(())
    }

    /// Goes on to the slab before this one.
    fn go_on(&mut self, slab: &SlabRecord, ids: IdsOfSlab) -> Result<()> {
        self.later = Later {
            classes: ids.classes,
            carried_in: self.spool.get(&slab.carried_in)?,
            surfaces: ids.surfaces,
            surfaces_from_previous: self.spool.get(&slab.surfaces_from_previous)?,
        };
        Ok(())
    }
}

/// What becomes of the members of a slab in the next one.
struct Successors<'a> {
    /// The members that go on.
    live: &'a [u32],
    /// What each of these is there.
    carried_in: &'a [u32],
    /// The ids there.
    ids: &'a [u64],
}

impl Successors<'_> {
    /// The id of every member of a slab: that of its successor in the next slab if it goes on there,
    /// else that of its own provisional label.
    fn ids(
        &self,
        provisional: &[u64],
        mut own: impl FnMut(usize, u64) -> Result<u64>,
    ) -> Result<Vec<u64>> {
        let mut out = vec![0; provisional.len()];
        for (&member, &successor) in self.live.iter().zip(self.carried_in) {
            out[member as usize] = self.ids[successor as usize];
        }
        for (member, id) in out.iter_mut().enumerate().filter(|(_, id)| **id == 0) {
            *id = own(member, provisional[member])?;
        }
        Ok(out)
    }
}

/// A whole surface, with the ids of what it borders.
fn surface_record(surface: &SlabSurface, ids: &[u64]) -> SurfaceRecord {
    SurfaceRecord {
        mesh: surface.sums,
        object: ids[surface.object as usize],
        cell: ids[surface.cell as usize],
        tiles: 0,
        touches_border: u64::from(surface.sums.border_edges > 0),
    }
}

impl Components {
    /// Enters components that have ended, given the phases and ids of all classes.
    fn add_ended(
        &mut self,
        spool: &mut SpillFile,
        ended: &EndedComponents,
        above: &[u8],
        ids: &[u64],
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
            let record = ComponentRecord {
                voxels,
                ..ComponentRecord::default()
            };
            table.set(ids[class] - 1, record)
        })
    }

    /// Adds a tile to the counts of all components in it, which its pieces name.
    fn count_tile(&mut self, pieces: &[WrittenPiece], ids: &IdsOfSlab) -> Result<()> {
        let open = pieces.iter().filter(|piece| !piece.is_cap());
        let open: Vec<Ids> = open.map(|piece| ids.of(piece)).collect();
        let distinct = |get: fn(&Ids) -> u64| {
            let mut ids: Vec<u64> = open.iter().map(get).collect();
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
        for id in distinct(|ids| ids.surface) {
            self.surfaces.update(id - 1, |r| r.tiles += 1)?;
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
