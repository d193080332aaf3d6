//! What labelling gathers: components in terms of each slab's classes.

use crate::checkpoint::{Marks, Place as Begun, Scratch};
use crate::convert::label::band::{Band, SealedBand};
use crate::convert::label::kept_bands::{KeptBand, KeptBands};
use crate::convert::label::seam::{Leaving, Seam, crc_of};
use crate::convert::label::slab_memory::SlabMemory;
use crate::convert::label::slab_records::{SlabRecord, Slabs};
use crate::convert::layers::Layers;
use crate::error::Result;
use crate::grid::Dims;
use crate::labels::{CarriedComponents, PhaseLabels, ProvisionalLabels, SlabComponents};
use crate::measure::VoxelSums;
use crate::sys::spill_file::{Place, SpillFile};
use crate::sys::state_codec::Encoder;
use crate::volume::Voxel;

/// Names of the files of a sweep.
const SLABS: &str = "slabs";
const RECORDS: &str = "records";
const OBJECTS: &str = "objects";
const CELLS: &str = "cells";
const SURFACES: &str = "surfaces";
const SUMMARY: &str = "summary";

/// What labelling leaves.
pub struct Labelled {
    /// The arrays of all slabs.
    pub spool: SpillFile,
    /// By rising z.
    pub slabs: Slabs,
    /// What meshing needs of all bands.
    pub bands: KeptBands,
    /// Numbers of components and surfaces.
    pub provisional: PhaseLabels,
    /// NaN samples.
    pub nan: u64,
    /// What the checkpoint knows of the sweep's files, once it is over.
    pub marks: Marks,
}

/// What joining the bands of a slab has found.
#[derive(Debug, Default)]
pub struct SlabLabels {
    /// The bands, by rising y.
    pub sealed: Vec<SealedBand>,
    /// Their classes.
    pub classes: SlabComponents,
}

/// What is kept of bands for meshing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keeps {
    /// Nothing: none follows.
    Nothing,
    /// Bits and labels.
    Labels,
    /// These, and the samples that are needed, which are slow to read.
    Samples,
}

/// The sweep's state between slabs.
pub struct LabelState {
    /// What has been gathered.
    pub labelled: Labelled,
    /// The memory of bands and classes of slabs that have not ended.
    pub memory: SlabMemory,
    classes: CarriedComponents,
    /// What there is to tell the parts of the volume below and above.
    seam: Seam,
    dims: Dims,
    made: Layers,
    keeps: Keeps,
}

/// The voxels of a component, of which a search notes whether it leaves the region of interest.
fn in_search(sums: &VoxelSums) -> u64 {
    match sums.touches_border {
        0 => sums.voxels,
        _ => u64::MAX,
    }
}

impl LabelState {
    /// Nothing gathered yet, of these layers of a grid of this size.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(
        files: &Scratch,
        dims: Dims,
        made: Layers,
        memory: SlabMemory,
        keeps: Keeps,
    ) -> Result<Self> {
        let spool = |what| SpillFile::create(&files.path(what));
        let provisional = |what| ProvisionalLabels::new(&files.path(what));
        let labelled = Labelled {
            spool: spool(SLABS)?,
            slabs: Slabs::new(spool(RECORDS)?, made.first),
            bands: KeptBands::new(files)?,
            provisional: PhaseLabels {
                objects: provisional(OBJECTS)?,
                cells: provisional(CELLS)?,
                surfaces: provisional(SURFACES)?,
            },
            nan: 0,
            marks: Marks::default(),
        };
        Ok(LabelState {
            labelled,
            memory,
            classes: CarriedComponents::default(),
            seam: Seam::default(),
            dims,
            made,
            keeps,
        })
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        self.mark_spools(files, marks)?;
        let labelled = &mut self.labelled;
        let PhaseLabels {
            objects,
            cells,
            surfaces,
        } = &labelled.provisional;
        for (what, labels) in [(OBJECTS, objects), (CELLS, cells), (SURFACES, surfaces)] {
            marks.add_length(files, what, labels.resident().spilled_bytes());
        }
        Ok(())
    }

    /// The same of the files that grow at their ends only.
    fn mark_spools(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        let labelled = &mut self.labelled;
        marks.add(files, SLABS, labelled.spool.mark()?);
        marks.add(files, RECORDS, labelled.slabs.mark()?);
        labelled.bands.mark(files, marks)
    }

    /// Writes the state between two slabs, apart from what [`LabelState::mark`] has brought to files.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        out.number(self.labelled.nan)?;
        let PhaseLabels {
            objects,
            cells,
            surfaces,
        } = &self.labelled.provisional;
        for labels in [objects, cells, surfaces] {
            labels.resident().save(out)?;
        }
        self.classes.save(out)
    }

    /// The state that was written, on the files as they were then; `None` if this is none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(
        files: &Scratch,
        dims: Dims,
        made: Layers,
        at: &mut Begun,
        memory: SlabMemory,
        keeps: Keeps,
    ) -> Result<Option<Self>> {
        let (marks, input) = (&at.marks, &mut at.state);
        let nan = input.number();
        let objects = ProvisionalLabels::load(&files.path(OBJECTS), input)?;
        let cells = ProvisionalLabels::load(&files.path(CELLS), input)?;
        let surfaces = ProvisionalLabels::load(&files.path(SURFACES), input)?;
        let (Some(nan), Some(objects), Some(cells), Some(surfaces)) =
            (nan, objects, cells, surfaces)
        else {
            return Ok(None);
        };
        let classes = CarriedComponents::load(input);
        let provisional = PhaseLabels {
            objects,
            cells,
            surfaces,
        };
        let open = |what: &str| marks.reopen(files, what);
        let bands = KeptBands::opened(open)?;
        let labelled = Labelled::opened(open, bands, marks, provisional, nan, made)?;
        let state = labelled.zip(classes).map(|(labelled, classes)| LabelState {
            labelled,
            memory,
            classes,
            seam: Seam::default(),
            dims,
            made,
            keeps,
        });
        Ok(state)
    }

    /// Takes out of a band what the joining needs.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn seal<T: Voxel>(&mut self, band: &mut Band<T>) -> Result<SealedBand> {
        let Labelled { spool, bands, .. } = &mut self.labelled;
        let kept = match self.keeps {
            Keeps::Nothing => None,
            keeps => Some((bands, keeps == Keeps::Samples)),
        };
        band.seal(self.dims, spool, kept)
    }

    /// Joins a layer's bands, by rising y, to classes.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`], and nothing has changed but for the bands, which are returned; [`crate::Error::Io`].
    pub fn join(
        &mut self,
        layer: u32,
        sealed: Vec<SealedBand>,
        last_layer: bool,
    ) -> std::result::Result<SlabLabels, Box<(crate::error::Error, Vec<SealedBand>)>> {
        let known: Vec<_> = sealed.iter().map(SealedBand::known).collect();
        let bytes = sealed_bytes(&sealed) + self.classes.bytes(&known) + self.seam.bytes();
        if let Err(error) = self.memory.hold(layer, bytes) {
            return Err(Box::new((error, sealed)));
        }
        self.labelled.nan += sealed.iter().map(|b| b.nan).sum::<u64>();
        match self.classes.join(&known, &mut self.labelled.provisional) {
            Ok(mut classes) => {
                if last_layer {
                    classes.live.clear(); // nothing grows beyond the last slice
                }
                let is_first = layer == self.made.first;
                if is_first && layer > 0 {
                    self.seam.begin(&sealed, &classes);
                }
                self.seam.follow(layer, &classes, is_first);
                if layer + 1 == self.made.end {
                    self.seam.bits[1] = crc_of(sealed.iter().map(|band| band.slices[1]));
                }
                Ok(SlabLabels { sealed, classes })
            }
            Err(error) => Err(Box::new((error, Vec::new()))),
        }
    }

    /// True if components are looked at for their number of voxels alone.
    pub fn is_search(&self) -> bool {
        self.keeps == Keeps::Nothing
    }

    /// Voxels so far of each class of a slab, in a search; those of one with a voxel outside of the region of interest are
    /// beyond all numbers.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn class_voxels(&mut self, known: &SlabLabels) -> Result<Vec<u64>> {
        let SlabLabels { sealed, classes } = known;
        let mut voxels = vec![0; classes.provisional.len()];
        for (class, sums) in &classes.open {
            voxels[*class as usize] = in_search(sums);
        }
        for (band, of_local) in sealed.iter().zip(&classes.of_local) {
            let mut whole = band.components.whole();
            self.labelled.spool.for_each(&band.whole, |sums| {
                let local = whole.next().expect("as many as there are sums");
                voxels[of_local[local as usize] as usize] = in_search(&sums);
                Ok(())
            })?;
        }
        Ok(voxels)
    }

    /// Notes how many voxels the classes of a slab have, in a search.
    pub fn note_voxels(&mut self, layer: u32, voxels: &[u64]) {
        self.seam.note_voxels(layer, voxels);
    }

    /// What there is to tell other parts of the volume, when all layers are joined.
    pub fn seam(&mut self) -> Seam {
        let mut seam = std::mem::take(&mut self.seam);
        let leaving = self.classes.live().map(|live| Leaving {
            provisional: live.provisional_id,
            surface: live.surface,
            above: live.above.into(),
            voxels: in_search(&live.sums),
        });
        seam.end(self.classes.last_slice(), leaving);
        seam
    }

    /// Ends a slab: spools what it has.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn finish_slab(&mut self, layer: u32, known: &SlabLabels) -> Result<()> {
        let SlabLabels { sealed, classes } = known;
        // what goes on in the next part is summed up there, too
        let is_last = layer + 1 == self.made.end;
        let Labelled {
            spool,
            slabs,
            bands,
            ..
        } = &mut self.labelled;
        let mut finished = Vec::with_capacity(sealed.len() + 1);
        let mut finish = |sums: Place<VoxelSums>, classes: Place<u32>| {
            let [[sums, many], [classes, of]] = [sums.numbers(), classes.numbers()];
            finished.push([sums, many, classes, of]);
        };
        let mut of_local_at = Vec::with_capacity(sealed.len());
        for (band, of_local) in sealed.iter().zip(&classes.of_local) {
            let whole = band.components.whole();
            let classes = spool.push_all(whole.map(|local| of_local[local as usize]))?;
            finish(band.whole, classes);
            of_local_at.push(spool.push(of_local)?.numbers());
        }
        let ended = || classes.finished(is_last);
        let sums = spool.push_all(ended().map(|(_, sums)| *sums))?;
        let classes_of = spool.push_all(ended().map(|(class, _)| class))?;
        finish(sums, classes_of);
        let slab = SlabRecord {
            layer,
            provisional: spool.push(&classes.provisional)?,
            surfaces: spool.push(&classes.surfaces)?,
            above: spool.push(&classes.above)?,
            live: spool.push(&classes.live)?,
            carried_in: spool.push(&classes.carried_in)?,
            finished: spool.push(&finished)?,
            of_local: spool.push(&of_local_at)?,
        };
        slabs.push(&slab)?;
        let kept: Vec<KeptBand> = sealed.iter().map(|band| band.kept).collect();
        bands.add_layer(kept.into_iter())?;
        self.memory.let_go(layer);
        Ok(())
    }

    /// Ends labelling; marks what is needed from now on.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn end(mut self, files: &Scratch) -> Result<Marks> {
        let mut marks = Marks::default();
        self.mark_spools(files, &mut marks)?;
        let mut summary = vec![self.labelled.nan];
        let PhaseLabels {
            objects,
            cells,
            surfaces,
        } = &mut self.labelled.provisional;
        for (what, labels) in [(OBJECTS, objects), (CELLS, cells), (SURFACES, surfaces)] {
            summary.push(labels.spill()?);
            marks.add(files, what, labels.mark()?);
        }
        let mut file = SpillFile::create(&files.path(SUMMARY))?;
        file.push(&summary)?;
        marks.add(files, SUMMARY, file.mark()?);
        Ok(marks)
    }
}

impl Labelled {
    /// What labelling has left in these files; `None` if they hold something else.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(files: &Scratch, marks: &Marks, made: Layers) -> Result<Option<Self>> {
        let spool = |what: &str| marks.open(files, what);
        let Some(mut summary) = spool(SUMMARY)? else {
            return Ok(None);
        };
        let summary = match summary.everything::<u64>() {
            Some(all) => summary.get(&all)?,
            None => Vec::new(),
        };
        let &[nan, objects, cells, surfaces] = &summary[..] else {
            return Ok(None);
        };
        let open = |what, count| ProvisionalLabels::spilled(&files.path(what), count);
        let provisional = PhaseLabels {
            objects: open(OBJECTS, objects)?,
            cells: open(CELLS, cells)?,
            surfaces: open(SURFACES, surfaces)?,
        };
        let bands = KeptBands::opened(spool)?;
        Labelled::opened(spool, bands, marks, provisional, nan, made)
    }

    /// On files that `open` opens.
    fn opened(
        open: impl Fn(&str) -> Result<Option<SpillFile>>,
        bands: Option<KeptBands>,
        marks: &Marks,
        provisional: PhaseLabels,
        nan: u64,
        made: Layers,
    ) -> Result<Option<Self>> {
        let (spool, records) = (open(SLABS)?, open(RECORDS)?);
        let (Some(spool), Some(records), Some(bands)) = (spool, records, bands) else {
            return Ok(None);
        };
        let slabs = Slabs::load(records, made.first)?;
        Ok(slabs.map(|slabs| Labelled {
            spool,
            slabs,
            bands,
            provisional,
            nan,
            marks: marks.clone(),
        }))
    }
}

fn sealed_bytes(bands: &[SealedBand]) -> u64 {
    bands.iter().map(SealedBand::bytes).sum()
}
