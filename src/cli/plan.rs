//! `alvis plan`: a conversion in parts, by many processes.

use super::convert::ConvertArgs;
use super::info::tile_bytes;
use super::input::Input;
use super::plan_script::{Engine, Script};
use super::prepare::{Prepared, Purpose};
use super::{Cli, Command, Outcome, output};
use crate::convert::parts::{Asked, PartsPlan, plan_parts};
use crate::convert::{ConvertOptions, LabelRows, Labels};
use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::progress::Quiet;
use crate::volume::{Cropped, Prediction, Volume, predict};
use clap::{Args, Parser};
use serde::Serialize;
use std::ffi::OsString;
use std::path::Path;

/// Bytes of samples that a prediction reads, as far as two slices are not more.
const LOOKED_AT: u64 = 256 << 20;
/// Slices that it reads at most.
const SLICES: u64 = 64;
/// Bytes of a voxel between rounds: bits, runs, sums.
const KEPT_FOR_VOXEL: f64 = 0.3;
/// More of it where cells are split: distances, basins and saddles.
const KEPT_FOR_SPLIT: f64 = 0.7;
/// Processor time of a pass that labels, for each voxel, and of all else for each triangle, in nanoseconds.
const NS_FOR_VOXEL: f64 = 4.0;
const NS_FOR_TRIANGLE: f64 = 37.0;
/// Processor time of splitting cells, for each voxel, in nanoseconds.
const NS_FOR_SPLIT: f64 = 45.0;
/// More of it where labels give cells: stretches of labels, and what is found of cells.
const KEPT_FOR_LABELS: f64 = 0.6;
/// Processor time of reading labels and cutting surfaces by them, for each voxel, in nanoseconds.
const NS_FOR_LABELS: f64 = 50.0;
/// Bytes between rounds of chords of walls, and processor time of finding these, for each triangle.
const KEPT_FOR_WALLS: f64 = 4.0;
const NS_FOR_WALLS: f64 = 80.0;
/// Jobs of a script ask for so many times the memory that is predicted, where the limit is not below: a volume may be denser
/// than a foam.
const ROOM: u64 = 4;
/// And for this, at least.
const LEAST: u64 = 256 << 20;
/// Threads of a job, at most, if it is not said how many.
const THREADS: usize = 8;
/// Files that a part leaves in a round, at most, besides tiles and shards.
const FILES_OF_ROUND: u64 = 20;

/// Plan a conversion in parts, which many processes or machines that share a file system work on
///
/// Takes the options of `alvis convert` and makes the same tile set. Nothing is submitted: `alvis work OUT --part K` is the
/// job of a part, in every round, and `alvis merge OUT` says which parts are to run, and joins them. With a method for the
/// threshold or a region that is to be found the volume is read here, with --labels the labels are.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    alvis plan scan.mhd OUT --threshold 128 --parts 100\n  \
    alvis plan scan.mhd OUT --threshold otsu --for web --parts 20 --script slurm > run.sh")]
#[command(override_usage = "alvis plan [OPTIONS] --parts <N> --threshold <T|METHOD> <INPUT> <OUT>")]
pub struct PlanArgs {
    /// How many parts; at most one for each layer of macrocubes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    parts: u32,
    /// Print a script that does it all by this engine
    #[arg(long, value_name = "ENGINE", conflicts_with = "json")]
    script: Option<Engine>,
    // their own texts come before those of this command
    #[command(flatten)]
    convert: ConvertArgs,
}

/// What `--json` prints.
#[derive(Debug, Clone, Copy, Serialize)]
struct Costs {
    #[serde(flatten)]
    plan: PartsPlan,
    bytes_read: u64,
    bytes_written: u64,
    files: u64,
    cpu_seconds: f64,
}

impl PlanArgs {
    /// Makes a plan; `typed` is the command line that asks for it.
    pub fn run(self, typed: &[OsString]) -> Result<Outcome> {
        let args = &self.convert;
        let out = args.plain_out()?;
        let console = args.common.start();
        let Prepared {
            opened,
            options,
            understood,
            ..
        } = args.prepare(Input::Path(&args.input), out, Purpose::Plan, &console)?;
        let directory = std::env::current_dir();
        let directory = directory.map_err(|e| Error::io(".", "find the directory", e))?;
        let asked = Asked {
            words: words(typed)?,
            directory: text(directory.as_os_str())?,
            threshold: options.threshold,
            region: options.region.as_ref().map(|region| region.stated.clone()),
            labels: options.labels.as_ref().map(Labels::sums),
        };
        let plan = plan_parts(&*opened.volume, &options, out, self.parts, asked)?;
        let costs = Costs::of(&*opened.volume, &options, plan)?;
        drop(console);
        let script = Script {
            out,
            parts: plan.parts,
            memory: options.memory.min((ROOM * plan.memory_bytes).max(LEAST)),
            threads: match options.threads {
                0 => std::thread::available_parallelism().map_or(1, |n| n.get().min(THREADS)),
                threads => threads,
            },
        };
        match self.script {
            Some(engine) => output::print(&script.text(engine))?,
            None if args.common.json => output::print_json(&costs)?,
            None if args.common.talks() => {
                let rows = output::table(&costs.rows(&script));
                output::print(&format!("{understood}\n{rows}"))?;
            }
            None => {}
        }
        Ok(Outcome::Done)
    }

    /// The conversion that a plan was made for, from the words of its command line.
    ///
    /// # Errors
    /// [`Error::Usage`] if this version does not know them.
    pub fn again(asked: &Asked) -> Result<ConvertArgs> {
        let words = ["alvis", "plan"].into_iter();
        let words = words.chain(asked.words.iter().map(String::as_str));
        match Cli::try_parse_from(words).map(|cli| cli.command) {
            Ok(Command::Plan(args)) => Ok(args.convert),
            _ => {
                let found = asked.words.join(" ");
                Err(Error::usage("plan", found, "words that this version knows"))
            }
        }
    }
}

/// The words behind the command.
fn words(typed: &[OsString]) -> Result<Vec<String>> {
    typed.iter().skip(2).map(|word| text(word)).collect()
}

fn text(word: &std::ffi::OsStr) -> Result<String> {
    let text = word.to_str().map(str::to_owned);
    text.ok_or_else(|| {
        let found = format!("{}, whose name is not UTF-8", Path::new(word).display());
        Error::usage("plan", found, "names in UTF-8, which the plan keeps")
    })
}

/// Bytes of labels that are read: all of them by the plan, and those of their slices by the parts.
fn labels_bytes(tiling: Tiling, options: &ConvertOptions) -> u64 {
    let Some(labels) = &options.labels else {
        return 0;
    };
    let LabelRows::OnDemand(labels) = &labels.rows else {
        return 0;
    };
    let header = labels.volume.header();
    let [nx, ny, nz] = header.dims.0.map(u64::from);
    let [.., slices] = tiling.dims.0.map(u64::from);
    nx * ny * (nz + slices) * header.dtype.bytes() as u64
}

impl Costs {
    fn of(volume: &dyn Volume, options: &ConvertOptions, plan: PartsPlan) -> Result<Self> {
        let part = Cropped::part(Box::new(volume), options.crop.as_ref())?;
        let header = part.header();
        let [nx, ny, _] = header.dims.0.map(u64::from);
        let sample = header.dtype.bytes() as u64;
        let slices = (LOOKED_AT / (nx * ny * sample)).clamp(2, SLICES);
        let surface = predict(&*part, options.threshold, slices as u32, &Quiet)?;
        let tiling = Tiling {
            dims: header.dims,
            macrocube: options.macrocube,
        };
        Ok(Costs::predicted(tiling, sample, options, &surface, plan))
    }

    fn predicted(
        tiling: Tiling,
        sample: u64,
        options: &ConvertOptions,
        surface: &Prediction,
        plan: PartsPlan,
    ) -> Self {
        let voxels = tiling.dims.voxels();
        let [x, y, layers] = tiling.tiles().map(u64::from);
        let tiles = (x * y * layers).min(surface.triangles);
        let labelled = if options.min_voxels > 1 { 3 } else { 1 };
        let yes = |given: bool| if given { 1.0 } else { 0.0 };
        let split = yes(options.split.is_some());
        let walls = surface.triangles as f64 * yes(options.walls);
        // here, and by the parts
        let of_labels = labels_bytes(tiling, options);
        let labels = yes(of_labels > 0);
        let keeps = options.keep_samples || options.source_filtered.is_some();
        // chords need the samples beside the surface, as meshing does
        let passes = labelled + u64::from(!keeps) * (1 + u64::from(options.walls));
        let kept = if keeps { sample as f64 } else { 0.0 };
        let for_voxel =
            KEPT_FOR_VOXEL * labelled as f64 + KEPT_FOR_SPLIT * split + KEPT_FOR_LABELS * labels;
        let scratch = voxels as f64 * (for_voxel + kept) + walls * KEPT_FOR_WALLS;
        let for_each =
            NS_FOR_VOXEL * labelled as f64 + NS_FOR_SPLIT * split + NS_FOR_LABELS * labels;
        let for_surface = surface.triangles as f64 * NS_FOR_TRIANGLE + walls * NS_FOR_WALLS;
        let nanoseconds = voxels as f64 * for_each + for_surface;
        Costs {
            plan,
            bytes_read: passes * voxels * sample + of_labels,
            bytes_written: tile_bytes(surface) + scratch as u64,
            files: tiles + layers + u64::from(plan.parts) * u64::from(plan.rounds) * FILES_OF_ROUND,
            cpu_seconds: nanoseconds * 1e-9,
        }
    }

    /// The same for people, and what to do next.
    fn rows(&self, script: &Script) -> Vec<(&'static str, String)> {
        let PartsPlan { parts, rounds, .. } = self.plan;
        let count = output::count;
        vec![
            ("parts", format!("{parts}, each in {rounds} rounds")),
            ("a worker", output::bytes(self.plan.memory_bytes)),
            (
                "all of them",
                format!(
                    "{} read, about {} written in {} files, {:.2} h of processor time",
                    output::bytes(self.bytes_read),
                    output::bytes(self.bytes_written),
                    count(self.files),
                    self.cpu_seconds / 3600.0
                ),
            ),
            ("each part", script.work("K")),
            ("and between", script.merge()),
        ]
    }
}
