//! The measures in the extras of the tiles' pieces, to be held against the table of cells.
//!
//! Tiles are read before tables and cells are too many to be held in memory, so only a hash of the measures goes along
//! with each surface.

use crate::tile::read::Measured;
use std::hash::{DefaultHasher, Hasher};

/// The hash of what a piece, or a row of the table, states.
pub(super) fn hash(m: &Measured) -> u64 {
    let mut hasher = DefaultHasher::new();
    hasher.write(m.unit.unwrap_or("").as_bytes());
    for v in m.values {
        // no value and -0 have one form each
        hasher.write_u64(if v.is_nan() {
            u64::MAX
        } else {
            (v + 0.0).to_bits()
        });
    }
    hasher.finish()
}
