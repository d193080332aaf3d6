//! Files written whole, and removed.

use crate::error::{Error, Result};
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Writes a new file from byte `start` on.
///
/// # Errors
/// [`Error::Io`].
pub fn write_body(path: &Path, start: usize, body: &[u8]) -> Result<()> {
    let file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    file.write_all_at(body, start as u64)
        .map_err(|e| Error::io(path, "write", e))
}

/// Writes a new file from parts.
///
/// # Errors
/// [`Error::Io`].
pub fn write_file(path: &Path, parts: &[&[u8]]) -> Result<()> {
    let mut file = File::create(path).map_err(|e| Error::io(path, "create", e))?;
    for part in parts {
        file.write_all(part)
            .map_err(|e| Error::io(path, "write", e))?;
    }
    Ok(())
}

/// Makes a directory, unless it is there.
///
/// # Errors
/// [`Error::Io`].
pub fn make_directory(path: &Path) -> Result<()> {
    match fs::create_dir(path) {
        Err(e) if e.kind() == ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        made => made.map_err(|e| Error::io(path, "create the directory", e)),
    }
}

/// Removes a file, or a directory with all that is in it.
///
/// # Errors
/// [`Error::Io`].
pub fn remove_if_there(path: &Path) -> Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(meta) if meta.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(e) => Err(e),
    };
    removed.map_err(|e| Error::io(path, "remove", e))
}
