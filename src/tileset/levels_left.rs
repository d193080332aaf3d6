//! What work on levels of detail leaves in the directory of a tile set when it is interrupted.

use crate::error::Result;
use crate::manifest::{MANIFEST, Manifest, PARTIAL, TILESET};
use crate::sys::files::remove_if_there;
use std::path::Path;

/// Directory of all levels, in the tile set and while they are made.
pub(crate) const LOD: &str = "lod";
/// The file in the work directory that says what levels are being made.
pub(crate) const LEVELS_STATE: &str = "lod.json";
/// The file in it that says that all is made and is being moved in.
pub(crate) const LEVELS_MOVING: &str = "lod-moving";

/// How far levels had got that were interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LevelsLeft {
    /// They were being made.
    Begun,
    /// All of them are made, and not all are in place.
    MovingIn,
}

/// What is left to be done of levels of the tile set in `out` that were interrupted; `None` if nothing is.
pub fn levels_left(out: &Path) -> Option<LevelsLeft> {
    let has = |name: &str| out.join(PARTIAL).join(name).is_file();
    match has(LEVELS_MOVING) {
        // the index is the last to be moved
        true => has(MANIFEST).then_some(LevelsLeft::MovingIn),
        false => has(LEVELS_STATE).then_some(LevelsLeft::Begun),
    }
}

/// Gives up levels that were being moved into `out`, before anything of them is removed in `work`: else the rest of them
/// could come into place later. What the index of the set does not name goes with them.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io).
pub(super) fn give_up_moving(out: &Path, work: &Path) -> Result<()> {
    let marker = work.join(LEVELS_MOVING);
    if !marker.exists() {
        return Ok(());
    }
    if Manifest::open(out).is_ok_and(|set| set.lod.is_none()) {
        // without it nothing more is moved in
        remove_if_there(&work.join(MANIFEST))?;
        remove_if_there(&out.join(TILESET))?;
        remove_if_there(&out.join(LOD))?;
    }
    // what is left of them is none that were begun
    remove_if_there(&work.join(LEVELS_STATE))?;
    remove_if_there(&marker)
}
