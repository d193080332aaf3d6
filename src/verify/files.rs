//! Files of a tile set: paths that stay inside, sizes, checksums, and files that do not belong.

use super::code::Code;
use super::report::Issues;
use crate::manifest::{TileEntry, checksum_text, is_plain};
use crate::store::{self, File, is_remote};
use crate::sys::direct_io::Buffer;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A file that the index names.
pub(super) struct Expected<'a> {
    /// As the index has it, relative to the tile set.
    pub path: &'a str,
    pub bytes: u64,
    pub checksum: &'a str,
    /// Where the index has it, for messages.
    pub at: &'a str,
}

/// Joins a relative path with `/` between its parts to `root`, which has its links resolved.
///
/// Reports [`Code::PathOutside`] for a path that leads, or could lead on another system, outside,
/// and [`Code::MissingFile`] for one that does not exist; then there is nothing to read.
pub(super) fn resolve(root: &Path, path: &str, at: &str, issues: &mut Issues) -> Option<PathBuf> {
    if !is_plain(path) {
        let message = format!("found {path:?}, expected a relative path without .. or empty parts");
        issues.add(Code::PathOutside, at, message);
        return None;
    }
    let joined = root.join(path);
    if is_remote(root) {
        return Some(joined);
    }
    match joined.canonicalize() {
        Ok(real) if real.starts_with(root) => Some(real),
        Ok(real) => {
            let message = format!(
                "{path} is a link to {}, outside the tile set",
                real.display()
            );
            issues.add(Code::PathOutside, at, message);
            None
        }
        Err(e) => {
            issues.add(Code::MissingFile, path, format!("named by {at}: {e}"));
            None
        }
    }
}

impl<'a> Expected<'a> {
    /// The file of a tile, whose entry is at `at`.
    pub fn tile(entry: &'a TileEntry, at: &'a str) -> Self {
        Expected {
            path: &entry.path,
            bytes: entry.bytes,
            checksum: &entry.checksum,
            at,
        }
    }
}

/// Reads a file into `out`, whatever its size. False, and an issue, if it cannot be read.
pub(super) fn fetch(root: &Path, file: &Expected, out: &mut Buffer, issues: &mut Issues) -> bool {
    let Some(real) = resolve(root, file.path, file.at, issues) else {
        return false;
    };
    if let Err(e) = fill(&real, out) {
        issues.add(Code::MissingFile, file.path, format!("cannot be read: {e}"));
        return false;
    }
    true
}

/// Compares size and checksum of what was read. A file of the wrong ones is looked at all the same, so
/// that what is wrong with it can be named.
pub(super) fn compare(file: &Expected, bytes: &[u8], issues: &mut Issues) {
    compare_sums(file, bytes.len() as u64, || crc32fast::hash(bytes), issues);
}

/// The same for a file of so many bytes with this checksum, which is asked for if the size is right.
pub(super) fn compare_sums(
    file: &Expected,
    bytes: u64,
    crc: impl FnOnce() -> u32,
    issues: &mut Issues,
) {
    if bytes != file.bytes {
        let message = format!(
            "found {bytes} bytes, expected {} as in {}",
            file.bytes, file.at
        );
        issues.add(Code::FileSize, file.path, message);
        return;
    }
    let found = checksum_text(crc());
    if found != file.checksum {
        let message = format!(
            "found {found}, expected {} as in {}",
            file.checksum, file.at
        );
        issues.add(Code::Checksum, file.path, message);
    }
}

/// Opens a regular file; opening a pipe would wait.
pub(super) fn open(path: &Path) -> std::io::Result<File> {
    if !is_remote(path) && !store::metadata(path)?.is_file {
        return Err(std::io::Error::other("it is no regular file"));
    }
    File::open(path)
}

fn fill(path: &Path, out: &mut Buffer) -> std::io::Result<()> {
    let file = open(path)?;
    let len = file.len()?;
    // a GLB's length has 32 bits; anything longer is not ours
    if len > u64::from(u32::MAX) {
        return Err(std::io::Error::other("it is larger than 4 GiB"));
    }
    let read = match file.local() {
        Some(file) => out.read(file, len as usize),
        None => {
            out.begin(len as usize, len as usize);
            file.read_exact_at(out.get_mut(), 0)
        }
    };
    read.map_err(|e| match e.kind() {
        ErrorKind::OutOfMemory => std::io::Error::other("it does not fit into memory"),
        _ => e,
    })
}
