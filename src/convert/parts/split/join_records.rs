//! Joins what parts have found of cells, objects and surfaces that lie in several of them.

use crate::convert::components::PartRecord;
use crate::convert::conversion::Conversion;
use crate::convert::parts::directory::{Directory, Done, Made};
use crate::convert::parts::records::{NO_PART, Shared, SharedComponent, gather, merge_table};
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::split::cells::MergedCells;
use crate::convert::parts::split::meshed::{CELLS, COMPONENTS, CellRecord, OBJECTS, SharedCell};
use crate::convert::parts::split::necks::merge_necks;
use crate::convert::parts::split::surfaces::{CellOwners, merge_surfaces};
use crate::error::Result;
use crate::measure::ComponentRecord;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What came of joining records.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MergedRecords {
    /// Surfaces of cells that parts before each part own; at last, all of them.
    pub surfaces_before: Vec<u64>,
    /// Which cells each part owns.
    pub owners: CellOwners,
}

/// Adds up the records of all that lies in several parts.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn merge_split_records(
    job: &Conversion,
    directory: &Directory,
    rounds: Rounds,
    dir: &Path,
) -> Result<Made<MergedRecords>> {
    let (round, parts) = (rounds.number(Round::Mesh), directory.parts());
    let known: Done<MergedCells> = directory.merged(rounds.number(Round::Saddles), 0)?;
    let mut objects = gather::<SharedComponent>(directory, round, dir, OBJECTS)?;
    let mut cells = gather::<SharedCell>(directory, round, dir, CELLS)?;
    let mut one_surface = ComponentRecord::zeroed();
    one_surface.surfaces = 1;
    let mut one_neck = ComponentRecord::zeroed();
    one_neck.necks = 1;
    let mut count = |cell, object| {
        objects.push(SharedComponent::new(one_surface, [object, NO_PART]))?;
        let record = CellRecord::new(one_surface, PartRecord::default());
        cells.push(SharedCell::new(record, [cell, NO_PART]))
    };
    let surfaces = merge_surfaces(directory, round, &known.result.owners, dir, &mut count)?;
    let necks = merge_necks(job, directory, round, &known, dir, |opening| {
        let mut part = PartRecord::default();
        part.largest_neck = opening.radius;
        opening.cells.into_iter().try_for_each(|cell| {
            let record = CellRecord::new(one_neck, part);
            cells.push(SharedCell::new(record, [cell, NO_PART]))
        })
    })?;
    let components = gather::<SharedComponent>(directory, round, dir, COMPONENTS)?;
    let files = [
        merge_table(objects, parts, dir, OBJECTS)?,
        merge_table(components, parts, dir, COMPONENTS)?,
        merge_table(cells, parts, dir, CELLS)?,
        surfaces.files,
        necks,
    ];
    Ok(Made {
        marks: Default::default(),
        files: files.concat(),
        result: MergedRecords {
            surfaces_before: surfaces.before,
            owners: known.result.owners,
        },
    })
}
