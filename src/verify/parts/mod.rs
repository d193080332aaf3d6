//! Cells that are parts of components: what of them the tiles prove.
//!
//! The surface is that of the components. Its pieces are cut where cells touch, so the parts of a surface in a tile are
//! put together again ([`weld`]) and go the way of any other piece: holes, surfaces, laws and the bodies of components are
//! checked as those of cells are where these are the components. Which component a surface is of, tiles do not say; the
//! table of surfaces does, and one that is wrong has components whose sums do not fit.
//!
//! 1. Parts of a surface in a tile have the same vertices where they meet, and stand by rising cell. A triangle is of the
//!    cell of the voxel below at its first vertex, so those that begin at one voxel are of one cell.
//! 2. Each surface of the table has a component; components are checked with their table.
//! 3. Of each cell, area, tiles, names and measures on its pieces are those of its row; the voxels at which its triangles
//!    begin are in its box; it is of the component that its pieces have. Fields follow from each other, and are empty
//!    where they have no meaning ([`cells`]).
//! 4. The cells of a component have its voxels, its centroid, its box and its area together; one that is alone equals it
//!    ([`shares`]).
//! 5. Necks join two cells of one component that lie beside each other, each pair once, and each cell has as many as its
//!    row says ([`necks`]).
//!
//! By the tiles alone, how many voxels each cell has is not proved, nor where cells touch.
//!
//! All that grows with the set is sorted on disk, see [`super::spill`]: by surface, then by component, then by cell.

mod cells;
mod check;
mod necks;
mod shares;
mod sums;
mod weld;

pub(super) use check::check;
pub(super) use sums::{CellSums, PartLedger};
pub(super) use weld::Weld;
