//! Walls between cells: what of their table the tiles prove, and what the volume does.
//!
//! The table states of each two cells the chords between them, see [`crate::convert`]: lines of voxels from one cell
//! through what is above to the other, whose axis has a share of the wall. The ends of chords are vertices, so:
//!
//! 1. Each vertex is the end of a chord, if its line goes on to another cell. Those of a tile are joined there; what is
//!    left over at its ends is sorted by line, and joined with that of other tiles ([`chords`]).
//! 2. By the tiles alone a normal tells within bounds which share the line's axis has of the wall and how slanted that is,
//!    for what central differences miss is not in it; with the volume the samples tell it ([`slant`]). So by the tiles each
//!    row is within bounds: its number of chords, its area, its thickness and whether it is thin; with the volume these
//!    bounds are what gradients in 32 bits leave. Each pair that has chords beyond doubt has a row ([`table`]).
//! 3. What rows of cells say of neighbours and the thickness of walls follows from the tables of walls and of necks, and
//!    the areas of cells ([`cells`]).
//!
//! Where cells are parts of components, tiles tell the cell of a voxel only if a triangle begins at it. Chords that end at
//! others may be of any row: then rows may have as many chords more. Where labels, or a split of the volume, tell the cell of
//! each voxel there are no such chords.
//!
//! Of a part of a set, whose tiles lack surfaces, the tables are held against each other alone.

mod cells;
mod chords;
mod slant;
mod table;

pub(super) use chords::{Crossing, TileChords, WallLedger, WallScale, of_tile};
pub(super) use slant::{Crossed, Slant, by_samples};
pub(super) use table::check;
