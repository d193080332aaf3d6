//! A tile set that was made on this machine, put below a key of a bucket: each file once, the index last.

use super::{is_remote, list, remote};
use crate::error::{Error, Result};
use rayon::prelude::*;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// What was put.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Uploaded {
    /// Files that were there already, with the same bytes.
    pub there: u64,
    pub files: u64,
    pub bytes: u64,
}

/// Refuses a place in a bucket that holds objects, unless it holds what an upload has left that is to be gone on with, and
/// never one with an `index`; and a store that does not keep its word on conditions, for nothing else keeps two writers
/// apart there.
///
/// # Errors
/// [`Error::Format`] and [`Error::Unsupported`] as said; [`Error::Io`] for what the store answers.
pub(crate) fn refuse_used(dir: &Path, index: &str, resume: bool) -> Result<()> {
    debug_assert!(is_remote(dir));
    let there: Vec<_> = match list(dir).and_then(Iterator::collect) {
        Ok(there) => there,
        Err(e) if e.kind() == ErrorKind::NotFound => Vec::new(),
        Err(e) => return Err(Error::io(dir, "list what is there", e)),
    };
    let has_index = there.iter().any(|entry| entry.name == index);
    if has_index || !there.is_empty() && !resume {
        let found = match has_index {
            true => "a tile set",
            false => "objects below this key",
        };
        let hint = match has_index {
            true => "nothing in a bucket is replaced: give another key, or remove what is there",
            false => {
                "give --resume to go on with an upload that was interrupted, another key, or remove what is there"
            }
        };
        return Err(Error::format(dir, found, "a key with nothing below").with_hint(hint));
    }
    match remote::probe(dir) {
        Ok(true) => Ok(()),
        Ok(false) => Err(Error::unsupported(
            dir,
            "a store that puts one object over another although it was told not to (If-None-Match: *)",
            "two writers would mix their tiles: write to this machine, and copy the directory",
        )),
        Err(e) => Err(Error::io(dir, "put an object", e)),
    }
}

/// Puts all files of the directory `set` below `dir`, `index` last. What is there with the same bytes stays, so it can be done again
/// after it was interrupted. `done` is called with each file's bytes, and says whether to go on.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read, an object of other bytes is there, or what the store answers;
/// [`Error::Interrupted`].
pub(crate) fn upload(
    set: &Path,
    dir: &Path,
    index: &str,
    done: &(dyn Fn(u64) -> bool + Sync),
) -> Result<Uploaded> {
    let (there, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
    let put = |inner: &Path| -> Result<()> {
        let (from, to) = (set.join(inner), dir.join(inner));
        let len = std::fs::metadata(&from)
            .map_err(|e| Error::io(&from, "read", e))?
            .len();
        let new = remote::put_file(&from, &to).map_err(|e| Error::io(&to, "put the object", e))?;
        there.fetch_add(u64::from(!new), Ordering::Relaxed);
        bytes.fetch_add(len, Ordering::Relaxed);
        match done(len) {
            true => Ok(()),
            false => Err(Error::Interrupted),
        }
    };
    let mut files = 0;
    // a layer at a time: their names take little memory
    let mut folders = vec![PathBuf::new()];
    while let Some(folder) = folders.pop() {
        let mut names = Vec::new();
        let below = set.join(&folder);
        let fail = |e| Error::io(&below, "list", e);
        for entry in std::fs::read_dir(&below).map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let inner = folder.join(entry.file_name());
            if entry.file_type().map_err(fail)?.is_dir() {
                folders.push(inner);
            } else if inner != Path::new(index) {
                names.push(inner);
            }
        }
        files += names.len() as u64;
        names
            .par_iter()
            .with_max_len(1)
            .try_for_each(|inner| put(inner))?;
    }
    put(Path::new(index))?;
    Ok(Uploaded {
        there: there.into_inner(),
        files: files + 1,
        bytes: bytes.into_inner(),
    })
}
