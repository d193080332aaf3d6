//! The neighbours of triangles that come as a plain list.

use crate::strip::{NONE, STRIDE, Triangle};

/// Listed triangles as those of a piece, behind the element that stands for none. Edges are neighbours
/// where exactly two run between the same vertices, and run opposite ways.
pub fn connect(triangles: &[[u32; 3]]) -> Vec<Triangle> {
    let mut piece = vec![Triangle::default(); 1 + triangles.len()];
    // half-edges by their ends, the smaller first: mates are neighbours then
    let mut edges: Vec<([u32; 2], bool, u32)> = Vec::with_capacity(3 * triangles.len());
    for (t, corners) in triangles.iter().enumerate() {
        piece[t + 1] = Triangle::new(*corners, [NONE; 3]);
        for e in 0..3 {
            let (a, b) = (corners[e], corners[(e + 1) % 3]);
            let half_edge = STRIDE * (t as u32 + 1) + e as u32;
            edges.push(([a.min(b), a.max(b)], a < b, half_edge));
        }
    }
    edges.sort_unstable();
    let numbers: &mut [u32] = bytemuck::cast_slice_mut(&mut piece);
    for pair in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, false, a), (_, true, b)] = *pair {
            numbers[a as usize] = b;
            numbers[b as usize] = a;
        }
    }
    piece
}
