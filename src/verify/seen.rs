//! Which lattice edges of a tile have a vertex already.

/// The most bits of the map: 16 MiB. Larger macrocubes sort the edges instead.
const MAX_BITS: u64 = 1 << 27;

/// A set of lattice edges that tells which were inserted twice. It is kept from tile to tile.
#[derive(Default)]
pub(super) struct Seen {
    size: [u64; 3],
    bits: Vec<u64>,
    twice: Vec<u64>,
    list: Option<Vec<u64>>,
}

impl Seen {
    /// Forgets everything; from now on cells are below `size`.
    pub fn begin(&mut self, size: [u64; 3]) {
        self.size = size;
        self.twice.clear();
        // at most 65,539^3 cells times 3, below 2^50
        let bits = size.iter().product::<u64>() * 3;
        self.bits.clear();
        if bits <= MAX_BITS {
            self.list = None;
            self.bits.resize(bits.div_ceil(64) as usize, 0);
        } else {
            self.list.get_or_insert_default().clear();
        }
    }

    /// Inserts the lattice edge that leaves lattice point `cell` along `axis`.
    #[inline]
    pub fn insert(&mut self, cell: [u64; 3], axis: u8) {
        let id =
            ((cell[2] * self.size[1] + cell[1]) * self.size[0] + cell[0]) * 3 + u64::from(axis);
        if let Some(list) = &mut self.list {
            list.push(id);
            return;
        }
        let (word, bit) = (&mut self.bits[(id / 64) as usize], 1 << (id % 64));
        if *word & bit != 0 {
            self.twice.push(id);
        }
        *word |= bit;
    }

    /// How many edges were inserted again, and the cell of the first. Before the end of a tile only
    /// the map knows; the list is sorted at the `end`.
    pub fn repeated(&mut self, end: bool) -> Option<(u64, [u64; 3])> {
        if let (true, Some(list)) = (end, &mut self.list) {
            list.sort_unstable();
            let again = list.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]);
            self.twice.extend(again);
        }
        let first = self.twice.first()? / 3;
        let [x, y, _] = self.size;
        let cell = [first % x, first / x % y, first / x / y];
        Some((self.twice.len() as u64, cell))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_and_the_list_agree() {
        for size in [[5, 6, 7], [1000, 1000, 1000]] {
            let mut seen = Seen::default();
            seen.begin(size);
            seen.insert([1, 2, 3], 0);
            seen.insert([1, 2, 3], 1);
            seen.insert([4, 2, 3], 1);
            assert_eq!(seen.repeated(true), None);
            seen.insert([4, 2, 3], 1);
            assert_eq!(seen.repeated(true), Some((1, [4, 2, 3])));
            seen.begin(size);
            seen.insert([4, 2, 3], 1);
            assert_eq!(seen.repeated(true), None);
        }
    }
}
