//! Finishes tiles, batch by batch, in all threads.

use crate::convert::finalize::FinishSettings;
use crate::convert::finalize::batch_size::max_concurrent_tiles;
use crate::convert::finalize::batches::{Batch, Batches, Job, count_distinct};
use crate::convert::finalize::rewrite::{Buffers, make_layer_dir};
use crate::convert::finalize::shards::{FinishedBatch, LayerFinisher};
use crate::convert::memory::{FOR_NEXT_BATCH, KNOWN_PIECES};
use crate::error::Result;
use crate::manifest::{TileEntry, entry_text};
use crate::measure::{ComponentRecord, Measures, RecordTable};
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::locks::lock;
use rayon::prelude::*;
use std::sync::Mutex;

/// Finishes tiles, batch by batch.
pub struct Finisher<'a> {
    pub(super) settings: FinishSettings<'a>,
    /// The sums of all cells.
    cells: &'a RecordTable<ComponentRecord>,
    /// Of each thread.
    buffers: Vec<Mutex<Buffers>>,
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
    pub fn new(settings: &FinishSettings<'a>, cells: &'a RecordTable<ComponentRecord>) -> Self {
        Finisher {
            settings: *settings,
            cells,
            buffers: (0..rayon::current_num_threads())
                .map(|_| Mutex::default())
                .collect(),
            behind: FinishedBatch::default(),
        }
    }

    /// The next batch, with what is to be known of it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn next(&self, batches: &mut Batches) -> Result<Option<Ready>> {
        let Some(batch) = batches.next()? else {
            return Ok(None);
        };
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
            handed: self.settings.writers.map_or(0, BackgroundWriters::handed),
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
        let anew = jobs.par_iter().map(|job| self.is_anew(job));
        let anew: Vec<bool> = anew.collect();
        self.make_layer_dirs(jobs, &anew)?;
        let finish = |&at: &usize| {
            let thread = rayon::current_thread_index().unwrap_or_default();
            let mut buffers = lock(&self.buffers[thread]);
            let job = &jobs[at];
            let entry = match anew[at] {
                true => self.rewrite_tile(job, known, &mut buffers),
                false => self.finish_tile(job, known),
            }?;
            let text = entry_text(&entry);
            Ok((at, (entry, text)))
        };
        let together = few.unwrap_or(jobs.len().max(1));
        // those that are written anew take longest: no thread is left with one when the others have none
        let mut order: Vec<usize> = (0..jobs.len()).collect();
        order.sort_by_key(|&at| !anew[at]);
        let mut finished = Vec::with_capacity(jobs.len());
        for some in order.chunks(together) {
            let made = some.par_iter().with_max_len(1).map(finish);
            finished.extend(made.collect::<Result<Vec<_>>>()?);
            if few.is_some() {
                // there is no memory for what each thread keeps
                for buffers in &self.buffers {
                    *lock(buffers) = Buffers::default();
                }
            }
        }
        finished.sort_unstable_by_key(|&(at, _)| at);
        Ok(finished.into_iter().map(|(_, made)| made).collect())
    }

    /// Makes the directories for those that are written anew.
    fn make_layer_dirs(&self, jobs: &[Job], anew: &[bool]) -> Result<()> {
        let layers = jobs.iter().zip(anew).filter(|&(_, &anew)| anew);
        let mut layers: Vec<u32> = layers.map(|(job, _)| job.tile.grid[2]).collect();
        layers.dedup();
        let mut layers = layers.into_iter();
        layers.try_for_each(|layer| make_layer_dir(self.settings.dir, layer))
    }

    /// Whether a tile has to be written anew: pieces turned out to be one, or it is not in the form that is wanted.
    fn is_anew(&self, job: &Job) -> bool {
        job.tile.room == 0 || count_distinct(&job.ids) < job.ids.len()
    }

    /// The cells of some tiles by rising id, unless there are too many pieces. Most lie in several tiles.
    fn cells_of(&self, jobs: &[Job]) -> Result<Vec<Cell>> {
        if jobs.iter().map(|job| job.ids.len()).sum::<usize>() > KNOWN_PIECES {
            return Ok(Vec::new());
        }
        let all = jobs.iter().flat_map(|job| &job.ids).map(|ids| ids.cell);
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
        let record = self.cells.get(id - 1)?;
        Ok(Cell {
            id,
            measures: Measures::of(&record, self.settings.placement, false),
            has_surfaces: record.surfaces > 1,
        })
    }
}
