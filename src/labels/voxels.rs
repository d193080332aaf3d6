//! The voxels of a band, with the neighbours that gradients need.
//!
//! They are copied, also from a mapped file, so that memory holds one slab and a few bands and not two slabs.

use crate::error::Result;
use crate::grid::Dims;
use crate::labels::{NeededRows, RowStretch};
use crate::volume::{Volume, Voxel};
use std::ops::Range;

/// Rows and slices of a grid over its full width, in voxels of the grid.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Span {
    /// Voxels along x: always 0..nx.
    pub nx: u32,
    /// Rows.
    pub y: Range<u32>,
    /// Slices.
    pub z: Range<u32>,
}

impl Span {
    /// Number of rows per slice.
    pub fn rows(&self) -> usize {
        self.y.len()
    }

    /// Number of slices.
    pub fn slices(&self) -> usize {
        self.z.len()
    }

    /// The span with one more row and slice on every side, inside the grid.
    pub fn with_neighbours(&self, dims: Dims) -> Span {
        let grow = |r: &Range<u32>, n: u32| r.start.saturating_sub(1)..(r.end + 1).min(n);
        Span {
            nx: self.nx,
            y: grow(&self.y, dims.0[1]),
            z: grow(&self.z, dims.0[2]),
        }
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.nx as usize * self.rows() * self.slices()
    }
}

/// Samples of a span.
#[derive(Debug, Clone, Default)]
pub struct Voxels<T> {
    /// What is covered.
    pub span: Span,
    /// The samples, and what is left of a larger span before.
    memory: Vec<T>,
    /// Number of samples.
    count: usize,
}

impl<T: Voxel> Voxels<T> {
    /// Reads `span` from the volume into this buffer.
    ///
    /// # Errors
    /// Those of [`Volume::read_box`].
    pub fn load(&mut self, volume: &dyn Volume, span: Span) -> Result<()> {
        self.make_room(&span);
        let bytes = bytemuck::cast_slice_mut(&mut self.memory[..self.count]);
        volume.read_box(0..span.nx, span.y.clone(), span.z.clone(), bytes)?;
        self.span = span;
        Ok(())
    }

    /// Reads these rows of `span` into this buffer, stretch by stretch; others have no meaning.
    ///
    /// # Errors
    /// What `read` returns.
    pub fn load_rows(
        &mut self,
        span: Span,
        rows: &NeededRows,
        mut read: impl FnMut(&RowStretch, &mut [u8]) -> Result<()>,
    ) -> Result<()> {
        self.make_room(&span);
        self.span = span;
        for stretch in &rows.parts {
            let place = self.place_of(stretch);
            read(stretch, bytemuck::cast_slice_mut(&mut self.memory[place]))?;
        }
        Ok(())
    }

    /// The samples of some rows, which must be inside the span.
    pub fn of_rows(&self, rows: &RowStretch) -> &[T] {
        &self.samples()[self.place_of(rows)]
    }

    fn place_of(&self, rows: &RowStretch) -> Range<usize> {
        let start = self.row_start(rows.y.start, rows.z.start);
        start..start + self.span.nx as usize * rows.y.len() * rows.z.len()
    }

    /// Makes room for the samples of a span.
    fn make_room(&mut self, span: &Span) {
        let count = span.voxels();
        if self.memory.is_empty() {
            // as the system has it, zero before it is touched
            self.memory = vec![T::zeroed(); count];
        } else if self.memory.len() < count {
            self.memory.resize(count, T::zeroed());
        }
        self.count = count;
    }

    /// The samples of a span, x fastest.
    #[cfg(test)]
    pub fn of(span: Span, samples: Vec<T>) -> Self {
        assert_eq!(samples.len(), span.voxels());
        let (memory, count) = (samples, span.voxels());
        Voxels {
            span,
            memory,
            count,
        }
    }

    /// The samples, x fastest.
    pub fn samples(&self) -> &[T] {
        &self.memory[..self.count]
    }

    /// Index of voxel (0, y, z), which must be inside the span.
    pub fn row_start(&self, y: u32, z: u32) -> usize {
        let row =
            (z - self.span.z.start) as usize * self.span.rows() + (y - self.span.y.start) as usize;
        row * self.span.nx as usize
    }

    /// Row (y, z) in grid coordinates.
    pub fn row(&self, y: u32, z: u32) -> &[T] {
        let start = self.row_start(y, z);
        &self.samples()[start..start + self.span.nx as usize]
    }
}
