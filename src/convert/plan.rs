//! How a conversion is cut to fit memory.

use crate::convert::ConvertOptions;
use crate::error::{Error, Result};
use crate::grid::{Dims, Tiling};
use crate::labels::Span;
use crate::surface::{BYTES_PER_CUBE, BYTES_PER_TRIANGLE};
use crate::sys::background_writer::in_flight;
use crate::sys::huge_pages::held;
use crate::tile::{check_reach, codec};
use crate::volume::{SPOOL_PIECE, Volume};

/// Resident memory of the program itself with its threads' stacks and allocator slack.
const BASE: u64 = 20 << 20;
/// Bytes per voxel of a band's bits, run numbers and labels: 1/8 + 1/16, and 8 bytes for each of
/// about 0.06 runs a voxel (a foam has 0.05, both phases together).
const BAND_BYTES_PER_VOXEL: f64 = 0.19 + 0.06 * 8.0;
/// Triangles per cube that a tile's buffers are planned for; a foam has 0.3, noise 2.6. A tile that
/// needs more is checked against the limit when it is met.
const TILE_TRIANGLES_PER_CUBE: f64 = 0.4;
/// Bytes of a tile's geometry per triangle: 12 for half a vertex, and room for 10 of indices.
const BODY_BYTES_PER_TRIANGLE: f64 = 22.0;
/// Bytes planned for a tile at least.
const SMALLEST_TILE: u64 = 1 << 20;
/// Bytes of the last slice's labels, of a slab's components, surfaces and tiles, per pixel of a slice: a
/// foam takes 0.8, a thousand components to a megapixel 2. A slab that needs more is checked against the
/// limit when it is met.
const FRONT_BYTES_PER_PIXEL: f64 = 2.4;

/// What fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// The tiles.
    pub tiling: Tiling,
    /// Bands of a slab that are in memory at once. If it is all of them, voxels are read once; else
    /// a slab is read twice, first to label it and then to mesh it.
    pub bands_at_once: u32,
    /// Bands of the next slabs for which there is memory besides that of a slab; 0 if none of them is read before the
    /// slab in hand has ended. Most are prepared in the memory of bands whose tiles are made.
    pub ahead: u32,
    /// There is memory for all bands of the next slab, too, where components often turn out to be one.
    pub next_slab: bool,
    /// Worker threads.
    pub threads: usize,
    /// Predicted peak resident memory, in bytes, without the next slab.
    pub memory: u64,
    /// The limit asked for, in bytes.
    pub limit: u64,
    /// Bytes of it that no buffer is counted for: the program itself and what the volume keeps.
    pub fixed: u64,
    /// Bytes of it planned for a slab's components, surfaces and tiles.
    pub front: u64,
    /// Tiles that may be on their way to the disk while others are made.
    pub in_flight: usize,
    /// Bytes that the geometry of each of them may have.
    pub body: u64,
    /// Bytes of buffers for each triangle of a tile while it is made.
    pub per_triangle: u64,
}

impl Plan {
    /// Bytes that tiles may take while they are finished: beside them lie the tables, and what is on its way to the
    /// disk.
    pub fn finishing(&self) -> u64 {
        let others = self.fixed + self.in_flight as u64 * self.body + self.tables();
        self.limit.saturating_sub(others)
    }

    /// Bytes that the tables may take.
    pub fn tables(&self) -> u64 {
        self.limit / 8
    }

    /// Refuses a tile that takes so many bytes while it is finished, if there will not be as many.
    ///
    /// # Errors
    /// [`Error::TooDense`].
    pub fn check_finishing(&self, bytes: u64) -> Result<()> {
        let left = self.finishing();
        if bytes <= left {
            return Ok(());
        }
        // an eighth of what is added goes to the tables
        let more = ((bytes - left) as f64 * 8.0 / 7.0).ceil() as u64;
        Err(Error::TooDense {
            limit: self.limit,
            needed: self.limit.saturating_add(more),
        })
    }
}

fn per_triangle(options: &ConvertOptions) -> u64 {
    let codec = codec(options.encoding);
    let encoding = match codec.is_encoded_early(&options.form()) {
        true => codec.bytes_per_triangle(),
        false => 0,
    };
    BYTES_PER_TRIANGLE + encoding
}

/// Predicts the memory and chooses how to cut.
///
/// # Errors
/// [`Error::Memory`] with the smallest limit that works if `options.memory` is below it;
/// [`Error::Usage`] if macrocubes are too large for the encoding.
pub fn plan(volume: &dyn Volume, dims: Dims, options: &ConvertOptions) -> Result<Plan> {
    let threads = crate::sys::simd::threads(options.threads);
    let tiling = Tiling {
        dims,
        macrocube: options.macrocube,
    };
    check_reach(options.encoding, tiling)?;
    let bands = tiling.tiles()[1];
    let cost = Cost::of(volume, tiling, threads, per_triangle(options));
    let make = |bands_at_once: u32, ahead: u32| Plan {
        tiling,
        bands_at_once,
        ahead,
        next_slab: false,
        threads,
        memory: cost.total(bands_at_once, ahead),
        limit: options.memory,
        fixed: cost.base,
        front: cost.front,
        in_flight: 0,
        body: cost.body,
        per_triangle: cost.per_triangle,
    };
    let smallest = make(1, 0);
    if smallest.memory > options.memory {
        return Err(Error::Memory {
            limit: options.memory,
            needed: smallest.memory,
            hint: "fewer --threads or a smaller --macrocube need less".into(),
        });
    }
    let mut best = smallest;
    // a band for two threads at least: so one thread goes on while the other one makes the last tile of a slab
    let few = (threads as u64).div_ceil(2).min(bands.into()) as u32;
    let whole = [make(bands, few), make(bands, 0)];
    let parts = (2..bands).rev().map(|b| make(b, 0));
    if let Some(fits) = whole
        .into_iter()
        .chain(parts)
        .find(|p| p.memory <= options.memory)
    {
        best = fits;
    }
    // after all else, tiles may be on their way: a few of them, next to a slab
    let bytes = in_flight(threads) as u64 * cost.body;
    if best.memory + bytes <= options.memory {
        best.memory += bytes;
        best.in_flight = in_flight(threads);
    }
    // then a band for each other thread, which may be in the middle of the last tile of one
    let others = u64::from(bands) * u64::from(tiling.tiles()[2].saturating_sub(1));
    let each = others
        .min(threads as u64 - 1)
        .saturating_sub(best.ahead.into());
    if best.ahead > 0 && best.in_flight > 0 {
        let more = each.min((options.memory - best.memory) / cost.band.max(1));
        best.memory += more * cost.band;
        best.ahead += more as u32;
        // at last all bands of another slab, which few volumes come to take
        best.next_slab = best.memory + u64::from(bands) * cost.band <= options.memory;
    }
    Ok(best)
}

/// Predicted bytes of the parts.
struct Cost {
    base: u64,
    front: u64,
    body: u64,
    band: u64,
    tile: u64,
    per_triangle: u64,
    threads: u64,
}

impl Cost {
    fn of(volume: &dyn Volume, tiling: Tiling, threads: usize, per_triangle: u64) -> Self {
        let [nx, ny, nz] = tiling.dims.0;
        let (y, z) = (tiling.cubes(1, 0), tiling.cubes(2, 0));
        let span = Span {
            nx,
            y: y.start..y.end + 1,
            z: z.start..z.end + 1,
        };
        let samples = span.with_neighbours(Dims([nx, ny, nz])).voxels() as f64;
        let bytes = volume.header().dtype.bytes() as f64;
        let band = samples * bytes + span.voxels() as f64 * BAND_BYTES_PER_VOXEL;
        let cubes: f64 = (0..3).map(|a| f64::from(tiling.cubes(a, 0).end)).product();
        let tile = cubes * TILE_TRIANGLES_PER_CUBE * per_triangle as f64 + cubes * BYTES_PER_CUBE;
        let body = (cubes * TILE_TRIANGLES_PER_CUBE * BODY_BYTES_PER_TRIANGLE) as usize;
        let held = held(body, body);
        let slices = span.with_neighbours(tiling.dims).z;
        // streams are unpacked while tiles are made
        let unpacking = if volume.random_access() {
            0
        } else {
            SPOOL_PIECE
        };
        let front = f64::from(nx) * f64::from(ny) * FRONT_BYTES_PER_PIXEL;
        Cost {
            base: BASE + volume.held_bytes() + unpacking + 2 * volume.mapped_bytes(slices),
            front: front as u64,
            body: held as u64,
            band: band as u64,
            // small tiles differ most from the mean
            per_triangle,
            tile: (tile as u64).max(SMALLEST_TILE) + (held - body) as u64,
            threads: threads as u64,
        }
    }

    fn total(&self, bands_at_once: u32, ahead: u32) -> u64 {
        let bands = u64::from(bands_at_once) + u64::from(ahead);
        self.base + self.front + bands * self.band + self.threads * self.tile
    }
}
