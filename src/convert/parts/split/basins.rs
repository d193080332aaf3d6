//! The round that finds the basins of a part, and what joins those of all parts.

use crate::convert::cells::{KeptBits, for_blocks, metric};
use crate::convert::conversion::Conversion;
use crate::convert::label::Labelled;
use crate::convert::memory::{SLABS, SPLITTING};
use crate::convert::parts::directory::{Attempt, Directory, Done, FileSum, Made};
use crate::convert::parts::ids::{open_labels, unfit};
use crate::convert::parts::records::sum_of;
use crate::convert::parts::rounds::Round;
use crate::convert::parts::split::columns::{beside, options_of};
use crate::convert::parts::work::{LabelsOfPart, PartWork};
use crate::error::{Error, Result};
use crate::split::{
    BASIN_FILES, BasinMerger, BasinNames, BasinSeam, Beside, KnownBasins, NeckRule, OpenBasin,
    SliceBelow, SplitOptions, find_basins, first_names, slice_below,
};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::state_codec::{Decoder, Encoder};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The file that tells which basins of a part reach its first and its last slice.
const SEAM: &str = "basin-seam";

/// What finding the basins of a part has found.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct BasinsOfPart {
    /// How many there are.
    count: u64,
    /// How the part was cut: slices of a slab, rows of a band.
    cut: [u32; 2],
}

/// What came of joining basins.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MergedBasins {
    /// How many each part has found.
    pub counts: Vec<u64>,
    /// How many there are, those that lie in several parts once.
    pub basins: u64,
}

fn file_of(part: u32) -> String {
    format!("part-{part:04}.basins")
}

/// What both rounds that go over the voxels of a part work on.
pub struct PartOfSplit {
    /// What labelling has found.
    pub labelled: Labelled,
    /// How cells are split.
    pub options: SplitOptions,
    /// What is known of columns.
    pub beside: Beside,
    /// Memory for blocks.
    _held: MemoryReservation,
}

impl PartWork<'_> {
    /// What is known of the part when it is labelled.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a file is damaged.
    pub(super) fn part_of_split(&self, rule: NeckRule) -> Result<PartOfSplit> {
        let (job, directory, part) = (self.job, self.directory, self.part);
        let round = self.rounds.number(Round::Label);
        let done: Done<LabelsOfPart> = directory.done_by(round, part)?;
        done.check_marks()?;
        let mut held = MemoryReservation::new(&job.plan.pool(), SPLITTING);
        let for_blocks = for_blocks(&mut held, job.plan.tiling.dims);
        let options = options_of(job, rule, for_blocks);
        Ok(PartOfSplit {
            labelled: open_labels(directory, &done, part)?,
            beside: beside(job, directory, round, part, options.metric.reach())?,
            options,
            _held: held,
        })
    }

    /// Finds the basins of the part.
    ///
    /// # Errors
    /// Those of a conversion; [`Error::Format`] if what was left by rounds before is damaged.
    pub fn basins(&self, attempt: Attempt, rule: NeckRule) -> Result<()> {
        let job = self.job;
        let split = self.part_of_split(rule)?;
        let work = &attempt.dir;
        let checkpointer = self.checkpointer(&attempt)?;
        let kept = &split.labelled.bands;
        let mut bits = KeptBits::new(job.plan.tiling, job.made, kept);
        let found = find_basins(&mut bits, &split.options, split.beside, work, job.progress)?;
        found.seam.write(&work.join(SEAM))?;
        let files = BASIN_FILES.into_iter().zip(found.marks);
        let mut files: Vec<FileSum> = files.map(|(name, mark)| sum_of(name, mark)).collect();
        files.push(FileSum::of(work, SEAM)?);
        let grid = split.options.grid;
        let made = Made {
            marks: Default::default(),
            files,
            result: BasinsOfPart {
                count: found.count,
                cut: [grid.height, grid.band],
            },
        };
        self.done(attempt, checkpointer, made)
    }

    /// The basins of the part as they are called in the whole volume; `options` are cut as these were.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a file is damaged.
    pub(super) fn known_basins(&self, options: &mut SplitOptions) -> Result<KnownBasins> {
        let (directory, part) = (self.directory, self.part);
        let round = self.rounds.number(Round::Basins);
        let merged: Done<MergedBasins> = directory.merged(round, part)?;
        let done: Done<BasinsOfPart> = directory.done_by(round, part)?;
        [options.grid.height, options.grid.band] = done.result.cut;
        let of_part = |part: u32| -> Result<(BasinSeam, Vec<OpenBasin>)> {
            let done: Done<BasinsOfPart> = directory.done_by(round, part)?;
            let seam = BasinSeam::read(&done.file(SEAM)?.0)?;
            let named = read_named(&merged, part, &seam)?;
            Ok((seam, named))
        };
        let below = match part.checked_sub(1) {
            Some(below) => {
                let (seam, named) = of_part(below)?;
                slice_below(seam, named)
            }
            None => SliceBelow::default(),
        };
        let (seam, named) = of_part(part)?;
        let (first, _) = first_names(&merged.result.counts);
        let (base, count) = (first[part as usize], done.result.count);
        let [pieces, tables, places] = BASIN_FILES;
        Ok(KnownBasins {
            files: [
                done.spool(pieces)?,
                done.spool(tables)?,
                done.spool(places)?,
            ],
            names: BasinNames::of(base, count, &seam, named, below),
        })
    }
}

fn read_named(merged: &Done<MergedBasins>, part: u32, seam: &BasinSeam) -> Result<Vec<OpenBasin>> {
    let (path, _) = merged.file(&file_of(part))?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
    let read = Decoder::new(bytes).and_then(|mut input| input.array::<OpenBasin>());
    read.filter(|read| read.len() == seam.open.len())
        .ok_or_else(|| Error::format(&path, "other basins", "those that the part has found"))
}

/// Joins the basins of all parts.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if what the parts have left is damaged or does not fit.
pub fn merge_basins(
    job: &Conversion,
    directory: &Directory,
    round: u32,
    dir: &Path,
    memory: &Arc<MemoryPool>,
) -> Result<Made<MergedBasins>> {
    let found = |part: u32| directory.done_by::<BasinsOfPart>(round, part);
    let mut counts = Vec::new();
    for part in 0..directory.parts() {
        counts.push(found(part)?.result.count);
    }
    let seam = |part: u32| BasinSeam::read(&found(part)?.file(SEAM)?.0);
    let mut held = MemoryReservation::new(memory, SLABS);
    let mut merger = BasinMerger::new(job.plan.tiling.dims, &counts, dir)?;
    let mut below = seam(0)?;
    for part in 1..directory.parts() {
        let above = seam(part)?;
        held.grow_to(below.bytes() + above.bytes())?;
        let joined = merger.join(part as usize - 1, &below, &above)?;
        joined.map_err(|misfit| unfit(directory, part, misfit))?;
        below = above;
    }
    drop(below);
    for part in 0..directory.parts() {
        merger.note_peaks(part as usize, &seam(part)?)?;
    }
    let mut files = Vec::new();
    for part in 0..directory.parts() {
        let named = merger.named(part as usize, &seam(part)?)?;
        let name = file_of(part);
        let mut out = Encoder::create(&dir.join(&name))?;
        out.array(&named)?;
        out.finish()?;
        files.push(FileSum::of(dir, &name)?);
    }
    Ok(Made {
        marks: Default::default(),
        files,
        result: MergedBasins {
            basins: merger.basins(&counts),
            counts,
        },
    })
}

/// How distances are counted in a conversion.
pub fn metric_of(job: &Conversion) -> crate::split::Metric {
    metric(job.grid.header().placement.spacing)
}
