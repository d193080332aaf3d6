//! The sums over components and surfaces of a part, and those over what lies in several parts.

use crate::convert::components::Components;
use crate::convert::id_places::IdPlaces;
use crate::convert::parts::directory::{Directory, Done, FileSum, Made};
use crate::convert::resolve::Each;
use crate::error::Result;
use crate::measure::{ComponentRecord, RecordTable, SurfaceRecord};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::{Mark, SpillFile};
use bytemuck::{Pod, Zeroable};
use serde::de::IgnoredAny;
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 11;
/// Names of the tables.
const OBJECTS: &str = "objects";
/// See [`OBJECTS`].
const CELLS: &str = "cells";
/// See [`OBJECTS`].
const SURFACES: &str = "surfaces";
/// In the place of a part: a sum is of none.
pub const NO_PART: u64 = u64::MAX;

/// The record of a component that lies in several parts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SharedComponent {
    record: ComponentRecord,
    /// Id and part, or part and id.
    key: [u64; 2],
}

/// The record of a surface that lies in several parts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SharedSurface {
    record: SurfaceRecord,
    /// Id and part, or part and id.
    key: [u64; 2],
}

/// A record of something that lies in several parts.
pub trait Shared: Keyed {
    /// The record without the rest.
    type Record: Pod;
    /// With id and part, or part and id.
    fn new(record: Self::Record, key: [u64; 2]) -> Self;
    /// The record.
    fn record(&self) -> Self::Record;
    /// Adds another one of the same.
    fn merge(into: &mut Self::Record, other: &Self::Record);
}

impl Keyed for SharedComponent {
    fn key(&self) -> [u64; 2] {
        self.key
    }
}

impl Keyed for SharedSurface {
    fn key(&self) -> [u64; 2] {
        self.key
    }
}

impl Shared for SharedComponent {
    type Record = ComponentRecord;

    fn new(record: ComponentRecord, key: [u64; 2]) -> Self {
        SharedComponent { record, key }
    }

    fn record(&self) -> ComponentRecord {
        self.record
    }

    fn merge(into: &mut ComponentRecord, other: &ComponentRecord) {
        into.merge(other);
    }
}

impl Shared for SharedSurface {
    type Record = SurfaceRecord;

    fn new(record: SurfaceRecord, key: [u64; 2]) -> Self {
        SharedSurface { record, key }
    }

    fn record(&self) -> SurfaceRecord {
        self.record
    }

    fn merge(into: &mut SurfaceRecord, other: &SurfaceRecord) {
        into.merge(other);
    }
}

/// Files of a part: all records of components that begin there, and the records of those that lie in several parts.
pub fn own_file(table: &str) -> String {
    format!("{table}.records")
}

/// See [`own_file`].
pub fn shared_file(table: &str) -> String {
    format!("{table}.shared")
}

/// The file of what merging hands a part of a table.
pub fn merged_file(table: &str, part: u32) -> String {
    format!("part-{part:04}.{table}")
}

/// The sum of a file that was written as a spool.
pub fn sum_of(path: &str, mark: Mark) -> FileSum {
    FileSum {
        path: path.to_owned(),
        bytes: mark.len,
        crc: mark.crc,
    }
}

/// Writes the records of a part in a table of this name: those in its own places, the first ones, and those of ids that
/// others have, too.
///
/// # Errors
/// [`crate::Error::Io`], and what `record` returns.
pub fn write_table<S: Shared>(
    dir: &Path,
    name: &str,
    record: impl Fn(u64) -> Result<S::Record>,
    (own, place_of): (u64, impl Fn(u64) -> u64),
    shared: &[u64],
) -> Result<[FileSum; 2]> {
    let path = own_file(name);
    let mut file = SpillFile::create(&dir.join(&path))?;
    for place in 0..own {
        file.push(&[record(place)?])?;
    }
    let own = sum_of(&path, file.mark()?);
    let path = shared_file(name);
    let mut file = SpillFile::create(&dir.join(&path))?;
    for &id in shared {
        let record = record(place_of(id))?;
        file.push(&[S::new(record, [id, 0])])?;
    }
    Ok([own, sum_of(&path, file.mark()?)])
}

/// How many ids are a part's own, and where the record of each lies.
pub fn in_places(places: &IdPlaces) -> (u64, impl Fn(u64) -> u64 + '_) {
    (places.own, |id| places.of(id))
}

/// Writes the records of a part, of which `shared` lists the ids that lie in others, too.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_records(
    dir: &Path,
    components: &Components,
    shared: &Each<Vec<u64>>,
) -> Result<Vec<FileSum>> {
    let Components {
        objects,
        cells,
        surfaces,
        places,
        ..
    } = components;
    let of = |place| objects.get(place);
    let placed = in_places(&places.objects);
    let objects = write_table::<SharedComponent>(dir, OBJECTS, of, placed, &shared.objects);
    let of = |place| cells.get(place);
    let placed = in_places(&places.cells);
    let cells = write_table::<SharedComponent>(dir, CELLS, of, placed, &shared.cells);
    let of = |place| surfaces.get(place);
    let placed = in_places(&places.surfaces);
    let surfaces = write_table::<SharedSurface>(dir, SURFACES, of, placed, &shared.surfaces);
    Ok([objects?, cells?, surfaces?].concat())
}

/// Hands on the records of a part in a table of this name, by their places: its own, then what merging has made of those that
/// others have, too.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged; what `set` returns.
pub fn read_table<S: Shared, A, B>(
    name: &str,
    place_of: impl Fn(u64) -> u64,
    done: &Done<A>,
    (merged, part): (&Done<B>, u32),
    mut set: impl FnMut(u64, S::Record) -> Result<()>,
) -> Result<()> {
    let mut place = 0;
    done.spool(&own_file(name))?.each(|record: S::Record| {
        set(place, record)?;
        place += 1;
        Ok(())
    })?;
    let others = merged.spool(&merged_file(name, part))?;
    others.each(|shared: S| {
        let [_, id] = shared.key();
        set(place_of(id), shared.record())
    })
}

/// Fills a table with what [`read_table`] hands on.
pub fn setter<T: Pod>(table: &mut RecordTable<T>) -> impl FnMut(u64, T) -> Result<()> + '_ {
    |place, record| table.update(place, |own| *own = record)
}

/// Reads the records of a part back, those of components that lie in several parts as they are of the whole volume.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn read_records<A, B>(
    empty: Components,
    done: &Done<A>,
    merged: &Done<B>,
    part: u32,
) -> Result<Components> {
    let Components {
        mut objects,
        mut cells,
        mut surfaces,
        places,
        ..
    } = empty;
    let merged = (merged, part);
    let set = setter(&mut objects);
    read_table::<SharedComponent, _, _>(OBJECTS, |id| places.objects.of(id), done, merged, set)?;
    let set = setter(&mut cells);
    read_table::<SharedComponent, _, _>(CELLS, |id| places.cells.of(id), done, merged, set)?;
    let set = setter(&mut surfaces);
    read_table::<SharedSurface, _, _>(SURFACES, |id| places.surfaces.of(id), done, merged, set)?;
    Ok(Components {
        objects,
        cells,
        surfaces,
        places,
        has_titles: part == 0,
        given: None,
        walls: None,
    })
}

/// What parts have left in a round.
#[derive(Clone, Copy)]
pub struct LeftInRound<'a> {
    /// Where they work.
    pub directory: &'a Directory,
    /// The round.
    pub round: u32,
}

impl LeftInRound<'_> {
    /// Calls `each` for all records of a file that all parts have.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged; those of `each`.
    pub fn each<T: Pod>(&self, name: &str, mut each: impl FnMut(T) -> Result<()>) -> Result<()> {
        for part in 0..self.directory.parts() {
            let done: Done<IgnoredAny> = self.directory.done_by(self.round, part)?;
            done.spool(name)?.each(&mut each)?;
        }
        Ok(())
    }
}

/// Records of what lies in several parts, of one table, by their ids.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn gather<S: Shared>(
    directory: &Directory,
    round: u32,
    dir: &Path,
    name: &str,
) -> Result<Sorter<S>> {
    let mut by_id = Sorter::<S>::new(dir, ROOM)?;
    for part in 0..directory.parts() {
        let done: Done<IgnoredAny> = directory.done_by(round, part)?;
        done.spool(&shared_file(name))?.each(|shared: S| {
            let [id, _] = shared.key();
            by_id.push(S::new(shared.record(), [id, part.into()]))
        })?;
    }
    Ok(by_id)
}

/// Adds up one table's records, and hands each part those that it needs.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn merge_table<S: Shared>(
    by_id: Sorter<S>,
    parts: u32,
    dir: &Path,
    name: &str,
) -> Result<Vec<FileSum>> {
    merge_table_with(by_id, parts, dir, name, |_, _| Ok(()))
}

/// The same; `each` is told of all ids and what their records add up to.
///
/// # Errors
/// [`crate::Error::Io`], and what `each` returns.
pub fn merge_table_with<S: Shared>(
    by_id: Sorter<S>,
    parts: u32,
    dir: &Path,
    name: &str,
    mut each: impl FnMut(u64, &S::Record) -> Result<()>,
) -> Result<Vec<FileSum>> {
    let mut by_part = Sorter::<S>::new(dir, ROOM)?;
    let mut at_hand: Option<(u64, S::Record, Vec<u64>)> = None;
    let mut hand_out = |(id, record, mut parts): (u64, S::Record, Vec<u64>)| {
        each(id, &record)?;
        parts.dedup();
        let parts = parts.into_iter().filter(|&part| part != NO_PART);
        parts
            .into_iter()
            .try_for_each(|part| by_part.push(S::new(record, [part, id])))
    };
    by_id.finish(|shared| {
        let [id, part] = shared.key();
        match &mut at_hand {
            Some((own, record, parts)) if *own == id => {
                S::merge(record, &shared.record());
                parts.push(part);
                Ok(())
            }
            _ => {
                let before = at_hand.replace((id, shared.record(), vec![part]));
                before.map_or(Ok(()), &mut hand_out)
            }
        }
    })?;
    at_hand.map_or(Ok(()), &mut hand_out)?;
    hand_out_table(by_part, parts, dir, name)
}

/// Writes each part's records of one table, which have part and id as their keys.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn hand_out_table<S: Keyed>(
    by_part: Sorter<S>,
    parts: u32,
    dir: &Path,
    name: &str,
) -> Result<Vec<FileSum>> {
    let mut files = PartFiles::new(dir, name)?;
    by_part.finish(|shared| {
        let [part, _] = shared.key();
        files.go_on_to(part as u32)?;
        files.push(&shared)
    })?;
    files.finish(parts)
}

/// Files of one table for all parts, one after the other.
pub struct PartFiles<'a> {
    dir: &'a Path,
    table: &'a str,
    /// Those that are whole.
    files: Vec<FileSum>,
    /// The next one.
    file: SpillFile,
}

impl<'a> PartFiles<'a> {
    /// Begins with that of the first part.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(dir: &'a Path, table: &'a str) -> Result<Self> {
        Ok(PartFiles {
            dir,
            table,
            files: Vec::new(),
            file: SpillFile::create(&dir.join(merged_file(table, 0)))?,
        })
    }

    /// The name of the next file.
    fn name(&self) -> String {
        merged_file(self.table, self.files.len() as u32)
    }

    /// Adds a record to the file of the part at hand.
    pub fn push<T: Pod>(&mut self, record: &T) -> Result<()> {
        self.file.push(&[*record]).map(|_| ())
    }

    /// Ends the files of parts before this one.
    pub fn go_on_to(&mut self, part: u32) -> Result<()> {
        while self.files.len() < part as usize {
            let sum = sum_of(&self.name(), self.file.mark()?);
            self.files.push(sum);
            self.file = SpillFile::create(&self.dir.join(self.name()))?;
        }
        Ok(())
    }

    /// Ends them all.
    pub fn finish(mut self, parts: u32) -> Result<Vec<FileSum>> {
        self.go_on_to(parts - 1)?;
        let sum = sum_of(&self.name(), self.file.mark()?);
        self.files.push(sum);
        Ok(self.files)
    }
}

/// Adds up the records of all that lies in several parts.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn merge_records(directory: &Directory, round: u32, dir: &Path) -> Result<Made<()>> {
    let parts = directory.parts();
    let mut files = Vec::new();
    for name in [OBJECTS, CELLS] {
        let all: Sorter<SharedComponent> = gather(directory, round, dir, name)?;
        files.extend(merge_table(all, parts, dir, name)?);
    }
    let all: Sorter<SharedSurface> = gather(directory, round, dir, SURFACES)?;
    files.extend(merge_table(all, parts, dir, SURFACES)?);
    Ok(Made {
        marks: Default::default(),
        files,
        result: (),
    })
}
