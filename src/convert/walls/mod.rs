//! Walls between cells: what of the volume lies between two of them, its area and how thick it is.
//!
//! A pass over the bands finds chords. Those along x lie in a band; of those along y and z that pass from band to band
//! the ends are sorted by line and place, where each end that enters is followed by the one that leaves. So bands come in
//! any order and know nothing of each other, and memory is that of the bands at hand.

mod of_cells;

pub use of_cells::{AreaSteps, CellWalls, JudgedWall, Neighbours, WallsOfCell, add_walls};

use crate::convert::conversion::Conversion;
use crate::convert::known_band::KnownBands;
use crate::convert::memory::{FOR_WALLS, WALLS};
use crate::convert::mesh::{BandLoader, MeshBand};
use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::labels::CellRows;
use crate::surface::{
    BandEdges, ChordEnd, ChordFinder, ChordScale, Chords, FoundChords, WALL_AREA_STEPS, WALL_BINS,
};
use crate::sys::locks::{into_inner, lock};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::sorted_spill::{Keyed, Sorter};
use crate::sys::spill_file::SpillFile;
use crate::volume::{Volume, Voxel};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Chords of a band that are gathered before those of the same bin are made one.
const GATHERED: usize = 1 << 13;

/// The wall between two cells.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Wall {
    /// The cells, the smaller id first.
    pub cells: [u64; 2],
    /// Sum of what its chords stand for, see [`Wall::area`].
    pub area_steps: u64,
    /// Median of the thickness at its chords by what they stand for, in voxels of the finest axis.
    pub thickness: f64,
    /// Chords.
    pub chords: u64,
    /// The sum over those of them that are thinner than a scan resolves.
    pub thin: u64,
}

impl Wall {
    /// Its area, in the square of the unit of `spacing`.
    pub fn area(&self, [x, y, z]: [f64; 3]) -> f64 {
        let smallest = (y * z).min(x * z).min(x * y);
        self.area_steps as f64 / WALL_AREA_STEPS * smallest
    }
}

/// What the pass works on.
pub struct WallsInput<'a> {
    /// The conversion.
    pub job: &'a Conversion<'a>,
    /// Its grid, which can be read in any order.
    pub volume: &'a dyn Volume,
    /// Its bands.
    pub known: KnownBands<'a>,
    /// The cells of voxels; `None` if each component is one.
    pub rows: Option<&'a CellRows>,
    /// Its memory.
    pub memory: &'a Arc<MemoryPool>,
    /// Directory for temporary files.
    pub work: &'a Path,
}

/// Finds the walls between all cells, by rising ids.
///
/// # Errors
/// As of [`Gathered::of`].
pub fn walls(input: &WallsInput) -> Result<SpillFile> {
    let mut walls = SpillFile::new(input.work)?;
    Gathered::of(input)?.each_wall(|_| Ok(()), |bins| walls.push(&[wall_of(bins)]).map(|_| ()))?;
    walls.mark()?;
    Ok(walls)
}

/// Chords, and ends of such as pass from band to band, of all bands or from all parts of a volume.
pub struct Gathered {
    chords: Sorter<Chords>,
    ends: Sorter<ChordEnd>,
    scale: ChordScale,
    /// For those that are sorted.
    _held: MemoryReservation,
}

impl Gathered {
    /// Nothing yet; temporary files lie in `work`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::TooDense`].
    pub fn none_yet(job: &Conversion, memory: &Arc<MemoryPool>, work: &Path) -> Result<Self> {
        let mut held = MemoryReservation::new(memory, WALLS);
        let for_sorting = FOR_WALLS.of(job.plan.limit);
        held.grow_to(for_sorting)?;
        let room = for_sorting as usize / (size_of::<Chords>() + size_of::<ChordEnd>());
        Ok(Gathered {
            chords: Sorter::new(work, room)?,
            ends: Sorter::new(work, room)?,
            scale: ChordScale::new(job.grid.header().placement.spacing),
            _held: held,
        })
    }

    /// Those of the bands of the layers that are made.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::TooDense`], [`Error::Interrupted`], and those of [`Volume::read_box`].
    pub fn of(input: &WallsInput) -> Result<Self> {
        let gathered = Gathered::none_yet(input.job, input.memory, input.work)?;
        let pass = Pass {
            input,
            scale: gathered.scale,
            gathered: Mutex::new(gathered),
        };
        crate::volume::with_voxel_type!(input.volume.header().dtype, T => pass.bands::<T>())?;
        Ok(into_inner(pass.gathered))
    }

    /// Takes chords.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, chords: Chords) -> Result<()> {
        self.chords.push(chords)
    }

    /// Takes the end of a chord.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push_end(&mut self, end: ChordEnd) -> Result<()> {
        self.ends.push(end)
    }

    /// Calls `each` for every wall, by rising ids, with the bins of its chords by rising thickness, of which there is one at
    /// least; and `open` before that with ends of chords whose other ends may be in other parts of the volume.
    ///
    /// # Errors
    /// [`Error::Io`], and those of `open` and `each`.
    pub fn each_wall(
        self,
        open: impl FnMut(ChordEnd) -> Result<()>,
        mut each: impl FnMut(&[Chords]) -> Result<()>,
    ) -> Result<()> {
        let Gathered {
            mut chords,
            ends,
            scale,
            _held,
        } = self;
        join_ends(ends, &scale, |chord| chords.push(chord), open)?;
        let mut bins: Vec<Chords> = Vec::new();
        chords.finish_merged(Chords::merge, |chords| {
            if bins.last().is_some_and(|last| last.cells != chords.cells) {
                each(&bins)?;
                bins.clear();
            }
            bins.push(chords);
            Ok(())
        })?;
        match bins.is_empty() {
            true => Ok(()),
            false => each(&bins),
        }
    }
}

struct Pass<'a> {
    input: &'a WallsInput<'a>,
    scale: ChordScale,
    gathered: Mutex<Gathered>,
}

impl Pass<'_> {
    /// Goes through all bands.
    fn bands<T: Voxel + Default>(&self) -> Result<()> {
        let input = self.input;
        let (job, tiling) = (input.job, input.known.tiling);
        let ([_, bands, _], layers) = (tiling.tiles(), job.made);
        job.progress
            .begin("walls", u64::from(bands) * u64::from(layers.count()));
        let loader = BandLoader {
            volume: input.volume,
            known: input.known,
            cells: input.rows,
            cap: false,
            memory: input.memory,
        };
        let all: Vec<[u32; 2]> = layers
            .each()
            .flat_map(|tz| (0..bands).map(move |ty| [ty, tz]))
            .collect();
        // no more bands at once than for meshing
        for some in all.chunks(job.plan.bands_at_once.max(1) as usize) {
            if job.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            some.par_iter().with_max_len(1).try_for_each(|&place| {
                let mut band = loader.band::<T>();
                // a band without a surface has no tile to make
                if !loader.load(place, &mut band)?.is_empty() {
                    self.band(&band, tiling)?;
                }
                job.progress.advance(1);
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Finds the chords of a band.
    fn band<T: Voxel>(&self, band: &MeshBand<T>, tiling: Tiling) -> Result<()> {
        let bits = &band.known.bits;
        let span = &bits.span;
        let known = &band.known;
        let cell = |[x, y, z]: [u32; 3]| {
            let row = (z - span.z.start) as usize * span.rows() + (y - span.y.start) as usize;
            if self.input.rows.is_some() {
                return band.cells.at(row, x);
            }
            let run = known.runs.at(bits, row * bits.row_words, x as usize);
            known.components[known.class_of_run[run as usize] as usize].id
        };
        let edges = BandEdges {
            voxels: &band.voxels,
            dims: tiling.dims,
            threshold: self.input.job.options.threshold,
            scale: &self.scale,
            cell,
        };
        let mut held = MemoryReservation::new(self.input.memory, WALLS);
        held.grow_to(ChordFinder::bytes(bits))?;
        let mut finder = ChordFinder::new(bits, tiling.dims, &self.scale, &edges);
        let mut found = FoundChords::default();
        for s in 0..span.slices() {
            finder.slice(s, &mut found);
            held.grow_to(ChordFinder::bytes(bits) + found.bytes())?;
            if found.chords.len() > GATHERED {
                make_one(&mut found.chords);
            }
            if found.chords.len() > GATHERED / 2 || found.ends.len() > GATHERED {
                self.gather(&mut found)?;
            }
        }
        make_one(&mut found.chords);
        self.gather(&mut found)
    }

    fn gather(&self, found: &mut FoundChords) -> Result<()> {
        let mut all = lock(&self.gathered);
        for chords in found.chords.drain(..) {
            all.chords.push(chords)?;
        }
        for end in found.ends.drain(..) {
            all.ends.push(end)?;
        }
        Ok(())
    }
}

/// Makes chords of the same bin of a wall one.
fn make_one(chords: &mut Vec<Chords>) {
    chords.sort_unstable_by_key(Chords::key);
    chords.dedup_by(|next, kept| {
        let same = next.key() == kept.key();
        if same {
            kept.merge(next);
        }
        same
    });
}

/// Joins the ends of chords that pass from band to band: on each line one that enters is followed by the one that leaves,
/// unless they are too far apart to count. Along z the first end of a line may be one that leaves, and the last one that
/// enters: these go on in other parts of the volume. Where an end between them does not count, they are too far apart, too.
fn join_ends(
    ends: Sorter<ChordEnd>,
    scale: &ChordScale,
    mut each: impl FnMut(Chords) -> Result<()>,
    mut open: impl FnMut(ChordEnd) -> Result<()>,
) -> Result<()> {
    let mut open = |end: ChordEnd| match end.is_along_z() {
        true => open(end),
        false => Ok(()),
    };
    let mut before: Option<ChordEnd> = None;
    ends.finish(|end| {
        match before.replace(end) {
            Some(enters) if enters.line == end.line => {
                let is_chord = enters.leaves == 0 && end.leaves == 1;
                let chord = is_chord.then(|| scale.chord(&enters, &end)).flatten();
                return chord.map_or(Ok(()), &mut each);
            }
            Some(last) if last.leaves == 0 => open(last)?,
            _ => {}
        }
        match end.leaves {
            1 => open(end),
            _ => Ok(()),
        }
    })?;
    match before {
        Some(last) if last.leaves == 0 => open(last),
        _ => Ok(()),
    }
}

/// The wall with these bins of chords, by rising thickness, of which there is one at least.
pub fn wall_of(bins: &[Chords]) -> Wall {
    let sum = |of: fn(&Chords) -> u64| bins.iter().map(of).sum::<u64>();
    let area_steps = sum(|bin| bin.area);
    let half = area_steps as f64 / 2.0;
    let mut before = 0.0;
    let mut median = 0.0;
    for bin in bins {
        let here = bin.area as f64;
        if before + here >= half {
            // what is in a bin is taken to lie evenly in it
            median = f64::from(bin.bin) + (half - before) / here;
            break;
        }
        before += here;
    }
    Wall {
        cells: bins[0].cells,
        area_steps,
        thickness: median / f64::from(WALL_BINS),
        chords: sum(|bin| bin.count.into()),
        thin: sum(|bin| bin.thin),
    }
}
