//! Whether a mesh is open, told edge by edge in any order and without keeping edges.
//!
//! Of two triangles that share an edge one goes along it from one end to the other, the second back. So numbers that are
//! mixed from both ends, added one way and taken off the other way, make 0 if each edge has its mate. An edge without one
//! leaves a number that is 0 with a probability of 2^-64.

use super::sheet::{Region, Sheet};

/// Sums over edges of triangles, which are 0 if each of these has its mate.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct Gaps {
    inside: u64,
    faces: u64,
}

impl Gaps {
    /// Of a tile alone, whose neighbours have the mates of edges on the planes between them.
    pub fn of(sheet: &Sheet, region: &Region) -> Self {
        let keys: Vec<u64> = sheet.points.iter().map(|p| key(*p)).collect();
        let mut gaps = Gaps::default();
        for t in &sheet.triangles {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                let [p, q] = [a, b].map(|i| sheet.points[i as usize]);
                let [from, to] = [a, b].map(|i| keys[i as usize]);
                let edge = match p < q {
                    true => mixed(from, to),
                    false => mixed(to, from).wrapping_neg(),
                };
                let sum = match region.on_face(p, q) {
                    true => &mut gaps.faces,
                    false => &mut gaps.inside,
                };
                *sum = sum.wrapping_add(edge);
            }
        }
        gaps
    }

    /// Takes in another tile.
    pub fn add(&mut self, other: Gaps) {
        self.inside = self.inside.wrapping_add(other.inside);
        self.faces = self.faces.wrapping_add(other.faces);
    }

    /// True if the mesh is open somewhere else than at the faces of the volume.
    pub fn are_inside(self) -> bool {
        self.inside != 0
    }

    /// True if the mesh is open at the faces of the volume.
    pub fn are_at_faces(self) -> bool {
        self.faces != 0
    }
}

/// A number for a place.
fn key(p: [i32; 3]) -> u64 {
    p.into_iter().fold(0, |key, v| mixed(key, v as u64))
}

/// A number in which all bits of both have their share (the finalizer of splitmix64).
fn mixed(a: u64, b: u64) -> u64 {
    let mut v = a.rotate_left(32) ^ b.wrapping_add(0x9e37_79b9_7f4a_7c15);
    v = (v ^ v >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    v = (v ^ v >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ v >> 31
}
