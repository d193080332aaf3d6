//! Leaves out components of few voxels (`--min-voxels`).
//!
//! A component that is left out is filled with the other phase, so that all laws hold on what
//! remains. Its size is known only when it has ended, so volumes with dust are labelled three times:
//! to find small objects; to find small cells among what remains; to find all that is left. Filling small cells only
//! joins objects, so nothing small is left after that. What has a voxel outside of the region of interest is never small.
//! Vertices do not move: every lattice edge out of a component is crossed, and all of them go with it.

use crate::checkpoint::{Checkpointer, Marks, Scratch};
use crate::convert::label::seam::Beyond;
use crate::convert::label::slab_memory::SlabMemory;
use crate::convert::label::state::{Keeps, LabelState, SlabLabels};
use crate::convert::label::{LabelInput, SweepEnd};
use crate::convert::layers::Layers;
use crate::error::Result;
use crate::grid::{Dims, Tiling};
use crate::labels::{Bits, RowRuns, Run, Runs, SlabComponents};
use crate::sys::locks::{lock, unshared};
use crate::sys::spill_file::{Place, SpillFile};
use crate::volume::Voxel;
use std::path::Path;
use std::sync::Mutex;

/// The sweep that finds small objects; small cells are found once these are filled, by the next one.
const SMALL_OBJECTS: usize = 0;

/// Knows which components of one phase are to be filled.
#[derive(Debug)]
pub struct Filter {
    found: Mutex<Found>,
    /// Number of components.
    pub components: u64,
    /// Number of their voxels.
    pub voxels: u64,
}

#[derive(Debug)]
struct Found {
    spool: SpillFile,
    /// See [`Search::places`].
    places: SpillFile,
    bands: u32,
    layers: Layers,
    /// Arrays that have 1 for each class that is to be filled.
    small: SpillFile,
    /// Where these lie, from the last layer back to the first.
    small_places: SpillFile,
}

/// What the reverse sweep needs of a slab.
struct Slab {
    voxels: Place<u64>,
    above: Place<u8>,
    live: Place<u32>,
    carried_in: Place<u32>,
}

impl Filter {
    /// Fills the small components of band `ty` of layer `tz`, whose runs have these labels.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the temporary file fails.
    pub fn fill(
        &self,
        [ty, tz]: [u32; 2],
        bits: &mut Bits,
        runs: &Runs,
        of_run: &[u32],
    ) -> Result<()> {
        debug_assert_eq!(runs.count, of_run.len());
        let (class_of, small) = {
            let mut found = lock(&self.found);
            (found.class_of(ty, tz)?, found.small(tz)?)
        };
        let nx = bits.span.nx;
        let mut run = 0;
        let mut flips: Vec<Run> = Vec::new();
        for row in bits.words.chunks_exact_mut(bits.row_words) {
            for found in RowRuns::new(row, nx) {
                if small[class_of[of_run[run] as usize] as usize] == 1 {
                    flips.push(found);
                }
                run += 1;
            }
            for flip in flips.drain(..) {
                for x in flip.start..flip.end {
                    row[x as usize / 64] ^= 1 << (x % 64);
                }
            }
        }
        Ok(())
    }
}

impl LabelInput<'_> {
    /// Labels the volume and marks what is known of all components then.
    ///
    /// # Errors
    /// Those of [`label`](crate::convert::label::label).
    pub fn search_dust<T: Voxel + Default>(
        &self,
        filters: &[Filter],
        sweep: usize,
        checkpointer: &mut Checkpointer,
    ) -> Result<SweepEnd> {
        let (dims, made) = (self.job.plan.tiling.dims, self.job.made);
        let memory = self.slab_memory()?;
        let (mut state, mut search, first) =
            Search::begin(sweep, checkpointer, dims, made, memory)?;
        self.label_layers::<T>(filters, first, &mut state, |state, layer, known| {
            search.add(state, layer, known)?;
            if layer + 1 < made.end {
                search.save(state, layer + 1, checkpointer)?;
            }
            state.memory.let_go(layer);
            Ok(())
        })?;
        let (marks, seam) = (search.marks()?, state.seam());
        drop((search, state));
        checkpointer.close_sweep(sweep, &marks)?;
        Ok(SweepEnd { marks, seam })
    }
}

/// Names of the files of a search.
const FOUND: &str = "found";
const PLACES: &str = "places";
/// Places of a layer behind those of its bands: those of [`Slab`].
const SLAB_PLACES: u64 = 4;

/// A search for dust under way.
struct Search {
    /// The number of the sweep.
    sweep: usize,
    files: Scratch,
    spool: SpillFile,
    /// Where the arrays of each layer lie in `spool`: the classes of the local components of each
    /// band, then those of [`Slab`]. Two numbers for each.
    places: SpillFile,
}

impl Search {
    /// Begins, or goes on where an interrupted conversion stopped. Returns the first layer, too.
    fn begin(
        sweep: usize,
        checkpointer: &mut Checkpointer,
        dims: Dims,
        made: Layers,
        memory: SlabMemory,
    ) -> Result<(LabelState, Self, u32)> {
        let files = checkpointer.files(sweep);
        let Some(mut at) = checkpointer.take(sweep) else {
            let state = LabelState::new(&files, dims, made, memory, Keeps::Nothing)?;
            let search = Search {
                sweep,
                spool: SpillFile::create(&files.path(FOUND))?,
                places: SpillFile::create(&files.path(PLACES))?,
                files,
            };
            return Ok((state, search, made.first));
        };
        let state = LabelState::load(&files, dims, made, &mut at, memory, Keeps::Nothing)?;
        let spool = at.marks.reopen(&files, FOUND)?;
        let places = at.marks.reopen(&files, PLACES)?;
        match (state, spool, places) {
            (Some(state), Some(spool), Some(places)) if at.state.is_empty() => {
                let search = Search {
                    sweep,
                    files,
                    spool,
                    places,
                };
                Ok((state, search, at.layer))
            }
            _ => Err(checkpointer.damaged()),
        }
    }

    /// Adds a layer.
    fn add(&mut self, state: &mut LabelState, layer: u32, known: &SlabLabels) -> Result<()> {
        let classes = &known.classes;
        for of_local in &classes.of_local {
            let place = self.spool.push(of_local)?;
            self.places.push(&place.numbers())?;
        }
        let voxels = state.class_voxels(known)?;
        state.note_voxels(layer, &voxels);
        let slab = Slab::new(&voxels, classes, &mut self.spool)?;
        self.places.push(&slab.numbers())?;
        Ok(())
    }

    /// Marks what is needed once the search is over.
    fn marks(&mut self) -> Result<Marks> {
        let mut marks = Marks::default();
        marks.add(&self.files, FOUND, self.spool.mark()?);
        marks.add(&self.files, PLACES, self.places.mark()?);
        Ok(marks)
    }

    /// Keeps what is known before `layer`.
    fn save(
        &mut self,
        state: &mut LabelState,
        layer: u32,
        checkpointer: &mut Checkpointer,
    ) -> Result<()> {
        let mut marks = self.marks()?;
        state.mark(&self.files, &mut marks)?;
        checkpointer.save(self.sweep, layer, &marks, |out| state.save(out))
    }
}

impl Found {
    /// Reads what a search has found; `None` if the files hold something else.
    fn read(
        files: &Scratch,
        marks: &Marks,
        tiling: Tiling,
        layers: Layers,
        dir: &Path,
    ) -> Result<Option<Self>> {
        let [_, bands, _] = tiling.tiles();
        let (spool, places) = (marks.open(files, FOUND)?, marks.open(files, PLACES)?);
        let (Some(spool), Some(places)) = (spool, places) else {
            return Ok(None);
        };
        let of_layer = u64::from(bands) + SLAB_PLACES;
        if places.here::<u64>().offset() != 16 * of_layer * u64::from(layers.count()) {
            return Ok(None);
        }
        Ok(Some(Found {
            spool,
            places,
            bands,
            layers,
            small: SpillFile::new(dir)?,
            small_places: SpillFile::new(dir)?,
        }))
    }

    /// Some numbers of a layer in [`Search::places`], from place `first` on.
    fn numbers(&mut self, layer: u32, first: u64, count: usize) -> Result<Vec<u64>> {
        let of_layer = u64::from(self.bands) + SLAB_PLACES;
        let place = u64::from(layer - self.layers.first) * of_layer + first;
        self.places.get(&Place::new(16 * place, count))
    }

    /// Class of each local component of a band.
    fn class_of(&mut self, ty: u32, tz: u32) -> Result<Vec<u32>> {
        let numbers = self.numbers(tz, ty.into(), 2)?;
        self.spool.get(&Place::new(numbers[0], numbers[1] as usize))
    }

    fn slab(&mut self, layer: u32) -> Result<Slab> {
        let numbers = self.numbers(layer, self.bands.into(), 2 * SLAB_PLACES as usize)?;
        Ok(Slab::from_numbers(&numbers))
    }

    /// 1 for each class of a layer that is to be filled, once that is known of all layers.
    fn small(&mut self, layer: u32) -> Result<Vec<u8>> {
        let offset = 16 * u64::from(self.layers.end - 1 - layer);
        let numbers = self.small_places.get::<u64>(&Place::new(offset, 2))?;
        self.small.get(&Place::new(numbers[0], numbers[1] as usize))
    }
}

impl Slab {
    fn new(voxels: &[u64], classes: &SlabComponents, spool: &mut SpillFile) -> Result<Self> {
        Ok(Slab {
            voxels: spool.push(voxels)?,
            above: spool.push(&classes.above)?,
            live: spool.push(&classes.live)?,
            carried_in: spool.push(&classes.carried_in)?,
        })
    }

    fn numbers(&self) -> [u64; 8] {
        let places = [
            self.voxels.numbers(),
            self.above.numbers(),
            self.live.numbers(),
            self.carried_in.numbers(),
        ];
        std::array::from_fn(|i| places[i / 2][i % 2])
    }

    fn from_numbers(n: &[u64]) -> Self {
        Slab {
            voxels: Place::new(n[0], n[1] as usize),
            above: Place::new(n[2], n[3] as usize),
            live: Place::new(n[4], n[5] as usize),
            carried_in: Place::new(n[6], n[7] as usize),
        }
    }
}

impl Filter {
    /// That of a search which has left files with these marks; `None` if they hold something else. Of components that go on
    /// in other parts of the volume, `beyond` tells whether they are small: 1 for those that are, which are counted there.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(
        input: &LabelInput,
        number: usize,
        files: &Scratch,
        marks: &Marks,
        beyond: &Beyond<u8>,
    ) -> Result<Option<Self>> {
        let job = input.job;
        let found = Found::read(files, marks, job.plan.tiling, job.made, input.work)?;
        let Some(found) = found else {
            return Ok(None);
        };
        let mut filter = Filter {
            found: Mutex::new(found),
            components: 0,
            voxels: 0,
        };
        let above = number == SMALL_OBJECTS;
        filter.resolve(above, job.options.min_voxels, beyond)?;
        Ok(Some(filter))
    }

    /// Decides, from the last slab back to the first, which classes are part of a small component.
    fn resolve(&mut self, above: bool, min_voxels: u64, beyond: &Beyond<u8>) -> Result<()> {
        let found = unshared(&mut self.found);
        let leaving = beyond.leaving.clone();
        let each = (0..leaving.len() as u32).collect();
        let mut later: (Vec<u8>, Vec<u32>) = (leaving, each);
        for layer in found.layers.each().rev() {
            let slab = found.slab(layer)?;
            let voxels = found.spool.get(&slab.voxels)?;
            let phases = found.spool.get(&slab.above)?;
            let mut goes_on = vec![None; voxels.len()];
            for (&class, &successor) in found.spool.get(&slab.live)?.iter().zip(&later.1) {
                goes_on[class as usize] = Some(later.0[successor as usize]);
            }
            for &(class, small) in beyond.ended(layer) {
                goes_on[class as usize] = Some(small);
            }
            let mut small = Vec::with_capacity(voxels.len());
            for (class, &count) in voxels.iter().enumerate() {
                small.push(goes_on[class].unwrap_or_else(|| {
                    let is_small = (phases[class] == 1) == above && count < min_voxels;
                    if is_small {
                        self.components += 1;
                        self.voxels += count;
                    }
                    u8::from(is_small)
                }));
            }
            let place = found.small.push(&small)?;
            found.small_places.push(&place.numbers())?;
            later = (small, found.spool.get(&slab.carried_in)?);
        }
        Ok(())
    }
}
