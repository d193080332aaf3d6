//! Which chunks of a volume are there, by the names of files, so that a volume of which a part is missing is told.

use crate::error::{Error, Result};
use crate::store::{self, File};
use crate::volume::formats::zarr::files::{Files, NONE};
use crate::volume::formats::zarr::meta::{Array, ChunkKey};
use crate::volume::stated::written::Missing;
use std::path::{Path, PathBuf};

/// More names than this are not looked at.
const MAX_NAMES: u64 = 1 << 20;
/// More shards than this are not looked into.
const MAX_SHARDS: usize = 1 << 12;
/// More entries of tables of shards than this are not looked at.
const MAX_ENTRIES: u64 = 1 << 22;

/// How chunk files may be named.
const KEYS: [ChunkKey; 4] = [
    ChunkKey::new("", '.'),
    ChunkKey::new("", '/'),
    ChunkKey::new("c", '/'),
    ChunkKey::new("c", '.'),
];

/// Chunks of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Count {
    pub(crate) missing: u64,
    pub(crate) total: u64,
}

impl From<Count> for Missing {
    fn from(count: Count) -> Self {
        Missing {
            count: Some(count.missing),
            total: count.total,
        }
    }
}

/// What is found in the folder of an array.
#[derive(Debug, Default)]
struct Names {
    /// Files of chunks or shards that the volume needs, the first of them, and as many as are looked into.
    needed: u64,
    first: Option<Vec<u64>>,
    some: Vec<Vec<u64>>,
    /// Those whose names are no numbers of a chunk, and one of them.
    strange: u64,
    example: Option<PathBuf>,
    looked_at: u64,
}

/// Counts the chunks of a volume that are missing, and looks for their files by the other names in use if there is
/// none of the stated names: then `files` has these afterwards. `at` is the entry of every axis besides `volume`.
/// `None` if there are too many to count. Notes say what else was found.
pub(crate) fn count(
    files: &mut Files,
    volume: [usize; 3],
    at: &[u64],
    notes: &mut Vec<String>,
) -> Result<Option<Count>> {
    let wanted = Wanted::of(&files.array, volume, at);
    let stated = files.array.key;
    let Some(mut names) = wanted.names(files.folder(), stated)? else {
        return Ok(None);
    };
    if names.first.is_none() {
        for key in KEYS.into_iter().filter(|key| *key != stated) {
            let found = wanted.names(files.folder(), key)?;
            let Some(found) = found else { continue };
            let Some(first) = &found.first else { continue };
            let said = files.file(first);
            files.array.key = key;
            let read = files.file(first);
            let inner = |path: &Path| {
                let inner = path.strip_prefix(files.folder()).unwrap_or(path);
                inner.display().to_string()
            };
            notes.push(format!(
                "chunks are not named as the metadata say, {}, but {}: read so",
                inner(&said),
                inner(&read)
            ));
            names = found;
            break;
        }
    }
    if let (Some(example), n @ 1..) = (&names.example, names.strange) {
        let name = example
            .strip_prefix(files.folder())
            .unwrap_or(example)
            .display();
        notes.push(match n {
            1 => format!("a file of another name than chunks have is not read: {name}"),
            n => format!("{n} files of other names than chunks have are not read, such as {name}"),
        });
    }
    wanted.missing(files, &names)
}

/// The chunks that a volume needs.
struct Wanted {
    /// Files along each axis, of which `only` one is needed where that is stated.
    grid: Vec<u64>,
    only: Vec<Option<u64>>,
    /// Chunks along each axis, likewise, and those in a file.
    chunks: Vec<u64>,
    chunk: Vec<Option<u64>>,
    inside: Vec<u64>,
}

impl Wanted {
    fn of(array: &Array, volume: [usize; 3], at: &[u64]) -> Wanted {
        let axes = 0..array.shape.len();
        let inside: Vec<u64> = match &array.shards {
            Some(shards) => shards.count.clone(),
            None => vec![1; array.shape.len()],
        };
        let chunks: Vec<u64> = array
            .shape
            .iter()
            .zip(&array.chunk)
            .map(|(s, c)| s.div_ceil(*c))
            .collect();
        let one = |i: usize| (!volume.contains(&i)).then(|| at[i] / array.chunk[i]);
        Wanted {
            grid: chunks
                .iter()
                .zip(&inside)
                .map(|(n, k)| n.div_ceil(*k))
                .collect(),
            only: axes
                .clone()
                .map(|i| one(i).map(|n| n / inside[i]))
                .collect(),
            chunk: axes.map(one).collect(),
            chunks,
            inside,
        }
    }

    fn product(sizes: &[u64], only: &[Option<u64>]) -> u64 {
        let sizes = sizes.iter().zip(only).filter(|(_, only)| only.is_none());
        sizes.fold(1, |n, (s, _)| n.saturating_mul(*s))
    }

    /// Looks through the names of a kind; `None` if there are too many.
    fn names(&self, folder: &Path, key: ChunkKey) -> Result<Option<Names>> {
        let mut names = Names::default();
        let whole = match key.separator {
            '/' => self.nested(&folder.join(key.front), &mut Vec::new(), &mut names)?,
            _ => self.flat(folder, key.front, &mut names)?,
        };
        Ok(whole.then_some(names))
    }

    /// Names such as `0.0.0` in one folder; false if there are too many.
    fn flat(&self, folder: &Path, front: &str, names: &mut Names) -> Result<bool> {
        each(folder, names, |path, name, folder, names| {
            let rest = match front {
                "" => Some(name),
                front => name
                    .strip_prefix(front)
                    .and_then(|rest| rest.strip_prefix('.')),
            };
            let place = rest.map(|rest| rest.split('.').map(number).collect::<Option<Vec<u64>>>());
            match place {
                Some(Some(place)) if place.len() == self.grid.len() => self.add(place, names),
                _ if folder => {}
                _ => names.stranger(path, name),
            }
            Ok(true)
        })
    }

    /// Names such as `0/0/0`; false if there are too many.
    fn nested(&self, folder: &Path, place: &mut Vec<u64>, names: &mut Names) -> Result<bool> {
        if !store::is_dir(folder) {
            return Ok(true);
        }
        let last = place.len() + 1 == self.grid.len();
        each(folder, names, |path, name, is_folder, names| {
            match number(name) {
                Some(n) if last => {
                    self.add([&place[..], &[n]].concat(), names);
                    Ok(true)
                }
                Some(n) if is_folder => {
                    let axis = place.len();
                    if self.only[axis].is_some_and(|only| only != n) || n >= self.grid[axis] {
                        return Ok(true);
                    }
                    place.push(n);
                    let whole = self.nested(path, place, names);
                    place.pop();
                    whole
                }
                _ if is_folder => Ok(true),
                _ => {
                    names.stranger(path, name);
                    Ok(true)
                }
            }
        })
    }

    fn add(&self, place: Vec<u64>, names: &mut Names) {
        let needed = place.iter().zip(&self.grid).zip(&self.only);
        let mut needed =
            needed.map(|((n, size), only)| n < size && only.is_none_or(|only| only == *n));
        if needed.all(|n| n) {
            names.needed += 1;
            if names.first.as_ref().is_none_or(|first| place < *first) {
                names.first = Some(place.clone());
            }
            if names.some.len() < MAX_SHARDS {
                names.some.push(place);
            }
        }
    }

    fn missing(&self, files: &Files, names: &Names) -> Result<Option<Count>> {
        let there = names.needed;
        if files.array.shards.is_none() {
            let total = Self::product(&self.grid, &self.only);
            let missing = total.saturating_sub(there);
            return Ok(Some(Count { missing, total }));
        }
        let each: u64 = self.inside.iter().fold(1, |n: u64, k| n.saturating_mul(*k));
        if each.saturating_mul(there) > MAX_ENTRIES || there > names.some.len() as u64 {
            return Ok(None);
        }
        let mut present = 0;
        for place in &names.some {
            present += self.in_shard(files, place)?;
        }
        let total = Self::product(&self.chunks, &self.chunk);
        let missing = total.saturating_sub(present);
        Ok(Some(Count { missing, total }))
    }

    /// Chunks of the volume that are in a shard, by its table.
    fn in_shard(&self, files: &Files, shard: &[u64]) -> Result<u64> {
        let path = files.file(shard);
        let Some((file, size)) = files.open(&path)? else {
            return Ok(0);
        };
        let (start, len) = files.table_place(&path, size)?;
        let mut present = 0;
        let mut buffer = vec![0; 1 << 16];
        for first in (0..len).step_by(buffer.len()) {
            let n = (len - first).min(buffer.len() as u64) as usize;
            read(&file, &path, start + first, &mut buffer[..n])?;
            for (i, entry) in (first / 16..).zip(buffer[..n].as_chunks::<16>().0) {
                let there = *entry != *bytemuck::bytes_of(&NONE);
                present += u64::from(there && self.needs(shard, i));
            }
        }
        Ok(present)
    }

    /// True if chunk `i` of a shard is one of the volume.
    fn needs(&self, shard: &[u64], mut i: u64) -> bool {
        (0..self.inside.len()).rev().all(|axis| {
            let n = shard[axis] * self.inside[axis] + i % self.inside[axis];
            i /= self.inside[axis];
            n < self.chunks[axis] && self.chunk[axis].is_none_or(|only| only == n)
        })
    }
}

fn read(file: &File, path: &Path, at: u64, out: &mut [u8]) -> Result<()> {
    file.read_exact_at(out, at)
        .map_err(|e| Error::io(path, "read", e))
}

impl Names {
    fn stranger(&mut self, path: &Path, name: &str) {
        // metadata, and what systems put into folders
        if name.starts_with('.') || name == "zarr.json" {
            return;
        }
        self.strange += 1;
        if self.example.as_deref().is_none_or(|e| path < e) {
            self.example = Some(path.to_path_buf());
        }
    }
}

/// The number that a name is, without zeros in front.
fn number(name: &str) -> Option<u64> {
    let plain =
        name.bytes().all(|b| b.is_ascii_digit()) && (name.len() == 1 || !name.starts_with('0'));
    name.parse().ok().filter(|_| plain)
}

/// Looks at each name in a folder, as long as `look` says so; false if that ends before.
fn each(
    folder: &Path,
    names: &mut Names,
    mut look: impl FnMut(&Path, &str, bool, &mut Names) -> Result<bool>,
) -> Result<bool> {
    let fail = |e| Error::io(folder, "list", e);
    for entry in store::list(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        names.looked_at += 1;
        let path = folder.join(&entry.name);
        let name = entry.name.to_string_lossy();
        if names.looked_at > MAX_NAMES || !look(&path, &name, entry.is_dir, names)? {
            return Ok(false);
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbers_as_they_are_written() {
        let names = ["0", "10", "01", "", "1e3", "-1", "+1"];
        let found = [Some(0), Some(10), None, None, None, None, None];
        assert_eq!(names.map(number), found);
    }
}
