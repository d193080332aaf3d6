//! The directory in which levels are made, inside that of the tile set, and how they get their names: the index last,
//! so that it never names what is not there.

use crate::error::{Error, Result};
use crate::manifest::checksum_text;
use crate::manifest::{LEVELS, LevelsEntry, MANIFEST, Manifest, PARTIAL, TILESET, sums_of};
use crate::sys::files::{remove_if_there, write_file};
use crate::tileset::{
    self, LEVELS_MOVING as MOVING, LEVELS_STATE as STATE, LOD, Lock, levels_left, take_lock, tidy,
};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// The state while it is written.
const STATE_NEW: &str = "lod.new";
/// The index without levels, while those that it named are replaced.
const PLAIN: &str = "index-plain.json";

/// What levels are made of, and how; see [`Identity::has_nodes_of`] for which of them go on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Checksum of the tile set's index.
    pub index: Option<String>,
    pub version: String,
    pub ratio: f64,
    pub levels: Option<u32>,
    pub pixel_error: f64,
}

impl Identity {
    /// True if the nodes of both are the same: how many levels there are and what viewers are told of errors
    /// changes none.
    pub fn has_nodes_of(&self, other: &Identity) -> bool {
        (&self.index, &self.version, self.ratio) == (&other.index, &other.version, other.ratio)
    }
}

/// The work directory; dropped before [`Work::publish`], it goes unless it is to be kept.
#[derive(Debug)]
pub struct Work {
    out: PathBuf,
    dir: PathBuf,
    keep: bool,
    /// True if all levels had been made, and are in place since this was opened.
    moved_in: bool,
    lock: Option<Lock>,
}

/// True if the directory of a tile set has levels that were interrupted while they were made or moved into place.
pub fn interrupted(out: &Path) -> bool {
    levels_left(out).is_some()
}

/// True if levels are all made, and were interrupted while they were moved into the directory of a tile set.
pub(crate) fn moving_in(out: &Path) -> bool {
    out.join(PARTIAL).join(MOVING).is_file()
}

impl Work {
    /// Makes the work directory, or takes the one that is there if there is something in it to go on with. What was being
    /// moved in when it was interrupted is moved in first.
    ///
    /// # Errors
    /// [`Error::OutputBusy`] if somebody else writes there; [`Error::Usage`] if a conversion was interrupted there;
    /// [`Error::Io`].
    pub fn open(out: &Path) -> Result<Self> {
        tidy(out)?;
        let dir = out.join(PARTIAL);
        let lock = take_lock(&dir, out)?;
        let mut work = Work {
            out: out.to_path_buf(),
            keep: interrupted(out) || tileset::interrupted(out).is_some(),
            dir,
            moved_in: false,
            lock: Some(lock),
        };
        if tileset::interrupted(out).is_some() {
            return Err(Error::usage(
                out.display().to_string(),
                "an interrupted conversion",
                format!(
                    "a tile set that is finished: the `alvis convert` that was interrupted, typed again with --resume, goes \
                     on with it; removing {} drops it",
                    work.dir.display()
                ),
            ));
        }
        if work.dir.join(MOVING).exists() {
            work.move_in()?;
            work.clear()?;
            work.keep = false;
            work.moved_in = true;
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

    /// True if all levels had been made, and are in place since this was opened.
    pub fn moved_in(&self) -> bool {
        self.moved_in
    }

    /// What was begun here and interrupted, if that can be told.
    pub fn begun(&self) -> Option<Identity> {
        let bytes = fs::read(self.dir.join(STATE)).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Goes on with what is here, whose nodes are those of `identity`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn go_on(&self, identity: &Identity) -> Result<()> {
        self.write_state(identity)
    }

    /// Removes what was made above so many levels, the tiles counted, and the tree over them: what is gone on with
    /// may have been begun for more.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn keep_levels(&self, count: u32) -> Result<()> {
        let lod = self.dir.join(LOD);
        remove_if_there(&lod.join("tilesets"))?;
        let above = (count..).map(|level| lod.join(level.to_string()));
        above
            .take_while(|dir| dir.exists())
            .try_for_each(|dir| remove_if_there(&dir))
    }

    /// Begins anew.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn begin(&self, identity: &Identity) -> Result<()> {
        self.clear()?;
        let lod = self.dir.join(LOD);
        fs::create_dir(&lod).map_err(|e| Error::io(&lod, "create the directory", e))?;
        self.write_state(identity)
    }

    fn write_state(&self, identity: &Identity) -> Result<()> {
        let path = self.dir.join(STATE);
        let json = serde_json::to_vec(identity).expect("plain data serialises");
        let new = self.dir.join(STATE_NEW);
        write_file(&new, &[&json])?;
        fs::rename(&new, &path).map_err(|e| Error::io(&path, "move into place", e))
    }

    /// Gives all that is made its name; `manifest` is that of the tile set, whose levels are so many then.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn publish(&mut self, mut manifest: Manifest, levels: u32) -> Result<()> {
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
        for name in [STATE, STATE_NEW, MOVING, LOD, TILESET, MANIFEST, PLAIN] {
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
