//! What is kept of a conversion while it runs, so that one that was interrupted can go on.
//!
//! After each layer the state between two layers is written to `checkpoint`, with the lengths and
//! checksums of the temporary files. It gets that name once the layer's tiles are written, too, which
//! may be while the next one is swept. That needs no sync: what a process has written stays with the
//! system when it is killed. Such a checkpoint names the boot of the system and counts only until the
//! next one. Once a conversion has run for some seconds, a thread behind it syncs the file system
//! and then publishes a copy of the checkpoint from before the sync as `checkpoint.safe`, which counts
//! also after a power failure. The files `finished` and `finished.safe` are the same for the layers
//! whose tiles have got their ids.
//!
//! A conversion sweeps twice, to label and to mesh, and twice more before with `min_voxels`; each sweep has its files
//! and its layers.

mod identity;
mod marks;
mod swap;
mod sync;

pub use identity::Identity;
pub use marks::{Marks, Scratch};

use crate::checkpoint::sync::{Disk, SAFE};
use crate::error::{Error, Result};
use crate::sys::state_codec::{Decoder, Encoder};
use std::path::{Path, PathBuf};

/// Files of a work directory.
const CONVERSION: &str = "conversion.json";
const CHECKPOINT: &str = "checkpoint";
const FINISHED: &str = "finished";
/// Files without which nothing in a work directory is relied on.
pub const STATE: [&str; 3] = [CONVERSION, CHECKPOINT, "checkpoint.safe"];
/// Directory of the sweeps' files.
pub const SPOOLS: &str = "spools";
/// Names of the sweeps, in their order.
const SWEEPS: [&str; 4] = ["small-objects", "small-cells", "labels", "tiles"];
/// The sweep that finds all components.
pub const LABELS: usize = 2;
/// The sweep that writes tiles.
pub const TILES: usize = 3;

/// Layers that an interrupted conversion has finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayersDone {
    /// Layers that are done. A conversion sweeps twice, or four times with `min_voxels`, and counts the layers of each
    /// sweep.
    pub done: u64,
    /// All layers.
    pub of: u64,
}

/// A place between two layers.
#[derive(Debug)]
struct Checkpoint {
    kept: LayersDone,
    sweep: usize,
    /// Layers of this sweep that are done.
    layer: u32,
    marks: Marks,
    /// The state of the sweep.
    state: Decoder,
    /// It ends in [`SAFE`].
    safe: bool,
}

/// Where a sweep goes on.
pub struct Place {
    /// The first layer to do.
    pub layer: u32,
    /// How much of the files counts.
    pub marks: Marks,
    /// The state before that layer.
    pub state: Decoder,
}

/// Keeps the state of one conversion.
#[derive(Debug)]
pub struct Checkpointer {
    work: PathBuf,
    crc: u32,
    boot: Vec<u8>,
    /// Sweeps of this conversion, and layers of each.
    sweeps: u64,
    layers: u32,
    at: Option<Checkpoint>,
    /// Files of the sweeps that are over.
    over: Marks,
    /// What was done before this process began: layers of all sweeps; layers of tiles that were
    /// swept; layers of tiles that had got their ids.
    before: (u64, u32, u32),
    /// True once a checkpoint exists.
    any: bool,
    disk: Disk,
}

impl Checkpointer {
    /// Begins anew in a work directory that holds nothing of another conversion.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(work: &Path, identity: &Identity, dust: bool, layers: u32) -> Result<Self> {
        let path = work.join(CONVERSION);
        std::fs::write(&path, identity.to_bytes()).map_err(|e| Error::io(&path, "write", e))?;
        let spools = work.join(SPOOLS);
        std::fs::create_dir(&spools).map_err(|e| Error::io(&spools, "create the directory", e))?;
        Ok(Self::empty(work, identity, dust, layers))
    }

    fn empty(work: &Path, identity: &Identity, dust: bool, layers: u32) -> Self {
        Checkpointer {
            work: work.to_path_buf(),
            crc: identity.crc(),
            boot: boot(),
            sweeps: if dust { 4 } else { 2 },
            layers,
            at: None,
            over: Marks::default(),
            before: (0, 0, 0),
            any: false,
            disk: Disk::new(work, &[CHECKPOINT, FINISHED]),
        }
    }

    /// What in a work directory's conversion differs from this one; `None` if there is none.
    pub fn differences(work: &Path, identity: &Identity) -> Option<Vec<String>> {
        let bytes = std::fs::read(work.join(CONVERSION)).ok()?;
        Identity::from_bytes(&bytes).map(|before| identity.differences(&before))
    }

    /// Goes on in a work directory; `None` if nothing in it can be relied on.
    ///
    /// # Errors
    /// [`Error::OtherConversion`] if what is there was made from another input or with other options;
    /// [`Error::Io`].
    pub fn resume(
        work: &Path,
        out: &Path,
        identity: &Identity,
        dust: bool,
        layers: u32,
    ) -> Result<Option<Self>> {
        if kept(work).is_none() {
            return Ok(None);
        }
        match Self::differences(work, identity) {
            Some(d) if d.is_empty() => {}
            differences => {
                return Err(Error::OtherConversion {
                    path: out.to_path_buf(),
                    differences: differences.unwrap_or_default().join("; "),
                });
            }
        }
        let mut checkpointer = Self::empty(work, identity, dust, layers);
        let checkpoint = load(work, checkpointer.crc, &checkpointer.boot);
        let Some(checkpoint) = checkpoint.filter(|c| c.layer <= layers) else {
            return Ok(None);
        };
        checkpointer.before.0 = checkpoint.kept.done;
        if checkpoint.sweep == TILES {
            checkpointer.before.1 = checkpoint.layer;
        }
        if checkpointer.before.1 == layers {
            checkpointer.before.2 = checkpointer.load_finished(checkpoint.safe).unwrap_or(0);
        }
        if checkpoint.safe {
            for name in [CHECKPOINT, FINISHED] {
                crate::sys::files::remove_if_there(&work.join(name))?;
            }
        }
        checkpointer.any = true;
        checkpointer.at = Some(checkpoint);
        Ok(Some(checkpointer))
    }

    /// Layers, of all sweeps, that were done before this process began.
    pub fn kept(&self) -> u64 {
        self.before.0
    }

    /// Layers of tiles that had been swept before this process began.
    pub fn swept(&self) -> u32 {
        self.before.1
    }

    /// Layers of tiles that had got their ids before this process began.
    pub fn finished(&self) -> u32 {
        self.before.2
    }

    /// True once there is something to go on from.
    pub fn has_any(&self) -> bool {
        self.any
    }

    /// The files of a sweep.
    pub fn files(&self, sweep: usize) -> Scratch {
        Scratch::of_sweep(&self.work, sweep)
    }

    /// Marks of a sweep that writes no tiles, if all its layers were done before.
    pub fn over(&self, sweep: usize) -> Option<Marks> {
        let at = self.at.as_ref()?;
        let over = sweep < at.sweep || sweep == at.sweep && at.layer == self.layers;
        over.then(|| at.marks.of(&self.files(sweep)))
    }

    /// Where a sweep goes on, if it had begun. Can be asked once.
    pub fn take(&mut self, sweep: usize) -> Option<Place> {
        let at = self.at.take_if(|at| at.sweep == sweep)?;
        Some(Place {
            layer: at.layer,
            marks: at.marks,
            state: at.state,
        })
    }

    /// The error for a checkpoint that is not what it should be, although its checksum is right.
    pub fn damaged(&self) -> Error {
        Error::format(
            self.work.join(CHECKPOINT),
            "a state that cannot be",
            "what a conversion leaves",
        )
        .with_hint("give --force instead of --resume to begin anew")
    }

    /// Says that a sweep is over whose files are marked here.
    pub fn end_sweep(&mut self, marks: &Marks) {
        self.over.extend(marks);
    }

    /// Keeps what is left of a sweep that writes no tiles, and removes its other files.
    ///
    /// # Errors
    /// [`Error::Io`], also if a sync failed.
    pub fn close_sweep(&mut self, sweep: usize, marks: &Marks) -> Result<()> {
        self.save(sweep, self.layers, marks, |_| Ok(()))?;
        // a checkpoint on the disk may need them until there is the next one
        self.disk.finish()?;
        marks.remove_others(&self.files(sweep))
    }

    /// Keeps the state after `layer` layers of a sweep. `marks` are of the sweep's files, and `state`
    /// writes the rest.
    ///
    /// # Errors
    /// [`Error::Io`], also if an earlier sync failed.
    pub fn save(
        &mut self,
        sweep: usize,
        layer: u32,
        marks: &Marks,
        state: impl FnOnce(&mut Encoder) -> Result<()>,
    ) -> Result<()> {
        self.stage(sweep, layer, marks, state)?;
        self.commit()
    }

    /// As [`Checkpointer::save`], but what is written counts only from [`Checkpointer::commit`] on: what it relies on may be
    /// on its way until then, while the sweep goes on. It takes the place of one that was not kept.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn stage(
        &mut self,
        sweep: usize,
        layer: u32,
        marks: &Marks,
        state: impl FnOnce(&mut Encoder) -> Result<()>,
    ) -> Result<()> {
        let sweeps_before = self.sweeps - (SWEEPS.len() - sweep) as u64;
        let of = self.sweeps * u64::from(self.layers);
        let done = sweeps_before * u64::from(self.layers) + u64::from(layer);
        let mut all = self.over.clone();
        all.extend(marks);
        self.write(CHECKPOINT, |out| {
            for number in [done, of, sweep as u64, u64::from(layer)] {
                out.number(number)?;
            }
            all.save(out)?;
            state(out)
        })
    }

    /// Keeps what is ready.
    ///
    /// # Errors
    /// [`Error::Io`], also if an earlier sync failed.
    pub fn commit(&mut self) -> Result<()> {
        self.give_name(CHECKPOINT)?;
        self.any = true;
        self.disk.begin().map(|_| ())
    }

    /// Keeps that the tiles of `layers` layers have their ids.
    ///
    /// # Errors
    /// [`Error::Io`], also if an earlier sync failed.
    pub fn save_finished(&mut self, layers: u32) -> Result<()> {
        self.write(FINISHED, |out| out.number(u64::from(layers)))?;
        self.give_name(FINISHED)
    }

    /// The disk under the work directory.
    pub fn disk(&mut self) -> &mut Disk {
        &mut self.disk
    }

    fn load_finished(&self, safe: bool) -> Option<u32> {
        let name = format!("{FINISHED}{}", if safe { SAFE } else { "" });
        let mut input = open(&self.work.join(name), self.crc, &self.boot, safe)?;
        input.index().filter(|_| input.is_empty())
    }

    /// Writes a file of this conversion and boot under a temporary name.
    fn write(&self, name: &str, body: impl FnOnce(&mut Encoder) -> Result<()>) -> Result<()> {
        let mut out = Encoder::create(&self.work.join(new_name(name)))?;
        out.number(u64::from(self.crc))?;
        out.array(&self.boot)?;
        body(&mut out)?;
        out.finish()
    }

    /// Gives such a file its name. The one before may stay under the temporary name, to be written over.
    fn give_name(&self, name: &str) -> Result<()> {
        let (path, new) = (self.work.join(name), self.work.join(new_name(name)));
        // what counts after a power failure is a copy that a sync covers
        swap::replace(&new, &path)
            .map(|_| ())
            .map_err(|e| Error::io(&path, "move into place", e))
    }
}

/// The name of a file until it is whole, and all that it relies on.
fn new_name(name: &str) -> String {
    format!("{name}.new")
}

/// What a work directory keeps; `None` if nothing.
pub fn kept(work: &Path) -> Option<LayersDone> {
    let before = Identity::from_bytes(&std::fs::read(work.join(CONVERSION)).ok()?)?;
    load(work, before.crc(), &boot()).map(|c| c.kept)
}

/// The newest checkpoint that can be relied on.
fn load(work: &Path, crc: u32, boot: &[u8]) -> Option<Checkpoint> {
    [false, true].into_iter().find_map(|safe| {
        let name = format!("{CHECKPOINT}{}", if safe { SAFE } else { "" });
        let mut input = open(&work.join(name), crc, boot, safe)?;
        let kept = LayersDone {
            done: input.number()?,
            of: input.number()?,
        };
        let (sweep, layer) = (input.index()?, input.index()?);
        let marks = Marks::load(&mut input)?;
        let sound = sweep < SWEEPS.len() && marks.hold(&work.join(SPOOLS));
        sound.then_some(Checkpoint {
            kept,
            sweep,
            layer,
            marks,
            state: input,
            safe,
        })
    })
}

/// Opens a file that was written by [`Checkpointer::write`] in the same conversion, and in the same boot
/// unless it is safe.
fn open(path: &Path, crc: u32, boot: &[u8], safe: bool) -> Option<Decoder> {
    let mut input = Decoder::new(std::fs::read(path).ok()?)?;
    let same = input.number()? == u64::from(crc);
    let same_boot = input.array::<u8>()? == boot;
    (same && (safe || same_boot)).then_some(input)
}

/// What tells one run of the system from the next; empty if it does not say.
pub fn boot() -> Vec<u8> {
    std::fs::read("/proc/sys/kernel/random/boot_id").unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ready_counts_when_it_is_kept() {
        let identity = Identity::new(vec![("version".into(), "1".into())]);
        let dir = tempfile::tempdir().unwrap();
        let done = || kept(dir.path()).map(|k| k.done);
        let mut checkpointer = Checkpointer::new(dir.path(), &identity, false, 9).unwrap();
        let ready = |checkpointer: &mut Checkpointer, layer| {
            let state = |out: &mut Encoder| out.number(5);
            checkpointer.stage(TILES, layer, &Marks::default(), state)
        };
        ready(&mut checkpointer, 1).unwrap();
        // nine layers are labelled before
        assert_eq!((done(), checkpointer.has_any()), (None, false));
        checkpointer.commit().unwrap();
        assert_eq!((done(), checkpointer.has_any()), (Some(10), true));
        // one that was never kept is as if it had not been
        ready(&mut checkpointer, 2).unwrap();
        assert_eq!(done(), Some(10));
        ready(&mut checkpointer, 3).unwrap();
        checkpointer.commit().unwrap();
        assert_eq!(done(), Some(12));
    }
}
