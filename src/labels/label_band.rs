//! Connected components of one band: union-find over runs, with the sums of their voxels.

use crate::grid::{Ambiguous, Dims, Placement};
use crate::labels::Bits;
use crate::labels::runs::{RowRuns, Run, Runs, inside, transitions};
use crate::labels::union_find::UnionFind;
use crate::measure::{Row, VoxelSums, power_sums};
use crate::sys::simd::dispatch;

/// The local components of a band.
#[derive(Debug, Clone, Default)]
pub struct Labels {
    /// Local component of each run, dense from 0 by first voxel.
    pub of_run: Vec<u32>,
    /// The components.
    pub components: Vec<LocalComponent>,
}

/// A connected component of a band's voxels.
#[derive(Debug, Clone, Copy)]
pub struct LocalComponent {
    /// Phase.
    pub above: bool,
    /// Smallest linear index of its voxels in this band.
    pub first: u64,
    /// Sums over the voxels that this band owns: all but those of the row and slice that it shares
    /// with the band and slab before it.
    pub sums: VoxelSums,
}

/// Labels the runs of a band: above voxels 6-connected and below voxels 18-connected for
/// [`Ambiguous::Separate`], the other way round for [`Ambiguous::Join`]. Returns the label of each
/// run, in the `memory` of others, and the number of labels.
pub fn label_runs(
    bits: &Bits,
    runs: &Runs,
    rule: Ambiguous,
    memory: Vec<u32>,
) -> (Vec<u32>, usize) {
    let mut sets = UnionFind::new_in(memory, runs.count);
    dispatch!(join_rows(bits, runs, rule, &mut sets));
    // runs follow their first voxels, so sets do
    sets.into_numbers()
}

#[inline(always)]
fn join_rows(bits: &Bits, runs: &Runs, rule: Ambiguous, sets: &mut UnionFind) {
    // flips bits so that the 18-connected phase is 1
    let wide = if rule == Ambiguous::Separate { !0 } else { 0 };
    let rows = bits.span.rows();
    for s in 0..bits.span.slices() {
        for r in 0..rows {
            let row = |s: usize, r: usize| (s * rows + r) * bits.row_words;
            let here = row(s, r);
            if r > 0 {
                join_row_pair(bits, runs, [here, row(s, r - 1)], wide, sets);
            }
            if s > 0 {
                let below = row(s - 1, r);
                join_row_pair(bits, runs, [here, below], wide, sets);
                if !is_wide_over_narrow(bits, [here, below], wide) {
                    continue; // the row below has joined all that touches across it
                }
                if r > 0 {
                    let corner = [here, row(s - 1, r - 1), below, row(s, r - 1)];
                    join_across(bits, runs, corner, wide, sets);
                }
                if r + 1 < rows {
                    let corner = [here, row(s - 1, r + 1), below, row(s, r + 1)];
                    join_across(bits, runs, corner, wide, sets);
                }
            }
        }
    }
}

/// Whether any voxel of the first of two rows is of the 18-connected phase where the second is not.
#[inline(always)]
fn is_wide_over_narrow(bits: &Bits, rows: [usize; 2], wide: u64) -> bool {
    let [a, b] = rows.map(|row| &bits.words[row..][..bits.row_words]);
    let over = a.iter().zip(b).map(|(a, b)| (a ^ wide) & !(b ^ wide));
    over.fold(0, |any, word| any | word) != 0
}

/// Joins the runs of two rows a step in y and one in z apart, the first two of four given by the indices
/// of their first words. Only the 18-connected phase touches there, and only where neither of the two rows
/// between has joined them already is there anything to do.
#[inline(always)]
fn join_across(bits: &Bits, runs: &Runs, rows: [usize; 4], wide: u64, sets: &mut UnionFind) {
    let words = rows.map(|row| &bits.words[row..][..bits.row_words]);
    for w in 0..bits.row_words {
        // bits beyond a row's end are all alike
        let [a, b, c, d] = words.map(|words| words[w] ^ wide);
        let touch = a & b & !c & !d;
        // the others of a stretch lie in the same runs
        let mut starts = touch & !(touch << 1);
        while starts != 0 {
            let x = 64 * w + starts.trailing_zeros() as usize;
            let [a, b] = [rows[0], rows[1]].map(|row| runs.at(bits, row, x));
            sets.union(a, b);
            starts &= starts - 1;
        }
    }
}

/// Joins the runs of two rows one step apart, given by the indices of their first words: both phases touch
/// at equal x, the 18-connected one also at x +- 1.
#[inline(always)]
fn join_row_pair(bits: &Bits, runs: &Runs, [a, b]: [usize; 2], wide: u64, sets: &mut UnionFind) {
    if let [Some(run_a), Some(run_b)] = [a, b].map(|row| runs.only_run(row, bits.row_words)) {
        // the most common pair in a volume with much of nothing
        let (word_a, word_b) = (bits.words[a] & 1, bits.words[b] & 1);
        if word_a == word_b {
            sets.union(run_a, run_b);
        }
        return;
    }
    let words = [a, b].map(|row| &bits.words[row..][..bits.row_words]);
    let firsts = [a, b].map(|row| &runs.word_run[row..][..bits.row_words]);
    let (mut last_a, mut last_b) = (None, None);
    // bit 63 of the previous word of: both rows equal and wide, equal and narrow, row a, row b
    let mut carry = [0u64; 4];
    for w in 0..bits.row_words {
        let (word_a, word_b) = (words[0][w], words[1][w]);
        let (trans_a, trans_b) = (transitions(word_a, last_a), transitions(word_b, last_b));
        if w > 0 && trans_a | trans_b == 0 {
            continue; // whatever touches here did so before
        }
        let mask = inside(w, bits.span.nx);
        let (flip_a, flip_b) = (word_a ^ wide, word_b ^ wide);
        let both_wide = flip_a & flip_b & mask;
        let both_narrow = !flip_a & !flip_b & mask;
        let starts_wide = both_wide & !(both_wide << 1 | carry[0]);
        let starts_narrow = both_narrow & !(both_narrow << 1 | carry[1]);
        let (left_a, left_b) = (flip_a << 1 | carry[2], flip_b << 1 | carry[3]);
        let (first_a, first_b) = (firsts[0][w], firsts[1][w]);
        let run_a = |upto: u64| first_a + (trans_a & upto).count_ones();
        let run_b = |upto: u64| first_b + (trans_b & upto).count_ones();
        // a at x meets b at x - 1 where no equal-x contact joins them already, and mirrored
        let known = if w == 0 { mask & !1 } else { mask };
        for_each_bit(flip_a & left_b & !flip_b & !left_a & known, |upto| {
            sets.union(run_a(upto), run_b(upto) - 1);
        });
        for_each_bit(flip_b & left_a & !flip_a & !left_b & known, |upto| {
            sets.union(run_a(upto) - 1, run_b(upto));
        });
        for_each_bit(starts_wide | starts_narrow, |upto| {
            sets.union(run_a(upto), run_b(upto));
        });
        carry = [
            both_wide >> 63,
            both_narrow >> 63,
            flip_a >> 63,
            flip_b >> 63,
        ];
        (last_a, last_b) = (Some(word_a), Some(word_b));
    }
}

/// Calls `each` for every set bit with the mask of all bits up to it, itself included.
#[inline]
fn for_each_bit(mut word: u64, mut each: impl FnMut(u64)) {
    while word != 0 {
        each(word ^ (word - 1));
        word &= word - 1;
    }
}

/// The components of labelled runs with the sums of their voxels, in a grid that lies so in the world.
pub fn sum_voxels(
    bits: &Bits,
    of_run: Vec<u32>,
    count: usize,
    dims: Dims,
    place: &Placement,
) -> Labels {
    let mut labels = Labels {
        of_run,
        components: Vec::with_capacity(count),
    };
    dispatch!(sum_rows(bits, &mut labels, dims));
    if place.is_rotated() {
        widen_in_world(bits, &mut labels, place);
    }
    for component in &mut labels.components {
        component.sums.note_border(dims);
    }
    labels
}

/// Finds the ends of components along the axes of the world. Voxels of rows that other bands own are of the same
/// components, so they count, too.
fn widen_in_world(bits: &Bits, labels: &mut Labels, place: &Placement) {
    let Labels { of_run, components } = labels;
    let span = &bits.span;
    let mut labels = of_run.iter();
    for (s, z) in span.z.clone().enumerate() {
        for (r, y) in span.y.clone().enumerate() {
            for Run { start, end, .. } in RowRuns::new(bits.row(s, r), span.nx) {
                let label = *labels.next().expect("a label for each run") as usize;
                let sums = &mut components[label].sums;
                sums.widen_in_world(start..end, [y, z], place);
            }
        }
    }
}

#[inline(always)]
fn sum_rows(bits: &Bits, labels: &mut Labels, dims: Dims) {
    let Labels { of_run, components } = labels;
    let span = &bits.span;
    let mut labels = of_run.iter();
    for (s, z) in span.z.clone().enumerate() {
        for (r, y) in span.y.clone().enumerate() {
            let owned = (r > 0 || y == 0) && (s > 0 || z == 0);
            let row = Row::new(y, z);
            let mut before = [0; 3];
            for Run { start, end, above } in RowRuns::new(bits.row(s, r), span.nx) {
                let label = *labels.next().expect("a label for each run") as usize;
                if label == components.len() {
                    components.push(LocalComponent {
                        above,
                        first: dims.linear([start, y, z]),
                        sums: VoxelSums::default(),
                    });
                }
                let upto = power_sums(end);
                if owned {
                    let run = [0, 1, 2].map(|k| upto[k] - before[k]);
                    components[label].sums.add_run(start..end, run, &row);
                }
                before = upto;
            }
        }
    }
}
