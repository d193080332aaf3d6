//! How far the border may move in its planes: vertices of edges that would move further than that stay.
//!
//! All of it follows from the border alone, so the nodes on both sides of a plane find the same.

use super::border::{Border, BorderEdge};
use super::clusters::{Clustering, Rules};
use super::gap::moved_edges;
use super::mesh::Mesh;
use super::place::Placing;
use super::planes::{OnPlanes, Planes};

/// How often curves are looked at again once some of their vertices stay.
const ROUNDS: u32 = 3;

/// Which vertices of a mesh stay, so that no edge of its border moves by more than `most` lattice steps if that can be;
/// `inner` are the planes that are no faces of the volume.
pub fn staying(
    mesh: &Mesh,
    border: &Border,
    planes: &Planes,
    rules: &Rules,
    most: f64,
) -> Vec<bool> {
    let inner: OnPlanes = !planes.faces;
    let mut numbers = vec![u32::MAX; mesh.points.len()];
    let mut vertices = Vec::new();
    for edge in border.edges.iter().filter(|e| e.planes & inner != 0) {
        for v in [edge.from, edge.to] {
            if numbers[v as usize] == u32::MAX {
                numbers[v as usize] = vertices.len() as u32;
                vertices.push(v as usize);
            }
        }
    }
    let edges = border.edges.iter().filter(|e| e.planes & inner != 0);
    let own = Border {
        edges: edges
            .map(|e| BorderEdge {
                from: numbers[e.from as usize],
                to: numbers[e.to as usize],
                ..*e
            })
            .collect(),
        of_vertex: vertices.iter().map(|&v| border.of_vertex[v]).collect(),
    };
    let alone = Mesh {
        points: vertices.iter().map(|&v| mesh.points[v]).collect(),
        normals: vertices.iter().map(|&v| mesh.normals[v]).collect(),
        surface_of: vertices.iter().map(|&v| mesh.surface_of[v]).collect(),
        triangles: Vec::new(),
        surfaces: mesh.surfaces.clone(),
    };
    let mut pinned = vec![false; vertices.len()];
    for _ in 0..ROUNDS {
        if !pin(&alone, &own, planes, rules, most, &mut pinned) {
            break;
        }
    }
    let mut all = vec![false; mesh.points.len()];
    for (i, _) in pinned.iter().enumerate().filter(|(_, stays)| **stays) {
        all[vertices[i]] = true;
    }
    all
}

/// Pins the ends of edges that move too far; false if there is none.
fn pin(
    mesh: &Mesh,
    border: &Border,
    planes: &Planes,
    rules: &Rules,
    most: f64,
    pinned: &mut [bool],
) -> bool {
    let kept = vec![false; mesh.surfaces.len()];
    let clustering = Clustering {
        mesh,
        border,
        kept: &kept,
        pinned,
        open_faces: planes.faces,
        rules,
    };
    let clusters = clustering.clusters();
    let placing = Placing {
        mesh,
        border,
        clusters: &clusters,
        planes,
        rules,
    };
    let places = placing.place(&placing.quadrics()).points;
    let (_, distances) = moved_edges(mesh, border, &clusters, &places, !planes.faces);
    let mut any = false;
    for (edge, _) in distances.into_iter().filter(|d| d.1 > most) {
        for v in [border.edges[edge].from, border.edges[edge].to] {
            any |= !pinned[v as usize];
            pinned[v as usize] = true;
        }
    }
    any
}
