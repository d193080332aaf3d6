//! Which lattice edges of a tile have a vertex already.

use super::marks::axis;
use super::piece::Vertex;
use crate::sys::simd::dispatch;

/// Vertices whose places in the map are found side by side.
const BATCH: usize = 16;

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

    /// Inserts the lattice edges of vertices, with `lo` in the second cell along each axis. Returns false
    /// if two of them are known to be the same.
    pub fn insert(&mut self, points: &[Vertex], lo: [i32; 3]) -> bool {
        if self.list.is_none() {
            let known = self.twice.len();
            dispatch!(self.map(points, lo));
            return self.twice.len() == known;
        }
        let size = self.size;
        let ids = points.iter().map(|p| {
            let cell = |a: usize| (((p[a] - lo[a]) >> 8) + 1) as u64;
            ((cell(2) * size[1] + cell(1)) * size[0] + cell(0)) * 3 + u64::from(axis(p[3]))
        });
        let list = self.list.get_or_insert_default();
        let first = list.len();
        list.extend(ids);
        let own = &mut list[first..];
        own.sort_unstable();
        own.windows(2).all(|w| w[0] != w[1])
    }

    /// Enters vertices in the map, a batch at a time.
    #[inline(always)]
    fn map(&mut self, points: &[Vertex], lo: [i32; 3]) {
        // below MAX_BITS together
        let [nx, ny, _] = self.size.map(|n| n as i32);
        let id = |p: &Vertex| {
            let [x, y, z] = [0, 1, 2].map(|a| ((p[a] - lo[a]) >> 8) + 1);
            (((z * ny + y) * nx + x) * 3 + i32::from(axis(p[3]))) as u32
        };
        let (batches, rest) = points.as_chunks::<BATCH>();
        for batch in batches {
            for id in batch.each_ref().map(id) {
                self.enter(id);
            }
        }
        for p in rest {
            self.enter(id(p));
        }
    }

    #[inline(always)]
    fn enter(&mut self, id: u32) {
        let (word, bit) = (&mut self.bits[(id / 64) as usize], 1 << (id % 64));
        if *word & bit != 0 {
            self.twice.push(u64::from(id));
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
    use crate::verify::marks::code;

    #[test]
    fn the_map_and_the_list_agree() {
        let vertex = |cell: [i32; 3], axis: usize| -> Vertex {
            let along = std::array::from_fn(|a| i32::from(a == axis));
            let [x, y, z] = cell.map(|c| (c - 1) * 256);
            [x, y, z, code(cell, along)]
        };
        for size in [[5, 6, 7], [1000, 1000, 1000]] {
            let mut seen = Seen::default();
            seen.begin(size);
            let first = [([1, 2, 3], 0), ([1, 2, 3], 1), ([4, 2, 3], 1)].map(|(c, a)| vertex(c, a));
            assert!(seen.insert(&first, [0; 3]));
            assert_eq!(seen.repeated(true), None);
            seen.insert(&[vertex([4, 2, 3], 1)], [0; 3]);
            assert_eq!(seen.repeated(true), Some((1, [4, 2, 3])));
            seen.begin(size);
            // more than a batch
            let row: Vec<_> = (0..40)
                .map(|i| vertex([i % 5, i / 5 % 4, i / 20], 2))
                .collect();
            assert!(seen.insert(&row, [0; 3]));
            assert_eq!(seen.repeated(true), None);
            seen.begin(size);
            assert!(!seen.insert(&[&row[..], &row[17..18]].concat(), [0; 3]));
            assert_eq!(seen.repeated(true), Some((1, [2, 3, 0])));
        }
    }
}
