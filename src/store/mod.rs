//! Where files lie: on this machine, or in a bucket of S3-compatible storage, as `s3://bucket/key`.
//!
//! Whoever reads volumes or tile sets asks here as the standard library is asked for files, with paths of either kind.
//! `bucket` alone knows the client of such storage; what waits for it waits as for a disk.

#[cfg(feature = "s3")]
mod bucket;
mod file;
#[cfg(feature = "s3")]
mod object;
#[cfg(not(feature = "s3"))]
mod off;
mod place;
#[cfg(feature = "s3")]
mod profile;
#[cfg(feature = "s3")]
mod said;
#[cfg(feature = "s3")]
mod settings;
mod upload;

pub(crate) use file::File;
pub(crate) use place::is_remote;
pub(crate) use upload::{refuse_used, upload};

#[cfg(feature = "s3")]
use object as remote;
#[cfg(not(feature = "s3"))]
use off as remote;

use std::ffi::OsString;
use std::io::{ErrorKind, Result};
use std::path::Path;

/// What is known of a file or folder without opening it. A folder in a bucket is what keys begin with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Meta {
    /// Bytes of a file.
    pub len: u64,
    pub is_file: bool,
    pub is_dir: bool,
}

/// What tells an object from others that had its key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Stamped {
    /// Its path.
    pub path: String,
    pub bytes: u64,
    /// As the store states it, empty if it states none.
    pub etag: String,
}

/// A file or folder in a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Entry {
    pub name: OsString,
    pub is_file: bool,
    pub is_dir: bool,
    pub is_link: bool,
}

/// Looks at a file or folder, links followed.
///
/// # Errors
/// [`ErrorKind::NotFound`]; what the system or the store answers.
pub(crate) fn metadata(path: &Path) -> Result<Meta> {
    if is_remote(path) {
        return remote::metadata(path);
    }
    let meta = std::fs::metadata(path)?;
    Ok(Meta {
        len: meta.len(),
        is_file: meta.is_file(),
        is_dir: meta.is_dir(),
    })
}

/// True for a folder that is there.
#[cfg_attr(not(feature = "zarr"), allow(dead_code))]
pub(crate) fn is_dir(path: &Path) -> bool {
    metadata(path).is_ok_and(|meta| meta.is_dir)
}

/// True for a file that is there.
pub(crate) fn is_file(path: &Path) -> bool {
    match is_remote(path) {
        true => remote::is_object(path),
        false => path.is_file(),
    }
}

/// What is in a folder, in no order.
///
/// # Errors
/// [`ErrorKind::NotFound`]; what the system or the store answers, which may come later, too.
pub(crate) fn list(path: &Path) -> Result<Box<dyn Iterator<Item = Result<Entry>>>> {
    if is_remote(path) {
        return Ok(Box::new(remote::list(path)?.into_iter().map(Ok)));
    }
    let entry = |entry: Result<std::fs::DirEntry>| {
        let entry = entry?;
        let kind = entry.file_type()?;
        Ok(Entry {
            name: entry.file_name(),
            is_file: kind.is_file(),
            is_dir: kind.is_dir(),
            is_link: kind.is_symlink(),
        })
    };
    Ok(Box::new(std::fs::read_dir(path)?.map(entry)))
}

/// The object at a path in a bucket, or all whose keys lie below it, by their keys.
///
/// # Errors
/// [`ErrorKind::NotFound`] if there is none; what the store answers.
pub(crate) fn stamps(path: &Path) -> Result<Vec<Stamped>> {
    remote::stamps(path)
}

/// Copies a file to a place on this machine.
///
/// # Errors
/// What the system or the store answers.
pub(crate) fn copy(from: &Path, to: &Path) -> Result<u64> {
    if !is_remote(from) {
        return std::fs::copy(from, to);
    }
    std::io::copy(&mut File::open(from)?, &mut std::fs::File::create(to)?)
}

/// All bytes of a file.
///
/// # Errors
/// What the system or the store answers.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    if !is_remote(path) {
        return std::fs::read(path);
    }
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    let len = usize::try_from(file.len()?).map_err(|_| ErrorKind::OutOfMemory)?;
    bytes.try_reserve_exact(len)?;
    bytes.resize(len, 0);
    file.read_exact_at(&mut bytes, 0)?;
    Ok(bytes)
}
