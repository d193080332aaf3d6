//! The reverse pass over the slabs' class maps: which component of the whole volume each class is.

use crate::convert::label::{Labelled, SlabRecord};
use crate::error::Result;
use crate::labels::Ranks;
use crate::sys::spill_file::{Place, SpillFile};
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// A component of the whole volume.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct ComponentId {
    /// Object or cell id.
    pub id: u64,
    /// The id of the surface to the neighbour that begins before it; 0 for the component of the first voxel, which has
    /// none. No other component has the same.
    pub surface: u64,
}

/// The ids of a piece.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Pod, Zeroable)]
pub struct Ids {
    /// The object.
    pub object: u64,
    /// The cell; 0 for a cap.
    pub cell: u64,
    /// The surface; 0 for a cap.
    pub surface: u64,
}

impl Ids {
    /// Of a piece between two components, of which one begins before the other: the surface is that of the later one.
    pub fn of(object: ComponentId, cell: ComponentId) -> Self {
        Ids {
            object: object.id,
            cell: cell.id,
            surface: object.surface.max(cell.surface),
        }
    }

    /// Of a piece that closes an object outside the volume.
    pub fn of_cap(object: ComponentId) -> Self {
        Ids {
            object: object.id,
            cell: 0,
            surface: 0,
        }
    }
}

/// How many objects, cells and surfaces there are.
#[derive(Debug, Clone, Copy)]
pub struct Counts {
    /// Objects.
    pub objects: u64,
    /// Cells.
    pub cells: u64,
    /// Surfaces.
    pub surfaces: u64,
}

/// The components of the local components of all bands.
#[derive(Debug)]
pub struct BandIds {
    /// Bands.
    count: u64,
    /// Where those of each lie: from the last one back to the first.
    places: SpillFile,
    spool: SpillFile,
}

impl BandIds {
    /// Of the band of this number, by layer, then y.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn get(&self, band: u64) -> Result<Vec<ComponentId>> {
        let offset = 16 * (self.count - 1 - band);
        let [offset, count] = self.places.read(&Place::<[u64; 2]>::new(offset, 1))?[0];
        self.spool.read(&Place::new(offset, count as usize))
    }
}

/// What resolving leaves.
pub struct Resolved {
    /// How many components there are.
    pub counts: Counts,
    /// Of the bands.
    pub bands: BandIds,
    /// Where the components of the classes of each slab lie, from the last one back to the first.
    class_places: SpillFile,
    classes: SpillFile,
    slabs: u64,
}

impl Resolved {
    /// The components of the classes of a slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn classes(&mut self, slab: u64) -> Result<Vec<ComponentId>> {
        let offset = 16 * (self.slabs - 1 - slab);
        let [offset, count] = self.class_places.get(&Place::<[u64; 2]>::new(offset, 1))?[0];
        self.classes.get(&Place::new(offset, count as usize))
    }
}

/// Resolves slab by slab, from the last one back to the first.
struct Resolver {
    objects: Ranks,
    cells: Ranks,
    surfaces: Ranks,
    /// The components of the slab after the one in hand.
    later: Vec<ComponentId>,
    /// What the components that go on from the slab in hand are there.
    carried_in: Vec<u32>,
}

/// Resolves all ids; temporary files lie in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn resolve(labelled: &mut Labelled, work: &Path) -> Result<Resolved> {
    let mut resolver = Resolver {
        objects: labelled.provisional.objects.renumber()?,
        cells: labelled.provisional.cells.renumber()?,
        surfaces: labelled.provisional.surfaces.renumber()?,
        later: Vec::new(),
        carried_in: Vec::new(),
    };
    let slabs = labelled.slabs.len();
    let mut bands = BandIds {
        count: 0,
        places: SpillFile::new(work)?,
        spool: SpillFile::new(work)?,
    };
    let (mut class_places, mut classes) = (SpillFile::new(work)?, SpillFile::new(work)?);
    for number in (0..slabs).rev() {
        let slab = labelled
            .slabs
            .get(number)?
            .expect("there is one of each number");
        let ids = resolver.slab(&slab, &mut labelled.spool)?;
        class_places.push(&[classes.push(&ids)?.numbers()])?;
        for [offset, count] in labelled.spool.get(&slab.of_local)?.into_iter().rev() {
            let of_local: Vec<u32> = labelled.spool.get(&Place::new(offset, count as usize))?;
            let of_band = of_local.iter().map(|&class| ids[class as usize]);
            let place = bands.spool.push_all(of_band)?;
            bands.places.push(&[place.numbers()])?;
            bands.count += 1;
        }
        resolver.later = ids;
        resolver.carried_in = labelled.spool.get(&slab.carried_in)?;
    }
    bands.places.mark()?;
    bands.spool.mark()?;
    Ok(Resolved {
        counts: Counts {
            objects: resolver.objects.alive(),
            cells: resolver.cells.alive(),
            surfaces: resolver.surfaces.alive() - 1,
        },
        bands,
        class_places,
        classes,
        slabs: slabs as u64,
    })
}

impl Resolver {
    /// The components of a slab's classes: of each that goes on, that of its class in the next slab.
    fn slab(&mut self, slab: &SlabRecord, spool: &mut SpillFile) -> Result<Vec<ComponentId>> {
        let above = spool.get(&slab.above)?;
        let provisional = spool.get(&slab.provisional)?;
        let surfaces = spool.get(&slab.surfaces)?;
        let mut ids = vec![ComponentId::default(); above.len()];
        for (&class, &successor) in spool.get(&slab.live)?.iter().zip(&self.carried_in) {
            ids[class as usize] = self.later[successor as usize];
        }
        for (class, id) in ids.iter_mut().enumerate().filter(|(_, id)| id.id == 0) {
            let ranks = match above[class] {
                1 => &mut self.objects,
                _ => &mut self.cells,
            };
            *id = ComponentId {
                id: ranks.id(provisional[class])?,
                surface: self.surfaces.id(surfaces[class])? - 1,
            };
        }
        Ok(ids)
    }
}
