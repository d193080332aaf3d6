//! What the classes of a slab are in the slab behind it: there, several may turn out to be one component.

use crate::labels::SlabComponents;

/// What a class is behind its slab.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Successor {
    /// It ended as this class of its own slab.
    Ended(u32),
    /// It is this class of the next slab.
    Next(u32),
}

/// Classes of a slab as those of the next one.
#[derive(Debug, Clone, Copy)]
pub struct CarryOver<'a> {
    /// Classes that are live in the next slab, by rising number.
    live: &'a [u32],
    /// What each of these is there; one element to each.
    there: &'a [u32],
}

impl<'a> CarryOver<'a> {
    /// Of classes of which those in `live`, by rising number, are `carried_in` in the next slab.
    pub fn new(live: &'a [u32], carried_in: &'a [u32]) -> Self {
        debug_assert_eq!(live.len(), carried_in.len());
        CarryOver {
            live,
            there: carried_in,
        }
    }

    /// Of the classes of a slab.
    pub fn between(slab: &'a SlabComponents, next: &'a SlabComponents) -> Self {
        CarryOver::new(&slab.live, &next.carried_in)
    }

    /// Of an object and a cell.
    pub fn of_pair(&self, pair: [u32; 2]) -> [Successor; 2] {
        pair.map(|class| self.of(class))
    }

    /// Of a class, or of a number that no class has, which ended.
    pub fn of(&self, class: u32) -> Successor {
        match self.live.binary_search(&class) {
            Ok(at) => Successor::Next(self.there[at]),
            Err(_) => Successor::Ended(class),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_go_on_or_end() {
        let carry_over = CarryOver::new(&[1, 4, 5], &[7, 0, 7]);
        let found = [0, 1, 4, 5, 6, u32::MAX].map(|class| carry_over.of(class));
        let [next, ended] = [Successor::Next, Successor::Ended];
        let expected = [
            ended(0),
            next(7),
            next(0),
            next(7),
            ended(6),
            ended(u32::MAX),
        ];
        assert_eq!(found, expected);
    }
}
