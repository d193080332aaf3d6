//! Pieces of components that hold several cells, split into a piece for each cell.
//!
//! A triangle belongs to the cell of the below end of its vertex with the smallest lattice key, whatever the tile.
//! Vertices between two cells are in the pieces of both, with the same bits. Each is counted once, with a cell that does
//! not depend on the tile either: of the cubes around it the last one by z, y and x counts, which the tile that counts the
//! vertex has, and of the triangles at it in that cube the one of the smallest cell.

use crate::labels::BandCells;
use crate::strip::{NONE, STRIDE, Triangle};
use crate::surface::assign_pieces::{Piece, VertexAssignment};
use crate::surface::cell_numbers::CellNumbers;
use crate::surface::edges::Edges;
use crate::surface::mesher::{BandView, CellsView, Sizes, TileBox, TileMesh, room};
use crate::surface::vertex_shares::{LAST, Shares};
use std::cmp::Reverse;
use std::ops::Range;

/// Bytes of buffers for each crossed edge of a tile whose pieces may be split: what is known of its vertex, of its two
/// triangles, and of the parts that have it where they are several.
pub const BYTES_PER_SPLIT_VERTEX: u64 = 128;

/// Splits pieces; its buffers are used again from tile to tile. What they take follows vertices, triangles and parts.
///
/// Triangles and vertices are gone through in their order, which is that of places: what is asked of one's neighbours is
/// near then, and those of a part come in long stretches. Nearly all triangles have three vertices of one cell. Vertices
/// of the others may be in several parts, and only these need more than one number.
#[derive(Debug, Default)]
pub struct PieceSplitter {
    /// The lattice key of each vertex.
    key_of_vertex: Vec<u64>,
    /// The number of the cell at the below end of the edge of each vertex, with [`NEXT_TILE`].
    cell_of_vertex: Vec<u32>,
    cells: CellNumbers,
    /// Of each cell the part that was begun last for it.
    part_of_cell: Vec<u32>,
    /// Of each vertex the only part that has it, or [`NO_PART`], or [`SEVERAL`].
    part_of_vertex: Vec<u32>,
    /// Of each vertex its number in its part; of those that several parts may have, the first of its `shares`.
    vertex_of: Vec<u32>,
    /// The vertices that several parts may have.
    shares: Shares,
    /// Of each triangle, piece by piece, its part.
    part_of_triangle: Vec<u32>,
    /// Of each triangle, piece by piece, its number in its part, from 1.
    number_of_triangle: Vec<u32>,
    /// The parts of all pieces. Those of a piece stand by their first triangles until all are filled, then by their cells.
    parts: Vec<Piece>,
    vertices: PartVertices,
    triangles: Vec<Triangle>,
}

/// No part has the vertex.
const NO_PART: u32 = u32::MAX;
/// The vertex has a triangle with vertices of several cells: more than one part may have it.
const SEVERAL: u32 = u32::MAX - 1;
/// Marks a vertex that the next tile counts, beside the number of its cell.
const NEXT_TILE: u32 = 1 << 31;

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
    #[inline(always)]
    fn place(&mut self, part: &Piece, number: u32, position: [f32; 3], normal: [f32; 3]) -> u32 {
        let count = &mut self.counts[number as usize];
        let own = *count;
        *count += 1;
        let at = (part.first_vertex + own) as usize;
        let [positions, normals] = &mut self.vectors;
        positions[at] = position;
        normals[at] = normal;
        own
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
            let cells = &self.cell_of_vertex[vertices(piece)];
            if let Some(first) = cells.first().map(|cell| cell & !NEXT_TILE) {
                piece.given = self.cells.ids[first as usize];
                any |= cells.iter().any(|cell| cell & !NEXT_TILE != first);
            }
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
        room(&mut self.key_of_vertex, edges.count(), 0);
        room(&mut self.cell_of_vertex, edges.count(), 0);
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
                        self.key_of_vertex[vertex as usize] = key + 3 * u64::from(x) + axis as u64;
                        self.cell_of_vertex[vertex as usize] =
                            cell | if shared { NEXT_TILE } else { 0 };
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
        self.part_of_triangle.clear();
        self.number_of_triangle.clear();
        self.shares.clear();
        self.part_of_cell.clear();
        self.part_of_cell.resize(self.cells.ids.len(), NO_PART);
        let vertices = mesh.chunk.vertices();
        self.part_of_vertex.clear();
        self.part_of_vertex.resize(vertices, NO_PART);
        self.vertex_of.clear();
        self.vertex_of.resize(vertices, LAST);
        let positions = mesh.chunk.numbers().as_chunks::<3>().0;
        let mut ends_of_parts = Vec::with_capacity(mesh.pieces.len());
        for piece in &mesh.pieces {
            let faces = &mesh.triangles[piece.faces()][1..];
            let (triangles, parts) = (self.part_of_triangle.len(), self.parts.len());
            if self.part_triangles(piece, faces) {
                self.share_vertices(piece, faces, triangles, positions);
            }
            self.count_vertices(piece, parts);
            ends_of_parts.push(self.parts.len() as u32);
        }
        ends_of_parts
    }

    /// Gives each triangle of a piece to the part of its cell, and marks the vertices of those that have several. Returns
    /// whether there are such.
    fn part_triangles(&mut self, piece: &Piece, faces: &[Triangle]) -> bool {
        let before = self.parts.len();
        let own = vertices(piece);
        let (cells, keys) = (
            &self.cell_of_vertex[own.clone()],
            &self.key_of_vertex[own.clone()],
        );
        let part_of_vertex = &mut self.part_of_vertex[own];
        let mut any = false;
        let (mut last, mut part, mut count) = (None, 0, 0);
        for triangle in faces {
            let corners = triangle.corners().map(|v| v as usize);
            let of = corners.map(|v| cells[v] & !NEXT_TILE);
            let mut cell = of[0];
            if of[1] != cell || of[2] != cell {
                any = true;
                cell = cell_of_lowest(of, corners.map(|v| keys[v]));
                for v in corners {
                    part_of_vertex[v] = SEVERAL;
                }
            }
            if last != Some(cell) {
                if last.replace(cell).is_some() {
                    self.parts[part as usize].triangles = count;
                }
                let known = &mut self.part_of_cell[cell as usize];
                if *known == NO_PART || (*known as usize) < before {
                    *known = self.parts.len() as u32;
                    let mut part = Piece::new(piece.object, piece.cell);
                    part.given = self.cells.ids[cell as usize];
                    self.parts.push(part);
                }
                part = *known;
                count = self.parts[part as usize].triangles;
            }
            count += 1;
            self.part_of_triangle.push(part);
            self.number_of_triangle.push(count);
        }
        if last.is_some() {
            self.parts[part as usize].triangles = count;
        }
        any
    }

    /// Lists the parts of each marked vertex of a piece; `own` is the place of its first triangle.
    fn share_vertices(
        &mut self,
        piece: &Piece,
        faces: &[Triangle],
        own: usize,
        positions: &[[f32; 3]],
    ) {
        let first = piece.first_vertex as usize;
        for (triangle, &part) in faces.iter().zip(&self.part_of_triangle[own..]) {
            let corners = triangle.corners().map(|v| first + v as usize);
            let marked = corners.map(|v| self.part_of_vertex[v] == SEVERAL);
            if marked == [false; 3] {
                continue;
            }
            let cube = cube(corners.map(|v| positions[v]));
            for (v, is_marked) in corners.into_iter().zip(marked) {
                if is_marked {
                    self.shares.add(&mut self.vertex_of[v], part, cube);
                }
            }
        }
    }

    /// Finds the part of each vertex of a piece, counts the vertices of its parts, which begin at `before`, and finds their
    /// smallest keys.
    fn count_vertices(&mut self, piece: &Piece, before: usize) {
        let parts = &mut self.parts;
        let mut add = |part: u32, key: u64| {
            let part = &mut parts[part as usize];
            part.vertices += 1;
            part.key = part.key.min(key);
        };
        for v in vertices(piece) {
            let key = self.key_of_vertex[v];
            if self.part_of_vertex[v] == SEVERAL {
                let shares = self.shares.of(self.vertex_of[v]);
                shares.for_each(|share| add(share.part, key));
                continue;
            }
            // all of its triangles have three vertices of its cell
            let part = self.part_of_cell[(self.cell_of_vertex[v] & !NEXT_TILE) as usize];
            if part != NO_PART && part as usize >= before {
                self.part_of_vertex[v] = part;
                add(part, key);
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
            let triangles = own..own + piece.triangles as usize;
            own = triangles.end;
            self.place_triangles(piece, triangles, tile, mesh);
        }
        self.parts.sort_unstable_by_key(|part| part.first_triangle);
    }

    /// Numbers the vertices of a piece in their parts, and counts those that this tile counts.
    fn place_vertices(&mut self, piece: &Piece, mesh: &TileMesh) {
        let (positions, normals) = mesh.chunk.numbers().split_at(3 * mesh.chunk.vertices());
        let [positions, normals] = [positions, normals].map(|numbers| numbers.as_chunks::<3>().0);
        for v in vertices(piece) {
            let counted = u64::from(self.cell_of_vertex[v] & NEXT_TILE == 0);
            match self.part_of_vertex[v] {
                NO_PART => {}
                SEVERAL => {
                    let list = self.vertex_of[v];
                    // ids of parts differ
                    let last = self
                        .shares
                        .of(list)
                        .max_by_key(|s| (s.cube, Reverse(self.parts[s.part as usize].given)));
                    let with = last.expect("a part at least").part;
                    self.parts[with as usize].sums.vertices += counted;
                    let place = |part| {
                        let of = &self.parts[part as usize];
                        self.vertices.place(of, part, positions[v], normals[v])
                    };
                    self.shares.number(list, place);
                }
                part => {
                    let of = &mut self.parts[part as usize];
                    of.sums.vertices += counted;
                    self.vertex_of[v] = self.vertices.place(of, part, positions[v], normals[v]);
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
        let part_of = &self.part_of_triangle[own.clone()];
        let numbers = &self.number_of_triangle[own];
        let of_vertices = vertices(piece);
        let part_of_vertex = &self.part_of_vertex[of_vertices.clone()];
        let vertex_of = &self.vertex_of[of_vertices];
        for (triangle, (&part, &number)) in faces.iter().zip(part_of.iter().zip(numbers)) {
            let corners = triangle.corners().map(|v| v as usize);
            let mate = |mate: u32| match mate {
                NONE => NONE,
                _ => STRIDE * numbers[(mate / STRIDE) as usize - 1] + mate % STRIDE,
            };
            // all around its vertices is of its part
            let is_inner = corners.map(|v| part_of_vertex[v] != SEVERAL) == [true; 3];
            let (corners, mates) = match is_inner {
                true => (corners.map(|v| vertex_of[v]), triangle.mates.map(mate)),
                false => {
                    let number = |v: usize| match part_of_vertex[v] {
                        SEVERAL => self.shares.number_in(vertex_of[v], part),
                        _ => vertex_of[v],
                    };
                    // across the border of a part is none
                    let is_own = |m: u32| m != NONE && part_of[(m / STRIDE) as usize - 1] == part;
                    let own = |m: u32| if is_own(m) { mate(m) } else { NONE };
                    (corners.map(number), triangle.mates.map(own))
                }
            };
            let part = &mut self.parts[part as usize];
            if triangle.mates.contains(&NONE) {
                part.sums.border_edges += on_border(triangle, positions, tile);
            }
            self.triangles[(part.first_triangle + number) as usize] = Triangle::new(corners, mates);
        }
    }
}

/// The places of the vertices of a piece.
fn vertices(piece: &Piece) -> Range<usize> {
    let first = piece.first_vertex as usize;
    first..first + piece.vertices as usize
}

/// Of the cells of three vertices that of the one with the smallest key.
fn cell_of_lowest([a, b, c]: [u32; 3], keys: [u64; 3]) -> u32 {
    let (lower, key) = if keys[1] < keys[0] {
        (b, keys[1])
    } else {
        (a, keys[0])
    };
    if keys[2] < key { c } else { lower }
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
