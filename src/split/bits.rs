//! Which voxels are solid, and how far each column has been without one: bits on the disk, read once from the source.
//!
//! Distances along z come first. Before each slab lies, for each column, how many slices below it the nearest solid
//! voxel is, behind it how many above: then any part of the slab computes its distances alone.

use super::{BitSource, SlabGrid};
use crate::error::{Error, Result};
use crate::grid::Dims;
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

/// The states of the columns of a slice, a byte for each voxel: steps to the last solid one, at most the reach.
pub type Columns = Vec<u8>;

/// The states of columns in the slice below and in the one above some slices; unknown where there is none.
#[derive(Debug, Clone)]
pub struct Beside {
    /// In the slice below: how far it is down to a solid voxel.
    pub before: Columns,
    /// In the slice above: how far it is up.
    pub behind: Columns,
}

impl Beside {
    /// Of columns of which no solid voxel is known.
    pub fn unknown(dims: Dims, reach: u8) -> Self {
        let columns = vec![reach; dims.slice_voxels() as usize];
        Beside {
            before: columns.clone(),
            behind: columns,
        }
    }
}

/// The bits and the states of columns before and behind each slab, in unnamed files.
#[derive(Debug)]
pub struct SolidBits {
    grid: SlabGrid,
    dir: PathBuf,
    /// Rows by z and y, each of whole words, from the slice below the first one on.
    bits: File,
    /// Slices of one byte a column: before slab 0, behind slab 0, before slab 1, ...
    columns: File,
}

impl SolidBits {
    /// Reads all bits of a source, of whose columns `beside` is known.
    ///
    /// # Errors
    /// [`Error::Io`], what the source returns, and [`Error::Interrupted`].
    pub fn gather(
        source: &mut dyn BitSource,
        grid: SlabGrid,
        reach: u8,
        beside: Beside,
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
        let ny = grid.dims.0[1];
        let ([first, end], [is_below, is_above]) = (grid.slices, grid.goes_on());
        let mut words = vec![0; grid.row_words() * ny as usize];
        let sides = [
            (is_below, &beside.before, first.wrapping_sub(1)),
            (is_above, &beside.behind, end),
        ];
        for (_, columns, z) in sides.into_iter().filter(|side| side.0) {
            kept.solid_of(columns, &mut words);
            kept.write(&kept.bits, bytemuck::cast_slice(&words), kept.bits_at(0, z))?;
        }
        let mut columns = beside.before;
        for z in first..end {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let [slab, s] = grid.slab_of(z);
            if s == 0 {
                kept.write_columns(slab, Side::Before, &columns)?;
            }
            source.slice(z, &mut words)?;
            kept.write(&kept.bits, bytemuck::cast_slice(&words), kept.bits_at(0, z))?;
            kept.step_slice(&mut columns, &words, reach);
            progress.advance(1);
        }
        let mut columns = beside.behind;
        for z in (first..end).rev() {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let [slab, s] = grid.slab_of(z);
            if z + 1 == end || s + 1 == grid.height {
                kept.write_columns(slab, Side::Behind, &columns)?;
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

    /// The bits of a slice whose columns are in these states.
    fn solid_of(&self, columns: &[u8], words: &mut [u64]) {
        words.fill(0);
        let rows = columns.chunks(self.grid.dims.0[0] as usize);
        for (row, words) in rows.zip(words.chunks_mut(self.grid.row_words())) {
            for (x, _) in row.iter().enumerate().filter(|(_, steps)| **steps == 0) {
                words[x / 64] |= 1 << (x % 64);
            }
        }
    }

    fn step_slice(&self, columns: &mut [u8], words: &[u64], reach: u8) {
        step_slice(&self.grid, columns, words, reach);
    }

    fn bits_at(&self, y: u32, z: u32) -> u64 {
        // the slice below the first one is there, too
        let slice = (z + 1).wrapping_sub(self.grid.slices[0]);
        let row = u64::from(slice) * u64::from(self.grid.dims.0[1]) + u64::from(y);
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

/// Moves the columns of a slice on by a slice with these bits.
fn step_slice(grid: &SlabGrid, columns: &mut [u8], words: &[u64], reach: u8) {
    let rows = columns.chunks_mut(grid.dims.0[0] as usize);
    dispatch!(step_rows(rows.zip(words.chunks(grid.row_words())), reach));
}

/// What passing some slices does to the states of columns, whatever these were: upwards and downwards.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Passage {
    /// How many slices there are.
    pub slices: u32,
    /// From the last one down to a solid voxel of theirs, at most the reach.
    pub up: Columns,
    /// From the first one up.
    pub down: Columns,
}

impl Passage {
    /// That of the slices of a grid.
    ///
    /// # Errors
    /// What the source returns, and [`Error::Interrupted`].
    pub fn of(
        source: &mut dyn BitSource,
        grid: SlabGrid,
        reach: u8,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let [first, end] = grid.slices;
        let Beside { before, behind } = Beside::unknown(grid.dims, reach);
        let (mut up, mut down) = (before, behind);
        let (nx, row_words) = (grid.dims.0[0] as usize, grid.row_words());
        let mut words = vec![0; row_words * grid.dims.0[1] as usize];
        let mut seen = words.clone();
        for z in first..end {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            source.slice(z, &mut words)?;
            step_slice(&grid, &mut up, &words, reach);
            let steps = (z - first).min(reach.into()) as u8;
            for (at, (&word, seen)) in words.iter().zip(&mut seen).enumerate() {
                let mut new = word & !*seen;
                *seen |= word;
                while new != 0 {
                    let x = at % row_words * 64 + new.trailing_zeros() as usize;
                    down[at / row_words * nx + x] = steps;
                    new &= new - 1;
                }
            }
        }
        Ok(Passage {
            slices: end - first,
            up,
            down,
        })
    }
}

/// Takes columns through slices that have such a passage in their direction: whichever solid voxel is nearer.
pub fn pass(columns: &mut [u8], passage: &[u8], slices: u32, reach: u8) {
    let slices = slices.min(reach.into()) as u8;
    for (column, &nearest) in columns.iter_mut().zip(passage) {
        *column = nearest.min(column.saturating_add(slices).min(reach));
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
    use crate::progress::Quiet;

    struct Slices(Vec<Vec<u64>>);

    impl BitSource for Slices {
        fn slice(&mut self, z: u32, words: &mut [u64]) -> Result<()> {
            words.copy_from_slice(&self.0[z as usize]);
            Ok(())
        }
    }

    #[test]
    fn passages_one_after_the_other_are_those_of_all() {
        let dims = Dims([70, 3, 23]);
        let mut state = 1u64;
        let mut sparse = || {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(11);
            (state >> 7) & (state >> 23) & (state >> 40) & ((1 << 6) - 1)
        };
        let mut slices = Slices(
            (0..23)
                .map(|_| (0..6).map(|_| sparse()).collect())
                .collect(),
        );
        for reach in [1, 4, 9, u8::MAX] {
            let of = |slices: &mut Slices, range: Range<u32>| {
                let grid = SlabGrid::fitting(dims, 1 << 20, 1).of_slices(range);
                Passage::of(slices, grid, reach, &Quiet).unwrap()
            };
            let whole = of(&mut slices, 0..23);
            for cuts in [vec![0, 23], vec![0, 1, 2, 23], vec![0, 5, 12, 13, 23]] {
                let parts: Vec<Passage> = cuts
                    .windows(2)
                    .map(|c| of(&mut slices, c[0]..c[1]))
                    .collect();
                let Beside {
                    before: mut up,
                    behind: mut down,
                } = Beside::unknown(dims, reach);
                parts
                    .iter()
                    .for_each(|part| pass(&mut up, &part.up, part.slices, reach));
                let behind = parts.iter().rev();
                behind.for_each(|part| pass(&mut down, &part.down, part.slices, reach));
                assert_eq!((&up, &down), (&whole.up, &whole.down), "{reach} {cuts:?}");
            }
        }
    }

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
