//! The passes over some slices, in their order: all of a volume, or those of a part of it.

use super::ascent::{self, RowPieces, Ways};
use super::basins::{BandEnds, Carried};
use super::bits::{Beside, SolidBits};
use super::cells::{Found, Split, Tree};
use super::distance::{Block, DistanceBuffers, Level, levels};
use super::graph::{Arrival, Graph};
use super::judge::Judge;
use super::names::BasinNames;
use super::necks::BasinTouch;
use super::numbers::Numbers;
use super::seam::BasinSeam;
use super::store::{PieceFile, Store};
use super::touches::{Touch, Window, grown_rows, touches};
use super::{BitSource, SplitOptions};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sys::locks::lock;
use crate::sys::simd::threads;
use crate::sys::spill_file::SpillFile;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;

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
    let beside = Beside::unknown(options.grid.dims, options.metric.reach());
    let files = Files {
        dir,
        have_names: false,
    };
    with_passes(source, options, beside, files, progress, |passes| {
        let Basins { store, count, .. } = passes.basins()?;
        passes
            .saddles(store, BasinNames::whole(count))?
            .into_split(dir)
    })
}

/// Where the passes make files.
#[derive(Debug, Clone, Copy)]
pub struct Files<'a> {
    /// The directory.
    pub dir: &'a Path,
    /// True if those that others are to read have names.
    pub have_names: bool,
}

impl Files<'_> {
    fn spool(&self, name: &str) -> Result<SpillFile> {
        match self.have_names {
            true => SpillFile::create(&self.dir.join(name)),
            false => SpillFile::new(self.dir),
        }
    }
}

/// Names of the files of saddles and of touches.
pub const SADDLES: &str = "saddles";
/// See [`SADDLES`].
pub const TOUCHES: &str = "touches";

/// Gathers bits, and calls `work` in the threads that are asked for. `beside` is known of the columns of the slices.
///
/// # Errors
/// Those of [`split`].
pub fn with_passes<R: Send>(
    source: &mut dyn BitSource,
    options: &SplitOptions,
    beside: Beside,
    files: Files,
    progress: &dyn Progress,
    work: impl FnOnce(&Passes) -> Result<R> + Send,
) -> Result<R> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads(options.threads))
        .build()
        .map_err(|e| Error::io(files.dir, "start threads", std::io::Error::other(e)))?;
    let [first, end] = options.grid.slices;
    progress.begin("reading", u64::from(end - first));
    let reach = options.metric.reach();
    let bits = SolidBits::gather(source, options.grid, reach, beside, files.dir, progress)?;
    let passes = Passes {
        bits: &bits,
        options,
        ways: Ways::new(&options.metric, options.ambiguous),
        files,
        progress,
    };
    pool.install(|| work(&passes))
}

/// The basins of some slices.
pub struct Basins {
    /// Their voxels by rows.
    pub store: Store,
    /// How many there are.
    pub count: u64,
    carried: Carried,
    numbers: Numbers,
}

impl Basins {
    /// What those of the first and the last slice tell other slices.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn seam(&mut self) -> Result<BasinSeam> {
        let mut seam = self.carried.seam(&mut self.numbers)?;
        for slab in 0..self.store.slabs() {
            for basin in self.store.basins(slab)? {
                if let Some(peak) = basin.peak() {
                    seam.note_peak(basin.number, peak);
                }
            }
        }
        Ok(seam)
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
pub struct Passes<'a> {
    bits: &'a SolidBits,
    options: &'a SplitOptions,
    ways: Ways,
    files: Files<'a>,
    progress: &'a dyn Progress,
}

impl Passes<'_> {
    /// Finds the basins.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub fn basins(&self) -> Result<Basins> {
        match self.options.metric.cap() <= u32::from(u16::MAX) {
            true => self.find_basins::<u16>(),
            false => self.find_basins::<u32>(),
        }
    }

    /// Finds where basins touch, and of the tree of saddles what is known without other slices.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub fn saddles(&self, store: Store, names: BasinNames) -> Result<Found> {
        match self.options.metric.cap() <= u32::from(u16::MAX) {
            true => self.find_saddles::<u16>(store, names),
            false => self.find_saddles::<u32>(store, names),
        }
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

    fn find_basins<T: Level>(&self) -> Result<Basins> {
        let (grid, dir) = (self.options.grid, self.files.dir);
        self.progress.begin("basins", self.blocks());
        let mut numbers = Numbers::new(dir)?;
        let mut store = match self.files.have_names {
            true => Store::create(grid, dir)?,
            false => Store::new(grid, dir)?,
        };
        let mut carried = Carried::new(grid);
        let mut bands = Vec::new();
        let mut raw = PieceFile::new(dir)?;
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
                    let raw = std::mem::replace(&mut raw, PieceFile::new(dir)?);
                    store.push(raw, classes, &mut numbers)?;
                }
                Ok(())
            },
        )?;
        let count = store.finish(&mut numbers)?;
        Ok(Basins {
            store,
            count,
            carried,
            numbers,
        })
    }

    fn find_saddles<T: Level>(&self, store: Store, names: BasinNames) -> Result<Found> {
        let (grid, options) = (self.options.grid, self.options);
        self.progress.begin("necks", self.blocks());
        let mut graph = Graph::default();
        let mut tree = Tree {
            judge: Judge::new(options.rule, options.metric),
            saddles: self.files.spool(SADDLES)?,
            sets: Numbers::sets(self.files.dir, names.distinct())?,
        };
        let mut met = self.files.spool(TOUCHES)?;
        let spare = Spare::<T>::default();
        self.in_order(
            |block| {
                let mut buffers = spare.take();
                let levels = levels(self.bits, &options.metric, block, &mut buffers.distance)?;
                let (window, numbers) = self.window(&store, &names, block)?;
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
                    begin_slab(&mut graph, &store, &names, &block)?;
                }
                for touch in found {
                    graph.touch(touch.basins, touch.saddle);
                    met.push(&[BasinTouch::of(&touch)])?;
                }
                match block.y.end == grid.dims.0[1] {
                    true => graph.end_slab(|saddle| tree.add(saddle, &names)),
                    false => Ok(()),
                }
            },
        )?;
        let go_on = names_above(&store, &names)?;
        let most_trees = graph.most_trees() as u64;
        // what is read back from now on is in the files
        tree.saddles.mark()?;
        met.mark()?;
        Ok(Found {
            rest: graph.into_rest(|name| go_on.binary_search(&name).is_ok()),
            store,
            names,
            tree,
            met,
            most_trees,
        })
    }

    /// The basins of a block and around it, and their numbers.
    fn window<'b>(
        &self,
        store: &Store,
        known: &BasinNames,
        block: &'b Block,
    ) -> Result<(Window<'b>, Vec<u64>)> {
        let grid = self.options.grid;
        let of_slab = |slab| -> Result<Vec<u64>> {
            let basins = store.basins(slab)?;
            Ok(basins
                .iter()
                .map(|basin| known.name(basin.number))
                .collect())
        };
        let below = match block.slab.checked_sub(1) {
            Some(below) => of_slab(below)?,
            None => known
                .below
                .basins
                .iter()
                .map(|basin| basin.number)
                .collect(),
        };
        let tables = [below, of_slab(block.slab)?];
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
                } else if z < grid.slices[0] {
                    let row = known.below.rows.row(y as usize);
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

/// Tells the graph that the slab of a block begins.
fn begin_slab(graph: &mut Graph, store: &Store, names: &BasinNames, block: &Block) -> Result<()> {
    let there_is_more = block.z.end < store.grid().dims.0[2];
    let basins = store.basins(block.slab)?;
    let own = basins.iter().map(|basin| Arrival {
        basin: names.name(basin.number),
        peak: basin.peak().or_else(|| names.peak(basin.number)),
        live: basin.is_live() && there_is_more,
    });
    // what lies below all slabs may have neighbours there
    let below = names.below.basins.iter().map(|basin| Arrival {
        basin: basin.number,
        peak: basin.peak(),
        live: true,
    });
    graph.begin_slab(own.chain(below));
    Ok(())
}

/// The basins that may go on above the last slab, by rising name.
fn names_above(store: &Store, names: &BasinNames) -> Result<Vec<u64>> {
    let mut above = Vec::new();
    if store.grid().goes_on()[1] {
        let last = store.basins(store.slabs() - 1)?;
        let live = last.iter().filter(|basin| basin.is_live());
        above.extend(live.map(|basin| names.name(basin.number)));
        above.sort_unstable();
    }
    Ok(above)
}
