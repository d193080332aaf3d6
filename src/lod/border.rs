//! The border of a node: directed edges in its planes that its triangles leave without a mate.
//!
//! What another node, or nothing, continues is decided by sums: an edge counts for one way and against the other. A
//! flag by place alone would do for the tiles, but coarser surfaces may touch a plane that they do not cross.

use super::mesh::Mesh;
use super::planes::{OnPlanes, Planes};

/// An edge of the border, of the smaller to the larger vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BorderEdge {
    pub from: u32,
    pub to: u32,
    /// How many more triangles run along it than against it; not 0.
    pub sum: i32,
    /// The planes in which both ends lie.
    pub planes: OnPlanes,
}

/// The border of a mesh.
#[derive(Debug, Default)]
pub struct Border {
    /// By vertices.
    pub edges: Vec<BorderEdge>,
    /// Of each vertex, the planes it lies on if it is an end of one of the edges; else 0.
    pub of_vertex: Vec<OnPlanes>,
}

impl Border {
    /// The border of a mesh in a node with these planes.
    pub fn of(mesh: &Mesh, planes: &Planes) -> Self {
        let on: Vec<OnPlanes> = mesh.points.iter().map(|p| planes.bits(*p)).collect();
        let mut halves: Vec<(u64, i32)> = Vec::new();
        for t in &mesh.triangles {
            let bits = t.map(|v| on[v as usize]);
            if bits[0] | bits[1] | bits[2] == 0 {
                continue;
            }
            for k in 0..3 {
                let j = (k + 1) % 3;
                if bits[k] & bits[j] != 0 {
                    let (from, to) = (t[k].min(t[j]), t[k].max(t[j]));
                    let key = u64::from(from) << 32 | u64::from(to);
                    halves.push((key, if from == t[k] { 1 } else { -1 }));
                }
            }
        }
        halves.sort_unstable();
        let mut border = Border {
            edges: Vec::new(),
            of_vertex: vec![0; on.len()],
        };
        for same in halves.chunk_by(|a, b| a.0 == b.0) {
            let sum: i32 = same.iter().map(|half| half.1).sum();
            if sum == 0 {
                continue;
            }
            let (from, to) = ((same[0].0 >> 32) as u32, same[0].0 as u32);
            let ends = [from, to].map(|v| on[v as usize]);
            border.edges.push(BorderEdge {
                from,
                to,
                sum,
                planes: ends[0] & ends[1],
            });
            border.of_vertex[from as usize] = ends[0];
            border.of_vertex[to as usize] = ends[1];
        }
        border
    }
}
