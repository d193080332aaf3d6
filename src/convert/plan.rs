//! How a conversion is cut to fit memory.

use crate::convert::ConvertOptions;
use crate::convert::memory::{Cost, FINISHING, FOR_TABLES, PROGRAM, TABLES, WRITES};
use crate::error::{Error, MemoryUse, Result};
use crate::grid::{Dims, Tiling};
use crate::sys::background_writer::in_flight;
use crate::sys::memory_pool::MemoryPool;
use crate::tile::check_reach;
use crate::volume::Volume;
use std::sync::Arc;

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
        FOR_TABLES.of(self.limit)
    }

    /// The memory of the conversion.
    pub fn pool(&self) -> Arc<MemoryPool> {
        MemoryPool::new(self.limit, PROGRAM, self.fixed)
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
        // some of what is added goes to the tables
        let needed = self
            .limit
            .saturating_add(FOR_TABLES.with_rest(bytes - left));
        let uses = [
            (PROGRAM, self.fixed),
            (WRITES, self.in_flight as u64 * self.body),
            (TABLES, FOR_TABLES.of(needed)),
            (FINISHING, bytes),
        ];
        Err(Error::TooDense {
            limit: self.limit,
            needed,
            uses: uses.map(|(by, bytes)| MemoryUse { by, bytes }).to_vec(),
        })
    }
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
    let cost = Cost::of(volume, tiling, threads, options);
    let smallest = Plan {
        tiling,
        bands_at_once: 1,
        ahead: 0,
        next_slab: false,
        threads,
        memory: cost.total(1),
        limit: options.memory,
        fixed: cost.program,
        front: cost.slabs,
        in_flight: 0,
        body: cost.body,
        per_triangle: cost.per_triangle,
    };
    if smallest.memory > options.memory {
        return Err(Error::Memory {
            limit: options.memory,
            needed: smallest.memory,
            hint: "fewer --threads or a smaller --macrocube need less".into(),
        });
    }
    Ok(smallest
        .with_bands(&cost)
        .with_writers()
        .with_next_slab(&cost))
}

impl Plan {
    /// As many bands of a slab as fit, and a few of the next one if there is memory for all of this one.
    fn with_bands(self, cost: &Cost) -> Self {
        let bands = self.tiling.tiles()[1];
        let with = |bands_at_once: u32, ahead: u32| Plan {
            bands_at_once,
            ahead,
            memory: cost.total(u64::from(bands_at_once) + u64::from(ahead)),
            ..self
        };
        // a band for two threads at least: so one thread goes on while the other one makes the last tile of a slab
        let few = (self.threads as u64).div_ceil(2).min(bands.into()) as u32;
        let whole = [with(bands, few), with(bands, 0)];
        let parts = (2..bands).rev().map(|b| with(b, 0));
        let mut all = whole.into_iter().chain(parts);
        all.find(|p| p.memory <= self.limit).unwrap_or(self)
    }

    /// After all else, tiles may be on their way to the disk: a few of them, next to a slab.
    fn with_writers(mut self) -> Self {
        let in_flight = in_flight(self.threads);
        let bytes = in_flight as u64 * self.body;
        if self.memory + bytes <= self.limit {
            self.memory += bytes;
            self.in_flight = in_flight;
        }
        self
    }

    /// Then a band for each other thread, which may be in the middle of the last tile of one; at last all bands of
    /// another slab, which few volumes come to take.
    fn with_next_slab(mut self, cost: &Cost) -> Self {
        if self.ahead == 0 || self.in_flight == 0 {
            return self;
        }
        let [_, bands, layers] = self.tiling.tiles().map(u64::from);
        let others = bands * layers.saturating_sub(1);
        let each = others
            .min(self.threads as u64 - 1)
            .saturating_sub(self.ahead.into());
        let more = each.min((self.limit - self.memory) / cost.band.max(1));
        self.memory += more * cost.band;
        self.ahead += more as u32;
        self.next_slab = self.memory + bands * cost.band <= self.limit;
        self
    }
}
