//! Meshing: a second pass, over what of the volume has a surface. All components are known, so each tile is written once
//! with its pieces as they stay; bands are meshed by themselves, in any order.
//!
//! What is still missing of a tile is how large its components are, which their meshes tell: its JSON chunk is only room.

mod band;
mod collect;
mod queue;
pub(crate) mod tile_writer;
mod tiles;
mod workers;
mod workspace_pool;

pub use band::{BandLoader, MeshBand};
pub use collect::MeshOutput;

use crate::checkpoint::{Checkpointer, TILES};
use crate::convert::cells::GivenCells;
use crate::convert::conversion::Conversion;
use crate::convert::known_band::KnownBands;
use crate::convert::layers::Layers;
use crate::convert::memory::WRITES;
use crate::convert::mesh::collect::TileCollector;
use crate::convert::mesh::tile_writer::TileWriter;
use crate::convert::mesh::workers::MeshWorkers;
use crate::convert::mesh::workspace_pool::WorkspacePool;
use crate::error::Result;
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::volume::Volume;
use std::sync::Arc;

/// What meshing works on.
pub struct MeshInput<'a> {
    /// The conversion.
    pub job: &'a Conversion<'a>,
    /// Its grid, which can be read in any order.
    pub volume: &'a dyn Volume,
    /// Its memory.
    pub memory: &'a Arc<MemoryPool>,
    /// Writes tiles.
    pub writer: &'a TileWriter,
    /// Bands with their components.
    pub known: KnownBands<'a>,
    /// The cells, where these are given.
    pub cells: Option<&'a GivenCells>,
}

/// All that meshing uses.
pub struct Meshing<'a> {
    job: &'a Conversion<'a>,
    volume: &'a dyn Volume,
    writer: &'a TileWriter,
    cells: Option<&'a GivenCells>,
    workspaces: WorkspacePool,
    writers: Option<BackgroundWriters>,
}

/// What meshing has made, and the last layer, still to be committed.
pub struct Meshed {
    /// The tiles and their pieces.
    pub output: MeshOutput,
    /// The last layer.
    pub last_layer: UncommittedLayer,
}

/// The last layer, some of whose tiles may be on their way to the disk.
pub struct UncommittedLayer {
    writers: Option<BackgroundWriters>,
    /// Tiles that have to be written before it is kept; `None` if it is.
    tiles: Option<u64>,
}

impl UncommittedLayer {
    /// Commits it, when threads that have nothing else to do have helped to write its tiles.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn commit(self, checkpointer: &mut Checkpointer) -> Result<()> {
        let Some(tiles) = self.tiles else {
            return Ok(());
        };
        if let Some(writers) = &self.writers {
            let written = rayon::broadcast(|_| writers.wait_for(tiles));
            written.into_iter().collect::<Result<()>>()?;
        }
        checkpointer.commit()
    }
}

/// Makes all tiles that are not made yet.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::TooDense`] if the volume is too dense for the limit,
/// [`crate::Error::Interrupted`], and those of [`Volume::read_box`].
pub fn mesh(input: &MeshInput, checkpointer: &mut Checkpointer) -> Result<Meshed> {
    let plan = input.job.plan;
    let mut collector = begin(input, checkpointer)?;
    let writes = MemoryReservation::new(input.memory, WRITES);
    let meshing = Meshing {
        job: input.job,
        volume: input.volume,
        writer: input.writer,
        cells: input.cells,
        workspaces: WorkspacePool::new(input.memory),
        writers: BackgroundWriters::new(plan.in_flight, plan.body, writes),
    };
    let [x, y, _] = plan.tiling.tiles();
    let done = collector.output.layers().count();
    let tiles = |layers: u32| [x, y, layers].map(u64::from).iter().product();
    let job = input.job;
    job.progress.begin("tiles", tiles(job.made.count()));
    job.progress.advance(tiles(done));
    let tiles = crate::volume::with_voxel_type!(
        input.volume.header().dtype,
        T => MeshWorkers::<T>::new(input, &meshing, &mut collector, checkpointer).run())?;
    Ok(Meshed {
        output: collector.output,
        last_layer: UncommittedLayer {
            writers: meshing.writers,
            tiles,
        },
    })
}

/// What is gathered before the first layer to do.
fn begin(input: &MeshInput, checkpointer: &mut Checkpointer) -> Result<TileCollector> {
    let files = checkpointer.files(TILES);
    let Some(mut at) = checkpointer.take(TILES) else {
        return TileCollector::new(&files, input.job.made.first, input.memory);
    };
    let layers = Layers {
        first: input.job.made.first,
        end: at.layer,
    };
    let collector = TileCollector::load(&files, &at.marks, &mut at.state, layers, input.memory)?;
    collector.ok_or_else(|| checkpointer.damaged())
}
