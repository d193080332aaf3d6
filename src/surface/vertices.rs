//! All vertices of a tile, in batches: samples are gathered one by one, arithmetic runs over arrays.
//!
//! Both ways through this file, and [`normal`] and [`step_on_edge`] for one vertex, give the same
//! bits; a test holds them equal. Places of vertices and samples are fetched ahead.

use crate::grid::LATTICE;
use crate::surface::assign_pieces::VertexAssignment;
use crate::surface::edges::Edges;
use crate::surface::mesher::{BandView, TileBox};
use crate::surface::samples::{Ends, Samples};
use crate::surface::vertex::{NORMAL_RANGE, Stencil, normal, step_on_edge};
use crate::surface::vertex_buffer::VertexBuffer;
use crate::sys::simd::dispatch;
use crate::sys::unchecked::{Unchecked, UncheckedMut};
use crate::volume::{Slope, Voxel};

/// Vertices per batch.
const BATCH: usize = 64;

/// Rows by which samples are fetched ahead: 16 or 64 make no difference.
const ROWS_AHEAD: usize = 32;

/// Vertices by which the room for those of a piece is fetched ahead.
const VERTICES_AHEAD: usize = 16;

/// Vertices on their way.
struct Batch<T: Voxel> {
    /// Number of the first edge.
    first: usize,
    len: usize,
    /// Position of the lower end, then of the vertex.
    positions: [[f32; 3]; BATCH],
    axis: [u8; BATCH],
    /// Samples at the lower and the upper end.
    values: [[T; BATCH]; 2],
    /// Gradients at the lower and the upper end.
    slopes: [[[T::Slope; BATCH]; 3]; 2],
    /// Components of the normals.
    normals: [[f32; BATCH]; 3],
}

impl<T: Voxel> Batch<T> {
    fn new() -> Self {
        Batch {
            first: 0,
            len: 0,
            positions: [[0.0; 3]; BATCH],
            axis: [0; BATCH],
            values: [[T::zeroed(); BATCH]; 2],
            // what is not overwritten has ordinary normals
            slopes: [[[T::Slope::ONE; BATCH]; 3]; 2],
            normals: [[0.0; BATCH]; 3],
        }
    }

    #[inline(always)]
    fn push(&mut self, position: [f32; 3], axis: usize, ends: &Ends<T>) {
        // a full batch is handed out at once; the remainder spares a check for each array
        let i = self.len % BATCH;
        self.positions[i] = position;
        self.axis[i] = axis as u8;
        for end in 0..2 {
            self.values[end][i] = ends.values[end];
            for a in 0..3 {
                self.slopes[end][a][i] = ends.slopes[end][a];
            }
        }
        self.len += 1;
    }

    /// Computes positions and normals of the whole batch and hands them out.
    #[inline(always)]
    fn flush(&mut self, threshold: f64, places: &mut Unsorted) {
        let mut steps = [0; BATCH];
        for (i, step) in steps.iter_mut().enumerate() {
            let [v0, v1] = [self.values[0][i].to_f64(), self.values[1][i].to_f64()];
            *step = step_on_edge(v0, v1, threshold);
        }
        let along = steps.map(|step| step as f32 / LATTICE as f32);
        let mut ordinary = true;
        for (i, &t) in along.iter().enumerate() {
            let n: [f32; 3] = std::array::from_fn(|a| {
                let [g0, g1] = [self.slopes[0][a][i].to_f32(), self.slopes[1][a][i].to_f32()];
                -(g0 + (g1 - g0) * t)
            });
            let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
            let length = square.sqrt();
            ordinary &= NORMAL_RANGE.contains(&square);
            for a in 0..3 {
                self.normals[a][i] = n[a] / length;
            }
        }
        if !ordinary {
            self.extraordinary_normals(&steps, threshold);
        }
        let moved = self.positions.iter_mut().zip(&self.axis).zip(&along);
        moved.for_each(|((p, &axis), &t)| p[usize::from(axis)] += t);
        places.put(self.first, &self.positions[..self.len], &self.normals);
        self.first += self.len;
        self.len = 0;
    }

    /// The normals one by one, with what to do about gradients that are zero, huge or no numbers.
    #[cold]
    fn extraordinary_normals(&mut self, steps: &[u32; BATCH], threshold: f64) {
        for i in 0..self.len {
            let gradient = |end: usize| [0, 1, 2].map(|a| self.slopes[end][a][i].to_f32());
            // as all samples are classified; NaN is below
            let lower_above = self.values[0][i].to_f64() >= threshold;
            let axis = usize::from(self.axis[i]);
            let n = normal(gradient(0), gradient(1), steps[i], axis, lower_above);
            for a in 0..3 {
                self.normals[a][i] = n[a];
            }
        }
    }
}

/// Takes vertices in the order of their edges, each into its piece's part of the tile's arrays.
struct Unsorted<'a> {
    /// Piece and vertex by the number of the edge.
    piece_of: Unchecked<'a, u32>,
    vertex_of: Unchecked<'a, u32>,
    /// First vertex by piece.
    first_of: Unchecked<'a, u32>,
    positions: UncheckedMut<'a, [f32; 3]>,
    normals: UncheckedMut<'a, [f32; 3]>,
}

impl Unsorted<'_> {
    /// Takes the vertices of edges `first` and following, a batch at most.
    #[inline(always)]
    fn put(&mut self, first: usize, positions: &[[f32; 3]], normals: &[[f32; BATCH]; 3]) {
        // apart, or where they lie would be looked up again after each write
        let (piece_of, vertex_of, first_of) = (self.piece_of, self.vertex_of, self.first_of);
        let (mut to_positions, mut to_normals) = (self.positions.again(), self.normals.again());
        for (i, &position) in positions.iter().enumerate().take(BATCH) {
            let piece = piece_of.at(first + i) as usize;
            let vertex = (first_of.at(piece) + vertex_of.at(first + i)) as usize;
            to_positions.prefetch(vertex + VERTICES_AHEAD);
            to_normals.prefetch(vertex + VERTICES_AHEAD);
            *to_positions.at_mut(vertex) = position;
            *to_normals.at_mut(vertex) = [normals[0][i], normals[1][i], normals[2][i]];
        }
    }
}

/// Computes the vertices on all crossed edges, which `sheets` assigns to pieces, as many as `chunk` has.
pub fn place_vertices<T: Voxel>(
    edges: &Edges,
    view: &BandView<T>,
    tile: &TileBox,
    threshold: f64,
    sheets: &VertexAssignment,
    chunk: &mut VertexBuffer,
) {
    assert!(chunk.vertices() == edges.count() && sheets.are_of(edges));
    let [positions, normals] = chunk.vectors_mut();
    // SAFETY: every edge has a piece, and a vertex of it: pieces have their vertices one behind the
    // other, as many as there are edges
    let mut places = unsafe {
        Unsorted {
            piece_of: Unchecked::new(&sheets.piece_of),
            vertex_of: Unchecked::new(&sheets.vertex_of),
            first_of: Unchecked::new(&sheets.first_of),
            positions: UncheckedMut::new(positions),
            normals: UncheckedMut::new(normals),
        }
    };
    dispatch!(place_inlined(edges, view, tile, threshold, &mut places));
}

#[inline(always)]
fn place_inlined<T: Voxel>(
    edges: &Edges,
    view: &BandView<T>,
    tile: &TileBox,
    threshold: f64,
    places: &mut Unsorted,
) {
    let span = &view.voxels.span;
    let strides = [1, span.nx as usize, span.nx as usize * span.rows()];
    let samples = Samples::new(view.voxels.samples(), strides);
    let mut batch = Batch::new();
    let start = view
        .voxels
        .row_start(tile.first_cube[1], tile.first_cube[2]);
    let mut ahead = Ahead::new(start, strides, tile, &samples);
    for (number, place, words) in edges.crossed_rows() {
        ahead.fetch(number + ROWS_AHEAD, &samples);
        let row = Row::new(view, tile, &samples, strides, place);
        for axis in 0..3 {
            for (w, word) in words.iter().enumerate() {
                let mut crossed = word[axis];
                while crossed != 0 {
                    let bit = crossed.trailing_zeros();
                    crossed &= crossed - 1;
                    let x = tile.first_cube[0] + 64 * w as u32 + bit;
                    row.gather(x, axis, &mut batch);
                    if batch.len == BATCH {
                        batch.flush(threshold, places);
                    }
                }
            }
        }
    }
    batch.flush(threshold, places);
}

/// Fetches the samples around a tile's rows before they are needed, row by row: too short for the processor to see
/// them coming.
struct Ahead {
    /// The next row to fetch for: its number, counted through all slices.
    number: usize,
    /// The same, counted in its slice.
    row: usize,
    /// The sample that it is the first to need: two slices on, a voxel before the tile.
    sample: usize,
    /// Rows of the tile.
    rows: usize,
    /// From one row and from one slice to the next.
    strides: [usize; 2],
    /// Samples to a row.
    width: usize,
}

impl Ahead {
    /// Fetches what the first slice needs but for what is two slices on. Voxel 0 of the band in the tile's first row
    /// is sample `start`.
    #[inline(always)]
    fn new<T: Voxel>(
        start: usize,
        [_, y, z]: [usize; 3],
        tile: &TileBox,
        samples: &Samples<T>,
    ) -> Self {
        let [width, rows, _] = tile.cubes.map(|c| c as usize);
        let (width, rows) = (width + 3, rows + 1);
        // where there is no voxel before the tile, others are fetched, or none
        let first = (start + tile.first_cube[0] as usize).wrapping_sub(1);
        for slice in 0..3 {
            let slice = first.wrapping_add(slice * z).wrapping_sub(z);
            for row in 0..rows.min(ROWS_AHEAD) + 2 {
                samples.prefetch(slice.wrapping_add(row * y).wrapping_sub(y), width);
            }
        }
        Ahead {
            number: 0,
            row: 0,
            sample: first.wrapping_add(2 * z),
            rows,
            strides: [y, z],
            width,
        }
    }

    /// Fetches what rows before this number are the first to need.
    #[inline(always)]
    fn fetch<T: Voxel>(&mut self, end: usize, samples: &Samples<T>) {
        while self.number < end {
            samples.prefetch(self.sample, self.width);
            self.sample = self.sample.wrapping_add(self.strides[0]);
            self.row += 1;
            if self.row == self.rows {
                self.row = 0;
                let slice = self.strides[1].wrapping_sub(self.rows * self.strides[0]);
                self.sample = self.sample.wrapping_add(slice);
            }
            self.number += 1;
        }
    }
}

/// A voxel row of the tile.
struct Row<'a, T: Voxel> {
    samples: &'a Samples<'a, T>,
    all: &'a [T],
    strides: [usize; 3],
    dims: [u32; 3],
    /// In voxels of the grid.
    y: u32,
    z: u32,
    /// Sample of the row's voxel 0.
    start: usize,
    /// True if all differences around edges of this row from voxels 1..nx - 2 are central and the
    /// samples they need are in memory.
    central: bool,
}

impl<'a, T: Voxel> Row<'a, T> {
    fn new(
        view: &BandView<'a, T>,
        tile: &TileBox,
        samples: &'a Samples<'a, T>,
        strides: [usize; 3],
        [row, slice]: [usize; 2],
    ) -> Self {
        let [nx, ny, nz] = tile.dims.0;
        let (y, z) = (
            tile.first_cube[1] + row as u32,
            tile.first_cube[2] + slice as u32,
        );
        let start = view.voxels.row_start(y, z);
        let inner = |v: u32, n: u32| v >= 1 && v + 2 < n;
        let central = nx > 3
            && inner(y, ny)
            && inner(z, nz)
            && samples.covers(start + 1, start + nx as usize - 3);
        Row {
            samples,
            all: view.voxels.samples(),
            strides,
            dims: tile.dims.0,
            y,
            z,
            start,
            central,
        }
    }

    /// Gathers the ends of the edge from voxel `x` along `axis`.
    #[inline(always)]
    fn gather(&self, x: u32, axis: usize, batch: &mut Batch<T>) {
        let position = [x, self.y, self.z].map(|v| v as f32);
        let p = self.start + x as usize;
        if self.central && x >= 1 && x + 2 < self.dims[0] {
            // SAFETY: `central` says that the samples cover the row's voxels 1..=nx - 3
            let ends = unsafe {
                match axis {
                    0 => self.samples.ends::<0>(p),
                    1 => self.samples.ends::<1>(p),
                    _ => self.samples.ends::<2>(p),
                }
            };
            batch.push(position, axis, &ends);
        } else {
            batch.push(position, axis, &self.ends_at_face(p, x, axis));
        }
    }

    #[cold]
    fn ends_at_face(&self, p: usize, x: u32, axis: usize) -> Ends<T> {
        let [nx, ny, nz] = self.dims;
        let q = p + self.strides[axis];
        let gradient = |p: usize, step: [u32; 3]| {
            let at = [self.y + step[1], self.z + step[2]];
            let stencil = Stencil::new(at, [ny, nz], [self.strides[1], self.strides[2]]);
            stencil.gradient(self.all, p, x + step[0], nx)
        };
        let mut step = [0; 3];
        step[axis] = 1;
        Ends {
            values: [self.all[p], self.all[q]],
            slopes: [gradient(p, [0; 3]), gradient(q, step)],
        }
    }
}
