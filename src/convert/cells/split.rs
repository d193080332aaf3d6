//! Cells that components are split into at their necks.

use crate::checkpoint::{Checkpointer, LABELS, Marks, Scratch};
use crate::convert::cells::CellsInput;
use crate::convert::cells::opening::Opening;
use crate::convert::known_band::KnownBands;
use crate::convert::label::{KeptBand, span_of};
use crate::convert::memory::SPLITTING;
use crate::error::Result;
use crate::grid::Dims;
use crate::labels::{CellPiece, CellRows, CellRowsWriter, RowKinds, Span, bytes_of_rows};
use crate::split::{BitSource, Metric, NeckRule, PartPiece, SlabGrid, Split, SplitOptions, split};
use crate::sys::memory_pool::MemoryReservation;
use crate::sys::spill_file::{Mark, SpillFile};

/// Bytes that splitting keeps beside its blocks: pages of numbers of basins, and the graph of the last slices of a foam.
const BESIDE_BLOCKS: u64 = 16 << 20;
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

/// Splits, and marks the files of what is found.
fn split_anew(input: &CellsInput, rule: NeckRule, files: &Scratch) -> Result<(SplitCells, Marks)> {
    let job = input.job;
    let dims = job.plan.tiling.dims;
    let mut held = MemoryReservation::new(input.memory, SPLITTING);
    held.grow_as_far_as(BESIDE_BLOCKS + ENOUGH);
    let for_blocks = held.bytes().saturating_sub(BESIDE_BLOCKS);
    let options = SplitOptions {
        rule,
        ambiguous: job.options.ambiguous,
        metric: metric(job.grid.header().placement.spacing),
        grid: SlabGrid::fitting(dims, for_blocks, job.plan.threads),
        threads: job.plan.threads,
    };
    let mut bits = KeptBits {
        known: input.known,
        layer: None,
    };
    let mut made = split(&mut bits, &options, input.work, job.progress)?;
    drop(bits);
    let spacing = job.options.measured(&job.grid.header().placement)?.spacing;
    let mut marks = Marks::default();
    let (rows, mark) = rows(&mut made, options.grid, files)?;
    marks.add(files, PIECES, mark);
    marks.add_length(files, ROWS, bytes_of_rows(dims));
    let mut openings_file = SpillFile::create(&files.path(OPENINGS))?;
    openings(&mut made, &options, spacing, &mut openings_file)?;
    marks.add(files, OPENINGS, openings_file.mark()?);
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
        openings: openings_file,
        curve,
    };
    Ok((made, marks))
}

/// The cells of all rows.
fn rows(made: &mut Split, grid: SlabGrid, files: &Scratch) -> Result<(CellRows, Mark)> {
    let (pieces_path, rows_path) = (files.path(PIECES), files.path(ROWS));
    let mut rows = CellRowsWriter::create(grid.dims, &pieces_path, &rows_path)?;
    let mut pieces = Vec::new();
    for slab in 0..grid.slabs() {
        made.slab(slab, |y, z, parts| {
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
        })?;
    }
    rows.finish_marked()
}

/// Where cells touch, in the unit of `spacing`.
fn openings(
    made: &mut Split,
    options: &SplitOptions,
    spacing: [f64; 3],
    openings: &mut SpillFile,
) -> Result<()> {
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let [nx, ny, _] = options.grid.dims.0.map(u64::from);
    made.necks(|neck| {
        let voxel = [
            neck.voxel % nx,
            neck.voxel / nx % ny,
            neck.voxel / (nx * ny),
        ];
        let opening = Opening {
            cells: neck.cells,
            radius: options.metric.radius(neck.level) * finest,
            ratio: neck.ratio().unwrap_or(f64::NAN),
            place: voxel.map(|v| v as f64),
            area: neck.area(spacing),
        };
        openings.push(&[opening]).map(|_| ())
    })
}

/// The bits that labelling has kept, slice by slice.
struct KeptBits<'a> {
    known: KnownBands<'a>,
    /// The layer at hand.
    layer: Option<Layer>,
}

/// What is known of the bands of a layer.
struct Layer {
    tz: u32,
    bands: Vec<(Span, KeptBand, RowKinds)>,
}

impl KeptBits<'_> {
    /// The bands of a layer.
    fn layer(&mut self, tz: u32) -> Result<&Layer> {
        if self.layer.as_ref().is_none_or(|layer| layer.tz != tz) {
            let (known, tiling) = (self.known, self.known.tiling);
            let [_, bands, _] = tiling.tiles();
            let band = |ty: u32| {
                let span = span_of(tiling, ty, tz);
                let kept = known.kept.get(known.number([ty, tz]))?;
                let kinds = known.kept.kinds(&kept, &span)?;
                Ok((span, kept, kinds))
            };
            let bands = (0..bands).map(band).collect::<Result<_>>()?;
            self.layer = Some(Layer { tz, bands });
        }
        Ok(self.layer.as_ref().expect("it was read"))
    }
}

impl BitSource for KeptBits<'_> {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
        let (stored, tiling) = (self.known.kept, self.known.tiling);
        let [.., layers] = tiling.tiles();
        let layer = self.layer((z / tiling.macrocube[2]).min(layers - 1))?;
        for (span, kept, kinds) in &layer.bands {
            let row_words = (span.nx as usize).div_ceil(64);
            let first = (z - span.z.start) as usize * span.rows();
            let rows = first..first + span.rows();
            let mixed = kinds.mixed_before(rows.start)..kinds.mixed_before(rows.end);
            let mixed = stored.mixed_rows(kept, mixed, row_words)?;
            // the row that bands share comes from both
            let at = span.y.start as usize * row_words;
            let out = &mut words[at..][..span.rows() * row_words];
            kinds.fill_rows(rows, span.nx, &mixed, out);
        }
        Ok(())
    }
}
