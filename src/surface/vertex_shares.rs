//! Vertices that several parts of a piece have: for each a short list of these parts.

/// Ends a list; what a vertex of no list begins with.
pub const LAST: u32 = u32::MAX;

/// A vertex in one of the parts that have it.
#[derive(Debug, Clone, Copy)]
pub struct Share {
    /// The part.
    pub part: u32,
    /// The number of the vertex there.
    pub number: u32,
    /// The last of the cubes around the vertex in which it has a triangle of the part.
    pub cube: u64,
    /// The next share of the vertex.
    next: u32,
}

/// The shares of all vertices; each vertex knows the first of its own.
#[derive(Debug, Default)]
pub struct Shares(Vec<Share>);

impl Shares {
    /// Forgets all, but not the room for them.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Notes that the vertex with the list `first` has a triangle of a part in a cube.
    pub fn add(&mut self, first: &mut u32, part: u32, cube: u64) {
        let known = self.numbers(*first).find(|&i| self.0[i].part == part);
        match known {
            Some(i) => self.0[i].cube = self.0[i].cube.max(cube),
            None => {
                let next = std::mem::replace(first, self.0.len() as u32);
                self.0.push(Share {
                    part,
                    number: 0,
                    cube,
                    next,
                });
            }
        }
    }

    /// Those of a vertex, in no order.
    pub fn of(&self, first: u32) -> impl Iterator<Item = &Share> {
        self.numbers(first).map(|i| &self.0[i])
    }

    /// Gives the vertex with the list `first` its number in each of its parts.
    pub fn number(&mut self, first: u32, mut number: impl FnMut(u32) -> u32) {
        let mut next = first;
        while next != LAST {
            let share = &mut self.0[next as usize];
            share.number = number(share.part);
            next = share.next;
        }
    }

    /// The number of a vertex in one of its parts.
    ///
    /// # Panics
    /// If the part is none of them.
    pub fn number_in(&self, first: u32, part: u32) -> u32 {
        let found = self.of(first).find(|share| share.part == part);
        found.expect("the part has the vertex").number
    }

    fn numbers(&self, first: u32) -> impl Iterator<Item = usize> {
        let known = |i: u32| (i != LAST).then_some(i as usize);
        std::iter::successors(known(first), move |&i| known(self.0[i].next))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn lists_hold_what_a_map_holds() {
        let mut seed = 11u64;
        let mut random = |below: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) % below
        };
        let mut shares = Shares::default();
        for round in 1..40 {
            shares.clear();
            let mut lists = [LAST; 20];
            let mut wanted = BTreeMap::new();
            for _ in 0..5 * round {
                let (vertex, part, cube) = (random(20), random(6) as u32, random(1000));
                shares.add(&mut lists[vertex as usize], part, cube);
                let known: &mut u64 = wanted.entry((vertex, part)).or_default();
                *known = cube.max(*known);
            }
            let mut found = BTreeMap::new();
            for (vertex, &first) in (0..).zip(&lists) {
                shares.number(first, |part| 100 * vertex as u32 + part);
                for share in shares.of(first) {
                    let twice = found.insert((vertex, share.part), share.cube);
                    assert_eq!(twice, None);
                    let number = shares.number_in(first, share.part);
                    assert_eq!(number, 100 * vertex as u32 + share.part);
                }
            }
            assert_eq!(found, wanted);
        }
    }
}
