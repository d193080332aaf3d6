//! The passes over a volume, in their order, and what they give.

use super::ascent::{self, RowPieces, Ways};
use super::basins::{BandEnds, Carried};
use super::bits::SolidBits;
use super::distance::{Block, DistanceBuffers, Level, levels};
use super::graph::{Arrival, Graph, NeckRule, TreeSaddle};
use super::necks::{BasinTouch, Neck, NeckSorter};
use super::numbers::Numbers;
use super::store::{PieceFile, Store};
use super::touches::{Touch, Window, grown_rows, touches};
use super::{BitSource, Metric, SlabGrid, SplitOptions};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sys::locks::lock;
use crate::sys::simd::threads;
use crate::sys::spill_file::SpillFile;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Ratios of the split curve, in thousandths: 0.5, 0.55, ... 0.95.
const CURVE: [u32; 10] = [500, 550, 600, 650, 700, 750, 800, 850, 900, 950];

/// Splits the cells of a volume. Temporary files without names are made in `dir`: about half a byte for each voxel.
///
/// # Errors
/// [`Error::Usage`] if an option is out of range, what the source returns, [`Error::Io`] for temporary files, and
/// [`Error::Interrupted`].
pub fn split(
    source: &mut dyn BitSource,
    options: &SplitOptions,
    dir: &Path,
    progress: &dyn Progress,
) -> Result<Split> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads(options.threads))
        .build()
        .map_err(|e| Error::io(dir, "start threads", std::io::Error::other(e)))?;
    let nz = u64::from(options.grid.dims.0[2]);
    progress.begin("reading", nz);
    let reach = options.metric.reach();
    let bits = SolidBits::gather(source, options.grid, reach, dir, progress)?;
    let passes = Passes {
        bits: &bits,
        options,
        ways: Ways::new(&options.metric, options.ambiguous),
        dir,
        progress,
    };
    match options.metric.cap() <= u32::from(u16::MAX) {
        true => pool.install(|| passes.all::<u16>()),
        false => pool.install(|| passes.all::<u32>()),
    }
}

/// The memory that a thread works on a block in.
#[derive(Default)]
struct Buffers<T> {
    distance: DistanceBuffers<T>,
    ways: Vec<u32>,
}

/// That of threads that have done a block, to be used for the next one.
struct Spare<T>(Mutex<Vec<Buffers<T>>>);

impl<T> Default for Spare<T> {
    fn default() -> Self {
        Spare(Mutex::default())
    }
}

impl<T: Level> Spare<T> {
    fn take(&self) -> Buffers<T> {
        lock(&self.0).pop().unwrap_or_default()
    }

    fn put(&self, buffers: Buffers<T>) {
        lock(&self.0).push(buffers);
    }
}

/// What all passes need.
struct Passes<'a> {
    bits: &'a SolidBits,
    options: &'a SplitOptions,
    ways: Ways,
    dir: &'a Path,
    progress: &'a dyn Progress,
}

impl Passes<'_> {
    fn all<T: Level>(&self) -> Result<Split> {
        let (store, basins) = self.find_basins::<T>()?;
        self.find_parts::<T>(store, basins)
    }

    /// Works on blocks, some at once, and takes what comes of them in their order, beside the work on those that follow.
    fn in_order<R: Send>(
        &self,
        make: impl Fn(&Block) -> Result<R> + Sync,
        mut take: impl FnMut(Block, R) -> Result<()> + Send,
    ) -> Result<()> {
        let mut take_all = |made: Vec<(Block, R)>| {
            made.into_iter().try_for_each(|(block, made)| {
                self.progress.advance(1);
                take(block, made)
            })
        };
        let mut blocks = self.options.grid.blocks();
        let mut made = Vec::new();
        loop {
            if self.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let some: Vec<Block> = blocks.by_ref().take(rayon::current_num_threads()).collect();
            if some.is_empty() {
                return take_all(made);
            }
            let make_all = || {
                let some = some.into_par_iter().with_max_len(1);
                some.map(|block| make(&block).map(|made| (block, made)))
                    .collect()
            };
            let (next, taken): (Result<Vec<_>>, _) = rayon::join(make_all, || take_all(made));
            taken?;
            made = next?;
        }
    }

    fn blocks(&self) -> u64 {
        let grid = self.options.grid;
        u64::from(grid.slabs()) * u64::from(grid.bands())
    }

    /// Finds the basins: their voxels by rows, and how many there are.
    fn find_basins<T: Level>(&self) -> Result<(Store, u64)> {
        let grid = self.options.grid;
        self.progress.begin("basins", self.blocks());
        let mut numbers = Numbers::new(self.dir)?;
        let mut store = Store::new(grid, self.dir)?;
        let mut carried = Carried::new(grid);
        let mut bands = Vec::new();
        let mut raw = PieceFile::new(self.dir)?;
        let spare = Spare::<T>::default();
        self.in_order(
            |block| {
                let mut buffers = spare.take();
                let Buffers { distance, ways } = &mut buffers;
                let levels = levels(self.bits, &self.options.metric, block, distance)?;
                let ends = ascent::ends(&levels, &self.ways, grid.dims, block, ways);
                distance.take_back(levels);
                spare.put(buffers);
                Ok(BandEnds::of(ends, block))
            },
            |block, (band, pieces)| {
                raw.push(&pieces)?;
                bands.push(band);
                if bands.len() as u32 == grid.bands() {
                    let bands = std::mem::take(&mut bands);
                    let classes = carried.join(block.slab, bands, &mut numbers)?;
                    let raw = std::mem::replace(&mut raw, PieceFile::new(self.dir)?);
                    store.push(raw, classes, &mut numbers)?;
                }
                Ok(())
            },
        )?;
        let basins = store.finish(&mut numbers)?;
        Ok((store, basins))
    }

    /// Finds where basins touch, and joins them to parts.
    fn find_parts<T: Level>(&self, store: Store, basins: u64) -> Result<Split> {
        let (grid, options) = (self.options.grid, self.options);
        self.progress.begin("necks", self.blocks());
        let mut graph = Graph::default();
        let mut tree = Tree::new(self, basins)?;
        let mut met = SpillFile::new(self.dir)?;
        let spare = Spare::<T>::default();
        self.in_order(
            |block| {
                let mut buffers = spare.take();
                let levels = levels(self.bits, &options.metric, block, &mut buffers.distance)?;
                let (window, numbers) = self.window(&store, block)?;
                let found = touches(&window, &levels, options.ambiguous);
                buffers.distance.take_back(levels);
                spare.put(buffers);
                let named = |touch: Touch<u32>| Touch {
                    basins: touch.basins.map(|basin| numbers[basin as usize]),
                    saddle: touch.saddle,
                    faces: touch.faces,
                };
                Ok(found.into_iter().map(named).collect::<Vec<_>>())
            },
            |block, found| {
                if block.y.start == 0 {
                    let there_is_more = block.z.end < grid.dims.0[2];
                    let basins = store.basins(block.slab)?;
                    graph.begin_slab(basins.into_iter().map(|basin| Arrival {
                        basin: basin.number,
                        peak: basin.peak(),
                        live: basin.is_live() && there_is_more,
                    }));
                }
                for touch in found {
                    graph.touch(touch.basins, touch.saddle);
                    met.push(&[BasinTouch::of(&touch)])?;
                }
                match block.y.end == grid.dims.0[1] {
                    true => graph.end_slab(|saddle| tree.add(saddle)),
                    false => Ok(()),
                }
            },
        )?;
        tree.finish(store, met, graph.most_trees() as u64)
    }

    /// The basins of a block and around it, and their numbers.
    fn window<'b>(&self, store: &Store, block: &'b Block) -> Result<(Window<'b>, Vec<u64>)> {
        let grid = self.options.grid;
        let below = block.slab.checked_sub(1);
        let of_slab = |slab| -> Result<Vec<u64>> {
            let basins = store.basins(slab)?;
            Ok(basins.iter().map(|basin| basin.number).collect())
        };
        let tables = [below.map_or(Ok(Vec::new()), of_slab)?, of_slab(block.slab)?];
        let mut numbers = tables.concat();
        numbers.sort_unstable();
        numbers.dedup();
        let place = |number: &u64| numbers.binary_search(number).expect("one of all") as u32;
        let names = tables.map(|table| table.iter().map(place).collect::<Vec<u32>>());
        let mut window = Window {
            pieces: RowPieces::new(),
            block,
            grid,
        };
        let own = store.block(block.slab, block.y.start / grid.band)?;
        for z in window.slices() {
            let names = &names[usize::from(z >= block.z.start)];
            for y in grown_rows(block, &grid) {
                if z >= block.z.start && block.y.contains(&y) {
                    let row = (z - block.z.start) as usize * block.y.len();
                    let row = own.row(row + (y - block.y.start) as usize);
                    window.pieces.push_row(row, |end| names[end as usize]);
                } else {
                    let row = store.row(y, z)?;
                    window
                        .pieces
                        .push_row(row.row(0), |end| names[end as usize]);
                }
            }
        }
        Ok((window, numbers))
    }
}

/// The tree of saddles while it grows.
struct Tree {
    rule: NeckRule,
    metric: Metric,
    grid: SlabGrid,
    dir: PathBuf,
    /// All saddles of the tree.
    saddles: SpillFile,
    /// Basins that are one cell.
    parts: Numbers,
    /// Basins that are one component.
    components: Numbers,
    /// Cuts at each ratio of the curve.
    cuts: [u64; CURVE.len()],
}

impl Tree {
    fn new(passes: &Passes, basins: u64) -> Result<Self> {
        Ok(Tree {
            rule: passes.options.rule,
            metric: passes.options.metric,
            grid: passes.options.grid,
            dir: passes.dir.to_path_buf(),
            saddles: SpillFile::new(passes.dir)?,
            parts: Numbers::sets(passes.dir, basins)?,
            components: Numbers::sets(passes.dir, basins)?,
            cuts: [0; CURVE.len()],
        })
    }

    fn add(&mut self, saddle: TreeSaddle) -> Result<()> {
        let joins = |rule: NeckRule| rule.joins(&self.metric, saddle.level, saddle.peak);
        for (cuts, ratio_permille) in self.cuts.iter_mut().zip(CURVE) {
            *cuts += u64::from(!joins(NeckRule {
                ratio_permille,
                ..self.rule
            }));
        }
        let [a, b] = saddle.basins;
        if joins(self.rule) {
            self.parts.union(a, b)?;
        }
        self.components.union(a, b)?;
        self.saddles.push(&[saddle]).map(|_| ())
    }

    /// Numbers parts and components by their first voxels.
    fn finish(mut self, store: Store, met: SpillFile, most_trees: u64) -> Result<Split> {
        let basins = self.parts.len();
        let (parts, components) = (self.parts.number_sets()?, self.components.number_sets()?);
        let mut component_of = Numbers::new(&self.dir)?;
        for basin in 0..basins {
            // a part's number is that of its first basin among the first ones
            if self.parts.get(basin)? == component_of.len() {
                component_of.push(self.components.get(basin)?)?;
            }
        }
        Ok(Split {
            grid: self.grid,
            dir: self.dir,
            store,
            saddles: self.saddles,
            met,
            part_of: self.parts,
            component_of,
            counts: SplitCounts {
                parts,
                components,
                basins,
                most_trees,
            },
            curve: std::array::from_fn(|i| (CURVE[i], components + self.cuts[i])),
        })
    }
}

/// Numbers of what was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SplitCounts {
    /// Cells after the split.
    pub parts: u64,
    /// Connected components of air: cells without the split.
    pub components: u64,
    /// Maxima of the distance.
    pub basins: u64,
    /// The most trees of basins that were in memory at once, between slabs.
    pub most_trees: u64,
}

/// Voxels of a row one after the other that are of one cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartPiece {
    /// The first one.
    pub start: u16,
    /// The last one.
    pub last: u16,
    /// The cell: from 1, by the smallest linear index of a voxel.
    pub part: u64,
}

/// The cells of a volume after the split.
#[derive(Debug)]
pub struct Split {
    grid: SlabGrid,
    dir: PathBuf,
    store: Store,
    saddles: SpillFile,
    /// Basins that touch, block by block.
    met: SpillFile,
    part_of: Numbers,
    component_of: Numbers,
    counts: SplitCounts,
    curve: [(u32, u64); CURVE.len()],
}

impl Split {
    /// How many cells, components and basins there are.
    pub fn counts(&self) -> SplitCounts {
        self.counts
    }

    /// The number of cells for ratios of 0.5 to 0.95, in thousandths, with the other limits of the rule.
    pub fn curve(&self) -> &[(u32, u64)] {
        &self.curve
    }

    /// Bytes of the temporary files that hold rows and basins.
    pub fn stored_bytes(&self) -> u64 {
        self.store.bytes()
    }

    /// The component that a cell is a part of; both from 1.
    ///
    /// # Errors
    /// [`Error::Io`], here and below.
    pub fn component(&mut self, part: u64) -> Result<u64> {
        Ok(self.component_of.get(part - 1)? + 1)
    }

    /// Hands on the cells of a slab, row by row: row, slice and pieces by rising x. Rows of a band come slice by slice,
    /// bands by rising y.
    pub fn slab(
        &mut self,
        slab: u32,
        mut each: impl FnMut(u32, u32, &[PartPiece]) -> Result<()>,
    ) -> Result<()> {
        let mut parts = Vec::new();
        for basin in self.store.basins(slab)? {
            parts.push(self.part_of.get(basin.number)? + 1);
        }
        let mut out: Vec<PartPiece> = Vec::new();
        for band in 0..self.grid.bands() {
            let rows = self.store.block(slab, band)?;
            let places = self
                .grid
                .slab(slab)
                .flat_map(|z| self.grid.rows(band).map(move |y| (y, z)));
            for (row, (y, z)) in places.enumerate() {
                out.clear();
                for piece in rows.row(row) {
                    let part = parts[piece.end as usize];
                    match out.last_mut() {
                        Some(last)
                            if last.part == part
                                && last.last.checked_add(1) == Some(piece.start) =>
                        {
                            last.last = piece.last;
                        }
                        _ => out.push(PartPiece {
                            start: piece.start,
                            last: piece.last,
                            part,
                        }),
                    }
                }
                each(y, z, &out)?;
            }
        }
        Ok(())
    }

    /// Hands on the necks, by rising cells.
    ///
    /// # Errors
    /// [`Error::Io`], and what `each` returns.
    pub fn necks(&mut self, each: impl FnMut(Neck) -> Result<()>) -> Result<()> {
        let mut sorter = NeckSorter::new(&self.dir)?;
        let saddles = self.saddles.everything().expect("saddles alone");
        self.saddles.for_each(&saddles, |saddle: TreeSaddle| {
            sorter.saddle(&saddle, &mut self.part_of)
        })?;
        let met = self.met.everything().expect("touches alone");
        self.met.for_each(&met, |touch: BasinTouch| {
            sorter.touch(&touch, &mut self.part_of)
        })?;
        sorter.finish(each)
    }
}
