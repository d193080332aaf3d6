//! Labelling: a pass over the volume that finds all components, and keeps of each band what meshing needs: its bits and
//! the local component of each run, and the samples that it needs only where they are slow to read.
//!
//! Bands are labelled by themselves, in any order; slabs of them are joined one after the other. With `--min-voxels` two
//! passes come before that find small components.

mod band;
mod kept_bands;
mod queue;
mod seam;
mod slab_memory;
mod slab_records;
mod small_components;
mod state;
mod workers;

pub use band::span_of;
pub use kept_bands::{BANDS, KeptBand, KeptBands};
pub use seam::{Arrival, Beyond, Seam};
pub use slab_records::{EndedComponents, SlabRecord, Slabs};
pub use small_components::Filter;
pub use state::Labelled;

use crate::checkpoint::{Checkpointer, LABELS, Marks};
use crate::convert::conversion::Conversion;
use crate::convert::label::band::BandSource;
use crate::convert::label::queue::Limits;
use crate::convert::label::slab_memory::SlabMemory;
use crate::convert::label::state::{Keeps, LabelState, SlabLabels};
use crate::convert::label::workers::LabelWorkers;
use crate::error::Result;
use crate::sys::memory_pool::MemoryPool;
use crate::volume::{Volume, Voxel};
use std::path::Path;
use std::sync::Arc;

/// Objects and cells that were left out: how many, and their voxels.
pub type LeftOut = [(u64, u64); 2];

/// What labelling works on.
pub struct LabelInput<'a> {
    /// The conversion.
    pub job: &'a Conversion<'a>,
    /// Its grid, which can be read in any order.
    pub volume: &'a dyn Volume,
    /// It is filtered or unpacked as it is read, or slow to read, so that samples had better be kept than read again.
    pub is_slow: bool,
    /// Its memory.
    pub memory: &'a Arc<MemoryPool>,
    /// Directory for temporary files.
    pub work: &'a Path,
}

/// Finds all components, and what was left out of them.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::TooDense`] if the volume is too dense for the limit,
/// [`crate::Error::Interrupted`], and those of [`Volume::read_box`].
pub fn label(input: &LabelInput, checkpointer: &mut Checkpointer) -> Result<(Labelled, LeftOut)> {
    let job = input.job;
    let mut filters = Vec::new();
    let searches = match job.options.min_voxels > 1 {
        true => 0..LABELS,
        false => 0..0,
    };
    for number in searches {
        let marks = match checkpointer.over(number) {
            Some(marks) => marks,
            None => sweep(input, number, &filters, checkpointer)?.marks,
        };
        checkpointer.end_sweep(&marks);
        let files = checkpointer.files(number);
        let filter = Filter::read(input, number, &files, &marks, &Beyond::default())?;
        filters.push(filter.ok_or_else(|| checkpointer.damaged())?);
    }
    let marks = match checkpointer.over(LABELS) {
        Some(marks) => marks,
        None => sweep(input, LABELS, &filters, checkpointer)?.marks,
    };
    checkpointer.end_sweep(&marks);
    let labelled = Labelled::read(&checkpointer.files(LABELS), &marks, job.made)?;
    Ok((
        labelled.ok_or_else(|| checkpointer.damaged())?,
        left_out(&filters),
    ))
}

/// What these filters leave out, of objects and of cells.
pub fn left_out(filters: &[Filter]) -> LeftOut {
    match filters {
        [objects, cells] => [objects, cells].map(|f| (f.components, f.voxels)),
        _ => LeftOut::default(),
    }
}

/// What a sweep over the volume leaves.
pub struct SweepEnd {
    /// How much its files hold.
    pub marks: Marks,
    /// What it knows of components that go on in other parts of the volume.
    pub seam: Seam,
}

/// Makes the sweep of this number, one of those that find small components or that which finds all, after the `filters` of
/// those before.
///
/// # Errors
/// As of [`label`].
pub fn sweep(
    input: &LabelInput,
    number: usize,
    filters: &[Filter],
    checkpointer: &mut Checkpointer,
) -> Result<SweepEnd> {
    crate::volume::with_voxel_type!(input.volume.header().dtype, T => match number < LABELS {
        true => input.search_dust::<T>(filters, number, checkpointer),
        false => input.label_all::<T>(filters, checkpointer),
    })
}

impl LabelInput<'_> {
    /// Labels the volume and marks what is needed of that.
    fn label_all<T: Voxel + Default>(
        &self,
        filters: &[Filter],
        checkpointer: &mut Checkpointer,
    ) -> Result<SweepEnd> {
        let (mut state, first) = self.begin(checkpointer)?;
        let files = checkpointer.files(LABELS);
        let end = self.job.made.end;
        self.label_layers::<T>(filters, first, &mut state, |state, layer, known| {
            state.finish_slab(layer, known)?;
            if layer + 1 == end {
                return Ok(());
            }
            let mut marks = Marks::default();
            state.mark(&files, &mut marks)?;
            checkpointer.save(LABELS, layer + 1, &marks, |out| state.save(out))
        })?;
        let seam = state.seam();
        let marks = state.end(&files)?;
        checkpointer.close_sweep(LABELS, &marks)?;
        Ok(SweepEnd { marks, seam })
    }

    /// The state before the first layer to do, and that layer.
    fn begin(&self, checkpointer: &mut Checkpointer) -> Result<(LabelState, u32)> {
        let (files, memory) = (checkpointer.files(LABELS), self.slab_memory()?);
        let (dims, made) = (self.job.plan.tiling.dims, self.job.made);
        let keeps = match self.is_slow {
            true => Keeps::Samples,
            false => Keeps::Labels,
        };
        let Some(mut at) = checkpointer.take(LABELS) else {
            let state = LabelState::new(&files, dims, made, memory, keeps)?;
            return Ok((state, made.first));
        };
        let state = LabelState::load(&files, dims, made, &mut at, memory, keeps)?;
        let state = state.filter(|s| at.state.is_empty() && s.labelled.slabs.end() == at.layer);
        Ok((state.ok_or_else(|| checkpointer.damaged())?, at.layer))
    }

    fn slab_memory(&self) -> Result<SlabMemory> {
        SlabMemory::new(self.memory, self.job.plan.front)
    }

    /// Labels all layers from `first` on, and calls `each` for every one of them, in their order.
    ///
    /// # Errors
    /// As of [`label`], and what `each` returns.
    fn label_layers<T: Voxel + Default>(
        &self,
        filters: &[Filter],
        first: u32,
        state: &mut LabelState,
        each: impl FnMut(&mut LabelState, u32, &SlabLabels) -> Result<()> + Send,
    ) -> Result<()> {
        let Conversion {
            options,
            plan,
            made,
            ..
        } = self.job;
        let [_, bands, _] = plan.tiling.tiles();
        let source = BandSource {
            volume: self.volume,
            ceil: T::ceil_from(options.threshold),
            rule: options.ambiguous,
            tiling: plan.tiling,
            region: self.job.region,
            measured: options.measured(&self.job.grid.header().placement)?,
            is_search: state.is_search(),
            filters,
            memory: self.memory,
        };
        let limits = Limits {
            bands,
            layers: made.end,
            ahead: plan.bands_at_once,
        };
        LabelWorkers::new(self, &source, limits, first, state, each).run()
    }
}
