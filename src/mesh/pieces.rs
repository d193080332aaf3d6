//! Which surface piece each vertex of a tile belongs to.
//!
//! A vertex lies on an edge between an above and a below voxel, so it belongs to one object and one
//! cell, and so does everything connected to it.
//!
//! The piece is looked up for every stretch of edges: to ask first whether it is that of the edge before
//! saves the lookup for half of them and cannot be foretold, which cost a tenth of the time.

use crate::cpu::{dispatch, prefetch};
use crate::measure::MeshSums;
use crate::mesh::cubes::room_for;
use crate::mesh::edges::{EdgeWord, Edges};
use crate::mesh::tile::{BandView, TileBox};
use crate::segment::transitions;
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

/// A piece while its vertices are counted.
#[derive(Debug, Clone, Copy)]
struct Count {
    /// Its object, then its cell.
    pair: u64,
    vertices: u32,
    /// Those that the next tile counts.
    shared: u32,
    /// See [`Piece::key`].
    key: u64,
}

/// Finds pieces by object and cell: open addressing.
#[derive(Debug, Default)]
pub struct PieceIndex {
    slots: Vec<Slot>,
    counts: Vec<Count>,
}

/// A piece by its object and cell.
#[derive(Debug, Clone, Copy)]
struct Slot {
    pair: u64,
    piece: u32,
}

impl Slot {
    /// No class has this number, so no piece is between two of them.
    const EMPTY: Slot = Slot {
        pair: u64::MAX,
        piece: u32::MAX,
    };
}

impl PieceIndex {
    fn reset(&mut self) {
        self.slots.clear();
        self.slots.resize(256, Slot::EMPTY);
        self.counts.clear();
    }

    #[inline(always)]
    fn find(&mut self, object: u32, cell: u32) -> u32 {
        let pair = u64::from(object) << 32 | u64::from(cell);
        let mut at = Self::hash(pair);
        loop {
            let slot = self.slots[at & (self.slots.len() - 1)];
            if slot.pair == pair {
                return slot.piece;
            }
            if slot.pair == Slot::EMPTY.pair {
                return self.insert(pair);
            }
            at += 1;
        }
    }

    #[inline(always)]
    fn hash(pair: u64) -> usize {
        (pair.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as usize
    }

    #[cold]
    fn insert(&mut self, pair: u64) -> u32 {
        self.counts.push(Count {
            pair,
            vertices: 0,
            shared: 0,
            key: u64::MAX,
        });
        let count = self.counts.len();
        if 2 * count > self.slots.len() {
            self.slots = vec![Slot::EMPTY; 2 * self.slots.len()];
            (0..count).for_each(|i| self.place(i));
        } else {
            self.place(count - 1);
        }
        count as u32 - 1
    }

    fn place(&mut self, piece: usize) {
        let pair = self.counts[piece].pair;
        let mask = self.slots.len() - 1;
        let mut at = Self::hash(pair) & mask;
        while self.slots[at].pair != Slot::EMPTY.pair {
            at = (at + 1) & mask;
        }
        let piece = piece as u32;
        self.slots[at] = Slot { pair, piece };
    }
}

/// Which piece and which of its vertices lies on each crossed edge, by the edge's number. Some elements
/// more mean nothing. Pieces have their vertices one behind the other.
#[derive(Debug, Default)]
pub struct Sheets {
    /// The piece.
    pub piece_of: Vec<u32>,
    /// The vertex, numbered within the piece.
    pub vertex_of: Vec<u32>,
    /// The first vertex of each piece in the tile's arrays.
    pub first_of: Vec<u32>,
    /// The run in which each voxel row begins, where it has been asked for, or [`UNKNOWN`].
    first_run: Vec<u32>,
}

impl Sheets {
    /// Whether there is an element for each crossed edge.
    pub fn are_of(&self, edges: &Edges) -> bool {
        self.piece_of.len().min(self.vertex_of.len()) >= edges.count()
    }
}

/// No run has this number.
const UNKNOWN: u32 = u32::MAX;

/// Vertices written at once, whether a stretch has as many or not.
const AT_ONCE: usize = 8;

/// Rows by which classes are fetched ahead: each row of a tile has them elsewhere.
const ROWS_AHEAD: usize = 4;

/// Assigns every crossed edge its piece and vertex, and counts the pieces' vertices.
pub fn assign<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    index: &mut PieceIndex,
    pieces: &mut Vec<Piece>,
    sheets: &mut Sheets,
) {
    index.reset();
    sheets.piece_of.resize(edges.count() + AT_ONCE, 0);
    sheets.vertex_of.resize(edges.count() + AT_ONCE, 0);
    sheets.first_run.clear();
    sheets.first_run.resize(edges.first.len(), UNKNOWN);
    let mut assigner = Assigner {
        class_of_run: view.class_of_run,
        index,
        piece_of: &mut sheets.piece_of,
        vertex_of: &mut sheets.vertex_of,
        number: 0,
        last: 0,
    };
    let first_run = &mut sheets.first_run;
    dispatch!(assign_inlined(view, tile, edges, first_run, &mut assigner));
    pieces.clear();
    sheets.first_of.clear();
    let (mut vertex, mut triangle) = (0, 0);
    for count in &index.counts {
        let mut piece = Piece::new((count.pair >> 32) as u32, count.pair as u32, false);
        piece.key = count.key;
        piece.vertices = count.vertices;
        piece.sums.vertices = u64::from(count.vertices - count.shared);
        piece.first_vertex = vertex;
        sheets.first_of.push(vertex);
        vertex += piece.vertices;
        piece.first_triangle = triangle;
        triangle = piece.end_of_faces();
        pieces.push(piece);
    }
}

#[inline(always)]
fn assign_inlined<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    first_run: &mut [u32],
    assigner: &mut Assigner,
) {
    let [cx, cy, cz] = tile.cubes.map(|c| c as usize);
    // three rows ask for each
    let mut row = |y: usize, z: usize| {
        let number = z * edges.rows + y;
        let first = &mut first_run[number];
        if *first == UNKNOWN {
            *first = view.run_at(tile, [0, y, z]);
        }
        Row {
            bits: &edges.bits[number * edges.row_words..][..edges.row_words],
            first_run: *first,
        }
    };
    for (number, [y, z], words) in edges.crossed_rows() {
        let [first_x, first_y, first_z] = edges.first[number];
        let of_row = OfRow {
            key: 3 * tile.linear([0, y, z]),
            shared: tile.shares_upper(1, y) || tile.shares_upper(2, z),
        };
        // the next tile counts the vertices on the last voxel's edges, of which none goes along the row
        let shares_last = !of_row.shared && !tile.is_last[0];
        let shared = words[cx / 64].map(|word| shares_last && word >> (cx % 64) & 1 == 1);
        if y + ROWS_AHEAD <= cy && z < cz {
            let run = row(y + ROWS_AHEAD, z + 1).first_run as usize;
            prefetch(assigner.class_of_run, run);
        }
        let here = row(y, z);
        if first_x < first_y {
            assigner.along_row(words, &here, &of_row);
        }
        if first_y < first_z {
            assigner.across_rows(words, 1, [&here, &row(y + 1, z)], &of_row);
            assigner.index.counts[assigner.last].shared += u32::from(shared[1]);
        }
        if first_z < edges.first[number + 1][0] {
            assigner.across_rows(words, 2, [&here, &row(y, z + 1)], &of_row);
            assigner.index.counts[assigner.last].shared += u32::from(shared[2]);
        }
    }
}

/// A voxel row of the tile.
struct Row<'a> {
    /// Its bits, aligned to the tile's first voxel.
    bits: &'a [u64],
    /// Run of its first voxel.
    first_run: u32,
}

/// What the vertices of a row have in common.
struct OfRow {
    /// Key of its first edge.
    key: u64,
    /// The next tile counts the vertices.
    shared: bool,
}

/// Gives the crossed edges their pieces in the order of their numbers.
struct Assigner<'a> {
    class_of_run: &'a [u32],
    index: &'a mut PieceIndex,
    piece_of: &'a mut [u32],
    vertex_of: &'a mut [u32],
    /// Of the next edge.
    number: usize,
    /// Piece of the edge before.
    last: usize,
}

impl Assigner<'_> {
    /// The edges along a row: each lies between a run and the next.
    #[inline(always)]
    fn along_row(&mut self, words: &[EdgeWord], row: &Row, of_row: &OfRow) {
        let mut run = row.first_run;
        for (w, word) in words.iter().enumerate() {
            let mut crossed = word[0];
            while crossed != 0 {
                let bit = crossed.trailing_zeros() as usize;
                crossed &= crossed - 1;
                let is_above = row.bits[w] >> bit & 1 == 1;
                let key = of_row.key + 3 * (64 * w + bit) as u64;
                let (piece, vertex) = self.count([run, run + 1], is_above, (1, key), of_row);
                self.piece_of[self.number] = piece;
                self.vertex_of[self.number] = vertex;
                self.number += 1;
                run += 1;
            }
        }
    }

    /// The edges from a row to the next along `axis`: those of one stretch lie between the same two
    /// runs. A stretch can only begin where one of the runs does.
    #[inline(always)]
    fn across_rows(&mut self, words: &[EdgeWord], axis: usize, rows: [&Row; 2], of_row: &OfRow) {
        let mut first_run = rows.map(|r| r.first_run);
        let mut before = [None; 2];
        for (w, word) in words.iter().enumerate() {
            let bits = rows.map(|r| r.bits[w]);
            let starts = [0, 1].map(|i| transitions(bits[i], before[i]));
            let crossed = word[axis];
            let no_more = !crossed | starts[0] | starts[1];
            let mut left = crossed;
            while left != 0 {
                let start = left.trailing_zeros();
                let upto = !0 >> (63 - start);
                let past = no_more & !upto;
                let end = past.trailing_zeros();
                // the bits from the end on, none if it is the word's
                left &= (past & past.wrapping_neg()).wrapping_neg();
                let runs = [0, 1].map(|i| first_run[i] + (starts[i] & upto).count_ones());
                let is_above = bits[0] >> start & 1 == 1;
                let key = of_row.key + 3 * (64 * w as u64 + u64::from(start)) + axis as u64;
                let (piece, vertex) = self.count(runs, is_above, (end - start, key), of_row);
                self.put(piece, vertex, (end - start) as usize);
            }
            first_run = [0, 1].map(|i| first_run[i] + starts[i].count_ones());
            before = bits.map(Some);
        }
    }

    /// Counts edges between two runs, of which the first is above or the second; returns their piece
    /// and the first one's vertex.
    #[inline(always)]
    fn count(
        &mut self,
        runs: [u32; 2],
        is_above: bool,
        (count, key): (u32, u64),
        of_row: &OfRow,
    ) -> (u32, u32) {
        let classes = runs.map(|r| self.class_of_run[r as usize]);
        let (object, cell) = (
            classes[usize::from(!is_above)],
            classes[usize::from(is_above)],
        );
        let piece = self.index.find(object, cell);
        self.last = piece as usize;
        let of = &mut self.index.counts[piece as usize];
        let first = of.vertices;
        of.vertices += count;
        of.key = of.key.min(key);
        if of_row.shared {
            of.shared += count;
        }
        (piece, first)
    }

    /// Gives the next `count` edges their vertices, the first of which is `vertex`.
    #[inline(always)]
    fn put(&mut self, piece: u32, vertex: u32, count: usize) {
        let pieces = &mut self.piece_of[self.number..];
        let vertices = &mut self.vertex_of[self.number..];
        pieces[..AT_ONCE].fill(piece);
        for (i, place) in vertices[..AT_ONCE].iter_mut().enumerate() {
            *place = vertex + i as u32;
        }
        for i in AT_ONCE..count {
            (pieces[i], vertices[i]) = (piece, vertex + i as u32);
        }
        self.number += count;
    }
}
