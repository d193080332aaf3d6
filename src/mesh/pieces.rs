//! Which surface piece each vertex of a tile belongs to.
//!
//! A vertex lies on an edge between an above and a below voxel, so it belongs to one object and one
//! cell, and so does everything connected to it.

use crate::cpu::dispatch;
use crate::measure::MeshSums;
use crate::mesh::cubes::room_for;
use crate::mesh::edges::Edges;
use crate::mesh::tile::{BandView, TileBox};
use crate::volume::Voxel;

/// The surface of a tile between one object and one cell.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    /// Class of the object.
    pub object: u32,
    /// Class of the cell.
    pub cell: u32,
    /// True for the triangles that close the surface outside the volume.
    pub cap: bool,
    /// First vertex in the tile's arrays.
    pub first_vertex: u32,
    /// Number of vertices.
    pub vertices: u32,
    /// Element of the tile's arrays that stands for no triangle of the piece; those after it are its
    /// triangles.
    pub first_triangle: u32,
    /// Number of triangles.
    pub triangles: u32,
    /// Smallest lattice key (3 x linear index of the edge's lower voxel + axis) of its vertices.
    pub key: u64,
    /// Sums over the triangles and over the vertices that this tile counts.
    pub sums: MeshSums,
    /// Smallest vertex coordinates in lattice steps.
    pub min: [i32; 3],
    /// Largest vertex coordinates in lattice steps.
    pub max: [i32; 3],
}

impl Piece {
    /// The elements of its triangles in the tile's arrays, that of none before them.
    pub fn faces(&self) -> std::ops::Range<usize> {
        let first = self.first_triangle as usize;
        first..first + 1 + self.triangles as usize
    }

    /// The first element after those of its triangles and their room.
    pub fn end_of_faces(&self) -> u32 {
        let room = if self.cap {
            1 + self.triangles
        } else {
            room_for(self.vertices)
        };
        self.first_triangle + room
    }

    /// A piece without vertices.
    pub fn new(object: u32, cell: u32, cap: bool) -> Self {
        Piece {
            object,
            cell,
            cap,
            first_vertex: 0,
            vertices: 0,
            first_triangle: 0,
            triangles: 0,
            key: u64::MAX,
            sums: MeshSums::default(),
            min: [i32::MAX; 3],
            max: [i32::MIN; 3],
        }
    }
}

/// Finds pieces by (object, cell): open addressing.
#[derive(Debug, Default)]
pub struct PieceIndex {
    /// Open addressing: piece + 1, or 0.
    slots: Vec<u32>,
}

impl PieceIndex {
    fn reset(&mut self) {
        self.slots.clear();
        self.slots.resize(256, 0);
    }

    #[inline]
    fn find(&mut self, pieces: &mut Vec<Piece>, object: u32, cell: u32) -> u32 {
        let mut at = Self::hash(object, cell) & (self.slots.len() - 1);
        loop {
            match self.slots[at] {
                0 => return self.insert(pieces, object, cell),
                found => {
                    let piece = &pieces[found as usize - 1];
                    if piece.object == object && piece.cell == cell {
                        return found - 1;
                    }
                }
            }
            at = (at + 1) & (self.slots.len() - 1);
        }
    }

    fn hash(object: u32, cell: u32) -> usize {
        let mixed = (u64::from(object) << 32 | u64::from(cell)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> 40) as usize
    }

    #[cold]
    fn insert(&mut self, pieces: &mut Vec<Piece>, object: u32, cell: u32) -> u32 {
        pieces.push(Piece::new(object, cell, false));
        if 2 * pieces.len() > self.slots.len() {
            self.slots = vec![0; 2 * self.slots.len()];
            for (i, piece) in pieces.iter().enumerate() {
                self.place(i as u32 + 1, piece);
            }
        } else {
            let piece = pieces[pieces.len() - 1];
            self.place(pieces.len() as u32, &piece);
        }
        pieces.len() as u32 - 1
    }

    fn place(&mut self, number: u32, piece: &Piece) {
        let mask = self.slots.len() - 1;
        let mut at = Self::hash(piece.object, piece.cell) & mask;
        while self.slots[at] != 0 {
            at = (at + 1) & mask;
        }
        self.slots[at] = number;
    }
}

/// Which piece and which of its vertices lies on each crossed edge, by the edge's number.
#[derive(Debug, Default)]
pub struct Sheets {
    /// The piece.
    pub piece_of: Vec<u32>,
    /// The vertex, numbered within the piece.
    pub vertex_of: Vec<u32>,
}

/// Vertices of one piece that follow each other.
#[derive(Debug, Clone, Copy)]
struct VertexRun {
    object: u32,
    cell: u32,
    piece: u32,
    /// Vertices of the piece up to now; 0 if the run has none.
    next: u32,
    /// Vertices of the run that the next tile along x counts.
    shared: u32,
}

impl Default for VertexRun {
    /// No vertices, of no piece.
    fn default() -> Self {
        VertexRun {
            object: u32::MAX,
            cell: u32::MAX,
            piece: 0,
            next: 0,
            shared: 0,
        }
    }
}

impl VertexRun {
    /// Adds the run to its piece; the tile counts its vertices unless the row is `shared` with the next
    /// tile, which does.
    #[inline(always)]
    fn end(self, pieces: &mut [Piece], shared: bool) {
        if self.next > 0 {
            let piece = &mut pieces[self.piece as usize];
            let counted = self.next - piece.vertices - self.shared;
            piece.vertices = self.next;
            piece.sums.vertices += u64::from(counted) * u64::from(!shared);
        }
    }
}

/// Assigns every crossed edge its piece and vertex, and counts the pieces' vertices.
pub fn assign<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    index: &mut PieceIndex,
    pieces: &mut Vec<Piece>,
    sheets: &mut Sheets,
) {
    dispatch!(assign_inlined(view, tile, edges, index, pieces, sheets));
}

#[inline(always)]
fn assign_inlined<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    index: &mut PieceIndex,
    pieces: &mut Vec<Piece>,
    sheets: &mut Sheets,
) {
    index.reset();
    pieces.clear();
    let count = edges.count as usize;
    sheets.piece_of.resize(count, 0);
    sheets.vertex_of.resize(count, 0);
    let (piece_of, vertex_of) = (&mut sheets.piece_of[..], &mut sheets.vertex_of[..]);
    let mut number = 0;
    let [_, cy, cz] = tile.cubes.map(|c| c as usize);
    let mut words = edges.words.chunks_exact(edges.row_words);
    let mut bits = edges.bits.chunks_exact(edges.row_words);
    for z in 0..=cz {
        for y in 0..=cy {
            let row_words = words.next().expect("one chunk per row");
            let row_bits = bits.next().expect("one chunk per row");
            let lower = view.label_row(tile, y, z);
            let upper = [
                lower,
                if y < cy {
                    view.label_row(tile, y + 1, z)
                } else {
                    lower
                },
                if z < cz {
                    view.label_row(tile, y, z + 1)
                } else {
                    lower
                },
            ];
            let shared_row = tile.shares_upper(1, y) || tile.shares_upper(2, z);
            let row_key = 3 * tile.linear([0, y, z]);
            for axis in 0..3 {
                let step = usize::from(axis == 0);
                let mut run = VertexRun::default();
                for (w, word) in row_words.iter().enumerate() {
                    let mut crossed = word.crossed[axis];
                    while crossed != 0 {
                        let bit = crossed.trailing_zeros() as usize;
                        crossed &= crossed - 1;
                        let x = 64 * w + bit;
                        let ends = [
                            view.class_at(lower, tile, x),
                            view.class_at(upper[axis], tile, x + step),
                        ];
                        let lower_above = (row_bits[w] >> bit & 1) as usize;
                        let (object, cell) = (ends[1 - lower_above], ends[lower_above]);
                        // walls are long: the piece is mostly that of the vertex before
                        if (run.object, run.cell) != (object, cell) {
                            run.end(pieces, shared_row);
                            let p = index.find(pieces, object, cell);
                            let piece = &mut pieces[p as usize];
                            // within a row and axis, keys rise
                            piece.key = piece.key.min(row_key + (3 * x + axis) as u64);
                            run = VertexRun {
                                object,
                                cell,
                                piece: p,
                                next: piece.vertices,
                                shared: 0,
                            };
                        }
                        piece_of[number] = run.piece;
                        vertex_of[number] = run.next;
                        number += 1;
                        run.next += 1;
                        run.shared += u32::from(tile.shares_upper(0, x));
                    }
                }
                run.end(pieces, shared_row);
            }
        }
    }
    let (mut vertex, mut triangle) = (0, 0);
    for piece in pieces {
        piece.first_vertex = vertex;
        vertex += piece.vertices;
        piece.first_triangle = triangle;
        triangle = piece.end_of_faces();
    }
}
