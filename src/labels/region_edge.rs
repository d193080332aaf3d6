//! Components that the edge of a region of interest cuts off.

use crate::error::Result;
use crate::labels::label_band::Labels;
use crate::labels::runs::{RowRuns, Runs};
use crate::labels::{Bits, Span};
use crate::volume::RegionVoxels;
use std::ops::Range;

/// Which voxels of a band are inside a region, laid out as [`Bits::words`].
#[derive(Debug, Clone, Default)]
pub struct InsideBand {
    words: Vec<u64>,
}

impl InsideBand {
    /// Reads those of a span; the memory is used again.
    ///
    /// # Errors
    /// Those of the region.
    pub fn load(&mut self, region: &RegionVoxels, span: &Span) -> Result<()> {
        self.words.clear();
        let mut slice = Vec::new();
        for z in span.z.clone() {
            region.rows(span.y.clone(), z, &mut slice)?;
            self.words.extend_from_slice(&slice);
        }
        Ok(())
    }
}

/// Notes that components touch the border whose voxels share a face with a voxel of the other phase, where one of the two
/// is outside of the region: there the surface is none of the sample's.
pub fn note_region_edge(bits: &Bits, runs: &Runs, labels: &mut Labels, inside: &InsideBand) {
    for_each_region_edge(bits, inside, |row, x| {
        let run = runs.at(bits, row * bits.row_words, x as usize);
        let label = labels.of_run[run as usize];
        labels.components[label as usize].sums.touches_border = 1;
    });
}

/// Calls `note` with the row, counted through all slices, and the x of voxels that share a face with one of the other
/// phase, where one of the two is outside of the region; of each such face with both.
pub fn for_each_region_edge(bits: &Bits, inside: &InsideBand, note: impl FnMut(usize, u32)) {
    let rows = bits.span.rows();
    let mut edge = Edge {
        bits,
        inside: &inside.words,
        note,
    };
    for s in 0..bits.span.slices() {
        for r in 0..rows {
            let here = s * rows + r;
            edge.along(here);
            if r > 0 {
                edge.across([here - 1, here]);
            }
            if s > 0 {
                edge.across([here - rows, here]);
            }
        }
    }
}

/// Says of components, in the place of whether they touch the border, whether they have a voxel outside of the region, if
/// there is one. For a search alone: measures need the border.
pub fn note_outside(bits: &Bits, labels: &mut Labels, inside: Option<&InsideBand>) {
    let Labels { of_run, components } = labels;
    for component in &mut *components {
        component.sums.touches_border = 0;
    }
    let Some(inside) = inside else {
        return;
    };
    let rows = bits.words.chunks_exact(bits.row_words);
    let rows = rows.zip(inside.words.chunks_exact(bits.row_words));
    let mut of_run = of_run.iter();
    for (row, inside) in rows {
        for run in RowRuns::new(row, bits.span.nx) {
            let label = *of_run.next().expect("a label for each run") as usize;
            if has_outside(inside, run.start as usize..run.end as usize) {
                components[label].sums.touches_border = 1;
            }
        }
    }
}

/// True if one of some voxels of a row is outside.
fn has_outside(inside: &[u64], run: Range<usize>) -> bool {
    let words = run.start / 64..run.end.div_ceil(64);
    words.into_iter().any(|w| {
        let from = run.start.saturating_sub(64 * w);
        let to = (run.end - 64 * w).min(64);
        !inside[w] & (!0 << from) & (!0 >> (64 - to)) != 0
    })
}

struct Edge<'a, F> {
    bits: &'a Bits,
    inside: &'a [u64],
    note: F,
}

impl<F: FnMut(usize, u32)> Edge<'_, F> {
    /// Pairs along x, of a row.
    fn along(&mut self, row: usize) {
        let (nx, words) = (self.bits.span.nx as usize, self.bits.row_words);
        let (mut phase_before, mut inside_before) = (0, 0);
        for w in 0..words {
            let at = row * words + w;
            let (phase, inside) = (self.bits.words[at], self.inside[at]);
            let differ = phase ^ (phase << 1 | phase_before);
            let outside = !inside | !(inside << 1 | inside_before);
            let mut found = differ & outside;
            if w == 0 {
                found &= !1;
            }
            (phase_before, inside_before) = (phase >> 63, inside >> 63);
            while found != 0 {
                let x = 64 * w + found.trailing_zeros() as usize;
                found &= found - 1;
                if x < nx {
                    (self.note)(row, x as u32 - 1);
                    (self.note)(row, x as u32);
                }
            }
        }
    }

    /// Pairs of two neighbouring rows.
    fn across(&mut self, rows: [usize; 2]) {
        let words = self.bits.row_words;
        let [a, b] = rows.map(|row| row * words);
        for w in 0..words {
            let differ = self.bits.words[a + w] ^ self.bits.words[b + w];
            // bits beyond a row's end do not differ
            let mut found = differ & (!self.inside[a + w] | !self.inside[b + w]);
            while found != 0 {
                let x = 64 * w as u32 + found.trailing_zeros();
                found &= found - 1;
                rows.iter().for_each(|&row| (self.note)(row, x));
            }
        }
    }
}
