//! Tile sets made of tile sets.

pub mod repack;
pub mod select;
