//! `alvis convert`: a volume to a tile set.

use super::again::Again;
use super::args::{Common, InputOptions, TableFile, input_help};
use super::bucket::Place;
use super::form::FormArgs;
use super::info;
use super::input::Input;
use super::lod;
use super::parse::{self, CropArg};
use super::prepare::{Prepared, Purpose};
use super::progress::Console;
use super::threshold::{TAKES, Threshold, threshold};
use super::view::ViewArgs;
use super::{Outcome, batch, output};
use crate::convert::{self, Accept, ConvertOptions, ConvertReport, NeckRule};
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Origin, Unit};
use crate::lod::{LodOptions, LodReport};
use crate::manifest::{Form, Manifest};
use crate::progress::Progress;
use crate::volume::{Opened, Stamp};
use crate::words::exact;
use clap::{Args, ValueEnum, ValueHint};
use serde::Serialize;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Defaults of --split-h and --split-min-radius.
pub(super) const SPLIT_H: &str = "0.5";
pub(super) const SPLIT_MIN_RADIUS: &str = "0";

/// Rule for ambiguous faces, as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum AmbiguousArg {
    /// The two above corners are separated: objects are 6-connected, cells 18-connected
    Separate,
    /// The two above corners are joined: objects are 18-connected, cells 6-connected
    Join,
}

impl From<AmbiguousArg> for Ambiguous {
    fn from(arg: AmbiguousArg) -> Self {
        match arg {
            AmbiguousArg::Separate => Ambiguous::Separate,
            AmbiguousArg::Join => Ambiguous::Join,
        }
    }
}

/// Convert a volume to a directory of glTF tiles
///
/// The surface lies where the samples cross the threshold. The directory gets one GLB per
/// macrocube, an index and tables of cells, objects and surfaces.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis convert scan.mhd OUT --threshold otsu\n  \
    alvis convert scan.raw OUT --dims 512,512,300 --dtype u16 --spacing 0.05 --unit mm --threshold 12000\n  \
    alvis convert scan.mhd PART --threshold 120 --crop :,:,100:160\n  \
    alvis convert scan.mhd WEB --threshold 120 --for web\n  \
    alvis convert scan.mhd OUT --threshold otsu --resume\n  \
    alvis convert scan.mhd OUT --threshold otsu --for web --lod\n  \
    alvis convert a.mhd b.mhd c.mhd --out-dir SCANS --threshold otsu")]
#[command(
    override_usage = "alvis convert [OPTIONS] --threshold <T|METHOD> <INPUT> <OUT>\n       \
    alvis convert [OPTIONS] --threshold <T|METHOD> --out-dir <DIR> <INPUT>..."
)]
pub struct ConvertArgs {
    /// The volume: a file, a folder of slices, a Zarr, or slices as in `s%04d.tif`
    #[arg(value_hint = ValueHint::FilePath, long_help = input_help())]
    pub input: PathBuf,
    /// The directory to write; with --out-dir another volume
    #[arg(value_hint = ValueHint::DirPath, required_unless_present = "out_dir")]
    pub out: Option<PathBuf>,
    /// More volumes, with --out-dir
    #[arg(value_hint = ValueHint::FilePath, value_name = "INPUT", requires = "out_dir")]
    pub more: Vec<PathBuf>,
    /// Convert all the volumes, each to a tile set of its own in this directory, with a table of them, scans.csv
    ///
    /// A tile set gets the name of its file without the endings. All options hold for all volumes. If one cannot be
    /// converted, the others are, the table says why, and the exit status is 2. With --resume those that are done stay;
    /// one that was made with other options is refused. Rows of other tile sets in the directory stay in the table.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out_dir: Option<PathBuf>,
    /// A voxel is above (metal) if its value is at least this; or how to find it from the histogram
    ///
    /// Methods are `otsu` (two heaps of like size), `peaks` (half-way between the two peaks: little of one phase), `li`,
    /// `triangle` (one heap with a tail) and `porosity=31%` (this share of the voxels is below, of the whole volume, also with --crop). `alvis info` shows what
    /// they find beforehand.
    #[arg(long, value_name = TAKES, allow_hyphen_values = true, value_parser = threshold)]
    pub threshold: Threshold,
    /// Cubes per macrocube, that is per tile: one number, or three
    #[arg(long, value_name = "N|X,Y,Z", default_value = "64", value_parser = parse::macrocube)]
    macrocube: [u32; 3],
    /// Limit of resident memory; 2g is 2 * 10^9 bytes, 2GiB is 2 * 2^30
    #[arg(long, value_name = "SIZE", default_value = "1GiB", value_parser = parse::bytes)]
    memory: u64,
    /// What happens to the two above corners of an ambiguous face
    #[arg(long, value_name = "RULE", default_value = "separate")]
    ambiguous: AmbiguousArg,
    /// Close the surface half a voxel outside the volume's faces
    #[arg(long)]
    cap: bool,
    /// Leave out objects and cells of fewer voxels; they are filled with the other phase. Of cells that are split, and of those
    /// of --labels, it goes by the connected parts that they are of
    #[arg(long, value_name = "N", default_value_t = 0)]
    min_voxels: u64,
    /// The cells are those of this volume of labels, of the same size: a voxel below belongs to the cell of its label
    ///
    /// For pores that another program has separated. The surface comes from the values of the scan; cells of one connected
    /// part are open where they touch, and necks.csv lists where. Labels are whole numbers, and are the ids of the cells;
    /// voxels below with label 0 are one more cell, behind the largest label. Labels of voxels above mean nothing, and may be
    /// below 0 there.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, conflicts_with = "out_dir")]
    pub(super) labels: Option<PathBuf>,
    /// Split cells that leak into each other where the opening is at most this part of the smaller one's radius
    /// [without a number: 0.8]
    ///
    /// For walls with holes: a foam whose bubbles one threshold joins. A cell ends where the radius of the opening between
    /// it and the next is at most RATIO times its own; necks.csv lists all openings, and `alvis cells OUT --split-curve`
    /// how many cells other ratios give. Comes after the filters and --min-voxels.
    #[arg(long, value_name = "RATIO", num_args = 0..=1, default_missing_value = "0.8", allow_negative_numbers = true, value_parser = parse::ratio, conflicts_with = "labels")]
    split: Option<u32>,
    /// With --split: do not cut where the radius falls by less than this, in voxels of the finest axis, to 1/256 of one; 1 for
    /// thin tubes
    #[arg(long, value_name = "H", default_value = SPLIT_H, allow_hyphen_values = true, value_parser = parse::voxels_256, requires = "split", conflicts_with = "labels")]
    split_h: u32,
    /// With --split: what is thinner than this radius, in voxels of the finest axis, is no cell of its own
    #[arg(long, value_name = "R", default_value = SPLIT_MIN_RADIUS, allow_hyphen_values = true, value_parser = parse::voxels_256, requires = "split", conflicts_with = "labels")]
    split_min_radius: u32,
    /// Also find the walls between cells: walls.csv, and how many neighbours each cell has and how thick its walls are
    ///
    /// walls.csv lists pairs of cells with the area and the median thickness of what lies between them, measured between the
    /// places where lines of voxels cross the surface. This takes another pass over the volume.
    #[arg(long)]
    walls: bool,
    /// Convert this box of voxels only; half-open, a missing bound is the volume's
    ///
    /// Voxels are those of the filtered volume. What filters read of voxels outside of the box still counts, so that a
    /// crop is the same part of the whole.
    #[arg(long, value_name = "X0:X1,Y0:Y1,Z0:Z1", value_parser = parse::crop)]
    crop: Option<CropArg>,
    /// Unit of lengths in tables and in the measures that tiles carry: m, cm, mm, um or nm [default: the volume's]
    #[arg(long, value_name = "UNIT", value_parser = parse::length_unit)]
    table_unit: Option<Unit>,
    /// Kinds of the tables' files: csv, or csv,parquet
    #[arg(
        long,
        value_name = "KINDS",
        value_delimiter = ',',
        default_value = "csv"
    )]
    tables: Vec<TableFile>,
    /// Keep the samples beside the surface on the disk of OUT and read the volume once, not twice: for a volume on a slow
    /// drive that is larger than memory
    ///
    /// The first pass finds the cells, the second one needs the samples beside the surface again. They take as much disk as
    /// the rows of voxels that have surface: of a foam all of it. Filtered and packed volumes are read once in any case.
    #[arg(long)]
    keep_samples: bool,
    /// Replace a tile set that is in the directory
    #[arg(long)]
    pub force: bool,
    /// Go on with a conversion that was interrupted: finished layers are not done again
    ///
    /// Input and options must be those of the interrupted conversion; --memory, --threads, --io,
    /// --force, --quiet and --json may change. If there is nothing to go on with, the conversion begins
    /// at the beginning; if the directory holds this tile set already, whole and younger than the input,
    /// nothing is done, but with --force what was begun in place of it goes on.
    #[arg(long)]
    pub resume: bool,
    /// Add levels of detail when the tiles are done, as `alvis lod` does; not with --split or --labels, where they would gape
    /// between cells that touch
    #[arg(long)]
    pub(super) lod: bool,
    /// Look at the tiles in the browser when they are done, as `alvis view` does
    #[arg(long, conflicts_with_all = ["json", "out_dir"])]
    pub(super) view: bool,
    #[command(flatten)]
    form: FormArgs,
    #[command(flatten)]
    pub(super) options: InputOptions,
    #[command(flatten)]
    pub common: Common,
}

/// What `--json` prints.
#[derive(Serialize)]
pub struct Printed<'a> {
    #[serde(flatten)]
    report: &'a ConvertReport,
    /// 0 where cells are parts of components that touch nowhere: the totals leave it out.
    #[serde(skip_serializing_if = "Option::is_none")]
    necks: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lod: Option<&'a LodReport>,
}

impl ConvertArgs {
    /// Converts one volume or several; `typed` is the command line that asks for it.
    pub fn run(self, typed: &[OsString]) -> Result<Outcome> {
        self.run_if(typed, &|_| Ok(()))
    }

    /// The same; of one volume, what `accept` refuses is not moved into place.
    pub(super) fn run_if(self, typed: &[OsString], accept: &Accept) -> Result<Outcome> {
        self.check_lod()?;
        let (None, Some(out)) = (&self.out_dir, &self.out) else {
            return batch::run(self, typed);
        };
        let console = self.common.start();
        let input = Input::Path(&self.input);
        let place = Place::of(out, self.resume)?;
        let again = Again::Typed(typed);
        let report = self.convert_if(input, &place.dir(), accept, again, &console)?;
        let levels = self.levels(&place.dir(), &console)?;
        place.put(&console)?;
        drop(console);
        if self.common.json {
            output::print_json(&self.printed(&report, levels.as_ref()))?;
        } else if self.common.talks() {
            output::print(&summary(&report))?;
            if let Some(levels) = &levels {
                output::print(&lod::summary(levels))?;
            }
        }
        match self.view {
            true => ViewArgs::of(out, self.common.quiet).run(),
            false => Ok(Outcome::Done),
        }
    }

    /// Refuses levels of detail of cells that are parts of components.
    fn check_lod(&self) -> Result<()> {
        let option = match (self.split.is_some(), self.labels.is_some()) {
            (true, _) => "--split",
            (_, true) => "--labels",
            _ => return Ok(()),
        };
        match self.lod {
            true => Err(Error::usage(
                "--lod",
                format!("it with {option}"),
                "one of the two: levels of such a set would gape where cells touch",
            )),
            false => Ok(()),
        }
    }

    /// What `--json` prints of a conversion, and of the levels of detail, if there are any.
    pub fn printed<'a>(
        &self,
        report: &'a ConvertReport,
        lod: Option<&'a LodReport>,
    ) -> Printed<'a> {
        let totals = &report.totals;
        Printed {
            report,
            necks: (totals.components > 0 && totals.necks == 0).then_some(0),
            lod,
        }
    }

    /// Adds levels of detail to the tile set in a directory, if they are asked for.
    pub fn levels(&self, out: &Path, console: &Console) -> Result<Option<LodReport>> {
        if !self.lod {
            return Ok(None);
        }
        if Manifest::open(out)?.totals.tiles == 0 {
            console.warn("there is no surface, so there are no levels of detail of it");
            return Ok(None);
        }
        let options = LodOptions {
            memory: self.memory,
            threads: self.common.threads.map_or(0, usize::from),
            resume: self.resume,
            ..LodOptions::default()
        };
        let made = lod::make(out, &options, console);
        let typed = output::shell(out);
        made.map(Some).map_err(|error| match error {
            Error::Memory { limit, needed, .. } => {
                let mib = needed.div_ceil(1 << 20);
                Error::Memory {
                    limit,
                    needed,
                    hint: format!(
                        "of the levels of detail: the tile set is there and whole without them, `alvis lod {typed} --memory {mib}MiB` \
                         adds them"
                    ),
                }
            }
            // those of another ratio; --force of this command is for the tiles
            other @ Error::Usage { .. } if convert::interrupted(out).is_none() => other
                .with_hint(format!("the tile set is there and whole: `alvis lod {typed} --force` makes its levels of detail anew")),
            other => other,
        })
    }

    /// What is asked for of a volume, but for the threshold and the region, which it may take a look at it to find.
    pub(super) fn of_opened(&self, opened: &Opened, stamp: Stamp) -> Result<ConvertOptions> {
        let dims = opened.volume.header().dims;
        let crop = self.crop.as_ref().map(|c| c.resolve(dims)).transpose()?;
        let form = self.form.form(Form::default());
        Ok(ConvertOptions {
            macrocube: self.macrocube,
            memory: self.memory,
            threads: self.common.threads.map_or(0, usize::from),
            ambiguous: self.ambiguous.into(),
            cap: self.cap,
            min_voxels: self.min_voxels,
            walls: self.walls,
            split: self.split.map(|ratio_permille| NeckRule {
                ratio_permille,
                h_256: self.split_h,
                min_radius_256: self.split_min_radius,
            }),
            crop,
            primitives: form.primitives,
            encoding: form.encoding,
            layout: form.layout,
            table_unit: self.table_unit,
            parquet: TableFile::parquet(&self.tables)?,
            keep_samples: self.keep_samples,
            force: self.force,
            resume: self.resume,
            input: stamp,
            source_name: opened.name.clone(),
            source_offset: opened.offset,
            source_part: opened.part.clone(),
            source_values: opened.values.clone(),
            source_scaled: opened.scaled,
            source_filtered: opened.filtered.clone(),
            provenance: opened.provenance,
            ..ConvertOptions::default()
        })
    }

    /// Converts one volume into the directory `out`; `again` is what goes on with it.
    pub fn convert(
        &self,
        input: Input,
        out: &Path,
        again: Again,
        console: &Console,
    ) -> Result<ConvertReport> {
        self.convert_if(input, out, &|_| Ok(()), again, console)
    }

    /// The same; what `accept` refuses is not moved into place.
    fn convert_if(
        &self,
        input: Input,
        out: &Path,
        accept: &Accept,
        again: Again,
        console: &Console,
    ) -> Result<ConvertReport> {
        let Prepared {
            opened,
            options,
            doubts,
            understood,
            how,
        } = self.prepare(input, out, Purpose::Convert, console)?;
        if self.out_dir.is_none() {
            console.note(&understood);
        }
        let mut report = convert::convert_if(&*opened.volume, &options, out, accept, console)
            .map_err(|e| again.resumable(how_found(e, &how), out))
            .inspect_err(|e| {
                if matches!(e, Error::Interrupted) {
                    console.note("no layer was done yet, so nothing is kept");
                }
            })?;
        report.warnings = [opened.warnings, doubts, report.warnings].concat();
        Ok(report)
    }
}

/// An error that says that the threshold was another one before, with how this one was found, for it was not typed.
fn how_found(mut error: Error, how: &str) -> Error {
    if let Error::OtherTileSet { differences, .. } | Error::OtherConversion { differences, .. } =
        &mut error
    {
        let named = |line: &str| match line.starts_with("--threshold was ") {
            true => format!("{line}{how}"),
            false => line.to_owned(),
        };
        *differences = differences
            .split("; ")
            .map(named)
            .collect::<Vec<_>>()
            .join("; ");
    }
    error
}

/// What will be done, for the user to stop it if it is not what was meant.
///
/// # Errors
/// [`crate::Error::Memory`] if the limit is too small.
pub(super) fn understood(
    opened: &Opened,
    options: &ConvertOptions,
    region: Option<String>,
    how: &str,
) -> Result<String> {
    let header = opened.volume.header();
    let mut rows = vec![
        (
            "input",
            format!(
                "{}: {}, {} voxels, {}",
                opened.name,
                header.format,
                header.dims,
                info::sample_text(header)
            ),
        ),
        ("spacing", info::spacing_text(&header.placement, opened)),
        ("threshold", format!("{}{how}", exact(options.threshold))),
    ];
    if let Some(unit) = options.table_unit {
        rows.push(("tables", format!("lengths in {unit}")));
    }
    rows.extend(info::remarks(opened));
    rows.extend(region.map(|text| ("region", text)));
    rows.extend(options.crop.as_ref().map(|crop| ("crop", crop.to_string())));
    let predicted = convert::predicted_memory(&*opened.volume, options)?;
    rows.push((
        "memory",
        format!(
            "about {} of the {} allowed",
            output::bytes(predicted),
            output::bytes(options.memory)
        ),
    ));
    Ok(output::table(&rows).trim_end().to_string())
}

/// Where a value came from, for people.
pub fn from(origin: Origin) -> &'static str {
    match origin {
        Origin::Default => "not stated",
        Origin::File => "from the file",
        Origin::Option => "from the options",
        Origin::Assumed => "assumed",
    }
}

/// What a conversion made, for people.
pub fn summary(report: &ConvertReport) -> String {
    let totals = &report.totals;
    let (count, things) = (output::count, output::things);
    let mut rows = vec![
        (
            "tiles",
            format!(
                "{}, {}",
                count(totals.tiles),
                output::bytes(report.bytes_written)
            ),
        ),
        (
            "surface",
            format!(
                "{}, {} vertices",
                things(totals.triangles, "triangle"),
                count(totals.vertices)
            ),
        ),
        (
            "parts",
            format!(
                "{}, {}, {}",
                things(totals.objects, "object"),
                output::cells_of(totals),
                things(totals.surfaces, "surface")
            ),
        ),
    ];
    if totals.strips > 0 {
        let per_triangle = totals.strip_indices as f64 / totals.triangles.max(1) as f64;
        rows.push((
            "strips",
            format!(
                "{}, {per_triangle:.2} indices per triangle",
                count(totals.strips)
            ),
        ));
    }
    rows.push(("took", output::took(report.seconds, report.peak_rss_bytes)));
    output::table(&rows)
}
