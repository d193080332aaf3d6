//! Directed edges of triangles as bits of their vertices.
//!
//! Triangles lie in one cube each, and vertices on different lattice edges. So the other end of an edge
//! is one of the 32 lattice edges that share a cube with the vertex's own, and a number of six bits tells
//! which: the difference of the two vertices' codes. Seen from the other end it has the opposite sign,
//! so one end sees it below 32; that one has the edge's bit, in the lower half of its word if the edge
//! leaves it, in the upper half if the edge arrives. Entering an edge is a bitwise or at a place that is
//! known before, edges pair up if both halves of a word are the same, and none occurs twice if there
//! are as many bits as were entered.
//!
//! Differences that are
//! sums of multiples of the coordinates alone, without a start for each axis, do not fit six bits: a search
//! found none.

use super::piece::{DOWN, UP, USED};

/// By how much codes differ from a lattice point to the next along each axis, and between lattice edges
/// along each axis. With these numbers, found by a search over all, the differences between all that
/// share a cube differ, none is 0 or 32, and the bits of [`FLAGS`] stay free.
pub(super) const STEPS: [i32; 3] = [1, 14, 26];
pub(super) const STARTS: [i32; 3] = [0, 4, 59];

/// Bits of a code below the axis.
pub(super) const BITS: u32 = 6;

/// Bits of a word's lower half that mean no edge: what triangles say of the vertex.
pub(super) const FLAGS: u32 = USED as u32 | UP as u32 | DOWN as u32;

/// Bits of a word that mean edges.
const EDGES: u64 = !((FLAGS as u64) << 32 | FLAGS as u64);

/// The code of the lattice edge from a lattice point (in voxels) along an axis; from bit 6 on, the axis.
///
/// `along` is 1 for that axis, else 0.
#[inline(always)]
pub(super) fn code(point: [i32; 3], along: [i32; 3]) -> i32 {
    let (mut number, mut axis) = (0, 0);
    for a in 0..3 {
        number += STEPS[a].wrapping_mul(point[a]) + STARTS[a] * along[a];
        axis += a as i32 * along[a];
    }
    axis << BITS | number & ((1 << BITS) - 1)
}

/// The axis of a code.
#[inline(always)]
pub(super) fn axis(code: i32) -> u8 {
    (code >> BITS) as u8
}

/// The word of a triangle on a corner: the bits of the edges to the `next` and from the `last` corner as
/// far as this one has them, and which way it faces `along` the corner's lattice edge. All but `along`
/// are codes.
#[inline(always)]
pub(super) fn mark(own: i32, next: i32, last: i32, along: i32) -> u64 {
    let up = if along > 0 { u32::from(UP) } else { 0 };
    let down = if along < 0 { u32::from(DOWN) } else { 0 };
    let flags = u32::from(USED) | up | down;
    u64::from(bit(last.wrapping_sub(own))) << 32 | u64::from(bit(next.wrapping_sub(own)) | flags)
}

/// The bit of an edge between codes that differ so, if the end that is subtracted has it; else none.
#[inline(always)]
fn bit(difference: i32) -> u32 {
    let place = (difference & 63) as u32;
    if place < 32 { 1 << place } else { 0 }
}

/// True if an edge is there, which was entered, and so is its reverse. `ends` are the word and the code
/// of its tail, then of its head.
#[inline]
pub(super) fn has_reverse([(tail, tail_code), (head, head_code)]: [(u64, i32); 2]) -> bool {
    let out = u64::from(bit(head_code.wrapping_sub(tail_code)));
    let back = u64::from(bit(tail_code.wrapping_sub(head_code)));
    tail & out << 32 | head & back != 0
}

/// The directed edges that all words hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Balance {
    /// Directed edges; those that were entered twice count once.
    pub directed: u64,
    /// Edges that are there one way only.
    pub open: u64,
}

/// Adds what words say of their vertices to the vertices' states, and counts edges.
#[inline(always)]
pub(super) fn balance(words: &[u64], states: &mut [u8]) -> Balance {
    let mut balance = Balance::default();
    for (word, state) in words.iter().zip(states) {
        *state |= *word as u8 & FLAGS as u8;
        let edges = word & EDGES;
        balance.directed += u64::from(edges.count_ones());
        balance.open += u64::from((edges ^ edges >> 32) as u32 & !FLAGS).count_ones() as u64;
    }
    balance
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The twelve lattice edges of a cube: lattice point and axis.
    fn edges_of(cube: [i32; 3]) -> Vec<([i32; 3], usize)> {
        let mut out = Vec::new();
        for axis in 0..3 {
            for corner in 0..4 {
                let mut at = cube;
                at[(axis + 1) % 3] += corner & 1;
                at[(axis + 2) % 3] += corner >> 1;
                out.push((at, axis));
            }
        }
        out
    }

    fn code_of(edge: ([i32; 3], usize)) -> i32 {
        let (at, axis) = edge;
        code(at, std::array::from_fn(|a| i32::from(a == axis)))
    }

    #[test]
    fn every_neighbour_of_a_lattice_edge_has_a_bit_of_its_own() {
        for own in edges_of([7, -1, 65_536]) {
            let mut neighbours = BTreeSet::new();
            for shift in 0..27 {
                let cube = [shift % 3, shift / 3 % 3, shift / 9].map(|s| s - 1);
                let cube = std::array::from_fn(|a| own.0[a] + cube[a]);
                let all = edges_of(cube);
                if all.contains(&own) {
                    neighbours.extend(all);
                }
            }
            neighbours.remove(&own);
            assert_eq!(neighbours.len(), 32);
            let mut seen = BTreeSet::new();
            for &other in &neighbours {
                let ways = [(own, other), (other, own)];
                let bits = ways.map(|(from, to)| bit(code_of(to).wrapping_sub(code_of(from))));
                assert_eq!(bits.iter().filter(|b| **b != 0).count(), 1);
                assert!(bits.iter().all(|b| b & (FLAGS | 1) == 0));
                seen.insert(bits);
            }
            assert_eq!(seen.len(), 32);
            assert_eq!(usize::from(axis(code_of(own))), own.1);
        }
    }
}
