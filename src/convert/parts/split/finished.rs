//! What a part is to know of its cells when it is finished.

use crate::convert::cells::{CellIds, KnownCells};
use crate::convert::components::{Components, Given};
use crate::convert::id_places::IdPlaces;
use crate::convert::memory::FOR_EACH_TABLE;
use crate::convert::parts::directory::Done;
use crate::convert::parts::records::{SharedComponent, merged_file, read_table, setter};
use crate::convert::parts::split::cells::NECKS;
use crate::convert::parts::split::join_records::MergedRecords;
use crate::convert::parts::split::meshed::{
    CELLS, COMPONENTS, CellRecord, MeshedPart, OBJECTS, SharedCell,
};
use crate::convert::parts::split::necks::read_openings;
use crate::convert::parts::split::surfaces::read_surfaces;
use crate::convert::parts::work::PartWork;
use crate::convert::resolve::Each;
use crate::error::Result;
use crate::measure::RecordTable;
use std::path::Path;

impl PartWork<'_> {
    /// The records of a part whose cells were split, see [`read_cells`].
    ///
    /// # Errors
    /// As of [`read_cells`].
    pub fn split_components(
        &self,
        places: Each<IdPlaces>,
        done: &Done<MeshedPart>,
        merged: &Done<MergedRecords>,
        dir: &Path,
    ) -> Result<Components> {
        let (of_cells, curve) = self.cell_places()?;
        let handed = merged.spool(&merged_file(NECKS, self.part))?;
        let cells = KnownCells {
            ids: CellIds::Placed(of_cells),
            openings: read_openings(self.job, [done.spool(NECKS)?, handed], dir)?,
            unlabelled: 0,
            curve,
            pairs: None,
        };
        read_cells(self, places, (done, merged), cells, dir)
    }
}

/// Reads the records of a part back, those of what lies in several parts as they are of the whole volume. `places` are those
/// of objects and of components.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn read_cells(
    work: &PartWork,
    places: Each<IdPlaces>,
    (done, merged): (&Done<MeshedPart>, &Done<MergedRecords>),
    known: KnownCells,
    dir: &Path,
) -> Result<Components> {
    let (job, part) = (work.job, work.part);
    let of_each = FOR_EACH_TABLE.of(job.plan.tables());
    let handed = (merged, part);
    let mut objects = RecordTable::new(places.objects.len(), of_each, dir)?;
    let (of, set) = (|id| places.objects.of(id), setter(&mut objects));
    read_table::<SharedComponent, _, _>(OBJECTS, of, done, handed, set)?;
    let mut components = RecordTable::new(places.cells.len(), of_each, dir)?;
    let (of, set) = (|id| places.cells.of(id), setter(&mut components));
    read_table::<SharedComponent, _, _>(COMPONENTS, of, done, handed, set)?;
    let ids = &known.ids;
    let mut cells = RecordTable::new(ids.len(), of_each, dir)?;
    let mut parts = RecordTable::new(ids.len(), of_each, dir)?;
    let set = |place, CellRecord { record, part }| {
        cells.update(place, |own| *own = record)?;
        parts.update(place, |own| *own = part)
    };
    read_table::<SharedCell, _, _>(CELLS, |id| ids.place(id), done, handed, set)?;
    let before = &merged.result.surfaces_before;
    let range = [0, 1].map(|more| before[part as usize + more]);
    let (surfaces, of_surfaces) = read_surfaces(done, merged, part, range, (of_each, dir))?;
    let mut made = Components {
        objects,
        cells,
        surfaces,
        places: Each {
            objects: places.objects,
            cells: IdPlaces::default(),
            surfaces: of_surfaces,
        },
        has_titles: part == 0,
        given: Some(Given {
            cells: known,
            components,
            places: places.cells,
            parts,
        }),
        walls: None,
    };
    made.note_first_surfaces()?;
    made.add_borders()?;
    Ok(made)
}
