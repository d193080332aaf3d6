//! Surfaces between cells and objects that lie in several parts. They are numbered by cells, then objects, so that those of
//! a cell are numbered in the part where it begins; where others have found more of them is found out here.

use crate::convert::components::Components;
use crate::convert::id_places::IdPlaces;
use crate::convert::parts::directory::{Directory, Done, FileSum};
use crate::convert::parts::records::{
    Shared, SharedSurface, hand_out_table, merged_file, own_file, shared_file, sum_of,
};
use crate::convert::parts::split::meshed::MeshedPart;
use crate::error::{Error, Result};
use crate::measure::{RecordTable, SurfaceRecord};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::Path;

/// The table.
const SURFACES: &str = "surfaces";
/// Records that are sorted in memory.
const ROOM: usize = 1 << 11;

/// What a part knows of a surface of a cell that may lie in other parts, too. With object 0 it tells where the surfaces of
/// the cell begin in the part where the cell does.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Piece {
    record: SurfaceRecord,
    part: u64,
    /// How many surfaces of cells that begin in the part come before it there.
    rank: u64,
    /// 1 if the part has counted it with its cell and its object: no other part knows of these two.
    counted: u64,
    reserved: u64,
}

impl Keyed for Piece {
    fn key(&self) -> [u64; 2] {
        [self.record.cell, self.record.object]
    }
}

/// Writes the surfaces of a part, of which `shared` lists the objects and the cells that may lie in others; `own_cells` begin
/// here. Those that other parts may count are not counted any more. Returns the files, and how many surfaces there are of
/// cells that begin here.
///
/// # Errors
/// [`Error::Io`].
pub fn write_surfaces(
    components: &mut Components,
    part: u32,
    shared: [&[u64]; 2],
    own_cells: Range<u64>,
    dir: &Path,
) -> Result<(Vec<FileSum>, u64)> {
    let [objects, cells] = shared;
    let (own_name, shared_name) = (own_file(SURFACES), shared_file(SURFACES));
    let mut own = SpillFile::create(&dir.join(&own_name))?;
    let mut pieces = SpillFile::create(&dir.join(&shared_name))?;
    let mut begin = cells
        .iter()
        .filter(|&cell| own_cells.contains(cell))
        .peekable();
    let mut rank = 0;
    let piece = |record, rank, counted: bool| Piece {
        record,
        part: part.into(),
        rank,
        counted: u64::from(counted),
        reserved: 0,
    };
    let start = |cell: u64, rank| {
        let record = SurfaceRecord {
            cell,
            ..SurfaceRecord::zeroed()
        };
        piece(record, rank, true)
    };
    for at in 0..components.surfaces.len() {
        let record = components.surfaces.get(at)?;
        let SurfaceRecord { cell, object, .. } = record;
        while let Some(&cell) = begin.next_if(|&&begins| begins <= cell) {
            pieces.push(&[start(cell, rank)])?;
        }
        if cells.binary_search(&cell).is_ok() {
            let is_counted = objects.binary_search(&object).is_err();
            if !is_counted {
                let place = components.place_of_cell(cell);
                components.cells.update(place, |r| r.surfaces -= 1)?;
                let place = components.places.objects.of(object);
                components.objects.update(place, |r| r.surfaces -= 1)?;
            }
            pieces.push(&[piece(record, rank, is_counted)])?;
        } else {
            own.push(&[record])?;
        }
        rank += u64::from(own_cells.contains(&cell));
    }
    for &cell in begin {
        pieces.push(&[start(cell, rank)])?;
    }
    let files = vec![
        sum_of(&own_name, own.mark()?),
        sum_of(&shared_name, pieces.mark()?),
    ];
    Ok((files, rank))
}

/// Which part has the rows of each cell, and of its surfaces and openings.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CellOwners {
    /// The largest cell that parts before each part own; at last, the largest of all.
    pub before: Vec<u64>,
    /// True if each cell begins in its part, which has numbered the surfaces that it knows of.
    pub begin_there: bool,
}

impl CellOwners {
    /// The part of a cell.
    pub fn part_of(&self, cell: u64) -> u64 {
        self.before.partition_point(|&before| before < cell) as u64 - 1
    }

    /// True if the owner of a surface's cell is one of the parts that have found the surface, and has numbered it.
    fn has_numbered(&self, parts: &[u64], owner: u64) -> bool {
        self.begin_there && parts.contains(&owner)
    }
}

/// What came of joining surfaces.
pub struct MergedSurfaces {
    /// What each part is handed.
    pub files: Vec<FileSum>,
    /// Surfaces of cells that begin in parts before each part; at last, all of them.
    pub before: Vec<u64>,
}

/// Joins the surfaces of all parts and numbers them, those of each cell in the part that owns it. `count` is told cell and
/// object of those that no part has counted.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if a file is damaged.
pub fn merge_surfaces(
    directory: &Directory,
    round: u32,
    owners: &CellOwners,
    dir: &Path,
    count: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<MergedSurfaces> {
    let parts = directory.parts();
    let mut sorter = Sorter::<Piece>::new(dir, ROOM)?;
    let mut added = vec![0; parts as usize];
    for part in 0..parts {
        let done: Done<MeshedPart> = directory.done_by(round, part)?;
        added[part as usize] = done.result.surfaces;
        done.spool(&shared_file(SURFACES))?
            .each(|piece: Piece| sorter.push(piece))?;
    }
    let mut sorted = SpillFile::new(dir)?;
    sorter.finish(|piece| sorted.push(&[piece]).map(|_| ()))?;
    sorted.mark()?;
    each_surface(&sorted, |surface| {
        let owner = owners.part_of(surface.record.cell);
        added[owner as usize] += u64::from(!owners.has_numbered(&surface.parts, owner));
        Ok(())
    })?;
    let mut before = vec![0];
    for added in added {
        before.push(before.last().expect("not empty") + added);
    }
    let mut by_part = Sorter::<SharedSurface>::new(dir, ROOM)?;
    let mut numbers = Numbers::default();
    each_surface(&sorted, |mut surface| {
        let owner = owners.part_of(surface.record.cell);
        let misfit = || {
            let found = format!("no first surface of cell {}", surface.record.cell);
            let expected = format!("one that part {owner} has told");
            Error::format(&directory.out, found, expected)
        };
        let rank = numbers.rank(&surface, owners).ok_or_else(misfit)?;
        if surface.record.object == 0 {
            return Ok(());
        }
        let id = before[owner as usize] + rank + 1;
        if !surface.is_counted {
            count(surface.record.cell, surface.record.object)?;
        }
        if !surface.parts.contains(&owner) {
            surface.parts.push(owner);
        }
        let record = surface.record;
        surface.parts.into_iter().try_for_each(|part| {
            let key = [part, id];
            by_part.push(SharedSurface::new(record, key))
        })
    })?;
    Ok(MergedSurfaces {
        files: hand_out_table(by_part, parts, dir, SURFACES)?,
        before,
    })
}

/// Numbers surfaces, by rising cells and objects, among those of the part where their cells begin.
#[derive(Default)]
struct Numbers {
    owner: u64,
    cell: u64,
    /// Surfaces that the part knows itself and that come before.
    known: u64,
    /// Those that others have found.
    added: u64,
}

impl Numbers {
    /// How many come before a surface; `None` if the part has told nothing of its cell.
    fn rank(&mut self, surface: &Surface, owners: &CellOwners) -> Option<u64> {
        let owner = owners.part_of(surface.record.cell);
        if self.owner != owner {
            (self.owner, self.added) = (owner, 0);
        }
        if surface.record.object == 0 {
            (self.cell, self.known) = (surface.record.cell, surface.rank);
            return Some(surface.rank);
        }
        if owners.begin_there && self.cell != surface.record.cell {
            return None;
        }
        let rank = self.known + self.added;
        match owners.has_numbered(&surface.parts, owner) {
            true => self.known += 1,
            false => self.added += 1,
        }
        Some(rank)
    }
}

/// A surface, or the first one of a cell, as all parts together know it.
struct Surface {
    record: SurfaceRecord,
    rank: u64,
    is_counted: bool,
    /// The parts that know of it.
    parts: Vec<u64>,
}

/// Calls `each` with all surfaces, of pieces that are sorted by cells and objects.
fn each_surface(sorted: &SpillFile, mut each: impl FnMut(Surface) -> Result<()>) -> Result<()> {
    let mut at_hand: Option<Surface> = None;
    sorted.each(|piece: Piece| {
        if let Some(surface) = &mut at_hand {
            let record = &mut surface.record;
            if [record.cell, record.object] == piece.key() {
                record.merge(&piece.record);
                surface.is_counted |= piece.counted == 1;
                surface.parts.push(piece.part);
                return Ok(());
            }
        }
        let next = Surface {
            record: piece.record,
            rank: piece.rank,
            is_counted: piece.counted == 1,
            parts: vec![piece.part],
        };
        at_hand.replace(next).map_or(Ok(()), &mut each)
    })?;
    at_hand.map_or(Ok(()), each)
}

/// The surfaces of a part, with the places of their ids. `range` has how many lie in parts before it, and with it.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if a file is damaged.
pub fn read_surfaces<A, B>(
    done: &Done<A>,
    merged: &Done<B>,
    part: u32,
    [before, end]: [u64; 2],
    (memory, dir): (u64, &Path),
) -> Result<(RecordTable<SurfaceRecord>, IdPlaces)> {
    let handed = merged.spool(&merged_file(SURFACES, part))?;
    let mut places = IdPlaces {
        before,
        own: end - before,
        others: Vec::new(),
    };
    let mut others = Vec::new();
    let mut taken = Vec::new();
    handed.each(|surface: SharedSurface| {
        let [_, id] = surface.key();
        match places.is_own(id) {
            true => taken.push(places.of(id)),
            false => others.push(id),
        }
        Ok(())
    })?;
    places.others = others;
    let mut table = RecordTable::new(places.len(), memory, dir)?;
    handed.each(|surface: SharedSurface| {
        let [_, id] = surface.key();
        table.update(places.of(id), |own| *own = surface.record())
    })?;
    // the part's own have the other places, in their order
    let (mut place, mut taken) = (0, taken.into_iter().peekable());
    done.spool(&own_file(SURFACES))?
        .each(|record: SurfaceRecord| {
            while taken.next_if_eq(&place).is_some() {
                place += 1;
            }
            table.update(place, |own| *own = record)?;
            place += 1;
            Ok(())
        })?;
    Ok((table, places))
}
