//! The reverse sweep over the slabs' class maps: final ids and the sums of whole components.

use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord, VoxelSums};
use crate::pipeline::batch::IdsOfSlab;
use crate::pipeline::forward::{Forward, SlabRecord};
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::surfaces::SlabSurface;
use std::path::Path;

/// Final ids of one slab's classes and surfaces.
#[derive(Debug)]
pub struct SlabIds {
    /// Object or cell id of each class.
    pub classes: Place<u64>,
    /// Id of each surface.
    pub surfaces: Place<u64>,
    /// Id of each surface that is whole in a tile.
    pub whole: Place<u64>,
}

/// Every component and surface of the volume; record i has id i + 1.
pub struct Resolved {
    /// Ids per slab, in the order of the slabs.
    pub slabs: Vec<SlabIds>,
    /// Where they lie.
    pub ids: Spool,
    /// Objects.
    pub objects: RecordTable<ComponentRecord>,
    /// Cells.
    pub cells: RecordTable<ComponentRecord>,
    /// Surfaces.
    pub surfaces: RecordTable<SurfaceRecord>,
}

impl Resolved {
    /// The ids of a slab by its number.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn ids_of(&mut self, slab: usize) -> Result<IdsOfSlab> {
        let places = &self.slabs[slab];
        Ok(IdsOfSlab {
            classes: self.ids.get(&places.classes)?,
            surfaces: self.ids.get(&places.surfaces)?,
            whole: self.ids.get(&places.whole)?,
        })
    }
}

/// The ids of the slab after the one in hand.
#[derive(Default)]
struct Later {
    classes: Vec<u64>,
    from_previous: Vec<u32>,
    surfaces: Vec<u64>,
    surfaces_from_previous: Vec<u32>,
}

/// Resolves all ids; tables larger than `budget` bytes go to temporary files in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn resolve(
    forward: Forward,
    budget: u64,
    work: &Path,
) -> Result<(Vec<SlabRecord>, Spool, Resolved)> {
    let Forward {
        mut spool,
        mut whole,
        slabs,
        births,
        surface_births,
        ..
    } = forward;
    let mut object_ranks = births.objects.rank()?;
    let mut cell_ranks = births.cells.rank()?;
    let mut surface_ranks = surface_births.rank()?;
    let mut resolved = Resolved {
        slabs: Vec::with_capacity(slabs.len()),
        ids: Spool::new(work)?,
        objects: RecordTable::new(object_ranks.alive(), budget / 3, work)?,
        cells: RecordTable::new(cell_ranks.alive(), budget / 3, work)?,
        surfaces: RecordTable::new(surface_ranks.alive(), budget / 3, work)?,
    };
    let mut later = Later::default();
    for slab in slabs.iter().rev() {
        let above = spool.get(&slab.above)?;
        let births = spool.get(&slab.births)?;
        let live = spool.get(&slab.live)?;
        let classes = ids(
            &births,
            &live,
            &later.classes,
            &later.from_previous,
            |class, birth| {
                if above[class] == 1 {
                    object_ranks.id(birth)
                } else {
                    cell_ranks.id(birth)
                }
            },
        )?;
        for (sums, class_of) in &slab.finished {
            resolved.add_components(&mut spool, (sums, class_of), &above, &classes)?;
        }
        drop((above, births));
        let surfaces = spool.get(&slab.surfaces)?;
        let births: Vec<u64> = surfaces.iter().map(|s| s.birth).collect();
        let live = spool.get(&slab.surfaces_live)?;
        let after = (&later.surfaces, &later.surfaces_from_previous);
        let surface_ids = ids(&births, &live, after.0, after.1, |_, birth| {
            surface_ranks.id(birth)
        })?;
        let mut goes_on = vec![false; surfaces.len()];
        for &i in &live {
            goes_on[i as usize] = true;
        }
        let ended = surfaces.iter().enumerate().filter(|(i, _)| !goes_on[*i]);
        for (i, surface) in ended {
            let record = surface_record(surface, &classes);
            resolved.surfaces.set(surface_ids[i] - 1, record)?;
        }
        let mut whole_ids = spool.get(&slab.whole_births)?;
        for id in &mut whole_ids {
            *id = surface_ranks.id(*id)?;
        }
        let mut ids_of = whole_ids.iter();
        whole.for_each(&slab.whole, |surface| {
            let id = ids_of.next().expect("as many as there are surfaces");
            let record = surface_record(&surface, &classes);
            resolved.surfaces.set(id - 1, record)
        })?;
        resolved.slabs.push(SlabIds {
            classes: resolved.ids.push(&classes)?,
            surfaces: resolved.ids.push(&surface_ids)?,
            whole: resolved.ids.push(&whole_ids)?,
        });
        later = Later {
            classes,
            from_previous: spool.get(&slab.from_previous)?,
            surfaces: surface_ids,
            surfaces_from_previous: spool.get(&slab.surfaces_from_previous)?,
        };
    }
    resolved.slabs.reverse();
    resolved.add_meshes()?;
    Ok((slabs, spool, resolved))
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

impl Resolved {
    /// Enters components that have ended, given their sums and classes, and the phases and ids of all
    /// classes.
    fn add_components(
        &mut self,
        spool: &mut Spool,
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
/// else that of its own birth.
fn ids(
    births: &[u64],
    live: &[u32],
    later: &[u64],
    from_previous: &[u32],
    mut own: impl FnMut(usize, u64) -> Result<u64>,
) -> Result<Vec<u64>> {
    let mut out = vec![0; births.len()];
    for (&member, &successor) in live.iter().zip(from_previous) {
        out[member as usize] = later[successor as usize];
    }
    for (member, id) in out.iter_mut().enumerate().filter(|(_, id)| **id == 0) {
        *id = own(member, births[member])?;
    }
    Ok(out)
}
