//! Threads that do what is next, each by itself, from slab to slab.

use crate::checkpoint::Checkpointer;
use crate::convert::scan::band::Band;
use crate::convert::scan::collect::TileCollector;
use crate::convert::scan::mode::Parts;
use crate::convert::scan::scheduler::{Limits, SlabScheduler, Stop, Task};
use crate::convert::scan::slab::Slab;
use crate::convert::scan::state::SlabLabels;
use crate::convert::scan::tiles::{TileJob, take_classes};
use crate::convert::scan::{Carried, MadeSlab, Sweep};
use crate::error::{Error, Result};
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::locks::{into_inner, lock, wait};
use crate::volume::Voxel;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

/// All that the threads of a sweep share.
pub struct SlabWorkers<'a, T> {
    sweep: &'a Sweep<'a>,
    parts: &'a Parts<'a, T>,
    gather: TileCollector<'a>,
    pending: Mutex<PendingCommit<'a>>,
    queue: Mutex<SlabScheduler<T>>,
    changed: Condvar,
}

/// Keeps layers that have ended when their tiles are on the disk, while the next one is swept.
struct PendingCommit<'a> {
    checkpointer: &'a mut Checkpointer,
    writers: Option<&'a BackgroundWriters>,
    /// Tiles that have to be written before what the checkpointer has ready is kept; `None` if it has nothing.
    tiles: Option<u64>,
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
        self.checkpointer.commit()
    }

    /// Ends a layer: keeps the one before, has this one ready, which `end` does, and keeps it if its tiles are
    /// written.
    fn end(&mut self, end: impl FnOnce(&mut Checkpointer) -> Result<()>) -> Result<()> {
        self.commit()?;
        end(self.checkpointer)?;
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

impl<'a, T: Voxel + Default> SlabWorkers<'a, T> {
    /// Will sweep from `layer` on.
    pub fn new(
        sweep: &'a Sweep<'a>,
        parts: &'a Parts<'a, T>,
        layer: u32,
        carried: &'a mut Carried,
    ) -> Self {
        let Carried {
            state,
            checkpointer,
        } = carried;
        let [_, bands, layers] = sweep.plan.tiling.tiles();
        let limits = Limits {
            bands,
            layers,
            ahead: parts.mode.ahead,
            next_slab: parts.mode.next_slab,
            in_order: !parts.source.volume.random_access(),
        };
        SlabWorkers {
            sweep,
            parts,
            gather: TileCollector::new(state),
            pending: Mutex::new(PendingCommit {
                checkpointer,
                writers: parts.writers.as_ref(),
                tiles: None,
            }),
            queue: Mutex::new(SlabScheduler::new(limits, layer)),
            changed: Condvar::new(),
        }
    }

    /// Sweeps with all threads. Returns where it had to stop for want of memory, or else how many tiles have to be
    /// written before the last layer is kept.
    ///
    /// # Errors
    /// Those of [`Sweep::run`].
    pub fn run(self) -> Result<Result<Option<u64>, Stop>> {
        rayon::broadcast(|_| self.work());
        let mut pending = into_inner(self.pending);
        let queue = into_inner(self.queue);
        if !queue.has_ended() {
            pending.commit()?;
        }
        Ok(match queue.outcome()? {
            Some(stop) => Err(stop),
            None => Ok(pending.tiles),
        })
    }

    fn lock(&self) -> MutexGuard<'_, SlabScheduler<T>> {
        lock(&self.queue)
    }

    /// What each thread does.
    fn work(&self) {
        let _guard = WakeOnPanic(self);
        let mut queue = self.lock();
        loop {
            let step = queue.next(self.sweep.progress.interrupted());
            queue = match step {
                Task::Finished => break,
                Task::Wait => wait(&self.changed, queue),
                step => {
                    drop(queue);
                    self.take(step);
                    self.changed.notify_all();
                    self.commit_if_written();
                    self.lock()
                }
            };
        }
        let others_go_on = !queue.has_ended();
        drop(queue);
        self.changed.notify_all();
        if others_go_on {
            // it takes the system a while to have their memory back
            self.parts.pool.give_back();
        }
    }

    /// Does it and tells so.
    fn take(&self, step: Task<T>) {
        match step {
            Task::Prepare(place, memory) => self.prepare(place, memory),
            Task::Begin(layer, bands, alone) => self.begin(layer, bands, alone),
            Task::Label(place, band, known) => self.label(place, band, &known),
            Task::Tile(job, known, next) => self.tile(job, &known, next.as_deref()),
            Task::End(layer, known, next) => self.end(layer, &known, next.as_deref()),
            Task::Wait | Task::Finished => {}
        }
    }

    fn prepare(&self, place: [u32; 2], memory: Option<Band<T>>) {
        let source = &self.parts.source;
        let mut band = memory.unwrap_or_else(|| source.band());
        let [ty, layer] = place;
        let prepared = source.prepare(ty, layer, &mut band);
        self.lock().prepared(place, prepared.map(|()| band));
    }

    fn begin(&self, layer: u32, mut bands: Vec<Band<T>>, alone: bool) {
        if !alone
            && !self
                .gather
                .with(|state| state.memory.has_room_for_another())
        {
            return self.lock().postpone(bands);
        }
        let joined = self.join(layer, &mut bands, alone);
        self.lock().begun(joined.map(|known| (bands, known)));
    }

    /// Joins the bands of a layer, `alone` if the one before has ended.
    fn join(&self, layer: u32, bands: &mut [Band<T>], alone: bool) -> Result<SlabLabels> {
        let known = self.gather.with(|state| {
            let mut sealed = Vec::new();
            state.seal(layer, bands, &mut sealed)?;
            self.sweep.join(sealed, layer, state)
        })?;
        if alone {
            self.gather.begin(layer, &known)?;
        }
        self.sweep.prefetch(&self.parts.source, layer + 1);
        Ok(known)
    }

    fn label(&self, place: [u32; 2], mut band: Band<T>, known: &SlabLabels) {
        take_classes(&mut band, &known.classes.of_local[place[0] as usize]);
        let (band, [ty, layer]) = (Arc::new(band), place);
        let tile = |tx| self.sweep.tile_of(band.clone(), [tx, ty, layer]);
        let tiles: Vec<_> = (0..self.sweep.plan.tiling.tiles()[0]).map(tile).collect();
        // whoever makes the last of them gets the band's memory
        drop(band);
        self.lock().labelled(layer, tiles);
    }

    /// Makes a tile of a layer; what is known of the next one, if it has waited for that.
    fn tile(&self, job: TileJob<Arc<Band<T>>>, known: &SlabLabels, next: Option<&SlabLabels>) {
        let slab = Slab {
            classes: &known.classes,
            next: next.map(|next| &next.classes),
            gather: &self.gather,
        };
        let made = self.sweep.mesh_tile(self.parts, &job, &slab);
        let [_, _, layer] = job.grid;
        let unused = self.lock().made(layer, made, Arc::into_inner(job.band));
        // it takes the system a while to have it back
        drop(unused);
    }

    /// Ends a layer. The next one may have begun.
    fn end(&self, layer: u32, known: &SlabLabels, next: Option<&SlabLabels>) {
        let gather = &self.gather;
        let slab = MadeSlab {
            layer,
            known,
            tiles: gather.take(),
        };
        let mut pending = lock(&self.pending);
        let ended = pending.end(|checkpointer| {
            gather.with(|state| {
                let carried = &mut Carried {
                    state,
                    checkpointer,
                };
                self.sweep.end_slab(self.parts, slab, carried)
            })
        });
        drop(pending);
        let begun = match next {
            Some(next) if ended.is_ok() => gather.begin(layer + 1, next),
            _ => Ok(()),
        };
        let mut queue = self.lock();
        queue.ended(ended);
        if let Err(error) = begun {
            queue.fail(error);
        }
    }

    /// Keeps the layer that ended last, if its tiles are written by now and nobody else is about it.
    fn commit_if_written(&self) {
        if let Ok(mut pending) = self.pending.try_lock()
            && let Err(error) = pending.commit_if_written()
        {
            self.lock().fail(error);
        }
    }
}

/// Lets threads that wait see that another one has panicked.
struct WakeOnPanic<'a, 'b, T>(&'a SlabWorkers<'b, T>);

impl<T> Drop for WakeOnPanic<'_, '_, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(&self.0.queue).fail(Error::Interrupted);
            self.0.changed.notify_all();
        }
    }
}
