//! Triangle strips from a mesh whose triangle neighbours are known.
//!
//! Triangle k of a strip is (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k. Entries that make
//! a triangle with two equal indices (a *degenerate*) draw nothing: they turn a strip (a *swap*,
//! one entry) or join two strips (two entries where the next strip starts at the vertex the last one
//! ended with, four anywhere else). The cost of a mesh is the number of entries, so all three count.

mod crossings;
mod greedy;
#[cfg(test)]
mod tests;
mod write;

use crossings::Crossings;

/// Marks a triangle edge without a neighbour.
pub const NONE: u32 = u32::MAX;

/// Most exchanges in a row that the end of a strip tries; see the table above.
const TUNNEL_DEPTH: u32 = 3;

/// Makes strips; holds scratch that is cleared for each piece and never given back.
#[derive(Debug, Default)]
pub struct Stripifier {
    greedy: greedy::Greedy,
    states: Vec<u8>,
    ends: Vec<u32>,
    queue: write::Queue,
}

impl Stripifier {
    /// An empty workspace.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends one stitched strip for `triangles` to `out`; returns the number of strips joined in it.
    ///
    /// The appended part is a whole strip: its first entry counts as even, whatever stands before.
    /// Edge e of triangle t runs from `triangles[t][e]` to `triangles[t][(e + 1) % 3]`, and
    /// `mates[3 * t + e]` is the half-edge `3 * u + f` of the triangle u across it, which runs the
    /// other way, or [`NONE`]. Mates are mutual; the three indices of a triangle differ. Linear in
    /// time and memory, and always the same for the same input.
    ///
    /// # Panics
    /// If `mates` has not three entries per triangle, or one that is out of range.
    pub fn stripify(&mut self, triangles: &[[u32; 3]], mates: &[u32], out: &mut Vec<u32>) -> usize {
        assert_eq!(mates.len(), 3 * triangles.len(), "three mates per triangle");
        assert!(mates.len() < NONE as usize, "half-edges are u32");
        self.states.clear();
        self.states.resize(mates.len() + 1, 0);
        self.ends.clear();
        let mut crossings = Crossings {
            mates,
            states: &mut self.states,
            ends: &mut self.ends,
        };
        self.greedy.label(&mut crossings);
        crossings.settle();
        crossings.tunnel(TUNNEL_DEPTH);
        write::write_strips(triangles, &mut crossings, &mut self.queue, out)
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
fn rotated([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
