//! Laws of one tile.

use crate::strip::{NONE, STRIDE, Triangle as Numbered, connect};
use crate::surface::TileMesh;
use std::collections::HashMap;

/// Mates are mutual, run the opposite way, and are missing only where no triangle has the reverse.
pub fn check_mates(mesh: &TileMesh) {
    for piece in &mesh.pieces {
        let made = &mesh.piece(piece)[1..];
        let triangles: Vec<_> = made.iter().map(Numbered::corners).collect();
        let mut all = HashMap::new();
        for (t, corners) in triangles.iter().enumerate() {
            for e in 0..3 {
                let edge = (corners[e], corners[(e + 1) % 3]);
                let half_edge = STRIDE * (t as u32 + 1) + e as u32;
                assert!(all.insert(edge, half_edge).is_none(), "three at an edge");
            }
        }
        for (corners, made) in triangles.iter().zip(made) {
            for e in 0..3 {
                let reverse = (corners[(e + 1) % 3], corners[e]);
                assert_eq!(made.mates[e], all.get(&reverse).copied().unwrap_or(NONE));
            }
        }
        assert_eq!(numbers(&connect(&triangles)[1..]), numbers(made));
    }
}

/// The way without branches and the plain one make the same triangles in the same order.
pub fn assert_same(mesh: &TileMesh, reference: &TileMesh) {
    assert_eq!(mesh.pieces.len(), reference.pieces.len());
    for (a, b) in mesh.pieces.iter().zip(&reference.pieces) {
        assert_eq!(a.faces(), b.faces());
        assert_eq!(a.sums, b.sums);
        let [a, b] = [mesh.piece(a), reference.piece(b)];
        assert_eq!(numbers(&a[1..]), numbers(&b[1..]));
    }
}

/// Corners and mates.
fn numbers(triangles: &[Numbered]) -> Vec<[[u32; 3]; 2]> {
    triangles.iter().map(|t| [t.corners(), t.mates]).collect()
}
