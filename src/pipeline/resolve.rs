//! The reverse sweep over the slabs' class maps: final ids and the sums of whole components.

use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::pipeline::forward::{FinishedComponent, Forward, SlabRecord};
use crate::pipeline::spool::{Place, Spool};
use crate::segment::Ranks;
use std::path::Path;

/// Final ids of one slab's classes and surfaces.
#[derive(Debug)]
pub struct SlabIds {
    /// Object or cell id of each class.
    pub classes: Place<u64>,
    /// Id of each surface.
    pub surfaces: Place<u64>,
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
        slabs,
        mut objects,
        mut cells,
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
        objects: component_table(&mut objects, &mut object_ranks, budget / 3, work)?,
        cells: component_table(&mut cells, &mut cell_ranks, budget / 3, work)?,
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
        let surfaces = spool.get(&slab.surfaces)?;
        let births: Vec<u64> = surfaces.iter().map(|s| s.birth).collect();
        let live = spool.get(&slab.surfaces_live)?;
        let after = (&later.surfaces, &later.surfaces_from_previous);
        let surface_ids = ids(&births, &live, after.0, after.1, |_, birth| {
            surface_ranks.id(birth)
        })?;
        let mut live = live.iter().peekable();
        for (i, surface) in surfaces.iter().enumerate() {
            if live.peek() == Some(&&(i as u32)) {
                live.next();
                continue;
            }
            let record = SurfaceRecord {
                mesh: surface.sums,
                object: classes[surface.object as usize],
                cell: classes[surface.cell as usize],
                tiles: 0,
                touches_border: u64::from(surface.sums.border_edges > 0),
            };
            resolved.surfaces.set(surface_ids[i] - 1, record)?;
        }
        resolved.slabs.push(SlabIds {
            classes: resolved.ids.push(&classes)?,
            surfaces: resolved.ids.push(&surface_ids)?,
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

impl Resolved {
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

/// The finished components of a phase, by id.
fn component_table(
    finished: &mut Spool,
    ranks: &mut Ranks,
    budget: u64,
    work: &Path,
) -> Result<RecordTable<ComponentRecord>> {
    let mut table = RecordTable::new(ranks.alive(), budget, work)?;
    finished.for_each(|component: FinishedComponent| {
        let record = ComponentRecord {
            voxels: component.sums,
            ..ComponentRecord::default()
        };
        table.set(ranks.id(component.birth)? - 1, record)
    })?;
    Ok(table)
}
