//! Which layers of macrocubes are made together.

use crate::grid::Tiling;

/// Layers that follow each other: all of a volume, or those of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layers {
    /// The first one.
    pub first: u32,
    /// The one behind the last.
    pub end: u32,
}

impl Layers {
    /// All layers.
    pub fn all(tiling: Tiling) -> Self {
        let [_, _, end] = tiling.tiles();
        Layers { first: 0, end }
    }

    /// How many.
    pub fn count(self) -> u32 {
        self.end - self.first
    }

    /// Each of them.
    pub fn each(self) -> std::ops::Range<u32> {
        self.first..self.end
    }
}
