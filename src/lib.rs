//! Turns CT volumes larger than memory into glTF tiles.

pub mod cli;
pub mod error;
pub mod grid;
pub mod manifest;
mod measure;
mod memory;
mod mesh;
pub mod phantom;
mod picture;
pub mod pipeline;
pub mod preview;
pub mod progress;
mod segment;
pub mod select;
mod slab;
mod strip;
pub mod table;
pub mod tile;
pub mod verify;
pub mod volume;

pub use error::{Error, Result};
