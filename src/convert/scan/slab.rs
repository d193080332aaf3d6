//! The slab that tiles are made of.

use crate::convert::scan::collect::TileCollector;
use crate::labels::{CarryOver, SlabComponents};
use crate::surface::Piece;

/// What is known of it.
pub struct Slab<'a, 'g> {
    /// Its classes.
    pub classes: &'a SlabComponents,
    /// Those of the next slab, if its tiles have waited for these.
    pub next: Option<&'a SlabComponents>,
    /// Hears of its tiles.
    pub gather: &'a TileCollector<'g>,
}

impl Slab<'_, '_> {
    /// What the classes become in the next slab, if that is known.
    pub fn carry_over(&self) -> Option<CarryOver<'_>> {
        let next = self.next?;
        Some(CarryOver::between(self.classes, next))
    }

    /// True if some of a tile's pieces are likely to turn out to be one, besides those that are written as one. The
    /// tile is then written anew, and is best read back from the page cache.
    pub fn is_provisional(&self, pieces: &[Piece]) -> bool {
        let firsts = (0..).zip(pieces).filter(|&(number, p)| p.first == number);
        let pairs = firsts.map(|(_, p)| p.pair());
        self.classes.merge_often && self.classes.may_become_one(self.next, pairs)
    }
}
