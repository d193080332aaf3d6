//! What the tiles of a set tell of its structure in one pass: porosity slice by slice and of boxes, the orientation of
//! the surface, and the mean length of lines in the cells.
//!
//! The volume is not needed: where the surface crosses the rows of the grid, and which side is above, says of every voxel
//! which phase it is. Sums over crossings are whole numbers and do not depend on the order of tiles.

mod air;
mod blocks;
mod boxes;
mod crossings;
mod fabric;
mod members;
mod pass;
mod profile;
mod slice;
#[cfg(test)]
mod tests;

pub use boxes::BoxPorosity;
pub use fabric::{Fabric, MeanIntercept};
pub use profile::{AxisProfile, Profile};
pub use slice::SliceBits;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::table::Outside;
use crate::tileset::TileSet;
use members::Members;
use pass::{Found, Gather};
use serde::Serialize;

/// What is asked of a tile set.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wanted {
    /// Which cells are air around the sample.
    pub outside: Outside,
    /// Porosity by slices and boxes, not the surface's orientation alone.
    pub porosity: bool,
    /// The slice across z of which the voxels are wanted as well, see [`Structure::slice`]; goes with `porosity`.
    pub slice: Option<u32>,
}

/// Whose surface the orientation and the lengths of lines are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum SurfaceOf {
    /// All cells.
    #[serde(rename = "cells")]
    Cells,
    /// All cells but those that count as outside.
    #[serde(rename = "cells without outside")]
    CellsWithoutOutside,
    /// Cells that do not touch the border: what the edge of a region cuts has a surface along that edge.
    #[serde(rename = "whole cells")]
    WholeCells,
}

/// What the tiles tell.
#[derive(Debug, Clone, Serialize)]
pub struct Structure {
    /// Whose surface it is.
    pub surface_of: SurfaceOf,
    /// The orientation of the surface; absent if there is none.
    pub fabric: Option<Fabric>,
    /// Mean lengths of lines in these cells; absent with it.
    pub mean_intercept_length: Option<MeanIntercept>,
    /// Porosity by slices; absent if it was not asked for or cannot be told.
    pub profile: Option<Profile>,
    /// Porosity of boxes of growing size, the smallest first; empty without a profile, or if boxes would reach outside of
    /// the sample.
    pub boxes: Vec<BoxPorosity>,
    /// Why something is absent.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// The slice that was asked for.
    #[serde(skip)]
    pub slice: Option<SliceBits>,
}

/// Goes through the tiles of a set once. Memory: a tile for each thread, 32 MiB for boxes, and a bit for each voxel of a
/// slice that is wanted.
///
/// # Errors
/// What reading returns; [`Error::Usage`] if cells that count as outside may be missing in a part of a tile set, or for a
/// tile set of a region; [`Error::Format`] if tiles are not those of the set; [`Error::Interrupted`].
pub fn structure(set: &TileSet, wanted: &Wanted, progress: &dyn Progress) -> Result<Structure> {
    let manifest = set.manifest();
    let members = Members::read(set, wanted.outside)?;
    let refusal = wanted
        .porosity
        .then(|| profile::refusal(manifest))
        .flatten();
    let wants = wanted.porosity && refusal.is_none();
    let mut gather = Gather::new(manifest, &members, wants, wanted.slice);
    pass::all_tiles(set, &mut gather, progress)?;
    let Found {
        fabric,
        porosity,
        mut slice,
    } = gather.finish();
    let place = manifest.measured();
    let mut structure = Structure {
        surface_of: members.surface_of,
        fabric: fabric.fabric(),
        mean_intercept_length: fabric.intercepts(members.volume, place.unit.name()),
        profile: None,
        boxes: Vec::new(),
        notes: members.note().into_iter().chain(refusal).collect(),
        slice: None,
    };
    let Some(porosity) = porosity else {
        return Ok(structure);
    };
    let told = porosity.tell(manifest, &members).ok_or_else(|| {
        let found = "a surface that does not bound the voxels that the index and the tables state";
        let hint = format!("alvis verify {} says what is wrong", set.dir().display());
        Error::format(set.dir(), found, "the tiles of one set").with_hint(hint)
    })?;
    if let Some(slice) = &mut slice {
        slice.finish(told.above.corners[usize::from(slice.z)]);
    }
    structure.slice = slice;
    if let Some(refusal) = members.refusal() {
        structure.notes.push(refusal);
        return Ok(structure);
    }
    let measured = profile::measured(manifest, &told)?;
    structure.notes.extend(measured.note);
    structure.profile = Some(measured.profile);
    structure.boxes = measured.boxes;
    Ok(structure)
}
