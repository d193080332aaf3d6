//! The reverse sweep over the slabs' class maps: final ids and the sums of whole components.

use crate::convert::finalize::batches::{Ids, IdsOfSlab};
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::scan::state::ScanOutput;
use crate::convert::scan::surfaces::SlabSurface;
use crate::convert::scan::tile_writer::WrittenPiece;
use crate::convert::slab_records::Slabs;
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord, VoxelSums};
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

/// Resolves all ids, and counts in how many tiles each component is; tables larger than `budget` bytes go to
/// temporary files in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn resolve(forward: ScanOutput, budget: u64, work: &Path) -> Result<Resolved> {
    let ScanOutput {
        mut spool,
        mut whole,
        mut slabs,
        provisional,
        surface_labels,
        ..
    } = forward;
    let mut object_ranks = provisional.objects.renumber()?;
    let mut cell_ranks = provisional.cells.renumber()?;
    let mut surface_ranks = surface_labels.renumber()?;
    let mut spooled = SpooledIds::new(work)?;
    let of_each = FOR_EACH_TABLE.of(budget);
    let mut resolved = Components {
        objects: RecordTable::new(object_ranks.alive(), of_each, work)?,
        cells: RecordTable::new(cell_ranks.alive(), of_each, work)?,
        surfaces: RecordTable::new(surface_ranks.alive(), of_each, work)?,
    };
    let mut later = Later::default();
    for number in (0..slabs.len()).rev() {
        let slab = slabs.get(number)?.expect("there is one of each number");
        let above = spool.get(&slab.above)?;
        let provisional = spool.get(&slab.provisional)?;
        let live = spool.get(&slab.live)?;
        let classes = ids(
            &provisional,
            &live,
            &later.classes,
            &later.carried_in,
            |class, provisional_id| {
                if above[class] == 1 {
                    object_ranks.id(provisional_id)
                } else {
                    cell_ranks.id(provisional_id)
                }
            },
        )?;
        for (sums, class_of) in &slab.ended(&mut spool)? {
            resolved.add_components(&mut spool, (sums, class_of), &above, &classes)?;
        }
        drop((above, provisional));
        let surfaces = spool.get(&slab.surfaces)?;
        let provisional: Vec<u64> = surfaces.iter().map(|s| s.provisional_id).collect();
        let live = spool.get(&slab.surfaces_live)?;
        let after = (&later.surfaces, &later.surfaces_from_previous);
        let surface_ids = ids(
            &provisional,
            &live,
            after.0,
            after.1,
            |_, provisional_id| surface_ranks.id(provisional_id),
        )?;
        let mut goes_on = vec![false; surfaces.len()];
        for &i in &live {
            goes_on[i as usize] = true;
        }
        let ended = surfaces.iter().enumerate().filter(|(i, _)| !goes_on[*i]);
        for (i, surface) in ended {
            let record = surface_record(surface, &classes);
            resolved.surfaces.set(surface_ids[i] - 1, record)?;
        }
        let mut whole_ids = spool.get(&slab.whole_labels)?;
        for id in &mut whole_ids {
            *id = surface_ranks.id(*id)?;
        }
        let mut ids_of = whole_ids.iter();
        whole.for_each(&slab.whole, |surface| {
            let id = ids_of.next().expect("as many as there are surfaces");
            let record = surface_record(&surface, &classes);
            resolved.surfaces.set(id - 1, record)
        })?;
        let ids = IdsOfSlab {
            classes,
            surfaces: surface_ids,
            whole: whole_ids,
        };
        spooled.push(&ids)?;
        for tile in spool.get(&slab.tiles)? {
            resolved.count_tile(&tile.pieces(&mut spool)?, &ids)?;
        }
        later = Later {
            classes: ids.classes,
            carried_in: spool.get(&slab.carried_in)?,
            surfaces: ids.surfaces,
            surfaces_from_previous: spool.get(&slab.surfaces_from_previous)?,
        };
    }
    resolved.add_meshes()?;
    Ok(Resolved {
        slabs,
        pieces: spool,
        ids: spooled,
        components: resolved,
    })
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
    /// Enters components that have ended, given their sums and classes, and the phases and ids of all
    /// classes.
    fn add_components(
        &mut self,
        spool: &mut SpillFile,
        (sums, class_of): (&Place<VoxelSums>, &Place<u32>),
        above: &[u8],
        ids: &[u64],
    ) -> Result<()> {
        let class_of = spool.get(class_of)?;
        let mut class_of = class_of.iter();
        spool.for_each(sums, |voxels| {
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

/// The id of every member of a slab: that of its successor in the next slab if it goes on there,
/// else that of its own provisional label.
fn ids(
    provisional: &[u64],
    live: &[u32],
    later: &[u64],
    carried_in: &[u32],
    mut own: impl FnMut(usize, u64) -> Result<u64>,
) -> Result<Vec<u64>> {
    let mut out = vec![0; provisional.len()];
    for (&member, &successor) in live.iter().zip(carried_in) {
        out[member as usize] = later[successor as usize];
    }
    for (member, id) in out.iter_mut().enumerate().filter(|(_, id)| **id == 0) {
        *id = own(member, provisional[member])?;
    }
    Ok(out)
}
