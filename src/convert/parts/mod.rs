//! A conversion in parts, by many processes on many machines that share a file system.
//!
//! A part is a range of layers. Each does the stages of a conversion by itself, in rounds: it labels its layers; it writes the
//! geometry of its tiles, when all components have their ids; it finishes its tiles, when the sums over all components are
//! known. Between the rounds a merge joins what the parts have found of components that lie in several of them, in memory of
//! a slice; at last it moves everything into place. The bytes are those of [`convert`](crate::convert::convert).

mod commit;
mod directory;
mod ids;
mod join;
mod records;
mod rounds;
mod sealed;
mod small;
mod work;

pub use directory::Asked;

use crate::checkpoint::Identity;
use crate::convert::conversion::{Conversion, Made};
use crate::convert::layers::Layers;
use crate::convert::parts::commit::Commit;
use crate::convert::parts::directory::{Directory, Doer, FORMAT, Made as Left, Plan};
use crate::convert::parts::ids::merge_ids;
use crate::convert::parts::records::merge_records;
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::small::{SmallSearch, merge_small};
use crate::convert::parts::work::PartWork;
use crate::convert::resume::refuse_kept;
use crate::convert::{
    ConvertOptions, ConvertReport, identity, in_threads, predict, with_conversion,
};
use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::progress::{Progress, Quiet};
use crate::sys::process_memory::peak_rss_bytes;
use crate::tileset::{Output, interrupted, tidy};
use crate::volume::{Stamp, Volume};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// What a plan will cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PartsPlan {
    /// How many parts there are.
    pub parts: u32,
    /// How many rounds they do.
    pub rounds: u32,
    /// The peak of resident memory that work on a part is predicted to have.
    pub memory_bytes: u64,
}

/// What a part does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextWork {
    /// Nothing: it is done with all rounds, or the tile set is in place.
    Done,
    /// Nothing before a merge, since it is done with this round.
    Waits(&'static str),
    /// This round.
    Do(&'static str),
}

/// What a merge does next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NextMerge {
    /// Nothing: the tile set is in place.
    InPlace,
    /// Nothing before these parts have done this round.
    ToRun(&'static str, Vec<u32>),
    /// It joins what all parts have found.
    Join,
}

/// What a merge has come to.
#[derive(Debug, Clone, PartialEq)]
pub enum Merged {
    /// The tile set is in place; the report is of what this merge has moved there.
    InPlace(Option<Box<ConvertReport>>),
    /// These parts are to do this round.
    ToRun(&'static str, Vec<u32>),
}

/// Rows at both ends of the input whose samples tell it from others: as many as these bytes have.
const LOOKED_AT: u64 = 1 << 20;

/// Everything that the parts depend on. Nodes may find the input elsewhere, and tell times of other precision, so that
/// instead of its place some of its samples count.
fn identity_of(job: &Conversion) -> Result<Identity> {
    let mut input: Stamp = job.options.input.clone();
    input.values.retain(|(name, _)| name != "input");
    for (name, value) in &mut input.values {
        let whole = match name.as_str() {
            "last change of the input" => value
                .split_once('.')
                .map(|(s, _)| format!("{s} s after 1970")),
            "files of the input" => value.split_once(',').map(|(files, _)| files.to_owned()),
            _ => None,
        };
        if let Some(whole) = whole {
            *value = whole;
        }
    }
    input
        .values
        .push(("samples of the input".into(), looked_at(job.volume)?));
    Ok(identity::of(&input, &job.asked()))
}

/// A checksum of the first and the last samples of a volume.
fn looked_at(volume: &dyn Volume) -> Result<String> {
    let header = volume.header();
    let [nx, ny, nz] = header.dims.0;
    let row = u64::from(nx) * header.dtype.bytes() as u64;
    let rows = (LOOKED_AT / row).clamp(1, ny.into()) as u32;
    let mut samples = vec![0; (row * u64::from(rows)) as usize];
    let mut hasher = crc32fast::Hasher::new();
    for (y, z) in [(0..rows, 0), (ny - rows..ny, nz - 1)] {
        volume.read_box(0..nx, y, z..z + 1, &mut samples)?;
        hasher.update(&samples);
    }
    Ok(format!("CRC-32 {:08x} at its ends", hasher.finalize()))
}

/// Cuts layers to parts that differ by one layer at most.
fn cut(layers: u32, parts: u32) -> Vec<[u32; 2]> {
    let end = |part: u32| (u64::from(layers) * u64::from(part) / u64::from(parts)) as u32;
    (0..parts).map(|part| [end(part), end(part + 1)]).collect()
}

/// Refuses a plan that [`plan_parts`] would refuse before it reads any sample, whatever the threshold and the region;
/// `in_region` tells whether there will be one.
///
/// # Errors
/// As of [`plan_parts`].
pub fn check_plan(
    volume: &dyn Volume,
    options: &ConvertOptions,
    in_region: bool,
    out: &Path,
) -> Result<()> {
    check(volume, options)?;
    refuse_tile_set(out)?;
    predict(volume, options, in_region).map(|_| ())
}

fn refuse_tile_set(out: &Path) -> Result<()> {
    if !out.join(MANIFEST).exists() {
        return Ok(());
    }
    let found = format!("{}, which holds a tile set", out.display());
    let expected = "another directory: parts are not made where a tile set is";
    Err(Error::usage("OUT", found, expected))
}

/// Refuses what is not converted in parts.
fn check(volume: &dyn Volume, options: &ConvertOptions) -> Result<()> {
    let given = [
        ("--split", options.split.is_some()),
        ("--labels", options.labels.is_some()),
    ];
    if let Some((option, _)) = given.into_iter().find(|(_, given)| *given) {
        let expected = "neither --split nor --labels: cells that are parts of components are found in one process";
        return Err(Error::usage(option, "it with a plan", expected)
            .with_hint("`alvis convert` does it on one machine"));
    }
    if !volume.random_access() {
        let found = format!("{}, which is packed as one stream", options.source_name);
        let expected = "an input of which each part can be read by itself";
        return Err(Error::usage("INPUT", found, expected)
            .with_hint("unpack it first, as by `gunzip -k` or `zstd -d`"));
    }
    Ok(())
}

/// Plans the conversion of a volume into the directory `out` in so many parts. If the same plan is there already, it stays,
/// with all that its parts have done; `options.force` drops another one.
///
/// # Errors
/// [`Error::Usage`] if there are not as many layers, or for what is not converted in parts; [`Error::OtherPlan`] if another
/// plan is there; those of [`predicted_memory`](crate::convert::predicted_memory) and
/// [`check_unused`](crate::convert::check_unused), also with `options.force` if a tile set is there.
pub fn plan_parts(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    parts: u32,
    asked: Asked,
) -> Result<PartsPlan> {
    check(volume, options)?;
    with_conversion(volume, options, &Quiet, Layers::all, |job| {
        check(job.grid, options)?;
        let layers = job.layers();
        if parts == 0 || parts > layers {
            let expected = format!(
                "1 to {layers}: the volume has so many layers of macrocubes of {} voxels along z, of which a part has at least one",
                options.macrocube[2]
            );
            return Err(Error::usage("--parts", parts.to_string(), expected));
        }
        let rounds = Rounds::of(options).count();
        let plan = Plan {
            format: FORMAT,
            identity: identity_of(job)?.into_list(),
            parts: cut(layers, parts),
            rounds,
            asked,
        };
        write_plan(options, out, &plan)?;
        Ok(PartsPlan {
            parts,
            rounds,
            memory_bytes: job.plan.memory,
        })
    })
}

/// Writes a plan, unless the same one is there.
fn write_plan(options: &ConvertOptions, out: &Path, plan: &Plan) -> Result<()> {
    refuse_tile_set(out)?;
    match Directory::open(out) {
        Ok(Some(before)) if !options.force => {
            before.check(&Identity::new(plan.identity.clone()))?;
            let [was, is] = [&before.plan.parts, &plan.parts].map(Vec::len);
            if was != is {
                return Err(Error::OtherPlan {
                    path: out.to_path_buf(),
                    differences: format!("--parts was {was} and is {is}"),
                });
            }
            return Ok(());
        }
        Err(e) if !options.force => return Err(e),
        _ => {}
    }
    if !options.force {
        refuse_kept(out, interrupted(out))?;
    }
    let mut output = Output::open(out, options.force, false)?;
    output.clear()?;
    Directory::create(output.work(), plan)?;
    output.keep(true);
    Ok(())
}

/// The plan in a directory; `None` if the tile set is in place.
///
/// # Errors
/// [`Error::Usage`] if there is neither; as of [`Directory::open`].
fn planned(out: &Path) -> Result<Option<Directory>> {
    if out.join(MANIFEST).exists() {
        return Ok(None);
    }
    match Directory::open(out)? {
        Some(directory) => Ok(Some(directory)),
        // it may have been moved into place just now
        None if out.join(MANIFEST).exists() => Ok(None),
        None => {
            let found = format!("{}, which holds no plan", out.display());
            let expected =
                "a directory for which there is one: `alvis plan VOLUME OUT --parts N` makes it";
            Err(Error::usage("OUT", found, expected))
        }
    }
}

/// How the volume and the options of the plan in a directory are had again; `None` if the tile set is in place.
///
/// # Errors
/// [`Error::Usage`] if there is no plan; [`Error::Io`], [`Error::Format`], [`Error::OtherPlan`].
pub fn asked_of(out: &Path) -> Result<Option<Asked>> {
    Ok(planned(out)?.map(|directory| directory.plan.asked))
}

/// How many parts the plan in a directory has; `None` if the tile set is in place.
///
/// # Errors
/// As of [`asked_of`].
pub fn parts_of(out: &Path) -> Result<Option<u32>> {
    Ok(planned(out)?.map(|directory| directory.parts()))
}

/// What a part does next, which takes a few milliseconds to find out.
///
/// # Errors
/// As of [`asked_of`]; [`Error::Usage`] if there is no such part; [`Error::Format`] if what it has left is damaged.
pub fn next_work(out: &Path, part: u32) -> Result<NextWork> {
    let Some(directory) = planned(out)? else {
        return Ok(NextWork::Done);
    };
    directory.layers(part)?;
    Ok(match round_of(&directory, part)? {
        Ok(round) => NextWork::Do(round.name()),
        Err(None) => NextWork::Done,
        Err(Some(waits)) => NextWork::Waits(waits.name()),
    })
}

/// The round that a part does next, or the one that it is done with and whose merge it waits for, if there is any.
fn round_of(directory: &Directory, part: u32) -> Result<std::result::Result<Round, Option<Round>>> {
    let rounds = Rounds::counting(directory.plan.rounds);
    let mut before = None;
    for round in rounds.all() {
        let number = rounds.number(round);
        if directory.is_done(number, Doer::Part(part))? {
            before = Some(round);
            continue;
        }
        let merged = match number {
            1 => true,
            _ => directory.is_done(number - 1, Doer::Merge)?,
        };
        return Ok(match merged {
            true => Ok(round),
            false => Err(before),
        });
    }
    Ok(Err(None))
}

/// Does what a part does next, if there is anything; the volume and the options are those of the plan, but for memory and
/// threads.
///
/// # Errors
/// As of [`next_work`] and [`convert`](crate::convert::convert); [`Error::OtherPlan`] for another input or other options.
pub fn work_on_part(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    part: u32,
    progress: &dyn Progress,
) -> Result<()> {
    let Some(directory) = planned(out)? else {
        return Ok(());
    };
    let layers = directory.layers(part)?;
    let Ok(round) = round_of(&directory, part)? else {
        return Ok(());
    };
    let worked = with_conversion(
        volume,
        options,
        progress,
        |_| layers,
        |job| {
            directory.check(&identity_of(job)?)?;
            let rounds = Rounds::of(options);
            let work = PartWork {
                job,
                directory: &directory,
                rounds,
                part,
            };
            in_threads(job, || work.run(round))?
        },
    );
    match worked {
        // somebody else has done it meanwhile, and what is left of this attempt has been removed
        Err(_) if out.join(MANIFEST).exists() || was_done(&directory, round, part) => Ok(()),
        worked => worked,
    }
}

/// True if a part is done with a round.
fn was_done(directory: &Directory, round: Round, part: u32) -> bool {
    let number = Rounds::counting(directory.plan.rounds).number(round);
    matches!(directory.is_done(number, Doer::Part(part)), Ok(true))
}

/// What a merge does next.
///
/// # Errors
/// As of [`asked_of`]; [`Error::Format`] if what a part has left is damaged.
pub fn next_merge(out: &Path) -> Result<NextMerge> {
    let Some(directory) = planned(out)? else {
        return Ok(NextMerge::InPlace);
    };
    let rounds = Rounds::counting(directory.plan.rounds);
    for round in rounds.all() {
        let number = rounds.number(round);
        if directory.is_done(number, Doer::Merge)? {
            continue;
        }
        let left = left_to_do(&directory, number)?;
        return Ok(match left.is_empty() {
            true => NextMerge::Join,
            false => NextMerge::ToRun(round.name(), left),
        });
    }
    Ok(NextMerge::Join)
}

/// The parts that have not done a round.
fn left_to_do(directory: &Directory, round: u32) -> Result<Vec<u32>> {
    let mut left = Vec::new();
    for part in 0..directory.parts() {
        if !directory.is_done(round, Doer::Part(part))? {
            left.push(part);
        }
    }
    Ok(left)
}

/// Joins what all parts have found, if they have; at the end the tile set is in place.
///
/// # Errors
/// As of [`next_merge`]; [`Error::OtherPlan`] for another input or other options; [`Error::Format`] if what the parts have
/// left does not fit together; [`Error::OutputBusy`] if somebody else is about it.
pub fn merge_parts(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Merged> {
    let start = Instant::now();
    let Some(directory) = planned(out)? else {
        tidy_parts(out)?;
        return Ok(Merged::InPlace(None));
    };
    let merged = with_conversion(volume, options, progress, Layers::all, |job| {
        directory.check(&identity_of(job)?)?;
        let merge = Merge {
            job,
            directory: &directory,
            rounds: Rounds::of(options),
        };
        in_threads(job, || merge.run())?
    });
    match merged {
        Ok(Ok(made)) => Ok(Merged::InPlace(Some(Box::new(ConvertReport {
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
        })))),
        Ok(Err((round, left))) => Ok(Merged::ToRun(round.name(), left)),
        // another merge was first
        Err(_) if out.join(MANIFEST).exists() => Ok(Merged::InPlace(None)),
        Err(error) => Err(error),
    }
}

/// Removes what a merge has left that was killed after it had moved everything into place.
///
/// # Errors
/// [`Error::Io`].
pub fn tidy_parts(out: &Path) -> Result<()> {
    match tidy(out) {
        // whoever is at work there has begun anew
        Err(Error::OutputBusy { .. }) => Ok(()),
        tidied => tidied,
    }
}

/// A merge under way.
struct Merge<'a> {
    job: &'a Conversion<'a>,
    directory: &'a Directory,
    rounds: Rounds,
}

impl Merge<'_> {
    /// Joins round after round; returns what was made, or the round and the parts that are to do it.
    fn run(&self) -> Result<std::result::Result<Made, (Round, Vec<u32>)>> {
        for round in self.rounds.all() {
            let number = self.rounds.number(round);
            if self.directory.is_done(number, Doer::Merge)? {
                continue;
            }
            let left = left_to_do(self.directory, number)?;
            if !left.is_empty() {
                return Ok(Err((round, left)));
            }
            if round == Round::Finish {
                break;
            }
            match self.join(round) {
                // another merge was first, and has removed what was left of this one
                Err(_) if self.directory.is_done(number, Doer::Merge)? => {}
                joined => joined?,
            }
            self.directory.remove_others(number);
        }
        let commit = Commit {
            job: self.job,
            directory: self.directory,
            rounds: self.rounds,
        };
        commit.run().map(Ok)
    }

    /// Joins what the parts have found in a round.
    fn join(&self, round: Round) -> Result<()> {
        let (directory, number) = (self.directory, self.rounds.number(round));
        let attempt = directory.attempt(number, Doer::Merge)?;
        let dir = &attempt.dir;
        let memory = &self.job.plan.pool();
        match round {
            Round::Search(sweep) => {
                let search = SmallSearch {
                    above: sweep == 0,
                    min_voxels: self.job.options.min_voxels,
                };
                let made = merge_small(directory, number, dir, search, memory)?;
                self.done(attempt, made)
            }
            Round::Label => {
                let made = merge_ids(directory, number, dir, memory)?;
                self.done(attempt, made)
            }
            Round::Mesh | Round::Finish => {
                let made = merge_records(directory, number, dir)?;
                self.done(attempt, made)
            }
        }
    }

    fn done<T: Serialize>(&self, attempt: directory::Attempt, made: Left<T>) -> Result<()> {
        self.directory.finish(attempt, made).map(|_| ())
    }
}
