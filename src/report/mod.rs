//! A report of a tile set for the lab book: what was converted and how, and what came out, as one page without anything
//! from elsewhere, or as JSON with the same numbers.
//!
//! The same tile set gives the same bytes: a page has no time and no path.

mod cells;
mod page;
mod pairs;
mod picture;
mod plots;
mod sources;
mod split;

pub use cells::{Form, Outlier};
pub use pairs::{Necks, Walls};
pub use picture::{Picture, SourceVolume};
pub use sources::{DEFINITIONS, Definition};
pub use split::{CurvePoint, SplitCells};

use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Filter, Placement, Region, Unit};
use crate::manifest::{Dust, Generator, GridInfo, Manifest, PartsBy, Selection, Source, Totals};
use crate::progress::Progress;
use crate::structure::{Structure, Wanted, structure};
use crate::sys::atomic_file::NewFile;
use crate::table::{Outside, Query, Summary, Table, summarise};
use crate::tileset::TileSet;
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// What a report is of.
#[derive(Default)]
pub struct ReportOptions<'a> {
    /// Which cells are air around the sample.
    pub outside: Outside,
    /// The volume that the tiles were made from, for its grey values in the picture.
    pub source: Option<SourceVolume<'a>>,
    /// Make a picture; what is only printed as JSON needs none.
    pub picture: bool,
}

/// A report; the command prints it with `--json`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// What made the report.
    pub generator: Generator,
    /// What the tiles were made from, and how.
    pub settings: Settings,
    /// Sums over the tiles.
    pub totals: Totals,
    /// What the cells sum up to; see [`Summary`].
    pub summary: Summary,
    /// The form of whole cells, a measure after the other.
    pub form: Vec<Form>,
    /// Porosity by slices and boxes, orientation of the surface and lengths of lines.
    #[serde(flatten)]
    pub structure: Structure,
    /// How cells were split, if they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<SplitCells>,
    /// Necks between cells, if the set has a table of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub necks: Option<Necks>,
    /// Walls between cells, if the set has a table of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walls: Option<Walls>,
    /// Whole cells that lie far from the others, the farthest first, 20 at most.
    pub outliers: Vec<Outlier>,
    /// How all these are defined, and what to cite.
    pub definitions: Vec<Definition>,
    /// What makes the numbers doubtful.
    pub warnings: Vec<String>,
    /// A slice through the middle.
    #[serde(skip)]
    pub picture: Option<Picture>,
}

/// What the tiles were made from, and how: as the index states it.
#[derive(Debug, Clone, Serialize)]
pub struct Settings {
    /// The program that made the tiles.
    pub made_by: Generator,
    /// Checksum of the index, which holds those of all other files of the set.
    pub index_checksum: Option<String>,
    /// The input.
    pub source: Source,
    /// What was done to the samples before the threshold.
    pub filters: Vec<Filter>,
    /// The region of interest; absent if all of the grid counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// The grid.
    pub grid: GridInfo,
    /// Its place.
    #[serde(flatten)]
    pub placement: Placement,
    /// Unit of all lengths of the report.
    pub table_unit: Unit,
    /// The threshold.
    pub threshold: f64,
    /// The rule for ambiguous faces.
    pub ambiguous: Ambiguous,
    /// The surface is closed at the faces of the grid.
    pub cap: bool,
    /// What cells are, where they are parts of components.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cells: Option<PartsBy>,
    /// What was left out as dust.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dust: Option<Dust>,
    /// How the set was chosen from another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
}

impl Settings {
    fn of(m: &Manifest) -> Self {
        Settings {
            made_by: m.generator.clone(),
            index_checksum: m.checksum.clone(),
            source: m.source.clone(),
            filters: m.filters.clone(),
            region: m.region.clone(),
            grid: m.grid,
            placement: m.placement,
            table_unit: m.measured().unit,
            threshold: m.threshold,
            ambiguous: m.ambiguous,
            cap: m.cap,
            cells: m.cells.clone(),
            dust: m.dust,
            selection: m.selection.clone(),
        }
    }
}

/// Reads a tile set for a report: its tables, and its tiles once. Memory: a tile for each thread, 32 MiB, some 100 bytes
/// for each whole cell, and with a picture some 16 bytes for each voxel of a slice.
///
/// # Errors
/// What reading returns, those of [`TileSet::check_tables`], [`crate::table::summarise`], [`crate::structure::structure`] and
/// [`crate::preview::preview`].
pub fn report(dir: &Path, options: &ReportOptions, progress: &dyn Progress) -> Result<Report> {
    let set = TileSet::open(dir)?;
    set.check_tables()?;
    let manifest = set.manifest();
    let all = Query::default();
    let summary = summarise(dir, manifest, Table::Cells, &all, options.outside)?;
    let middle = manifest.grid.dims.0[2] / 2;
    let drawn = options.picture && manifest.grid.dims.slice_voxels() <= picture::VOXELS;
    let from_tiles = drawn && options.source.is_none();
    let wanted = Wanted {
        outside: options.outside,
        porosity: true,
        slice: from_tiles.then_some(middle),
    };
    let structure = structure(&set, &wanted, progress)?;
    let cells::Forms { forms, outliers } = cells::forms(dir, manifest, options.outside)?;
    let mut warnings = summary.warnings.clone();
    warnings.extend(split::warning(manifest));
    warnings.extend(structure.notes.iter().cloned());
    let shown = picture::Shown {
        z: middle,
        by_size: forms.iter().any(|f| f.column == "equivalent_diameter"),
    };
    let picture = match (&options.source, &structure.slice) {
        (Some(source), _) if drawn => Some(picture::of_volume(dir, shown, source)?),
        (None, Some(bits)) => Some(picture::of_tiles(dir, manifest, shown, bits)?),
        _ => None,
    };
    if options.picture && !drawn {
        warnings.push("a slice is too large for a picture here: alvis preview draws it".to_owned());
    }
    Ok(Report {
        generator: Generator {
            name: env!("CARGO_PKG_NAME").to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        },
        settings: Settings::of(manifest),
        totals: manifest.totals,
        summary,
        form: forms,
        split: SplitCells::of(manifest),
        necks: pairs::necks(&set)?,
        walls: pairs::walls(&set)?,
        structure,
        outliers,
        definitions: sources::definitions(manifest.cells.as_ref()),
        warnings,
        picture,
    })
}

/// Refuses to write over a file, before any work.
///
/// # Errors
/// [`Error::FileExists`].
pub fn check_file(path: &Path, force: bool) -> Result<()> {
    if !force && path.symlink_metadata().is_ok_and(|m| !m.is_dir()) {
        return Err(exists(path));
    }
    Ok(())
}

/// Writes a report as one page of HTML, whole or not at all.
///
/// # Errors
/// [`Error::FileExists`] unless `force` is set; [`Error::Io`].
pub fn write_page(report: &Report, path: &Path, force: bool) -> Result<()> {
    check_file(path, force)?;
    let failed = |e: std::io::Error| match e.kind() {
        ErrorKind::AlreadyExists => exists(path),
        _ => Error::io(path, "write the report", e),
    };
    let mut file = NewFile::create(path).map_err(failed)?;
    file.write_all(page::page(report).as_bytes())
        .map_err(failed)?;
    file.keep(force).map_err(failed)
}

fn exists(path: &Path) -> Error {
    Error::FileExists {
        path: path.to_path_buf(),
    }
}
