//! What the classes of a slab are in the slab behind it: there, several may turn out to be one component.

use crate::labels::SlabClasses;

/// What a class is behind its slab.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fate {
    /// It ended as this class of its own slab.
    Ended(u32),
    /// It is this class of the next slab.
    Next(u32),
}

/// Classes of a slab as those of the next one.
#[derive(Debug, Clone, Copy)]
pub struct Fates<'a> {
    /// Classes that are live in the next slab, by rising number.
    live: &'a [u32],
    /// What each of these is there; one element to each.
    there: &'a [u32],
}

impl<'a> Fates<'a> {
    /// Of classes of which those in `live`, by rising number, are `from_previous` in the next slab.
    pub fn new(live: &'a [u32], from_previous: &'a [u32]) -> Self {
        debug_assert_eq!(live.len(), from_previous.len());
        Fates {
            live,
            there: from_previous,
        }
    }

    /// Of the classes of a slab.
    pub fn between(slab: &'a SlabClasses, next: &'a SlabClasses) -> Self {
        Fates::new(&slab.live, &next.from_previous)
    }

    /// Of an object and a cell.
    pub fn of_both(&self, pair: [u32; 2]) -> [Fate; 2] {
        pair.map(|class| self.of(class))
    }

    /// Of a class, or of a number that no class has, which ended.
    pub fn of(&self, class: u32) -> Fate {
        match self.live.binary_search(&class) {
            Ok(at) => Fate::Next(self.there[at]),
            Err(_) => Fate::Ended(class),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_go_on_or_end() {
        let fates = Fates::new(&[1, 4, 5], &[7, 0, 7]);
        let found = [0, 1, 4, 5, 6, u32::MAX].map(|class| fates.of(class));
        let [next, ended] = [Fate::Next, Fate::Ended];
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
