//! Threads that label bands and join slabs.

use crate::convert::label::LabelInput;
use crate::convert::label::band::{Band, BandSource, SealedBand, span_of};
use crate::convert::label::queue::{LabelQueue, LabelTask, Limits};
use crate::convert::label::state::{LabelState, SlabLabels};
use crate::convert::shared_queue::SharedQueue;
use crate::error::{Error, Result};
use crate::sys::locks::lock;
use crate::volume::Voxel;
use std::sync::Mutex;

/// All that the threads share.
pub struct LabelWorkers<'a, T, F> {
    input: &'a LabelInput<'a>,
    source: &'a BandSource<'a, T>,
    layers: u32,
    /// The state, and who hears of each slab.
    state: Mutex<(&'a mut LabelState, F)>,
    queue: SharedQueue<LabelQueue<Band<T>, SealedBand>>,
}

impl<'a, T, F> LabelWorkers<'a, T, F>
where
    T: Voxel + Default,
    F: FnMut(&mut LabelState, u32, &SlabLabels) -> Result<()> + Send,
{
    /// Will label from `layer` on, and call `each` for every slab that is joined.
    pub fn new(
        input: &'a LabelInput,
        source: &'a BandSource<'a, T>,
        limits: Limits,
        layer: u32,
        state: &'a mut LabelState,
        each: F,
    ) -> Self {
        LabelWorkers {
            input,
            source,
            layers: limits.layers,
            state: Mutex::new((state, each)),
            queue: SharedQueue::new(LabelQueue::new(limits, layer)),
        }
    }

    /// Labels with all threads.
    ///
    /// # Errors
    /// As of [`label`](crate::convert::label::label).
    pub fn run(self) -> Result<()> {
        let progress = self.input.job.progress;
        rayon::broadcast(|_| self.queue.work(progress, |task| self.take(task), || {}));
        self.queue.into_inner().outcome()
    }

    /// Does it and tells so.
    fn take(&self, task: LabelTask<Band<T>, SealedBand>) {
        match task {
            LabelTask::Label(place, memory) => {
                let mut band = memory.unwrap_or_else(|| self.source.band());
                let sealed = self.label(place, &mut band);
                self.queue.lock().labelled(place, sealed, band);
            }
            LabelTask::Join(layer, bands) => {
                let joined = self.join(layer, bands);
                self.queue.lock().joined(joined);
            }
        }
    }

    fn label(&self, [ty, layer]: [u32; 2], band: &mut Band<T>) -> Result<SealedBand> {
        if ty == 0 {
            self.prefetch(layer + 1);
        }
        self.source.label(ty, layer, band)?;
        lock(&self.state).0.seal(band)
    }

    fn join(
        &self,
        layer: u32,
        bands: Vec<SealedBand>,
    ) -> std::result::Result<(), Box<(Error, Vec<SealedBand>)>> {
        let (state, each) = &mut *lock(&self.state);
        let [_, _, all] = self.source.tiling.tiles();
        let known = state.join(layer, bands, layer + 1 == all)?;
        each(state, layer, &known).map_err(|error| Box::new((error, Vec::new())))?;
        // slices that no later slab needs
        let z = span_of(self.source.tiling, 0, layer).z;
        let done = z.start.saturating_sub(1)..z.end.saturating_sub(2).max(z.start);
        self.input.volume.release(done);
        Ok(())
    }

    fn prefetch(&self, layer: u32) {
        if layer < self.layers {
            let span = span_of(self.source.tiling, 0, layer);
            self.input
                .volume
                .prefetch(span.with_neighbours(self.source.tiling.dims).z);
        }
    }
}
