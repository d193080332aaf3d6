//! The round that finds the saddles of a part, and what joins the basins of all parts to cells.

use crate::convert::cells::KeptBits;
use crate::convert::conversion::Conversion;
use crate::convert::id_places::IdPlaces;
use crate::convert::parts::directory::{Attempt, Directory, Done, FileSum, Made};
use crate::convert::parts::records::sum_of;
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::split::basins::{MergedBasins, metric_of};
use crate::convert::parts::split::surfaces::CellOwners;
use crate::convert::parts::work::PartWork;
use crate::error::{Error, Result};
use crate::labels::{ProvisionalLabels, Ranks};
use crate::split::{
    CellMerger, JOIN_FILES, Neck, NeckRule, RestEdge, RestTree, SADDLE_FILES, SplitRows,
    TreeSaddle, find_saddles, first_names, rows_of,
};
use crate::sys::spill_file::SpillFile;
use crate::sys::state_codec::{Decoder, Encoder};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The file of what merging leaves: names of basins, of which those are set with which a cell begins.
const BEGINS: &str = "first-basins";
/// The file of the necks that no part could decide.
pub const NECKS: &str = "necks";

/// What finding the saddles of a part has found.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SaddlesOfPart {
    /// Saddles, and necks among them.
    saddles: [u64; 2],
    /// Necks at each ratio of the curve.
    cuts: Vec<u64>,
}

/// What came of joining cells.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MergedCells {
    /// How many bits there are of names.
    bits: u64,
    /// The parts in which they begin: ids have no gaps.
    pub owners: CellOwners,
    /// Cells at each ratio of the curve, in thousandths.
    pub curve: Vec<[u64; 2]>,
}

/// The cells of a part.
pub struct CellsOfPart {
    /// By rows.
    pub rows: SplitRows,
    /// Those that may lie in other parts, too, by rising id.
    pub shared: Vec<u64>,
    /// Where their records are to lie.
    pub places: IdPlaces,
    /// Cells at each ratio of the curve, in thousandths.
    pub curve: Vec<[u64; 2]>,
}

fn file_of(part: u32) -> String {
    format!("part-{part:04}.cells-of-basins")
}

impl PartWork<'_> {
    /// Finds the saddles of the part.
    ///
    /// # Errors
    /// Those of a conversion; [`Error::Format`] if what was left by rounds before is damaged.
    pub fn saddles(&self, attempt: Attempt, rule: NeckRule) -> Result<()> {
        let job = self.job;
        let mut split = self.part_of_split(rule)?;
        let basins = self.known_basins(&mut split.options)?;
        let work = &attempt.dir;
        let checkpointer = self.checkpointer(&attempt)?;
        let kept = &split.labelled.bands;
        let mut bits = KeptBits::new(job.plan.tiling, job.made, kept);
        let (options, beside) = (&split.options, split.beside);
        let found = find_saddles(&mut bits, options, beside, basins, work, job.progress)?;
        let kept = SADDLE_FILES.into_iter().zip(found.kept);
        let files = kept.chain(JOIN_FILES.into_iter().zip(found.joins));
        let (saddles, cuts) = found.counts;
        let made = Made {
            marks: Default::default(),
            files: files.map(|(name, mark)| sum_of(name, mark)).collect(),
            result: SaddlesOfPart {
                saddles,
                cuts: cuts.to_vec(),
            },
        };
        self.done(attempt, checkpointer, made)
    }

    /// The cells of the part, which are known now; temporary files lie in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a file is damaged.
    pub fn cells(&self, rule: NeckRule, dir: &Path) -> Result<CellsOfPart> {
        let (directory, part) = (self.directory, self.part);
        let round = self.rounds.number(Round::Saddles);
        let done: Done<SaddlesOfPart> = directory.done_by(round, part)?;
        let merged: Done<MergedCells> = directory.merged(round, part)?;
        let mut options = super::columns::options_of(self.job, rule, 0);
        let basins = self.known_basins(&mut options)?;
        let told = read_told(&done, &merged, part)?;
        let places = places_of(&merged.result, part, &told);
        let window = self.windows()?[part as usize];
        let mut ranks = ranks_of(&merged, window, places.before)?;
        let [saddles, met, cells] = SADDLE_FILES;
        let files = [done.spool(saddles)?, done.spool(met)?, done.spool(cells)?];
        let begun = |name: u64| ranks.id(name - 64 * window[0]);
        let rows = rows_of(&options, basins, files, &told, begun, dir)?;
        Ok(CellsOfPart {
            rows,
            shared: shared(&told),
            places,
            curve: merged.result.curve,
        })
    }

    /// Where the records of cells are to lie, and the cells that may lie in other parts, too.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a file is damaged.
    pub fn cell_places(&self) -> Result<(IdPlaces, Vec<[u64; 2]>)> {
        let round = self.rounds.number(Round::Saddles);
        let done: Done<SaddlesOfPart> = self.directory.done_by(round, self.part)?;
        let merged: Done<MergedCells> = self.directory.merged(round, self.part)?;
        let told = read_told(&done, &merged, self.part)?;
        Ok((
            places_of(&merged.result, self.part, &told),
            merged.result.curve,
        ))
    }

    /// The first word of bits of each part, and the one behind the last.
    fn windows(&self) -> Result<Vec<[u64; 2]>> {
        let round = self.rounds.number(Round::Basins);
        let merged: Done<MergedBasins> = self.directory.merged(round, self.part)?;
        Ok(windows(&merged.result.counts))
    }
}

fn windows(counts: &[u64]) -> Vec<[u64; 2]> {
    let (first, _) = first_names(counts);
    let words = first.iter().zip(counts);
    words
        .map(|(first, count)| [first / 64, first / 64 + count.div_ceil(64)])
        .collect()
}

/// Gives cells that begin in a part their ids.
fn ranks_of(merged: &Done<MergedCells>, [start, end]: [u64; 2], before: u64) -> Result<Ranks> {
    let (path, _) = merged.file(BEGINS)?;
    let labels = ProvisionalLabels::spilled(&path, merged.result.bits)?;
    labels.renumber_some(start as usize..end as usize, before)
}

/// The cells that a part is told, by basins.
fn read_told(
    done: &Done<SaddlesOfPart>,
    merged: &Done<MergedCells>,
    part: u32,
) -> Result<Vec<(u64, u64)>> {
    let mut told = Vec::new();
    let [_, _, asked, ..] = JOIN_FILES;
    done.spool(asked)?.each(|basin: u64| {
        told.push((basin, 0));
        Ok(())
    })?;
    let (path, _) = merged.file(&file_of(part))?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
    let cells = Decoder::new(bytes).and_then(|mut input| input.array::<u64>());
    let cells = cells.filter(|cells| cells.len() == told.len());
    let cells = cells
        .ok_or_else(|| Error::format(&path, "other cells", "those of the basins of the part"))?;
    told.iter_mut()
        .zip(cells)
        .for_each(|(told, cell)| told.1 = cell);
    Ok(told)
}

fn shared(told: &[(u64, u64)]) -> Vec<u64> {
    let mut cells: Vec<u64> = told.iter().map(|told| told.1).collect();
    cells.sort_unstable();
    cells.dedup();
    cells
}

fn places_of(merged: &MergedCells, part: u32, told: &[(u64, u64)]) -> IdPlaces {
    let [before, end] = [0, 1].map(|more| merged.owners.before[part as usize + more]);
    let mut places = IdPlaces {
        before,
        own: end - before,
        others: Vec::new(),
    };
    let mut others = shared(told);
    others.retain(|&cell| !places.is_own(cell));
    places.others = others;
    places
}

/// Joins the basins of all parts to cells, and gives these their ids.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if what the parts have left is damaged or does not fit.
pub fn merge_cells(
    job: &Conversion,
    directory: &Directory,
    rounds: Rounds,
    dir: &Path,
) -> Result<Made<MergedCells>> {
    let rule = job.options.split.expect("a round of cells that are split");
    let round = rounds.number(Round::Saddles);
    let basins: Done<MergedBasins> = directory.merged(rounds.number(Round::Basins), 0)?;
    let MergedBasins { counts, basins } = basins.result;
    let (_, names) = first_names(&counts);
    let mut merger = CellMerger::new(rule, metric_of(job), names, dir)?;
    let mut begins = ProvisionalLabels::new(&dir.join(BEGINS))?;
    let mut saddles = SpillFile::new(dir)?;
    for part in 0..directory.parts() {
        let done: Done<SaddlesOfPart> = directory.done_by(round, part)?;
        add_part(&done, &mut merger, &mut begins, &mut saddles)?;
    }
    saddles.mark()?;
    let bits = begins.spill()?;
    let mut before = vec![0];
    for [start, end] in windows(&counts) {
        let so_far = *before.last().expect("not empty");
        let ranks = begins.renumber_some(start as usize..end as usize, so_far)?;
        before.push(ranks.alive());
    }
    let (curve, cells) = merger.cells(basins);
    let found = *before.last().expect("not empty");
    if found != cells {
        // every saddle that is a neck makes one cell more of a component
        let found = format!("{found} cells");
        let expected = format!("{cells}, as basins, saddles and necks tell");
        return Err(Error::format(&directory.out, found, expected));
    }
    let mut ranks = begins.renumber()?;
    let mut cell = |basin: u64| ranks.id(merger.first_of(basin)?);
    let mut files = vec![FileSum::of(dir, BEGINS)?, necks(&saddles, &mut cell, dir)?];
    for part in 0..directory.parts() {
        let done: Done<SaddlesOfPart> = directory.done_by(round, part)?;
        files.push(tell(&done, &mut cell, dir, &file_of(part))?);
    }
    Ok(Made {
        marks: Default::default(),
        files,
        result: MergedCells {
            bits,
            owners: CellOwners {
                before,
                begin_there: true,
            },
            curve: curve
                .iter()
                .map(|&(permille, cells)| [permille.into(), cells])
                .collect(),
        },
    })
}

/// Joins what a part has left to what those before it have.
fn add_part(
    done: &Done<SaddlesOfPart>,
    merger: &mut CellMerger,
    begins: &mut ProvisionalLabels,
    saddles: &mut SpillFile,
) -> Result<()> {
    let [bits, links, _, trees, edges] = JOIN_FILES;
    begins.append(&[])?;
    done.spool(bits)?
        .each(|word: u64| begins.append(&[word]).map(|_| ()))?;
    let [all, necks] = done.result.saddles;
    merger.judge.add(all, necks, &done.result.cuts);
    let mut retire = |basin| begins.retire(basin);
    done.spool(links)?
        .each(|link: [u64; 2]| merger.join(link, &mut retire))?;
    let (mut left, mut meets): (Vec<RestTree>, Vec<RestEdge>) = (Vec::new(), Vec::new());
    done.spool(trees)?.each(|tree| {
        left.push(tree);
        Ok(())
    })?;
    done.spool(edges)?.each(|edge| {
        meets.push(edge);
        Ok(())
    })?;
    let mut each = |saddle: TreeSaddle| saddles.push(&[saddle]).map(|_| ());
    merger.add(&left, meets.into_iter(), &mut retire, &mut each)
}

/// Writes the cells of the basins of which a part is to know them.
fn tell(
    done: &Done<SaddlesOfPart>,
    cell: &mut dyn FnMut(u64) -> Result<u64>,
    dir: &Path,
    name: &str,
) -> Result<FileSum> {
    let [_, _, asked, ..] = JOIN_FILES;
    let mut told = Vec::new();
    done.spool(asked)?.each(|basin: u64| {
        told.push(cell(basin)?);
        Ok(())
    })?;
    let mut out = Encoder::create(&dir.join(name))?;
    out.array(&told)?;
    out.finish()?;
    FileSum::of(dir, name)
}

/// Writes the necks among saddles.
fn necks(
    saddles: &SpillFile,
    cell: &mut dyn FnMut(u64) -> Result<u64>,
    dir: &Path,
) -> Result<FileSum> {
    let mut necks = SpillFile::create(&dir.join(NECKS))?;
    saddles.each(|saddle: TreeSaddle| {
        let [a, b] = [cell(saddle.basins[0])?, cell(saddle.basins[1])?];
        if a == b {
            return Ok(());
        }
        let neck = Neck {
            cells: [a.min(b), a.max(b)],
            ..saddle.neck()
        };
        necks.push(&[neck]).map(|_| ())
    })?;
    Ok(sum_of(NECKS, necks.mark()?))
}
