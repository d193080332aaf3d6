//! One band of a slab, read, classified and labelled.

use crate::convert::label::kept_bands::{KeptBand, KeptBands};
use crate::convert::label::small_components::Filter;
use crate::convert::memory::BANDS;
use crate::error::Result;
use crate::grid::{Ambiguous, Dims, Placement, Tiling};
use crate::labels::{
    BandComponents, BandFaces, BandInput, Bits, InsideBand, Labels, LocalComponent, Runs, Span,
    Voxels, add_border_euler, keys_on_top, label_runs, note_outside, note_region_edge, sum_voxels,
};
use crate::measure::VoxelSums;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::spill_file::{Place, SpillFile};
use crate::volume::{RegionVoxels, Volume, Voxel};
use std::sync::Arc;

/// Everything about a band; its buffers are reused from slab to slab.
#[derive(Debug, Default)]
pub struct Band<T> {
    /// Samples with gradient neighbours.
    pub voxels: Voxels<T>,
    /// Bits.
    pub bits: Bits,
    /// Runs.
    pub runs: Runs,
    /// Local components.
    pub labels: Labels,
    /// What joins it to its neighbours.
    pub edges: BandFaces,
    /// Which of the voxels are inside the region of interest, if there is one.
    pub inside: InsideBand,
    /// NaN samples among the voxels that the band owns.
    pub nan: u64,
    /// See [`keys_on_top`].
    pub keys_on_top: Vec<(u32, u64)>,
    /// The memory of all this.
    pub held: MemoryReservation,
}

/// What the joining of bands needs of one.
#[derive(Debug)]
pub struct SealedBand {
    /// What it shares with others.
    pub edges: BandFaces,
    /// Its components.
    pub components: BandComponents,
    /// Sums of the components that are whole in it.
    pub whole: Place<VoxelSums>,
    /// NaN samples.
    pub nan: u64,
    /// What is kept for meshing.
    pub kept: KeptBand,
    /// CRC-32 of the bits of its first and its last slice.
    pub slices: [u32; 2],
}

impl<T: Voxel> Band<T> {
    /// Takes out what the joining of bands needs. Components that are whole in this band leave memory
    /// for `spool`; what meshing needs is added to `kept`, if that is to follow, with
    /// samples for `true`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn seal(
        &mut self,
        dims: Dims,
        spool: &mut SpillFile,
        kept: Option<(&mut KeptBands, bool)>,
    ) -> Result<SealedBand> {
        let all = std::mem::take(&mut self.labels.components);
        let edges = std::mem::take(&mut self.edges);
        let on_top = std::mem::take(&mut self.keys_on_top);
        let mut whole = spool.here();
        let components = BandComponents::split(&all, &edges, on_top, dims, |sums| {
            spool.extend(&mut whole, &[*sums])
        })?;
        let kept = match kept {
            Some((kept, samples)) => {
                let samples = samples.then_some(&self.voxels);
                kept.keep(&self.bits, &self.labels.of_run, all.len(), samples)?
            }
            None => KeptBand::default(),
        };
        self.held
            .shrink_to(self.held.bytes() - component_bytes(all.len()));
        Ok(SealedBand {
            edges,
            components,
            whole,
            nan: self.nan,
            kept,
            slices: [0, self.bits.span.slices() - 1].map(|s| {
                let words = self.bits.span.rows() * self.bits.row_words;
                crc32fast::hash(bytemuck::cast_slice(&self.bits.words[s * words..][..words]))
            }),
        })
    }
}

impl SealedBand {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        self.edges.bytes() + self.components.bytes()
    }

    /// As the joining takes it.
    pub fn known(&self) -> BandInput<'_> {
        BandInput {
            edges: &self.edges,
            components: &self.components,
        }
    }
}

fn component_bytes(count: usize) -> u64 {
    (count * size_of::<LocalComponent>()) as u64
}

/// What bands are made from.
#[derive(Clone, Copy)]
pub struct BandSource<'a, T> {
    /// The grid's samples.
    pub volume: &'a dyn Volume,
    /// The threshold in the samples' type, see [`Voxel::ceil_from`].
    pub ceil: Option<T>,
    /// Which voxels an ambiguous face joins.
    pub rule: Ambiguous,
    /// The macrocubes.
    pub tiling: Tiling,
    /// The region of interest of the grid, if there is one; voxels outside have the sample that fills them.
    pub region: Option<&'a RegionVoxels>,
    /// Where the grid lies, in the unit of measures.
    pub measured: Placement,
    /// Components are looked for that are to be left out: no measures are made.
    pub is_search: bool,
    /// What to leave out, in this order.
    pub filters: &'a [Filter],
    /// Where the bands' memory is taken from.
    pub memory: &'a Arc<MemoryPool>,
}

impl<T: Voxel> BandSource<'_, T> {
    fn dims(&self) -> Dims {
        self.tiling.dims
    }

    /// An empty band.
    pub fn band(&self) -> Band<T>
    where
        T: Default,
    {
        Band {
            held: MemoryReservation::new(self.memory, BANDS),
            ..Band::default()
        }
    }

    /// Fills `band` with band `ty` of layer `tz`, and labels it.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`]; [`crate::Error::TooDense`] if the band is too dense for what is
    /// left of the memory.
    pub fn label(&self, ty: u32, tz: u32, band: &mut Band<T>) -> Result<()> {
        let span = span_of(self.tiling, ty, tz);
        let samples = span.with_neighbours(self.dims());
        let words = (span.nx as usize).div_ceil(64) * span.rows() * span.slices();
        // 8 bytes of bits, 4 of run numbers, and 8 again of what is inside
        let of_word = if self.region.is_some() { 20 } else { 12 };
        let fixed = (samples.voxels() * size_of::<T>() + words * of_word) as u64;
        band.held.grow_to(fixed)?;
        band.voxels.load(self.volume, samples)?;
        band.nan = count_nan(&band.voxels, &span);
        band.bits.classify(&band.voxels, span.clone(), self.ceil);
        band.runs.number(&band.bits);
        let mut of_run = std::mem::take(&mut band.labels.of_run);
        for filter in self.filters {
            (of_run, _) = label_runs(&band.bits, &band.runs, self.rule, of_run);
            filter.fill([ty, tz], &mut band.bits, &band.runs, &of_run)?;
            band.runs.number(&band.bits);
        }
        // a label for each run with room for a few more, and again those of the outer rows and slices
        let (runs, rows) = (band.runs.count, span.rows() * span.slices());
        let outer = 2 * (span.rows() + span.slices());
        let labels = 4 * (runs + runs / 16 + runs.div_ceil(rows) * outer) as u64;
        band.held.grow_to(fixed + labels)?;
        let (of_run, count) = label_runs(&band.bits, &band.runs, self.rule, of_run);
        band.held.grow_to(fixed + labels + component_bytes(count))?;
        band.labels = sum_voxels(&band.bits, of_run, count, self.dims(), &self.measured);
        if let Some(region) = self.region {
            band.inside.load(region, &span)?;
        }
        let inside = self.region.map(|_| &band.inside);
        if self.is_search {
            note_outside(&band.bits, &mut band.labels, inside);
        } else {
            add_border_euler(
                &band.bits,
                &band.runs,
                &mut band.labels,
                self.rule,
                self.dims(),
            );
            if let Some(inside) = inside {
                note_region_edge(&band.bits, &band.runs, &mut band.labels, inside, self.rule);
            }
        }
        band.edges = BandFaces::of(&band.bits, &band.runs, &band.labels, self.dims());
        band.keys_on_top = keys_on_top(&band.bits, &band.runs, &band.labels, self.dims());
        Ok(())
    }
}

/// The voxels of band `ty` of layer `tz`, without gradient neighbours.
pub fn span_of(tiling: Tiling, ty: u32, tz: u32) -> Span {
    let (y, z) = (tiling.cubes(1, ty), tiling.cubes(2, tz));
    Span {
        nx: tiling.dims.0[0],
        y: y.start..y.end + 1,
        z: z.start..z.end + 1,
    }
}

/// NaN samples in the rows and slices that no band or slab before owns.
fn count_nan<T: Voxel>(voxels: &Voxels<T>, span: &Span) -> u64 {
    if !T::DTYPE.is_float() {
        return 0;
    }
    let owned = |start: u32| if start == 0 { 0 } else { start + 1 };
    let mut count = 0;
    for z in owned(span.z.start)..span.z.end {
        for y in owned(span.y.start)..span.y.end {
            // only NaN differs from itself
            #[allow(clippy::eq_op)]
            let nan = voxels.row(y, z).iter().filter(|v| *v != *v).count();
            count += nan as u64;
        }
    }
    count
}
