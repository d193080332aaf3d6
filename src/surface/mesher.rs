//! The mesh of one tile, grouped by surface piece.

use crate::grid::{Ambiguous, Dims, Tiling};
use crate::labels::{BandCells, Bits, Runs, Voxels};
use crate::measure::AreaScale;
use crate::strip::Triangle;
use crate::surface::assign_pieces::{Piece, PieceIndex, VertexAssignment, assign_vertices};
use crate::surface::caps::add_caps;
use crate::surface::edges::{Edges, known_or};
use crate::surface::split_pieces::{BYTES_PER_SPLIT_VERTEX, PieceSplitter};
use crate::surface::sums::sum_pieces;
use crate::surface::triangles::{CaseKernels, CubeMarcher, MarchInput};
use crate::surface::vertex_buffer::VertexBuffer;
use crate::surface::vertices::place_vertices;
use crate::sys::simd::dispatch;
use crate::volume::Voxel;
use std::ops::Range;

/// Bytes of buffers per triangle of a tile while it is made: about 100 are used, and buffers grow
/// in steps.
pub const BYTES_PER_TRIANGLE: u64 = 130;

/// Bytes of buffers for each cube of a tile, surface or not.
pub const BYTES_PER_CUBE: f64 = 1.5;

/// Bytes of buffers for each surface piece of a tile.
const BYTES_PER_PIECE: u64 = 256;

/// Bytes for each part that a piece is split to: as it is made, where it lies in the file, and its record.
const BYTES_PER_PART: u64 = 1024;

/// How large the mesh of a tile is.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Edges that the surface crosses.
    pub vertices: u64,
    /// No more surface pieces than this.
    pub pieces: u64,
}

impl Sizes {
    /// What the bits of a tile tell of its mesh.
    ///
    /// Every part of it that hangs together has a first voxel, before which there is none of its kind along any
    /// axis. Surfaces in a box are one fewer than such parts, above and below.
    pub fn of(bits: &Bits, tile: &TileBox) -> Sizes {
        dispatch!(sizes(bits, tile))
    }

    /// Bytes of buffers for making the tile, with so many for each triangle: there are about two to a crossed edge.
    pub fn bytes(&self, tile: &TileBox, per_triangle: u64) -> u64 {
        let cubes: f64 = tile.cubes.iter().map(|&c| f64::from(c)).product();
        let rest_of_page = VertexBuffer::rest_of_page(self.vertices as usize) as u64;
        2 * self.vertices * per_triangle
            + self.pieces * BYTES_PER_PIECE
            + (cubes * BYTES_PER_CUBE) as u64
            + rest_of_page
    }

    /// Bytes of buffers beside [`Sizes::bytes`] of this mesh for splitting its pieces, whatever they are split to.
    pub fn bytes_to_split(&self) -> u64 {
        self.vertices * BYTES_PER_SPLIT_VERTEX
    }

    /// Bytes of buffers for the parts that pieces are split to; these sizes are theirs. They lie beside those of the whole
    /// mesh.
    pub fn bytes_of_parts(&self, per_triangle: u64) -> u64 {
        let rest_of_page = VertexBuffer::rest_of_page(self.vertices as usize) as u64;
        2 * self.vertices * per_triangle + self.pieces * BYTES_PER_PART + rest_of_page
    }
}

#[inline(always)]
fn sizes(bits: &Bits, tile: &TileBox) -> Sizes {
    // nearly every tile has one or two words to a row
    match tile.words().len() {
        1 => sizes_in_rows::<1>(bits, tile),
        2 => sizes_in_rows::<2>(bits, tile),
        _ => sizes_in_rows::<0>(bits, tile),
    }
}

/// The same for a tile of `WORDS` words to a row, or of any number for 0.
#[inline(always)]
fn sizes_in_rows<const WORDS: usize>(bits: &Bits, tile: &TileBox) -> Sizes {
    let Range { start: word, end } = tile.words();
    let words = known_or::<WORDS>(end - word);
    let [low, high] = tile.ends_of_words();
    let outer_x = low & low.wrapping_neg();
    let (mut vertices, mut parts) = (0, 0);
    let (mut before_z, mut outer_z) = (None, !0);
    for slice in tile.slices_of(bits) {
        let rows = slice.chunks_exact(bits.row_words);
        let rows_z = before_z.unwrap_or(slice).chunks_exact(bits.row_words);
        let (mut before_y, mut outer_y) = (&slice[word..][..words], !0);
        for (row, row_z) in rows.zip(rows_z) {
            let [row, row_z] = [row, row_z].map(|row| &row[word..][..words]);
            let mut left = 0;
            for w in 0..words {
                let here = if w == 0 { low } else { !0 } & if w + 1 == words { high } else { !0 };
                let outer = if w == 0 { outer_x } else { 0 };
                let along_x = (row[w] ^ (row[w] << 1 | left)) & here;
                let [along_y, along_z] = [before_y[w], row_z[w]].map(|b| (row[w] ^ b) & here);
                let crossed = [along_x & !outer, along_y, along_z].map(u64::count_ones);
                vertices += u64::from(crossed.iter().sum::<u32>());
                let begins = here & (along_x | outer) & (along_y | outer_y) & (along_z | outer_z);
                parts += u64::from(begins.count_ones());
                left = row[w] >> 63;
            }
            (before_y, outer_y) = (row, 0);
        }
        (before_z, outer_z) = (Some(slice), 0);
    }
    Sizes {
        vertices,
        pieces: parts - 1,
    }
}

/// The cubes of one tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileBox {
    /// The grid.
    pub dims: Dims,
    /// Lowest cube.
    pub first_cube: [u32; 3],
    /// Number of cubes per axis, at least 1.
    pub cubes: [u32; 3],
    /// Per axis, whether the tile ends at the grid's end.
    pub is_last: [bool; 3],
}

impl TileBox {
    /// The cubes of tile `t` of a tiling.
    pub fn of(tiling: Tiling, t: [u32; 3]) -> Self {
        let ranges: [_; 3] = std::array::from_fn(|a| tiling.cubes(a, t[a]));
        TileBox {
            dims: tiling.dims,
            first_cube: ranges.clone().map(|r| r.start),
            cubes: ranges.clone().map(|r| r.end - r.start),
            is_last: std::array::from_fn(|a| ranges[a].end + 1 == tiling.dims.0[a]),
        }
    }

    /// The words of a row of bits that have its voxels.
    #[inline(always)]
    fn words(&self) -> Range<usize> {
        let [first, last] = [0, self.cubes[0]].map(|x| (self.first_cube[0] + x) as usize);
        first / 64..last / 64 + 1
    }

    /// Those bits of the first and of the last of these words that are of its voxels, if the others are.
    #[inline(always)]
    fn ends_of_words(&self) -> [u64; 2] {
        let [first, last] = [0, self.cubes[0]].map(|x| self.first_cube[0] + x);
        [!0 << (first % 64), !0 >> (63 - last % 64)]
    }

    /// The words of the rows that have its voxels, whole rows, by slice.
    #[inline(always)]
    pub fn slices_of<'a>(&self, bits: &'a Bits) -> impl Iterator<Item = &'a [u64]> {
        let row = (self.first_cube[1] - bits.span.y.start) as usize;
        let slice = (self.first_cube[2] - bits.span.z.start) as usize;
        let [rows, slices] = [1, 2].map(|axis| self.cubes[axis] as usize + 1);
        let (row_words, band_rows) = (bits.row_words, bits.span.rows());
        (slice..slice + slices).map(move |slice| {
            let first = (slice * band_rows + row) * row_words;
            &bits.words[first..][..rows * row_words]
        })
    }

    /// True if local voxel `v` lies on the upper plane along `axis` and the next tile counts it.
    #[inline]
    pub fn shares_upper(&self, axis: usize, v: usize) -> bool {
        v == self.cubes[axis] as usize && !self.is_last[axis]
    }

    /// Which of the cubes 64 w ..= 64 w + 63 of a row touch the volume's faces.
    #[inline]
    pub fn border_cubes(&self, w: usize, [y, z]: [usize; 2]) -> u64 {
        let outer = |axis: usize, v: usize| {
            v == 0 && self.first_cube[axis] == 0
                || v + 1 == self.cubes[axis] as usize && self.is_last[axis]
        };
        if outer(1, y) || outer(2, z) {
            return !0;
        }
        let last = self.cubes[0] as usize - 1;
        let low = u64::from(w == 0 && self.first_cube[0] == 0);
        let high = u64::from(last / 64 == w && self.is_last[0]) << (last % 64);
        low | high
    }

    /// Linear index of a local voxel in the grid.
    pub fn linear(&self, local: [usize; 3]) -> u64 {
        self.dims.linear(std::array::from_fn(|a| {
            self.first_cube[a] + local[a] as u32
        }))
    }
}

/// What the mesher needs of a band.
#[derive(Clone, Copy)]
pub struct BandView<'a, T> {
    /// Samples with the neighbours that gradients need.
    pub voxels: &'a Voxels<T>,
    /// Bits of the band.
    pub bits: &'a Bits,
    /// Runs of the bits.
    pub runs: &'a Runs,
    /// Class of each run.
    pub class_of_run: &'a [u32],
    /// The cells of voxels, where these are given.
    pub cells: Option<CellsView<'a>>,
}

/// The cells of a band that are parts of components.
#[derive(Clone, Copy)]
pub struct CellsView<'a> {
    /// Of each voxel.
    pub of_voxels: &'a BandCells,
    /// Of each class of voxels below, if all of its voxels are in one.
    pub of_class: &'a [Option<u64>],
    /// Tells whether there is memory for parts of these sizes.
    pub fits: &'a dyn Fn(&Sizes) -> bool,
}

impl<T: Voxel> BandView<'_, T> {
    /// Run of a tile's local voxel.
    #[inline(always)]
    pub fn run_at(&self, tile: &TileBox, [x, y, z]: [usize; 3]) -> u32 {
        let s = z + (tile.first_cube[2] - self.bits.span.z.start) as usize;
        let r = y + (tile.first_cube[1] - self.bits.span.y.start) as usize;
        let row = (s * self.bits.span.rows() + r) * self.bits.row_words;
        self.runs
            .at(self.bits, row, x + tile.first_cube[0] as usize)
    }

    /// Class of a tile's local voxel.
    pub fn class_at(&self, tile: &TileBox, local: [usize; 3]) -> u32 {
        self.class_of_run[self.run_at(tile, local) as usize]
    }
}

/// The mesh of a tile. Vertices and triangles are grouped by piece; within a piece vertices follow their lattice edges
/// by z, y, axis, x.
///
/// A piece's triangles are numbered from 1; number 0 stands for none, and is the element
/// [`Piece::first_triangle`] of `triangles`. Between pieces there may be elements without meaning.
#[derive(Debug, Default)]
pub struct TileMesh {
    /// The pieces, by their first vertex in lattice order; then caps.
    pub pieces: Vec<Piece>,
    /// Vertices.
    pub chunk: VertexBuffer,
    /// Triangles: corners are vertex numbers within the piece, counter-clockwise seen from below; mates are
    /// within the piece, too.
    pub triangles: Vec<Triangle>,
}

impl TileMesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> u64 {
        self.pieces.iter().map(|p| u64::from(p.triangles)).sum()
    }

    /// The triangles of a piece behind the one that stands for none.
    #[cfg(test)]
    pub fn piece(&self, piece: &Piece) -> &[Triangle] {
        &self.triangles[piece.faces()]
    }
}

/// Makes tile meshes; its buffers are reused from tile to tile.
#[derive(Debug, Default)]
pub struct TileMesher {
    edges: Edges,
    index: PieceIndex,
    sheets: VertexAssignment,
    splitter: PieceSplitter,
    /// The cubes.
    pub(crate) walk: CubeMarcher,
}

impl TileMesher {
    /// Meshes one tile into `out`; reuses its memory. True if the tile has any surface.
    ///
    /// # Errors
    /// The sizes of the parts that its pieces would be split to, if they do not fit.
    pub fn mesh<T: Voxel>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        settings: &MeshSettings,
        out: &mut TileMesh,
    ) -> Result<bool, Sizes> {
        out.pieces.clear();
        self.edges.find(view.bits, tile);
        let vertices = self.edges.count();
        out.chunk.begin(vertices);
        if vertices > 0 {
            self.mesh_open(view, tile, settings, out)?;
        }
        if settings.cap {
            add_caps(view, tile, settings, out);
        }
        Ok(!out.pieces.is_empty())
    }

    /// The surface inside the volume.
    fn mesh_open<T: Voxel>(
        &mut self,
        view: &BandView<T>,
        tile: &TileBox,
        settings: &MeshSettings,
        out: &mut TileMesh,
    ) -> Result<(), Sizes> {
        assign_vertices(
            view,
            tile,
            &self.edges,
            &mut self.index,
            &mut out.pieces,
            &mut self.sheets,
        );
        let (sheets, threshold) = (&self.sheets, settings.threshold);
        place_vertices(&self.edges, view, tile, threshold, sheets, &mut out.chunk);
        let faces = out.pieces.last().map_or(0, Piece::end_of_faces) as usize;
        room(&mut out.triangles, faces, faces / 2);
        let cut = MarchInput {
            edges: &self.edges,
            tile,
            sheets: &self.sheets,
        };
        self.walk.make(cut, CaseKernels::of(settings.rule), out);
        if let Some(cells) = view.cells {
            let found = (&self.edges, &self.sheets);
            self.splitter.split(view, tile, &cells, found, out)?;
        }
        sum_pieces(
            &mut out.pieces,
            out.chunk.numbers(),
            &out.triangles,
            &settings.area,
        );
        Ok(())
    }
}

/// Makes a list that tiles use one after the other at least so long, and with room for so many `more` where it has to grow.
/// What is in it has no meaning.
pub fn room<T: Copy + Default>(list: &mut Vec<T>, length: usize, more: usize) {
    if list.capacity() < length {
        // nothing is to be moved; room that no tile comes to use takes no memory
        *list = Vec::new();
        list.reserve_exact(length + more);
    }
    // what is left of a larger tile stays: to cut it off and clear it again costs time
    if list.len() < length {
        list.resize(length, T::default());
    }
}

/// What does not change from tile to tile.
#[derive(Debug, Clone, Copy)]
pub struct MeshSettings {
    /// The iso value.
    pub threshold: f64,
    /// Which voxels an ambiguous face joins.
    pub rule: Ambiguous,
    /// Close the surface outside the volume.
    pub cap: bool,
    /// Scale of areas.
    pub area: AreaScale,
}
