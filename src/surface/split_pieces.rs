//! Pieces of components that hold several cells, split into a piece for each cell.
//!
//! A triangle belongs to the cell of the below end of its vertex with the smallest lattice key, whatever the tile.
//! Vertices between two cells are in the pieces of both, with the same bits. Each is counted once, with a cell that does
//! not depend on the tile either: of the cubes around it the last one by z, y and x counts, which the tile that counts the
//! vertex has, and of the triangles at it in that cube the one of the smallest cell.

use crate::labels::BandCells;
use crate::strip::{NONE, STRIDE, Triangle};
use crate::surface::assign_pieces::{Piece, VertexAssignment};
use crate::surface::edges::Edges;
use crate::surface::mesher::{BandView, CellsView, Sizes, TileBox, TileMesh, room};
use crate::surface::vertex_shares::{LAST, Shares};
use foldhash::fast::RandomState;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::ops::Range;

/// Bytes of buffers for each crossed edge of a tile whose pieces may be split: what is known of its vertex, of its two
/// triangles, and of the parts that have it where they are several.
pub const BYTES_PER_SPLIT_VERTEX: u64 = 128;

/// Splits pieces; its buffers are used again from tile to tile. What they take follows vertices, triangles and parts.
///
/// Triangles and vertices are gone through in their order, which is that of places: what is asked of one's neighbours is
/// near then. Few vertices are in several parts, and only these need more than one number.
#[derive(Debug, Default)]
pub struct PieceSplitter {
    /// What is known of the edge of each vertex.
    ends: Vec<End>,
    cells: CellNumbers,
    /// Of each cell the part that was begun last for it.
    part_of_cell: Vec<u32>,
    /// Of each vertex the only part that has it, or [`NO_PART`], or [`SEVERAL`].
    part_of_vertex: Vec<u32>,
    /// Of each vertex its number in its part; of those that several parts have, the first of its `shares`.
    vertex_of: Vec<u32>,
    /// The vertices of several parts.
    shares: Shares,
    /// Of each triangle, piece by piece, its part and its number in that, from 1.
    places: Vec<[u32; 2]>,
    /// The parts of all pieces. Those of a piece stand by their first triangles until all are filled, then by their cells.
    parts: Vec<Piece>,
    vertices: PartVertices,
    triangles: Vec<Triangle>,
}

/// No part has the vertex.
const NO_PART: u32 = u32::MAX;
/// More than one part has the vertex.
const SEVERAL: u32 = u32::MAX - 1;
/// Marks a vertex that the next tile counts, beside the number of its cell.
const NEXT_TILE: u32 = 1 << 31;

/// Numbers of the different cells of a tile, in any order.
#[derive(Debug, Default)]
struct CellNumbers {
    number_of: HashMap<u64, u32, RandomState>,
    ids: Vec<u64>,
    /// The one that was asked for last.
    last: Option<(u64, u32)>,
}

impl CellNumbers {
    fn clear(&mut self) {
        self.number_of.clear();
        self.ids.clear();
        self.last = None;
    }

    /// The number of a cell, which may be new.
    fn number(&mut self, id: u64) -> u32 {
        match self.last {
            Some((last, number)) if last == id => number,
            _ => {
                let next = self.ids.len() as u32;
                let number = *self.number_of.entry(id).or_insert(next);
                if number == next {
                    self.ids.push(id);
                }
                self.last = Some((id, number));
                number
            }
        }
    }
}

/// The vertices of all parts.
#[derive(Debug, Default)]
struct PartVertices {
    /// How many of each part there are.
    counts: Vec<u32>,
    /// Their positions, and their normals.
    vectors: [Vec<[f32; 3]>; 2],
}

impl PartVertices {
    fn begin(&mut self, parts: usize, vertices: usize) {
        self.counts.clear();
        self.counts.resize(parts, 0);
        for vectors in &mut self.vectors {
            room(vectors, vertices, 0);
        }
    }

    /// Adds a vertex to the part `number`; returns its number there.
    fn place(&mut self, part: &Piece, number: u32, vectors: [[f32; 3]; 2]) -> u32 {
        let count = &mut self.counts[number as usize];
        let at = part.first_vertex + *count;
        *count += 1;
        for (all, vector) in self.vectors.iter_mut().zip(vectors) {
            all[at as usize] = vector;
        }
        at - part.first_vertex
    }
}

/// What is known of a vertex by the lattice edge that it lies on.
#[derive(Debug, Clone, Copy, Default)]
struct End {
    /// The key of the edge.
    key: u64,
    /// The number of the cell at the below end of the edge, with [`NEXT_TILE`].
    cell: u32,
}

impl End {
    fn cell(self) -> u32 {
        self.cell & !NEXT_TILE
    }

    /// Whether this tile counts the vertex.
    fn is_counted(self) -> bool {
        self.cell & NEXT_TILE == 0
    }
}

impl PieceSplitter {
    /// Gives each piece of the open surface its cell, and splits those that have several; they are to be summed up then.
    ///
    /// # Errors
    /// The sizes of the mesh with all parts, if it does not fit; `out` has no meaning then.
    pub fn split<T>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        cells: &CellsView,
        found: (&Edges, &VertexAssignment),
        out: &mut TileMesh,
    ) -> Result<(), Sizes> {
        let mut all_known = true;
        for piece in &mut out.pieces {
            match cells.of_class[piece.cell as usize] {
                Some(cell) => piece.given = cell,
                None => all_known = false,
            }
        }
        if all_known {
            return Ok(());
        }
        self.find_ends(view, tile, cells.of_voxels, found);
        let mut any = false;
        for piece in &mut out.pieces {
            let ends = &self.ends[piece.first_vertex as usize..][..piece.vertices as usize];
            let first = ends.first().map_or(0, |end| end.cell());
            piece.given = ends.first().map_or(0, |_| self.cells.ids[first as usize]);
            any |= ends.iter().any(|end| end.cell() != first);
        }
        if !any {
            return Ok(());
        }
        let ends_of_parts = self.find_parts(out);
        let sizes = self.lay_out(&ends_of_parts);
        if !(cells.fits)(&sizes) {
            return Err(sizes);
        }
        self.make_parts(&sizes, tile, out);
        out.pieces.clear();
        out.pieces.append(&mut self.parts);
        std::mem::swap(&mut out.triangles, &mut self.triangles);
        out.chunk.begin(sizes.vertices as usize);
        for (to, from) in out
            .chunk
            .vectors_mut()
            .into_iter()
            .zip(&self.vertices.vectors)
        {
            to.copy_from_slice(&from[..to.len()]);
        }
        Ok(())
    }

    /// Finds the cell and the key of each vertex.
    fn find_ends<T>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        cells: &BandCells,
        (edges, assigned): (&Edges, &VertexAssignment),
    ) {
        self.cells.clear();
        self.ends.clear();
        self.ends.resize(edges.count(), End::default());
        let span = &view.bits.span;
        let [first_x, first_y, first_z] = tile.first_cube;
        let band_row = |y: usize, z: usize| {
            let (r, s) = (first_y - span.y.start, first_z - span.z.start);
            (s as usize + z) * span.rows() + r as usize + y
        };
        let mut number = 0;
        for (row, [y, z], words) in edges.crossed_rows() {
            let key = 3 * tile.linear([0, y, z]);
            let bits = &edges.bits[row * edges.row_words..][..edges.row_words];
            for axis in 0..3 {
                for (w, word) in words.iter().enumerate() {
                    let mut crossed = word[axis];
                    while crossed != 0 {
                        let bit = crossed.trailing_zeros();
                        crossed &= crossed - 1;
                        let x = 64 * w as u32 + bit;
                        let to_upper = u32::from(bits[w] >> bit & 1 == 1);
                        let mut below = [x, y as u32, z as u32];
                        below[axis] += to_upper;
                        let row = band_row(below[1] as usize, below[2] as usize);
                        let vertex = assigned.first_of[assigned.piece_of[number] as usize]
                            + assigned.vertex_of[number];
                        let place = [x as usize, y, z];
                        let shared = (0..3).any(|a| a != axis && tile.shares_upper(a, place[a]));
                        let cell = self.cells.number(cells.at(row, below[0] + first_x));
                        self.ends[vertex as usize] = End {
                            key: key + 3 * u64::from(x) + axis as u64,
                            cell: cell | if shared { NEXT_TILE } else { 0 },
                        };
                        number += 1;
                    }
                }
            }
        }
    }

    /// Finds the parts of all pieces with what they count, and the numbers of their triangles. Returns for each piece
    /// where its parts end.
    fn find_parts(&mut self, mesh: &TileMesh) -> Vec<u32> {
        self.parts.clear();
        self.places.clear();
        self.shares.clear();
        self.part_of_cell.clear();
        self.part_of_cell.resize(self.cells.ids.len(), NO_PART);
        self.part_of_vertex.clear();
        self.part_of_vertex.resize(self.ends.len(), NO_PART);
        self.vertex_of.clear();
        self.vertex_of.resize(self.ends.len(), LAST);
        let positions = mesh.chunk.numbers().as_chunks::<3>().0;
        let mut ends_of_parts = Vec::with_capacity(mesh.pieces.len());
        for piece in &mesh.pieces {
            let faces = &mesh.triangles[piece.faces()][1..];
            let own = self.places.len();
            self.part_triangles(piece, faces);
            self.share_vertices(piece, faces, own, positions);
            self.count_vertices(piece);
            ends_of_parts.push(self.parts.len() as u32);
        }
        ends_of_parts
    }

    /// Gives each triangle of a piece to the part of its cell.
    fn part_triangles(&mut self, piece: &Piece, faces: &[Triangle]) {
        let before = self.parts.len();
        let own = piece.first_vertex as usize..(piece.first_vertex + piece.vertices) as usize;
        let ends = &self.ends[own.clone()];
        let part_of_vertex = &mut self.part_of_vertex[own];
        for triangle in faces {
            let corners = triangle.corners().map(|v| v as usize);
            let cell = cell(corners.map(|v| ends[v]));
            let known = &mut self.part_of_cell[cell as usize];
            if *known == NO_PART || (*known as usize) < before {
                *known = self.parts.len() as u32;
                let mut part = Piece::new(piece.object, piece.cell);
                part.given = self.cells.ids[cell as usize];
                self.parts.push(part);
            }
            let part = *known;
            let count = &mut self.parts[part as usize].triangles;
            *count += 1;
            self.places.push([part, *count]);
            for v in corners {
                let known = &mut part_of_vertex[v];
                *known = match *known == NO_PART || *known == part {
                    true => part,
                    false => SEVERAL,
                };
            }
        }
    }

    /// Lists the parts of each vertex of a piece that several of them have; `own` is the place of its first triangle.
    fn share_vertices(
        &mut self,
        piece: &Piece,
        faces: &[Triangle],
        own: usize,
        positions: &[[f32; 3]],
    ) {
        let first = piece.first_vertex as usize;
        for (triangle, &[part, _]) in faces.iter().zip(&self.places[own..]) {
            let corners = triangle.corners().map(|v| first + v as usize);
            if corners.iter().all(|&v| self.part_of_vertex[v] != SEVERAL) {
                continue;
            }
            let cube = cube(corners.map(|v| positions[v]));
            for v in corners
                .into_iter()
                .filter(|&v| self.part_of_vertex[v] == SEVERAL)
            {
                self.shares.add(&mut self.vertex_of[v], part, cube);
            }
        }
    }

    /// Counts the vertices of the parts of a piece, and finds their smallest keys.
    fn count_vertices(&mut self, piece: &Piece) {
        let parts = &mut self.parts;
        let mut add = |part: u32, end: End| {
            let part = &mut parts[part as usize];
            part.vertices += 1;
            part.key = part.key.min(end.key);
        };
        for v in (piece.first_vertex..).take(piece.vertices as usize) {
            let v = v as usize;
            match self.part_of_vertex[v] {
                NO_PART => {}
                SEVERAL => self
                    .shares
                    .of(self.vertex_of[v])
                    .for_each(|share| add(share.part, self.ends[v])),
                part => add(part, self.ends[v]),
            }
        }
    }

    /// Says where each part is to lie: those of a piece by their cells. Returns what all of them have.
    fn lay_out(&mut self, ends_of_parts: &[u32]) -> Sizes {
        let mut order: Vec<u32> = (0..self.parts.len() as u32).collect();
        let mut first = 0;
        let (mut vertices, mut triangles) = (0, 0);
        for &end in ends_of_parts {
            let own = &mut order[first..end as usize];
            own.sort_unstable_by_key(|&part| self.parts[part as usize].given);
            for &part in &*own {
                let part = &mut self.parts[part as usize];
                part.first_vertex = vertices as u32;
                part.first_triangle = triangles;
                vertices += u64::from(part.vertices);
                triangles += 1 + part.triangles;
            }
            first = end as usize;
        }
        Sizes {
            vertices,
            pieces: self.parts.len() as u64,
        }
    }

    /// Fills the parts with their vertices and triangles, which have their places by then.
    fn make_parts(&mut self, sizes: &Sizes, tile: &TileBox, mesh: &TileMesh) {
        self.vertices
            .begin(self.parts.len(), sizes.vertices as usize);
        let faces = self.parts.iter().map(Piece::end_of_faces).max();
        room(&mut self.triangles, faces.unwrap_or(0) as usize, 0);
        let mut own = 0;
        for piece in &mesh.pieces {
            self.place_vertices(piece, mesh);
            let places = own..own + piece.triangles as usize;
            own = places.end;
            self.place_triangles(piece, places, tile, mesh);
        }
        self.parts.sort_unstable_by_key(|part| part.first_triangle);
    }

    /// Numbers the vertices of a piece in their parts, and counts those that this tile counts.
    fn place_vertices(&mut self, piece: &Piece, mesh: &TileMesh) {
        let (positions, normals) = mesh.chunk.numbers().split_at(3 * mesh.chunk.vertices());
        let from = [positions, normals].map(|numbers| numbers.as_chunks::<3>().0);
        for v in piece.first_vertex as usize..(piece.first_vertex + piece.vertices) as usize {
            let counted = u64::from(self.ends[v].is_counted());
            let vectors = from.map(|vectors| vectors[v]);
            match self.part_of_vertex[v] {
                NO_PART => {}
                SEVERAL => {
                    let list = self.vertex_of[v];
                    // ids of parts differ
                    let last = self
                        .shares
                        .of(list)
                        .max_by_key(|s| (s.cube, Reverse(self.parts[s.part as usize].given)));
                    let with = last.expect("several parts").part;
                    self.parts[with as usize].sums.vertices += counted;
                    let place = |part| {
                        self.vertices
                            .place(&self.parts[part as usize], part, vectors)
                    };
                    self.shares.number(list, place);
                }
                part => {
                    self.parts[part as usize].sums.vertices += counted;
                    self.vertex_of[v] =
                        self.vertices
                            .place(&self.parts[part as usize], part, vectors);
                }
            }
        }
    }

    /// Brings the triangles of a piece to their parts; `own` are their places.
    fn place_triangles(
        &mut self,
        piece: &Piece,
        own: Range<usize>,
        tile: &TileBox,
        mesh: &TileMesh,
    ) {
        let first = piece.first_vertex as usize;
        let faces = &mesh.triangles[piece.faces()][1..];
        let positions = &mesh.chunk.numbers().as_chunks::<3>().0[first..];
        let places = &self.places[own];
        for (triangle, &[part, number]) in faces.iter().zip(places) {
            let corners = triangle.corners().map(|v| {
                let v = first + v as usize;
                match self.part_of_vertex[v] == SEVERAL {
                    true => self.shares.number_in(self.vertex_of[v], part),
                    false => self.vertex_of[v],
                }
            });
            // across the border of a part is none
            let mates = triangle.mates.map(|mate| {
                if mate == NONE {
                    return NONE;
                }
                let [other, place] = places[(mate / STRIDE) as usize - 1];
                match other == part {
                    true => STRIDE * place + mate % STRIDE,
                    false => NONE,
                }
            });
            let part = &mut self.parts[part as usize];
            part.sums.border_edges += on_border(triangle, positions, tile);
            self.triangles[(part.first_triangle + number) as usize] = Triangle::new(corners, mates);
        }
    }
}

/// The number of the cell of a triangle: that of its vertex with the smallest key.
fn cell([a, b, c]: [End; 3]) -> u32 {
    let lower = if b.key < a.key { b } else { a };
    let lowest = if c.key < lower.key { c } else { lower };
    lowest.cell()
}

/// The cube of a triangle by its corners, in voxels: z, y and x, 21 bits each.
fn cube(corners: [[f32; 3]; 3]) -> u64 {
    let [x, y, z] = [0, 1, 2].map(|a| {
        // no triangle lies in a face of its cube
        corners[0][a].min(corners[1][a]).min(corners[2][a]) as u64
    });
    (z << 42) | (y << 21) | x
}

/// Edges of a triangle that lie on the faces of the volume; `positions` are those of its piece.
fn on_border(triangle: &Triangle, positions: &[[f32; 3]], tile: &TileBox) -> u64 {
    let corners = triangle.corners();
    let outer = |edge: usize| {
        let ends = [corners[edge], corners[(edge + 1) % 3]].map(|v| positions[v as usize]);
        (0..3).any(|a| {
            let last = tile.dims.0[a] as f32 - 1.0;
            ends[0][a] == ends[1][a] && (ends[0][a] == 0.0 || ends[0][a] == last)
        })
    };
    let edges = (0..3).filter(|&edge| triangle.mates[edge] == NONE && outer(edge));
    edges.count() as u64
}
