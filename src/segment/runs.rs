//! Runs of equal voxels in the rows of a band.

use crate::cpu::dispatch;
use crate::slab::Bits;

/// Numbers the runs of a band: rows in order, runs by rising x; phases alternate within a row.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    /// Per word of [`Bits`]: the number of the run that a transition-free start of this word would
    /// continue, i.e. the run of the voxel before it (of its own first voxel in a row's first word).
    pub word_run: Vec<u32>,
    /// Number of runs in the band.
    pub count: usize,
}

/// Bit x is set iff voxel x differs from voxel x - 1 of its row; `before` is the previous word, or
/// `None` for the first.
#[inline]
pub fn transitions(word: u64, before: Option<u64>) -> u64 {
    match before {
        Some(before) => word ^ (word << 1 | before >> 63),
        None => (word ^ word << 1) & !1,
    }
}

/// The bits of a word that lie inside a row of `nx` voxels.
#[inline]
pub fn inside(word: usize, nx: u32) -> u64 {
    let left = nx as usize - 64 * word;
    if left >= 64 { !0 } else { (1 << left) - 1 }
}

impl Runs {
    /// Numbers the runs of `bits`; reuses the memory.
    pub fn number(&mut self, bits: &Bits) {
        dispatch!(self.number_inlined(bits));
    }

    #[inline(always)]
    fn number_inlined(&mut self, bits: &Bits) {
        // what is left of another band is written over
        self.word_run.resize(bits.words.len(), 0);
        let row_words = bits.row_words;
        let beyond = !inside(row_words - 1, bits.span.nx);
        let rows = bits.words.chunks_exact(row_words);
        let mut run = 0u32;
        for (row, first) in rows.zip(self.word_run.chunks_exact_mut(row_words)) {
            // as if the first voxel had one like it before it
            let mut before = row[0] << 63;
            for (first, &word) in first.iter_mut().zip(row) {
                *first = run;
                run += transitions(word, Some(before)).count_ones();
                before = word;
            }
            // a row that ends above has a transition to the 0 beyond
            run += 1 - (before << 1 & beyond).count_ones();
        }
        self.count = run as usize;
    }

    /// The run of the row whose words start at index `row` of `bits.words`, if it has no other.
    #[inline(always)]
    pub fn only_run(&self, row: usize, row_words: usize) -> Option<u32> {
        let first = self.word_run[row];
        let next_row = row + row_words;
        let end = self
            .word_run
            .get(next_row)
            .map_or(self.count, |&run| run as usize);
        (first as usize + 1 == end).then_some(first)
    }

    /// The run of voxel `x` in the row whose words start at index `row` of `bits.words`.
    #[inline(always)]
    pub fn at(&self, bits: &Bits, row: usize, x: usize) -> u32 {
        let w = x / 64;
        let before = (w > 0).then(|| bits.words[row + w - 1]);
        let t = transitions(bits.words[row + w], before);
        self.word_run[row + w] + (t & (!0 >> (63 - x % 64))).count_ones()
    }
}

/// Calls `each(start, end, above)` for every run of a row of `nx` voxels, by rising x.
pub fn for_each_run(words: &[u64], nx: u32, mut each: impl FnMut(u32, u32, bool)) {
    let mut start = 0;
    let mut above = words[0] & 1 == 1;
    let mut before = None;
    for (w, &word) in words.iter().enumerate() {
        let mut t = transitions(word, before) & inside(w, nx);
        while t != 0 {
            let x = 64 * w as u32 + t.trailing_zeros();
            each(start, x, above);
            (start, above) = (x, !above);
            t &= t - 1;
        }
        before = Some(word);
    }
    each(start, nx, above);
}
