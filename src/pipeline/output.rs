//! The output directory: everything is made beside and moved in at the end, the manifest last.

use crate::error::{Error, Result};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What a tile set may have at its top level, the manifest first: it goes first and comes last. Only
/// painted sets have a legend.
const ENTRIES: [&str; 7] = [
    "index.json",
    "index",
    "tiles",
    "cells.csv",
    "objects.csv",
    "surfaces.csv",
    "legend.png",
];
/// Name of the directory for what is not finished.
const WORK: &str = ".alvis-partial";

/// An output directory in the making; dropped before [`Output::commit`], it leaves things as they
/// were.
#[derive(Debug)]
pub struct Output {
    out: PathBuf,
    work: PathBuf,
    /// True if `out` itself is new.
    made_out: bool,
    done: bool,
}

impl Output {
    /// Makes the work directory inside `out`.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if `out` holds anything and `force` is not set, or holds anything but
    /// a tile set; [`Error::Io`] if it cannot be written.
    pub fn create(out: &Path, force: bool) -> Result<Self> {
        let made_out = match fs::read_dir(out) {
            Ok(entries) => {
                for entry in entries {
                    let name = entry
                        .map_err(|e| Error::io(out, "read the directory", e))?
                        .file_name();
                    let ours = name == WORK || ENTRIES.iter().any(|&e| name == e);
                    if name != WORK && !(force && ours) {
                        return Err(Error::OutputExists {
                            path: out.to_path_buf(),
                        });
                    }
                }
                false
            }
            Err(e) if e.kind() == ErrorKind::NotFound => {
                fs::create_dir_all(out).map_err(|e| Error::io(out, "create the directory", e))?;
                true
            }
            Err(e) => return Err(Error::io(out, "use as the output directory", e)),
        };
        let work = out.join(WORK);
        let output = Output {
            out: out.to_path_buf(),
            work,
            made_out,
            done: false,
        };
        remove_if_there(&output.work)?;
        for dir in ["", "tiles", "index"] {
            let dir = output.work.join(dir);
            fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
        }
        Ok(output)
    }

    /// Where to write.
    pub fn work(&self) -> &Path {
        &self.work
    }

    /// Moves everything to its final name, the manifest last.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn commit(mut self) -> Result<()> {
        for name in ENTRIES {
            remove_if_there(&self.out.join(name))?;
        }
        for name in ENTRIES.iter().rev() {
            let to = self.out.join(name);
            match fs::rename(self.work.join(name), &to) {
                Err(e) if e.kind() == ErrorKind::NotFound && *name == "legend.png" => {}
                moved => moved.map_err(|e| Error::io(&to, "move into place", e))?,
            }
        }
        self.done = true;
        remove_if_there(&self.work)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if self.done {
            return;
        }
        // nothing more can be done about a failure here
        let _ = fs::remove_dir_all(&self.work);
        if self.made_out {
            let _ = fs::remove_dir(&self.out);
        }
    }
}

fn remove_if_there(path: &Path) -> Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(meta) if meta.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(e) => Err(e),
    };
    removed.map_err(|e| Error::io(path, "remove", e))
}
