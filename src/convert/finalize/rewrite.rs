//! Tiles that are written a second time. The new ones lie beside the old ones, layer by layer, until
//! a checkpoint says that the layer is done: a tile that is half written can then be made again.

use crate::checkpoint::Checkpointer;
use crate::convert::scan::tile_writer::Heads;
use crate::error::{Error, Result};
use crate::sys::background_writer::{BackgroundWriters, Job};
use crate::sys::direct_io::{self, Buffer};
use crate::sys::files::remove_if_there;
use crate::sys::files::write_file;
use crate::tile::{
    EncodedBody, EncodedLayout, FloatBody, Grouped, Node, Refused, plain_head, tile_file,
    tile_file_with, tile_path,
};
use crate::tileset::layer_directory;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Layers that wait to be moved at most: they lie on the disk twice.
const LAYERS: usize = 8;
/// Directory of the new ones.
const ANEW: &str = "anew";

/// Where a tile is written for the second time.
pub fn replacement_path(grid: [u32; 3]) -> PathBuf {
    Path::new(ANEW).join(tile_path(grid))
}

/// Where the new tiles of a layer are.
fn layer_dir(work: &Path, layer: u32) -> PathBuf {
    work.join(ANEW).join(layer_directory(layer))
}

/// Makes the directory for the new tiles of a layer, if it is not there.
///
/// # Errors
/// [`Error::Io`].
pub fn make_layer_dir(work: &Path, layer: u32) -> Result<()> {
    let dir = layer_dir(work, layer);
    fs::create_dir_all(&dir).map_err(|e| Error::io(&dir, "create the directory", e))
}

/// Layers whose new tiles wait to take the place of the old ones.
pub struct Anew {
    work: PathBuf,
    waiting: Vec<u32>,
    /// How many of them the sync covers that began last.
    covered: usize,
    mover: Option<Mover>,
}

impl Anew {
    /// Begins after `done` layers: moves what waits of these, and drops the others.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(work: &Path, done: u32, layers: u32) -> Result<Self> {
        if work.join(ANEW).exists() {
            (0..done).try_for_each(|layer| move_layer(work, layer))?;
            (done..layers).try_for_each(|layer| remove_if_there(&layer_dir(work, layer)))?;
        }
        Ok(Anew {
            work: work.to_path_buf(),
            waiting: Vec::new(),
            covered: 0,
            mover: None,
        })
    }

    /// A layer's tiles have their ids. New tiles take their places from now on, or, if there are
    /// checkpoints that count after a power failure, once they are on the disk.
    ///
    /// # Errors
    /// [`Error::Io`], also if an earlier layer's tiles could not take their places.
    pub fn layer_done(&mut self, layer: u32, checkpointer: &mut Checkpointer) -> Result<()> {
        checkpointer.save_finished(layer + 1)?;
        if layer_dir(&self.work, layer).exists() {
            self.waiting.push(layer);
        }
        let begun = checkpointer.disk().begin()?;
        if !checkpointer.disk().is_used() {
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
    pub fn end(mut self, checkpointer: &mut Checkpointer) -> Result<()> {
        if !self.waiting.is_empty() {
            checkpointer.disk().finish()?;
            self.move_first(self.waiting.len())?;
        }
        self.mover.as_mut().map_or(Ok(()), Mover::end)
    }

    fn move_first(&mut self, count: usize) -> Result<()> {
        self.covered = 0;
        for layer in self.waiting.drain(..count) {
            let mover = match &mut self.mover {
                Some(mover) => mover,
                None => self.mover.insert(Mover::begin(&self.work)?),
            };
            mover.put(layer)?;
        }
        Ok(())
    }
}

/// A thread that moves new tiles into the places of old ones. To remove these takes little work, but the
/// disk may be waited for: on ext4 with `discard` and without a journal, until it has forgotten their blocks.
struct Mover {
    /// None once it has ended.
    layers: Option<SyncSender<u32>>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Mover {
    /// # Errors
    /// [`Error::Io`].
    fn begin(work: &Path) -> Result<Self> {
        let (layers, queue) = sync_channel(LAYERS);
        let dir = work.to_path_buf();
        let run = move || queue.iter().try_for_each(|layer| move_layer(&dir, layer));
        let thread = std::thread::Builder::new().name("move".into()).spawn(run);
        let thread =
            thread.map_err(|e| Error::io(work, "start a thread for moving tiles in", e))?;
        Ok(Mover {
            layers: Some(layers),
            thread: Some(thread),
        })
    }

    /// Has a layer's tiles moved after those before; waits while there are too many of these.
    ///
    /// # Errors
    /// [`Error::Io`] if one of these could not be.
    fn put(&mut self, layer: u32) -> Result<()> {
        let layers = self.layers.as_ref().expect("it has not ended");
        match layers.send(layer) {
            Ok(()) => Ok(()),
            // nobody receives it any more, since something failed
            Err(_) => self.end(),
        }
    }

    /// Waits until all are moved.
    ///
    /// # Errors
    /// [`Error::Io`].
    fn end(&mut self) -> Result<()> {
        self.layers = None;
        let thread = self.thread.take();
        thread.map_or(Ok(()), |t| t.join().expect("it does not panic"))
    }
}

impl Drop for Mover {
    fn drop(&mut self) {
        // something else has failed before
        let _ = self.end();
    }
}

/// Puts the new tiles of a layer in the place of the old ones.
fn move_layer(work: &Path, layer: u32) -> Result<()> {
    let from = layer_dir(work, layer);
    let fail = |e| Error::io(&from, "list", e);
    let entries = match fs::read_dir(&from) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(fail)?,
    };
    let tiles = work.join(layer_directory(layer));
    for entry in entries {
        let entry = entry.map_err(fail)?;
        let to = tiles.join(entry.file_name());
        // ext4 writes out first what is to replace another file, which takes a third longer; if this ends
        // here, the new tile still waits, and takes its place when the conversion goes on
        remove_if_there(&to)?;
        fs::rename(entry.path(), &to).map_err(|e| Error::io(&to, "move into place", e))?;
    }
    fs::remove_dir(&from).map_err(|e| Error::io(&from, "remove", e))
}

/// Files of a tile that is written anew.
#[derive(Default)]
pub struct Buffers {
    /// As it was.
    pub old: Buffer,
    /// As it is to be.
    pub new: Buffer,
}

/// Fills `out` with the file of a tile whose macrocube has its lowest voxel at `low`; returns its index entries.
///
/// What the sweep would have written with the same pieces looks the same: it leaves room for their widest JSON.
///
/// # Errors
/// [`Refused`].
pub fn fill(
    out: &mut Buffer,
    heads: Heads,
    low: [u32; 3],
    made: &Grouped,
    nodes: &[Node],
) -> std::result::Result<u64, Refused> {
    let head = heads.head;
    let room = |layout: &EncodedLayout, bytes| {
        let body = &made.body;
        heads.room(low, EncodedBody { body, layout }, bytes)
    };
    if !head.is_plain(nodes.len()) {
        let bin = made.bytes();
        let floats = FloatBody {
            body: &made.body,
            bytes: &bin,
        };
        let file = match head.is_encoded_early() {
            true => tile_file_with(head, low, floats, nodes, room),
            false => tile_file(head, low, floats, nodes),
        }?;
        let bytes = file.head.len() + file.bin.len();
        out.begin(bytes, bytes);
        let (before, bin) = out.get_mut().split_at_mut(file.head.len());
        before.copy_from_slice(&file.head);
        bin.copy_from_slice(&file.bin);
        return Ok(file.indices);
    }
    // as it is made, and copied no more: a hundredth of the time of a sparse scan
    let body_bytes = made.body.bytes as usize;
    let room = room(&EncodedLayout::default(), body_bytes)?;
    let before = plain_head(head, &made.body, nodes, room)?;
    let bytes = before.len() + body_bytes;
    out.begin(bytes, bytes);
    let mut rest = out.get_mut();
    let mut put = |part: &[u8]| rest.write_all(part).expect("as long as its parts are");
    put(&before);
    made.write(put);
    Ok(made.body.pieces.iter().map(|p| u64::from(p.indices)).sum())
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

/// Writes a whole tile, a long one by the writers if there are any, who leave other memory for it.
///
/// # Errors
/// [`Error::Io`].
pub fn write_replacement(
    path: PathBuf,
    tile: &mut Buffer,
    writers: Option<&BackgroundWriters>,
) -> Result<()> {
    let Some(writers) = writers.filter(|_| tile.get().len() >= direct_io::WORTH) else {
        return write_file(&path, &[tile.get()]);
    };
    *tile = writers.put(Job {
        path,
        start: 0,
        body: std::mem::take(tile),
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A work directory with new tiles, one in each of some layers.
    fn work(layers: &[u32]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for &layer in layers {
            make_layer_dir(dir.path(), layer).unwrap();
            fs::write(dir.path().join(replacement_path([1, 2, layer])), "new").unwrap();
        }
        dir
    }

    #[test]
    fn new_tiles_take_the_places_of_old_ones_and_of_none() {
        let dir = work(&[0, 2]);
        let tiles = [0, 2].map(|layer| dir.path().join(tile_path([1, 2, layer])));
        for tile in &tiles {
            fs::create_dir_all(tile.parent().unwrap()).unwrap();
        }
        fs::write(&tiles[0], "old").unwrap();
        let mut mover = Mover::begin(dir.path()).unwrap();
        // layer 1 has no new tiles
        (0..3).try_for_each(|layer| mover.put(layer)).unwrap();
        mover.end().unwrap();
        for (tile, layer) in tiles.iter().zip([0, 2]) {
            assert_eq!(fs::read_to_string(tile).unwrap(), "new");
            assert!(!layer_dir(dir.path(), layer).exists());
        }
    }

    #[test]
    fn what_cannot_be_moved_is_told_of_and_waits() {
        let dir = work(&[0, 1]);
        let mut mover = Mover::begin(dir.path()).unwrap();
        // there is no directory for the layer's tiles
        let told = mover.put(0).and_then(|()| mover.end());
        match told {
            Err(Error::Io { path, .. }) => {
                assert_eq!(path, dir.path().join(tile_path([1, 2, 0])));
            }
            other => panic!("{other:?}"),
        }
        assert!(dir.path().join(replacement_path([1, 2, 0])).exists());
        let mut mover = Mover::begin(dir.path()).unwrap();
        let failed = loop {
            if let Err(e) = mover.put(1) {
                break e;
            }
        };
        assert!(matches!(failed, Error::Io { .. }));
    }
}
