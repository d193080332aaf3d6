//! Which surface piece each vertex of a tile belongs to.
//!
//! A vertex lies on an edge between an above and a below voxel, so it belongs to one object and one
//! cell, and so does everything connected to it.
//!
//! The piece is looked up for every stretch of edges: to ask first whether it is that of the edge before
//! saves the lookup for half of them and cannot be foretold, which cost a tenth of the time. Processors do
//! nearly as many instructions at once here as they can, so time goes by their number: 44 million on a foam of
//! 130^3 voxels with each row's first run looked up where it is needed, 31 with all of them found first, words
//! behind a row's last edge left out, and counts where the piece is looked up; a quarter less time.

use crate::measure::MeshSums;
use crate::surface::edges::Edges;
use crate::surface::mesher::{BandView, TileBox};
use crate::surface::triangles::room_for;
use crate::sys::simd::dispatch;
use crate::sys::unchecked::{Unchecked, UncheckedMut};
use crate::volume::Voxel;
use std::hint::select_unpredictable as select;

/// Class of a cap's cell.
pub const CAP: u32 = u32::MAX;

/// The surface of a tile between one object and one cell.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    /// Class of the object.
    pub object: u32,
    /// Class of the cell, or [`CAP`]; of the component of which it is a part where cells are given.
    pub cell: u32,
    /// The cell where cells are given; 0 where they are not, and of a cap.
    pub given: u64,
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
        let room = if self.is_cap() {
            1 + self.triangles
        } else {
            // a part of a piece may have more triangles to a vertex than any piece
            room_for(self.vertices).max(1 + self.triangles)
        };
        self.first_triangle + room
    }

    /// True for the triangles that close the surface outside the volume.
    pub fn is_cap(&self) -> bool {
        self.cell == CAP
    }

    /// A piece without vertices.
    pub fn new(object: u32, cell: u32) -> Self {
        Piece {
            object,
            cell,
            given: 0,
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
    /// See [`Piece::key`].
    key: u64,
    vertices: u32,
    /// Those that the next tile counts.
    shared: u32,
    /// Its number.
    piece: u32,
}

impl Count {
    /// No class has this number, so no piece is between two of them.
    const NONE: Count = Count {
        pair: u64::MAX,
        key: u64::MAX,
        vertices: 0,
        shared: 0,
        piece: u32::MAX,
    };
}

/// Finds pieces by object and cell: open addressing.
#[derive(Debug, Default)]
pub struct PieceIndex {
    /// Two or more to each piece, a power of 2.
    slots: Vec<Count>,
    pieces: u32,
}

impl PieceIndex {
    fn reset(&mut self) {
        self.slots.clear();
        self.slots.resize(256, Count::NONE);
        self.pieces = 0;
    }

    /// The slot of a piece.
    #[inline(always)]
    fn find(&mut self, object: u32, cell: u32) -> usize {
        let pair = u64::from(object) << 32 | u64::from(cell);
        let at = self.place_of(pair);
        if self.slots[at].pair == pair {
            at
        } else {
            self.insert(pair)
        }
    }

    /// The slot of a pair, or the empty one where it would be.
    #[inline(always)]
    fn place_of(&self, pair: u64) -> usize {
        let mask = self.slots.len() - 1;
        let mut at = (pair.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as usize & mask;
        while self.slots[at].pair != pair && self.slots[at].pair != Count::NONE.pair {
            at = (at + 1) & mask;
        }
        at
    }

    #[cold]
    fn insert(&mut self, pair: u64) -> usize {
        if 2 * (self.pieces as usize + 1) > self.slots.len() {
            let more = vec![Count::NONE; 2 * self.slots.len()];
            for count in std::mem::replace(&mut self.slots, more) {
                if count.pair != Count::NONE.pair {
                    let at = self.place_of(count.pair);
                    self.slots[at] = count;
                }
            }
        }
        let at = self.place_of(pair);
        self.slots[at] = Count {
            pair,
            piece: self.pieces,
            ..Count::NONE
        };
        self.pieces += 1;
        at
    }

    /// The pieces by number.
    fn counts(&self) -> Vec<Count> {
        let mut counts = vec![Count::NONE; self.pieces as usize];
        for count in self.slots.iter().filter(|c| c.pair != Count::NONE.pair) {
            counts[count.piece as usize] = *count;
        }
        counts
    }
}

/// Which piece and which of its vertices lies on each crossed edge, by the edge's number. Some elements
/// more mean nothing. Pieces have their vertices one behind the other.
#[derive(Debug, Default)]
pub struct VertexAssignment {
    /// The piece.
    pub piece_of: Vec<u32>,
    /// The vertex, numbered within the piece.
    pub vertex_of: Vec<u32>,
    /// The first vertex of each piece in the tile's arrays.
    pub first_of: Vec<u32>,
    /// The run of the first voxel of each row.
    first_run: Vec<u32>,
}

impl VertexAssignment {
    /// Whether there is an element for each crossed edge.
    pub fn are_of(&self, edges: &Edges) -> bool {
        self.piece_of.len().min(self.vertex_of.len()) >= edges.count()
    }
}

/// Vertices written at once, whether a stretch has as many or not.
const AT_ONCE: usize = 8;

/// Rows by which classes are fetched ahead: each row of a tile has them elsewhere.
const ROWS_AHEAD: usize = 4;

/// Assigns every crossed edge its piece and vertex, and counts the pieces' vertices.
pub fn assign_vertices<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    index: &mut PieceIndex,
    pieces: &mut Vec<Piece>,
    sheets: &mut VertexAssignment,
) {
    index.reset();
    sheets.piece_of.resize(edges.count() + AT_ONCE, 0);
    sheets.vertex_of.resize(edges.count() + AT_ONCE, 0);
    let last_run = dispatch!(find_first_runs(view, tile, edges, &mut sheets.first_run));
    assert!((last_run as usize) < view.class_of_run.len() || edges.count() == 0);
    // SAFETY: one element for each crossed edge is written, and `AT_ONCE` from there on; runs are those of
    // rows, the last of which was compared
    let mut assigner = unsafe {
        Assigner {
            class_of_run: Unchecked::new(view.class_of_run),
            index,
            piece_of: UncheckedMut::new(&mut sheets.piece_of),
            vertex_of: UncheckedMut::new(&mut sheets.vertex_of),
            number: 0,
            last: 0,
        }
    };
    let first_run = &sheets.first_run;
    dispatch!(assign_inlined(tile, edges, first_run, &mut assigner));
    pieces.clear();
    let (mut vertex, mut triangle) = (0, 0);
    for count in index.counts() {
        let mut piece = Piece::new((count.pair >> 32) as u32, count.pair as u32);
        piece.key = count.key;
        piece.first_vertex = vertex;
        piece.vertices = count.vertices;
        vertex += count.vertices;
        piece.sums.vertices = u64::from(count.vertices - count.shared);
        piece.first_triangle = triangle;
        triangle = piece.end_of_faces();
        pieces.push(piece);
    }
    sheets.first_of.clear();
    sheets
        .first_of
        .extend(pieces.iter().map(|p| p.first_vertex));
}

/// Finds the run of each row's first voxel; returns the last run of all rows.
#[inline(always)]
fn find_first_runs<T: Voxel>(
    view: &BandView<T>,
    tile: &TileBox,
    edges: &Edges,
    first_run: &mut Vec<u32>,
) -> u32 {
    let slices = tile.cubes[2] as usize + 1;
    first_run.resize(edges.rows * slices, 0);
    let mut last = 0;
    let rows = first_run.iter_mut().zip(&edges.first).enumerate();
    for (number, (run, first)) in rows {
        *run = view.run_at(tile, [0, number % edges.rows, number / edges.rows]);
        // one more behind each edge along the row
        last = last.max(*run + (first[1] - first[0]));
    }
    last
}

#[inline(always)]
fn assign_inlined(tile: &TileBox, edges: &Edges, first_run: &[u32], assigner: &mut Assigner) {
    let cx = tile.cubes[0] as usize;
    let row = |number: usize| Row {
        start: number * edges.row_words,
        first_run: first_run[number],
    };
    for (number, [y, z], words) in edges.crossed_rows() {
        let [first_x, first_y, first_z] = edges.first[number];
        let end = edges.first[number + 1][0];
        let of_row = OfRow {
            edges,
            key: 3 * tile.linear([0, y, z]),
            shared: tile.shares_upper(1, y) || tile.shares_upper(2, z),
        };
        // the next tile counts the vertices on the last voxel's edges, of which none goes along the row
        let shares_last = !of_row.shared && !tile.is_last[0];
        let on_last = |axis: usize| shares_last && words[cx / 64][axis] >> (cx % 64) & 1 == 1;
        if let Some(&run) = first_run.get(number + edges.rows + ROWS_AHEAD) {
            assigner.class_of_run.prefetch(run as usize);
        }
        let here = row(number);
        if first_x < first_y {
            assigner.along_row(&here, &of_row, first_y);
        }
        if first_y < first_z {
            let next = row(number + 1);
            assigner.across_rows(1, [&here, &next], &of_row, first_z);
            if on_last(1) {
                assigner.share_last();
            }
        }
        if first_z < end {
            let next = row(number + edges.rows);
            assigner.across_rows(2, [&here, &next], &of_row, end);
            if on_last(2) {
                assigner.share_last();
            }
        }
    }
}

/// A voxel row of the tile.
struct Row {
    /// Its first word.
    start: usize,
    /// Run of its first voxel.
    first_run: u32,
}

/// What the vertices of a row have in common.
struct OfRow<'a> {
    edges: &'a Edges,
    /// Key of its first edge.
    key: u64,
    /// The next tile counts the vertices.
    shared: bool,
}

/// Gives the crossed edges their pieces in the order of their numbers.
struct Assigner<'a> {
    class_of_run: Unchecked<'a, u32>,
    index: &'a mut PieceIndex,
    piece_of: UncheckedMut<'a, u32>,
    vertex_of: UncheckedMut<'a, u32>,
    /// Of the next edge.
    number: usize,
    /// Slot of the piece of the edge before.
    last: usize,
}

impl Assigner<'_> {
    /// The edges along a row up to number `end`: each lies between a run and the next.
    #[inline(always)]
    fn along_row(&mut self, row: &Row, of_row: &OfRow, end: u32) {
        let mut run = row.first_run;
        let (mut at, mut key) = (row.start, of_row.key);
        while self.number < end as usize {
            let mut crossed = of_row.edges.words[at][0];
            let bits = of_row.edges.bits[at];
            while crossed != 0 {
                let bit = crossed.trailing_zeros();
                crossed &= crossed - 1;
                let is_above = bits >> bit & 1 == 1;
                let key = key + 3 * u64::from(bit);
                let (piece, vertex) = self.count([run, run + 1], is_above, 1, key, of_row);
                *self.piece_of.at_mut(self.number) = piece;
                *self.vertex_of.at_mut(self.number) = vertex;
                self.number += 1;
                run += 1;
            }
            at += 1;
            key += 3 * 64;
        }
    }

    /// The edges from a row to the next along `axis` up to number `end`: those of one stretch lie between the
    /// same two runs. A stretch can only begin where one of the runs does.
    #[inline(always)]
    fn across_rows(&mut self, axis: usize, rows: [&Row; 2], of_row: &OfRow, end: u32) {
        let mut first_run = rows.map(|r| r.first_run);
        let mut at = rows.map(|r| r.start);
        let mut key = of_row.key + axis as u64;
        let mut carry = [0; 2];
        // most rows end in a word for the last voxel alone, which seldom is reached
        while self.number < end as usize {
            let words = at.map(|at| &of_row.edges.words[at]);
            // runs begin behind the crossed edges along the row
            let starts = [0, 1].map(|i| words[i][0] << 1 | carry[i]);
            let bits = of_row.edges.bits[at[0]];
            let mut left = words[0][axis];
            let no_more = !left | starts[0] | starts[1];
            while left != 0 {
                let start = left.trailing_zeros();
                let upto = left ^ (left - 1);
                let past = no_more & !upto;
                let end = past.trailing_zeros();
                // the bits from the end on, none if it is the word's
                left &= (past & past.wrapping_neg()).wrapping_neg();
                let runs = [0, 1].map(|i| first_run[i] + (starts[i] & upto).count_ones());
                let is_above = bits >> start & 1 == 1;
                let key = key + 3 * u64::from(start);
                let (piece, vertex) = self.count(runs, is_above, end - start, key, of_row);
                self.put(piece, vertex, (end - start) as usize);
            }
            first_run = [0, 1].map(|i| first_run[i] + starts[i].count_ones());
            carry = words.map(|word| word[0] >> 63);
            at = at.map(|at| at + 1);
            key += 3 * 64;
        }
    }

    /// Counts edges between two runs, of which the first is above or the second; returns their piece
    /// and the first one's vertex.
    #[inline(always)]
    fn count(
        &mut self,
        runs: [u32; 2],
        is_above: bool,
        edges: u32,
        key: u64,
        of_row: &OfRow,
    ) -> (u32, u32) {
        let [a, b] = runs.map(|run| self.class_of_run.at(run as usize));
        let (object, cell) = (select(is_above, a, b), select(is_above, b, a));
        self.last = self.index.find(object, cell);
        let count = &mut self.index.slots[self.last];
        let first = count.vertices;
        count.vertices += edges;
        // only in the first row of a piece
        if key < count.key {
            count.key = key;
        }
        if of_row.shared {
            count.shared += edges;
        }
        (count.piece, first)
    }

    /// The next tile counts the last vertex.
    fn share_last(&mut self) {
        self.index.slots[self.last].shared += 1;
    }

    /// Gives the next `count` edges their vertices, the first of which is `vertex`.
    #[inline(always)]
    fn put(&mut self, piece: u32, vertex: u32, count: usize) {
        self.piece_of.put(self.number, [piece; AT_ONCE]);
        let vertices: [u32; AT_ONCE] = std::array::from_fn(|i| vertex + i as u32);
        self.vertex_of.put(self.number, vertices);
        for i in AT_ONCE..count {
            *self.piece_of.at_mut(self.number + i) = piece;
            *self.vertex_of.at_mut(self.number + i) = vertex + i as u32;
        }
        self.number += count;
    }
}
