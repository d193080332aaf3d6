//! The Euler characteristic of each component's patch on the grid's outer faces.
//!
//! The faces form a quadrangulated sphere: its vertices are the voxels on them, its quads the 2 x 2
//! squares of such voxels in one face. A component's patch has V - E + F over the vertices, edges and
//! quads that are wholly in it, if the component is 6-connected (4-connected in a face); an
//! 18-connected component also joins the two voxels of a diagonal, which takes 1 for every quad that
//! has just them. With the surfaces' own characteristic it gives that of the component: see
//! [`crate::measure`].

use crate::grid::{Ambiguous, Dims};
use crate::labels::Bits;
use crate::labels::label_band::Labels;
use crate::labels::runs::{RowRuns, Runs, inside, transitions};

/// Adds the patches' characteristics of the voxels, edges and quads that this band owns (those whose
/// largest row and slice it owns) to its components.
pub fn add_border_euler(
    bits: &Bits,
    runs: &Runs,
    labels: &mut Labels,
    rule: Ambiguous,
    dims: Dims,
) {
    let on_face = |v: u32, axis: usize| v == 0 || v + 1 == dims.0[axis];
    let mut patch = Patch {
        bits,
        runs,
        labels,
        rule,
    };
    let span = &bits.span;
    for (s, z) in span.z.clone().enumerate() {
        for (r, y) in span.y.clone().enumerate() {
            let (own_y, own_z) = (r > 0 || y == 0, s > 0 || z == 0);
            let (face_y, face_z) = (on_face(y, 1), on_face(z, 2));
            if s > 0 && r > 0 && !face_y && !face_z && patch.ends_are_alike(s, r) {
                continue; // one vertex, two edges and one quad on either side
            }
            if own_y && own_z {
                if face_y || face_z {
                    patch.whole_row(s, r);
                } else {
                    patch.row_ends(s, r);
                }
            }
            if own_z && r > 0 {
                patch.row_pair([(s, r - 1), (s, r)], face_z);
            }
            if own_y && s > 0 {
                patch.row_pair([(s - 1, r), (s, r)], face_y);
            }
            if s > 0 && r > 0 {
                patch.column_quads(s, r);
            }
        }
    }
}

struct Patch<'a> {
    bits: &'a Bits,
    runs: &'a Runs,
    labels: &'a mut Labels,
    rule: Ambiguous,
}

impl Patch<'_> {
    fn above(&self, (s, r): (usize, usize), x: usize) -> bool {
        self.bits.row(s, r)[x / 64] >> (x % 64) & 1 == 1
    }

    fn label(&self, (s, r): (usize, usize), x: usize) -> usize {
        let row = (s * self.bits.span.rows() + r) * self.bits.row_words;
        self.labels.of_run[self.runs.at(self.bits, row, x) as usize] as usize
    }

    fn add(&mut self, at: (usize, usize), x: usize, euler: i64) {
        let label = self.label(at, x);
        self.labels.components[label].sums.border_euler += euler;
    }

    /// A row that lies in a face: each of its runs has one vertex more than edges.
    fn whole_row(&mut self, s: usize, r: usize) {
        let bits = self.bits;
        for run in RowRuns::new(bits.row(s, r), bits.span.nx) {
            self.add((s, r), run.start as usize, 1);
        }
    }

    /// A row that only its ends are on faces of.
    fn row_ends(&mut self, s: usize, r: usize) {
        for x in self.end_columns() {
            self.add((s, r), x, 1);
        }
    }

    /// Whether at both ends this row, the one before in y and those before in z are alike.
    fn ends_are_alike(&self, s: usize, r: usize) -> bool {
        let rows = [(s, r), (s, r - 1), (s - 1, r), (s - 1, r - 1)];
        self.end_columns().into_iter().all(|x| {
            rows[1..]
                .iter()
                .all(|&row| self.above(row, x) == self.above(rows[0], x))
        })
    }

    /// The x of the two faces across x.
    fn end_columns(&self) -> [usize; 2] {
        [0, self.bits.span.nx as usize - 1]
    }

    /// The edges between two neighbouring rows and, if both lie in one face, the quads between them.
    fn row_pair(&mut self, [a, b]: [(usize, usize); 2], in_face: bool) {
        if !in_face {
            for x in self.end_columns() {
                if self.above(a, x) == self.above(b, x) {
                    self.add(a, x, -1);
                }
            }
            return;
        }
        // between two transitions of either row there is one edge more than quads, both whole or
        // neither; so only the places where a stretch begins have to be looked at
        let bits = self.bits;
        let (row_a, row_b) = (bits.row(a.0, a.1), bits.row(b.0, b.1));
        let mut before = [None; 2];
        for (w, (&word_a, &word_b)) in row_a.iter().zip(row_b).enumerate() {
            let either = transitions(word_a, before[0]) | transitions(word_b, before[1]);
            before = [Some(word_a), Some(word_b)];
            let mut starts = either & inside(w, bits.span.nx) | u64::from(w == 0);
            while starts != 0 {
                let x = 64 * w + starts.trailing_zeros() as usize;
                starts &= starts - 1;
                if self.above(a, x) == self.above(b, x) {
                    self.add(a, x, -1);
                }
                if x > 0 {
                    self.quad([(a, x - 1), (a, x), (b, x - 1), (b, x)]);
                }
            }
        }
    }

    /// The quads in the two faces across x between this row, the one before in y, and those in z.
    fn column_quads(&mut self, s: usize, r: usize) {
        for x in self.end_columns() {
            let at = |ds: usize, dr: usize| ((s - ds, r - dr), x);
            self.quad([at(1, 1), at(1, 0), at(0, 1), at(0, 0)]);
        }
    }

    /// One quad; corners 0 and 3 are opposite.
    fn quad(&mut self, corners: [((usize, usize), usize); 4]) {
        let above = corners.map(|(at, x)| self.above(at, x));
        if above.iter().all(|&a| a == above[0]) {
            self.add(corners[0].0, corners[0].1, 1);
        } else if above[0] == above[3] && above[1] == above[2] {
            let wide_phase = self.rule == Ambiguous::Join;
            let (at, x) = if above[0] == wide_phase {
                corners[0]
            } else {
                corners[1]
            };
            self.add(at, x, -1);
        }
    }
}
