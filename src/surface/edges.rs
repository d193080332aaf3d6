//! The lattice edges of a tile that the surface crosses, numbered without a hash.
//!
//! For each voxel row of the tile and each axis one word per 64 voxels says which edges cross; an
//! edge's number is the count of those before it, of which each row's first is kept. (Flying Edges,
//! Schroeder et al. 2015, numbers by counting per row too; bits make it 16 times denser.) From the first
//! numbers it is also seen which rows have none, so that empty parts of a tile cost little.

use crate::labels::Bits;
use crate::surface::mesher::TileBox;
use crate::sys::simd::dispatch;

/// Crossed edges of 64 voxels of a row, per axis. Bit x: the edge from voxel x along the axis is crossed.
pub type EdgeWord = [u64; 3];

/// All crossed edges of a tile. Numbers rise by z, y, then axis, then x of the edge's lower voxel.
#[derive(Debug, Default)]
pub struct Edges {
    /// Words per voxel row of the tile.
    pub row_words: usize,
    /// Voxel rows per slice of the tile.
    pub rows: usize,
    /// Bits of the tile's voxels, aligned to its first voxel.
    pub bits: Vec<u64>,
    /// By slice, row and word.
    pub words: Vec<EdgeWord>,
    /// By slice and row, and one more for the end: number of the first crossed edge per axis, there or
    /// later.
    pub first: Vec<[u32; 3]>,
}

impl Edges {
    /// Finds the crossed edges of a tile; reuses the memory.
    pub fn find(&mut self, bits: &Bits, tile: &TileBox) {
        dispatch!(self.find_inlined(bits, tile));
    }

    #[inline(always)]
    fn find_inlined(&mut self, bits: &Bits, tile: &TileBox) {
        self.row_words = tile.cubes[0] as usize / 64 + 1;
        // nearly every tile has one or two words to a row
        match self.row_words {
            1 => self.find_in_rows::<1>(bits, tile),
            2 => self.find_in_rows::<2>(bits, tile),
            _ => self.find_in_rows::<0>(bits, tile),
        }
    }

    /// The same for rows of `WORDS` words, or of any number for 0.
    #[inline(always)]
    fn find_in_rows<const WORDS: usize>(&mut self, bits: &Bits, tile: &TileBox) {
        let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
        let row = known_or::<WORDS>(self.row_words);
        self.rows = cy + 1;
        let slice = self.rows * row;
        self.copy_bits(bits, tile, row);
        // what is left of another tile is written over
        self.words.resize(self.bits.len(), EdgeWord::default());
        self.first.resize(self.rows * (cz + 1) + 1, [0; 3]);
        let mut words = self.words.chunks_exact_mut(row);
        let mut first = self.first.iter_mut();
        let mut next = 0u32;
        for z in 0..=cz {
            for y in 0..=cy {
                let start = z * slice + y * row;
                let here = &self.bits[start..][..row];
                let step = |on: bool, step: usize| if on { step } else { 0 };
                // past the last row or slice an edge would leave the tile: compare with itself
                let next_y = &self.bits[start + step(y < cy, row)..][..row];
                let next_z = &self.bits[start + step(z < cz, slice)..][..row];
                let words = words.next().expect("some for each row");
                let mut counts = [0; 3];
                for w in 0..row {
                    let after = if w + 1 < row { here[w + 1] << 63 } else { 0 };
                    let along_x = (here[w] ^ (here[w] >> 1 | after)) & below(cx, w);
                    let crossed = [along_x, here[w] ^ next_y[w], here[w] ^ next_z[w]];
                    words[w] = crossed;
                    for axis in 0..3 {
                        counts[axis] += crossed[axis].count_ones();
                    }
                }
                let [x, y, z] = counts;
                *first.next().expect("one for each row") = [next, next + x, next + x + y];
                next += x + y + z;
            }
        }
        *first.next().expect("one more") = [next; 3];
    }

    /// Number of crossed edges.
    pub fn count(&self) -> usize {
        self.first.last().map_or(0, |&[end, ..]| end as usize)
    }

    /// True if no edge of the row, counted through all slices, is crossed.
    #[inline(always)]
    pub fn is_empty(&self, row: usize) -> bool {
        self.first[row][0] == self.first[row + 1][0]
    }

    /// The rows with crossed edges by rising number: number, row and slice, and words.
    #[inline(always)]
    pub fn crossed_rows(&self) -> impl Iterator<Item = (usize, [usize; 2], &[EdgeWord])> {
        let [mut y, mut z] = [0, 0];
        let rows = self.words.chunks_exact(self.row_words).enumerate();
        rows.map(move |(number, words)| {
            let place = [y, z];
            y += 1;
            if y == self.rows {
                [y, z] = [0, z + 1];
            }
            (number, place, words)
        })
        .filter(|&(number, ..)| !self.is_empty(number))
    }

    /// Copies the bits of the tile's voxels, `row` words for each row.
    #[inline(always)]
    fn copy_bits(&mut self, bits: &Bits, tile: &TileBox, row: usize) {
        let cx = tile.cubes[0] as usize;
        let (word0, shift) = (tile.first_cube[0] as usize / 64, tile.first_cube[0] % 64);
        self.bits
            .resize(self.rows * (tile.cubes[2] as usize + 1) * row, 0);
        let mut out = self.bits.chunks_exact_mut(row);
        for slice in tile.slices_of(bits) {
            for from in slice.chunks_exact(bits.row_words) {
                let out = out.next().expect("one for each row");
                if shift == 0 {
                    // one by one: a call of the system's copying function costs more for so few
                    let from = &from[word0..][..row];
                    for (w, (out, &word)) in out.iter_mut().zip(from).enumerate() {
                        *out = word & below(cx + 1, w);
                    }
                    continue;
                }
                for (w, out) in out.iter_mut().enumerate() {
                    let low = from.get(word0 + w).map_or(0, |&b| b >> shift);
                    let high = match from.get(word0 + w + 1) {
                        Some(&b) => b << (64 - shift),
                        None => 0,
                    };
                    *out = (low | high) & below(cx + 1, w);
                }
            }
        }
    }
}

/// A number that is known when code is compiled, or another one if that is 0: loops of few steps need no counting
/// then.
#[inline(always)]
pub fn known_or<const KNOWN: usize>(number: usize) -> usize {
    if KNOWN == 0 { number } else { KNOWN }
}

/// The bits of word `w` that lie below position `n` of the row.
#[inline]
pub fn below(n: usize, w: usize) -> u64 {
    match n.saturating_sub(64 * w) {
        0 => 0,
        left if left >= 64 => !0,
        left => (1 << left) - 1,
    }
}
