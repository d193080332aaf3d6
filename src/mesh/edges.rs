//! The lattice edges of a tile that the surface crosses, numbered without a hash.
//!
//! For each voxel row of the tile and each axis one word per 64 voxels says which edges cross; an
//! edge's number is the count of those before it, of which each row's first is kept. (Flying Edges,
//! Schroeder et al. 2015, numbers by counting per row too; bits make it 16 times denser.)

use crate::cpu::dispatch;
use crate::mesh::tile::TileBox;
use crate::slab::Bits;

/// Crossed edges of 64 voxels of a row, per axis, and the numbers of the first of each.
#[derive(Debug, Clone, Copy, Default)]
pub struct EdgeWord {
    /// Bit x: the edge from voxel x along the axis is crossed.
    pub crossed: [u64; 3],
    /// Number of the first crossed edge of this word and axis.
    pub first: [u32; 3],
}

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
    /// Number of crossed edges.
    pub count: u32,
}

impl Edges {
    /// Finds the crossed edges of a tile; reuses the memory.
    pub fn find(&mut self, bits: &Bits, tile: &TileBox) {
        dispatch!(self.find_inlined(bits, tile));
    }

    #[inline(always)]
    fn find_inlined(&mut self, bits: &Bits, tile: &TileBox) {
        let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
        self.row_words = cx / 64 + 1;
        self.rows = cy + 1;
        self.copy_bits(bits, tile);
        self.words.clear();
        self.words.reserve(self.bits.len());
        let (slice, row) = (self.rows * self.row_words, self.row_words);
        let mut next = 0u32;
        for z in 0..=cz {
            for y in 0..=cy {
                let start = z * slice + y * row;
                let here = &self.bits[start..start + row];
                let zeros = |on: bool, step: usize| if on { step } else { 0 };
                // past the last row or slice an edge would leave the tile: compare with itself
                let next_y = &self.bits[start + zeros(y < cy, row)..][..row];
                let next_z = &self.bits[start + zeros(z < cz, slice)..][..row];
                let first_word = self.words.len();
                for w in 0..row {
                    let after = here.get(w + 1).map_or(0, |&n| n << 63);
                    let along_x = (here[w] ^ (here[w] >> 1 | after)) & below(cx, w);
                    let crossed = [along_x, here[w] ^ next_y[w], here[w] ^ next_z[w]];
                    self.words.push(EdgeWord {
                        crossed,
                        first: [0; 3],
                    });
                }
                for axis in 0..3 {
                    for word in &mut self.words[first_word..] {
                        word.first[axis] = next;
                        next += word.crossed[axis].count_ones();
                    }
                }
            }
        }
        self.count = next;
    }

    #[inline(always)]
    fn copy_bits(&mut self, bits: &Bits, tile: &TileBox) {
        let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
        let [x0, y0, z0] = tile.first_cube;
        let (word0, shift) = (x0 as usize / 64, x0 % 64);
        self.bits.clear();
        for z in 0..=cz {
            for y in 0..=cy {
                let s = z + (z0 - bits.span.z.start) as usize;
                let r = y + (y0 - bits.span.y.start) as usize;
                let row = bits.row(s, r);
                for w in 0..self.row_words {
                    let low = row.get(word0 + w).map_or(0, |&b| b >> shift);
                    let high = match row.get(word0 + w + 1) {
                        Some(&b) if shift > 0 => b << (64 - shift),
                        _ => 0,
                    };
                    self.bits.push((low | high) & below(cx + 1, w));
                }
            }
        }
    }
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
