//! The neighbours of triangles that come as a plain list.

use crate::mesh::cubes::NONE;

/// Corners and mates of listed triangles in the form of [`crate::mesh::TileMesh`]: numbered from 1,
/// behind an element that stands for none. Edges are neighbours where exactly two run between the same
/// vertices, and run opposite ways.
pub fn connect(triangles: &[[u32; 3]]) -> (Vec<[u32; 4]>, Vec<[u32; 4]>) {
    let mut corners = vec![[0; 4]];
    corners.extend(triangles.iter().map(|&[a, b, c]| [a, b, c, 0]));
    // half-edges by their ends, the smaller first: mates are neighbours then
    let mut edges: Vec<([u32; 2], bool, u32)> = Vec::with_capacity(3 * triangles.len());
    for (t, corners) in triangles.iter().enumerate() {
        for e in 0..3 {
            let (a, b) = (corners[e], corners[(e + 1) % 3]);
            let half_edge = (4 * (t + 1) + e) as u32;
            edges.push(([a.min(b), a.max(b)], a < b, half_edge));
        }
    }
    edges.sort_unstable();
    let mut mates = vec![[NONE; 4]; corners.len()];
    let flat = mates.as_flattened_mut();
    for pair in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, false, a), (_, true, b)] = *pair {
            flat[a as usize] = b;
            flat[b as usize] = a;
        }
    }
    (corners, mates)
}
