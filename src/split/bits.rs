//! Which voxels are solid, and how far each column has been without one: bits on the disk, read once from the source.
//!
//! Distances along z come first. Before each slab lies, for each column, how many slices below it the nearest solid
//! voxel is, behind it how many above: then any part of the slab computes its distances alone.

use super::{BitSource, SlabGrid};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sys::simd::dispatch;
use crate::sys::temp_file::unnamed;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// The bits of a word as bytes: 0xff for each voxel of air. Written so that it is made of shuffles of whole vectors: eight
/// bytes at a time from a table took ten times as long.
#[inline(always)]
fn air(word: u64) -> [u8; 64] {
    let bytes = word.to_le_bytes();
    std::array::from_fn(|x| match bytes[x / 8] & 1 << (x % 8) {
        0 => u8::MAX,
        _ => 0,
    })
}

/// Moves columns on by a slice: steps to the last solid voxel, at most `reach`. `columns` has one byte for each voxel
/// of the row.
#[inline(always)]
pub fn step(columns: &mut [u8], row: &[u64], reach: u8) {
    let moved = |column: u8, air: u8| column.saturating_add(1).min(reach) & air;
    let (whole, rest) = columns.as_chunks_mut::<64>();
    for (columns, &word) in whole.iter_mut().zip(row) {
        let air = air(word);
        for x in 0..64 {
            columns[x] = moved(columns[x], air[x]);
        }
    }
    let last = row.get(whole.len()).map_or([0; 64], |&word| air(word));
    for (column, air) in rest.iter_mut().zip(last) {
        *column = moved(*column, air);
    }
}

/// Where a column was left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Below the slab.
    Before,
    /// Above it.
    Behind,
}

/// The bits and the states of columns before and behind each slab, in unnamed files.
#[derive(Debug)]
pub struct SolidBits {
    grid: SlabGrid,
    dir: PathBuf,
    /// Rows by z and y, each of whole words.
    bits: File,
    /// Slices of one byte a column: before slab 0, behind slab 0, before slab 1, ...
    columns: File,
}

impl SolidBits {
    /// Reads all bits of a source.
    ///
    /// # Errors
    /// [`Error::Io`], what the source returns, and [`Error::Interrupted`].
    pub fn gather(
        source: &mut dyn BitSource,
        grid: SlabGrid,
        reach: u8,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let made = || unnamed(dir).map_err(|e| failed(dir, e));
        let kept = SolidBits {
            grid,
            dir: dir.to_path_buf(),
            bits: made()?,
            columns: made()?,
        };
        let [_, ny, nz] = grid.dims.0;
        let mut columns = kept.unknown(reach);
        let mut words = vec![0; grid.row_words() * ny as usize];
        for z in 0..nz {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            if z.is_multiple_of(grid.height) {
                kept.write_columns(z / grid.height, Side::Before, &columns)?;
            }
            source.slice(z, &mut words)?;
            kept.write(&kept.bits, bytemuck::cast_slice(&words), kept.bits_at(0, z))?;
            kept.step_slice(&mut columns, &words, reach);
            progress.advance(1);
        }
        let mut columns = kept.unknown(reach);
        for z in (0..nz).rev() {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            if z + 1 == nz || (z + 1).is_multiple_of(grid.height) {
                kept.write_columns(z / grid.height, Side::Behind, &columns)?;
            }
            kept.rows(0..ny, z, &mut words)?;
            kept.step_slice(&mut columns, &words, reach);
        }
        Ok(kept)
    }

    /// How the volume is cut.
    pub fn grid(&self) -> SlabGrid {
        self.grid
    }

    /// Columns of which no solid voxel is known.
    fn unknown(&self, reach: u8) -> Vec<u8> {
        vec![reach; self.grid.dims.slice_voxels() as usize]
    }

    fn step_slice(&self, columns: &mut [u8], words: &[u64], reach: u8) {
        let rows = columns.chunks_mut(self.grid.dims.0[0] as usize);
        dispatch!(step_rows(
            rows.zip(words.chunks(self.grid.row_words())),
            reach
        ));
    }

    fn bits_at(&self, y: u32, z: u32) -> u64 {
        let row = u64::from(z) * u64::from(self.grid.dims.0[1]) + u64::from(y);
        row * 8 * self.grid.row_words() as u64
    }

    fn columns_at(&self, y: u32, slab: u32, side: Side) -> u64 {
        let slice = 2 * u64::from(slab) + u64::from(side == Side::Behind);
        slice * self.grid.dims.slice_voxels() + u64::from(y) * u64::from(self.grid.dims.0[0])
    }

    fn write_columns(&self, slab: u32, side: Side, columns: &[u8]) -> Result<()> {
        self.write(&self.columns, columns, self.columns_at(0, slab, side))
    }

    fn write(&self, file: &File, bytes: &[u8], at: u64) -> Result<()> {
        let written = file.write_all_at(bytes, at);
        written.map_err(|e| failed(&self.dir, e))
    }

    /// Reads the bits of rows of a slice; `out` has the words of all of them.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn rows(&self, y: Range<u32>, z: u32, out: &mut [u64]) -> Result<()> {
        debug_assert_eq!(out.len(), y.len() * self.grid.row_words());
        let bytes = bytemuck::cast_slice_mut(out);
        let read = self.bits.read_exact_at(bytes, self.bits_at(y.start, z));
        read.map_err(|e| failed(&self.dir, e))
    }

    /// Reads the states of the columns of rows on one side of a slab; `out` has a byte for each.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn columns(&self, y: Range<u32>, slab: u32, side: Side, out: &mut [u8]) -> Result<()> {
        debug_assert_eq!(out.len(), y.len() * self.grid.dims.0[0] as usize);
        let read = self
            .columns
            .read_exact_at(out, self.columns_at(y.start, slab, side));
        read.map_err(|e| failed(&self.dir, e))
    }
}

#[inline(always)]
fn step_rows<'a>(rows: impl Iterator<Item = (&'a mut [u8], &'a [u64])>, reach: u8) {
    // a loop: what `for_each` calls would be compiled for any processor
    for (columns, row) in rows {
        step(columns, row, reach);
    }
}

fn failed(dir: &Path, e: std::io::Error) -> Error {
    Error::io(dir, "keep what is solid in a temporary file", e)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_steps_from_solid_voxels() {
        let mut columns = vec![3; 130];
        let row: Vec<u64> = vec![1 << 63 | 1, 0, 2];
        step(&mut columns, &row, 9);
        let solid = |x: usize| row[x / 64] >> (x % 64) & 1 == 1;
        let expected: Vec<u8> = (0..130).map(|x| if solid(x) { 0 } else { 4 }).collect();
        assert_eq!(columns, expected);
        for _ in 0..300 {
            step(&mut columns, &[0; 3], u8::MAX);
        }
        assert_eq!(columns, [u8::MAX; 130]);
    }
}
