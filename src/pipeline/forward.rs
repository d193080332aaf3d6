//! What the forward sweep gathers: components, surfaces and tiles in terms of each slab's classes.

use crate::checkpoint::{Decoder, Encoder};
use crate::error::Result;
use crate::measure::{MeshSums, VoxelSums};
use crate::mesh::Piece;
use crate::pipeline::band::{Band, SettledBand};
use crate::pipeline::budget::{Budget, Reservation};
use crate::pipeline::keep::{Marks, Scratch};
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::surfaces::{SlabSurface, SlabSurfaces, SurfacePart, Surfaces};
use crate::pipeline::tilefile::{TileRecord, WrittenPiece, cell_of};
use crate::segment::{Births, Classes, PhaseBirths, SlabClasses};
use std::sync::{Arc, Mutex, MutexGuard};

/// Names of the files of a sweep.
const SLABS: &str = "slabs";
const WHOLE_SURFACES: &str = "whole-surfaces";
const RECORDS: &str = "records";
const OBJECTS: &str = "objects";
const CELLS: &str = "cells";
const SURFACES: &str = "surfaces";

/// What the sweep leaves of one slab.
#[derive(Debug)]
pub struct SlabRecord {
    /// z index of its macrocubes.
    pub layer: u32,
    /// Number of each class.
    pub births: Place<u64>,
    /// 1 for objects, 0 for cells, per class.
    pub above: Place<u8>,
    /// See [`SlabClasses`].
    pub live: Place<u32>,
    /// See [`SlabClasses`].
    pub from_previous: Place<u32>,
    /// Sums of components that end in this slab, some at a time, and their classes.
    pub finished: Vec<(Place<VoxelSums>, Place<u32>)>,
    /// Surfaces that are not whole in a tile.
    pub surfaces: Place<SlabSurface>,
    /// See [`SlabSurfaces`].
    pub surfaces_live: Place<u32>,
    /// See [`SlabSurfaces`].
    pub surfaces_from_previous: Place<u32>,
    /// Surfaces that are, in a spool of their own.
    pub whole: Place<SlabSurface>,
    /// Births of these.
    pub whole_births: Place<u64>,
    /// The tiles, by y, then x.
    pub tiles: Place<TileRecord>,
}

impl SlabRecord {
    /// All of it as numbers.
    fn numbers(&self) -> Vec<u64> {
        let places = [
            self.births.numbers(),
            self.above.numbers(),
            self.live.numbers(),
            self.from_previous.numbers(),
            self.surfaces.numbers(),
            self.surfaces_live.numbers(),
            self.surfaces_from_previous.numbers(),
            self.whole.numbers(),
            self.whole_births.numbers(),
            self.tiles.numbers(),
        ];
        let finished = self.finished.iter();
        let finished = finished.flat_map(|(sums, of)| [sums.numbers(), of.numbers()]);
        let head = [u64::from(self.layer), self.finished.len() as u64];
        let places = places.into_iter().chain(finished).flatten();
        head.into_iter().chain(places).collect()
    }

    /// Takes a slab out of numbers; `None` if these are not enough.
    fn take(numbers: &mut impl Iterator<Item = u64>) -> Option<Self> {
        fn place<T>(numbers: &mut impl Iterator<Item = u64>) -> Option<Place<T>> {
            let (offset, len) = (numbers.next()?, numbers.next()?);
            Some(Place::new(offset, len.try_into().ok()?))
        }
        let layer = numbers.next()?.try_into().ok()?;
        let parts = numbers.next()?;
        let mut slab = SlabRecord {
            layer,
            births: place(numbers)?,
            above: place(numbers)?,
            live: place(numbers)?,
            from_previous: place(numbers)?,
            finished: Vec::new(),
            surfaces: place(numbers)?,
            surfaces_live: place(numbers)?,
            surfaces_from_previous: place(numbers)?,
            whole: place(numbers)?,
            whole_births: place(numbers)?,
            tiles: place(numbers)?,
        };
        for _ in 0..parts {
            slab.finished.push((place(numbers)?, place(numbers)?));
        }
        Some(slab)
    }
}

/// What the whole sweep leaves.
pub struct Forward {
    /// The arrays of all slabs.
    pub spool: Spool,
    /// By rising z.
    pub slabs: Vec<SlabRecord>,
    /// Surfaces that are whole in a tile.
    pub whole: Spool,
    /// Numbers of objects and cells.
    pub births: PhaseBirths,
    /// Numbers of surfaces.
    pub surface_births: Births,
    /// NaN samples.
    pub nan: u64,
    /// Sums over all caps.
    pub caps: MeshSums,
    /// Objects and cells that were left out: how many, and their voxels.
    pub dust: [(u64, u64); 2],
}

/// The sweep's state between slabs.
pub struct State {
    /// What has been gathered.
    pub forward: Forward,
    /// The slab records, for a resume.
    records: Spool,
    classes: Classes,
    surfaces: Surfaces,
    /// Memory planned for classes, surfaces and tiles of a slab.
    front: u64,
    /// The memory of these.
    held: Reservation,
}

impl State {
    /// Nothing gathered yet. The first `front` bytes of the budget are for what a slab has in
    /// components, surfaces and tiles.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`] if the budget is less than `front`.
    pub fn new(files: &Scratch, budget: &Arc<Budget>, front: u64) -> Result<Self> {
        let spool = |what| Spool::create(&files.path(what));
        let births = |what| Births::new(&files.path(what));
        let forward = Forward {
            spool: spool(SLABS)?,
            slabs: Vec::new(),
            whole: spool(WHOLE_SURFACES)?,
            births: PhaseBirths {
                objects: births(OBJECTS)?,
                cells: births(CELLS)?,
            },
            surface_births: births(SURFACES)?,
            nan: 0,
            caps: MeshSums::default(),
            dust: [(0, 0); 2],
        };
        let mut held = Reservation::new(budget);
        held.grow_to(front)?;
        Ok(State {
            forward,
            records: spool(RECORDS)?,
            classes: Classes::default(),
            surfaces: Surfaces::default(),
            front,
            held,
        })
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        let forward = &mut self.forward;
        marks.add(files, SLABS, forward.spool.mark()?);
        marks.add(files, WHOLE_SURFACES, forward.whole.mark()?);
        marks.add(files, RECORDS, self.records.mark()?);
        for (what, births) in [
            (OBJECTS, &forward.births.objects),
            (CELLS, &forward.births.cells),
            (SURFACES, &forward.surface_births),
        ] {
            marks.add_length(files, what, births.filed_bytes());
        }
        Ok(())
    }

    /// Writes the state between two slabs, apart from what [`State::mark`] has brought to files.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        let forward = &self.forward;
        out.number(forward.nan)?;
        out.array(&[forward.caps])?;
        forward.births.objects.save(out)?;
        forward.births.cells.save(out)?;
        forward.surface_births.save(out)?;
        self.classes.save(out)?;
        self.surfaces.save(out)
    }

    /// The state that was written, on the files as they were then; `None` if this is none.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`] if the budget is less than `front`.
    pub fn load(
        files: &Scratch,
        marks: &Marks,
        input: &mut Decoder,
        budget: &Arc<Budget>,
        front: u64,
    ) -> Result<Option<Self>> {
        let head = (input.number(), input.array::<MeshSums>());
        let objects = Births::load(&files.path(OBJECTS), input)?;
        let cells = Births::load(&files.path(CELLS), input)?;
        let surface_births = Births::load(&files.path(SURFACES), input)?;
        let (Some(objects), Some(cells), Some(surface_births)) = (objects, cells, surface_births)
        else {
            return Ok(None);
        };
        let (Some(nan), Some(caps)) = head else {
            return Ok(None);
        };
        let classes = Classes::load(input);
        let known = classes.as_ref().map_or(0, Classes::live_len);
        let surfaces = Surfaces::load(input, known);
        let (Some(classes), Some(surfaces), [caps]) = (classes, surfaces, &caps[..]) else {
            return Ok(None);
        };
        let open = |what| marks.reopen(files, what);
        let (Some(spool), Some(whole), Some(mut records)) =
            (open(SLABS)?, open(WHOLE_SURFACES)?, open(RECORDS)?)
        else {
            return Ok(None);
        };
        let Some(slabs) = read_slabs(&mut records)? else {
            return Ok(None);
        };
        let forward = Forward {
            spool,
            slabs,
            whole,
            births: PhaseBirths { objects, cells },
            surface_births,
            nan,
            caps: *caps,
            dust: [(0, 0); 2],
        };
        let mut held = Reservation::new(budget);
        held.grow_to(front)?;
        Ok(Some(State {
            forward,
            records,
            classes,
            surfaces,
            front,
            held,
        }))
    }

    /// Takes out of some bands what the joining needs, and appends it to that of the slab's bands
    /// before.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn settle<T>(
        &mut self,
        bands: &mut [Band<T>],
        settled: &mut Vec<SettledBand>,
    ) -> Result<()> {
        for band in bands {
            settled.push(band.settle(&mut self.forward.spool)?);
        }
        self.held.grow_to(settled_bytes(settled))
    }

    /// Joins a slab's bands, by rising y, to classes.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`], and nothing has changed; [`crate::Error::Io`].
    pub fn join(&mut self, bands: &[SettledBand], last_layer: bool) -> Result<SlabClasses> {
        let known: Vec<_> = bands.iter().map(SettledBand::known).collect();
        self.held
            .grow_to(settled_bytes(bands) + self.classes.bytes(&known))?;
        self.forward.nan += bands.iter().map(|b| b.nan).sum::<u64>();
        let mut classes = self.classes.join(&known, &mut self.forward.births)?;
        if last_layer {
            classes.live.clear(); // nothing grows beyond the last slice
        }
        Ok(classes)
    }

    /// Voxels so far of each class.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn class_voxels(
        &mut self,
        bands: &[SettledBand],
        classes: &SlabClasses,
    ) -> Result<Vec<u64>> {
        let mut voxels = vec![0; classes.births.len()];
        for (class, sums) in &classes.open {
            voxels[*class as usize] = sums.voxels;
        }
        for (band, of_local) in bands.iter().zip(&classes.of_local) {
            let mut whole = band.components.whole();
            self.forward.spool.for_each(&band.whole, |sums| {
                let local = whole.next().expect("as many as there are sums");
                voxels[of_local[local as usize] as usize] = sums.voxels;
                Ok(())
            })?;
        }
        Ok(voxels)
    }

    /// Ends a slab: spools what it has.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn finish_slab(
        &mut self,
        layer: u32,
        bands: &[SettledBand],
        classes: &SlabClasses,
        mut tiles: SlabTiles,
    ) -> Result<()> {
        let forward = &mut self.forward;
        forward.caps.merge(&tiles.caps);
        tiles
            .records
            .sort_unstable_by_key(|t| (t.grid[1], t.grid[0]));
        let mut surfaces = tiles.surfaces;
        self.surfaces
            .end(&mut surfaces, classes, &mut forward.surface_births)?;
        let spool = &mut forward.spool;
        let mut finished = Vec::with_capacity(bands.len() + 1);
        for (band, of_local) in bands.iter().zip(&classes.of_local) {
            let whole = band.components.whole();
            let classes = spool.push_all(whole.map(|local| of_local[local as usize]))?;
            finished.push((band.whole, classes));
        }
        let sums = spool.push_all(classes.finished().map(|(_, sums)| *sums))?;
        let classes_of = spool.push_all(classes.finished().map(|(class, _)| class))?;
        finished.push((sums, classes_of));
        let slab = SlabRecord {
            layer,
            births: spool.push(&classes.births)?,
            above: spool.push(&classes.above)?,
            live: spool.push(&classes.live)?,
            from_previous: spool.push(&classes.from_previous)?,
            finished,
            surfaces: spool.push(&surfaces.all)?,
            surfaces_live: spool.push(&surfaces.live)?,
            surfaces_from_previous: spool.push(&surfaces.from_previous)?,
            whole: surfaces.whole,
            whole_births: spool.push(&surfaces.whole_births)?,
            tiles: spool.push(&tiles.records)?,
        };
        self.records.push(&slab.numbers())?;
        forward.slabs.push(slab);
        drop(surfaces.all);
        self.held.shrink_to(self.front);
        Ok(())
    }
}

/// All slabs of a spool of records; `None` if it holds anything else.
fn read_slabs(records: &mut Spool) -> Result<Option<Vec<SlabRecord>>> {
    let mut numbers = records.all::<u64>()?.into_iter().peekable();
    let mut slabs = Vec::new();
    while numbers.peek().is_some() {
        match SlabRecord::take(&mut numbers) {
            Some(slab) if slab.layer as usize == slabs.len() => slabs.push(slab),
            _ => return Ok(None),
        }
    }
    Ok(Some(slabs))
}

fn settled_bytes(bands: &[SettledBand]) -> u64 {
    bands.iter().map(SettledBand::bytes).sum()
}

/// The tiles and surfaces of a slab.
#[derive(Debug)]
pub struct SlabTiles {
    records: Vec<TileRecord>,
    surfaces: SlabSurfaces,
    caps: MeshSums,
    /// Bytes of the slab's bands and classes.
    fixed: u64,
}

/// The state while tiles of a slab are gathered, in any order, from many threads.
pub struct Gather<'a>(Mutex<Gathering<'a>>);

struct Gathering<'a> {
    state: &'a mut State,
    slab: Option<SlabTiles>,
}

impl<'a> Gather<'a> {
    /// Has no tile yet.
    pub fn new(state: &'a mut State) -> Self {
        Gather(Mutex::new(Gathering { state, slab: None }))
    }

    fn lock(&self) -> MutexGuard<'_, Gathering<'a>> {
        self.0.lock().expect("no thread panicked")
    }

    /// Does what needs the state between two slabs.
    pub fn between<R>(&self, work: impl FnOnce(&mut State) -> R) -> R {
        work(self.lock().state)
    }

    /// Begins a slab, or begins it anew: drops what was gathered of it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn begin(&self, bands: &[SettledBand], classes: &SlabClasses) -> Result<()> {
        let Gathering { state, slab } = &mut *self.lock();
        let (whole, births) = (&state.forward.whole, &mut state.forward.surface_births);
        *slab = Some(SlabTiles {
            records: Vec::new(),
            surfaces: state.surfaces.begin(classes, whole, births)?,
            caps: MeshSums::default(),
            fixed: settled_bytes(bands) + classes.bytes(),
        });
        Ok(())
    }

    /// Adds a tile: its pieces learn their surfaces and leave memory.
    ///
    /// `pieces` holds what each adds to a surface, `None` for a cap.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn add(
        &self,
        mut record: TileRecord,
        pieces: impl Iterator<Item = (WrittenPiece, Option<SurfacePart>)>,
        caps: &MeshSums,
    ) -> Result<()> {
        let Gathering { state, slab } = &mut *self.lock();
        let slab = slab.as_mut().expect("a slab has begun");
        let Forward { spool, whole, .. } = &mut state.forward;
        record.pieces_at = spool.here::<WrittenPiece>().offset();
        let mut place = spool.here();
        for (mut piece, part) in pieces {
            if let Some(part) = part {
                piece.surface = slab.surfaces.add(&part, whole)?;
            }
            spool.extend(&mut place, &[piece])?;
        }
        slab.records.push(record);
        slab.caps.merge(caps);
        let records = slab.records.capacity() * size_of::<TileRecord>();
        let bytes = slab.fixed + slab.surfaces.bytes() + records as u64;
        state.held.grow_to(bytes)
    }

    /// All tiles of the slab that has begun.
    pub fn take(&self) -> SlabTiles {
        self.lock().slab.take().expect("a slab has begun")
    }
}

/// True if some of a tile's pieces are likely to turn out to be one. The tile is then written anew, and is
/// best read back from the page cache.
pub fn is_provisional(classes: &SlabClasses, pieces: &[Piece]) -> bool {
    let pair = |p: &Piece| [p.object, cell_of(p)];
    classes.merge_often && classes.may_become_one(pieces.iter().map(pair))
}
