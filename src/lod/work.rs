//! The directory in which levels are made, inside that of the tile set, and how they get their names: the index last,
//! so that it never names what is not there.

use crate::checkpoint::kept;
use crate::error::{Error, Result};
use crate::manifest::checksum_text;
use crate::manifest::{LEVELS, LevelsEntry, MANIFEST, Manifest, PARTIAL, TILESET, sums_of};
use crate::sys::files::{make_directory, remove_if_there, write_file};
use crate::tileset::{LEVELS_STATE as STATE, Lock, refuse_bucket};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Directory of all levels, in the tile set and while they are made.
const LOD: &str = "lod";
/// Says that all is made and is being moved in.
const MOVING: &str = "lod-moving";
/// The index without levels, while those that it named are replaced.
const PLAIN: &str = "index-plain.json";

/// What levels are made of, and how; those that were interrupted go on if it is the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Checksum of the tile set's index.
    pub index: Option<String>,
    pub version: String,
    pub ratio: f64,
    pub levels: Option<u32>,
    pub pixel_error: f64,
}

/// The work directory; dropped before [`Work::publish`], it goes unless it is to be kept.
#[derive(Debug)]
pub struct Work {
    out: PathBuf,
    dir: PathBuf,
    keep: bool,
    lock: Option<Lock>,
}

/// True if the directory of a tile set has levels that were interrupted while they were made.
pub fn interrupted(out: &Path) -> bool {
    out.join(PARTIAL).join(STATE).is_file()
}

impl Work {
    /// Makes the work directory, or takes the one that is there with all that is in it. What was being moved in when
    /// it was interrupted is moved in first.
    ///
    /// # Errors
    /// [`Error::OutputBusy`] if somebody else writes there; [`Error::Usage`] if a conversion was interrupted there;
    /// [`Error::Io`].
    pub fn open(out: &Path) -> Result<Self> {
        refuse_bucket(out)?;
        let dir = out.join(PARTIAL);
        make_directory(&dir)?;
        let lock = Lock::take(&dir.join("lock"), out)?;
        let work = Work {
            out: out.to_path_buf(),
            keep: interrupted(out) || kept(&dir).is_some(),
            dir,
            lock: Some(lock),
        };
        if kept(&work.dir).is_some() {
            return Err(Error::usage(
                "OUT",
                "an interrupted conversion",
                "a tile set that is finished: `alvis convert` with --resume goes on with it",
            ));
        }
        if work.dir.join(MOVING).exists() {
            work.move_in()?;
            work.clear()?;
        }
        Ok(work)
    }

    /// Where to write.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Says whether the directory stays if this is dropped now.
    pub fn keep(&mut self, keep: bool) {
        self.keep = keep;
    }

    /// True if what is there was begun for the same.
    pub fn is_of(&self, identity: &Identity) -> bool {
        let bytes = fs::read(self.dir.join(STATE)).ok();
        bytes
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .as_ref()
            == Some(identity)
    }

    /// Begins anew.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(&self, identity: &Identity) -> Result<()> {
        self.clear()?;
        let lod = self.dir.join(LOD);
        fs::create_dir(&lod).map_err(|e| Error::io(&lod, "create the directory", e))?;
        let json = serde_json::to_vec(identity).expect("plain data serialises");
        write_file(&self.dir.join(STATE), &[&json])
    }

    /// Gives all that is made its name; `manifest` is that of the tile set, whose levels are so many then.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn publish(mut self, mut manifest: Manifest, levels: u32) -> Result<()> {
        let path = self.dir.join(LEVELS);
        let failed = |e| Error::io(&path, "read back", e);
        let (bytes, crc) = File::open(&path)
            .and_then(|f| sums_of(&f))
            .map_err(failed)?;
        manifest.lod = None;
        self.write_manifest(PLAIN, manifest.clone())?;
        manifest.lod = Some(LevelsEntry {
            path: LEVELS.to_owned(),
            levels,
            bytes,
            checksum: checksum_text(crc),
        });
        self.write_manifest(MANIFEST, manifest)?;
        write_file(&self.dir.join(MOVING), &[])?;
        self.keep = true;
        self.move_in()?;
        self.keep = false;
        Ok(())
    }

    fn write_manifest(&self, name: &str, manifest: Manifest) -> Result<()> {
        let path = self.dir.join(name);
        let failed = |e| Error::io(&path, "write", e);
        let file = File::create(&path).map_err(|e| Error::io(&path, "create", e))?;
        let mut out = BufWriter::new(file);
        let layers = manifest.layers.clone();
        manifest.seal(
            &self.out,
            &mut |each| layers.iter().try_for_each(&mut *each),
            &mut out,
        )?;
        out.flush().map_err(failed)
    }

    /// Moves in what is not moved in yet.
    fn move_in(&self) -> Result<()> {
        if !self.dir.join(MANIFEST).exists() {
            return Ok(());
        }
        let rename = |from: &str, to: &str| {
            let to = self.out.join(to);
            match fs::rename(self.dir.join(from), &to) {
                Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
                moved => moved.map_err(|e| Error::io(&to, "move into place", e)),
            }
        };
        rename(PLAIN, MANIFEST)?;
        for name in [TILESET, LOD] {
            if self.dir.join(name).exists() {
                remove_if_there(&self.out.join(name))?;
                rename(name, name)?;
            }
        }
        rename(MANIFEST, MANIFEST)
    }

    /// Removes all but the lock.
    fn clear(&self) -> Result<()> {
        // first of all, so that what is half removed is not taken for something to go on from
        for name in [STATE, MOVING, LOD, TILESET, MANIFEST, PLAIN] {
            remove_if_there(&self.dir.join(name))?;
        }
        Ok(())
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        if self.keep {
            return;
        }
        // nothing more can be done about a failure here
        let _ = self.clear();
        let _ = remove_if_there(&self.dir.join("lock"));
        self.lock = None;
        let _ = fs::remove_dir(&self.dir);
    }
}
