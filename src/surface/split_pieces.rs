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
use crate::surface::mesher::{BandView, CellsView, TileBox, TileMesh};
use std::collections::BTreeMap;

/// Splits pieces; its buffers are used again from tile to tile.
#[derive(Debug, Default)]
pub struct PieceSplitter {
    /// What is known of the edge of each vertex.
    ends: Vec<End>,
    vectors: [Vec<[f32; 3]>; 2],
    triangles: Vec<Triangle>,
    pieces: Vec<Piece>,
}

/// What is known of a vertex by the lattice edge that it lies on.
#[derive(Debug, Clone, Copy, Default)]
struct End {
    /// The cell at the below end of the edge.
    cell: u64,
    /// The key of the edge.
    key: u64,
    /// The next tile counts the vertex.
    shared: bool,
}

/// Where the triangles of a piece went: the part, and the number in it.
type NewPlaces = Vec<(u32, u32)>;

impl PieceSplitter {
    /// Gives each piece of the open surface its cell, and splits those that have several; they are to be summed up then.
    pub fn split<T>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        cells: &CellsView,
        found: (&Edges, &VertexAssignment),
        out: &mut TileMesh,
    ) {
        let mut all_known = true;
        for piece in &mut out.pieces {
            match cells.of_class[piece.cell as usize] {
                Some(cell) => piece.given = cell,
                None => all_known = false,
            }
        }
        if all_known {
            return;
        }
        self.find_ends(view, tile, cells.of_voxels, found);
        let mut any = false;
        for piece in &mut out.pieces {
            let ends = &self.ends[piece.first_vertex as usize..][..piece.vertices as usize];
            piece.given = ends.first().map_or(0, |end| end.cell);
            any |= ends.iter().any(|end| end.cell != piece.given);
        }
        if !any {
            return;
        }
        self.vectors.iter_mut().for_each(Vec::clear);
        self.triangles.clear();
        self.pieces.clear();
        let pieces = std::mem::take(&mut out.pieces);
        for piece in &pieces {
            self.add_parts(piece, tile, out);
        }
        out.pieces.append(&mut self.pieces);
        std::mem::swap(&mut out.triangles, &mut self.triangles);
        out.chunk.begin(self.vectors[0].len());
        for (to, from) in out.chunk.vectors_mut().into_iter().zip(&self.vectors) {
            to.copy_from_slice(from);
        }
    }

    /// Finds the cell and the key of each vertex.
    fn find_ends<T>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        cells: &BandCells,
        (edges, assigned): (&Edges, &VertexAssignment),
    ) {
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
                        self.ends[vertex as usize] = End {
                            cell: cells.at(row, below[0] + first_x),
                            key: key + 3 * u64::from(x) + axis as u64,
                            shared,
                        };
                        number += 1;
                    }
                }
            }
        }
    }

    /// Adds the parts of a piece by the ids of their cells.
    fn add_parts(&mut self, piece: &Piece, tile: &TileBox, from: &TileMesh) {
        let first = piece.first_vertex as usize;
        let faces = &from.triangles[piece.faces()];
        let positions = from.chunk.numbers().as_chunks::<3>().0;
        let cell_of = |triangle: &Triangle| {
            let corners = triangle.corners().map(|v| self.ends[first + v as usize]);
            let lowest = corners.into_iter().min_by_key(|end| end.key);
            lowest.expect("three corners").cell
        };
        let vertices = piece.vertices as usize;
        let mut parts: BTreeMap<u64, Part> = BTreeMap::new();
        let cells: Vec<u64> = faces[1..].iter().map(cell_of).collect();
        for &cell in &cells {
            parts.entry(cell).or_default();
        }
        for (number, part) in (0..).zip(parts.values_mut()) {
            part.number = number;
            part.vertex_of = vec![u32::MAX; vertices];
        }
        let mut places: NewPlaces = vec![(u32::MAX, 0)];
        for (triangle, cell) in faces[1..].iter().zip(&cells) {
            let part = parts.get_mut(cell).expect("one for each cell");
            part.triangles += 1;
            places.push((part.number, part.triangles));
            for corner in triangle.corners() {
                part.vertex_of[corner as usize] = 0;
            }
        }
        let counted_with = counted_with(&faces[1..], &cells, &positions[first..][..vertices]);
        for (cell, mut part) in parts {
            let mut new = self.new_piece(piece, cell, &mut part, from);
            let own = counted_with.iter().zip(&self.ends[first..]);
            let own = own.filter(|(with, end)| **with == Some(cell) && !end.shared);
            new.sums.vertices = own.count() as u64;
            let at = new.first_triangle as usize;
            let room = new.end_of_faces() as usize - self.triangles.len();
            // another way than the mesher's, which is compiled for itself alone
            let none = std::iter::repeat_n(Triangle::default(), room);
            self.triangles.extend(none);
            let own = (1..)
                .zip(&faces[1..])
                .filter(|&(t, _): &(usize, _)| places[t].0 == part.number);
            for (t, triangle) in own {
                new.sums.border_edges += on_border(triangle, &positions[first..], tile);
                let to = at + places[t].1 as usize;
                self.triangles[to] = part.moved(triangle, &places);
            }
            self.pieces.push(new);
        }
    }

    /// A part of a piece without its sums; its vertices are added.
    fn new_piece(&mut self, piece: &Piece, cell: u64, part: &mut Part, from: &TileMesh) -> Piece {
        let coordinates = from.chunk.numbers();
        let normals = 3 * from.chunk.vertices();
        let mut new = Piece::new(piece.object, piece.cell);
        new.given = cell;
        new.first_vertex = self.vectors[0].len() as u32;
        new.first_triangle = self.pieces.last().map_or(0, Piece::end_of_faces);
        new.triangles = part.triangles;
        for (v, to) in part.vertex_of.iter_mut().enumerate() {
            if *to == u32::MAX {
                continue;
            }
            *to = new.vertices;
            new.vertices += 1;
            let at = piece.first_vertex as usize + v;
            new.key = new.key.min(self.ends[at].key);
            for (vectors, start) in self.vectors.iter_mut().zip([0, normals]) {
                let numbers = &coordinates[start + 3 * at..][..3];
                vectors.push([numbers[0], numbers[1], numbers[2]]);
            }
        }
        new
    }
}

/// The cell with which each vertex of a piece is counted, `None` of one that no triangle has; `positions` are those of the
/// vertices, `cells` those of the triangles.
fn counted_with(triangles: &[Triangle], cells: &[u64], positions: &[[f32; 3]]) -> Vec<Option<u64>> {
    let mut last: Vec<Option<([u32; 3], u64)>> = vec![None; positions.len()];
    for (triangle, &cell) in triangles.iter().zip(cells) {
        let corners = triangle.corners();
        let ends = corners.map(|v| positions[v as usize]);
        // no triangle lies in a face of its cube
        let cube = [2, 1, 0].map(|a| ends[0][a].min(ends[1][a]).min(ends[2][a]) as u32);
        for v in corners {
            let known = &mut last[v as usize];
            if known.is_none_or(|(known, of)| known < cube || known == cube && cell < of) {
                *known = Some((cube, cell));
            }
        }
    }
    last.iter()
        .map(|known| known.map(|(_, cell)| cell))
        .collect()
}

/// A part of a piece while it is made.
#[derive(Debug, Default)]
struct Part {
    number: u32,
    triangles: u32,
    /// Its vertex of each of the piece's; `u32::MAX` of those that it lacks.
    vertex_of: Vec<u32>,
}

impl Part {
    /// A triangle of the piece with the part's vertices; neighbours in other parts are none.
    fn moved(&self, triangle: &Triangle, places: &NewPlaces) -> Triangle {
        let corners = triangle.corners().map(|v| self.vertex_of[v as usize]);
        let mates = triangle.mates.map(|mate| {
            let (part, number) = places[(mate / STRIDE) as usize];
            match part == self.number {
                true => STRIDE * number + mate % STRIDE,
                false => NONE,
            }
        });
        Triangle::new(corners, mates)
    }
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
