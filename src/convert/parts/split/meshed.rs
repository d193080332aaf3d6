//! What a part finds of its cells when it is meshed.

use crate::convert::cells::{CellIds, CellsInput, GivenCells, KnownCells, sum_cells, write_rows};
use crate::convert::components::{Components, PartRecord};
use crate::convert::known_band::KnownBands;
use crate::convert::parts::directory::FileSum;
use crate::convert::parts::records::{Shared, SharedComponent, in_places, write_table};
use crate::convert::parts::split::columns::own_slices;
use crate::convert::parts::split::necks::write_necks;
use crate::convert::parts::split::surfaces::write_surfaces;
use crate::convert::parts::work::PartWork;
use crate::convert::resolve::Each;
use crate::error::Result;
use crate::labels::CellRowsWriter;
use crate::measure::ComponentRecord;
use crate::split::NeckRule;
use crate::sys::memory_pool::MemoryPool;
use crate::sys::sorted_spill::Keyed;
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Names of the tables.
pub const OBJECTS: &str = "objects";
/// See [`OBJECTS`].
pub const COMPONENTS: &str = "components";
/// See [`OBJECTS`].
pub const CELLS: &str = "cells";

const GIVEN: &str = "cells that are parts of components";

/// What meshing a part has found.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct MeshedPart {
    /// Surfaces of cells that begin in the part, where cells are split.
    pub surfaces: u64,
    /// Voxels below of the part that labels give to no cell.
    pub unlabelled: u64,
}

/// All that is known of a cell.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct CellRecord {
    /// Its sums.
    pub record: ComponentRecord,
    /// What more is known of it.
    pub part: PartRecord,
}

impl CellRecord {
    /// Of these.
    pub fn new(record: ComponentRecord, part: PartRecord) -> Self {
        CellRecord { record, part }
    }
}

/// The record of a cell that may lie in several parts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SharedCell {
    record: CellRecord,
    /// Id and part, or part and id.
    key: [u64; 2],
}

impl Keyed for SharedCell {
    fn key(&self) -> [u64; 2] {
        self.key
    }
}

impl Shared for SharedCell {
    type Record = CellRecord;

    fn new(record: CellRecord, key: [u64; 2]) -> Self {
        SharedCell { record, key }
    }

    fn record(&self) -> CellRecord {
        self.record
    }

    fn merge(into: &mut CellRecord, other: &CellRecord) {
        into.record.merge(&other.record);
        into.part.merge(&other.part);
    }
}

/// The cells of a part while it is meshed.
pub struct CellsToMesh {
    /// The cells.
    pub given: GivenCells,
    /// Those that may lie in other parts, too.
    pub shared: Vec<u64>,
    /// Files of their necks.
    pub files: Vec<FileSum>,
}

impl PartWork<'_> {
    /// The cells of the part, with the sums over their voxels.
    ///
    /// # Errors
    /// As of [`sum_cells`]; [`crate::Error::Format`] if what was left by rounds before is damaged.
    pub fn cells_to_mesh(
        &self,
        rule: NeckRule,
        known: KnownBands,
        memory: &Arc<MemoryPool>,
        work: &Path,
    ) -> Result<CellsToMesh> {
        let (job, tiling) = (self.job, self.job.plan.tiling);
        let mut cells = self.cells(rule, work)?;
        let slices = own_slices(tiling, job.made);
        // the slice below is there, too
        let slices = slices.start.saturating_sub(1)..slices.end;
        let mut rows = CellRowsWriter::of_slices(tiling.dims, slices, work)?;
        write_rows(&mut cells.rows, &mut rows)?;
        let (openings, files) = write_necks(job, &mut cells, work)?;
        let input = CellsInput {
            job,
            known,
            memory,
            work,
        };
        let known = KnownCells {
            ids: CellIds::Placed(cells.places),
            openings,
            unlabelled: 0,
            curve: cells.curve,
            pairs: None,
        };
        Ok(CellsToMesh {
            given: sum_cells(&input, rows.finish()?, Some(known))?,
            shared: cells.shared,
            files,
        })
    }
}

/// Writes the records of a part, of which `shared` lists the ids of components that lie in others, too, and `cells` those of
/// cells that may.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_meshed(
    dir: &Path,
    part: u32,
    components: &mut Components,
    shared: &Each<Vec<u64>>,
    cells: &[u64],
) -> Result<(Vec<FileSum>, MeshedPart)> {
    let given = components.given.as_ref().expect(GIVEN);
    let own = given.cells.ids.own_ids();
    let both = [&shared.objects[..], cells];
    let (mut files, surfaces) = write_surfaces(components, part, both, own, dir)?;
    let Components {
        objects,
        cells: table,
        places: of_ids,
        given,
        ..
    } = &*components;
    let given = given.as_ref().expect(GIVEN);
    let of = |place| objects.get(place);
    let (placed, others) = (in_places(&of_ids.objects), &shared.objects);
    let objects = write_table::<SharedComponent>(dir, OBJECTS, of, placed, others)?;
    let of = |place| given.components.get(place);
    let (placed, others) = (in_places(&given.places), &shared.cells);
    let components = write_table::<SharedComponent>(dir, COMPONENTS, of, placed, others)?;
    let of = |place| Ok(CellRecord::new(table.get(place)?, given.parts.get(place)?));
    let ids = &given.cells.ids;
    let placed = (ids.own(), |id| ids.place(id));
    let table = write_table::<SharedCell>(dir, CELLS, of, placed, cells)?;
    files.extend([objects, components, table].concat());
    let unlabelled = given.cells.unlabelled;
    Ok((
        files,
        MeshedPart {
            surfaces,
            unlabelled,
        },
    ))
}
