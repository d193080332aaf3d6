//! The mesh of a node in the making: what its children hold, joined where they meet.

use super::planes::Planes;
use crate::tile::Extras;
use crate::tile::node::SurfacePart;
use std::collections::HashMap;

/// Steps in a component of a normal that is summed: whole numbers, so that the order of sums does not show.
pub const NORMAL: f32 = 32_767.0;

/// Which surface a part belongs to; a cap, of which there is one to an object, has cell and surface 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SurfaceKey {
    /// Caps come last.
    pub is_cap: bool,
    pub surface: u64,
    pub cell: u64,
    pub object: u64,
}

impl SurfaceKey {
    /// Of a part with these ids.
    pub fn of(extras: &Extras) -> Self {
        SurfaceKey {
            is_cap: extras.cell == 0,
            surface: extras.surface,
            cell: extras.cell,
            object: extras.object,
        }
    }
}

/// A surface of a node.
#[derive(Debug, Clone)]
pub struct Surface {
    pub key: SurfaceKey,
    /// Ids and measures as its parts have them.
    pub extras: Extras,
    /// Triangles of the children.
    pub triangles: usize,
}

/// Triangles of some surfaces. Vertices belong to one surface each.
#[derive(Debug, Default, Clone)]
pub struct Mesh {
    /// Vertices in lattice steps.
    pub points: Vec<[i32; 3]>,
    /// Normals, of length 32,767.
    pub normals: Vec<[i16; 3]>,
    /// The surface of each vertex.
    pub surface_of: Vec<u32>,
    pub triangles: Vec<[u32; 3]>,
    pub surfaces: Vec<Surface>,
}

/// Joins the parts of a node's children, one after another.
pub struct Joiner<'a> {
    /// Where they meet, and where the node ends.
    planes: &'a Planes,
    mesh: Mesh,
    numbers: HashMap<SurfaceKey, u32>,
    /// Vertices on planes of the children, by surface and place.
    on_planes: HashMap<(u32, [i32; 3]), u32>,
    map: Vec<u32>,
}

impl<'a> Joiner<'a> {
    /// Of nothing yet; `planes` are those of the node.
    pub fn new(planes: &'a Planes) -> Self {
        Joiner {
            planes,
            mesh: Mesh::default(),
            numbers: HashMap::new(),
            on_planes: HashMap::new(),
            map: Vec::new(),
        }
    }

    /// Adds what a child holds. Vertices of a surface at one place on a plane of children are one; triangles that
    /// have no three corners then are left out.
    pub fn add(&mut self, parts: Vec<SurfacePart>) {
        let new: usize = parts.iter().map(|p| p.points.len()).sum();
        let triangles: usize = parts.iter().map(|p| p.triangles.len()).sum();
        self.mesh.points.reserve(new);
        self.mesh.normals.reserve(new);
        self.mesh.surface_of.reserve(new);
        self.mesh.triangles.reserve(triangles);
        for part in parts {
            let surface = self.surface(&part);
            self.map.clear();
            for (&point, normal) in part.points.iter().zip(&part.normals) {
                let vertex = self.vertex(surface, point, normal);
                self.map.push(vertex);
            }
            let mapped = part
                .triangles
                .iter()
                .map(|t| t.map(|v| self.map[v as usize]));
            let proper = mapped.filter(|[a, b, c]| a != b && b != c && a != c);
            let before = self.mesh.triangles.len();
            self.mesh.triangles.extend(proper);
            let added = self.mesh.triangles.len() - before;
            self.mesh.surfaces[surface as usize].triangles += added;
        }
    }

    fn surface(&mut self, part: &SurfacePart) -> u32 {
        let key = SurfaceKey::of(&part.extras);
        let surfaces = &mut self.mesh.surfaces;
        *self.numbers.entry(key).or_insert_with(|| {
            surfaces.push(Surface {
                key,
                extras: part.extras.clone(),
                triangles: 0,
            });
            surfaces.len() as u32 - 1
        })
    }

    fn vertex(&mut self, surface: u32, point: [i32; 3], normal: &[f32; 3]) -> u32 {
        let next = self.mesh.points.len() as u32;
        if self.planes.is_on_any(point) {
            let known = *self.on_planes.entry((surface, point)).or_insert(next);
            if known != next {
                return known;
            }
        }
        self.mesh.points.push(point);
        let steps = normal.map(|c| (c * NORMAL).round() as i16);
        self.mesh.normals.push(steps);
        self.mesh.surface_of.push(surface);
        next
    }

    /// The mesh of all children.
    pub fn finish(self) -> Mesh {
        self.mesh
    }
}
