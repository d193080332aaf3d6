//! The neighbours of triangles that come as a plain list.

use crate::strip::{NONE, STRIDE, Triangle};

/// An edge of a triangle, at the smaller of its ends.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// The larger end.
    other: u32,
    /// True if it runs to the larger end.
    rises: bool,
    number: u32,
}

/// Listed triangles as those of a piece, behind the element that stands for none. Edges are neighbours
/// where exactly two run between the same vertices, and run opposite ways.
pub fn connect(triangles: &[[u32; 3]]) -> Vec<Triangle> {
    let mut piece = vec![Triangle::default(); 1 + triangles.len()];
    let largest = triangles.as_flattened().iter().max();
    let mut ends = vec![0u32; largest.map_or(0, |v| *v as usize + 1)];
    for [a, b, c] in triangles {
        for v in [a.min(b), b.min(c), c.min(a)] {
            ends[*v as usize] += 1;
        }
    }
    let mut sum = 0;
    for end in &mut ends {
        // where those of a vertex begin, and once they are filled in, where they end
        sum += std::mem::replace(end, sum);
    }
    let mut edges = vec![HalfEdge::default(); 3 * triangles.len()];
    for (t, corners) in triangles.iter().enumerate() {
        piece[t + 1] = Triangle::new(*corners, [NONE; 3]);
        for e in 0..3 {
            let (a, b) = (corners[e], corners[(e + 1) % 3]);
            let end = &mut ends[a.min(b) as usize];
            edges[*end as usize] = HalfEdge {
                other: a.max(b),
                rises: a < b,
                number: STRIDE * (t as u32 + 1) + e as u32,
            };
            *end += 1;
        }
    }
    let numbers: &mut [u32] = bytemuck::cast_slice_mut(&mut piece);
    let mut start = 0;
    for end in ends {
        let of_vertex = &mut edges[start..end as usize];
        start = end as usize;
        of_vertex.sort_unstable();
        for pair in of_vertex.chunk_by(|a, b| a.other == b.other) {
            if let [down, up] = *pair
                && !down.rises
                && up.rises
            {
                numbers[down.number as usize] = up.number;
                numbers[up.number as usize] = down.number;
            }
        }
    }
    piece
}
