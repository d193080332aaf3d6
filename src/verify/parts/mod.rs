//! Cells that are parts of components: what of them the tiles prove.
//!
//! A surface of such a set lies between one cell and one object, and is open where the cell touches others. So the pieces
//! of an object in a tile are put together again ([`weld`]), and what is connected is that of the components: edges are
//! matched, and connected parts are counted, as those of any set. Sums go to the surfaces that pieces state.
//!
//! 1. Pieces have the same vertices, with the same normals, where they meet, and those that meet stand by rising cell. A
//!    triangle is of the cell of the voxel below at its first vertex, so those of a tile that begin at one voxel are of one
//!    cell.
//! 2. Surfaces are numbered by cell, then object, and are as their table says; of what is connected there is one less than
//!    objects and components together. Objects are checked as those of any set.
//! 3. Of each cell, area, tiles, names and measures on its pieces are those of its row, and the voxels at which its
//!    triangles begin are in its box. One that touches no other is checked as a body. Fields follow from each other, and
//!    are empty where they have no meaning ([`cells`]).
//! 4. The cells of a component have its voxels, its centroid, its box and its area together, one that is alone equals it,
//!    and the surfaces of all are those of its body ([`components`]). There are as many pairs of a component and an object
//!    with a surface as connected parts.
//! 5. Necks join two cells of one component that lie beside each other, each pair once, and each cell has as many as its
//!    row says ([`necks`]). Of cells that were split, radii and ratios are those of distances of voxels and cut by the rule,
//!    as many as there are cells more than components, and at smaller ratios as many as the curve says ([`rule`]).
//!
//! Not proved by the tiles: how many voxels a cell has that others touch, and where they touch; that triangles on both
//! sides of a tile's plane begin at voxels of one cell; and of components in which a cell has voxels that has some in
//! others, too, more than that they have them.
//!
//! All that grows with the set is sorted on disk, see [`super::spill`].

mod cells;
mod check;
mod components;
mod necks;
mod rule;
mod sums;
mod weld;

pub(super) use check::check;
pub(super) use rule::check_index;
pub(super) use sums::{PartLedger, PartSums};
pub(super) use weld::Weld;
