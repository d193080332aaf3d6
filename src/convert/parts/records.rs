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
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 11;
/// Names of the tables.
const TABLES: [&str; 3] = ["objects", "cells", "surfaces"];

/// The record of a component that lies in several parts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SharedComponent {
    record: ComponentRecord,
    /// Id and part, or part and id.
    key: [u64; 2],
}

/// The record of a surface that lies in several parts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SharedSurface {
    record: SurfaceRecord,
    /// Id and part, or part and id.
    key: [u64; 2],
}

/// A record of something that lies in several parts.
trait Shared: Keyed {
    /// The record without the rest.
    type Record: Pod;
    fn new(record: Self::Record, key: [u64; 2]) -> Self;
    fn record(&self) -> Self::Record;
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
fn own_file(table: usize) -> String {
    format!("{}.records", TABLES[table])
}

fn shared_file(table: usize) -> String {
    format!("{}.shared", TABLES[table])
}

fn merged_file(table: usize, part: u32) -> String {
    format!("part-{part:04}.{}", TABLES[table])
}

/// The sum of a file that was written as a spool.
fn sum_of(path: &str, mark: Mark) -> FileSum {
    FileSum {
        path: path.to_owned(),
        bytes: mark.len,
        crc: mark.crc,
    }
}

fn write_table<S: Shared>(
    dir: &Path,
    number: usize,
    table: &RecordTable<S::Record>,
    places: &IdPlaces,
    shared: &[u64],
) -> Result<[FileSum; 2]> {
    let path = own_file(number);
    let mut file = SpillFile::create(&dir.join(&path))?;
    for place in 0..places.own {
        file.push(&[table.get(place)?])?;
    }
    let own = sum_of(&path, file.mark()?);
    let path = shared_file(number);
    let mut file = SpillFile::create(&dir.join(&path))?;
    for &id in shared {
        let record = table.get(places.of(id))?;
        file.push(&[S::new(record, [id, 0])])?;
    }
    Ok([own, sum_of(&path, file.mark()?)])
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
    let objects = write_table::<SharedComponent>(dir, 0, objects, &places.objects, &shared.objects);
    let cells = write_table::<SharedComponent>(dir, 1, cells, &places.cells, &shared.cells);
    let surfaces =
        write_table::<SharedSurface>(dir, 2, surfaces, &places.surfaces, &shared.surfaces);
    Ok([objects?, cells?, surfaces?].concat())
}

fn read_table<S: Shared, A, B>(
    number: usize,
    mut table: RecordTable<S::Record>,
    places: &IdPlaces,
    done: &Done<A>,
    merged: (&Done<B>, u32),
) -> Result<RecordTable<S::Record>> {
    let mut place = 0;
    done.spool(&own_file(number))?.each(|record: S::Record| {
        table.update(place, |own| *own = record)?;
        place += 1;
        Ok(())
    })?;
    let (merged, part) = merged;
    let others = merged.spool(&merged_file(number, part))?;
    others.each(|shared: S| {
        let [_, id] = shared.key();
        table.update(places.of(id), |own| *own = shared.record())
    })?;
    Ok(table)
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
        objects,
        cells,
        surfaces,
        places,
        ..
    } = empty;
    let merged = (merged, part);
    let objects = read_table::<SharedComponent, _, _>(0, objects, &places.objects, done, merged)?;
    let cells = read_table::<SharedComponent, _, _>(1, cells, &places.cells, done, merged)?;
    let surfaces = read_table::<SharedSurface, _, _>(2, surfaces, &places.surfaces, done, merged)?;
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

/// Adds up one table's records of what lies in several parts, and hands each part those that it needs.
fn merge_table<S: Shared>(
    directory: &Directory,
    round: u32,
    dir: &Path,
    number: usize,
) -> Result<Vec<FileSum>> {
    let mut by_id = Sorter::<S>::new(dir, ROOM)?;
    for part in 0..directory.parts() {
        let done: Done<serde::de::IgnoredAny> = directory.done_by(round, part)?;
        done.spool(&shared_file(number))?.each(|shared: S| {
            let [id, _] = shared.key();
            by_id.push(S::new(shared.record(), [id, part.into()]))
        })?;
    }
    let mut by_part = Sorter::<S>::new(dir, ROOM)?;
    let mut at_hand: Option<(u64, S::Record, Vec<u64>)> = None;
    let mut hand_out = |(id, record, parts): (u64, S::Record, Vec<u64>)| {
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
    let mut files = PartFiles::new(dir, number)?;
    by_part.finish(|shared| {
        let [part, _] = shared.key();
        files.go_on_to(part as u32)?;
        files.file.push(&[shared]).map(|_| ())
    })?;
    files.finish(directory.parts())
}

/// Files of one table for all parts, one after the other.
struct PartFiles<'a> {
    dir: &'a Path,
    table: usize,
    /// Those that are whole.
    files: Vec<FileSum>,
    /// The next one.
    file: SpillFile,
}

impl<'a> PartFiles<'a> {
    fn new(dir: &'a Path, table: usize) -> Result<Self> {
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

    /// Ends the files of parts before this one.
    fn go_on_to(&mut self, part: u32) -> Result<()> {
        while self.files.len() < part as usize {
            let sum = sum_of(&self.name(), self.file.mark()?);
            self.files.push(sum);
            self.file = SpillFile::create(&self.dir.join(self.name()))?;
        }
        Ok(())
    }

    /// Ends them all.
    fn finish(mut self, parts: u32) -> Result<Vec<FileSum>> {
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
    let files = [
        merge_table::<SharedComponent>(directory, round, dir, 0)?,
        merge_table::<SharedComponent>(directory, round, dir, 1)?,
        merge_table::<SharedSurface>(directory, round, dir, 2)?,
    ];
    Ok(Made {
        marks: Default::default(),
        files: files.concat(),
        result: (),
    })
}
