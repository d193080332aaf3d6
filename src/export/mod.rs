//! One mesh of a whole tile set, or of some of its cells, as GLB, PLY, STL or OBJ.
//!
//! The tiles are read once, by rising z, y and x, a batch at a time in parallel. Vertices on the planes
//! between tiles are sewn by their place on the lattice of 1/256 voxel, which is a whole number, never by
//! a distance; only those on planes whose tiles beyond have yet to come are kept. So memory does not grow
//! with the surface, and the file is the same to the byte for any limit and number of threads: vertices
//! are numbered in the order in which tiles, pieces and vertices come.
//!
//! If everything is exported, the sewn mesh has exactly as many vertices and triangles as the index
//! states, which `alvis verify` has proved, or there is an error.
//!
//! | format | coordinates | beside the mesh |
//! |---|---|---|
//! | GLB | voxels, exact, below a node with the tiles' matrix to metres, Y up | normals, cell of each vertex |
//! | PLY | in the unit of the set, Z up | normals, cell and object of each triangle |
//! | STL | in the unit of the set, Z up | |
//! | OBJ | in the unit of the set, Z up | normals, a group for each cell |

mod choice;
mod format;
mod front;
mod gaps;
mod glb;
mod obj;
mod plan;
mod ply;
mod shape;
mod sheet;
mod simplify;
mod sink;
mod space;
mod stl;

pub use format::Format;
pub use simplify::Simplify;

use crate::error::{Error, Result};
use crate::grid::Unit;
use crate::manifest::{MANIFEST, Manifest, TileEntry, batch};
use crate::progress::Progress;
use crate::sys::process_memory::peak_rss_bytes;
use crate::table::{Chosen, Table, warn_of_open, warn_of_outside};
use crate::tileset::TileSet;
use crate::words::things;
use choice::{Choice, largest_cell};
use format::{Coded, Counts, Writer};
use front::{Front, Numbers};
use gaps::Gaps;
use plan::{Cost, Plan, wanted};
use rayon::prelude::*;
use serde::Serialize;
use sheet::Sheet;
use sink::Sink;
use std::path::Path;
use std::time::Instant;

/// What to export and how.
#[derive(Debug, Clone)]
pub struct ExportOptions {
    /// Which cells, objects or surfaces. Caps are exported with objects, and with cells or surfaces if all surfaces of the
    /// objects that these border are.
    pub chosen: Chosen,
    /// Fewer triangles.
    pub simplify: Option<Simplify>,
    /// Limit of peak resident memory in bytes.
    pub memory: u64,
    /// Replace the file if it exists.
    pub force: bool,
}

impl Default for ExportOptions {
    fn default() -> Self {
        ExportOptions {
            chosen: Chosen::default(),
            simplify: None,
            memory: 1 << 30,
            force: false,
        }
    }
}

/// What was exported; the command prints it with `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExportReport {
    /// The file's format.
    pub format: Format,
    /// Unit of the coordinates.
    pub unit: Unit,
    /// Tiles that were read.
    pub tiles: u64,
    /// Triangles in the file.
    pub triangles: u64,
    /// Vertices in the file; absent for STL, whose triangles share none.
    pub vertices: Option<u64>,
    /// Triangles before simplification; absent without it.
    pub triangles_before: Option<u64>,
    /// The largest error that simplification estimates, in `unit`; absent without it.
    pub error: Option<f64>,
    /// Bytes of the file.
    pub bytes: u64,
    /// Wall time.
    pub seconds: f64,
    /// Largest resident set of the process so far, in bytes.
    pub peak_rss_bytes: u64,
    /// Things the user should know.
    pub warnings: Vec<String>,
}

/// Writes the surface of the tile set in `dir`, or of some of its cells, to `file`, whose name says the
/// format. With [`ExportOptions::force`] a file of that name is replaced, once the new one is whole.
///
/// # Errors
/// [`Error::FileExists`]; [`Error::Usage`] for a name, condition or simplification that cannot be, if nothing is left to
/// export, or if the format has no room for so much; [`Error::Memory`]; [`Error::Format`] if the tile set
/// is damaged; [`Error::Io`]; [`Error::Interrupted`]. No part of a file is left then.
///
/// # Examples
/// ```no_run
/// use alvis::export::{ExportOptions, export};
/// use alvis::progress::Quiet;
/// use alvis::table::Chosen;
///
/// let options = ExportOptions {
///     chosen: Chosen::cells("not touches_border"),
///     ..ExportOptions::default()
/// };
/// let made = export("foam".as_ref(), "pores.ply".as_ref(), &options, &Quiet)?;
/// println!("{} triangles", made.triangles);
/// # Ok::<(), alvis::Error>(())
/// ```
pub fn export(
    dir: &Path,
    file: &Path,
    options: &ExportOptions,
    progress: &dyn Progress,
) -> Result<ExportReport> {
    let started = Instant::now();
    let format = Format::of(file)?;
    let set = TileSet::open(dir)?;
    let manifest = set.manifest();
    let simplify = options.simplify.as_ref();
    let simplify = simplify
        .map(|s| s.in_grid(&manifest.placement))
        .transpose()?;
    let choice = Choice::new(dir, manifest, &options.chosen)?;
    let writer = format.writer(manifest, largest_cell(dir, manifest)?);
    let cost = Cost::new(&*writer, simplify.is_some());
    let plan = Plan::new(&set, &choice, &cost, options.memory)?;
    if plan.triangles == 0 {
        return Err(nothing(&options.chosen, choice.share(manifest)));
    }
    if simplify.is_none() {
        writer.check(choice.vertices(manifest), plan.triangles)?;
    }
    let run = Run {
        set: &set,
        choice: &choice,
        simplify: simplify.as_ref(),
        writer: &*writer,
        progress,
        force: options.force,
    };
    let Written {
        counts,
        error,
        gaps,
        bytes,
    } = run.write(file, &plan, &cost)?;
    let mut warnings: Vec<String> = writer.warning().into_iter().collect();
    warnings.extend(warned(dir, manifest, &options.chosen, &choice, gaps)?);
    warnings.iter().for_each(|w| progress.warn(w));
    Ok(ExportReport {
        format,
        unit: manifest.placement.unit,
        tiles: plan.tiles,
        triangles: counts.triangles,
        vertices: writer.sewn().then_some(counts.vertices),
        triangles_before: simplify.is_some().then_some(plan.triangles),
        error: simplify.is_some().then_some(error),
        bytes,
        seconds: started.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
        warnings,
    })
}

/// What a user should know of what was chosen, and where its mesh is open.
fn warned(
    dir: &Path,
    manifest: &Manifest,
    chosen: &Chosen,
    choice: &Choice,
    gaps: Gaps,
) -> Result<Vec<String>> {
    let mut warnings: Vec<String> = Vec::new();
    warnings.extend(warn_of_outside(dir, manifest, chosen, false)?);
    if gaps.are_at_faces() {
        warnings.extend(warn_of_open(
            dir,
            manifest,
            chosen,
            choice.has_caps(manifest),
        )?);
    }
    if gaps.are_inside() {
        warnings.push(gaping(choice.open_necks(dir, manifest)?));
    }
    Ok(warnings)
}

/// What a user should know of a mesh that ends elsewhere than at the faces of the volume: at so many openings of its cells, if
/// it is one of cells.
fn gaping(necks: Option<u64>) -> String {
    match necks.filter(|n| *n > 0) {
        Some(n) => format!(
            "the mesh is open at {}, where its cells touch cells that are not in it (necks.csv tells which)",
            things(n, "opening")
        ),
        None => "the mesh is open at openings between cells, since the surface goes on there with that of a cell that is not \
                 in it"
            .to_owned(),
    }
}

/// What is chosen has no surface; `share` is how many rows are of how many, if not all are.
fn nothing(chosen: &Chosen, share: Option<[u64; 2]>) -> Error {
    let name = chosen.table.name();
    let (option, found) = match (&chosen.condition, share) {
        (Some(text), Some([n, of])) => (
            "--where",
            format!("{text}, which holds for {n} of {of} {name}"),
        ),
        (None, Some([n, of])) => ("--largest", format!("{n} of {of} {name}")),
        (_, None) => ("OUT", "no triangle".to_owned()),
    };
    let expected = match chosen.table {
        Table::Cells => "at least one cell with a surface",
        Table::Objects => "at least one object with a surface",
        Table::Surfaces => "at least one surface",
    };
    Error::usage(option, found, expected)
}

/// Tiles per thread in a batch, so that threads seldom wait for each other.
const BATCH: usize = 8;

struct Run<'a> {
    set: &'a TileSet,
    choice: &'a Choice,
    simplify: Option<&'a simplify::InGrid>,
    writer: &'a dyn Writer,
    progress: &'a dyn Progress,
    force: bool,
}

/// What came into the file.
struct Written {
    counts: Counts,
    /// The largest of simplification.
    error: f64,
    gaps: Gaps,
    bytes: u64,
}

impl Run<'_> {
    /// Writes the file.
    fn write(&self, file: &Path, plan: &Plan, cost: &Cost) -> Result<Written> {
        self.progress.begin("export", plan.tiles);
        let mut sink = Sink::create(file, self.writer, self.force)?;
        let mut front = Front::new(crate::sys::atomic_file::directory(file));
        let mut counts = Counts {
            bounds: [[i32::MAX; 3], [i32::MIN; 3]],
            ..Counts::default()
        };
        let mut error = 0.0f64;
        let mut gaps = Gaps::default();
        let tiles = self.set.tiles();
        let mut tiles = tiles
            .filter(|t| !matches!(t, Ok(entry) if !wanted(self.choice, entry)))
            .peekable();
        loop {
            let most = BATCH * rayon::current_num_threads();
            let batch = batch(&mut tiles, most, |t| cost.tile(t), plan.room)?;
            if batch.is_empty() {
                break;
            }
            for (sheet, coded) in self.code(&batch, &mut front)? {
                counts.add(&sheet);
                gaps.add(sheet.gaps);
                error = error.max(sheet.simplified.error);
                sink.push(&coded)?;
            }
            counts.vertices = front.vertices();
            self.writer.check(counts.vertices, counts.triangles)?;
            self.progress.advance(batch.len() as u64);
            if self.progress.interrupted() {
                return Err(Error::Interrupted);
            }
        }
        self.check(&counts, plan)?;
        let bytes = sink.finish(&self.writer.head(&counts))?;
        Ok(Written {
            counts,
            error,
            gaps,
            bytes,
        })
    }

    /// Reads tiles, numbers their vertices in order, and makes them ready to be written.
    fn code(&self, batch: &[TileEntry], front: &mut Front) -> Result<Vec<(Sheet, Coded)>> {
        let read = |t| Sheet::read(self.set, t, self.choice, self.simplify);
        let sheets: Vec<Sheet> = batch.par_iter().map(read).collect::<Result<_>>()?;
        let mut all = Vec::with_capacity(sheets.len());
        for sheet in sheets {
            let numbers = match self.writer.sewn() {
                true => front.add(&sheet)?,
                false => Numbers {
                    all: Vec::new(),
                    first: 0,
                },
            };
            all.push((sheet, numbers));
        }
        let code = |(sheet, numbers): (Sheet, Numbers)| {
            let coded = self.writer.encode(&sheet, &numbers);
            (sheet, coded)
        };
        Ok(all.into_par_iter().map(code).collect())
    }

    /// What came out must be what the index states.
    fn check(&self, counts: &Counts, plan: &Plan) -> Result<()> {
        if self.simplify.is_some() {
            return Ok(());
        }
        let manifest = self.set.manifest();
        let (totals, whole) = (&manifest.totals, self.choice.is_whole());
        // of a part some vertices may be counted with cells that were left out
        let sewn = self.writer.sewn() && !manifest.may_gape();
        let vertices = whole && sewn && counts.vertices != totals.vertices;
        let triangles = whole && counts.triangles != totals.triangles;
        if vertices || triangles || counts.triangles != plan.triangles {
            let expected = match whole {
                true => format!("{} and {}", totals.triangles, totals.vertices),
                false => format!("{} triangles", plan.triangles),
            };
            return Err(Error::format(
                self.set.dir().join(MANIFEST),
                format!(
                    "tiles with {} triangles and {} vertices",
                    counts.triangles, counts.vertices
                ),
                expected,
            )
            .with_hint("`alvis verify` says more"));
        }
        Ok(())
    }
}

impl Counts {
    fn add(&mut self, sheet: &Sheet) {
        self.triangles += sheet.triangles.len() as u64;
        for p in &sheet.points {
            for a in 0..3 {
                self.bounds[0][a] = self.bounds[0][a].min(p[a]);
                self.bounds[1][a] = self.bounds[1][a].max(p[a]);
            }
        }
    }
}
