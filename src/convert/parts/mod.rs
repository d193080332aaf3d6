//! A conversion in parts, by many processes on many machines that share a file system.
//!
//! A part is a range of layers. Each does the stages of a conversion by itself, in rounds: it labels its layers; it writes the
//! geometry of its tiles, when all components have their ids; it finishes its tiles, when the sums over all components are
//! known. Between the rounds a merge joins what the parts have found of components that lie in several of them, in memory of
//! a slice; at last it moves everything into place. The bytes are those of [`convert`](crate::convert::convert).

mod commit;
mod directory;
mod handed_out;
mod ids;
mod join;
mod labels;
mod planning;
mod records;
mod rounds;
mod sealed;
mod small;
mod split;
mod walls;
mod work;

pub use directory::Asked;
pub use planning::{PartsPlan, check_plan, plan_parts};

use crate::convert::conversion::{Conversion, Made};
use crate::convert::layers::Layers;
use crate::convert::parts::commit::Commit;
use crate::convert::parts::directory::{Attempt, Directory, Doer, FileSum, Made as Left};
use crate::convert::parts::ids::{cell_owners, merge_ids};
use crate::convert::parts::labels::{each_contact, merge_labelled};
use crate::convert::parts::planning::{identity_of, refuse_parts_in_bucket};
use crate::convert::parts::records::{LeftInRound, merge_records};
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::small::{SmallSearch, merge_small};
use crate::convert::parts::split::{
    CellOwners, each_neck, merge_basins, merge_cells, merge_split_records,
};
use crate::convert::parts::walls::merge_walls;
use crate::convert::parts::work::PartWork;
use crate::convert::{ConvertOptions, ConvertReport, in_threads, report, with_conversion};
use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::progress::Progress;
use crate::tileset::{is_moved_in, tidy};
use crate::volume::Volume;
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long to wait until somebody else has moved a tile set in, and between two looks.
const PATIENCE: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(20);

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

/// The plan in a directory; `None` if the tile set is in place.
///
/// # Errors
/// [`Error::Usage`] if there is neither; as of [`Directory::open`].
fn planned(out: &Path) -> Result<Option<Directory>> {
    refuse_parts_in_bucket(out)?;
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
    Ok(match round_of(&directory, part) {
        // files went away while they were looked at: it has been moved into place
        Err(_) if out.join(MANIFEST).exists() => NextWork::Done,
        round => match round? {
            Ok(round) => NextWork::Do(round.name()),
            Err(None) => NextWork::Done,
            Err(Some(waits)) => NextWork::Waits(waits.name()),
        },
    })
}

/// The round that a part does next, or the one that it is done with and whose merge it waits for, if there is any.
fn round_of(directory: &Directory, part: u32) -> Result<std::result::Result<Round, Option<Round>>> {
    let rounds = directory.plan.rounds;
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
    let round = match round_of(&directory, part) {
        Ok(Ok(round)) => round,
        Ok(Err(_)) => return Ok(()),
        Err(_) if out.join(MANIFEST).exists() => return Ok(()),
        Err(error) => return Err(error),
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
    let number = directory.plan.rounds.number(round);
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
    let rounds = directory.plan.rounds;
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
        Ok(Ok(made)) => {
            let report = Box::new(report(made, options, start));
            Ok(Merged::InPlace(Some(report)))
        }
        Ok(Err((round, left))) => Ok(Merged::ToRun(round.name(), left)),
        // another merge was first
        Err(_) if somebody_else_merged(out) => Ok(Merged::InPlace(None)),
        Err(error) => Err(error),
    }
}

/// True if a tile set is in place, or comes there while one waits for it.
fn somebody_else_merged(out: &Path) -> bool {
    let start = Instant::now();
    while is_moved_in(out) && start.elapsed() < PATIENCE {
        std::thread::sleep(PAUSE);
    }
    out.join(MANIFEST).exists()
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
            Round::Basins => {
                let made = merge_basins(self.job, directory, number, dir, memory)?;
                self.done(attempt, made)
            }
            Round::Saddles => {
                let made = merge_cells(self.job, directory, self.rounds, dir)?;
                self.done(attempt, made)
            }
            Round::Mesh | Round::Finish if self.job.options.labels.is_some() => {
                let made = merge_labelled(directory, number, dir)?;
                let walls = self.walls(&attempt, &made.result.owners, each_contact)?;
                self.done(attempt, made.with(walls))
            }
            Round::Mesh | Round::Finish if self.job.options.split.is_some() => {
                let made = merge_split_records(self.job, directory, self.rounds, dir)?;
                let round = self.rounds.number(Round::Saddles);
                let cells = directory.merged(round, 0)?;
                let owners = &made.result.owners;
                let walls =
                    self.walls(&attempt, owners, |left, each| each_neck(left, &cells, each))?;
                self.done(attempt, made.with(walls))
            }
            Round::Mesh | Round::Finish => {
                let made = merge_records(directory, number, dir)?;
                let round = self.rounds.number(Round::Label);
                let owners = cell_owners(&directory.merged(round, 0)?);
                let walls = self.walls(&attempt, &owners, |_, _| Ok(()))?;
                self.done(attempt, made.with(walls))
            }
        }
    }

    /// Joins the walls between cells, if these were asked for; `openings` hands on the cells of each opening.
    fn walls(
        &self,
        attempt: &Attempt,
        owners: &CellOwners,
        openings: impl FnOnce(LeftInRound, &mut dyn FnMut([u64; 2]) -> Result<()>) -> Result<()>,
    ) -> Result<Vec<FileSum>> {
        if !self.job.options.walls {
            return Ok(Vec::new());
        }
        let left = LeftInRound {
            directory: self.directory,
            round: self.rounds.number(Round::Mesh),
        };
        let openings = |each: &mut dyn FnMut([u64; 2]) -> Result<()>| openings(left, each);
        merge_walls(self.job, left, owners, &attempt.dir, openings)
    }

    fn done<T: Serialize>(&self, attempt: Attempt, made: Left<T>) -> Result<()> {
        self.directory.finish(attempt, made).map(|_| ())
    }
}
