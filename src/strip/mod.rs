//! Triangle strips from a mesh whose triangle neighbours are known.
//!
//! Triangle k of a strip is (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k. Entries that make
//! a triangle with two equal indices (a *degenerate*) draw nothing: they turn a strip (a *swap*,
//! one entry) or join two strips. Strips are the ALVIS paper's and SGI's idea; the aim here is the
//! fewest entries of the joined strip, not the fewest strips.
//!
//! # Entries
//! - A strip may start at an even or an odd triangle: of (b, c, d) with the exit edge (c, d), write
//!   b, c, d at an even place and b, d, c at an odd one. So a join is always last, first: with the
//!   next strip's own two first entries, a strip costs 4 over one entry per triangle. Joins that keep
//!   every start even cost 4.5.
//! - Two turns to the same side in a row need a swap; left and right in turn need none. The place's
//!   parity says which first turn is free, so strips are taken from two stacks by their first turn.
//! - So the entries follow from which edge each triangle skips (see `crossings`), which makes strips
//!   a labelling problem in which triangles can be improved one at a time.
//!
//! # Stages
//! 1. `greedy`: fewest free neighbours first, ties without a swap.
//! 2. `settle`: one pass that gives each triangle its best label beside its neighbours' labels.
//! 3. `merge_ends`: from each end of a strip one exchange with a neighbour, where it meets another end
//!    or saves entries otherwise.
//! 4. `write`: the strips one after the other.
//!
//! # What was tried
//! Marching cubes of a closed-cell foam (257^3 voxels, pitch 40, 0.35 triangles per voxel, 64^3-cube
//! macrocubes, pieces by connected surface; entries per triangle without and with two levels of
//! noise; ns per triangle on one core of a busy 2-core AMD EPYC, each piece's best of 15):
//!
//! | way | smooth | noise 0.1 | noise 0.3 | ns |
//! |---|---|---|---|---|
//! | greedy, starts in index order, every start even | 1.402 | | 1.436 | 22 |
//! | greedy, fewest free neighbours start too, every start even | 1.340 | 1.352 | 1.379 | 24 |
//! | the same, starts of either parity, next to the last vertex if free | 1.327 | 1.338 | 1.365 | 25 |
//! | stages 1 to 4 (chosen) | 1.302 | | 1.336 | |
//! | chains of exchanges, at most two long | 1.292 | 1.302 | 1.325 | 40 |
//! | three long | 1.286 | 1.295 | 1.319 | 46 |
//! | four long | 1.283 | | 1.316 | |
//! | five long | 1.281 | | 1.314 | |
//! | annealing, 1000 passes: about the optimum | 1.22 | | 1.26 | |
//!
//! Not worth it: a second `settle` before (-0.001) or settle and exchanges once more (-0.005, +11 ns);
//! choosing the neighbour by a table over the free exits of both (1.363 to 1.356 for greedy alone, by
//! hill climbing over all 256 contexts, so greedy ends there); sequential message passing from
//! nothing (1.44 after seven passes); starts in index order before the exchanges (+0.005); joins round
//! the last vertex after them, for they leave hardly a free end there.
//!
//! The times above are from before these, with chains of two on 193^3 voxels with noise 0.1,
//! Mtriangles per second beside meshopt's stripify (44 to 46) in the same run: four words to a triangle,
//! a first half-edge that stands for none, and a greedy stage without branches on its choices 24.7;
//! corners read in order before strips need them, and no branch on the side to turn to 31.3. State and
//! mate in one word (21.7) and the greedy count beside them (21.0) were slower: a wide store waits for
//! narrow ones. Without bounds checks it would be 3 % faster.
//!
//! Since then, on the foam of the same size that a conversion cuts to pieces of 1,700 triangles on
//! average, ns per triangle in the same run: 30.2 before, at 1.276 entries; 27.6 with the steps to the
//! other edge in the state; 23.6 with one exchange instead of two, at 1.286 entries. Fetching the mates of
//! both neighbours ahead changed nothing: pieces of this size stay in the first cache.
//!
//! Of these 24 ns, in clocks of 2.6 GHz a triangle: greedy 25 (of them 16 to walk and 6 to read the mates
//! for the first time), settle 9, exchanges 10, writing 19. Two pieces walked in turns, so that one need
//! not wait for the other's loads, took as long as one after the other. Without `settle` the exchanges take
//! its time, at 1.291 entries; one try for each end instead of three saves nothing.

mod crossings;
mod greedy;
#[cfg(test)]
mod tests;
mod write;

use crossings::Crossings;

/// Marks a triangle edge without a neighbour: the first half-edge of triangle 0, which is no triangle.
pub const NONE: u32 = 0;

/// Makes strips; holds scratch that is cleared for each piece and never given back.
#[derive(Debug, Default)]
pub struct Stripifier {
    greedy: greedy::Greedy,
    states: Vec<[u8; 4]>,
    ends: Vec<u32>,
    queue: write::Queue,
}

impl Stripifier {
    /// Appends one stitched strip for some triangles to `out`; returns the number of strips joined in it.
    ///
    /// The appended part is a whole strip: its first entry counts as even, whatever stands before.
    ///
    /// Triangles are numbered from 1: the first element of `corners` and `mates` belongs to none and
    /// is only zeros, and so is each fourth. Edge e of triangle t runs from `corners[t][e]` to
    /// `corners[t][(e + 1) % 3]`, and `mates[t][e]` is the half-edge `4 * u + f` of the triangle u
    /// across it, which runs the other way, or [`NONE`]. Four to a triangle, half-edges are found by
    /// shifts, and a border needs no question: nothing crosses its mate. Mates are mutual; the three
    /// corners of a triangle differ. Linear in time and memory, and always the same for the same input.
    ///
    /// # Panics
    /// If `corners` and `mates` differ in length, or a mate is out of range.
    pub fn stripify(
        &mut self,
        corners: &[[u32; 4]],
        mates: &[[u32; 4]],
        out: &mut Vec<u32>,
    ) -> usize {
        assert_eq!(mates.len(), corners.len(), "mates for each triangle");
        assert!(mates.len() < (1 << 30), "half-edges are u32");
        self.states.clear();
        self.states.resize(mates.len(), [0; 4]);
        self.ends.clear();
        let mut crossings = Crossings {
            mates: mates.as_flattened(),
            states: &mut self.states,
            ends: &mut self.ends,
        };
        self.greedy.label(&mut crossings);
        crossings.settle();
        crossings.merge_ends();
        write::write_strips(corners.as_flattened(), &mut crossings, &mut self.queue, out)
    }
}

/// Joins an already stitched strip onto another one: appends each index of `strip` plus `offset` to
/// `out`, behind as few repeated entries (0 to 3) as keep the orientation of every triangle.
///
/// `out` is a whole strip from its first entry, or empty. The sums stay below `u32::MAX`.
pub fn append_strip(out: &mut Vec<u32>, strip: &[u32], offset: u32) {
    let Some(&first) = strip.first() else { return };
    let first = first + offset;
    if let Some(&last) = out.last() {
        if last != first {
            out.extend([last, first]);
        }
        if out.len() % 2 == 1 {
            out.push(first);
        }
    }
    out.extend(strip.iter().map(|&v| v + offset));
}

/// Decodes a stitched strip to triangles in strip order, leaving out degenerates.
///
/// Each triangle keeps its orientation and is rotated so that its smallest index is first.
#[cfg(test)]
pub fn unstrip(indices: &[u32]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for (k, window) in indices.windows(3).enumerate() {
        let (a, b, c) = (window[0], window[1], window[2]);
        if a != b && b != c && c != a {
            triangles.push(rotated(if k % 2 == 0 { [a, b, c] } else { [b, a, c] }));
        }
    }
    triangles
}

/// The same oriented triangle with its smallest index first.
#[cfg(test)]
fn rotated([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
