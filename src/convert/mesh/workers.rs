//! Threads that load bands and make their tiles.

use crate::checkpoint::{Checkpointer, Marks, TILES};
use crate::convert::label::span_of;
use crate::convert::mesh::band::{BandLoader, MeshBand};
use crate::convert::mesh::collect::TileCollector;
use crate::convert::mesh::queue::{Limits, MeshQueue, MeshTask, TileTask};
use crate::convert::mesh::{MeshInput, Meshing};
use crate::convert::shared_queue::{Queue, SharedQueue};
use crate::error::{Error, Result};
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::locks::{into_inner, lock};
use crate::volume::Voxel;
use std::sync::Mutex;

/// All that the threads share.
pub struct MeshWorkers<'a, T> {
    input: &'a MeshInput<'a>,
    meshing: &'a Meshing<'a>,
    loader: BandLoader<'a>,
    collector: Mutex<&'a mut TileCollector>,
    pending: Mutex<PendingCommit<'a>>,
    queue: SharedQueue<MeshQueue<MeshBand<T>>>,
}

/// Keeps layers that have ended when their tiles are on the disk, while others are made.
struct PendingCommit<'a> {
    checkpointer: &'a mut Checkpointer,
    writers: Option<&'a BackgroundWriters>,
    /// Tiles that have to be written before what the checkpointer has ready is kept; `None` if it has nothing.
    tiles: Option<u64>,
    /// Layers that are ready, and those of them that are kept.
    ready: u32,
    kept: u32,
}

impl PendingCommit<'_> {
    /// True if there is something to keep whose tiles are written.
    fn is_written(&self) -> bool {
        let written = |tiles| self.writers.is_none_or(|w| w.is_done(tiles));
        self.tiles.is_some_and(written)
    }

    /// Keeps what is ready, after its tiles. If they cannot be written, it never is.
    fn commit(&mut self) -> Result<()> {
        let Some(tiles) = self.tiles.take() else {
            return Ok(());
        };
        self.writers.map_or(Ok(()), |w| w.wait_for(tiles))?;
        self.checkpointer.commit()?;
        self.kept = self.ready;
        Ok(())
    }

    /// Ends a layer: keeps the one before, has this one ready, which `end` does, and keeps it if its tiles are
    /// written.
    fn end(&mut self, end: impl FnOnce(&mut Checkpointer) -> Result<()>) -> Result<()> {
        self.commit()?;
        end(self.checkpointer)?;
        self.ready += 1;
        // its tiles are among them
        self.tiles = Some(self.writers.map_or(0, BackgroundWriters::handed));
        self.commit_if_written()
    }

    fn commit_if_written(&mut self) -> Result<()> {
        match self.is_written() {
            true => self.commit(),
            false => Ok(()),
        }
    }
}

impl<'a, T: Voxel + Default> MeshWorkers<'a, T> {
    /// Will mesh what the collector has not.
    pub fn new(
        input: &'a MeshInput,
        meshing: &'a Meshing,
        collector: &'a mut TileCollector,
        checkpointer: &'a mut Checkpointer,
    ) -> Self {
        let plan = input.job.plan;
        let [_, bands, _] = plan.tiling.tiles();
        let limits = Limits {
            bands,
            layers: input.job.made.end,
            at_once: plan.bands_at_once,
        };
        let before = collector.output.layers().end;
        let queue = MeshQueue::new(limits, before);
        MeshWorkers {
            input,
            meshing,
            loader: BandLoader {
                volume: input.volume,
                known: input.known,
                cells: input.cells.map(|cells| &cells.rows),
                cap: input.job.options.cap,
                memory: input.memory,
            },
            collector: Mutex::new(collector),
            pending: Mutex::new(PendingCommit {
                checkpointer,
                writers: meshing.writers.as_ref(),
                tiles: None,
                ready: before,
                kept: before,
            }),
            queue: SharedQueue::new(queue),
        }
    }

    /// Meshes with all threads. Returns how many tiles have to be written before the last layer is kept.
    ///
    /// # Errors
    /// As of [`mesh`](crate::convert::mesh::mesh).
    pub fn run(self) -> Result<Option<u64>> {
        let progress = self.input.job.progress;
        rayon::broadcast(|_| {
            let (take, then) = (|task| self.take(task), || self.commit_if_written());
            self.queue.work(progress, take, then);
        });
        let mut pending = into_inner(self.pending);
        match self.queue.into_inner().outcome() {
            Ok(()) => Ok(pending.tiles),
            Err(error) => {
                pending.commit()?;
                Err(error)
            }
        }
    }

    /// Does it and tells so.
    fn take(&self, task: MeshTask<MeshBand<T>>) {
        match task {
            MeshTask::Load(place, memory) => {
                let mut band = memory.unwrap_or_else(|| self.loader.band());
                let mut tiles = self.loader.load(place, &mut band);
                while matches!(tiles, Err(Error::TooDense { .. }))
                    && self.meshing.workspaces.free_idle()
                {
                    tiles = self.loader.load(place, &mut band);
                }
                if let Ok(tiles) = &tiles {
                    let all = u64::from(self.loader.known.tiling.tiles()[0]);
                    self.input.job.progress.advance(all - tiles.len() as u64);
                }
                self.queue
                    .lock()
                    .loaded(place, tiles.map(|tiles| (band, tiles)));
            }
            MeshTask::Tile(task) => {
                let made = self.tile(&task);
                self.queue.lock().made(task, made);
            }
            MeshTask::End(layer) => {
                let ended = self.end(layer);
                self.queue.lock().ended(ended);
            }
        }
    }

    fn tile(&self, task: &TileTask<MeshBand<T>>) -> Result<()> {
        if let Some(tile) = self.meshing.mesh_tile(&task.band, task.grid)? {
            let mut collector = lock(&self.collector);
            if collector.reserve().is_err() {
                self.meshing.workspaces.free_idle();
            }
            collector.add(tile)?;
        }
        self.input.job.progress.advance(1);
        Ok(())
    }

    /// Ends a layer, and returns how many are kept. Others may have begun.
    fn end(&self, layer: u32) -> Result<u32> {
        let mut pending = lock(&self.pending);
        pending.end(|checkpointer| {
            let collector = &mut *lock(&self.collector);
            collector.end_layer()?;
            let (files, mut marks) = (checkpointer.files(TILES), Marks::default());
            collector.mark(&files, &mut marks)?;
            checkpointer.stage(TILES, layer + 1, &marks, |out| collector.save(out))
        })?;
        let kept = pending.kept;
        drop(pending);
        let z = span_of(self.loader.known.tiling, 0, layer).z;
        let done = z.start.saturating_sub(1)..z.end.saturating_sub(2).max(z.start);
        self.input.volume.release(done);
        Ok(kept)
    }

    /// Keeps the layer that ended last, if its tiles are written by now and nobody else is about it.
    fn commit_if_written(&self) {
        let Ok(mut pending) = self.pending.try_lock() else {
            return;
        };
        let before = pending.kept;
        let committed = pending.commit_if_written();
        let kept = pending.kept;
        drop(pending);
        match committed {
            Ok(()) if kept == before => return,
            Ok(()) => self.queue.lock().keep(kept),
            Err(error) => self.queue.lock().fail(error),
        }
        self.queue.wake();
    }
}
