//! Necks between cells that lie in several parts: a neck is in the table of the part where its first cell begins.

use crate::convert::cells::{Opening, opening_of};
use crate::convert::conversion::Conversion;
use crate::convert::parts::directory::{Directory, Done, FileSum};
use crate::convert::parts::records::{LeftInRound, PartFiles, shared_file, sum_of};
use crate::convert::parts::split::basins::metric_of;
use crate::convert::parts::split::cells::{CellsOfPart, MergedCells, NECKS};
use crate::error::Result;
use crate::split::{Metric, Neck};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 14;

/// What a part knows of a neck that is, or may be, known elsewhere, too.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct SharedNeck {
    neck: Neck,
    /// 1 if the part knows all of it, and has counted it with its cells.
    counted: u64,
}

impl SharedNeck {
    fn merge(&mut self, other: &SharedNeck) {
        self.neck.merge(&other.neck);
        self.counted |= other.counted;
    }
}

impl Keyed for SharedNeck {
    fn key(&self) -> [u64; 2] {
        self.neck.cells
    }
}

/// Makes openings of necks.
pub struct Openings {
    metric: Metric,
    dims: crate::grid::Dims,
    spacing: [f64; 3],
}

impl Openings {
    /// Of a conversion.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a unit of measures that the volume cannot have.
    pub fn of(job: &Conversion) -> Result<Self> {
        let placement = job.options.measured(&job.grid.header().placement)?;
        Ok(Openings {
            metric: metric_of(job),
            dims: job.plan.tiling.dims,
            spacing: placement.spacing,
        })
    }

    /// That of a neck.
    pub fn opening(&self, neck: &Neck) -> Opening {
        opening_of(neck, &self.metric, self.dims, self.spacing)
    }
}

/// Writes the necks of a part; returns those of which it knows all, and the files.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_necks(
    job: &Conversion,
    cells: &mut CellsOfPart,
    dir: &Path,
) -> Result<(SpillFile, Vec<FileSum>)> {
    let to_opening = Openings::of(job)?;
    let shared_name = shared_file(NECKS);
    let mut openings = SpillFile::new(dir)?;
    let mut own = SpillFile::create(&dir.join(NECKS))?;
    let mut elsewhere = SpillFile::create(&dir.join(&shared_name))?;
    let CellsOfPart {
        rows,
        shared,
        places,
        ..
    } = cells;
    rows.necks(dir, |neck| {
        let goes_on = neck.cells.map(|cell| shared.binary_search(&cell).is_ok());
        let counted = u64::from(goes_on != [true; 2]);
        if counted == 1 {
            openings.push(&[to_opening.opening(&neck)])?;
        }
        match counted == 1 && places.is_own(neck.cells[0]) {
            true => own.push(&[neck]).map(|_| ()),
            false => elsewhere.push(&[SharedNeck { neck, counted }]).map(|_| ()),
        }
    })?;
    openings.mark()?;
    let files = vec![
        sum_of(NECKS, own.mark()?),
        sum_of(&shared_name, elsewhere.mark()?),
    ];
    Ok((openings, files))
}

/// Joins the necks of all parts and hands each to the part that has it in its table. `count` is told of those that no part
/// has counted.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn merge_necks(
    job: &Conversion,
    directory: &Directory,
    round: u32,
    cells: &Done<MergedCells>,
    dir: &Path,
    mut count: impl FnMut(&Opening) -> Result<()>,
) -> Result<Vec<FileSum>> {
    let to_opening = Openings::of(job)?;
    let mut all = Sorter::<SharedNeck>::new(dir, ROOM)?;
    each_shared(LeftInRound { directory, round }, cells, |neck| {
        all.push(neck)
    })?;
    let mut files = PartFiles::new(dir, NECKS)?;
    all.finish_merged(SharedNeck::merge, |SharedNeck { neck, counted }| {
        if counted == 0 {
            count(&to_opening.opening(&neck))?;
        }
        files.go_on_to(cells.result.owners.part_of(neck.cells[0]) as u32)?;
        files.push(&neck)
    })?;
    files.finish(directory.parts())
}

/// Calls `each` for all necks that are, or may be, known in several places.
fn each_shared(
    left: LeftInRound,
    cells: &Done<MergedCells>,
    mut each: impl FnMut(SharedNeck) -> Result<()>,
) -> Result<()> {
    cells.spool(NECKS)?.each(|neck: Neck| {
        let counted = 0;
        each(SharedNeck { neck, counted })
    })?;
    left.each(&shared_file(NECKS), each)
}

/// Calls `each` with the cells of all necks, of some more often than once.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged; those of `each`.
pub fn each_neck(
    left: LeftInRound,
    cells: &Done<MergedCells>,
    each: &mut dyn FnMut([u64; 2]) -> Result<()>,
) -> Result<()> {
    each_shared(left, cells, |shared| each(shared.neck.cells))?;
    left.each(NECKS, |neck: Neck| each(neck.cells))
}

/// The openings in the table of a part, of its own necks and those that it was handed.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if a file is damaged.
pub fn read_openings(
    job: &Conversion,
    [own, handed]: [SpillFile; 2],
    dir: &Path,
) -> Result<SpillFile> {
    let to_opening = Openings::of(job)?;
    let mut all = Sorter::<Neck>::new(dir, ROOM)?;
    own.each(|neck| all.push(neck))?;
    handed.each(|neck| all.push(neck))?;
    let mut openings = SpillFile::new(dir)?;
    all.finish(|neck| openings.push(&[to_opening.opening(&neck)]).map(|_| ()))?;
    openings.mark()?;
    Ok(openings)
}
