//! How a conversion is cut to fit memory.

use crate::convert::ConvertOptions;
use crate::convert::cells::splitting_bytes;
use crate::convert::memory::{Cost, FINISHING, FOR_TABLES, PROGRAM, TABLES, WRITES, reading_bytes};
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
    /// Bands that are in memory at once.
    pub bands_at_once: u32,
    /// Worker threads.
    pub threads: usize,
    /// Predicted peak resident memory, in bytes.
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

/// Predicts the memory and chooses how to cut; `in_region` tells whether voxels outside of a region of interest are filled.
///
/// # Errors
/// [`Error::Memory`] with the smallest limit that works if `options.memory` is below it;
/// [`Error::Usage`] if macrocubes are too large for the encoding.
pub fn plan(
    volume: &dyn Volume,
    dims: Dims,
    options: &ConvertOptions,
    in_region: bool,
) -> Result<Plan> {
    let threads = crate::sys::simd::threads(options.threads);
    let tiling = Tiling {
        dims,
        macrocube: options.macrocube,
    };
    check_reach(options.encoding, tiling)?;
    let cost = Cost::of(volume, tiling, threads, options, in_region);
    // with less, tiles wait for each other
    let fits = |tiles: &usize| cost.total(1, *tiles) <= options.memory;
    let tiles_at_once = (1..=threads).rev().find(fits).unwrap_or(1);
    let smallest = Plan {
        tiling,
        bands_at_once: 1,
        threads,
        memory: cost.total(1, tiles_at_once),
        limit: options.memory,
        fixed: cost.program,
        front: cost.slabs,
        in_flight: 0,
        body: cost.body,
        per_triangle: cost.per_triangle,
    };
    // to find a region, the volume and a mask are read before
    let before = match in_region {
        true => reading_bytes() + volume.held_bytes() + dims.slice_voxels(),
        false => 0,
    };
    let needed = smallest.memory.max(before);
    if needed > options.memory {
        return Err(Error::Memory {
            limit: options.memory,
            needed,
            hint: "fewer --threads or a smaller --macrocube need less, a surface denser than that of a foam more"
                .into(),
        });
    }
    let plan = smallest.with_bands(&cost).with_writers();
    Ok(match options.split {
        Some(_) => plan.with_splitting(),
        None => plan,
    })
}

/// Refuses another volume, which `option` gives and which is read beside a volume before its conversion begins, if that
/// takes more memory than `limit` bytes.
///
/// # Errors
/// [`Error::Memory`].
pub fn check_read_beside(
    volume: &dyn Volume,
    other: &dyn Volume,
    option: &str,
    limit: u64,
) -> Result<()> {
    let needed =
        reading_bytes() + volume.held_bytes() + other.held_bytes() + other.mapped_bytes(0..1);
    if needed <= limit {
        return Ok(());
    }
    let hint = match other.held_bytes() {
        0 => format!("the file of {option} is read beside the volume before tiles are made"),
        _ => format!(
            "the file of {option} is read in parts so large: smaller chunks need less, or a file without any (.npy, .nrrd)"
        ),
    };
    Err(Error::Memory {
        limit,
        needed,
        hint,
    })
}

impl Plan {
    /// A band for each thread, and as many more as are read while others are meshed, as far as they fit.
    fn with_bands(self, cost: &Cost) -> Self {
        let [_, bands, layers] = self.tiling.tiles().map(u64::from);
        let most = (bands * layers).min(self.threads as u64) as u32;
        let with = |bands_at_once: u32| Plan {
            bands_at_once,
            memory: cost.total(bands_at_once, self.threads),
            ..self
        };
        let mut all = (2..=most).rev().map(with);
        all.find(|p| p.memory <= self.limit).unwrap_or(self)
    }

    /// Cells are split before tiles are made, in what is left of the limit then.
    fn with_splitting(mut self) -> Self {
        let bytes = self.fixed + splitting_bytes(self.tiling.dims, self.threads);
        self.memory = self.memory.max(bytes.min(self.limit));
        self
    }

    /// After all else, tiles may be on their way to the disk: a few of them.
    fn with_writers(mut self) -> Self {
        let in_flight = in_flight(self.threads);
        let bytes = in_flight as u64 * self.body;
        if self.memory + bytes <= self.limit {
            self.memory += bytes;
            self.in_flight = in_flight;
        }
        self
    }
}
