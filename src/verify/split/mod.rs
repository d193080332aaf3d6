//! Cells that components are split into at their necks, held against the volume: they are split again, and what that gives
//! is compared with the tables.
//!
//! 1. The rule's weights are those of the grid's spacing, and other ratios give as many cells as the index states.
//! 2. Openings are those of the table of necks: between which cells, where, how wide and how large.
//! 3. Each cell is of the component that its row states.
//! 4. Cells touch the border where a voxel of theirs does, or the edge of the region of interest cuts them ([`border`]).
//! 5. The cells of all voxels are kept on the disk, as a volume ([`rows`]) that takes the place of labels: see
//!    [`super::labels`] for what follows from it of rows of cells and of tiles, and [`super::walls`].
//!
//! This is the one place at which the verifier runs what the conversion runs: a fault in the rule itself is not found here.
//! The tests of [`crate::split`] hold it against its definition, on whole volumes.

mod border;
mod rows;

use super::code::Code;
use super::components::{BORDER, COLUMNS};
use super::ledger::Kind;
use super::openings::{NeckRows, Opening};
use super::report::Issues;
use super::slices::Slices;
use super::spill::Merge;
use super::table_files::Lines;
use super::tile::Context;
use crate::error::Result;
use crate::manifest::PartsBy;
use crate::progress::Progress;
use crate::split::{BitSource, Metric, Neck, NeckRule, SlabGrid, Split, SplitOptions, split};
use crate::sys::id_set::IdSet;
use crate::volume::Volume;
use border::cells_at_border;
use rows::CellVolumeWriter;

pub(super) use rows::CellVolume;

/// Bytes of blocks that are worked on at once.
const BLOCKS: u64 = 64 << 20;

/// The bits of a volume.
struct Bits<'a>(Slices<'a>);

impl BitSource for Bits<'_> {
    fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
        self.0.read(z)?;
        let [nx, ny, _] = self.0.dims();
        let row_words = words.len() / ny as usize;
        words.fill(0);
        let rows = self.0.bits().chunks_exact(nx as usize);
        for (bits, words) in rows.zip(words.chunks_exact_mut(row_words)) {
            for (x, bit) in bits.iter().enumerate() {
                words[x / 64] |= u64::from(*bit) << (x % 64);
            }
        }
        Ok(())
    }
}

/// Splits the cells of a volume again, of which `filled` was left out as dust, and compares what it gives with the tables;
/// returns the cell of each voxel. `None` if cells are not those of a split, or their rule is not one of this grid.
///
/// # Errors
/// The volume's, [`crate::Error::Io`] for temporary files, [`crate::Error::Interrupted`].
pub(super) fn find(
    volume: &dyn Volume,
    filled: Option<Merge<1>>,
    cx: &Context,
    threads: usize,
    progress: &dyn Progress,
    issues: &mut Issues,
) -> Result<Option<CellVolume>> {
    let manifest = cx.manifest;
    let Some(options) = options(cx, threads) else {
        return Ok(None);
    };
    let dir = std::env::temp_dir();
    let slices = Slices::without(volume, manifest.threshold, filled)?;
    let mut made = split(&mut Bits(slices), &options, &dir, progress)?;
    compare_curve(&made, cx, issues);
    compare_components(&mut made, cx, issues)?;
    compare_necks(&mut made, &options.metric, cx, issues)?;
    let mut out = CellVolumeWriter::new(manifest.grid.dims)?;
    let slabs = options.grid.slabs();
    (0..slabs).try_for_each(|slab| made.slab(slab, |y, z, pieces| out.row(y, z, pieces)))?;
    let cells = out.finish()?;
    if !cx.edge.is_unknown() {
        let touching = cells_at_border(&cells, cx.edge, manifest.ambiguous)?;
        compare_border(&touching, made.counts().parts, cx, issues);
    }
    Ok(Some(cells))
}

/// Compares which cells touch the border with the table. What is wrong with that alone is said elsewhere.
fn compare_border(touching: &IdSet, cells: u64, cx: &Context, issues: &mut Issues) {
    let mut unsaid = Issues::new(0);
    let Some(mut lines) = Lines::open(cx, Kind::Cell, &mut unsaid) else {
        return;
    };
    while let Some(row) = lines.next_row(&mut unsaid) {
        let id = row[0].unwrap_or(0.0) as u64;
        let expected = f64::from(u8::from(touching.contains(id)));
        if (1..=cells).contains(&id) && row[BORDER] != Some(expected) {
            let stated = text(row[BORDER]);
            let message =
                format!("cell {id}: touches_border {stated}, by its voxels it is {expected}");
            issues.add(Code::TableValue, lines.place(), message);
        }
    }
}

/// How the cells of a set are split; `None` if they are not, or by weights that are not those of its grid, which is an
/// issue of the index.
fn options(cx: &Context, threads: usize) -> Option<SplitOptions> {
    let manifest = cx.manifest;
    let Some(PartsBy::Split {
        ratio_permille,
        h_256,
        min_radius_256,
        weights,
        unit,
        reach,
        ..
    }) = &manifest.cells
    else {
        return None;
    };
    let metric = Metric::of_spacing(manifest.placement.spacing, (*reach).max(1));
    let rule = NeckRule {
        ratio_permille: *ratio_permille,
        h_256: *h_256,
        min_radius_256: *min_radius_256,
    };
    let same = metric.weights() == *weights && metric.unit() == *unit && metric.reach() == *reach;
    (same && rule.check().is_ok()).then(|| SplitOptions {
        rule,
        ambiguous: manifest.ambiguous,
        metric,
        grid: SlabGrid::fitting(manifest.grid.dims, BLOCKS, threads),
        threads,
    })
}

fn compare_curve(made: &Split, cx: &Context, issues: &mut Issues) {
    let Some(PartsBy::Split { curve, .. }) = &cx.manifest.cells else {
        return;
    };
    let points = made.curve().iter();
    let found: Vec<[u64; 2]> = points
        .map(|&(permille, cells)| [permille.into(), cells])
        .collect();
    if found != *curve {
        let message = format!("found {curve:?}, the volume gives {found:?}");
        issues.add(Code::ManifestValue, "index.json#/cells/curve", message);
    }
}

/// Compares components of cells with the table of these. What is wrong with that alone is said elsewhere, here and below.
fn compare_components(made: &mut Split, cx: &Context, issues: &mut Issues) -> Result<()> {
    let mut unsaid = Issues::new(0);
    let Some(mut lines) = Lines::open(cx, Kind::Cell, &mut unsaid) else {
        return Ok(());
    };
    let parts = made.counts().parts;
    while let Some(row) = lines.next_row(&mut unsaid) {
        let id = row[0].unwrap_or(0.0) as u64;
        if !(1..=parts).contains(&id) {
            continue;
        }
        let found = made.component(id)?;
        if row[COLUMNS.len()] != Some(found as f64) {
            let stated = text(row[COLUMNS.len()]);
            let message = format!("cell {id}: component {stated}, by the volume it is {found}");
            issues.add(Code::TableValue, lines.place(), message);
        }
    }
    Ok(())
}

fn compare_necks(
    made: &mut Split,
    metric: &Metric,
    cx: &Context,
    issues: &mut Issues,
) -> Result<()> {
    let Some(mut rows) = NeckRows::open(cx, "volume") else {
        return Ok(());
    };
    made.necks(|neck| {
        rows.compare(&opening(&neck, metric, cx), issues);
        Ok(())
    })?;
    rows.finish(issues);
    Ok(())
}

/// The row of a neck.
fn opening(neck: &Neck, metric: &Metric, cx: &Context) -> Opening {
    let place = cx.manifest.measured();
    let finest = place.spacing.into_iter().fold(f64::INFINITY, f64::min);
    let [nx, ny, _] = cx.manifest.grid.dims.0.map(u64::from);
    let voxel = [
        neck.voxel % nx,
        neck.voxel / nx % ny,
        neck.voxel / (nx * ny),
    ];
    let [x, y, z] = place.world(voxel.map(|v| v as f64)).map(Some);
    let radius = Some(metric.radius(neck.level) * finest);
    let area = Some(neck.area(place.spacing));
    Opening {
        cells: neck.cells,
        numbers: [radius, neck.ratio(), x, y, z, area],
    }
}

fn text(v: Option<f64>) -> String {
    v.map_or("nothing".to_owned(), |v| v.to_string())
}
