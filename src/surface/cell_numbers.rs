//! Cells of a tile by small numbers instead of their ids.

use foldhash::fast::RandomState;
use std::collections::HashMap;

/// Numbers of the different cells of a tile, in any order.
#[derive(Debug, Default)]
pub struct CellNumbers {
    number_of: HashMap<u64, u32, RandomState>,
    /// Their ids.
    pub ids: Vec<u64>,
    /// The one that was asked for last.
    last: Option<(u64, u32)>,
}

impl CellNumbers {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.number_of.clear();
        self.ids.clear();
        self.last = None;
    }

    /// The number of a cell, which may be new.
    #[inline]
    pub fn number(&mut self, id: u64) -> u32 {
        match self.last {
            Some((last, number)) if last == id => number,
            _ => {
                let next = self.ids.len() as u32;
                let number = *self.number_of.entry(id).or_insert(next);
                if number == next {
                    self.ids.push(id);
                }
                self.last = Some((id, number));
                number
            }
        }
    }
}
