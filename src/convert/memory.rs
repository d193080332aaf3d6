//! What of `--memory` goes where in a conversion: who takes it, what is planned for each, and all shares of it.
//!
//! | who | planned | where it turns out to be more |
//! |---|---|---|
//! | [`PROGRAM`] | [`PROGRAM_BYTES`], and what the volume says that it keeps | never |
//! | [`BANDS`] | so many for a sample and for a voxel | fewer bands at once, see `one_by_one` in `label/queue.rs` |
//! | [`SLABS`] | so many for a pixel of a slice | fewer bands at once |
//! | [`SPLITTING`] | what is left between labelling and meshing | never |
//! | [`WALLS`] | nothing: they are found before tiles are made | never, but in bands of noise |
//! | [`NEW_TILES`] | so many for a cube, in each thread | tiles wait for each other, then fewer bands |
//! | [`WRITES`] | a few tiles, if there is room | they are written at once |
//! | [`TABLES`] | [`FOR_TABLES`] of the limit | the rest of them lies on the disk |
//! | [`FINISHING`] | what is left beside the tables | fewer tiles at once |
//!
//! All of them take it from one pool. What does not fit alone is [`crate::Error::TooDense`], which lists who has what.

use crate::convert::{ConvertOptions, Labels};
use crate::grid::{Dims, Tiling};
use crate::labels::Span;
use crate::manifest::Layout;
use crate::surface::{BYTES_PER_CUBE, BYTES_PER_SPLIT_VERTEX, BYTES_PER_TRIANGLE};
use crate::sys::huge_pages::held;
use crate::sys::memory_pool::Share;
use crate::tile::codec;
use crate::volume::{SPOOL_PIECE, Volume};

/// The program itself, and what the volume keeps.
pub const PROGRAM: &str = "the program and the open volume";
/// Samples, bits, runs and labels of bands.
pub const BANDS: &str = "bands of voxels";
/// What a slab has in components, surfaces and tiles.
pub const SLABS: &str = "components and surfaces of slabs";
/// Blocks of distances and basins while cells are split.
pub const SPLITTING: &str = "the splitting of cells";
/// Chords of walls.
pub const WALLS: &str = "walls between cells";
/// Buffers of tiles while they are meshed.
pub const NEW_TILES: &str = "tiles that are made";
/// Tiles that are handed to threads that write.
pub const WRITES: &str = "tiles that are being written";
/// Components and surfaces of the whole volume.
pub const TABLES: &str = "tables of components";
/// Tiles that get their ids and measures.
pub const FINISHING: &str = "tiles that get their ids";

/// Of the limit, for [`TABLES`].
pub const FOR_TABLES: Share = Share::new(1, 8);
/// Of that, for each of the three tables.
pub const FOR_EACH_TABLE: Share = Share::new(1, 3);
/// Of that, for what walls tell of cells: little of each.
pub const FOR_WALLS_OF_CELLS: Share = Share::new(1, 32);
/// Of the limit, for chords of walls that are sorted: no tile is made then.
pub const FOR_WALLS: Share = Share::new(1, 64);
/// Of the memory for [`FINISHING`], for the entries of a part of a layer: two parts are in memory.
pub const FOR_ENTRIES: Share = Share::new(1, 8);
/// Of the same, for tiles that are finished at once.
pub const FOR_TILES_AT_ONCE: Share = Share::new(3, 4);
/// Bytes of the same with which the next batch of tiles is made ready beside one: ten times what it takes.
pub const FOR_NEXT_BATCH: u64 = 64 << 20;

/// Pieces of some tiles whose cells are measured once for all of them, at most: 5 MB of measures.
pub const KNOWN_PIECES: usize = 1 << 14;

/// Resident memory of the program itself with the stacks and the allocator slack of two threads.
const PROGRAM_BYTES: u64 = 20 << 20;
/// The same of each thread more: 16 of them took 8 MB more than was planned without.
const BYTES_PER_THREAD: u64 = 768 << 10;
/// Bytes per voxel of a band's bits, run numbers and labels: 1/8 + 1/16, and 8 bytes for each of
/// about 0.06 runs a voxel (a foam has 0.05, both phases together).
const BAND_BYTES_PER_VOXEL: f64 = 0.19 + 0.06 * 8.0;
/// Bytes per voxel of a band's bits that tell what is inside a region of interest.
const INSIDE_BYTES_PER_VOXEL: f64 = 0.125;
/// Bytes of the last slice's labels, of a slab's components, surfaces and tiles, per pixel of a slice: a
/// foam takes 0.8, a thousand components to a megapixel 2. A slab that needs more is checked against the
/// limit when it is met.
const SLAB_BYTES_PER_PIXEL: f64 = 2.4;
/// Bytes per voxel of a band for its cells, where they are given: 8 for each of as many pieces as there are runs.
const CELLS_BYTES_PER_VOXEL: f64 = 0.06 * 8.0;
/// Triangles per cube that a tile's buffers are planned for; a foam has 0.3. A tile that needs more is checked against the
/// limit when it is met.
const TILE_TRIANGLES_PER_CUBE: f64 = 0.4;
/// The same of noise, which has the most.
const TRIANGLES_PER_CUBE_OF_NOISE: f64 = 2.6;
/// Bytes of a tile's geometry per triangle: 12 for half a vertex, and room for 10 of indices.
const BODY_BYTES_PER_TRIANGLE: f64 = 22.0;
/// Bytes planned for a tile at least: small tiles differ most from the mean.
const SMALLEST_TILE: u64 = 1 << 20;

/// Bytes for each piece of the tiles of a batch: as the scan wrote it, its ids, and its group, also as JSON.
pub const BYTES_PER_ENTRY: u64 = 400;
/// Bytes for each piece of a tile that is being finished: its node, and three times the JSON of that.
pub const BYTES_PER_NODE: u64 = 4096;
/// Bytes for each piece of a tile with a node for each, while it is finished or read: its nodes, and the JSON of all
/// of them, some 1300 bytes each. To finish 91,125 pieces took 2600 bytes each, and to verify them 3600.
pub const BYTES_PER_OWN_NODE: u64 = 4000;
/// Bytes of samples that are read at once before a conversion begins, at most.
const SAMPLES_AT_ONCE: u64 = 4 << 20;

/// Bytes that a volume of labels or of a mask is read in, besides what it keeps.
pub fn reading_bytes() -> u64 {
    PROGRAM_BYTES + SAMPLES_AT_ONCE
}

/// Predicted bytes of the parts of a conversion.
pub struct Cost {
    /// Of [`PROGRAM`].
    pub program: u64,
    /// Of [`SLABS`].
    pub slabs: u64,
    /// Of a band.
    pub band: u64,
    /// Of a tile that is made.
    pub tile: u64,
    /// Of each triangle of that, if it has more than planned.
    pub per_triangle: u64,
    /// Of a tile that is written.
    pub body: u64,
}

impl Cost {
    /// Of a conversion of a volume that is cut so.
    pub fn of(
        volume: &dyn Volume,
        tiling: Tiling,
        threads: usize,
        options: &ConvertOptions,
        in_region: bool,
    ) -> Self {
        let [nx, ny, nz] = tiling.dims.0;
        let (y, z) = (tiling.cubes(1, 0), tiling.cubes(2, 0));
        let span = Span {
            nx,
            y: y.start..y.end + 1,
            z: z.start..z.end + 1,
        };
        let samples = span.with_neighbours(Dims([nx, ny, nz])).voxels() as f64;
        let bytes = volume.header().dtype.bytes() as f64;
        let inside = match in_region {
            true => INSIDE_BYTES_PER_VOXEL,
            false => 0.0,
        };
        let given = options.labels.is_some() || options.split.is_some();
        let cells = if given { CELLS_BYTES_PER_VOXEL } else { 0.0 };
        let per_voxel = BAND_BYTES_PER_VOXEL + inside + cells;
        let band = samples * bytes + span.voxels() as f64 * per_voxel;
        let per_triangle = per_triangle(options);
        let cubes: f64 = (0..3).map(|a| f64::from(tiling.cubes(a, 0).end)).product();
        let triangles = cubes * triangles_per_cube(options);
        // pieces that hold several cells are in memory twice: whole, and in parts
        let in_buffers = match given {
            true => 2 * per_triangle + BYTES_PER_SPLIT_VERTEX / 2,
            false => per_triangle,
        };
        let tile = triangles * in_buffers as f64 + cubes * BYTES_PER_CUBE;
        let body = (triangles * BODY_BYTES_PER_TRIANGLE) as usize;
        let held = held(body, body);
        let slices = span.with_neighbours(tiling.dims).z;
        // streams are unpacked while tiles are made
        let unpacking = if volume.random_access() {
            0
        } else {
            SPOOL_PIECE
        };
        let slabs = f64::from(nx) * f64::from(ny) * SLAB_BYTES_PER_PIXEL;
        Cost {
            program: PROGRAM_BYTES
                + threads.saturating_sub(2) as u64 * BYTES_PER_THREAD
                + volume.held_bytes()
                + options.labels.as_ref().map_or(0, Labels::held_bytes)
                + unpacking
                + 2 * volume.mapped_bytes(slices),
            slabs: slabs as u64,
            band: band as u64,
            tile: (tile as u64).max(SMALLEST_TILE) + (held - body) as u64,
            per_triangle,
            body: held as u64,
        }
    }

    /// Of all, with so many bands and tiles at once.
    pub fn total(&self, bands: u32, tiles: usize) -> u64 {
        self.program + self.slabs + u64::from(bands) * self.band + tiles as u64 * self.tile
    }
}

/// Triangles per cube that a tile's buffers are planned for: voxels that are means of several have more of them.
fn triangles_per_cube(options: &ConvertOptions) -> f64 {
    let factors = options.filters().into_iter().map(|filter| filter.factor());
    let factor: f64 = factors.map(f64::from).product();
    (TILE_TRIANGLES_PER_CUBE * factor).min(TRIANGLES_PER_CUBE_OF_NOISE)
}

/// Bytes of buffers for each triangle of a tile while it is made.
fn per_triangle(options: &ConvertOptions) -> u64 {
    let codec = codec(options.encoding);
    // other tiles of floats stay as they are, but for those of very many pieces
    let plain = codec.keeps_floats() && options.layout != Layout::Merged;
    match plain {
        true => BYTES_PER_TRIANGLE,
        false => BYTES_PER_TRIANGLE + codec.bytes_per_triangle(),
    }
}
