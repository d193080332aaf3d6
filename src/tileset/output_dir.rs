//! The output directory: everything is made beside and moved in at the end, the manifest last.

use crate::checkpoint::{LayersDone, STATE, kept};
use crate::error::{Error, Result};
use crate::manifest::{
    COMPONENTS, COMPONENTS_PARQUET, LEGEND, LEGEND_SVG, NECKS, NECKS_PARQUET, PARTIAL as WORK,
    TILESET, WALLS, WALLS_PARQUET,
};
use crate::sys::files::{make_directory, remove_if_there, write_file};
use crate::tileset::Lock;
use crate::tileset::levels_left::{give_up_moving, levels_left};
use crate::tileset::refused::{refuse_bucket, refuse_inside};
use std::ffi::OsString;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What a tile set may have at its top level, the manifest first: it goes first and comes last. Only
/// painted sets have legends, tables are Parquet, too, where that was asked for, and some have levels of detail.
const ENTRIES: [&str; 19] = [
    "index.json",
    "index",
    "tiles",
    "cells.csv",
    "objects.csv",
    "surfaces.csv",
    OPTIONAL[0],
    OPTIONAL[1],
    OPTIONAL[2],
    OPTIONAL[3],
    OPTIONAL[4],
    OPTIONAL[5],
    OPTIONAL[6],
    OPTIONAL[7],
    OPTIONAL[8],
    OPTIONAL[9],
    OPTIONAL[10],
    OPTIONAL[11],
    OPTIONAL[12],
];
/// What some tile sets lack: pictures of colours, tables as Parquet, levels of detail, tables of cells that are parts of
/// components.
const OPTIONAL: [&str; 13] = [
    LEGEND,
    LEGEND_SVG,
    "cells.parquet",
    "objects.parquet",
    "surfaces.parquet",
    TILESET,
    "lod",
    COMPONENTS,
    NECKS,
    WALLS,
    COMPONENTS_PARQUET,
    NECKS_PARQUET,
    WALLS_PARQUET,
];
/// The file in it that says who works there.
const LOCK: &str = "lock";
/// The file in it that says how a volume is converted in parts, and the directory of these, until it is removed.
pub(crate) const PLAN: &str = "plan.json";
pub(crate) const PARTS: &str = "parts";
const PARTS_GONE: &str = "parts.gone";
/// The file in it that says that all is made and is being moved in.
const MOVING: &str = "moving";
/// The file in it that lists what is moved, one name in a line.
const TO_MOVE: &str = "moving.names";

/// Makes the directories of a tile set in the one where it is made, unless they are there.
///
/// # Errors
/// [`Error::Io`].
pub fn make_directories(work: &Path) -> Result<()> {
    let mut all = ["tiles", "index"].into_iter();
    all.try_for_each(|name| make_directory(&work.join(name)))
}

/// An output directory in the making; dropped before [`Output::commit`], it leaves things as they
/// were, or what has been made in the work directory if that is to be kept.
#[derive(Debug)]
pub struct Output {
    out: PathBuf,
    work: PathBuf,
    /// True if `out` itself is new.
    made_out: bool,
    keep: bool,
    done: bool,
    lock: Option<Lock>,
}

/// The layers that an interrupted conversion into `out` has finished, if there was one, and not all of it is in place.
pub fn interrupted(out: &Path) -> Option<LayersDone> {
    let work = out.join(WORK);
    // the index is the last to be moved
    let moved = work.join(MOVING).exists() && !work.join(ENTRIES[0]).exists();
    kept(&work).filter(|_| !moved)
}

/// True if all of a tile set is made and somebody moves it into `out`, or has been stopped meanwhile.
pub fn is_moved_in(out: &Path) -> bool {
    out.join(WORK).join(MOVING).exists()
}

/// Refuses a directory in which no tile set can be made, and leaves it as it is. What an interrupted conversion
/// left there is no hindrance.
///
/// # Errors
/// [`Error::OutputExists`] if it holds a tile set and `force` is not set; [`Error::OutputForeign`] if it holds
/// anything else; [`Error::OutputBusy`] if somebody writes there; [`Error::Usage`] if it lies in a tile set; [`Error::Io`] if it
/// cannot be written.
pub fn check_output(out: &Path, force: bool) -> Result<()> {
    let before = out.join(WORK).exists();
    let mut output = Output::open(out, force, false)?;
    output.keep(before);
    Ok(())
}

/// Whether there is a directory, in which a tile set can be made then.
///
/// # Errors
/// As of [`check_output`], but for locks; with `resume` a set that is being moved in, or has just been, is none.
fn is_free(out: &Path, force: bool, resume: bool) -> Result<bool> {
    let work = out.join(WORK);
    let has = |dir: &Path| dir.join(ENTRIES[0]).exists();
    let moving = work.join(MOVING).exists()
        && match has(&work) {
            true => !has(out),
            false => resume,
        };
    let entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(Error::io(out, "use as the output directory", e)),
    };
    let names = entries.map(|entry| entry.map(|e| e.file_name()));
    let names: std::io::Result<Vec<_>> = names.collect();
    let names = names.map_err(|e| Error::io(out, "read the directory", e))?;
    let ours = |name: &&OsString| ENTRIES.iter().any(|&e| *name == e);
    let foreign = |name: &&OsString| *name != WORK && !ours(name);
    if let Some(entry) = names.iter().filter(foreign).min() {
        return Err(Error::OutputForeign {
            path: out.to_path_buf(),
            entry: entry.clone(),
        });
    }
    match !force && !moving && names.iter().any(|name| ours(&name)) {
        true => Err(exists(out)),
        false => Ok(true),
    }
}

/// Removes what a process left that was killed before anything was done, or after it had moved everything to its final
/// name. Whatever can be gone on with stays.
///
/// # Errors
/// [`Error::OutputBusy`] if somebody writes there; [`Error::Io`].
pub fn tidy(out: &Path) -> Result<()> {
    let is_of_use = || levels_left(out).is_some() || interrupted(out).is_some();
    match !out.join(WORK).exists() || is_of_use() {
        true => Ok(()),
        // whoever held the lock may have begun meanwhile
        false => remove_if(out, || !is_of_use()),
    }
}

/// Removes the work directory of `out` if that may be when nobody else works there.
///
/// # Errors
/// As of [`tidy`].
pub fn remove_if(out: &Path, may_go: impl FnOnce() -> bool) -> Result<()> {
    let work = out.join(WORK);
    let mut output = Output {
        lock: Some(take_lock(&work, out)?),
        out: out.to_path_buf(),
        work,
        made_out: false,
        keep: true,
        done: false,
    };
    match may_go() {
        true => output.remove_work(),
        false => Ok(()),
    }
}

/// An error as the user is told: what is being made in the work directory of `out` has the name that it gets later,
/// and what nobody gets to see has that of `out`.
pub fn outward(error: Error, out: &Path) -> Error {
    let work = out.join(WORK);
    let outward = |path: PathBuf| {
        let Ok(inside) = path.strip_prefix(&work) else {
            return path;
        };
        let first = inside.components().next();
        let stays = first.is_some_and(|c| ENTRIES.iter().any(|&e| c.as_os_str() == e));
        match stays {
            true => out.join(inside),
            false => out.to_path_buf(),
        }
    };
    match error {
        Error::Io {
            path,
            action,
            source,
        } => Error::Io {
            path: outward(path),
            action,
            source,
        },
        Error::Format {
            path,
            found,
            expected,
            hint,
        } => Error::Format {
            path: outward(path),
            found,
            expected,
            hint,
        },
        error => error,
    }
}

impl Output {
    /// Makes an empty work directory inside `out`.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if `out` holds a tile set, be it an interrupted conversion, and `force`
    /// is not set; [`Error::OutputForeign`] if it holds anything else; [`Error::OutputBusy`] if somebody else
    /// writes there; [`Error::Io`] if it cannot be written.
    pub fn create(out: &Path, force: bool) -> Result<Self> {
        let mut output = Self::open(out, force, false)?;
        // asked when nobody else writes there any more
        if !force && interrupted(out).is_some() {
            output.keep(true);
            return Err(exists(out));
        }
        output.clear()?;
        Ok(output)
    }

    /// Makes a work directory inside `out`, or takes the one that an interrupted conversion left, with
    /// all that is in it. What `out` has of a set that was being moved in is no hindrance, nor is a
    /// whole one that has just been moved in if `resume` is set.
    ///
    /// # Errors
    /// As of [`Output::create`], but for interrupted conversions.
    pub fn open(out: &Path, force: bool, resume: bool) -> Result<Self> {
        if !force && out.join(WORK).join(PLAN).exists() {
            return Err(Error::OutputPlanned {
                path: out.to_path_buf(),
            });
        }
        Self::open_any(out, force, resume)
    }

    /// Takes the work directory of a plan to convert in parts, with all that is in it.
    ///
    /// # Errors
    /// As of [`Output::open`].
    pub fn open_planned(out: &Path) -> Result<Self> {
        let mut output = Self::open_any(out, true, true)?;
        output.keep(true);
        Ok(output)
    }

    fn open_any(out: &Path, force: bool, resume: bool) -> Result<Self> {
        refuse_bucket(out)?;
        refuse_inside(out)?;
        let work = out.join(WORK);
        let made_out = match is_free(out, force, resume)? {
            true => false,
            false => {
                fs::create_dir_all(out).map_err(|e| Error::io(out, "create the directory", e))?;
                true
            }
        };
        let lock = take_lock(&work, out).inspect_err(|_| {
            // only what is empty goes, so nothing of somebody else's
            let _ = fs::remove_dir(&work);
            if made_out {
                let _ = fs::remove_dir(out);
            }
        })?;
        // whoever held the lock may have finished meanwhile
        if let Err(error) = is_free(out, force, resume) {
            let _ = fs::remove_file(work.join(LOCK));
            drop(lock);
            let _ = fs::remove_dir(&work);
            return Err(error);
        }
        Ok(Output {
            out: out.to_path_buf(),
            work,
            made_out,
            keep: false,
            done: false,
            lock: Some(lock),
        })
    }

    /// Empties the work directory and makes the directories of a tile set in it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn clear(&self) -> Result<()> {
        if self.work.join(MOVING).exists() {
            for name in ENTRIES {
                remove_if_there(&self.out.join(name))?;
            }
        }
        give_up_moving(&self.out, &self.work)?;
        self.empty()?;
        make_directories(&self.work)
    }

    /// Where to write.
    pub fn work(&self) -> &Path {
        &self.work
    }

    /// Says whether the work directory stays if this is dropped now.
    pub fn keep(&mut self, keep: bool) {
        self.keep = keep;
    }

    /// The note that [`Output::commit`] left before it was interrupted.
    pub fn moving(&self) -> Option<Vec<u8>> {
        fs::read(self.work.join(MOVING)).ok()
    }

    /// Says that all is made. What follows can be interrupted and done again; `note` then tells what
    /// was made.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin_commit(&mut self, note: &[u8]) -> Result<()> {
        let there = ENTRIES.iter().filter(|name| self.work.join(name).exists());
        let names: Vec<&str> = there.copied().collect();
        write_file(&self.work.join(TO_MOVE), &[names.join("\n").as_bytes()])?;
        let path = self.work.join(MOVING);
        let new = path.with_extension("new");
        write_file(&new, &[note])?;
        fs::rename(&new, &path).map_err(|e| Error::io(&path, "move into place", e))?;
        self.keep = true;
        Ok(())
    }

    /// Moves everything to its final name, the manifest last, where nothing was before: what others move there at the same
    /// time is the same.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn move_in(mut self) -> Result<()> {
        self.move_all()?;
        self.done = true;
        self.remove_work()
    }

    /// Moves everything to its final name, the manifest last.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn commit(mut self) -> Result<()> {
        if !self.work.join(MOVING).exists() {
            self.begin_commit(b"")?;
        }
        let list = self.work.join(TO_MOVE);
        let list = fs::read_to_string(&list).map_err(|e| Error::io(&list, "read", e))?;
        for name in ENTRIES {
            // what has been moved already is not to be removed, and what the new set lacks is of another one
            if self.work.join(name).exists() || list.lines().all(|moved| moved != name) {
                remove_if_there(&self.out.join(name))?;
            }
        }
        self.move_all()?;
        self.done = true;
        self.remove_work()
    }

    /// Moves what there is to its final name, the manifest last.
    fn move_all(&self) -> Result<()> {
        for name in ENTRIES.iter().rev() {
            let to = self.out.join(name);
            match fs::rename(self.work.join(name), &to) {
                // not every set has these; the others have been moved already
                Err(e)
                    if e.kind() == ErrorKind::NotFound
                        && (OPTIONAL.contains(name) || to.exists()) => {}
                moved => moved.map_err(|e| Error::io(&to, "move into place", e))?,
            }
        }
        Ok(())
    }

    /// Removes all but the lock from the work directory.
    fn empty(&self) -> Result<()> {
        // first of all, so that what is half removed is not taken for a state to go on from
        for name in STATE {
            remove_if_there(&self.work.join(name))?;
        }
        // whoever still works on a part finds no directory then
        let (parts, gone) = (self.work.join(PARTS), self.work.join(PARTS_GONE));
        if parts.exists() {
            remove_if_there(&gone)?;
            fs::rename(&parts, &gone).map_err(|e| Error::io(&parts, "move", e))?;
        }
        let fail = |e| Error::io(&self.work, "read the directory", e);
        for entry in fs::read_dir(&self.work).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            if entry.file_name() != LOCK {
                remove_if_there(&entry.path())?;
            }
        }
        Ok(())
    }

    fn remove_work(&mut self) -> Result<()> {
        give_up_moving(&self.out, &self.work)?;
        self.empty()?;
        // whoever takes the lock from here on makes a directory of its own
        remove_if_there(&self.work.join(LOCK))?;
        self.lock = None;
        match fs::remove_dir(&self.work) {
            Err(e) if e.kind() == ErrorKind::DirectoryNotEmpty => Ok(()),
            removed => removed.map_err(|e| Error::io(&self.work, "remove", e)),
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if self.done || self.keep {
            return;
        }
        // nothing more can be done about a failure here
        let _ = self.remove_work();
        if self.made_out {
            let _ = fs::remove_dir(&self.out);
        }
    }
}

fn exists(out: &Path) -> Error {
    Error::OutputExists {
        path: out.to_path_buf(),
    }
}

/// Makes the work directory of `out` if it is not there, and takes its lock, waiting a little for whoever holds it.
///
/// # Errors
/// Those of [`Lock::take`].
pub fn take_lock(work: &Path, out: &Path) -> Result<Lock> {
    let mut tries = 0;
    loop {
        let made = match fs::create_dir(work) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists && work.is_dir() => Ok(()),
            made => made,
        };
        made.map_err(|e| Error::io(work, "create the directory", e))?;
        tries += 1;
        match Lock::take(&work.join(LOCK), out) {
            // somebody else is done and has removed the directory just now
            Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound && tries < 10 => {
            }
            taken => return taken,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The names in a directory, but that of the work directory.
    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name());
        let names = entries.map(|name| name.into_string().unwrap());
        let mut names: Vec<String> = names.filter(|name| name != WORK).collect();
        names.sort();
        names
    }

    /// One that waits for another to end takes nothing of what that has made.
    #[test]
    fn what_somebody_finishes_meanwhile_stays() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let mut first = Output::create(&out, false).unwrap();
        for name in ["index.json", "cells.csv", "objects.csv", "surfaces.csv"] {
            fs::write(first.work().join(name), "first").unwrap();
        }
        let second = std::thread::spawn({
            let out = out.clone();
            move || Output::create(&out, false).map(drop)
        });
        // by then it waits for the lock, which it does for two seconds
        std::thread::sleep(std::time::Duration::from_millis(300));
        first.begin_commit(b"note").unwrap();
        first.commit().unwrap();
        let refused = second.join().unwrap();
        assert!(
            matches!(refused, Err(Error::OutputExists { .. })),
            "{refused:?}"
        );
        assert_eq!(fs::read(out.join("index.json")).unwrap(), b"first");
        assert!(!out.join(WORK).exists());
    }

    /// Wherever moving was stopped, going on moves the rest and loses nothing; what the new set lacks goes.
    #[test]
    fn moving_in_goes_on_wherever_it_was_stopped() {
        let tables = [
            "cells.csv",
            "objects.csv",
            "surfaces.csv",
            "cells.parquet",
            NECKS,
        ];
        let new = [&["index.json"], &tables[..]].concat();
        for stop in 0..=new.len() + 2 {
            let dir = tempfile::tempdir().unwrap();
            let out = dir.path().join("out");
            fs::create_dir(&out).unwrap();
            for old in [
                "index.json",
                "cells.csv",
                "objects.csv",
                "legend.png",
                NECKS,
            ] {
                fs::write(out.join(old), "old").unwrap();
            }
            let mut output = Output::open_any(&out, true, false).unwrap();
            output.clear().unwrap();
            for name in &new {
                fs::write(output.work().join(name), "new").unwrap();
            }
            output.begin_commit(b"note").unwrap();
            // as far as it gets: what is removed first, then what is moved, the manifest last
            for name in ENTRIES {
                remove_if_there(&out.join(name)).unwrap();
            }
            let there = |name: &&&str| output.work().join(name).exists();
            let moved: Vec<_> = ENTRIES.iter().rev().filter(there).take(stop).collect();
            for name in moved {
                fs::rename(output.work().join(name), out.join(name)).unwrap();
            }
            drop(output);
            let output = Output::open_any(&out, false, true).unwrap();
            assert_eq!(output.moving().as_deref(), Some(&b"note"[..]));
            output.commit().unwrap();
            let mut expected = [&new[..], &["index", "tiles"]].concat();
            expected.sort_unstable();
            assert_eq!(names(&out), expected, "after {stop}");
            for name in &new {
                assert_eq!(fs::read_to_string(out.join(name)).unwrap(), "new", "{name}");
            }
        }
    }
}
