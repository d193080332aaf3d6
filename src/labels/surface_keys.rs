//! Which edge of the lattice leaves a component first.
//!
//! Surfaces are numbered by the smallest key of their edges: three times the linear index of the edge's lower voxel, plus
//! its axis. Of a component that begins behind the first slice, that is the edge that leads to its first voxel along z.
//! Those of the first slice are looked through here.

use crate::grid::Dims;
use crate::labels::label_band::Labels;
use crate::labels::{Bits, Runs};

/// No edge leaves the component, as far as is known.
const NONE: u64 = u64::MAX - 1;
/// The component has no edge in the first slice.
const ELSEWHERE: u64 = u64::MAX;

/// Local components that have voxels in the grid's first slice, by rising number, with the smallest lattice keys of the
/// edges that leave them; nothing of other slabs than the first.
pub fn keys_on_top(bits: &Bits, runs: &Runs, labels: &Labels, dims: Dims) -> Vec<(u32, u64)> {
    let (rows, nx) = (bits.span.rows(), bits.span.nx as usize);
    if bits.span.z.start > 0 {
        return Vec::new();
    }
    let mut keys = vec![ELSEWHERE; labels.components.len()];
    let words = bits.row_words;
    let component = |row: usize, x: usize| {
        let run = runs.at(bits, row * words, x);
        labels.of_run[run as usize] as usize
    };
    for row in 0..rows {
        for run in runs.of_row(row, words) {
            let key = &mut keys[labels.of_run[run] as usize];
            *key = NONE.min(*key);
        }
    }
    let neighbours = [(0, rows), (1, rows - 1), (rows, rows)];
    for (axis, (step, count)) in (0..).zip(neighbours) {
        if axis == 2 && bits.span.slices() == 1 {
            continue;
        }
        for row in 0..count {
            let y = bits.span.y.start + row as u32;
            for w in 0..words {
                let here = bits.words[row * words + w];
                let there = match axis {
                    0 => {
                        let next = bits
                            .words
                            .get(row * words + w + 1)
                            .filter(|_| w + 1 < words);
                        here >> 1 | next.map_or(0, |next| next << 63)
                    }
                    _ => bits.words[(row + step) * words + w],
                };
                let last = if axis == 0 { nx - 1 } else { nx };
                let mut crossed = here ^ there;
                while crossed != 0 {
                    let x = 64 * w + crossed.trailing_zeros() as usize;
                    crossed &= crossed - 1;
                    if x >= last {
                        break;
                    }
                    let end = x + usize::from(axis == 0);
                    let key = 3 * dims.linear([x as u32, y, 0]) + axis;
                    for component in [component(row, x), component(row + step, end)] {
                        keys[component] = key.min(keys[component]);
                    }
                }
            }
        }
    }
    let known = (0..).zip(keys).filter(|&(_, key)| key != ELSEWHERE);
    known.collect()
}
