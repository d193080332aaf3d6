//! Triangles that know their neighbours.

use crate::sys::simd::dispatch;
use crate::sys::unchecked::Unchecked;
use bytemuck::{Pod, Zeroable};

/// Numbers to a triangle, so its half-edges are `8 t`, `8 t + 1` and `8 t + 2`.
pub const STRIDE: u32 = 8;

/// Where the corners are among them, the mates being first.
pub const APEXES: u32 = 5;

/// Stands for no half-edge: the first one of triangle 0, which is none.
pub const NONE: u32 = 0;

/// A triangle and its neighbours, all that a walk needs of it in one cache line.
///
/// Those of a piece are numbered from 1: the first element belongs to none and means nothing. Half-edge
/// `8 t + e` runs from corner e of triangle t to the next one.
#[repr(C, align(32))]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Triangle {
    /// By edge the half-edge across it, which runs the other way, or [`NONE`]. Mates are mutual.
    pub mates: [u32; 3],
    /// The first two mates once more while strips are made: the mates of the edge after half-edge h and of
    /// the one before it are numbers h + 1 and h + 2 then, without counting in threes.
    again: [u32; 2],
    /// By edge the corner off it: three different vertices below 2^31.
    pub apexes: [u32; 3],
}

impl Triangle {
    /// By its corners and the half-edges across its edges.
    pub fn new([a, b, c]: [u32; 3], mates: [u32; 3]) -> Self {
        Triangle {
            mates,
            again: [NONE; 2],
            apexes: [c, a, b],
        }
    }

    /// Its three corners.
    pub fn corners(&self) -> [u32; 3] {
        let [c, a, b] = self.apexes;
        [a, b, c]
    }
}

/// The triangles of a piece, number by number.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangles<'a>(Unchecked<'a, u32>);

impl<'a> Triangles<'a> {
    /// # Safety
    /// What is asked for is at half-edges of the piece.
    pub(super) unsafe fn new(piece: &'a [Triangle]) -> Self {
        // SAFETY: a half-edge's numbers are in its triangle
        Triangles(unsafe { Unchecked::new(bytemuck::cast_slice(piece)) })
    }

    /// The half-edge across.
    #[inline(always)]
    pub(super) fn mate(self, h: u32) -> u32 {
        self.0.at(h as usize)
    }

    /// The half-edges across the edge after it and the one before it.
    #[inline(always)]
    pub(super) fn across(self, h: u32) -> [u32; 2] {
        [self.0.at(h as usize + 1), self.0.at(h as usize + 2)]
    }

    /// The corner at which it begins.
    #[inline(always)]
    pub(super) fn first(self, h: u32) -> u32 {
        self.apex(after(h))
    }

    /// The corner at which it ends.
    #[inline(always)]
    pub(super) fn last(self, h: u32) -> u32 {
        self.apex(before(h))
    }

    /// The corner that does not lie on it.
    #[inline(always)]
    pub(super) fn apex(self, h: u32) -> u32 {
        self.0.at((h + APEXES) as usize)
    }
}

/// Counts the mates of each triangle but the first, and repeats them.
///
/// # Panics
/// If a mate is no half-edge of the piece.
pub(super) fn count_mates(piece: &mut [Triangle], counts: &mut Vec<u8>) {
    assert!(piece.len() < 1 << 28, "half-edges are u32");
    counts.resize(piece.len(), 0);
    let [_, triangles @ ..] = piece else { return };
    let valid = dispatch!(count_inlined(triangles, &mut counts[1..]));
    assert!(valid, "mates are half-edges of the piece");
}

/// Returns whether all mates are half-edges.
#[inline(always)]
fn count_inlined(triangles: &mut [Triangle], counts: &mut [u8]) -> bool {
    let last = triangles.len();
    let (mut largest, mut edges) = (0, 0);
    for (triangle, count) in triangles.iter_mut().zip(counts) {
        let [k, l, m] = triangle.mates;
        triangle.again = [k, l];
        largest = k.max(l).max(m).max(largest);
        // 1 more than an edge has bit 2 for 3 to 6, and bit 3 for 7
        edges |= ((k & 7) + 1) | ((l & 7) + 1) | ((m & 7) + 1);
        *count = u8::from(k != NONE) + u8::from(l != NONE) + u8::from(m != NONE);
    }
    edges < 4 && largest as usize / (STRIDE as usize) <= last
}

/// The triangle of a half-edge.
#[inline(always)]
pub(super) fn triangle(h: u32) -> u32 {
    h / STRIDE
}

/// The first half-edge of a triangle.
#[inline(always)]
pub(super) fn half_edge(t: u32) -> u32 {
    STRIDE * t
}

/// The next half-edge of the same triangle.
#[inline(always)]
pub(super) fn after(h: u32) -> u32 {
    h + 1 - 3 * u32::from(h % STRIDE == 2)
}

/// The half-edge before it in the same triangle.
#[inline(always)]
pub(super) fn before(h: u32) -> u32 {
    h + 2 - 3 * u32::from(!h.is_multiple_of(STRIDE))
}
