//! What the forward sweep gathers: components, surfaces and tiles in terms of each slab's classes.

use crate::checkpoint::{Marks, Scratch};
use crate::convert::scan::band::{Band, SealedBand};
use crate::convert::scan::collect::SlabTiles;
use crate::convert::scan::slab_memory::SlabMemory;
use crate::convert::scan::surfaces::Surfaces;
use crate::convert::slab_records::{SlabRecord, Slabs};
use crate::error::Result;
use crate::labels::{
    CarriedComponents, PhaseLabels, ProvisionalLabels, ResidentLabels, SlabComponents,
};
use crate::measure::{MeshSums, VoxelSums};
use crate::sys::spill_file::{Place, SpillFile};
use crate::sys::state_codec::{Decoder, Encoder};

/// Names of the files of a sweep.
const SLABS: &str = "slabs";
const WHOLE_SURFACES: &str = "whole-surfaces";
const RECORDS: &str = "records";
const OBJECTS: &str = "objects";
const CELLS: &str = "cells";
const SURFACES: &str = "surfaces";

/// What the whole sweep leaves.
pub struct ScanOutput {
    /// The arrays of all slabs.
    pub spool: SpillFile,
    /// By rising z.
    pub slabs: Slabs,
    /// Surfaces that are whole in a tile.
    pub whole: SpillFile,
    /// Numbers of objects and cells.
    pub provisional: PhaseLabels,
    /// Numbers of surfaces.
    pub surface_labels: ProvisionalLabels,
    /// NaN samples.
    pub nan: u64,
    /// Sums over all caps.
    pub caps: MeshSums,
    /// Objects and cells that were left out: how many, and their voxels.
    pub dust: [(u64, u64); 2],
}

/// What joining the bands of a slab has found.
#[derive(Debug, Default)]
pub struct SlabLabels {
    /// The bands, by rising y.
    pub sealed: Vec<SealedBand>,
    /// Their classes.
    pub classes: SlabComponents,
    /// What is known of components behind the slab, to be kept when it ends: others may be joined by then.
    pub after: CarriedState,
}

impl SlabLabels {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        sealed_bytes(&self.sealed) + self.classes.bytes() + self.after.bytes()
    }
}

/// What is known of components between two slabs.
#[derive(Debug, Default)]
pub struct CarriedState {
    nan: u64,
    objects: ResidentLabels,
    cells: ResidentLabels,
    classes: CarriedComponents,
}

impl CarriedState {
    /// Bytes of memory.
    fn bytes(&self) -> u64 {
        self.objects.bytes() + self.cells.bytes() + self.classes.snapshot_bytes()
    }
}

/// The sweep's state between slabs. Components may be a slab ahead of surfaces and tiles.
pub struct ScanState {
    /// What has been gathered.
    pub forward: ScanOutput,
    /// Surfaces that go on.
    pub surfaces: Surfaces,
    /// The memory of classes, surfaces and tiles of slabs that have not ended.
    pub memory: SlabMemory,
    classes: CarriedComponents,
}

/// The voxels of a component, of which a search notes whether it leaves the region of interest.
fn in_search(sums: &VoxelSums) -> u64 {
    match sums.touches_border {
        0 => sums.voxels,
        _ => u64::MAX,
    }
}

impl ScanState {
    /// Nothing gathered yet.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(files: &Scratch, memory: SlabMemory) -> Result<Self> {
        let spool = |what| SpillFile::create(&files.path(what));
        let provisional = |what| ProvisionalLabels::new(&files.path(what));
        let forward = ScanOutput {
            spool: spool(SLABS)?,
            slabs: Slabs::new(spool(RECORDS)?),
            whole: spool(WHOLE_SURFACES)?,
            provisional: PhaseLabels {
                objects: provisional(OBJECTS)?,
                cells: provisional(CELLS)?,
            },
            surface_labels: provisional(SURFACES)?,
            nan: 0,
            caps: MeshSums::default(),
            dust: [(0, 0); 2],
        };
        Ok(ScanState {
            forward,
            surfaces: Surfaces::default(),
            memory,
            classes: CarriedComponents::default(),
        })
    }

    /// What is known of components.
    fn components(&self) -> CarriedState {
        let provisional = &self.forward.provisional;
        CarriedState {
            nan: self.forward.nan,
            objects: provisional.objects.resident().clone(),
            cells: provisional.cells.resident().clone(),
            classes: self.classes.snapshot(),
        }
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`: what they held when
    /// components were like this, or more.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(
        &mut self,
        files: &Scratch,
        marks: &mut Marks,
        components: &CarriedState,
    ) -> Result<()> {
        let forward = &mut self.forward;
        marks.add(files, SLABS, forward.spool.mark()?);
        marks.add(files, WHOLE_SURFACES, forward.whole.mark()?);
        marks.add(files, RECORDS, forward.slabs.mark()?);
        for (what, provisional) in [
            (OBJECTS, &components.objects),
            (CELLS, &components.cells),
            (SURFACES, forward.surface_labels.resident()),
        ] {
            marks.add_length(files, what, provisional.spilled_bytes());
        }
        Ok(())
    }

    /// Writes the state between two slabs with components as they were there, apart from what [`ScanState::mark`]
    /// has brought to files.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder, components: &CarriedState) -> Result<()> {
        let forward = &self.forward;
        out.number(components.nan)?;
        out.array(&[forward.caps])?;
        components.objects.save(out)?;
        components.cells.save(out)?;
        forward.surface_labels.resident().save(out)?;
        components.classes.save(out)?;
        self.surfaces.save(out)
    }

    /// The state that was written, on the files as they were then; `None` if this is none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(
        files: &Scratch,
        marks: &Marks,
        input: &mut Decoder,
        memory: SlabMemory,
    ) -> Result<Option<Self>> {
        let head = (input.number(), input.array::<MeshSums>());
        let objects = ProvisionalLabels::load(&files.path(OBJECTS), input)?;
        let cells = ProvisionalLabels::load(&files.path(CELLS), input)?;
        let surface_labels = ProvisionalLabels::load(&files.path(SURFACES), input)?;
        let (Some(objects), Some(cells), Some(surface_labels)) = (objects, cells, surface_labels)
        else {
            return Ok(None);
        };
        let (Some(nan), Some(caps)) = head else {
            return Ok(None);
        };
        let classes = CarriedComponents::load(input);
        let known = classes.as_ref().map_or(0, CarriedComponents::live_len);
        let surfaces = Surfaces::load(input, known);
        let (Some(classes), Some(surfaces), [caps]) = (classes, surfaces, &caps[..]) else {
            return Ok(None);
        };
        let open = |what| marks.reopen(files, what);
        let (Some(spool), Some(whole), Some(records)) =
            (open(SLABS)?, open(WHOLE_SURFACES)?, open(RECORDS)?)
        else {
            return Ok(None);
        };
        let Some(slabs) = Slabs::load(records)? else {
            return Ok(None);
        };
        let forward = ScanOutput {
            spool,
            slabs,
            whole,
            provisional: PhaseLabels { objects, cells },
            surface_labels,
            nan,
            caps: *caps,
            dust: [(0, 0); 2],
        };
        Ok(Some(ScanState {
            forward,
            surfaces,
            memory,
            classes,
        }))
    }

    /// Takes out of some bands of a layer what the joining needs, and appends it to that of the slab's bands
    /// before.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn seal<T>(
        &mut self,
        layer: u32,
        bands: &mut [Band<T>],
        sealed: &mut Vec<SealedBand>,
    ) -> Result<()> {
        for band in bands {
            sealed.push(band.seal(&mut self.forward.spool)?);
        }
        self.memory.hold(layer, sealed_bytes(sealed))
    }

    /// Joins a layer's bands, by rising y, to classes.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`], and nothing has changed; [`crate::Error::Io`].
    pub fn join(
        &mut self,
        layer: u32,
        sealed: Vec<SealedBand>,
        last_layer: bool,
    ) -> Result<SlabLabels> {
        let known: Vec<_> = sealed.iter().map(SealedBand::known).collect();
        let bytes = sealed_bytes(&sealed) + self.classes.bytes(&known);
        self.memory.hold(layer, bytes)?;
        self.forward.nan += sealed.iter().map(|b| b.nan).sum::<u64>();
        let mut classes = self.classes.join(&known, &mut self.forward.provisional)?;
        if last_layer {
            classes.live.clear(); // nothing grows beyond the last slice
        }
        Ok(SlabLabels {
            sealed,
            classes,
            after: self.components(),
        })
    }

    /// Voxels so far of each class of a slab, in a search; those of one with a voxel outside of the region of interest are
    /// beyond all numbers.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn class_voxels(&mut self, known: &SlabLabels) -> Result<Vec<u64>> {
        let SlabLabels {
            sealed, classes, ..
        } = known;
        let mut voxels = vec![0; classes.provisional.len()];
        for (class, sums) in &classes.open {
            voxels[*class as usize] = in_search(sums);
        }
        for (band, of_local) in sealed.iter().zip(&classes.of_local) {
            let mut whole = band.components.whole();
            self.forward.spool.for_each(&band.whole, |sums| {
                let local = whole.next().expect("as many as there are sums");
                voxels[of_local[local as usize] as usize] = in_search(&sums);
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
        known: &SlabLabels,
        mut tiles: SlabTiles,
    ) -> Result<()> {
        let SlabLabels {
            sealed, classes, ..
        } = known;
        let forward = &mut self.forward;
        forward.caps.merge(&tiles.caps);
        tiles
            .records
            .sort_unstable_by_key(|t| (t.grid[1], t.grid[0]));
        let mut surfaces = tiles.surfaces;
        self.surfaces
            .end(&mut surfaces, classes, &mut forward.surface_labels)?;
        let spool = &mut forward.spool;
        let mut finished = Vec::with_capacity(sealed.len() + 1);
        let mut finish = |sums: Place<VoxelSums>, classes: Place<u32>| {
            let [[sums, many], [classes, of]] = [sums.numbers(), classes.numbers()];
            finished.push([sums, many, classes, of]);
        };
        for (band, of_local) in sealed.iter().zip(&classes.of_local) {
            let whole = band.components.whole();
            let classes = spool.push_all(whole.map(|local| of_local[local as usize]))?;
            finish(band.whole, classes);
        }
        let sums = spool.push_all(classes.finished().map(|(_, sums)| *sums))?;
        let classes_of = spool.push_all(classes.finished().map(|(class, _)| class))?;
        finish(sums, classes_of);
        let slab = SlabRecord {
            layer,
            provisional: spool.push(&classes.provisional)?,
            above: spool.push(&classes.above)?,
            live: spool.push(&classes.live)?,
            carried_in: spool.push(&classes.carried_in)?,
            finished: spool.push(&finished)?,
            surfaces: spool.push(&surfaces.all)?,
            surfaces_live: spool.push(&surfaces.live)?,
            surfaces_from_previous: spool.push(&surfaces.carried_in)?,
            whole: surfaces.whole,
            whole_labels: spool.push(&surfaces.whole_labels)?,
            tiles: spool.push(&tiles.records)?,
        };
        forward.slabs.push(&slab)?;
        drop(surfaces.all);
        self.memory.let_go(layer);
        Ok(())
    }
}

fn sealed_bytes(bands: &[SealedBand]) -> u64 {
    bands.iter().map(SealedBand::bytes).sum()
}
