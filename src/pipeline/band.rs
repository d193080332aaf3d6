//! One band of a slab, read, classified and labelled.

use crate::error::Result;
use crate::grid::{Ambiguous, Dims, Tiling};
use crate::segment::{BandEdges, Labels, Runs, UnionFind, add_border_euler, label};
use crate::slab::{Bits, Span, Voxels};
use crate::volume::{Volume, Voxel};

/// Everything about a band; its buffers are reused from slab to slab.
#[derive(Debug, Default)]
pub struct Band<T> {
    /// Samples with gradient neighbours.
    pub voxels: Voxels<T>,
    /// Bits.
    pub bits: Bits,
    /// Runs.
    pub runs: Runs,
    /// Components; the labels of runs turn from local components to classes once these are known.
    pub labels: Labels,
    /// What joins it to its neighbours.
    pub edges: BandEdges,
    /// NaN samples among the voxels that the band owns.
    pub nan: u64,
    /// Scratch of the labelling.
    pub sets: UnionFind,
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
}

impl<T: Voxel> BandSource<'_, T> {
    /// The voxels of band `ty` of layer `tz`, without gradient neighbours.
    pub fn span(&self, ty: u32, tz: u32) -> Span {
        let (y, z) = (self.tiling.cubes(1, ty), self.tiling.cubes(2, tz));
        Span {
            nx: self.dims().0[0],
            y: y.start..y.end + 1,
            z: z.start..z.end + 1,
        }
    }

    fn dims(&self) -> Dims {
        self.tiling.dims
    }

    /// Fills `band` with band `ty` of layer `tz`.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`].
    pub fn prepare(&self, ty: u32, tz: u32, band: &mut Band<T>) -> Result<()> {
        let span = self.span(ty, tz);
        band.voxels
            .load(self.volume, span.with_neighbours(self.dims()))?;
        band.nan = count_nan(&band.voxels, &span);
        band.bits.classify(&band.voxels, span, self.ceil);
        band.runs.number(&band.bits);
        band.labels = label(
            &band.bits,
            &band.runs,
            self.rule,
            self.dims(),
            &mut band.sets,
        );
        add_border_euler(
            &band.bits,
            &band.runs,
            &mut band.labels,
            self.rule,
            self.dims(),
        );
        band.edges = BandEdges::of(&band.bits, &band.runs, &band.labels);
        Ok(())
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
