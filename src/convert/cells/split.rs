//! Cells that components are split into at their necks.

use crate::checkpoint::{Checkpointer, LABELS, Marks, Scratch};
use crate::convert::cells::CellsInput;
use crate::convert::cells::kept_bits::KeptBits;
use crate::convert::cells::opening::Opening;
use crate::convert::conversion::Conversion;
use crate::convert::memory::SPLITTING;
use crate::error::Result;
use crate::grid::Dims;
use crate::labels::{CellPiece, CellRows, CellRowsWriter, bytes_of_rows};
use crate::split::{Metric, Neck, NeckRule, PartPiece, SlabGrid, SplitOptions, SplitRows, split};
use crate::sys::memory_pool::MemoryReservation;
use crate::sys::spill_file::SpillFile;

/// Bytes that splitting keeps beside its blocks: pages of numbers of basins, and the graph of the last slices of a foam.
const BESIDE_BLOCKS: u64 = 16 << 20;
/// Bytes for each column of voxels: its states below and above, that of a part which passes it on, and its bits.
const BYTES_PER_COLUMN: f64 = 3.125;
/// Bytes that each thread takes besides: what lies around its block, and what comes of blocks.
const FOR_A_THREAD: u64 = 4 << 20;
/// Bytes of blocks that make it no faster to have more.
const ENOUGH: u64 = 256 << 20;

/// What splitting gives.
pub struct SplitCells {
    /// The cell of each voxel.
    pub rows: CellRows,
    /// Where cells touch.
    pub openings: SpillFile,
    /// Cells for each ratio in thousandths.
    pub curve: Vec<[u64; 2]>,
}

/// Bytes that splitting a volume of this size is expected to take, if it may have as many.
pub fn splitting_bytes(dims: Dims, threads: usize) -> u64 {
    let blocks = SlabGrid::most_bytes(dims, threads) + threads as u64 * FOR_A_THREAD;
    beside_blocks(dims).min(2 * dims.voxels()) + ENOUGH.min(blocks)
}

/// The metric of a conversion.
pub fn metric(spacing: [f64; 3]) -> Metric {
    Metric::of_spacing(spacing, Metric::REACH)
}

/// Splits all components of voxels below, unless that is done: then it is in files of the sweep that labels, of which
/// `marks` tells.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`], and [`crate::Error::Usage`] if the rule is out of range.
pub fn split_cells(
    input: &CellsInput,
    rule: NeckRule,
    marks: &Marks,
    checkpointer: &mut Checkpointer,
) -> Result<SplitCells> {
    let files = checkpointer.files(LABELS);
    let dims = input.job.plan.tiling.dims;
    if let Some(kept) = reopen(&files, marks, dims)? {
        return Ok(kept);
    }
    let (made, new) = split_anew(input, rule, &files)?;
    checkpointer.end_sweep(&new);
    checkpointer.save(LABELS, input.job.layers(), &Marks::default(), |_| Ok(()))?;
    Ok(made)
}

/// Names of the files.
const PIECES: &str = "cell-pieces";
const ROWS: &str = "cell-rows";
const OPENINGS: &str = "openings";
const SUMMARY: &str = "split";

/// What was found before; `None` if it was not.
fn reopen(files: &Scratch, marks: &Marks, dims: Dims) -> Result<Option<SplitCells>> {
    let (pieces, openings) = (marks.reopen(files, PIECES)?, marks.reopen(files, OPENINGS)?);
    let summary = marks.reopen(files, SUMMARY)?;
    let (Some(pieces), Some(openings), Some(mut summary)) = (pieces, openings, summary) else {
        return Ok(None);
    };
    let all = summary.everything::<u64>();
    let numbers = all.map_or(Ok(Vec::new()), |all| summary.get(&all))?;
    let Some((&largest, curve)) = numbers.split_first() else {
        return Ok(None);
    };
    Ok(Some(SplitCells {
        rows: CellRows::reopen(dims, pieces, &files.path(ROWS), largest)?,
        openings,
        curve: curve.as_chunks().0.to_vec(),
    }))
}

/// Bytes that no block is made of.
fn beside_blocks(dims: Dims) -> u64 {
    BESIDE_BLOCKS + (dims.slice_voxels() as f64 * BYTES_PER_COLUMN) as u64
}

/// Takes what splitting a volume of this size may have, and tells how much of it is for threads and their blocks.
pub fn for_blocks(held: &mut MemoryReservation, dims: Dims) -> u64 {
    let beside = beside_blocks(dims);
    held.grow_as_far_as(beside + ENOUGH);
    held.bytes().saturating_sub(beside)
}

/// How the cells of a conversion are split, where threads and their blocks have so many bytes: by as many threads as
/// these suffice for.
pub fn split_options(job: &Conversion, rule: NeckRule, for_blocks: u64) -> SplitOptions {
    let dims = job.plan.tiling.dims;
    let of_a_thread = FOR_A_THREAD + SlabGrid::least_bytes(dims);
    let most = usize::try_from(for_blocks / of_a_thread).unwrap_or(usize::MAX);
    let threads = job.plan.threads.min(most).max(1);
    let for_blocks = for_blocks.saturating_sub(threads as u64 * FOR_A_THREAD);
    SplitOptions {
        rule,
        ambiguous: job.options.ambiguous,
        metric: metric(job.grid.header().placement.spacing),
        grid: SlabGrid::fitting(dims, for_blocks, threads),
        threads,
    }
}

/// Splits, and marks the files of what is found.
fn split_anew(input: &CellsInput, rule: NeckRule, files: &Scratch) -> Result<(SplitCells, Marks)> {
    let job = input.job;
    let dims = job.plan.tiling.dims;
    let mut held = MemoryReservation::new(input.memory, SPLITTING);
    let for_blocks = for_blocks(&mut held, dims);
    let options = split_options(job, rule, for_blocks);
    let mut bits = KeptBits::new(job.plan.tiling, job.made, input.known.kept);
    let mut made = split(&mut bits, &options, input.work, job.progress)?;
    drop(bits);
    let spacing = job.options.measured(&job.grid.header().placement)?.spacing;
    let mut marks = Marks::default();
    let mut rows = CellRowsWriter::create(dims, &files.path(PIECES), &files.path(ROWS))?;
    write_rows(made.rows(), &mut rows)?;
    let (rows, mark) = rows.finish_marked()?;
    marks.add(files, PIECES, mark);
    marks.add_length(files, ROWS, bytes_of_rows(dims));
    let mut openings = SpillFile::create(&files.path(OPENINGS))?;
    made.necks(|neck| {
        let opening = opening_of(&neck, &options.metric, dims, spacing);
        openings.push(&[opening]).map(|_| ())
    })?;
    marks.add(files, OPENINGS, openings.mark()?);
    let points = made.curve().iter();
    let curve: Vec<[u64; 2]> = points
        .map(|&(permille, cells)| [permille.into(), cells])
        .collect();
    let mut summary = SpillFile::create(&files.path(SUMMARY))?;
    summary.push(&[rows.largest()])?;
    summary.push(curve.as_flattened())?;
    marks.add(files, SUMMARY, summary.mark()?);
    let made = SplitCells {
        rows,
        openings,
        curve,
    };
    Ok((made, marks))
}

/// Writes the cells of all rows, those of the slice below among them if there is one.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn write_rows(made: &mut SplitRows, rows: &mut CellRowsWriter) -> Result<()> {
    let grid = made.grid;
    let mut pieces = Vec::new();
    let mut write = |y: u32, z: u32, parts: &[PartPiece]| {
        pieces.clear();
        let mut at = 0;
        for &PartPiece { start, last, part } in parts {
            let start = u32::from(start);
            if at < start {
                pieces.push(CellPiece::new(at, 0));
            }
            pieces.push(CellPiece::new(start, part));
            at = u32::from(last) + 1;
        }
        if at < grid.dims.0[0] {
            pieces.push(CellPiece::new(at, 0));
        }
        rows.push(y, z, &pieces)
    };
    made.below(&mut write)?;
    (0..grid.slabs()).try_for_each(|slab| made.slab(slab, &mut write))
}

/// A neck, in the unit of `spacing`.
pub fn opening_of(neck: &Neck, metric: &Metric, dims: Dims, spacing: [f64; 3]) -> Opening {
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let [nx, ny, _] = dims.0.map(u64::from);
    let voxel = [
        neck.voxel % nx,
        neck.voxel / nx % ny,
        neck.voxel / (nx * ny),
    ];
    Opening {
        cells: neck.cells,
        radius: metric.radius(neck.level) * finest,
        ratio: neck.ratio().unwrap_or(f64::NAN),
        place: voxel.map(|v| v as f64),
        area: neck.area(spacing),
    }
}
