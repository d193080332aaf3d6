//! Gives the tiles their ids and measures.

pub(crate) mod batch_size;
pub(crate) mod batches;
mod rewrite;
pub(crate) mod shards;
use crate::checkpoint::Checkpointer;
use crate::convert::conversion::Conversion;
use crate::convert::finalize::batch_size::max_concurrent_tiles;
use crate::convert::finalize::batches::{Batch, Batches, Ids, Job, count_distinct, group};
use crate::convert::finalize::rewrite::{
    Buffers, fill, make_layer_dir, read_back, replacement_path, write_replacement,
};
use crate::convert::finalize::shards::{FinishedBatch, FinishedLayer, LayerFinisher};
use crate::convert::memory::{FINISHING, FOR_NEXT_BATCH, KNOWN_PIECES, WRITES};
use crate::convert::resolve::{Components, Resolved, SpooledIds};
use crate::convert::scan::tile_writer::{TileRecord, TileWriter};
use crate::convert::slab_records::{SlabRecord, Slabs};
use crate::error::{Error, Result};
use crate::grid::{LATTICE, Placement, Tiling};
use crate::manifest::{
    Bounds, Group, LayerRecord, ShardTiles, TileEntry, Totals, checksum_text, entry_text,
    shard_path, sums_of,
};
use crate::measure::{ComponentRecord, Measures, RecordTable};
use crate::progress::Progress;
use crate::sys::background_writer::BackgroundWriters;
use crate::sys::locks::lock;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::spill_file::SpillFile;
use crate::tile::{
    Body, Extras, Grouped, Node, PieceRange, TileHead, WidestNodes, decode, describe, name,
    refused, tile_path, too_large, write_head,
};
use crate::tileset::TilesetWriter;
use rayon::prelude::*;
use std::borrow::Cow;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// What finishing needs to know of the whole set.
#[derive(Clone, Copy)]
pub struct FinishSettings<'a> {
    /// Directory that will become the tile set.
    pub dir: &'a Path,
    /// What all tiles have in common.
    pub head: &'a TileHead,
    /// How wide their JSON can become.
    pub widest: &'a WidestNodes,
    /// Where the grid lies, in the unit of the measures.
    pub placement: &'a Placement,
    /// The macrocubes.
    pub tiling: Tiling,
    /// Bring tiles that are written anew to the disk.
    pub writers: Option<&'a BackgroundWriters>,
    /// Bytes that tiles may take while they are finished.
    pub memory: u64,
}

/// Finishes tiles, batch by batch.
struct Finisher<'a> {
    settings: FinishSettings<'a>,
    /// The sums of all cells.
    cells: &'a RecordTable<ComponentRecord>,
    /// Of each thread.
    buffers: Vec<Mutex<Buffers>>,
    /// What was made of the batch before.
    behind: FinishedBatch,
}

/// True once what goes on beside the finishing is to stop, too.
pub type Stop<'a> = dyn Fn() -> bool + Sync + 'a;

/// Tiles to finish.
struct Ready {
    batch: Batch,
    /// Their cells by rising id, unless there are too many.
    known: Vec<Cell>,
}

/// What the nodes of a cell say.
#[derive(Clone, Copy)]
struct Cell {
    id: u64,
    measures: Measures,
    has_surfaces: bool,
}

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
    /// What resolving left.
    pub resolved: &'a mut Resolved,
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
    let Resolved {
        slabs,
        pieces,
        ids,
        components,
    } = input.resolved;
    let progress = job.progress;
    progress.begin("index", slabs.len() as u64);
    let reserve = |by| MemoryReservation::new(input.memory, by);
    let writers = BackgroundWriters::new(job.plan.in_flight, job.plan.body, reserve(WRITES));
    let mut finishing = reserve(FINISHING);
    finishing.grow_as_far_as(u64::MAX);
    let settings = FinishSettings {
        dir: &writer.dir,
        head: &writer.head,
        widest: &writer.widest,
        placement: input.placement,
        tiling: job.plan.tiling,
        writers: writers.as_ref(),
        memory: finishing.bytes(),
    };
    let checkpointer = input.checkpointer;
    let (set, layers) = (input.set, slabs.len());
    let mut ends = LayerFinisher::begin(&settings, set, checkpointer, layers, progress)?;
    let failed = AtomicBool::new(false);
    let cells = &components.cells;
    let finish = || {
        let finished = finish_tiles(slabs, (pieces, ids), cells, &settings, &mut ends, progress);
        failed.store(finished.is_err(), Ordering::Relaxed);
        finished
    };
    let stop = || failed.load(Ordering::Relaxed) || progress.interrupted();
    let (finished, made) = rayon::join(finish, || beside(components, &stop));
    finished?;
    ends.end()?;
    made
}

/// Finishes the tiles of all slabs.
fn finish_tiles(
    slabs: &mut Slabs,
    (spool, ids): (&mut SpillFile, &mut SpooledIds),
    cells: &RecordTable<ComponentRecord>,
    settings: &FinishSettings,
    ends: &mut LayerFinisher,
    progress: &dyn Progress,
) -> Result<()> {
    let before = ends.finished() as usize;
    for number in 0..before {
        if let Some(slab) = slabs.get(number)? {
            ends.add(slab.layer, finished_layer(settings, &slab, spool)?)?;
        }
    }
    let mut finisher = Finisher {
        settings: *settings,
        cells,
        buffers: (0..rayon::current_num_threads())
            .map(|_| Mutex::default())
            .collect(),
        behind: FinishedBatch::default(),
    };
    let mut batches = Batches::new(slabs, before, (spool, ids), settings.memory);
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

/// What was made of a slab in a process before this one.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if the shard is not as it was written.
fn finished_layer(
    settings: &FinishSettings,
    slab: &SlabRecord,
    spool: &mut SpillFile,
) -> Result<Option<FinishedLayer>> {
    let tiles = spool.get(&slab.tiles)?;
    if tiles.is_empty() {
        return Ok(None);
    }
    let path = settings.dir.join(shard_path(slab.layer));
    let file = File::open(&path).map_err(|e| Error::io(&path, "read", e))?;
    let (bytes, crc) = sums_of(&file).map_err(|e| Error::io(&path, "read", e))?;
    let not_ours = |_| changed(&path, bytes, bytes);
    let mut totals = Totals::default();
    let mut grids = tiles.iter().map(|t| t.grid);
    let mut same = true;
    for tile in ShardTiles::open(path.clone(), slab.layer)? {
        let tile = tile.map_err(not_ours)?;
        same &= grids.next() == Some(tile.grid);
        totals.add_tile(&tile);
    }
    if !same || grids.next().is_some() {
        return Err(changed(&path, bytes, bytes));
    }
    let (z, tiles) = (slab.layer, totals.tiles);
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

impl Finisher<'_> {
    /// The next batch, with what is to be known of it.
    ///
    /// # Errors
    /// [`Error::Io`].
    fn next(&self, batches: &mut Batches) -> Result<Option<Ready>> {
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
    /// [`Error::Io`], [`Error::Usage`] if a tile would pass 4 GiB.
    fn finish(
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
    fn end(&mut self, ends: &mut LayerFinisher) -> Result<()> {
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

    fn cell(&self, id: u64) -> Result<Cell> {
        let record = self.cells.get(id - 1)?;
        Ok(Cell {
            id,
            measures: Measures::of(&record, self.settings.placement, false),
            has_surfaces: record.surfaces > 1,
        })
    }

    /// Writes what comes before the geometry of a tile, and behind it, where that is as it is to be.
    fn finish_tile(&self, job: &Job, known: &[Cell]) -> Result<TileEntry> {
        let (tile, body) = (&job.tile, job.body());
        let nodes = self.nodes(&body, &job.ids, known)?;
        let (head, low) = (self.settings.head, self.settings.tiling.lowest(tile.grid));
        let (json, table) = describe(head, low, (&body, &tile.recipe), &nodes)
            .map_err(|e| refused(e, tile.grid, self.settings.tiling))?;
        let more = table.len() as u64;
        let head = write_head(&json, tile.room as usize, tile.bin_bytes + more)
            .ok_or_else(|| too_large(tile.grid))?;
        let bytes = head.len() as u64 + tile.bin_bytes;
        let path = self.settings.dir.join(tile_path(tile.grid));
        let file = OpenOptions::new()
            .write(true)
            .open(&path)
            .map_err(|e| Error::io(&path, "open", e))?;
        let found = file.metadata().map_err(|e| Error::io(&path, "stat", e))?;
        // an interrupted conversion may have written the table already, or some of it
        if !(bytes..=bytes + more).contains(&found.len()) {
            return Err(changed(&path, found.len(), bytes));
        }
        for (part, at) in [(&head, 0), (&table, bytes)] {
            file.write_all_at(part, at)
                .map_err(|e| Error::io(&path, "write", e))?;
        }
        let mut crc = crc32fast::Hasher::new();
        crc.update(&head);
        crc.combine(&crc32fast::Hasher::new_with_initial_len(
            tile.crc,
            tile.bin_bytes,
        ));
        crc.update(&table);
        let size_and_crc = (bytes + more, crc.finalize());
        let indices = tile.recipe.indices.into();
        Ok(entry(tile, &body, &job.ids, indices, size_and_crc))
    }

    /// Writes a tile anew, beside the old one.
    fn rewrite_tile(&self, job: &Job, known: &[Cell], buffers: &mut Buffers) -> Result<TileEntry> {
        let tile = &job.tile;
        let (groups, group_ids) = group(&job.ids, &job.carry_over);
        let (head, low) = (self.settings.head, self.settings.tiling.lowest(tile.grid));
        let path = self.settings.dir.join(tile_path(tile.grid));
        let bytes = read_back(&path, &mut buffers.old)?;
        let place = tile.start()..tile.start() + tile.bin_bytes as usize;
        let not_ours = || changed(&path, bytes.len() as u64, place.end as u64);
        let bytes = bytes.get(place.clone()).ok_or_else(not_ours)?;
        if crc32fast::hash(bytes) != tile.crc {
            return Err(not_ours());
        }
        // as the sweep had it before it was encoded
        let (body, bytes) = match tile.room {
            0 => (job.body(), Cow::Borrowed(bytes)),
            _ => decode(head, low, (&job.body(), &tile.recipe), bytes).map_err(|_| not_ours())?,
        };
        let made = Grouped::new(&body, &bytes, &groups, head.form.primitives);
        let nodes = self.nodes(&made.body, &group_ids, known)?;
        let what = (head, self.settings.widest);
        let indices = fill(&mut buffers.new, what, low, (&made, &nodes))
            .map_err(|e| refused(e, tile.grid, self.settings.tiling))?;
        let file = buffers.new.get();
        let size_and_crc = (file.len() as u64, crc32fast::hash(file));
        let anew = self.settings.dir.join(replacement_path(tile.grid));
        write_replacement(anew, &mut buffers.new, self.settings.writers)?;
        Ok(entry(tile, &made.body, &group_ids, indices, size_and_crc))
    }

    /// Names and numbers of a tile's pieces.
    fn nodes(&self, body: &Body, ids: &[Ids], known: &[Cell]) -> Result<Vec<Node>> {
        let unit = self.settings.placement.unit.name();
        ids.iter()
            .zip(&body.pieces)
            .map(
                |(
                    &Ids {
                        object,
                        cell,
                        surface,
                    },
                    piece,
                )| {
                    let extras = Extras::ids(cell, object, surface, u64::from(piece.triangles));
                    if cell == 0 {
                        return Ok(Node {
                            name: name(0, object, false),
                            extras,
                            colour: None,
                        });
                    }
                    let of_cell = match known.binary_search_by_key(&cell, |c| c.id) {
                        Ok(at) => known[at],
                        Err(_) => self.cell(cell)?,
                    };
                    Ok(Node {
                        name: name(cell, object, of_cell.has_surfaces),
                        extras: extras.with_measures(&of_cell.measures, unit),
                        colour: None,
                    })
                },
            )
            .collect()
    }
}

/// The error for a tile that is not as this program has written it.
fn changed(path: &Path, found: u64, expected: u64) -> Error {
    let expected = format!("{expected} bytes as the conversion wrote them");
    Error::format(path, format!("{found} bytes"), expected).with_hint(
        "something else has changed the file: convert again with --force instead of --resume",
    )
}

/// The shard's entry of a tile.
fn entry(
    tile: &TileRecord,
    body: &Body,
    ids: &[Ids],
    indices: u64,
    (bytes, crc): (u64, u32),
) -> TileEntry {
    let sum = |get: fn(&PieceRange) -> u32| body.pieces.iter().map(|p| u64::from(get(p))).sum();
    let [min, max] = body
        .bounds()
        .map(|steps| steps.map(|v| f64::from(v) / f64::from(LATTICE)));
    TileEntry {
        path: tile_path(tile.grid),
        grid: tile.grid,
        bounds: Bounds { min, max },
        vertices: u64::from(body.vertices),
        triangles: sum(|p| p.triangles),
        strips: sum(|p| p.strips),
        indices,
        bytes,
        checksum: checksum_text(crc),
        groups: ids
            .iter()
            .zip(&body.pieces)
            .map(|(ids, p)| Group {
                cell: ids.cell,
                object: ids.object,
                surface: ids.surface,
                vertices: u64::from(p.vertices),
                triangles: u64::from(p.triangles),
            })
            .collect(),
    }
}
