//! Gives the tiles their ids and measures.

pub(crate) mod batch_size;
pub(crate) mod batches;
mod finish_tile;
mod finisher;
pub(crate) mod shards;

use crate::checkpoint::Checkpointer;
use crate::convert::components::Components;
use crate::convert::conversion::Conversion;
use crate::convert::finalize::batches::Batches;
use crate::convert::finalize::finish_tile::changed;
use crate::convert::finalize::finisher::Finisher;
use crate::convert::finalize::shards::{FinishedLayer, LayerFinisher};
use crate::convert::memory::FINISHING;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::{Heads, TileRecord, TileWriter};
use crate::error::{Error, Result};
use crate::grid::{Placement, Tiling};
use crate::manifest::{LayerRecord, ShardTiles, Totals, shard_path, sums_of};
use crate::progress::Progress;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::tileset::TilesetWriter;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What finishing needs to know of the whole set.
#[derive(Clone, Copy)]
pub struct FinishSettings<'a> {
    /// Directory that will become the tile set.
    pub dir: &'a Path,
    /// What comes before the geometry of all tiles.
    pub heads: Heads<'a>,
    /// Where the grid lies, in the unit of the measures.
    pub placement: &'a Placement,
    /// The macrocubes.
    pub tiling: Tiling,
    /// Bytes that tiles may take while they are finished.
    pub memory: u64,
}

/// True once what goes on beside the finishing is to stop, too.
pub type Stop<'a> = dyn Fn() -> bool + Sync + 'a;

/// What finalizing works on.
pub struct FinalizeInput<'a> {
    /// The conversion.
    pub job: &'a Conversion<'a>,
    /// Its memory, some of which the tables have.
    pub memory: &'a Arc<MemoryPool>,
    /// Wrote the tiles.
    pub writer: &'a TileWriter,
    /// Gets their entries.
    pub set: &'a mut TilesetWriter,
    /// Where the grid lies, in the unit of the measures.
    pub placement: &'a Placement,
    /// The tiles.
    pub tiles: &'a mut MeshOutput,
    /// The sums of all components.
    pub components: &'a Components,
    /// Is told of finished layers.
    pub checkpointer: &'a mut Checkpointer,
}

/// Gives all tiles their ids, layer by layer, and adds their entries to the set. Returns what `beside` makes of the
/// components meanwhile, as long as nothing stops that: it is told what would.
///
/// # Errors
/// [`Error::Interrupted`], [`Error::Io`], [`Error::Usage`] if a tile would pass 4 GiB, and [`Error::Format`]
/// if a shard from before is not as it was written.
pub fn finalize<R: Send>(
    input: FinalizeInput,
    beside: impl FnOnce(&Components, &Stop) -> Result<R> + Send,
) -> Result<R> {
    let (job, writer) = (input.job, input.writer);
    let (tiles, components) = (input.tiles, input.components);
    let progress = job.progress;
    progress.begin("index", tiles.layers().count().into());
    let mut finishing = MemoryReservation::new(input.memory, FINISHING);
    finishing.grow_as_far_as(u64::MAX);
    let settings = FinishSettings {
        dir: &writer.dir,
        heads: writer.heads(),
        placement: input.placement,
        tiling: job.plan.tiling,
        memory: finishing.bytes(),
    };
    let mut ends = LayerFinisher::begin(input.set, input.checkpointer, progress);
    let failed = AtomicBool::new(false);
    let finish = || {
        let finished = finish_tiles(tiles, components, &settings, &mut ends, progress);
        failed.store(finished.is_err(), Ordering::Relaxed);
        finished
    };
    let stop = || failed.load(Ordering::Relaxed) || progress.interrupted();
    let (finished, made) = rayon::join(finish, || beside(components, &stop));
    finished?;
    made
}

/// Finishes the tiles of all layers.
fn finish_tiles(
    tiles: &mut MeshOutput,
    components: &Components,
    settings: &FinishSettings,
    ends: &mut LayerFinisher,
    progress: &dyn Progress,
) -> Result<()> {
    let layers = tiles.layers();
    let before = ends.finished().max(layers.first);
    for layer in layers.first..before {
        let finished = finished_layer(settings, layer, &tiles.tiles(layer)?)?;
        ends.add(layer, finished)?;
    }
    let mut finisher = Finisher::new(settings, components);
    let mut batches = Batches::new(tiles, before, settings.memory);
    let mut at_hand = finisher.next(&mut batches)?;
    while let Some(ready) = at_hand {
        // to finish what is at hand takes less time than to come back to it
        let over = progress.interrupted();
        at_hand = finisher.finish(ready, ends, &mut batches)?;
        if over {
            finisher.end(ends)?;
            return Err(Error::Interrupted);
        }
    }
    finisher.end(ends)
}

/// What was made of a layer in a process before this one.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if the shard is not as it was written.
fn finished_layer(
    settings: &FinishSettings,
    layer: u32,
    tiles: &[TileRecord],
) -> Result<Option<FinishedLayer>> {
    if tiles.is_empty() {
        return Ok(None);
    }
    let path = settings.dir.join(shard_path(layer));
    let file = File::open(&path).map_err(|e| Error::io(&path, "read", e))?;
    let (bytes, crc) = sums_of(&file).map_err(|e| Error::io(&path, "read", e))?;
    let not_ours = |_| changed(&path, bytes, bytes);
    let mut totals = Totals::default();
    let mut grids = tiles.iter().map(|t| t.grid);
    let mut same = true;
    for tile in ShardTiles::open(path.clone(), layer)? {
        let tile = tile.map_err(not_ours)?;
        same &= grids.next() == Some(tile.grid);
        totals.add_tile(&tile);
    }
    if !same || grids.next().is_some() {
        return Err(changed(&path, bytes, bytes));
    }
    let (z, tiles) = (layer, totals.tiles);
    Ok(Some(FinishedLayer {
        entry: LayerRecord {
            z,
            crc,
            tiles,
            bytes,
        },
        totals,
    }))
}
