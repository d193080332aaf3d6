//! Turns CT volumes larger than memory into glTF tiles.

pub mod error;
pub mod grid;
pub mod manifest;
pub mod strip;
pub mod tile;
pub mod volume;

pub use error::{Error, Result};
