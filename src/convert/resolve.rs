//! The reverse pass over the slabs' class maps: which component of the whole volume each class is.

use crate::convert::id_places::IdPlaces;
use crate::convert::label::{Beyond, SlabRecord, Slabs};
use crate::convert::layers::Layers;
use crate::error::Result;
use crate::labels::{PhaseLabels, Ranks};
use crate::sys::spill_file::{Place, SpillFile};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
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

/// Something of objects, cells and surfaces.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Each<T> {
    /// Of objects.
    pub objects: T,
    /// Of cells.
    pub cells: T,
    /// Of surfaces.
    pub surfaces: T,
}

/// What gives the components that begin in some slabs their ids.
#[derive(Debug)]
pub struct Numbering {
    /// Of components; those of surfaces are one more than surfaces have, since the component of the first voxel has none.
    pub ranks: Each<Ranks>,
    /// What is known of components that go on in other parts of the volume.
    pub beyond: Beyond<ComponentId>,
}

impl Numbering {
    /// Of the components of a whole volume.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if a temporary file fails.
    pub fn of(provisional: &PhaseLabels) -> Result<Self> {
        let ranks = Each {
            objects: provisional.objects.renumber()?,
            cells: provisional.cells.renumber()?,
            surfaces: provisional.surfaces.renumber()?,
        };
        Ok(Numbering {
            ranks,
            beyond: Beyond::default(),
        })
    }

    /// The id of a component that begins in these slabs, given its numbers.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if a temporary file fails.
    pub fn id(&mut self, above: bool, provisional: u64, surface: u64) -> Result<ComponentId> {
        let ranks = match above {
            true => &mut self.ranks.objects,
            false => &mut self.ranks.cells,
        };
        Ok(ComponentId {
            id: ranks.id(provisional)?,
            surface: self.ranks.surfaces.id(surface)? - 1,
        })
    }
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
    pub counts: Each<u64>,
    /// Of the bands.
    pub bands: BandIds,
    /// Where the components of the classes of each slab lie, from the last one back to the first.
    class_places: SpillFile,
    classes: SpillFile,
    layers: Layers,
}

impl Resolved {
    /// The places of the ids of a whole volume.
    pub fn places(&self) -> Each<IdPlaces> {
        let Each {
            objects,
            cells,
            surfaces,
        } = self.counts;
        Each {
            objects: IdPlaces::all(objects),
            cells: IdPlaces::all(cells),
            surfaces: IdPlaces::all(surfaces),
        }
    }

    /// The components of the classes of a slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn classes(&mut self, layer: u32) -> Result<Vec<ComponentId>> {
        let offset = 16 * u64::from(self.layers.end - 1 - layer);
        let [offset, count] = self.class_places.get(&Place::<[u64; 2]>::new(offset, 1))?[0];
        self.classes.get(&Place::new(offset, count as usize))
    }
}

/// Resolves slab by slab, from the last one back to the first.
struct Resolver {
    numbering: Numbering,
    /// The components of the slab after the one in hand.
    later: Vec<ComponentId>,
    /// What the components that go on from the slab in hand are there.
    carried_in: Vec<u32>,
}

/// Resolves all ids of some slabs, whose arrays lie in `spool`; temporary files lie in `work`.
///
/// # Errors
/// [`crate::Error::Io`] if a temporary file fails.
pub fn resolve(
    slabs: &mut Slabs,
    spool: &mut SpillFile,
    numbering: Numbering,
    work: &Path,
) -> Result<Resolved> {
    let leaving = numbering.beyond.leaving.clone();
    let mut resolver = Resolver {
        numbering,
        carried_in: (0..leaving.len() as u32).collect(),
        later: leaving,
    };
    let layers = slabs.layers();
    let mut bands = BandIds {
        count: 0,
        places: SpillFile::new(work)?,
        spool: SpillFile::new(work)?,
    };
    let (mut class_places, mut classes) = (SpillFile::new(work)?, SpillFile::new(work)?);
    for layer in layers.each().rev() {
        let slab = slabs.get(layer)?;
        let ids = resolver.slab(&slab, spool)?;
        class_places.push(&[classes.push(&ids)?.numbers()])?;
        for [offset, count] in spool.get(&slab.of_local)?.into_iter().rev() {
            let of_local: Vec<u32> = spool.get(&Place::new(offset, count as usize))?;
            let of_band = of_local.iter().map(|&class| ids[class as usize]);
            let place = bands.spool.push_all(of_band)?;
            bands.places.push(&[place.numbers()])?;
            bands.count += 1;
        }
        resolver.later = ids;
        resolver.carried_in = spool.get(&slab.carried_in)?;
    }
    bands.places.mark()?;
    bands.spool.mark()?;
    let ranks = &resolver.numbering.ranks;
    Ok(Resolved {
        counts: Each {
            objects: ranks.objects.alive(),
            cells: ranks.cells.alive(),
            surfaces: ranks.surfaces.alive() - 1,
        },
        bands,
        class_places,
        classes,
        layers,
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
        for &(class, id) in self.numbering.beyond.ended(slab.layer) {
            ids[class as usize] = id;
        }
        for (class, id) in ids.iter_mut().enumerate().filter(|(_, id)| id.id == 0) {
            *id = self
                .numbering
                .id(above[class] == 1, provisional[class], surfaces[class])?;
        }
        Ok(ids)
    }
}
