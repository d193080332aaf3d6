//! Tile sets made of tile sets.

mod ids;
mod new_tiles;
pub mod repack;
pub mod select;
