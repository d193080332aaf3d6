//! Looking at a tile set: which tiles a viewer draws, and the server of `alvis view` with its page.
//!
//! A viewer draws the tiles in its view, nearest first, within a budget of triangles.
//! Two phases keep it fluent however large the surface is. While the camera moves, only macrocubes
//! in a limited environment of the viewing point are tested and drawn ([`TileIndex::interactive`]). When
//! it rests, what is drawn grows until all that is in the view is there ([`TileIndex::completion`]). The
//! second starts with the very tiles of the first. (Progressive rendering of macrocubes as in the paper
//! on ALVIS, 2000, section 4.)
//!
//! # Examples
//! ```no_run
//! use alvis::tileset::TileSet;
//! use alvis::view::{Depth, TileIndex, View};
//! use glam::DVec3;
//! use glam::dcamera::rh::{proj::directx, view::look_at_mat4};
//!
//! let set = TileSet::open("foam")?;
//! let index = TileIndex::read(&set)?;
//! let eye = look_at_mat4(DVec3::new(0.02, 0.01, 0.02), DVec3::ZERO, DVec3::Y);
//! let lens = directx::perspective(1.0, 16.0 / 9.0, 1e-4, 1.0);
//! let view = View::new(lens * eye, Depth::ZeroToOne, set.manifest());
//! for entry in index.interactive(&view, 2, 1_000_000) {
//!     let tile = set.read_tile(entry)?;
//!     println!("{}: {} pieces to draw", entry.path, tile.pieces.len());
//! }
//! # Ok::<(), alvis::Error>(())
//! ```

mod frustum;
mod mesh;
mod nodes;
mod page;
mod rows;
mod script;
mod server;
mod set;
mod slice;
mod tiles;

pub use frustum::{Depth, View};
pub(crate) use server::{Shown, Viewer, token};
pub(crate) use set::Told;
pub(crate) use slice::Slices;
pub use tiles::{Picked, TileIndex};

/// Appends words as the page takes them.
fn put(out: &mut Vec<u8>, words: &[u32]) {
    out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
}
