//! Where the vertices of clusters lie: as near as can be to the planes of the triangles around, or, on the border, to
//! the lines of the border, which nodes on both sides of it have in common.

use super::border::Border;
use super::clusters::{Cluster, Clusters, Kind, Rules};
use super::mesh::Mesh;
use super::planes::Planes;
use super::quadric::{LineQuadric, Quadric};
use crate::grid::LATTICE;
use std::collections::HashMap;

/// Vertices of clusters.
#[derive(Debug)]
pub struct Placed {
    /// In lattice steps.
    pub points: Vec<[i32; 3]>,
}

/// Lattice steps to voxels.
const VOXEL: f32 = 1.0 / LATTICE as f32;

/// What decides the places of clusters.
#[derive(Clone, Copy)]
pub struct Placing<'a> {
    pub mesh: &'a Mesh,
    pub border: &'a Border,
    pub clusters: &'a Clusters,
    pub planes: &'a Planes,
    pub rules: &'a Rules,
}

impl Placing<'_> {
    /// The quadrics of the clusters, of no triangle yet. Places count from the node's lower corner.
    pub fn quadrics(&self) -> Vec<Quadric> {
        let quadric = |cluster: &Cluster| {
            // of caps, which are flat, the mean will do and stays outside of the volume
            let cap = self.mesh.surfaces[cluster.surface as usize].key.is_cap;
            let wanted = cluster.kind == Kind::Inner && !cap;
            if !wanted {
                return Quadric::default();
            }
            let middle = self.rules.middle(cluster);
            let low = self.planes.low;
            let centre = std::array::from_fn(|a| (middle[a] - low[a]) as f32 * VOXEL);
            Quadric::around(centre, true)
        };
        self.clusters.all.iter().map(quadric).collect()
    }

    /// The places by quadrics, to which the mesh's triangles are added, and the border.
    pub fn place(&self, quadrics: &[Quadric]) -> Placed {
        let lines = self.lines();
        let clusters = &self.clusters.all;
        let mut placed = Placed {
            points: Vec::with_capacity(clusters.len()),
        };
        for (i, own) in clusters.iter().enumerate() {
            let leader = own.leader as usize;
            let point = match own.kind {
                _ if leader < i => placed.points[leader],
                Kind::Stays => self.planes.rounded(own.block, self.rules.step),
                Kind::Border(axis) => {
                    let quadric = lines.get(&own.leader).copied().unwrap_or_default();
                    self.on_border(own, axis, &quadric)
                }
                Kind::Inner => self.inside(own, &quadrics[i]),
            };
            placed.points.push(point);
        }
        placed
    }

    /// Moves clusters inside to their means where a triangle faces against the normals of all its corners: planes that
    /// meet at a sharp angle may lead to a place beyond a neighbour's.
    pub fn unfold(&self, quadrics: &[Quadric], triangles: &[[u32; 3]], placed: &mut Placed) {
        let clusters = &self.clusters.all;
        let mut folded: Vec<u32> = Vec::new();
        for t in triangles {
            let [p, q, r] = t.map(|c| placed.points[c as usize].map(|v| v as f32));
            let minus = |u: [f32; 3], v: [f32; 3]| glam::Vec3::from(u) - glam::Vec3::from(v);
            let face = minus(q, p).cross(minus(r, p));
            let normal = |c: u32| glam::Vec3::from(clusters[c as usize].normal.map(|v| v as f32));
            if t.iter().all(|&c| face.dot(normal(c)) < 0.0) {
                folded.extend(t);
            }
        }
        for i in folded.into_iter().map(|c| c as usize) {
            if clusters[i].kind == Kind::Inner && quadrics[i].wanted {
                let mean = self.mean(&clusters[i]).map(|v| v as f32 * VOXEL);
                placed.points[i] = self.inside_at(&quadrics[i], mean);
            }
        }
    }

    /// The mean of a cluster's vertices, from the middle of its block.
    fn mean(&self, own: &Cluster) -> [f64; 3] {
        own.sum.map(|s| s as f64 / own.count as f64)
    }

    /// The place of a cluster inside.
    fn inside(&self, own: &Cluster, quadric: &Quadric) -> [i32; 3] {
        let step = self.rules.step;
        let mean = self.mean(own);
        if !quadric.wanted {
            let middle = self.rules.middle(own);
            let at = |a: usize| ((f64::from(middle[a]) + mean[a]) / f64::from(step)).round() as i32;
            return std::array::from_fn(|a| at(a) * step);
        }
        let half = (self.rules.block / 2) as f32 * VOXEL;
        let best = quadric.smallest(mean.map(|m| m as f32 * VOXEL));
        self.inside_at(quadric, best.map(|v| v.clamp(-half, half)))
    }

    /// The place next to `best`, in voxels from the quadric's centre.
    fn inside_at(&self, quadric: &Quadric, best: [f32; 3]) -> [i32; 3] {
        let planes = self.planes;
        let at = |a: usize| {
            let steps = f64::from(best[a] + quadric.centre[a]) * f64::from(LATTICE);
            planes.between(a, steps + f64::from(planes.low[a]), self.rules.step)
        };
        std::array::from_fn(at)
    }

    /// The quadrics of clusters on the border, by leaders.
    fn lines(&self) -> HashMap<u32, LineQuadric> {
        let clusters = self.clusters;
        let mut lines: HashMap<u32, LineQuadric> = HashMap::new();
        for edge in &self.border.edges {
            let ends = [edge.from, edge.to];
            let leader = |v: u32| clusters.all[clusters.of_vertex[v as usize] as usize].leader;
            let own = ends.map(leader);
            let points = ends.map(|v| self.mesh.points[v as usize]);
            for i in 0..2 {
                let cluster = &clusters.all[own[i] as usize];
                let Kind::Border(axis) = cluster.kind else {
                    continue;
                };
                if i == 1 && own[0] == own[1] {
                    continue;
                }
                let middle = self.rules.middle(cluster);
                let flat = |p: [i32; 3]| along(axis).map(|a| i64::from(p[a] - middle[a]));
                let quadric = lines.entry(own[i]).or_default();
                quadric.add(flat(points[0]), flat(points[1]), i64::from(edge.sum.abs()));
            }
        }
        lines
    }

    /// The place of a cluster on the border, which is the same in both nodes that have it.
    fn on_border(&self, own: &Cluster, axis: usize, quadric: &LineQuadric) -> [i32; 3] {
        let half = f64::from(self.rules.border_block / 2);
        let middle = self.rules.middle(own);
        let mean = along(axis).map(|a| own.sum[a] as f64 / own.count as f64);
        let best = quadric.smallest(mean).map(|v| v.clamp(-half, half));
        let mut point = middle;
        // all of its vertices lie in the plane
        point[axis] = middle[axis] + (own.sum[axis] / own.count) as i32;
        for (a, v) in along(axis).into_iter().zip(best) {
            point[a] = self
                .planes
                .between(a, f64::from(middle[a]) + v, self.rules.step);
        }
        point
    }
}

/// The axes along a plane.
fn along(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}
