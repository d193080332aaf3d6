//! What is done of a layer of nodes in the making, a line for each node, so that none has to be made again.

use super::entry::Entry;
use super::level::Made;
use crate::error::{Error, Result};
use crate::manifest::{node_path, node_shard_path};
use crate::sys::files::remove_if_there;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// The journal of a layer, to which nodes are added as they are written.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

fn path(work: &Path, level: u32, z: u32) -> PathBuf {
    work.join(node_shard_path(level, z)).with_extension("done")
}

impl Journal {
    /// Begins the journal of a layer with the nodes that were done before.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(work: &Path, level: u32, z: u32, done: &[Made]) -> Result<Self> {
        let path = path(work, level, z);
        let file = File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
        let journal = Journal {
            path,
            file: Mutex::new(file),
        };
        done.iter().try_for_each(|made| journal.add(made))?;
        Ok(journal)
    }

    /// Adds a node that is written.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn add(&self, made: &Made) -> Result<()> {
        let mut line = serde_json::to_vec(made).expect("plain data serialises");
        line.push(b'\n');
        let mut file = self.file.lock().unwrap_or_else(|e| e.into_inner());
        file.write_all(&line)
            .map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Removes that of a layer that is done.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn remove(work: &Path, level: u32, z: u32) -> Result<()> {
        remove_if_there(&path(work, level, z))
    }

    /// The nodes that were done of a layer before the work was interrupted, as far as their files are as they were.
    pub fn kept(work: &Path, level: u32, z: u32) -> Vec<Made> {
        let text = fs::read(path(work, level, z)).unwrap_or_default();
        let lines = text.split(|b| *b == b'\n');
        // the last line may have been cut off
        let made = lines.filter_map(|line| serde_json::from_slice::<Made>(line).ok());
        made.filter(|made| {
            let entry = &made.entry;
            let named = node_path(level, entry.grid) == entry.path && entry.grid[2] == z;
            named && Entry::of_node(entry.clone()).read(work).is_ok()
        })
        .collect()
    }
}
