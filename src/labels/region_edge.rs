//! Components that the edge of a region of interest cuts off.

use crate::error::Result;
use crate::grid::Ambiguous;
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

/// Notes that components touch the border whose voxels meet one of the other phase, where one of the two is outside of
/// the region: there the surface is none of the sample's, see [`for_each_region_edge`].
pub fn note_region_edge(
    bits: &Bits,
    runs: &Runs,
    labels: &mut Labels,
    inside: &InsideBand,
    rule: Ambiguous,
) {
    for_each_region_edge(bits, inside, rule, |row, x| {
        let run = runs.at(bits, row * bits.row_words, x as usize);
        let label = labels.of_run[run as usize];
        labels.components[label as usize].sums.touches_border = 1;
    });
}

/// Calls `note` with the row, counted through all slices, and the x of voxels that share a face with one of the other
/// phase, where one of the two is outside of the region; of each such face with both. The phase that `rule` joins across
/// the edges of voxels goes on across these, too: so of each edge that a voxel of it inside shares with one of the other
/// phase outside, also with both.
pub fn for_each_region_edge(
    bits: &Bits,
    inside: &InsideBand,
    rule: Ambiguous,
    note: impl FnMut(usize, u32),
) {
    let rows = bits.span.rows();
    let joined = match rule {
        Ambiguous::Separate => 0,
        Ambiguous::Join => !0,
    };
    let mut edge = Edge {
        bits,
        inside: &inside.words,
        joined,
        note,
    };
    for s in 0..bits.span.slices() {
        for r in 0..rows {
            let here = s * rows + r;
            edge.along(here);
            if r > 0 {
                edge.across([here - 1, here]);
                edge.diagonal([here - 1, here], &[-1, 1]);
            }
            if s > 0 {
                edge.across([here - rows, here]);
                edge.diagonal([here - rows, here], &[-1, 1]);
                if r > 0 {
                    edge.diagonal([here - rows - 1, here], &[0]);
                    edge.diagonal([here - rows, here - 1], &[0]);
                }
            }
        }
    }
}

/// Calls `note` with the rows, counted through all slices, and the x of two voxels below that share a face, of which one
/// is outside of the region: across such a face what is below goes on, where what is outside is filled so.
pub fn for_each_open_face(
    bits: &Bits,
    inside: &InsideBand,
    mut note: impl FnMut([(usize, u32); 2]),
) {
    let (rows, words) = (bits.span.rows(), bits.row_words);
    let word = |row: usize, w: usize| {
        let at = row * words + w;
        // bits beyond a row's end are no voxels
        let voxels = !0u64 >> (64 - (bits.span.nx as usize - 64 * w).min(64));
        (!bits.words[at] & voxels, inside.words[at])
    };
    for row in 0..rows * bits.span.slices() {
        let before = [(row % rows > 0, 1), (row >= rows, rows)];
        let mut last = (0, 0);
        for w in 0..words {
            let (below, inner) = word(row, w);
            let mut found = below & (below << 1 | last.0) & (inner ^ (inner << 1 | last.1));
            last = (below >> 63, inner >> 63);
            while found != 0 {
                let x = 64 * w as u32 + found.trailing_zeros();
                found &= found - 1;
                note([(row, x - 1), (row, x)]);
            }
            for (_, step) in before.into_iter().filter(|(is_there, _)| *is_there) {
                let (other, other_inner) = word(row - step, w);
                let mut found = below & other & (inner ^ other_inner);
                while found != 0 {
                    let x = 64 * w as u32 + found.trailing_zeros();
                    found &= found - 1;
                    note([(row - step, x), (row, x)]);
                }
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
    /// The bits of voxels of the phase that is joined across the edges of voxels.
    joined: u64,
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

    /// Pairs of two rows whose x differ by one of `steps`, so that they share an edge of voxels.
    fn diagonal(&mut self, [a, b]: [usize; 2], steps: &[i32]) {
        for [own, other] in [[a, b], [b, a]] {
            if self.is_all_inside(other) {
                continue;
            }
            for &step in steps {
                self.beyond([own, other], step);
            }
        }
    }

    fn is_all_inside(&self, row: usize) -> bool {
        let (nx, words) = (self.bits.span.nx as usize, self.bits.row_words);
        let row = &self.inside[row * words..(row + 1) * words];
        row.iter().map(|w| w.count_ones() as usize).sum::<usize>() == nx
    }

    /// Voxels of the joined phase inside, of one row, and voxels of the other phase outside, `step` further along x in
    /// another row.
    fn beyond(&mut self, [own, other]: [usize; 2], step: i32) {
        let (nx, words) = (self.bits.span.nx as usize, self.bits.row_words);
        let word = |row: usize, w: usize| {
            let is_joined = !(self.bits.words[row * words + w] ^ self.joined);
            (is_joined, self.inside[row * words + w])
        };
        let outside = |w: usize| {
            let (is_joined, inside) = word(other, w);
            // bits beyond a row's end are no voxels
            let voxels = !0u64 >> (64 - (nx - 64 * w).min(64));
            !is_joined & !inside & voxels
        };
        let mut found = Vec::new();
        for w in 0..words {
            let (is_joined, inside) = word(own, w);
            let beside = match step {
                1 if w + 1 < words => outside(w) >> 1 | outside(w + 1) << 63,
                1 => outside(w) >> 1,
                -1 if w > 0 => outside(w) << 1 | outside(w - 1) >> 63,
                -1 => outside(w) << 1,
                _ => outside(w),
            };
            let mut both = is_joined & inside & beside;
            while both != 0 {
                found.push(64 * w as u32 + both.trailing_zeros());
                both &= both - 1;
            }
        }
        for x in found {
            (self.note)(own, x);
            (self.note)(other, x.wrapping_add_signed(step));
        }
    }
}
