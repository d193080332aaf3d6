//! Closes the surface: the triangles of the cubes around the volume, whose outer voxels count as
//! below. Vertices on edges that lead out lie half a voxel outside.
//!
//! Caps are few next to the surface, so this is the plain way, with hash maps. The triangles are
//! pieces of their own; vertices on the volume's faces, which the open surface has too, appear in
//! both with the same bits.

use crate::grid::LATTICE;
use crate::strip::connect;
use crate::surface::assign_pieces::{CAP, Piece};
use crate::surface::case_table::{Case, EDGE_LOWER, cases, edge_axis};
use crate::surface::mesher::{BandView, MeshSettings, TileBox, TileMesh};
use crate::surface::sums::sum_pieces;
use crate::surface::vertex::{Stencil, normal, step_on_edge};
use crate::volume::{Slope, Voxel};
use std::collections::HashMap;

/// A lattice edge by its lower voxel, which may lie outside, and axis.
type EdgeKey = ([i32; 3], usize);

/// Position in lattice steps and unit normal.
type Vertex = ([i32; 3], [f32; 3]);

/// One cap piece while it is made.
#[derive(Default)]
struct CapPiece {
    vertex_of: HashMap<EdgeKey, u32>,
    vertices: Vec<EdgeKey>,
    triangles: Vec<[u32; 3]>,
}

/// Adds the cap pieces of a tile to its mesh.
pub fn add_caps<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    settings: &MeshSettings,
    out: &mut TileMesh,
) {
    let caps = Caps {
        view,
        tile,
        settings,
    };
    let table = cases(settings.rule);
    let mut number: HashMap<u32, usize> = HashMap::new();
    let mut made: Vec<(u32, CapPiece)> = Vec::new();
    caps.for_each_ring_cube(|cube| {
        let case = caps.case(cube);
        let Case {
            triangles, edges, ..
        } = table[case];
        for corners in &edges[..triangles as usize] {
            let keys = corners.map(|e| edge_key(cube, e));
            let object = caps.object(keys[0]);
            let at = *number.entry(object).or_insert_with(|| {
                made.push((object, CapPiece::default()));
                made.len() - 1
            });
            made[at].1.add(keys);
        }
    });
    let first = out.pieces.len();
    for (object, piece) in &made {
        caps.append(*object, piece, out);
    }
    let keys = made.iter().flat_map(|(_, piece)| &piece.vertices);
    let vertices: Vec<Vertex> = keys.map(|&key| caps.vertex(key)).collect();
    out.chunk.extend(&vertices);
    sum_pieces(
        &mut out.pieces[first..],
        out.chunk.numbers(),
        &out.triangles,
        &settings.area,
    );
}

fn edge_key(cube: [i32; 3], e: u8) -> EdgeKey {
    let low = EDGE_LOWER[e as usize];
    let corner = [low & 1, low >> 1 & 1, low >> 2 & 1];
    (
        std::array::from_fn(|a| cube[a] + i32::from(corner[a])),
        edge_axis(e),
    )
}

impl CapPiece {
    fn add(&mut self, keys: [EdgeKey; 3]) {
        let corners = keys.map(|key| {
            *self.vertex_of.entry(key).or_insert_with(|| {
                self.vertices.push(key);
                self.vertices.len() as u32 - 1
            })
        });
        self.triangles.push(corners);
    }
}

struct Caps<'a, 'b, T> {
    view: &'a BandView<'b, T>,
    tile: &'a TileBox,
    settings: &'a MeshSettings,
}

impl<T: Voxel> Caps<'_, '_, T> {
    fn n(&self, axis: usize) -> i32 {
        self.tile.dims.0[axis] as i32
    }

    /// Calls `each` for the cubes outside the grid that belong to this tile, by z, y, x: macrocubes
    /// at the grid's end reach one cube further.
    fn for_each_ring_cube(&self, mut each: impl FnMut([i32; 3])) {
        let range = |a: usize| {
            let first = self.tile.first_cube[a] as i32;
            let end = first + self.tile.cubes[a] as i32;
            (if first == 0 { -1 } else { first })..(if self.tile.is_last[a] {
                end + 1
            } else {
                end
            })
        };
        let outer = |v: i32, a: usize| v == -1 || v == self.n(a) - 1;
        for z in range(2) {
            for y in range(1) {
                if outer(y, 1) || outer(z, 2) {
                    range(0).for_each(|x| each([x, y, z]));
                } else {
                    range(0)
                        .filter(|&x| outer(x, 0))
                        .for_each(|x| each([x, y, z]));
                }
            }
        }
    }

    /// True if the voxel is in the grid.
    fn inside(&self, v: [i32; 3]) -> bool {
        (0..3).all(|a| (0..self.n(a)).contains(&v[a]))
    }

    fn above(&self, v: [i32; 3]) -> bool {
        if !self.inside(v) {
            return false;
        }
        let [x, y, z] = v.map(|c| c as usize);
        let bits = self.view.bits;
        let row = bits.row(
            z - bits.span.z.start as usize,
            y - bits.span.y.start as usize,
        );
        row[x / 64] >> (x % 64) & 1 == 1
    }

    fn case(&self, cube: [i32; 3]) -> usize {
        (0..8).fold(0, |case, c| {
            let corner = [
                cube[0] + (c & 1),
                cube[1] + (c >> 1 & 1),
                cube[2] + (c >> 2),
            ];
            case | usize::from(self.above(corner)) << c
        })
    }

    fn upper(&self, (lower, axis): EdgeKey) -> [i32; 3] {
        let mut upper = lower;
        upper[axis] += 1;
        upper
    }

    /// Class of the object at the edge's above end, which is always inside the grid.
    fn object(&self, key: EdgeKey) -> u32 {
        let v = if self.above(key.0) {
            key.0
        } else {
            self.upper(key)
        };
        let local: [usize; 3] =
            std::array::from_fn(|a| (v[a] - self.tile.first_cube[a] as i32) as usize);
        self.view.class_at(self.tile, local)
    }

    fn leads_out(&self, key: EdgeKey) -> bool {
        !(self.inside(key.0) && self.inside(self.upper(key)))
    }

    fn vertex(&self, key: EdgeKey) -> Vertex {
        let (lower, axis) = key;
        let mut position = lower.map(|v| v * LATTICE as i32);
        if self.leads_out(key) {
            position[axis] += LATTICE as i32 / 2;
            let mut out = [0.0; 3];
            out[axis] = if self.above(lower) { 1.0 } else { -1.0 };
            return (position, out);
        }
        let voxels = self.view.voxels;
        let samples = voxels.samples();
        let strides = [
            1,
            voxels.span.nx as usize,
            voxels.span.nx as usize * voxels.span.rows(),
        ];
        let [nx, ny, nz] = self.tile.dims.0;
        let gradient = |v: [i32; 3]| {
            let [x, y, z] = v.map(|c| c as u32);
            let p = voxels.row_start(y, z) + x as usize;
            let stencil = Stencil::new([y, z], [ny, nz], [strides[1], strides[2]]);
            (
                samples[p].to_f64(),
                stencil.gradient(samples, p, x, nx).map(Slope::to_f32),
            )
        };
        let ((v0, g0), (v1, g1)) = (gradient(lower), gradient(self.upper(key)));
        let step = step_on_edge(v0, v1, self.settings.threshold);
        position[axis] += step as i32;
        (position, normal(g0, g1, step, axis, self.above(lower)))
    }

    /// True if this tile counts the vertex: the open surface has those inside, the next tile those
    /// on a shared plane.
    fn counts(&self, key: EdgeKey) -> bool {
        let shared = |a: usize| {
            let upper = self.tile.first_cube[a] + self.tile.cubes[a];
            key.0[a] == upper as i32 && !self.tile.is_last[a]
        };
        self.leads_out(key) && !(0..3).any(shared)
    }

    /// Adds a piece to the mesh, but for its vertices and sums.
    fn append(&self, object: u32, cap: &CapPiece, out: &mut TileMesh) {
        let mut piece = Piece::new(object, CAP);
        piece.first_vertex = out.pieces.last().map_or(0, |p| p.first_vertex + p.vertices);
        piece.vertices = cap.vertices.len() as u32;
        let faces = out.pieces.last().map_or(0, Piece::end_of_faces);
        out.triangles.truncate(faces as usize);
        piece.first_triangle = faces;
        piece.triangles = cap.triangles.len() as u32;
        let counted = cap.vertices.iter().filter(|&&key| self.counts(key));
        piece.sums.vertices = counted.count() as u64;
        out.triangles.extend(connect(&cap.triangles));
        out.pieces.push(piece);
    }
}
