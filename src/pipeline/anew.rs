//! Tiles that are written a second time. The new ones lie beside the old ones, layer by layer, until
//! a checkpoint says that the layer is done: a tile that is half written can then be made again.

use crate::direct::{self, Buffer};
use crate::error::{Error, Result};
use crate::pipeline::keep::Keeper;
use crate::pipeline::output::remove_if_there;
use crate::pipeline::tilefile::write_file;
use crate::pipeline::writers::{Job, Writers};
use crate::tile::tile_path;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Directory of the new ones.
const ANEW: &str = "anew";

/// Where a tile is written for the second time.
pub fn anew_path(grid: [u32; 3]) -> PathBuf {
    Path::new(ANEW).join(tile_path(grid))
}

/// Layers whose new tiles wait to take the place of the old ones.
pub struct Anew<'a> {
    work: &'a Path,
    waiting: Vec<u32>,
    /// How many of them the sync covers that began last.
    covered: usize,
}

impl<'a> Anew<'a> {
    /// Begins after `done` layers: moves what waits of these, and drops the others.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(work: &'a Path, done: u32, layers: u32) -> Result<Self> {
        let anew = Anew {
            work,
            waiting: Vec::new(),
            covered: 0,
        };
        if work.join(ANEW).exists() {
            (0..done).try_for_each(|layer| anew.move_layer(layer))?;
            (done..layers).try_for_each(|layer| remove_if_there(&anew.layer_dir(layer)))?;
        }
        Ok(anew)
    }

    fn layer_dir(&self, layer: u32) -> PathBuf {
        let tile = self.work.join(anew_path([0, 0, layer]));
        tile.parent()
            .expect("a tile lies in a directory")
            .to_path_buf()
    }

    /// A layer's tiles have their ids. New tiles take their places at once, or, if there are
    /// checkpoints that count after a power failure, once they are on the disk.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn layer_done(&mut self, layer: u32, keeper: &mut Keeper) -> Result<()> {
        keeper.save_finished(layer + 1)?;
        self.waiting.push(layer);
        let begun = keeper.disk().begin()?;
        if !keeper.disk().is_used() {
            return self.move_first(self.waiting.len());
        }
        if begun {
            // the one before is over
            self.move_first(self.covered)?;
            self.covered = self.waiting.len();
        }
        Ok(())
    }

    /// Moves all that waits.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn end(mut self, keeper: &mut Keeper) -> Result<()> {
        if self.work.join(ANEW).exists() {
            keeper.disk().finish()?;
            self.move_first(self.waiting.len())?;
        }
        Ok(())
    }

    fn move_first(&mut self, count: usize) -> Result<()> {
        let layers: Vec<u32> = self.waiting.drain(..count).collect();
        self.covered = 0;
        layers
            .into_iter()
            .try_for_each(|layer| self.move_layer(layer))
    }

    /// Puts the new tiles of a layer in the place of the old ones.
    fn move_layer(&self, layer: u32) -> Result<()> {
        let from = self.layer_dir(layer);
        let fail = |e| Error::io(&from, "list", e);
        let entries = match fs::read_dir(&from) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
            entries => entries.map_err(fail)?,
        };
        let tile = self.work.join(tile_path([0, 0, layer]));
        for entry in entries {
            let entry = entry.map_err(fail)?;
            let to = tile.with_file_name(entry.file_name());
            // ext4 writes out first what is to replace another file, which takes a third longer; if this ends
            // here, the new tile still waits, and takes its place when the conversion goes on
            remove_if_there(&to)?;
            fs::rename(entry.path(), &to).map_err(|e| Error::io(&to, "move into place", e))?;
        }
        fs::remove_dir(&from).map_err(|e| Error::io(&from, "remove", e))
    }
}

/// Files of a tile that is written anew.
#[derive(Default)]
pub struct Buffers {
    /// As it was.
    pub old: Buffer,
    /// As it is to be.
    pub new: Buffer,
}

/// Reads a tile that this conversion wrote.
///
/// # Errors
/// [`Error::Io`].
pub fn read_back<'b>(path: &Path, buffer: &'b mut Buffer) -> Result<&'b [u8]> {
    let read = |buffer: &mut Buffer| {
        let file = File::open(path)?;
        let len = file.metadata()?.len();
        buffer.read(&file, len as usize)
    };
    read(buffer).map_err(|e| Error::io(path, "read back", e))?;
    Ok(buffer.get())
}

/// Writes a whole tile from its parts, long ones by the writers if there are any.
///
/// # Errors
/// [`Error::Io`].
pub fn write_anew(
    path: PathBuf,
    parts: [&[u8]; 2],
    (writers, buffer): (Option<&Writers>, &mut Buffer),
) -> Result<()> {
    let bytes = parts.iter().map(|part| part.len()).sum();
    let Some(writers) = writers.filter(|_| bytes >= direct::WORTH) else {
        return write_file(&path, &parts);
    };
    buffer.begin(bytes, bytes);
    let (head, bin) = buffer.get_mut().split_at_mut(parts[0].len());
    head.copy_from_slice(parts[0]);
    bin.copy_from_slice(parts[1]);
    *buffer = writers.put(Job {
        path,
        start: 0,
        body: std::mem::take(buffer),
    })?;
    Ok(())
}
