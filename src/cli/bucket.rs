//! A tile set that is to lie in a bucket: made in a directory of this machine, put there when it is whole, and removed here.
//!
//! Tiles get their measures when all is known, and objects cannot be changed, so none could be put while it is made.

use super::output;
use super::progress::Console;
use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::progress::Progress;
use crate::store::{self, is_remote};
use crate::sys::files::remove_if_there;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Where a tile set is made, and where it is to lie.
pub struct Place<'a> {
    out: &'a Path,
    /// The directory in which it is made, if that is another.
    scratch: Option<PathBuf>,
}

impl<'a> Place<'a> {
    /// Of the output that was typed. A bucket is asked whether it can take the tile set before anything is made.
    ///
    /// # Errors
    /// Those of [`store::refuse_used`]; [`Error::Io`] if there is no room for temporary files.
    pub fn of(out: &'a Path, resume: bool) -> Result<Self> {
        if !is_remote(out) {
            return Ok(Place { out, scratch: None });
        }
        store::refuse_used(out, MANIFEST, resume)?;
        let scratch = scratch(out)?;
        Ok(Place {
            out,
            scratch: Some(scratch),
        })
    }

    /// The directory in which it is made.
    pub fn dir(&self) -> PathBuf {
        match &self.scratch {
            Some(scratch) => scratch.join("set"),
            None => self.out.to_path_buf(),
        }
    }

    /// Puts what was made into the bucket, and removes it here.
    ///
    /// # Errors
    /// Those of [`store::upload`]; what was made stays then.
    pub fn put(&self, console: &Console) -> Result<()> {
        let Some(scratch) = &self.scratch else {
            return Ok(());
        };
        console.begin("putting into the bucket", 0);
        let done = |_| {
            console.advance(1);
            !console.interrupted()
        };
        let put = store::upload(&self.dir(), self.out, MANIFEST, &done).inspect_err(|_| {
            console.warn(&format!(
                "the tile set is whole in {}: the same command with --resume goes on putting it into the bucket",
                self.dir().display()
            ));
        })?;
        let there = match put.there {
            0 => String::new(),
            n => format!(", {} of which were there", output::count(n)),
        };
        console.note(&format!(
            "{} in {}{there} are in {}",
            output::things(put.files, "object"),
            output::bytes(put.bytes),
            self.out.display()
        ));
        remove_if_there(scratch)
    }
}

/// The directory for what is to lie at a path: the same each time, so that work that was interrupted is found again, and
/// nobody else's.
fn scratch(out: &Path) -> Result<PathBuf> {
    let name = out.as_os_str().as_encoded_bytes();
    let user = rustix::process::geteuid().as_raw();
    let name = format!("alvis-{user}-{:08x}-{}", crc32fast::hash(name), name.len());
    let dir = std::env::temp_dir().join(name);
    let made = std::fs::DirBuilder::new().mode(0o700).create(&dir);
    match made {
        Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(Error::io(&dir, "create the directory", e));
        }
        _ => {}
    }
    let meta = std::fs::symlink_metadata(&dir).map_err(|e| Error::io(&dir, "use", e))?;
    match meta.is_dir() && meta.uid() == user {
        true => Ok(dir),
        false => Err(
            Error::format(dir, "somebody else's", "a directory of this user")
                .with_hint("set TMPDIR to another directory"),
        ),
    }
}
