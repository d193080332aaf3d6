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
use crate::surface::mesher::{BandView, CellsView, Sizes, TileBox, TileMesh};
use foldhash::fast::RandomState;
use std::collections::HashMap;
use std::ops::Range;

/// Bytes of buffers for each crossed edge of a tile whose pieces may be split: what is known of its vertex, and for its two
/// triangles the cell, its number, the place in the order of cells and the new place.
pub const BYTES_PER_SPLIT_VERTEX: u64 = 128;

/// Splits pieces; its buffers are used again from tile to tile. What they take follows vertices, triangles and parts.
#[derive(Debug, Default)]
pub struct PieceSplitter {
    /// What is known of the edge of each vertex.
    ends: Vec<End>,
    /// The cell of each triangle, piece by piece.
    cell_of: Vec<u64>,
    /// Numbers of the triangles of each piece, from 0, by their cells.
    by_cell: Vec<u32>,
    /// The different cells of a piece.
    cells: CellList,
    /// Of each vertex of a piece, its number in the part that is made, or that part.
    vertex_of: Vec<u32>,
    /// Where the triangles of a piece go: the part, and the number in it. The first one is that of none.
    places: Vec<(u32, u32)>,
    /// The corners of a part, each once.
    corners: Vec<u32>,
    vectors: [Vec<[f32; 3]>; 2],
    triangles: Vec<Triangle>,
    pieces: Vec<Piece>,
}

/// Says of a vertex that a part has it, and not yet its number there.
const SEEN: u32 = 1 << 31;

/// The different cells of the triangles of a piece, in any order.
#[derive(Debug, Default)]
struct CellList {
    /// Which of them each triangle has.
    which: Vec<u32>,
    number_of: HashMap<u64, u32, RandomState>,
    /// Each with how many triangles it has, later with where its next one goes.
    counts: Vec<(u64, u32)>,
}

impl CellList {
    /// Writes the numbers of triangles, from 0, by rising cells, and by themselves within each: by counting, since there are
    /// few cells.
    fn sort(&mut self, cell_of: &[u64], order: &mut [u32]) {
        self.which.clear();
        self.number_of.clear();
        self.counts.clear();
        let mut last = None;
        for &cell in cell_of {
            let number = match last {
                Some((of, number)) if of == cell => number,
                _ => self.number(cell),
            };
            last = Some((cell, number));
            self.counts[number as usize].1 += 1;
            self.which.push(number);
        }
        let mut rising: Vec<u32> = (0..self.counts.len() as u32).collect();
        rising.sort_unstable_by_key(|&number| self.counts[number as usize].0);
        let mut start = 0;
        for number in rising {
            let count = &mut self.counts[number as usize].1;
            start += std::mem::replace(count, start);
        }
        for (t, &number) in (0..).zip(&self.which) {
            let place = &mut self.counts[number as usize].1;
            order[*place as usize] = t;
            *place += 1;
        }
    }

    /// The number of a cell, which may be new.
    fn number(&mut self, cell: u64) -> u32 {
        let next = self.counts.len() as u32;
        let number = *self.number_of.entry(cell).or_insert(next);
        if number == next {
            self.counts.push((cell, 0));
        }
        number
    }
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
            piece.given = ends.first().map_or(0, |end| end.cell);
            any |= ends.iter().any(|end| end.cell != piece.given);
        }
        if !any {
            return Ok(());
        }
        let sizes = self.sort_triangles(out);
        if !(cells.fits)(&sizes) {
            return Err(sizes);
        }
        let vertices = sizes.vertices as usize;
        for vectors in &mut self.vectors {
            vectors.clear();
            vectors.reserve_exact(vertices);
        }
        self.triangles.clear();
        let faces = self.cell_of.len() + sizes.pieces as usize;
        self.triangles.reserve_exact(faces);
        self.pieces.clear();
        self.pieces.reserve_exact(sizes.pieces as usize);
        let pieces = std::mem::take(&mut out.pieces);
        let mut first = 0;
        for piece in &pieces {
            let own = first..first + piece.triangles as usize;
            first = own.end;
            self.add_parts(piece, own, tile, out);
        }
        let faces = self.pieces.last().map_or(0, Piece::end_of_faces);
        self.triangles.resize(faces as usize, Triangle::default());
        out.pieces.append(&mut self.pieces);
        std::mem::swap(&mut out.triangles, &mut self.triangles);
        out.chunk.begin(self.vectors[0].len());
        for (to, from) in out.chunk.vectors_mut().into_iter().zip(&self.vectors) {
            to.copy_from_slice(from);
        }
        Ok(())
    }

    /// Sorts the triangles of each piece by their cells, and counts what the parts will have.
    fn sort_triangles(&mut self, mesh: &TileMesh) -> Sizes {
        self.cell_of.clear();
        self.by_cell.clear();
        let mut sizes = Sizes {
            vertices: 0,
            pieces: 0,
        };
        for piece in &mesh.pieces {
            let faces = &mesh.triangles[piece.faces()][1..];
            let ends = &self.ends[piece.first_vertex as usize..];
            let first = self.cell_of.len();
            self.cell_of
                .extend(faces.iter().map(|face| cell(face, ends)));
            self.by_cell.resize(self.cell_of.len(), 0);
            let (cell_of, by_cell) = (&self.cell_of[first..], &mut self.by_cell[first..]);
            self.cells.sort(cell_of, by_cell);
            self.vertex_of.clear();
            self.vertex_of.resize(piece.vertices as usize, u32::MAX);
            for (number, part) in (0..).zip(parts(by_cell, cell_of)) {
                sizes.pieces += 1;
                for corner in part.iter().flat_map(|&t| faces[t as usize].corners()) {
                    let last = std::mem::replace(&mut self.vertex_of[corner as usize], number);
                    sizes.vertices += u64::from(last != number);
                }
            }
        }
        sizes
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

    /// Adds the parts of a piece by the ids of their cells; `own` are its triangles among all.
    fn add_parts(&mut self, piece: &Piece, own: Range<usize>, tile: &TileBox, from: &TileMesh) {
        let first = piece.first_vertex as usize;
        let faces = &from.triangles[piece.faces()][1..];
        let positions = &from.chunk.numbers().as_chunks::<3>().0[first..];
        let positions = &positions[..piece.vertices as usize];
        let by_cell = std::mem::take(&mut self.by_cell);
        let cell_of = std::mem::take(&mut self.cell_of);
        let (of_piece, cells) = (&by_cell[own.clone()], &cell_of[own]);
        self.place(of_piece, cells);
        self.vertex_of.clear();
        self.vertex_of.resize(piece.vertices as usize, u32::MAX);
        let counted_with = counted_with(faces, cells, positions);
        for (number, part) in (0..).zip(parts(of_piece, cells)) {
            let cell = cells[part[0] as usize];
            let mut new = self.new_piece(piece, (number, cell), part, from);
            let counted = self.corners.iter().filter(|&&v| {
                counted_with[v as usize] == Some(cell) && !self.ends[first + v as usize].shared
            });
            new.sums.vertices = counted.count() as u64;
            // another way than the mesher's, which is compiled for itself alone
            self.triangles.push(Triangle::default());
            for &t in part {
                let triangle = &faces[t as usize];
                new.sums.border_edges += on_border(triangle, positions, tile);
                let moved = self.moved(triangle, number);
                self.triangles.push(moved);
            }
            self.pieces.push(new);
        }
        (self.by_cell, self.cell_of) = (by_cell, cell_of);
    }

    /// Numbers the triangles of a piece, which are sorted by cells, in their parts.
    fn place(&mut self, by_cell: &[u32], cells: &[u64]) {
        self.places.clear();
        self.places.resize(1 + by_cell.len(), (u32::MAX, 0));
        for (number, part) in (0..).zip(parts(by_cell, cells)) {
            for (place, &t) in (1..).zip(part) {
                self.places[1 + t as usize] = (number, place);
            }
        }
    }

    /// The part `number` of a piece, of a cell, without its sums; its vertices are added, and numbered.
    fn new_piece(
        &mut self,
        piece: &Piece,
        (number, cell): (u32, u64),
        part: &[u32],
        from: &TileMesh,
    ) -> Piece {
        let faces = &from.triangles[piece.faces()][1..];
        let coordinates = from.chunk.numbers();
        let normals = 3 * from.chunk.vertices();
        let mut new = Piece::new(piece.object, piece.cell);
        new.given = cell;
        new.first_vertex = self.vectors[0].len() as u32;
        new.first_triangle = self.triangles.len() as u32;
        new.triangles = part.len() as u32;
        self.corners.clear();
        // a vertex has about six triangles: each once before they are sorted
        for corner in part.iter().flat_map(|&t| faces[t as usize].corners()) {
            let last = std::mem::replace(&mut self.vertex_of[corner as usize], SEEN | number);
            if last != SEEN | number {
                self.corners.push(corner);
            }
        }
        self.corners.sort_unstable();
        new.vertices = self.corners.len() as u32;
        for (place, &v) in (0..).zip(&self.corners) {
            self.vertex_of[v as usize] = place;
            let at = (piece.first_vertex + v) as usize;
            new.key = new.key.min(self.ends[at].key);
            for (vectors, start) in self.vectors.iter_mut().zip([0, normals]) {
                let numbers = &coordinates[start + 3 * at..][..3];
                vectors.push([numbers[0], numbers[1], numbers[2]]);
            }
        }
        new
    }

    /// A triangle of the piece with the vertices of part `number`; neighbours in other parts are none.
    fn moved(&self, triangle: &Triangle, number: u32) -> Triangle {
        let corners = triangle.corners().map(|v| self.vertex_of[v as usize]);
        let mates = triangle.mates.map(|mate| {
            let (part, place) = self.places[(mate / STRIDE) as usize];
            match part == number {
                true => STRIDE * place + mate % STRIDE,
                false => NONE,
            }
        });
        Triangle::new(corners, mates)
    }
}

/// The cell of a triangle: that of its vertex with the smallest key.
fn cell(triangle: &Triangle, ends: &[End]) -> u64 {
    let corners = triangle.corners().map(|v| ends[v as usize]);
    let lowest = corners.into_iter().min_by_key(|end| end.key);
    lowest.expect("three corners").cell
}

/// The triangles of each cell, of those that are sorted by cells.
fn parts<'a>(by_cell: &'a [u32], cells: &'a [u64]) -> impl Iterator<Item = &'a [u32]> {
    by_cell.chunk_by(|&a, &b| cells[a as usize] == cells[b as usize])
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_sorted_as_by_comparing() {
        let mut seed = 7u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            seed >> 33
        };
        let mut list = CellList::default();
        for count in 0..200usize {
            let cells = 1 + random() % 9;
            let step = [1, u64::MAX / 9][count % 2];
            let cell_of: Vec<u64> = (0..count)
                .map(|_| u64::MAX - step * (random() % cells))
                .collect();
            let mut found = vec![0; count];
            list.sort(&cell_of, &mut found);
            let mut expected: Vec<u32> = (0..count as u32).collect();
            expected.sort_by_key(|&t| cell_of[t as usize]);
            assert_eq!(found, expected);
        }
    }
}
