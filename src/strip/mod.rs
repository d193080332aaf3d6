//! Triangle strips from a mesh whose triangle neighbours are known.
//!
//! Triangle k of a strip is (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k. Entries that make
//! a triangle with two equal indices (a *degenerate*) draw nothing: they turn a strip (a *swap*,
//! one entry) or join two strips. Strips are the ALVIS paper's and SGI's idea; the aim here is the
//! fewest entries of the joined strip for the time, not the fewest strips.
//!
//! # Entries
//! - A strip may start at an even or an odd triangle: of (b, c, d) with the exit edge (c, d), write
//!   b, c, d at an even place and b, d, c at an odd one. So a join is always last, first: with the
//!   next strip's own two first entries, a strip costs 4 over one entry per triangle. Joins that keep
//!   every start even cost 4.5.
//! - Two turns to the same side in a row need a swap; left and right in turn need none. The place's
//!   parity says which first turn is free, so each strip is made for the parity it likes best, and the
//!   strips are put in an order in which all stand where they should (`write::Stitcher`).
//!
//! # Stages
//! 1. `triangle`: what a walk needs of each triangle, side by side.
//! 2. `greedy`: paths from triangles with fewest free neighbours, on to the neighbour with fewest, on
//!    ties without a swap, and from the start to its other side.
//! 3. `walk`: the steps of that.
//! 4. `write`: each path to a strip, and the strips to one.
//!
//! What else was tried: `docs/performance.md`.

mod adjacency;
mod greedy;
mod starts;
#[cfg(test)]
mod tests;
mod triangle;
mod walk;
mod write;

pub use adjacency::connect;
pub use triangle::{APEXES, NONE, STRIDE, Triangle};

use greedy::Greedy;
use write::Stitcher;

/// Makes strips; holds scratch that is cleared for each piece and never given back.
#[derive(Debug, Default)]
pub struct Stripifier {
    greedy: Greedy,
    stitcher: Stitcher,
}

impl Stripifier {
    /// Appends one stitched strip for a piece to `out`; returns the number of strips joined in it.
    ///
    /// The appended part is a whole strip: its first entry counts as even, whatever stands before. Linear in
    /// time and memory, and always the same for the same triangles. What is written to the piece is of no
    /// meaning to others.
    ///
    /// # Panics
    /// If a mate is no half-edge of the piece.
    pub fn stripify(&mut self, piece: &mut [Triangle], out: &mut Vec<u32>) -> usize {
        self.stitcher.clear();
        let mut paths = self.greedy.paths(piece);
        let mut strips = 0;
        while let Some(path) = paths.next() {
            self.stitcher.push(&path);
            strips += 1;
        }
        self.stitcher.write(out);
        strips
    }
}

/// Joins what `out` holds to what begins with `first` and comes next: by two entries, which leaves the
/// parity of the place as it is.
fn join(out: &mut Vec<u32>, first: u32) {
    if let Some(&last) = out.last() {
        out.extend([last, first]);
    }
}

/// Joins an already stitched strip onto another one: appends each index of `strip` plus `offset` to
/// `out`, behind as few repeated entries (0 to 3) as keep the orientation of every triangle.
///
/// `out` is a whole strip from its first entry, or empty. The sums stay below `u32::MAX`.
pub fn append_strip(out: &mut Vec<u32>, strip: &[u32], offset: u32) {
    let Some(&first) = strip.first() else { return };
    let first = first + offset;
    if out.last() != Some(&first) {
        join(out, first);
    }
    if out.len() % 2 == 1 {
        out.push(first);
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
