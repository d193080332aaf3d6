//! A band whose components are known, with the samples that its surface needs.

use crate::convert::known_band::{KnownBand, KnownBands};
use crate::convert::label::span_of;
use crate::convert::memory::BANDS;
use crate::error::Result;
use crate::labels::{BandCells, CellRows, NeededRows, RowRuns, Run, Voxels};
use crate::surface::{Sizes, TileBox};
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::volume::{Volume, Voxel};
use std::sync::Arc;

/// A band to mesh; its buffers are used again.
#[derive(Debug, Default)]
pub struct MeshBand<T> {
    /// The rows of samples that the surface needs, with gradient neighbours; others have no meaning.
    pub voxels: Voxels<T>,
    /// Bits, runs and components.
    pub known: KnownBand,
    /// The cells of its voxels, where these are given.
    pub cells: BandCells,
    /// The cell of each component, if all voxels of it that are here are in one.
    pub cell_of_class: Vec<Option<u64>>,
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
    /// Bits and components.
    pub known: KnownBands<'a>,
    /// The cells of voxels, where these are given.
    pub cells: Option<&'a CellRows>,
    /// Tiles without a surface may have caps.
    pub cap: bool,
    /// Where the bands' memory is taken from.
    pub memory: &'a Arc<MemoryPool>,
}

/// Finds the components of which all voxels in a band are in one cell.
fn cells_of_classes(known: &KnownBand, cells: &BandCells, out: &mut Vec<Option<u64>>) {
    let bits = &known.bits;
    out.clear();
    out.resize(known.components.len(), None);
    let mut seen = vec![false; out.len()];
    let mut run_number = 0;
    for row in 0..bits.span.rows() * bits.span.slices() {
        let words = &bits.words[row * bits.row_words..][..bits.row_words];
        for Run { start, end, above } in RowRuns::new(words, bits.span.nx) {
            let class = known.class_of_run[run_number] as usize;
            run_number += 1;
            if !above {
                cells.for_each_in(row, [start, end], |_, _, cell| {
                    match std::mem::replace(&mut seen[class], true) {
                        false => out[class] = Some(cell),
                        true => out[class] = out[class].filter(|known| *known == cell),
                    }
                });
            }
        }
    }
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
        let tiling = self.known.tiling;
        let [tiles_x, ..] = tiling.tiles();
        let number = self.known.number([ty, tz]);
        let stored = self.known.kept;
        let kept = stored.get(number)?;
        if !kept.has_surface() && !self.cap {
            return Ok(Vec::new());
        }
        let span = span_of(tiling, ty, tz);
        let samples = span.with_neighbours(tiling.dims);
        let fixed = (samples.voxels() * size_of::<T>()) as u64;
        let fixed = fixed + KnownBands::bytes(&kept, &span);
        band.held.grow_to(fixed)?;
        let kinds = stored.kinds(&kept, &span)?;
        let needed = NeededRows::of(&kinds, &span, &samples);
        stored.samples(&kept, self.volume, &needed, samples, &mut band.voxels)?;
        if let Some(cells) = self.cells {
            cells.load(&span, &mut band.cells)?;
            band.held
                .grow_to(fixed + band.cells.bytes() + 16 * kept.components())?;
        }
        self.known
            .load(number, &kept, &kinds, span, &mut band.known)?;
        if self.cells.is_some() {
            cells_of_classes(&band.known, &band.cells, &mut band.cell_of_class);
        }
        let tiles = 0..tiles_x;
        let boxes = tiles.clone().map(|tx| TileBox::of(tiling, [tx, ty, tz]));
        band.sizes.clear();
        band.sizes
            .extend(boxes.map(|tile| Sizes::of(&band.known.bits, &tile)));
        let has_any = |&tx: &u32| band.sizes[tx as usize].vertices > 0 || self.cap;
        let mut tiles: Vec<u32> = tiles.filter(has_any).collect();
        tiles
            .sort_by_key(|&tx| std::cmp::Reverse(band.sizes[tx as usize].vertices.checked_ilog2()));
        Ok(tiles)
    }
}
