//! Where the record of an id lies in a table: those of a part of the volume follow each other, and behind them come
//! those of components that begin in other parts and have voxels or triangles here.

/// Places of ids in a table.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct IdPlaces {
    /// Ids of parts before this one.
    pub before: u64,
    /// Ids of this part, which follow those before.
    pub own: u64,
    /// Others that have a record, by rising number.
    pub others: Vec<u64>,
}

impl IdPlaces {
    /// Of so many ids, from 1 on.
    pub fn all(count: u64) -> Self {
        IdPlaces {
            own: count,
            ..IdPlaces::default()
        }
    }

    /// The place of an id that has one.
    pub fn of(&self, id: u64) -> u64 {
        let place = id.wrapping_sub(self.before + 1);
        match place < self.own {
            true => place,
            false => {
                let other = self.others.binary_search(&id);
                self.own
                    + other.expect("components of a part are its own or go on in others") as u64
            }
        }
    }

    /// True if the id is one of this part.
    pub fn is_own(&self, id: u64) -> bool {
        id.wrapping_sub(self.before + 1) < self.own
    }

    /// The id in a place.
    pub fn id(&self, place: u64) -> u64 {
        match place < self.own {
            true => self.before + 1 + place,
            false => self.others[(place - self.own) as usize],
        }
    }

    /// How many places there are.
    pub fn len(&self) -> u64 {
        self.own + self.others.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_a_part_come_first() {
        let places = IdPlaces {
            before: 10,
            own: 3,
            others: vec![2, 7, 40],
        };
        let ids = [11, 12, 13, 2, 7, 40];
        assert_eq!(places.len(), 6);
        for (place, id) in (0..).zip(ids) {
            assert_eq!((places.of(id), places.id(place)), (place, id));
            assert_eq!(places.is_own(id), place < 3);
        }
        assert!(!places.is_own(10) && !places.is_own(14));
        let all = IdPlaces::all(4);
        assert!((1..=4).all(|id| all.of(id) == id - 1 && all.id(id - 1) == id));
    }
}
