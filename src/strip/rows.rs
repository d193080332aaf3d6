//! The triangles of a piece as walks over them read them.

use super::Faces;
use crate::cpu::dispatch;

/// Numbers in a row.
const ROW: u32 = 8;

/// A row for each triangle: the half-edges across its edges 0, 1, 2, 0 and 1, then its corners 2, 0 and 1.
///
/// Half-edge e of triangle t is `8 t + e` here, which is where its mate stands. Behind it stand the mates
/// of the next edge and of the one before, and five behind it the corner off the edge, so a walk needs not
/// count in threes. What one triangle needs lies in one cache line.
#[derive(Debug, Default)]
pub(super) struct Rows {
    rows: Vec<[u32; ROW as usize]>,
    triangles: usize,
}

impl Rows {
    /// Takes a piece; writes the number of mates of each triangle.
    ///
    /// # Panics
    /// If a mate is no half-edge of the piece.
    pub(super) fn fill(&mut self, Faces { corners, mates }: Faces, counts: &mut Vec<u8>) {
        assert_eq!(mates.len(), corners.len(), "mates for each triangle");
        assert!(mates.len() < 1 << 28, "half-edges are u32");
        self.triangles = corners.len();
        if self.rows.len() < corners.len() {
            self.rows.resize(corners.len(), [0; ROW as usize]);
        }
        counts.resize(corners.len(), 0);
        let rows = &mut self.rows[..corners.len()];
        // of the first nothing may be told but its number
        let [_, corners @ ..] = corners else { return };
        rows[0] = [0; ROW as usize];
        let (rows, counts) = (&mut rows[1..], &mut counts[1..]);
        let valid = dispatch!(fill(rows, corners, &mates[1..], counts));
        assert!(valid, "mates are half-edges of the piece");
    }

    /// All numbers: those at mates, and up to two behind these, are in it.
    pub(super) fn numbers(&self) -> &[u32] {
        self.rows[..self.triangles].as_flattened()
    }

    fn at(&self, place: u32) -> u32 {
        self.numbers()[place as usize]
    }

    /// The half-edge across.
    #[inline]
    pub(super) fn mate(&self, h: u32) -> u32 {
        self.at(h)
    }

    /// The corner that does not lie on the half-edge.
    #[inline]
    pub(super) fn apex(&self, h: u32) -> u32 {
        self.at(h + 5)
    }

    /// The corner at which it begins.
    #[inline]
    pub(super) fn first(&self, h: u32) -> u32 {
        self.apex(after(h))
    }

    /// The corner at which it ends.
    #[inline]
    pub(super) fn last(&self, h: u32) -> u32 {
        self.apex(before(h))
    }
}

/// Fills all rows but the first; returns whether all mates are half-edges.
#[inline(always)]
fn fill(
    rows: &mut [[u32; ROW as usize]],
    corners: &[[u32; 4]],
    mates: &[[u32; 4]],
    counts: &mut [u8],
) -> bool {
    let (mut largest, mut fourth) = (0, 0);
    let piece = corners.iter().zip(mates);
    for ((row, count), (&[a, b, c, _], &[k, l, m, _])) in rows.iter_mut().zip(counts).zip(piece) {
        largest = k.max(l).max(m).max(largest);
        fourth |= (k & k >> 1) | (l & l >> 1) | (m & m >> 1);
        *count = u8::from(k != 0) + u8::from(l != 0) + u8::from(m != 0);
        let [k, l, m] = [k, l, m].map(|h| 2 * h - (h & 3));
        *row = [k, l, m, k, l, c, a, b];
    }
    fourth & 1 == 0 && (largest as usize) < 4 * (1 + corners.len())
}

/// The triangle of a half-edge.
#[inline(always)]
pub(super) fn triangle(h: u32) -> u32 {
    h / ROW
}

/// The first half-edge of a triangle.
#[inline(always)]
pub(super) fn half_edge(t: u32) -> u32 {
    ROW * t
}

/// The next half-edge of the same triangle.
#[inline(always)]
pub(super) fn after(h: u32) -> u32 {
    h + 1 - 3 * u32::from(h % ROW == 2)
}

/// The half-edge before it in the same triangle.
#[inline(always)]
pub(super) fn before(h: u32) -> u32 {
    h + 2 - 3 * u32::from(!h.is_multiple_of(ROW))
}
