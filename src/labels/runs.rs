//! Runs of equal voxels in the rows of a band.

use crate::labels::Bits;
use crate::sys::simd::dispatch;

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

    /// The runs of row number `row`, of so many words.
    pub fn of_row(&self, row: usize, row_words: usize) -> std::ops::Range<usize> {
        let first = |row: usize| {
            self.word_run
                .get(row * row_words)
                .map_or(self.count, |&run| run as usize)
        };
        first(row)..first(row + 1)
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

/// A run of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Its first voxel.
    pub start: u32,
    /// What follows its last voxel.
    pub end: u32,
    /// Phase.
    pub above: bool,
}

/// The runs of a row, by rising x.
pub struct RowRuns<'a> {
    words: &'a [u64],
    nx: u32,
    /// The run that comes next starts here; there is none at the row's end.
    start: u32,
    above: bool,
    /// Transitions of word `word` that no run has ended at.
    left: u64,
    word: usize,
}

impl<'a> RowRuns<'a> {
    /// Those of a row of `nx` voxels.
    #[inline(always)]
    pub fn new(words: &'a [u64], nx: u32) -> Self {
        RowRuns {
            words,
            nx,
            start: 0,
            above: words[0] & 1 == 1,
            left: transitions(words[0], None) & inside(0, nx),
            word: 0,
        }
    }
}

impl Iterator for RowRuns<'_> {
    type Item = Run;

    #[inline(always)]
    fn next(&mut self) -> Option<Run> {
        if self.start == self.nx {
            return None;
        }
        while self.left == 0 && self.word + 1 < self.words.len() {
            let before = Some(self.words[self.word]);
            self.word += 1;
            self.left = transitions(self.words[self.word], before) & inside(self.word, self.nx);
        }
        let end = if self.left == 0 {
            self.nx
        } else {
            64 * self.word as u32 + self.left.trailing_zeros()
        };
        let (start, above) = (self.start, self.above);
        (self.start, self.above) = (end, !above);
        self.left &= self.left.wrapping_sub(1);
        Some(Run { start, end, above })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_are_the_longest_stretches_of_equal_voxels(
            stretches in prop::collection::vec(1usize..90, 1..9), first in any::<bool>(),
        ) {
            let phase = |i: usize| first ^ (i % 2 == 1);
            let row: Vec<bool> = stretches.iter().enumerate().flat_map(|(i, &n)| vec![phase(i); n]).collect();
            let words: Vec<u64> = row
                .chunks(64)
                .map(|chunk| chunk.iter().rev().fold(0, |word, &v| word << 1 | u64::from(v)))
                .collect();
            let mut start = 0;
            let expected: Vec<Run> = stretches.iter().enumerate().map(|(i, &n)| {
                let run = Run { start, end: start + n as u32, above: phase(i) };
                start = run.end;
                run
            }).collect();
            let found: Vec<Run> = RowRuns::new(&words, row.len() as u32).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
