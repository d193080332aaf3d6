//! The conversion, in the order of its stages.

mod band_order;
mod cells;
mod components;
mod conversion;
mod finalize;
mod given_labels;
mod id_places;
mod identity;
mod known_band;
mod label;
mod layers;
mod memory;
mod mesh;
mod one_by_one;
mod options;
pub mod parts;
mod plan;
mod resolve;
mod resume;
mod shared_queue;
mod tables;
mod totals;
mod walls;
mod warnings;

pub use crate::checkpoint::LayersDone;
pub use crate::labels::{CellRows, LabelSums};
pub use crate::measure::{
    COMPONENT_COLUMNS, Column, Field, Get, Measures, SURFACE_COLUMNS, SurfaceRow,
};
pub use crate::split::NeckRule;
pub use crate::tileset::{check_output, interrupted};
pub use given_labels::{LabelRows, LabelVolume, Labels};
pub use options::{ConvertOptions, ConvertReport, RegionOfInterest};
pub use plan::check_read_beside;
pub use tables::unit_text;

use crate::checkpoint::{Checkpointer, boot};
use crate::convert::cells::{CellsInput, GivenCells, cells};
use crate::convert::components::{Components, SumUp, sum_up};
use crate::convert::conversion::{Conversion, Made};
use crate::convert::finalize::{FinalizeInput, finalize};
use crate::convert::known_band::KnownBands;
use crate::convert::label::{LabelInput, Labelled, LeftOut, label};
use crate::convert::layers::Layers;
use crate::convert::memory::TABLES;
use crate::convert::mesh::tile_writer::TileWriter;
use crate::convert::mesh::{MeshInput, Meshed, mesh};
use crate::convert::plan::plan;
use crate::convert::resolve::{Numbering, Resolved, resolve};
use crate::convert::resume::{
    begin, commit_begun, complete, is_begun, refuse_kept, refuse_other, tidy_beside,
};
use crate::convert::tables::write_tables;
use crate::convert::totals::{ScannedSums, dust_of};
use crate::convert::walls::{WallsInput, add_walls, walls};
use crate::convert::warnings::warnings;
use crate::error::{Error, Result};
use crate::grid::{Placement, Tiling};
use crate::manifest::{Dust, Manifest, Totals};
use crate::progress::Progress;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::process_memory::peak_rss_bytes;
use crate::sys::spill_file::SpillFile;
use crate::tileset::{Output, TilesetWriter, outward};
use crate::volume::{Cropped, Filled, Volume, Watch, Watched, spool_beside};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Converts a volume to a tile set in the directory `out`.
///
/// The stages: plan the cut; label all bands; resolve ids in reverse; mesh and write the tiles' geometry; give the tiles
/// their measures; write the tables; write the manifest and move everything into place.
///
/// What is done of a layer is kept: see [`ConvertOptions::resume`].
///
/// # Errors
/// [`Error::Usage`] for impossible options, [`Error::Memory`] with the smallest limit that works,
/// those of [`check_output`], [`Error::OutputInterrupted`], [`Error::OtherConversion`] if the one to resume is
/// another, [`Error::OtherTileSet`] if the tile set there is another than is to be gone on with,
/// [`Error::InputChanged`], [`Error::Io`], [`Error::Interrupted`], and what reading the volume returns. Nothing is
/// left under a final name then; [`interrupted`] tells whether finished layers are kept.
pub fn convert(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<ConvertReport> {
    convert_if(volume, options, out, &|_| Ok(()), progress)
}

/// Decides whether the tile set that lies whole in a directory is the one that is wanted.
pub type Accept<'a> = dyn Fn(&Path) -> Result<()> + 'a;

/// The same, but what was made is moved into place only if `accept` takes it; what it refuses by [`Error::Usage`] is removed,
/// and `out` stays as it was.
///
/// # Errors
/// As of [`convert`], and what `accept` returns.
pub fn convert_if(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    accept: &Accept,
    progress: &dyn Progress,
) -> Result<ConvertReport> {
    let start = Instant::now();
    let done = with_conversion(volume, options, progress, Layers::all, |job| {
        run(job, out, accept).map_err(|e| outward(e, out))
    })?;
    Ok(ConvertReport {
        resumed_layers: done.resumed_layers,
        resumed_index_layers: done.resumed_index_layers,
        ..report(done.made, options, start)
    })
}

/// What is told of a tile set that was made since `start`, all of it.
fn report(made: Made, options: &ConvertOptions, start: Instant) -> ConvertReport {
    ConvertReport {
        totals: made.totals,
        threshold: options.threshold,
        filters: options.filters(),
        region: options.region.as_ref().map(|r| r.stated.clone()),
        bytes_written: made.bytes,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
        resumed_layers: 0,
        resumed_index_layers: 0,
        warnings: made.warnings,
    }
}

/// Calls `run` with what all stages of a conversion know, of the layers that `made` chooses.
fn with_conversion<R>(
    volume: &dyn Volume,
    options: &ConvertOptions,
    progress: &dyn Progress,
    made: impl FnOnce(Tiling) -> Layers,
    run: impl FnOnce(&Conversion) -> Result<R>,
) -> Result<R> {
    options.check(&volume.header().placement)?;
    let watch = Watch::new(volume.header(), options.source_scaled);
    let watched = Watched::new(Box::new(volume), &watch);
    let volume: &dyn Volume = &watched;
    let filled: Box<dyn Volume + '_> = match &options.region {
        Some(RegionOfInterest { stated, voxels }) => {
            let inner = Box::new(volume);
            Box::new(Filled::new(inner, voxels.clone(), stated.fill_value)?)
        }
        None => Box::new(volume),
    };
    let crop = options.crop.as_ref();
    let grid = Cropped::part(filled, crop)?;
    let region = options.region.as_ref().map(|r| r.voxels.cropped(crop));
    let region = region.transpose()?;
    let plan = plan(&*grid, grid.header().dims, options, region.is_some())?;
    run(&Conversion {
        volume,
        grid: &*grid,
        region: region.as_ref(),
        options,
        plan: &plan,
        made: made(plan.tiling),
        watch: &watch,
        progress,
    })
}

/// The peak of resident memory, in bytes, that a conversion is predicted to have.
///
/// # Errors
/// [`Error::Memory`] if `options.memory` is too small, [`Error::Usage`] for impossible options.
pub fn predicted_memory(volume: &dyn Volume, options: &ConvertOptions) -> Result<u64> {
    predict(volume, options, options.region.is_some())
}

/// The same; `in_region` tells whether voxels outside of a region of interest will be filled.
fn predict(volume: &dyn Volume, options: &ConvertOptions, in_region: bool) -> Result<u64> {
    options.check(&volume.header().placement)?;
    let dims = match &options.crop {
        Some(crop) => crop.dims_in(volume.header().dims)?,
        None => volume.header().dims,
    };
    Ok(plan(volume, dims, options, in_region)?.memory)
}

/// Refuses a conversion that [`convert`] would refuse before it reads any sample, whatever the threshold and the region;
/// `in_region` tells whether there will be one.
///
/// # Errors
/// As of [`predicted_memory`] and, unless something is to be resumed, of [`check_output`];
/// [`Error::OutputInterrupted`].
pub fn check_before(
    volume: &dyn Volume,
    options: &ConvertOptions,
    in_region: bool,
    out: &Path,
) -> Result<()> {
    predict(volume, options, in_region)?;
    match options.resume {
        true => Ok(()),
        false => check_unused(out, options.force),
    }
}

/// Refuses a directory that holds a tile set or an interrupted conversion, unless these are to be replaced, or anything
/// else.
///
/// # Errors
/// Those of [`check_output`]; [`Error::OutputInterrupted`].
pub fn check_unused(out: &Path, force: bool) -> Result<()> {
    check_output(out, force)?;
    match force {
        true => Ok(()),
        false => refuse_kept(out, interrupted(out)),
    }
}

/// A conversion that is done, and what of it was done before.
struct Done {
    made: Made,
    resumed_layers: u64,
    resumed_index_layers: u32,
}

/// Does what is not done yet.
fn run(job: &Conversion, out: &Path, accept: &Accept) -> Result<Done> {
    let options = job.options;
    let all_done = |made| Done {
        made,
        resumed_layers: job.swept_layers(),
        resumed_index_layers: job.layers(),
    };
    let identity = identity::of(&options.input, &job.asked());
    let begun = is_begun(out, &identity);
    // by force it was begun in place of a set that is whole, and by force it goes on
    if options.resume
        && !(options.force && begun)
        && let Some(made) = complete(job, out)
    {
        accept(out)?;
        job.progress
            .warn("nothing to resume: the directory holds this tile set already, whole");
        tidy_beside(out, &identity, job.progress)?;
        return Ok(all_done(made));
    }
    if options.resume && !options.force {
        refuse_other(job, out, begun)?;
    }
    let mut output = Output::open(out, options.force, options.resume)?;
    if options.resume
        && let Some(made) = commit_begun(&output, &identity)
    {
        let layers = job.swept_layers();
        job.progress
            .warn(&format!("resuming: all {layers} layers were done"));
        output.keep(true);
        output.commit()?;
        return Ok(all_done(made));
    }
    let checkpointer = begin(&mut output, out, job, &identity)?;
    let (resumed_layers, resumed_index_layers) = (checkpointer.kept(), checkpointer.finished());
    Ok(Done {
        made: make_and_commit(job, output, checkpointer, accept)?,
        resumed_layers,
        resumed_index_layers,
    })
}

/// Makes everything in the work directory, then moves it to its final name if it is accepted.
fn make_and_commit(
    job: &Conversion,
    mut output: Output,
    mut checkpointer: Checkpointer,
    accept: &Accept,
) -> Result<Made> {
    let work = output.work().to_path_buf();
    let made = in_threads(job, || make(job, &work, &mut checkpointer))?;
    let made = made.and_then(|made| accept(&work).map(|()| made));
    // usage errors come back with the same options, and nothing that was made of a changed input is of use
    let useless = matches!(made, Err(Error::Usage { .. } | Error::InputChanged { .. }));
    output.keep(checkpointer.has_any() && !useless);
    let mut made = made?;
    let check = job.options.input.check();
    let touched = check.inspect_err(|_| output.keep(false))?;
    if let Some(warning) = touched {
        job.progress.warn(&warning);
        made.warnings.push(warning);
    }
    // first what the note tells of, then the note: it may outlive a power failure
    checkpointer.disk().finish()?;
    made.boot = (!checkpointer.disk().is_used()).then(boot);
    let note = serde_json::to_vec(&made).expect("plain data serialises");
    output.begin_commit(&note)?;
    checkpointer.disk().finish()?;
    drop(checkpointer);
    output.commit()?;
    Ok(made)
}

/// Works in the threads of a conversion. The outer error says that there are none.
fn in_threads<R: Send>(
    job: &Conversion,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<Result<R>> {
    let threads = job.plan.threads;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::usage("--threads", threads.to_string(), e.to_string()))?;
    Ok(pool.install(|| {
        let working = AssertUnwindSafe(work);
        catch_unwind(working).unwrap_or_else(|panic| Err(changed(job, &*panic)))
    }))
}

/// What is read twice is taken to be the same: where the input changed meanwhile, that is the error, whatever it led
/// to. A file that is written to through a memory map keeps its time of change, so that a change can be seen by what it
/// led to alone.
fn changed(job: &Conversion, panic: &(dyn Any + Send)) -> Error {
    let found = match job.options.input.check() {
        Err(changed) => return changed,
        Ok(Some(found)) => found,
        Ok(None) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or(panic.downcast_ref::<&str>().copied());
            format!(
                "samples that do not fit together when they are read twice ({}), though size and time of change are \
                 the same; if nobody writes to it, not through a memory map either, this is a fault of alvis",
                text.unwrap_or("a panic")
            )
        }
    };
    Error::InputChanged {
        path: job.options.source_name.clone().into(),
        found,
    }
}

/// A volume that is labelled and meshed.
struct Swept {
    labelled: Labelled,
    left_out: LeftOut,
    resolved: Resolved,
    /// The cells, where these are given.
    cells: Option<GivenCells>,
    /// The walls between cells, if these were asked for.
    walls: Option<SpillFile>,
    meshed: Meshed,
}

/// Labels, resolves and meshes; the tiles' geometry is written.
fn sweep(
    job: &Conversion,
    work: &Path,
    memory: &Arc<MemoryPool>,
    writer: &TileWriter,
    checkpointer: &mut Checkpointer,
) -> Result<Swept> {
    let swept = read_twice(job, work, |volume, is_slow| {
        let input = LabelInput {
            job,
            volume,
            is_slow,
            memory,
            work,
        };
        let (mut labelled, left_out) = label(&input, checkpointer)?;
        let numbering = Numbering::of(&labelled.provisional)?;
        let Labelled { slabs, spool, .. } = &mut labelled;
        let resolved = resolve(slabs, spool, numbering, work)?;
        let known = KnownBands {
            tiling: job.plan.tiling,
            first: job.made.first,
            kept: &labelled.bands,
            ids: &resolved.bands,
        };
        let input = CellsInput {
            job,
            known,
            memory,
            work,
        };
        let cells = cells(&input, &labelled.marks, checkpointer)?;
        let input = WallsInput {
            job,
            volume,
            known,
            rows: cells.as_ref().map(|cells| &cells.rows),
            memory,
            work,
        };
        let walls = job.options.walls.then(|| walls(&input)).transpose()?;
        let input = MeshInput {
            job,
            volume,
            memory,
            writer,
            known,
            cells: cells.as_ref(),
        };
        let meshed = mesh(&input, checkpointer)?;
        Ok(Swept {
            labelled,
            left_out,
            resolved,
            cells,
            walls,
            meshed,
        })
    })?;
    // labels and surfaces of a volume that changed meanwhile may not fit each other
    job.options.input.check()?;
    Ok(swept)
}

/// All stages between planning and moving into place.
fn make(job: &Conversion, work: &Path, checkpointer: &mut Checkpointer) -> Result<Made> {
    // what was labelled before was not seen
    let all_seen = checkpointer.kept() == 0;
    let measured = job.options.measured(&job.grid.header().placement)?;
    let memory = job.plan.pool();
    let writer = job.tile_writer(work);
    let mut set = TilesetWriter::new(work)?;
    let mut to_mesh = checkpointer.swept()..job.layers();
    to_mesh.try_for_each(|z| set.make_layer_directory(z))?;
    let mut swept = sweep(job, work, &memory, &writer, checkpointer)?;
    let (mut tiles, last_layer) = (swept.meshed.output, swept.meshed.last_layer);
    let sums = ScannedSums {
        caps: tiles.caps,
        nan: swept.labelled.nan,
    };
    let dust = dust_of(job.options, swept.left_out);
    let mut tables = MemoryReservation::new(&memory, TABLES);
    tables.grow_as_far_as(job.plan.tables());
    let places = swept.resolved.places();
    let input = SumUp {
        labelled: &mut swept.labelled,
        resolved: &mut swept.resolved,
        meshed: &mut tiles,
        places,
    };
    let of_cells = (swept.cells, swept.walls);
    let (committed, components) = rayon::join(
        || last_layer.commit(checkpointer),
        || components_of(job, work, &measured, input, of_cells),
    );
    committed?;
    let components = components?;
    let input = FinalizeInput {
        job,
        memory: &memory,
        writer: &writer,
        set: &mut set,
        placement: &measured,
        tiles: &mut tiles,
        components: &components,
        checkpointer,
    };
    let tables_bytes = finalize(input, |components, stop| {
        write_tables(work, components, &measured, stop)
    })?;
    let totals = sums.totals(set.written(), &components, job.options.cap)?;
    let bytes = totals.bytes + set.index_bytes() + tables_bytes;
    let (manifest, warnings) = stated(job, totals, dust, &components, all_seen);
    let index = set.finish(manifest)?;
    Ok(Made {
        totals,
        bytes: bytes + index,
        warnings,
        boot: None,
    })
}

/// The rows of the tables: sums over all tiles, borders, and the walls between cells if these were asked for.
fn components_of(
    job: &Conversion,
    work: &Path,
    placement: &Placement,
    input: SumUp,
    (cells, walls): (Option<GivenCells>, Option<SpillFile>),
) -> Result<Components> {
    let memory = job.plan.tables();
    let mut components = sum_up(input, cells, memory, work)?;
    components.add_borders()?;
    if let Some(walls) = walls {
        add_walls(&mut components, walls, placement, memory, work)?;
    }
    Ok(components)
}

/// What the index states beside its tiles, and what is doubtful about the set, which is told.
fn stated(
    job: &Conversion,
    totals: Totals,
    dust: Option<Dust>,
    components: &Components,
    all_seen: bool,
) -> (Manifest, Vec<String>) {
    let (dims, threshold) = (job.plan.tiling.dims, job.options.threshold);
    let mut warnings = warnings(&totals, dims, threshold, dust);
    if all_seen && totals.surfaces > 0 {
        warnings.extend(job.watch.kind().map(|kind| kind.warning()));
    }
    let given = components.given.as_ref().map(|given| &given.cells);
    let (unlabelled, curve) = given.map_or((0, &[][..]), |g| (g.unlabelled, &g.curve[..]));
    let cells = job.stated_cells(unlabelled, curve);
    let of_parts = cells.as_ref();
    let in_region = job.options.region.is_some();
    let more = of_parts.and_then(|parts| parts.warning(totals.cells, in_region));
    warnings.extend(more);
    warnings
        .iter()
        .for_each(|warning| job.progress.warn(warning));
    let manifest = Manifest {
        dust,
        cells,
        ..job.manifest(totals)
    };
    (manifest, warnings)
}

/// Calls `read` with the grid as it can be read several times, in any order, and whether that is slow.
fn read_twice<R>(
    job: &Conversion,
    work: &Path,
    read: impl FnOnce(&dyn Volume, bool) -> Result<R>,
) -> Result<R> {
    match job.grid.decoded_once(work)? {
        Some(once) => read(&*once, true),
        None if job.grid.random_access() => {
            let options = job.options;
            read(
                job.grid,
                options.keep_samples || options.source_filtered.is_some(),
            )
        }
        None => spool_beside(job.grid, work, |copy| read(copy, false)),
    }
}
