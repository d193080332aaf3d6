//! What the classes of a slab are in the slab behind it: there, several may turn out to be one component.

use super::SlabClasses;

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

    /// Of a class, or of a number that no class has, which ended.
    pub fn of(&self, class: u32) -> Fate {
        match self.live.binary_search(&class) {
            Ok(at) => Fate::Next(self.there[at]),
            Err(_) => Fate::Ended(class),
        }
    }
}

/// The first of those that are equal to each: `firsts(&['a', 'b', 'a'])` is 0, 1, 0.
pub fn firsts<K: Ord>(keys: &[K]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by(|&a, &b| keys[a].cmp(&keys[b]));
    let mut firsts = vec![0; keys.len()];
    for equal in order.chunk_by(|&a, &b| keys[a] == keys[b]) {
        // sorting keeps the order of equal ones
        equal.iter().for_each(|&i| firsts[i] = equal[0]);
    }
    firsts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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

    proptest! {
        #[test]
        fn each_finds_the_first_that_is_equal(keys in prop::collection::vec(0..9u8, 0..40)) {
            for (key, first) in keys.iter().zip(firsts(&keys)) {
                prop_assert_eq!(keys.iter().position(|k| k == key), Some(first));
            }
        }
    }
}
