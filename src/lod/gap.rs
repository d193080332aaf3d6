//! How far the border of a node has moved in its planes.
//!
//! Each edge of the border before is led to an edge of the border after, or to those around one of its vertices. Where
//! both ends lie within a distance of the edge that they are led to, all between the two borders does: what lies on
//! one side of the one and on the other side of the other is swept on the way, and a triangle swept between a point
//! and an edge lies no further from the edge than the point. So fins of that half-width along the border after cover
//! all that could be seen through between them.

use super::border::Border;
use super::clusters::Clusters;
use super::mesh::Mesh;
use super::planes::{OnPlanes, axis_of};
use std::collections::{BTreeMap, BTreeSet};

/// A segment of the border after it has moved, between two clusters; of a part that became a point, that one twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Segment {
    pub from: u32,
    pub to: u32,
    /// Of the plane that it lies in.
    pub axis: usize,
}

/// The border after.
#[derive(Debug, Default)]
pub struct Moved {
    /// All segments, also those whose directions cancel.
    pub segments: Vec<Segment>,
    /// How far the border before lies from them, in lattice steps, rounded up; 0 only if it is the same.
    pub gap: u32,
}

/// Leads the border of a mesh to the places of its clusters; `inner` are the planes that are no faces of the volume.
pub fn moved(
    mesh: &Mesh,
    border: &Border,
    clusters: &Clusters,
    points: &[[i32; 3]],
    inner: OnPlanes,
) -> Moved {
    let (segments, distances) = moved_edges(mesh, border, clusters, points, inner);
    let gap = distances.into_iter().map(|d| d.1).fold(0.0, f64::max);
    let stays = |v: u32| mesh.points[v as usize] == points[clusters.of_vertex[v as usize] as usize];
    let edges = border.edges.iter().filter(|e| e.planes & inner != 0);
    // edges that became one on a line lie at no distance, and are others all the same
    let is_same = edges.flat_map(|e| [e.from, e.to]).all(stays);
    Moved {
        segments: segments.into_iter().collect(),
        gap: (gap.ceil() as u32).max(u32::from(!is_same)),
    }
}

/// The border after, and how far each edge before, by its number, lies from what it is led to, in lattice steps.
pub fn moved_edges(
    mesh: &Mesh,
    border: &Border,
    clusters: &Clusters,
    points: &[[i32; 3]],
    inner: OnPlanes,
) -> (BTreeSet<Segment>, Vec<(usize, f64)>) {
    let edges = || {
        let all = border.edges.iter().enumerate();
        all.filter(|(_, e)| e.planes & inner != 0)
    };
    let mut segments = BTreeSet::new();
    let mut around: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let ends = |from: u32, to: u32| [from, to].map(|v| clusters.of_vertex[v as usize]);
    for (_, edge) in edges() {
        let [a, b] = ends(edge.from, edge.to);
        around.entry(a).or_default();
        if a == b {
            continue;
        }
        let axis = axis_of(edge.planes & inner);
        let (from, to) = (a.min(b), a.max(b));
        if segments.insert(Segment { from, to, axis }) {
            around.entry(from).or_default().push(to);
            around.entry(to).or_default().push(from);
        }
    }
    let mut distances = Vec::new();
    for (number, edge) in edges() {
        let [a, b] = ends(edge.from, edge.to);
        let both = [edge.from, edge.to].map(|v| mesh.points[v as usize]);
        let distance = |from: u32, to: u32| {
            let segment = [from, to].map(|c| points[c as usize]);
            both.map(|p| to_segment(p, segment))
                .into_iter()
                .fold(0.0, f64::max)
        };
        let own = if a != b {
            distance(a, b)
        } else {
            let near = around[&a].iter().map(|&other| distance(a, other));
            near.reduce(f64::min).unwrap_or_else(|| {
                let axis = axis_of(edge.planes & inner);
                segments.insert(Segment {
                    from: a,
                    to: a,
                    axis,
                });
                distance(a, a)
            })
        };
        distances.push((number, own));
    }
    (segments, distances)
}

/// Distance of a point to a segment.
fn to_segment(p: [i32; 3], [from, to]: [[i32; 3]; 2]) -> f64 {
    let minus = |u: [i32; 3], v: [i32; 3]| -> [f64; 3] {
        std::array::from_fn(|a| f64::from(u[a]) - f64::from(v[a]))
    };
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (along, off) = (minus(to, from), minus(p, from));
    let length = dot(along, along);
    let t = match length > 0.0 {
        true => (dot(off, along) / length).clamp(0.0, 1.0),
        false => 0.0,
    };
    let rest: [f64; 3] = std::array::from_fn(|a| off[a] - t * along[a]);
    dot(rest, rest).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_to_the_segment_and_not_to_its_line() {
        let segment = [[0, 0, 0], [10, 0, 0]];
        assert_eq!(to_segment([5, 3, 0], segment), 3.0);
        assert_eq!(to_segment([13, 4, 0], segment), 5.0);
        assert_eq!(to_segment([3, 0, 4], [[0; 3]; 2]), 5.0);
    }
}
