//! What is kept of a band's bits between labelling and meshing: rows of one phase are a byte each, others are their words.
//!
//! It also tells which rows of samples the mesh needs: those that the surface crosses, and those beside them, which
//! gradients are taken from.

use crate::labels::{Bits, Span};
use std::ops::Range;

const BELOW: u8 = 0;
const ABOVE: u8 = 1;
const MIXED: u8 = 2;

/// The phase of each row of a band, slices in order, or that it has both.
#[derive(Debug, Clone, Default)]
pub struct RowKinds(pub Vec<u8>);

impl RowKinds {
    /// Of a band's bits, and the words of the rows that have both phases.
    pub fn of(bits: &Bits) -> (Self, Vec<u64>) {
        let (mut kinds, mut mixed) = (Vec::new(), Vec::new());
        kinds.reserve_exact(bits.span.rows() * bits.span.slices());
        for row in bits.words.chunks_exact(bits.row_words) {
            let kind = kind_of(row, bits.span.nx);
            if kind == MIXED {
                mixed.extend_from_slice(row);
            }
            kinds.push(kind);
        }
        (RowKinds(kinds), mixed)
    }

    /// Fills in the bits of `span`, whose rows are of these kinds, the mixed ones with these words.
    pub fn fill(&self, bits: &mut Bits, span: Span, mixed: &[u64]) {
        bits.row_words = (span.nx as usize).div_ceil(64);
        let len = bits.row_words * self.0.len();
        let more = len.saturating_sub(bits.words.len());
        bits.words.reserve_exact(more);
        bits.words.resize(len, 0);
        self.fill_rows(0..self.0.len(), span.nx, mixed, &mut bits.words);
        bits.span = span;
    }

    /// How many rows of both phases come before this one.
    pub fn mixed_before(&self, row: usize) -> usize {
        self.0[..row].iter().filter(|&&kind| kind == MIXED).count()
    }

    /// Fills in the words of some rows of a band of `nx` voxels along x, `mixed` being those of the mixed ones among them.
    pub fn fill_rows(&self, rows: Range<usize>, nx: u32, mixed: &[u64], out: &mut [u64]) {
        let row_words = (nx as usize).div_ceil(64);
        let mut mixed = mixed.chunks_exact(row_words);
        for (&kind, out) in self.0[rows].iter().zip(out.chunks_exact_mut(row_words)) {
            match kind {
                MIXED => out.copy_from_slice(mixed.next().expect("words of each mixed row")),
                kind => {
                    out.fill(if kind == ABOVE { !0 } else { 0 });
                    out[row_words - 1] &= last_word(nx);
                }
            }
        }
    }

    /// True if the surface crosses any edge of the band.
    pub fn has_surface(&self) -> bool {
        self.0
            .iter()
            .any(|&kind| kind == MIXED || kind != self.0[0])
    }

    /// The rows that the surface crosses, of a band that has so many to a slice.
    fn crossed(&self, rows: usize) -> Vec<bool> {
        let kinds = &self.0;
        let differ = |a: usize, b: usize| kinds.get(b).is_some_and(|&b| b != kinds[a]);
        let crossed = |at: usize| {
            let row = at % rows;
            kinds[at] == MIXED
                || row > 0 && differ(at, at - 1)
                || row + 1 < rows && differ(at, at + 1)
                || at >= rows && differ(at, at - rows)
                || differ(at, at + rows)
        };
        (0..kinds.len()).map(crossed).collect()
    }
}

/// The bits of a row's last word that are of voxels.
fn last_word(nx: u32) -> u64 {
    match nx % 64 {
        0 => !0,
        some => (1 << some) - 1,
    }
}

fn kind_of(row: &[u64], nx: u32) -> u8 {
    let (last, others) = row.split_last().expect("a row has a voxel");
    let all = |word: u64| others.iter().all(|&w| w == word) && *last == word & last_word(nx);
    match row[0] & 1 {
        0 if all(0) => BELOW,
        1 if all(!0) => ABOVE,
        _ => MIXED,
    }
}

/// Whole rows of samples that lie one behind the other: of one slice, or all rows of some slices.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowStretch {
    /// Rows.
    pub y: Range<u32>,
    /// Slices.
    pub z: Range<u32>,
}

/// Rows of samples that the mesh of a band needs.
#[derive(Debug, Default)]
pub struct NeededRows {
    /// In the order in which they lie.
    pub parts: Vec<RowStretch>,
}

impl NeededRows {
    /// Of a band with these rows of bits over `bits`, of the samples of `samples`, which has its neighbours.
    pub fn of(kinds: &RowKinds, bits: &Span, samples: &Span) -> Self {
        let crossed = kinds.crossed(bits.rows());
        let (rows, slices) = (samples.rows(), samples.slices());
        let mut needed = vec![false; rows * slices];
        let (low_y, low_z) = (
            bits.y.start - samples.y.start,
            bits.z.start - samples.z.start,
        );
        for (at, _) in crossed.iter().enumerate().filter(|(_, crossed)| **crossed) {
            let y = at % bits.rows() + low_y as usize;
            let z = at / bits.rows() + low_z as usize;
            let here = z * rows + y;
            needed[here] = true;
            if y > 0 {
                needed[here - 1] = true;
            }
            if y + 1 < rows {
                needed[here + 1] = true;
            }
            if z > 0 {
                needed[here - rows] = true;
            }
            if z + 1 < slices {
                needed[here + rows] = true;
            }
        }
        let mut parts: Vec<RowStretch> = Vec::new();
        for (slice, z) in needed.chunks_exact(rows).zip(samples.z.clone()) {
            let mut y = samples.y.start;
            for stretch in slice.chunk_by(|a, b| a == b) {
                let end = y + stretch.len() as u32;
                if stretch[0] {
                    match parts.last_mut() {
                        // whole slices are read together
                        Some(last)
                            if last.z.end == z && last.y == samples.y && stretch.len() == rows =>
                        {
                            last.z.end = z + 1;
                        }
                        _ => parts.push(RowStretch {
                            y: y..end,
                            z: z..z + 1,
                        }),
                    }
                }
                y = end;
            }
        }
        NeededRows { parts }
    }
}
