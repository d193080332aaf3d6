//! Finishes tiles, batch by batch, in all threads.

use crate::convert::components::Components;
use crate::convert::finalize::FinishSettings;
use crate::convert::finalize::batch_size::max_concurrent_tiles;
use crate::convert::finalize::batches::{Batch, Batches, Job};
use crate::convert::finalize::shards::{FinishedBatch, LayerFinisher};
use crate::convert::memory::{FOR_NEXT_BATCH, KNOWN_PIECES};
use crate::error::Result;
use crate::manifest::{TileEntry, entry_text};
use crate::measure::Measures;
use rayon::prelude::*;

/// Finishes tiles, batch by batch.
pub struct Finisher<'a> {
    pub(super) settings: FinishSettings<'a>,
    /// The sums of all cells.
    components: &'a Components,
    /// What was made of the batch before.
    behind: FinishedBatch,
}

/// Tiles to finish.
pub struct Ready {
    batch: Batch,
    /// Their cells by rising id, unless there are too many.
    known: Vec<Cell>,
}

/// What the nodes of a cell say.
#[derive(Clone, Copy)]
pub struct Cell {
    /// Its id.
    pub id: u64,
    /// Its measures.
    pub measures: Measures,
    /// It has more than one surface.
    pub has_surfaces: bool,
}

impl<'a> Finisher<'a> {
    /// Of the tiles of a set with these cells.
    pub fn new(settings: &FinishSettings<'a>, components: &'a Components) -> Self {
        Finisher {
            settings: *settings,
            components,
            behind: FinishedBatch::default(),
        }
    }

    /// The next batch, with what is to be known of it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn next(&self, batches: &mut Batches) -> Result<Option<Ready>> {
        let Some(mut batch) = batches.next()? else {
            return Ok(None);
        };
        for piece in batch.jobs.iter_mut().flat_map(|job| &mut job.pieces) {
            if !piece.is_cap() {
                piece.ids.surface = self.components.surface_of(piece)?;
            }
        }
        let known = self.cells_of(&batch.jobs)?;
        Ok(Some(Ready { batch, known }))
    }

    /// Finishes the tiles of a batch, a few at a time, and returns the next one. That is made ready, and what is to
    /// be done to files for the batch before goes on, beside that, if there is memory for all.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Usage`] if a tile would pass 4 GiB.
    pub fn finish(
        &mut self,
        ready: Ready,
        ends: &mut LayerFinisher,
        batches: &mut Batches,
    ) -> Result<Option<Ready>> {
        let few = self.few_at_once(&ready.batch.jobs);
        if few.is_some() {
            // nor is there memory for what was made of the batch before
            self.end(ends)?;
        }
        let beside = few.is_none() && self.settings.memory >= FOR_NEXT_BATCH;
        let behind = std::mem::take(&mut self.behind);
        let next = || beside.then(|| self.next(batches));
        let (taken, (made, next)) = rayon::join(
            || ends.take(behind),
            || rayon::join(|| self.finish_all(&ready, few), next),
        );
        taken?;
        self.behind = FinishedBatch {
            parts: ready.batch.into_parts(made?),
        };
        next.unwrap_or_else(|| self.next(batches))
    }

    /// How many of these tiles are finished at once, if there is no memory for one of them in each thread.
    fn few_at_once(&self, jobs: &[Job]) -> Option<usize> {
        let threads = rayon::current_num_threads();
        let records = jobs.iter().map(|job| &job.tile);
        Some(max_concurrent_tiles(records, self.settings.memory, threads))
            .filter(|&few| few < threads)
    }

    /// Does what is left to be done to files.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn end(&mut self, ends: &mut LayerFinisher) -> Result<()> {
        ends.take(std::mem::take(&mut self.behind))
    }

    fn finish_all(
        &self,
        Ready { batch, known }: &Ready,
        few: Option<usize>,
    ) -> Result<Vec<(TileEntry, Vec<u8>)>> {
        let jobs = &batch.jobs[..];
        let finish = |job: &Job| {
            let entry = self.finish_tile(job, known)?;
            let text = entry_text(&entry);
            Ok((entry, text))
        };
        let mut finished = Vec::with_capacity(jobs.len());
        for some in jobs.chunks(few.unwrap_or(jobs.len().max(1))) {
            let made = some.par_iter().with_max_len(1).map(finish);
            finished.extend(made.collect::<Result<Vec<_>>>()?);
        }
        Ok(finished)
    }

    /// The cells of some tiles by rising id, unless there are too many pieces. Most lie in several tiles.
    fn cells_of(&self, jobs: &[Job]) -> Result<Vec<Cell>> {
        if jobs.iter().map(|job| job.pieces.len()).sum::<usize>() > KNOWN_PIECES {
            return Ok(Vec::new());
        }
        let pieces = jobs.iter().flat_map(|job| &job.pieces);
        let all = pieces.map(|piece| piece.ids.cell);
        let mut all: Vec<u64> = all.filter(|&cell| cell != 0).collect();
        all.par_sort_unstable();
        all.dedup();
        let all = all.into_par_iter();
        all.map(|id| self.cell(id)).collect()
    }

    /// A cell by its id.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub(super) fn cell(&self, id: u64) -> Result<Cell> {
        let record = self.components.cell(id)?;
        Ok(Cell {
            id,
            measures: Measures::of(&record, self.settings.placement, false),
            has_surfaces: record.surfaces > 1,
        })
    }
}
