//! Places in which no tile set is made, whatever lies there.

use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::store::is_remote;
use std::path::Path;

/// Refuses to make a tile set of another one in the directory of that.
///
/// # Errors
/// [`Error::Usage`].
pub fn refuse_same(from: &Path, to: &Path) -> Result<()> {
    match (from.canonicalize(), to.canonicalize()) {
        (Ok(a), Ok(b)) if a == b => Err(Error::usage(
            "DEST",
            to.display().to_string(),
            "another directory than OUT",
        )),
        _ => Ok(()),
    }
}

/// Refuses a place in a bucket where only this machine is written to.
///
/// # Errors
/// [`Error::Unsupported`].
pub fn refuse_bucket(out: &Path) -> Result<()> {
    match is_remote(out) {
        false => Ok(()),
        true => Err(Error::unsupported(
            out,
            "writing this to a bucket",
            "of what writes tile sets `alvis convert` alone puts them there: write to this machine, and copy the directory",
        )),
    }
}

/// Refuses a directory inside of a tile set, where all other files are foreign.
pub fn refuse_inside(out: &Path) -> Result<()> {
    // of what cannot be told where it lies, the directories that it names
    let whole = std::path::absolute(out).unwrap_or_else(|_| out.to_path_buf());
    let above = whole.ancestors().skip(1);
    match above.take(3).find(|dir| is_tile_set(dir)) {
        Some(set) => Err(Error::usage(
            "OUT",
            format!(
                "{}, which lies in the tile set {}",
                out.display(),
                set.display()
            ),
            "a directory beside it",
        )),
        None => Ok(()),
    }
}

/// True if a directory has the index of a tile set and its tiles.
fn is_tile_set(dir: &Path) -> bool {
    dir.join(MANIFEST).is_file() && dir.join("tiles").is_dir()
}
