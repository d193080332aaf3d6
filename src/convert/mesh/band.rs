//! A band whose components are known, with the samples that its surface needs.

use crate::convert::label::{KeptBands, span_of};
use crate::convert::memory::BANDS;
use crate::convert::resolve::{BandIds, ComponentId};
use crate::error::Result;
use crate::grid::Tiling;
use crate::labels::{Bits, NeededRows, Runs, Voxels};
use crate::surface::{Sizes, TileBox};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::volume::{Volume, Voxel};
use std::sync::Arc;

/// A band to mesh; its buffers are used again.
#[derive(Debug, Default)]
pub struct MeshBand<T> {
    /// The rows of samples that the surface needs, with gradient neighbours; others have no meaning.
    pub voxels: Voxels<T>,
    /// Bits.
    pub bits: Bits,
    /// Runs.
    pub runs: Runs,
    /// Place in `components` of each run.
    pub class_of_run: Vec<u32>,
    /// The components of the whole volume that have voxels here.
    pub components: Vec<ComponentId>,
    /// What its tiles need, by rising x.
    pub sizes: Vec<Sizes>,
    /// The memory of all this.
    held: MemoryReservation,
}

/// What bands are loaded from.
#[derive(Clone, Copy)]
pub struct BandLoader<'a> {
    /// The grid's samples.
    pub volume: &'a dyn Volume,
    /// The macrocubes.
    pub tiling: Tiling,
    /// Bits, and local components of runs.
    pub kept: &'a KeptBands,
    /// The components of the whole volume that these are.
    pub ids: &'a BandIds,
    /// Tiles without a surface may have caps.
    pub cap: bool,
    /// Where the bands' memory is taken from.
    pub memory: &'a Arc<MemoryPool>,
}

impl BandLoader<'_> {
    /// An empty band.
    pub fn band<T: Default>(&self) -> MeshBand<T> {
        MeshBand {
            held: MemoryReservation::new(self.memory, BANDS),
            ..MeshBand::default()
        }
    }

    /// Fills `band` with band `ty` of layer `tz`. Returns its tiles that have something to mesh, by x: large ones first, so
    /// that no thread is left with one when the others have none.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`]; [`crate::Error::TooDense`]; [`crate::Error::Io`].
    pub fn load<T: Voxel>(&self, [ty, tz]: [u32; 2], band: &mut MeshBand<T>) -> Result<Vec<u32>> {
        let [tiles_x, bands, _] = self.tiling.tiles();
        let number = u64::from(tz) * u64::from(bands) + u64::from(ty);
        let kept = self.kept.get(number)?;
        if !kept.has_surface() && !self.cap {
            return Ok(Vec::new());
        }
        let span = span_of(self.tiling, ty, tz);
        let samples = span.with_neighbours(self.tiling.dims);
        let rows = span.rows() * span.slices();
        let words = (span.nx as usize).div_ceil(64) * rows;
        // 8 bytes of bits, and again while they are read, 4 of run numbers
        let fixed = samples.voxels() * size_of::<T>() + words * 20;
        // a class for each run, and its label while that is read; the number of each component, and its place
        let labels = 8 * kept.runs() + 40 * kept.components();
        band.held.grow_to(fixed as u64 + labels)?;
        let kinds = self.kept.kinds(&kept, &span)?;
        let needed = NeededRows::of(&kinds, &span, &samples);
        self.kept
            .samples(&kept, self.volume, &needed, samples, &mut band.voxels)?;
        let mixed = self.kept.mixed(&kept)?;
        kinds.fill(&mut band.bits, span, &mixed);
        drop(mixed);
        band.runs.number(&band.bits);
        let class_of = self.classes(number, band)?;
        band.class_of_run.clear();
        band.class_of_run.reserve_exact(band.runs.count);
        match kept.has_surface() {
            true => self.kept.labels(&kept, |label| {
                band.class_of_run.push(class_of[label as usize]);
            })?,
            false => band.class_of_run.resize(band.runs.count, class_of[0]),
        }
        let tiles = 0..tiles_x;
        let boxes = tiles
            .clone()
            .map(|tx| TileBox::of(self.tiling, [tx, ty, tz]));
        band.sizes.clear();
        band.sizes
            .extend(boxes.map(|tile| Sizes::of(&band.bits, &tile)));
        let has_any = |&tx: &u32| band.sizes[tx as usize].vertices > 0 || self.cap;
        let mut tiles: Vec<u32> = tiles.filter(has_any).collect();
        tiles
            .sort_by_key(|&tx| std::cmp::Reverse(band.sizes[tx as usize].vertices.checked_ilog2()));
        Ok(tiles)
    }

    /// Finds the components of a band, and returns the place of each local one among them.
    fn classes<T>(&self, number: u64, band: &mut MeshBand<T>) -> Result<Vec<u32>> {
        let of_local = self.ids.get(number)?;
        let mut order: Vec<u32> = (0..of_local.len() as u32).collect();
        order.sort_unstable_by_key(|&local| of_local[local as usize].surface);
        let mut class_of = vec![0; of_local.len()];
        band.components.clear();
        for local in order {
            let id = of_local[local as usize];
            if band.components.last() != Some(&id) {
                band.components.push(id);
            }
            class_of[local as usize] = band.components.len() as u32 - 1;
        }
        Ok(class_of)
    }
}
