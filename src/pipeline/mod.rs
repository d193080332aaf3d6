//! The conversion, in the order of its stages.

mod anew;
mod band;
mod batch;
mod budget;
mod dust;
mod finish;
mod forward;
mod gather;
pub(crate) mod keep;
mod options;
pub(crate) mod output;
mod parts;
mod plan;
mod ration;
mod resolve;
mod resume;
mod shards;
mod slabs;
pub(crate) mod spool;
mod surfaces;
mod sweep;
mod tables;
mod tilefile;
mod warnings;
mod workspace;
mod writers;

pub use keep::Kept;
pub use options::{ConvertOptions, ConvertReport};
pub(crate) use output::Output;
pub use output::{check_output, interrupted};
use plan::{Plan, plan};
pub use tables::{COMPONENT_COLUMNS, SURFACE_COLUMNS, unit_text};
pub(crate) use tilefile::write_file;

use crate::error::{Error, Result};
use crate::grid::{LATTICE, Placement, Tiling};
use crate::manifest::{
    Dust, Encoding, FORMAT, FORMAT_VERSION, Generator, GridInfo, Manifest, Source, Tables, Totals,
};
use crate::progress::Progress;
use crate::tile::{TileHead, WidestNodes};
use crate::volume::{Cropped, Volume, Watch, Watched, spool_beside};
use budget::Budget;
use finish::{FinishSettings, Stop, finish};
use forward::Forward;
use keep::{Identity, Keeper, boot};
use resolve::{Components, resolve};
use resume::{announced, begin, complete};
use serde::{Deserialize, Serialize};
use shards::Layers;
use std::path::Path;
use std::time::Instant;
use sweep::{Sweep, Unkept};
use tilefile::{TileWriter, too_wide};
use warnings::warnings;
use writers::Writers;

/// Converts a volume to a tile set in the directory `out`.
///
/// The stages: plan the cut; sweep forward, labelling, meshing and writing the tiles' geometry;
/// resolve ids in reverse; give the tiles their ids and measures; write the tables; write the
/// manifest and move everything into place.
///
/// What is done of a layer is kept: see [`ConvertOptions::resume`].
///
/// # Errors
/// [`Error::Usage`] for impossible options, [`Error::Memory`] with the smallest limit that works,
/// those of [`check_output`], [`Error::OtherConversion`] if the one to resume is
/// another, [`Error::InputChanged`], [`Error::Io`], [`Error::Interrupted`], and what reading the volume returns. Nothing is
/// left under a final name then; [`interrupted`] tells whether finished layers are kept.
pub fn convert(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<ConvertReport> {
    let start = Instant::now();
    check(volume, options)?;
    let watch = Watch::new(volume.header(), options.source_scaled);
    let watched = Watched::new(Box::new(volume), &watch);
    let volume: &dyn Volume = &watched;
    let cropped;
    let grid: &dyn Volume = match &options.crop {
        Some(crop) => {
            cropped = Cropped::new(Box::new(volume), crop)?;
            &cropped
        }
        None => volume,
    };
    let plan = plan(grid, grid.header().dims, options)?;
    let report = |made: Made, (sweep, index): (u64, u32)| ConvertReport {
        totals: made.totals,
        bytes_written: made.bytes,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: crate::memory::peak_rss_bytes(),
        resumed_layers: sweep,
        resumed_index_layers: index,
        warnings: made.warnings,
    };
    let layers = plan.tiling.tiles()[2];
    let sweeps = if options.min_voxels > 1 { 3 } else { 1 };
    let all = (sweeps * u64::from(layers), layers);
    if options.resume
        && let Some(made) = complete(volume, grid, options, &plan, out, progress)
    {
        progress.warn("nothing to resume: the directory holds this tile set already, whole");
        output::tidy(out)?;
        return Ok(report(made, all));
    }
    let identity = Identity::of(volume, options);
    let mut output = Output::open(out, options.force, options.resume)?;
    if options.resume
        && let Some(made) = announced(&output, &identity)
    {
        progress.warn(&format!("resuming: all {} layers were done", all.0));
        output.keep(true);
        output.commit()?;
        return Ok(report(made, all));
    }
    let mut keeper = begin(&mut output, out, options, &identity, layers, progress)?;
    let resumed = (keeper.kept(), keeper.finished());
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(plan.threads)
        .build()
        .map_err(|e| Error::usage("--threads", plan.threads.to_string(), e.to_string()))?;
    let work = output.work().to_path_buf();
    let made = pool.install(|| {
        make(
            volume,
            grid,
            options,
            &plan,
            (&work, &mut keeper),
            (progress, &watch),
        )
    });
    // usage errors come back with the same options
    let usage = matches!(made, Err(Error::Usage { .. }));
    output.keep(keeper.has_any() && !usage);
    let mut made = made?;
    // nothing that was made of a changed input is of use
    let touched = options.input.check().inspect_err(|_| output.keep(false))?;
    if let Some(warning) = touched {
        progress.warn(&warning);
        made.warnings.push(warning);
    }
    // first what the note tells of, then the note: it may outlive a power failure
    keeper.disk().finish()?;
    made.boot = (!keeper.disk().is_used()).then(boot);
    let note = serde_json::to_vec(&made).expect("plain data serialises");
    output.announce(&note)?;
    keeper.disk().finish()?;
    drop(keeper);
    output.commit()?;
    Ok(report(made, resumed))
}

/// The peak of resident memory, in bytes, that a conversion is predicted to have.
///
/// # Errors
/// [`Error::Memory`] if `options.memory` is too small, [`Error::Usage`] for impossible options.
pub fn predicted_memory(volume: &dyn Volume, options: &ConvertOptions) -> Result<u64> {
    check(volume, options)?;
    let dims = match &options.crop {
        Some(crop) => crop.dims_in(volume.header().dims)?,
        None => volume.header().dims,
    };
    Ok(plan(volume, dims, options)?.memory)
}

/// Refuses a conversion that [`convert`] would refuse before it reads any sample, whatever the threshold.
///
/// # Errors
/// As of [`predicted_memory`] and, unless something is to be resumed, of [`check_output`].
pub fn check_before(volume: &dyn Volume, options: &ConvertOptions, out: &Path) -> Result<()> {
    predicted_memory(volume, options)?;
    if options.resume {
        return Ok(());
    }
    check_output(out, options.force)
}

fn check(volume: &dyn Volume, options: &ConvertOptions) -> Result<()> {
    options.measured(&volume.header().placement)?;
    if !options.threshold.is_finite() {
        return Err(Error::usage(
            "--threshold",
            options.threshold.to_string(),
            "a finite number",
        ));
    }
    if options.macrocube.contains(&0) {
        return Err(Error::usage(
            "--macrocube",
            format!("{:?}", options.macrocube),
            "at least 1 cube along each axis",
        ));
    }
    Ok(())
}

/// Refuses macrocubes that reach further than 16-bit positions: 255 cubes are 65,280 steps, and with
/// caps a tile reaches a voxel and a half further.
///
/// # Errors
/// [`Error::Usage`].
pub(crate) fn check_reach(encoding: Encoding, tiling: Tiling) -> Result<()> {
    const MOST: u32 = 254;
    let cubes = |a: usize| tiling.macrocube[a].min(tiling.dims.0[a] - 1);
    if encoding != Encoding::Float && (0..3).any(|a| cubes(a) > MOST) {
        return Err(too_wide(tiling.macrocube));
    }
    Ok(())
}

/// What [`make`] made.
#[derive(Serialize, Deserialize)]
struct Made {
    totals: Totals,
    bytes: u64,
    warnings: Vec<String>,
    /// The boot of the system until whose end this counts, if it is not known to be on the disk.
    #[serde(default)]
    boot: Option<Vec<u8>>,
}

/// All stages between planning and moving into place.
fn make(
    volume: &dyn Volume,
    grid: &dyn Volume,
    options: &ConvertOptions,
    plan: &Plan,
    (work, keeper): (&Path, &mut Keeper),
    (progress, watch): (&dyn Progress, &Watch),
) -> Result<Made> {
    // what was swept before was not seen
    let all_seen = keeper.kept() == 0;
    let measured = options.measured(&grid.header().placement)?;
    let head = TileHead {
        matrix: grid.header().placement.gltf_matrix(),
        form: options.form(),
    };
    let writer = TileWriter {
        dir: work.to_path_buf(),
        widest: WidestNodes::new(&head),
        head: head.clone(),
        tiling: plan.tiling,
    };
    let (forward, unkept) = swept(grid, options, plan, (&writer, &mut *keeper), progress)?;
    let mut totals = forward_totals(&forward);
    let dust = dust(options, &forward);
    let tables = plan.tables();
    let resolve = || resolve(forward, tables, work);
    let (kept, resolved) = rayon::join(|| unkept.keep(keeper), resolve);
    kept?;
    let (mut slabs, mut spool, mut ids, components) = resolved?;
    progress.begin("index", slabs.len() as u64);
    let budget = Budget::new(plan.limit, plan.fixed);
    let writers = Writers::new(plan.in_flight, plan.body, &budget);
    let settings = FinishSettings {
        dir: work,
        head: &head,
        widest: &writer.widest,
        placement: &measured,
        tiling: plan.tiling,
        writers: writers.as_ref(),
        memory: budget.left().saturating_sub(tables),
    };
    let (mut layers, tables_bytes) = finish(
        &mut slabs,
        &mut spool,
        (&mut ids, &components.cells),
        (&settings, keeper),
        &mut totals,
        progress,
        |stop| write_tables(work, &components, (&measured, stop)),
    )?;
    remove_empty_layer_directories(work, plan.tiling, &mut layers)?;
    sum_components(&components, options.cap, &mut totals)?;
    let bytes = totals.bytes + layers.bytes + tables_bytes;
    let mut warnings = warnings(&totals, grid.header().dims, (options.threshold, dust));
    if all_seen && totals.surfaces > 0 {
        warnings.extend(watch.kind().map(|kind| kind.warning()));
    }
    for warning in &warnings {
        progress.warn(warning);
    }
    let manifest = Manifest {
        dust,
        ..manifest(volume, grid, options, plan, totals)
    };
    let index = manifest.write_sealed_with(work, &mut |each| {
        layers.for_each(|layer| each(&layer.layer()))
    })?;
    Ok(Made {
        totals,
        bytes: bytes + index,
        warnings,
        boot: None,
    })
}

/// The sweep over the volume: all tiles but those that are made again, and what is known of pieces.
fn swept(
    grid: &dyn Volume,
    options: &ConvertOptions,
    plan: &Plan,
    (writer, keeper): (&TileWriter, &mut Keeper),
    progress: &dyn Progress,
) -> Result<(Forward, Unkept)> {
    let work = &writer.dir;
    let [x, y, layers] = plan.tiling.tiles();
    make_layer_directories(work, keeper.swept()..layers)?;
    let measured = options.measured(&grid.header().placement)?;
    progress.begin("tiles", [x, y, layers].map(u64::from).iter().product());
    let mut sweep = |volume: &dyn Volume| {
        let sweep = Sweep {
            volume,
            plan,
            threshold: options.threshold,
            rule: options.ambiguous,
            measured,
            cap: options.cap,
            min_voxels: options.min_voxels,
            writer,
            progress,
        };
        sweep.run(keeper)
    };
    // a slab's bands are read one by one, each through all its slices
    let forward_only = y == 1 && options.min_voxels < 2;
    match grid.decoded_once(work)? {
        Some(once) => sweep(&*once),
        None if grid.random_access() || forward_only => sweep(grid),
        None => spool_beside(grid, work, sweep),
    }
}

fn layer_directory(z: u32) -> String {
    format!("tiles/z{z:04}")
}

/// Makes the directories of layers to sweep, empty.
fn make_layer_directories(work: &Path, layers: std::ops::Range<u32>) -> Result<()> {
    for z in layers {
        let dir = work.join(layer_directory(z));
        output::remove_if_there(&dir)?;
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
    }
    Ok(())
}

/// A layer without surface has no tile, hence no directory.
fn remove_empty_layer_directories(work: &Path, tiling: Tiling, layers: &mut Layers) -> Result<()> {
    let remove = |layers: std::ops::Range<u32>| {
        let mut dirs = layers.map(|z| work.join(layer_directory(z)));
        dirs.try_for_each(|dir| output::remove_if_there(&dir))
    };
    let mut next = 0;
    layers.for_each(|layer| {
        remove(next..layer.z)?;
        next = layer.z + 1;
        Ok(())
    })?;
    remove(next..tiling.tiles()[2])
}

/// What was left out, if that was asked for.
fn dust(options: &ConvertOptions, forward: &Forward) -> Option<Dust> {
    let [objects, cells] = forward.dust;
    (options.min_voxels > 1).then_some(Dust {
        min_voxels: options.min_voxels,
        objects: objects.0,
        object_voxels: objects.1,
        cells: cells.0,
        cell_voxels: cells.1,
    })
}

/// The totals that the forward sweep knows.
fn forward_totals(forward: &Forward) -> Totals {
    Totals {
        cap_triangles: forward.caps.triangles,
        vertices: forward.caps.vertices,
        volume6: forward.caps.volume6,
        voxels_nan: forward.nan,
        ..Totals::default()
    }
}

/// Writes the tables of cells, objects and surfaces side by side; returns their bytes.
fn write_tables(
    work: &Path,
    components: &Components,
    (placement, stop): (&Placement, &Stop),
) -> Result<u64> {
    let write = |name: &str, table, above| {
        tables::write_components(&work.join(name), table, (placement, above), stop)
    };
    let (cells, (objects, surfaces)) = rayon::join(
        || write("cells.csv", &components.cells, false),
        || {
            let objects = write("objects.csv", &components.objects, true);
            let path = work.join("surfaces.csv");
            let surfaces = tables::write_surfaces(&path, &components.surfaces, placement, stop);
            (objects, surfaces)
        },
    );
    Ok(cells? + objects? + surfaces?)
}

/// Adds what follows from the components: their numbers, and the sums of their surfaces.
fn sum_components(components: &Components, cap: bool, totals: &mut Totals) -> Result<()> {
    totals.objects = components.objects.len();
    totals.cells = components.cells.len();
    totals.surfaces = components.surfaces.len();
    for i in 0..components.objects.len() {
        totals.voxels_above += components.objects.get(i)?.voxels.voxels;
    }
    for i in 0..components.surfaces.len() {
        let mesh = components.surfaces.get(i)?.mesh;
        totals.vertices += mesh.vertices;
        totals.volume6 += mesh.volume6;
        totals.border_edges += mesh.border_edges;
    }
    if cap {
        totals.border_edges = 0;
    }
    let edges = (3 * totals.triangles + totals.border_edges) / 2;
    totals.euler_characteristic = totals.vertices as i64 - edges as i64 + totals.triangles as i64;
    Ok(())
}

/// What the manifest says, but for its layers.
fn manifest(
    volume: &dyn Volume,
    grid: &dyn Volume,
    options: &ConvertOptions,
    plan: &Plan,
    totals: Totals,
) -> Manifest {
    let source = volume.header();
    let placement = grid.header().placement;
    Manifest {
        format: FORMAT.into(),
        format_version: FORMAT_VERSION,
        generator: Generator {
            name: "alvis".into(),
            version: env!("CARGO_PKG_VERSION").into(),
        },
        source: Source {
            name: options.source_name.clone(),
            format: source.format.into(),
            dims: source.dims,
            dtype: source.dtype,
            values: options.source_values.clone(),
            endian: source.endian,
            offset: options.source_offset,
            crop: options.crop.clone(),
            part: options.source_part.clone(),
            provenance: options.provenance,
        },
        grid: GridInfo {
            dims: plan.tiling.dims,
            macrocube: options.macrocube,
            tiles: plan.tiling.tiles(),
        },
        placement,
        table_unit: options.table_unit,
        threshold: options.threshold,
        ambiguous: options.ambiguous,
        cap: options.cap,
        dust: None,
        primitives: options.primitives,
        encoding: options.encoding,
        layout: options.layout,
        lattice: LATTICE,
        transform: placement.gltf_matrix(),
        totals,
        layers: Vec::new(),
        tables: Tables {
            cells: "cells.csv".into(),
            objects: "objects.csv".into(),
            surfaces: "surfaces.csv".into(),
            checksums: None,
        },
        selection: None,
        checksum: None,
    }
}
