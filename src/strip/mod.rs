//! Triangle strips from a mesh whose triangle neighbours are known.
//!
//! Triangle k of a strip is (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k. Entries that make
//! a triangle with two equal indices (a *degenerate*) draw nothing: they turn a strip (a *swap*,
//! one entry) or join two strips (two entries where the next strip starts at the vertex the last one
//! ended with, four anywhere else). The cost of a mesh is the number of entries, so all three count.

mod greedy;
#[cfg(test)]
mod tests;

pub use greedy::Stripifier;

/// Marks a triangle edge without a neighbour.
pub const NONE: u32 = u32::MAX;

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
