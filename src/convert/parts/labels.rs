//! Cells that labels give, in parts of a volume. A label may be anywhere, so no part knows all of a cell, nor which cells
//! there are: each hands on what it has found, and of what that adds up to it owns those cells whose labels lie between two
//! numbers. It has their rows, those of their surfaces and those of openings to larger labels.

use crate::convert::cells::{
    CellIds, CellsInput, Contact, KnownCells, ListedIds, Opening, sum_cells_of_part,
};
use crate::convert::components::{Components, PartRecord};
use crate::convert::given_labels::Labels;
use crate::convert::id_places::IdPlaces;
use crate::convert::known_band::KnownBands;
use crate::convert::parts::directory::{Directory, Done, FileSum, Made};
use crate::convert::parts::records::{
    LeftInRound, NO_PART, PartFiles, Shared, SharedComponent, gather, merge_table,
    merge_table_with, merged_file, shared_file, sum_of,
};
use crate::convert::parts::split::{
    CELLS, COMPONENTS, CellOwners, CellRecord, CellsToMesh, MergedRecords, MeshedPart, OBJECTS,
    SharedCell, merge_surfaces, own_slices, read_cells,
};
use crate::convert::parts::work::PartWork;
use crate::convert::resolve::Each;
use crate::error::Result;
use crate::measure::ComponentRecord;
use crate::sys::memory_pool::MemoryPool;
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use std::path::Path;
use std::sync::Arc;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 12;
/// The file of a part of where its cells touch.
const CONTACTS: &str = "contacts";
/// The file of a part of its cells in components that go on in others.
const PAIRS: &str = "cells-in-components";

/// What the border of a component adds to a cell that has voxels in it, or, with cell 0, to all of them.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Border {
    component: u64,
    cell: u64,
    euler: i64,
}

impl Keyed for Border {
    fn key(&self) -> [u64; 2] {
        [self.component, self.cell]
    }
}

/// A cell that there is.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Found(u64);

impl Keyed for Found {
    fn key(&self) -> [u64; 2] {
        [self.0, 0]
    }
}

impl PartWork<'_> {
    /// The cells of the part, with the sums over their voxels.
    ///
    /// # Errors
    /// As of [`sum_cells_of_part`] and [`Labels::rows`].
    pub fn labelled_cells(
        &self,
        labels: &Labels,
        known: KnownBands,
        memory: &Arc<MemoryPool>,
        work: &Path,
    ) -> Result<CellsToMesh> {
        let job = self.job;
        let slices = own_slices(job.plan.tiling, job.made);
        // the surface goes down to the slice below
        let slices = slices.start.saturating_sub(1)..slices.end;
        let crop = job.options.crop.as_ref();
        let rows = labels.rows(crop, slices, work, job.progress)?;
        let input = CellsInput {
            job,
            known,
            memory,
            work,
        };
        let mut contacts = SpillFile::create(&work.join(CONTACTS))?;
        let given = sum_cells_of_part(&input, rows, |contact| {
            contacts.push(&[contact]).map(|_| ())
        })?;
        let ids = &given.known.ids;
        Ok(CellsToMesh {
            shared: (0..ids.len()).map(|place| ids.id(place)).collect(),
            given,
            files: vec![sum_of(CONTACTS, contacts.mark()?)],
        })
    }

    /// The records of the part, whose cells labels give, when all parts are meshed.
    ///
    /// # Errors
    /// As of [`read_cells`].
    pub fn labelled_components(
        &self,
        places: Each<IdPlaces>,
        done: &Done<MeshedPart>,
        merged: &Done<MergedRecords>,
        dir: &Path,
    ) -> Result<Components> {
        let (job, part) = (self.job, self.part);
        let mut ids = ListedIds::default();
        let handed = merged.spool(&merged_file(CELLS, part))?;
        handed.each(|shared: SharedCell| {
            let [_, cell] = shared.key();
            match merged.result.owners.part_of(cell) == u64::from(part) {
                true => ids.own.push(cell),
                false => ids.others.push(cell),
            }
            Ok(())
        })?;
        let spacing = job.options.measured(&job.grid.header().placement)?.spacing;
        let mut openings = SpillFile::new(dir)?;
        let handed = merged.spool(&merged_file(CONTACTS, part))?;
        handed.each(|contact: Contact| {
            let opening = Opening::of(&contact, spacing);
            openings.push(&[opening]).map(|_| ())
        })?;
        openings.mark()?;
        let known = KnownCells {
            ids: CellIds::Listed(ids),
            openings,
            unlabelled: 0,
            curve: Vec::new(),
            pairs: None,
        };
        read_cells(self, places, (done, merged), known, dir)
    }
}

/// Enters what the borders of components that lie in the part alone add to its cells, and writes which cells have voxels in
/// others, whose ids are `shared`.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_pairs(components: &mut Components, shared: &[u64], dir: &Path) -> Result<FileSum> {
    let mut file = SpillFile::create(&dir.join(PAIRS))?;
    let given = components.given.as_mut().expect("cells that labels give");
    let mut pairs = given.cells.pairs.take().expect("pairs that were kept");
    pairs.mark()?;
    pairs.each(|[cell, component]: [u64; 2]| {
        if shared.binary_search(&component).is_ok() {
            return file.push(&[[cell, component]]).map(|_| ());
        }
        let whole = given.components.get(given.places.of(component))?;
        let place = given.cells.ids.place(cell);
        let euler = whole.voxels.border_euler;
        given.parts.update(place, |part| part.borders += euler)
    })?;
    Ok(sum_of(PAIRS, file.mark()?))
}

/// Adds up the records of all cells, and of objects and components that lie in several parts.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn merge_labelled(
    directory: &Directory,
    round: u32,
    dir: &Path,
) -> Result<Made<MergedRecords>> {
    let parts = directory.parts();
    let found = found_cells(directory, round, dir)?;
    let owners = owners_of(&found, parts)?;
    let mut objects = gather::<SharedComponent>(directory, round, dir, OBJECTS)?;
    let mut cells = gather::<SharedCell>(directory, round, dir, CELLS)?;
    let nothing = CellRecord::new(ComponentRecord::zeroed(), PartRecord::default());
    found.each(|Found(cell)| {
        // the part that has its row may know nothing of it
        cells.push(SharedCell::new(nothing, [cell, owners.part_of(cell)]))
    })?;
    let mut one_surface = ComponentRecord::zeroed();
    one_surface.surfaces = 1;
    let surfaces = merge_surfaces(directory, round, &owners, dir, &mut |cell, object| {
        objects.push(SharedComponent::new(one_surface, [object, NO_PART]))?;
        let record = CellRecord::new(one_surface, PartRecord::default());
        cells.push(SharedCell::new(record, [cell, NO_PART]))
    })?;
    let contacts = merge_contacts(directory, round, &owners, dir, &mut cells)?;
    let components = merge_components(directory, round, dir, &mut cells)?;
    let files = [
        merge_table(objects, parts, dir, OBJECTS)?,
        components,
        merge_table(cells, parts, dir, CELLS)?,
        surfaces.files,
        contacts,
    ];
    Ok(Made {
        marks: Default::default(),
        files: files.concat(),
        result: MergedRecords {
            surfaces_before: surfaces.before,
            owners,
        },
    })
}

/// All cells that there are, by rising labels.
fn found_cells(directory: &Directory, round: u32, dir: &Path) -> Result<SpillFile> {
    let mut sorter = Sorter::<Found>::new(dir, ROOM)?;
    for part in 0..directory.parts() {
        let done: Done<MeshedPart> = directory.done_by(round, part)?;
        done.spool(&shared_file(CELLS))?
            .each(|shared: SharedCell| sorter.push(Found(shared.key()[0])))?;
    }
    let mut found = SpillFile::new(dir)?;
    let same = |_: &mut Found, _: &Found| ();
    sorter.finish_merged(same, |cell| found.push(&[cell]).map(|_| ()))?;
    found.mark()?;
    Ok(found)
}

/// Gives each part as many cells as others, but for one.
fn owners_of(found: &SpillFile, parts: u32) -> Result<CellOwners> {
    let (count, parts) = (found.records::<Found>(), u64::from(parts));
    let mut before = vec![0];
    let (mut number, mut last) = (0, 0);
    found.each(|Found(cell)| {
        while number == count * before.len() as u64 / parts && (before.len() as u64) < parts {
            before.push(last);
        }
        (number, last) = (number + 1, cell);
        Ok(())
    })?;
    before.resize(parts as usize + 1, last);
    Ok(CellOwners {
        before,
        begin_there: false,
    })
}

/// Calls `each` with the cells of all contacts, of some more often than once.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged; those of `each`.
pub fn each_contact(left: LeftInRound, each: &mut dyn FnMut([u64; 2]) -> Result<()>) -> Result<()> {
    left.each(CONTACTS, |contact: Contact| each(contact.cells))
}

/// Joins where cells touch, hands each contact to the part that owns its smaller cell, and counts it with both.
fn merge_contacts(
    directory: &Directory,
    round: u32,
    owners: &CellOwners,
    dir: &Path,
    cells: &mut Sorter<SharedCell>,
) -> Result<Vec<FileSum>> {
    let mut all = Sorter::<Contact>::new(dir, ROOM)?;
    let left = LeftInRound { directory, round };
    left.each(CONTACTS, |contact| all.push(contact))?;
    let mut one_neck = ComponentRecord::zeroed();
    one_neck.necks = 1;
    let one_neck = CellRecord::new(one_neck, PartRecord::default());
    let mut files = PartFiles::new(dir, CONTACTS)?;
    all.finish_merged(Contact::merge, |contact| {
        for cell in contact.cells {
            cells.push(SharedCell::new(one_neck, [cell, NO_PART]))?;
        }
        files.go_on_to(owners.part_of(contact.cells[0]) as u32)?;
        files.push(&contact)
    })?;
    files.finish(directory.parts())
}

/// Adds up the records of components that lie in several parts, and adds their borders to their cells.
fn merge_components(
    directory: &Directory,
    round: u32,
    dir: &Path,
    cells: &mut Sorter<SharedCell>,
) -> Result<Vec<FileSum>> {
    let parts = directory.parts();
    let mut borders = Sorter::<Border>::new(dir, ROOM)?;
    for part in 0..parts {
        let done: Done<MeshedPart> = directory.done_by(round, part)?;
        done.spool(PAIRS)?.each(|[cell, component]: [u64; 2]| {
            let euler = 0;
            borders.push(Border {
                component,
                cell,
                euler,
            })
        })?;
    }
    let components = gather::<SharedComponent>(directory, round, dir, COMPONENTS)?;
    let files = merge_table_with(components, parts, dir, COMPONENTS, |component, record| {
        let euler = record.voxels.border_euler;
        borders.push(Border {
            component,
            cell: 0,
            euler,
        })
    })?;
    let mut whole = 0;
    let same = |_: &mut Border, _: &Border| ();
    borders.finish_merged(same, |border| {
        if border.cell == 0 {
            whole = border.euler;
            return Ok(());
        }
        let mut part = PartRecord::default();
        part.borders = whole;
        let record = CellRecord::new(ComponentRecord::zeroed(), part);
        cells.push(SharedCell::new(record, [border.cell, NO_PART]))
    })?;
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_owns_as_many_cells() {
        let dir = tempfile::tempdir().unwrap();
        for count in 0..20u64 {
            for parts in 1..9u32 {
                let mut found = SpillFile::new(dir.path()).unwrap();
                for cell in 0..count {
                    found.push(&[Found(7 * cell * cell + 3)]).unwrap();
                }
                found.mark().unwrap();
                let owners = owners_of(&found, parts).unwrap();
                assert_eq!(owners.before.len(), parts as usize + 1);
                let mut of_parts = vec![0; parts as usize];
                for cell in 0..count {
                    of_parts[owners.part_of(7 * cell * cell + 3) as usize] += 1;
                }
                let (least, most) = (of_parts.iter().min(), of_parts.iter().max());
                assert!(most.unwrap() - least.unwrap() <= 1, "{count} {of_parts:?}");
            }
        }
    }
}
