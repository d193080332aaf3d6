//! Surfaces that would vanish: what is smaller than a block comes back with few triangles, so that no cell is lost.

use super::border::Border;
use super::clusters::Clusters;
use super::collapse::{Limits, collapse};
use super::mesh::Mesh;
use super::planes::{OnPlanes, Planes, axes};
use super::tetrahedron::tetrahedron;
use super::triangles::distinct;
use crate::grid::LATTICE;
use glam::DVec3;

/// So many triangles are left of one at most; a tetrahedron at least.
const MOST: usize = 6;
pub const LEAST: usize = 4;
/// Surfaces that so many blocks hold are small.
const SMALL_BLOCKS: i32 = 2;

/// What a node has of its surfaces, and what it is made of.
pub struct Specks<'a> {
    pub mesh: &'a Mesh,
    pub border: &'a Border,
    pub planes: &'a Planes,
    /// Faces of the volume on which surfaces end.
    pub open_faces: OnPlanes,
    /// Vertices lie on multiples of so many lattice steps.
    pub step: i32,
    /// Width of blocks in lattice steps.
    pub block: i32,
    pub clusters: &'a mut Clusters,
    /// Places of clusters.
    pub points: &'a mut Vec<[i32; 3]>,
    pub triangles: &'a mut Vec<[u32; 3]>,
    /// Triangles that may come back.
    pub room: usize,
}

/// A surface by itself: its vertices of the mesh, and triangles between them.
#[derive(Debug, Default)]
struct Alone {
    vertices: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Specks<'_> {
    /// Gives up surfaces so that no more than so many triangles are left, if those that some blocks hold will do: the
    /// smallest first, apart from those that other nodes continue. Edges of surfaces that are full of holes cannot be
    /// collapsed as far as is wanted.
    pub fn give_up(&mut self, most: usize) {
        let surface = |t: &[u32; 3]| self.clusters.all[t[0] as usize].surface as usize;
        let mut counts = vec![0; self.mesh.surfaces.len()];
        self.triangles.iter().for_each(|t| counts[surface(t)] += 1);
        let mut left = self.triangles.len();
        if left <= most {
            return;
        }
        let is_small = |i: usize| counts[i] > MOST && !self.mesh.surfaces[i].key.is_cap;
        let wanted: Vec<bool> = (0..counts.len()).map(is_small).collect();
        let width = i64::from(SMALL_BLOCKS * self.block);
        let widest = width * width;
        let alone = self.alone(&wanted).into_iter().enumerate();
        let own = alone.filter(|(_, s)| !s.vertices.is_empty() && !self.is_shared(s));
        let mut small: Vec<(i64, usize)> = own.map(|(i, s)| (self.extent(&s), i)).collect();
        small.retain(|(extent, _)| *extent < widest);
        small.sort_unstable();
        let mut is_gone = vec![false; counts.len()];
        for (_, i) in small {
            if left <= most {
                break;
            }
            is_gone[i] = true;
            left -= counts[i] - LEAST;
        }
        let all = &self.clusters.all;
        self.triangles
            .retain(|t| !is_gone[all[t[0] as usize].surface as usize]);
    }

    /// True for a surface that other nodes continue.
    fn is_shared(&self, alone: &Alone) -> bool {
        let is_shared = |v: &u32| self.border.of_vertex[*v as usize] & !self.open_faces != 0;
        alone.vertices.iter().any(is_shared)
    }

    /// Brings surfaces back of which no triangle is left, as far as there is room. Of those that other nodes continue only
    /// what is of small cells, closed by itself: their curves on the border are gone, too, and they may be gone in all nodes.
    pub fn bring_back(mut self) {
        let mut is_gone: Vec<bool> = self.mesh.surfaces.iter().map(|s| !s.key.is_cap).collect();
        for t in self.triangles.iter() {
            is_gone[self.clusters.all[t[0] as usize].surface as usize] = false;
        }
        if is_gone.contains(&true) {
            let mut gone = self.alone(&is_gone);
            gone.retain(|s| !s.vertices.is_empty() && (!self.is_shared(s) || self.is_small(s)));
            // the largest, if there is no room for all
            gone.sort_by_cached_key(|surface| std::cmp::Reverse(self.extent(surface)));
            let left = (self.room / gone.len().max(1)).clamp(LEAST, MOST);
            gone.truncate(self.room / left);
            for surface in &gone {
                match self.is_shared(surface) {
                    true => self.add_smallest(surface),
                    false => self.add(surface, left),
                }
            }
        }
    }

    /// True for a surface of a cell that some blocks hold.
    fn is_small(&self, alone: &Alone) -> bool {
        let surface = self.mesh.surface_of[alone.vertices[0] as usize];
        let voxels = self.mesh.surfaces[surface as usize].extras.voxels();
        let wide = f64::from(SMALL_BLOCKS * self.block) / f64::from(LATTICE);
        voxels.is_some_and(|voxels| voxels as f64 <= wide * wide * wide)
    }

    /// Adds the smallest piece of the surface that has most triangles, for a node of which else nothing is left.
    pub fn stand_in(mut self) {
        let surfaces = self.mesh.surfaces.iter().enumerate();
        let most =
            surfaces.max_by_key(|(i, s)| (!s.key.is_cap, s.triangles, std::cmp::Reverse(*i)));
        let wanted: Vec<bool> = (0..self.mesh.surfaces.len())
            .map(|i| most.is_some_and(|(first, _)| first == i))
            .collect();
        let all = self.alone(&wanted);
        if let Some(own) = all.iter().find(|s| !s.vertices.is_empty()) {
            self.add_smallest(own);
        }
    }

    /// The surfaces that are gone, in their order; the others without a vertex.
    fn alone(&self, is_gone: &[bool]) -> Vec<Alone> {
        let mut all: Vec<Alone> = is_gone.iter().map(|_| Alone::default()).collect();
        let mut numbers = vec![u32::MAX; self.mesh.points.len()];
        for t in &self.mesh.triangles {
            let surface = self.mesh.surface_of[t[0] as usize] as usize;
            if is_gone[surface] {
                let own = &mut all[surface];
                let triangle = t.map(|v| {
                    let number = &mut numbers[v as usize];
                    if *number == u32::MAX {
                        *number = own.vertices.len() as u32;
                        own.vertices.push(v);
                    }
                    *number
                });
                own.triangles.push(triangle);
            }
        }
        all
    }

    /// The squared diagonal of the box of a surface, in lattice steps.
    fn extent(&self, alone: &Alone) -> i64 {
        let side = |a: usize| {
            let all = || {
                let vertices = alone.vertices.iter();
                vertices.map(|&v| i64::from(self.mesh.points[v as usize][a]))
            };
            all().max().unwrap_or(0) - all().min().unwrap_or(0)
        };
        (0..3).map(|a| side(a) * side(a)).sum()
    }

    /// Adds a tetrahedron one step wide for a surface that is smaller than that.
    fn add_smallest(&mut self, alone: &Alone) {
        let Planes { low, high, .. } = *self.planes;
        let count = alone.vertices.len() as f64;
        let place = |v: &u32| DVec3::from(self.mesh.points[*v as usize].map(f64::from));
        let middle = alone.vertices.iter().map(place).sum::<DVec3>() / count;
        let mut volume = 0.0;
        for t in &alone.triangles {
            let [p, q, r] = t.map(|v| place(&alone.vertices[v as usize]) - middle);
            volume += p.dot(q.cross(r));
        }
        // all four corners lie strictly between the planes if there is room; else they have to match nothing there, either
        let corner = |a: usize| {
            let inner = if high[a] - low[a] >= 3 * self.step {
                self.step
            } else {
                0
            };
            let steps = (middle[a] / f64::from(self.step)).round() as i32;
            (steps * self.step).clamp(low[a] + inner, high[a] - inner - self.step)
        };
        let base: [i32; 3] = std::array::from_fn(corner);
        let first = self.points.len() as u32;
        let surface = self.mesh.surface_of[alone.vertices[0] as usize];
        let way = if volume < 0.0 { -1 } else { 1 };
        for k in 0..4 {
            let mut point = base;
            // the first corner looks to where none of the others is
            let mut normal = [if k == 0 { -way } else { 0 }; 3];
            if k > 0 {
                point[k - 1] += self.step;
                normal[k - 1] = way;
            }
            self.points.push(point);
            self.clusters.add_one(surface, normal, 0);
        }
        for [a, b, c] in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            let corners = if way > 0 { [a, b, c] } else { [a, c, b] };
            self.triangles.push(corners.map(|v| first + v));
        }
    }

    /// Adds what is left of a surface that is brought down to so many triangles.
    fn add(&mut self, alone: &Alone, left: usize) {
        let vertices = alone.vertices.iter().map(|&v| v as usize);
        let rounded = |v: usize| self.planes.rounded(self.mesh.points[v], self.step);
        let points: Vec<_> = vertices.clone().map(rounded).collect();
        // where two faces of the volume meet, what is on them must not be cut off
        let locked: Vec<bool> = vertices
            .map(|v| axes(self.border.of_vertex[v]) > 1)
            .collect();
        let voxels = |p: &[i32; 3]| p.map(|v| v as f32 / LATTICE as f32);
        let places: Vec<[f32; 3]> = points.iter().map(voxels).collect();
        let limits = Limits {
            triangles: left,
            error: f32::MAX,
        };
        let few = collapse(alone.triangles.clone(), &places, &locked, limits);
        let few = distinct(few, &points, |_| 0);
        let is_closed = alone
            .vertices
            .iter()
            .all(|&v| self.border.of_vertex[v as usize] == 0);
        // collapsed to nothing, or stuck
        let is_wrong = few.is_empty() || few.len() > 2 * left;
        let smallest = match is_wrong && is_closed {
            true => tetrahedron(&alone.triangles, &points),
            false => None,
        };
        let left = match smallest {
            Some(four) => four,
            None if few.is_empty() => distinct(alone.triangles.clone(), &points, |_| 0),
            None => few,
        };
        // what ends on a face of the volume and is smaller than a step comes back beside it, closed
        if left.is_empty() {
            return self.add_smallest(alone);
        }
        let mut numbers = vec![u32::MAX; points.len()];
        for t in left {
            let triangle = t.map(|v| {
                let number = &mut numbers[v as usize];
                if *number == u32::MAX {
                    *number = self.points.len() as u32;
                    self.points.push(points[v as usize]);
                    let own = alone.vertices[v as usize] as usize;
                    let normal = self.mesh.normals[own].map(i64::from);
                    let planes = self.border.of_vertex[own];
                    self.clusters
                        .add_one(self.mesh.surface_of[own], normal, planes);
                }
                *number
            });
            self.triangles.push(triangle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Tiling};
    use crate::lod::clusters::Kind;
    use crate::lod::mesh::{Surface, SurfaceKey};
    use crate::lod::tetrahedron::tests::solid;
    use crate::measure::Field;
    use crate::tile::Extras;

    /// An octahedron around a place, its corners so many lattice steps away.
    fn octahedron(middle: [i32; 3], reach: i32) -> Mesh {
        let corner = |i: usize| {
            let mut p = middle;
            p[i / 2] += if i.is_multiple_of(2) { reach } else { -reach };
            p
        };
        let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]];
        let lower = faces.map(|[a, b, _]| [b, a, 5]);
        let extras = Extras::ids(1, 1, 1, 8);
        Mesh {
            points: (0..6).map(corner).collect(),
            normals: vec![[0, 0, 32_767]; 6],
            surface_of: vec![0; 6],
            triangles: faces.into_iter().chain(lower).collect(),
            surfaces: vec![Surface {
                key: SurfaceKey::of(&extras),
                extras,
                triangles: 8,
            }],
        }
    }

    /// What comes back of a mesh of which nothing is left: clusters, their places, triangles.
    fn brought_back(mesh: &Mesh, planes: &Planes) -> (Clusters, Vec<[i32; 3]>, Vec<[u32; 3]>) {
        let border = Border::of(mesh, planes);
        let mut clusters = Clusters {
            all: Vec::new(),
            of_vertex: Vec::new(),
        };
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        Specks {
            mesh,
            border: &border,
            planes,
            open_faces: planes.faces,
            step: 32,
            block: 512,
            clusters: &mut clusters,
            points: &mut points,
            triangles: &mut triangles,
            room: 100,
        }
        .bring_back();
        (clusters, points, triangles)
    }

    /// Half of an octahedron, whose rim lies on a face of the volume: what comes back of it is known to lie there, so
    /// that it is not moved off it.
    #[test]
    fn what_lies_on_a_face_stays_on_it() {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let planes = Planes::of(tiling, 1, [0; 3]);
        let mut mesh = octahedron([2000, 3000, 0], 400);
        mesh.triangles.retain(|t| !t.contains(&5));
        let (clusters, points, _) = brought_back(&mesh, &planes);
        assert!(
            points.iter().filter(|p| p[2] == 0).count() > 2,
            "{points:?}"
        );
        for (point, cluster) in points.iter().zip(&clusters.all) {
            assert_eq!(cluster.kind == Kind::Stays, point[2] == 0, "{point:?}");
        }
    }

    /// A pore of one voxel that lies in two nodes: each has a whole one of its own, but not of a larger cell.
    #[test]
    fn what_two_nodes_share_comes_back_if_it_is_small() {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [10; 3],
        };
        let planes = Planes::of(tiling, 1, [0; 3]);
        let mut mesh = octahedron([20 * 256, 3000, 4000], 3);
        mesh.triangles.retain(|t| !t.contains(&0));
        for (voxels, left) in [(1, LEAST), (500, 0)] {
            mesh.surfaces[0].extras.measures[0] = Some(Field::Count(voxels));
            let (_, points, triangles) = brought_back(&mesh, &planes);
            assert_eq!(triangles.len(), left);
            let (volume, closed) = solid(&points, &triangles);
            assert!(closed && (volume > 0.0) == (left > 0), "{volume}");
            assert!(points.iter().all(|p| planes.bits(*p) == 0), "{points:?}");
        }
    }

    /// A pore of one voxel that the face of the volume cuts.
    #[test]
    fn what_ends_on_a_face_comes_back_however_small() {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let planes = Planes::of(tiling, 1, [0; 3]);
        for inverted in [false, true] {
            let mut mesh = octahedron([2000, 3000, 0], 3);
            mesh.triangles.retain(|t| !t.contains(&5));
            if inverted {
                mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
            }
            let (_, points, triangles) = brought_back(&mesh, &planes);
            assert_eq!(triangles.len(), LEAST);
            let (volume, closed) = solid(&points, &triangles);
            assert!(closed && (volume < 0.0) == inverted, "{volume}");
            assert!(points.iter().all(|p| planes.bits(*p) == 0), "{points:?}");
        }
    }

    #[test]
    fn the_smallest_are_given_up_first() {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let planes = Planes::of(tiling, 1, [0; 3]);
        let mut mesh = Mesh::default();
        for (i, reach) in [900, 300, 600].into_iter().enumerate() {
            let other = octahedron([2000, 3000, 4000], reach);
            let first = mesh.points.len() as u32;
            mesh.points.extend(other.points);
            mesh.normals.extend(other.normals);
            mesh.surface_of.extend([i as u32; 6]);
            mesh.triangles
                .extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
            mesh.surfaces.extend(other.surfaces);
        }
        let border = Border::of(&mesh, &planes);
        for (most, block, left) in [
            (24, 5000, 24),
            (23, 5000, 16),
            (17, 5000, 8),
            (1, 1100, 8),
            (1, 650, 16),
            (1, 350, 24),
        ] {
            let mut clusters = Clusters {
                all: Vec::new(),
                of_vertex: Vec::new(),
            };
            mesh.surface_of
                .iter()
                .for_each(|s| clusters.add_one(*s, [0, 0, 1], 0));
            let (mut points, mut triangles) = (mesh.points.clone(), mesh.triangles.clone());
            Specks {
                mesh: &mesh,
                border: &border,
                planes: &planes,
                open_faces: planes.faces,
                step: 32,
                block,
                clusters: &mut clusters,
                points: &mut points,
                triangles: &mut triangles,
                room: 100,
            }
            .give_up(most);
            assert_eq!(triangles.len(), left, "{most} {block}");
            // the largest stays longest
            assert!(triangles.iter().any(|t| t[0] < 6));
        }
    }

    #[test]
    fn what_is_gone_comes_back_however_small_and_wherever_it_lies() {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let planes = Planes::of(tiling, 1, [0; 3]);
        for (reach, inverted) in [(400, false), (3, false), (3, true)] {
            for middle in [[2000, 3000, 4000], [40 * 256 - 4, 5, 40 * 256 - 5]] {
                let mut mesh = octahedron(middle, reach.min(if middle[1] == 5 { 3 } else { 400 }));
                if inverted {
                    mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
                }
                let before = solid(&mesh.points, &mesh.triangles);
                let (clusters, points, triangles) = brought_back(&mesh, &planes);
                assert!((LEAST..=8).contains(&triangles.len()), "{triangles:?}");
                assert_eq!(clusters.all.len(), points.len());
                let (volume, closed) = solid(&points, &triangles);
                assert!(closed && volume * before.0 > 0.0, "{volume} {before:?}");
                let is_inside =
                    |p: &[i32; 3]| planes.bits(*p) == 0 && p.iter().all(|v| v % 32 == 0);
                assert!(points.iter().all(is_inside), "{points:?}");
            }
        }
    }
}
