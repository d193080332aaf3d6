//! Exact squared distances of a block: along z by the states of columns, then along x and y.
//!
//! The last two passes look at steps of 1, 2, ... to both sides until no step that far can help: exact, for up to 64
//! voxels at once, and for radii below about a hundred voxels faster than lower envelopes of parabolas, which go
//! voxel by voxel (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 8,
//! 2012). Rows beside the block are computed when a distance asks for them.

use super::bits::{Side, SolidBits, step};
use super::metric::Metric;
use crate::error::Result;
use crate::sys::simd::dispatch;
use bytemuck::Pod;
use std::ops::Range;

/// Voxels that are worked on at once.
const CHUNK: usize = 64;

/// A level as it is kept: two bytes where the cap allows it.
pub trait Level: Pod + Ord + Default + Send + Sync {
    /// A level, which fits.
    fn of(level: u32) -> Self;
    /// As a number.
    fn get(self) -> u32;
    /// The sum, or any other number from the cap on if that is more than the type holds.
    fn plus(self, more: Self) -> Self;
}

impl Level for u16 {
    #[inline(always)]
    fn of(level: u32) -> Self {
        level as u16
    }

    #[inline(always)]
    fn get(self) -> u32 {
        u32::from(self)
    }

    #[inline(always)]
    fn plus(self, more: Self) -> Self {
        self.saturating_add(more)
    }
}

impl Level for u32 {
    #[inline(always)]
    fn of(level: u32) -> Self {
        level
    }

    #[inline(always)]
    fn get(self) -> u32 {
        self
    }

    #[inline(always)]
    fn plus(self, more: Self) -> Self {
        // caps are below 2^21
        self.wrapping_add(more)
    }
}

/// Rows of slices: a part of the volume over its full width.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// Its slab.
    pub slab: u32,
    /// Its rows.
    pub y: Range<u32>,
    /// Its slices: those of the slab.
    pub z: Range<u32>,
}

/// Levels of a block and of one voxel around it on all sides; 0 for solid voxels and for those outside of the volume.
#[derive(Debug)]
pub struct Levels<T> {
    nx: usize,
    /// Rows of the block.
    rows: usize,
    /// By slice and row, one more on each side; rows have one voxel more at both ends.
    data: Vec<T>,
}

impl<T: Level> Levels<T> {
    /// All 0, in the memory of `data`.
    fn new(nx: usize, block: &Block, mut data: Vec<T>) -> Self {
        let voxels = (nx + 2) * (block.y.len() + 2) * (block.z.len() + 2);
        data.clear();
        data.resize(voxels, T::default());
        Levels {
            nx,
            rows: block.y.len(),
            data,
        }
    }

    /// Elements from a voxel to the next one along x, y and z.
    pub fn steps(&self) -> [usize; 3] {
        [1, self.nx + 2, (self.nx + 2) * (self.rows + 2)]
    }

    /// All elements.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// Where the first voxel of a row lies in [`Levels::data`]. Row and slice count from the one before the block.
    pub fn at(&self, r: usize, s: usize) -> usize {
        (s * (self.rows + 2) + r) * (self.nx + 2) + 1
    }

    /// The voxels of a row, likewise.
    pub fn row(&self, r: usize, s: usize) -> &[T] {
        &self.data[self.at(r, s)..][..self.nx]
    }
}

/// Memory that is used again from block to block: the system gives new memory page by page, which takes as long as the
/// distances themselves.
#[derive(Debug, Default)]
pub struct DistanceBuffers<T> {
    levels: Vec<T>,
    columns: Vec<u8>,
    plane: Vec<T>,
    bits: Vec<u64>,
}

impl<T: Level> DistanceBuffers<T> {
    /// Takes back the memory of levels that are not needed any more.
    pub fn take_back(&mut self, levels: Levels<T>) {
        self.levels = levels.data;
    }
}

/// The first elements of a vector that is made longer if it has fewer; what they are has no meaning.
fn room<V: Clone + Default>(of: &mut Vec<V>, len: usize) -> &mut [V] {
    if of.len() < len {
        // no page of a new one is touched yet
        *of = vec![V::default(); len];
    }
    &mut of[..len]
}

/// Computes the levels of a block and around it.
///
/// # Errors
/// [`crate::Error::Io`] if the bits cannot be read back.
pub fn levels<T: Level>(
    bits: &SolidBits,
    metric: &Metric,
    block: &Block,
    buffers: &mut DistanceBuffers<T>,
) -> Result<Levels<T>> {
    let [nx, ny, nz] = bits.grid().dims.0;
    let grown = |r: &Range<u32>, n: u32| r.start.saturating_sub(1)..(r.end + 1).min(n);
    let (y, z) = (grown(&block.y, ny), grown(&block.z, nz));
    let mut levels = Levels::new(nx as usize, block, std::mem::take(&mut buffers.levels));
    let mut planes = Planes::<T>::new(bits, metric, block, z.clone(), buffers);
    for slice in z.clone() {
        planes.begin(slice - z.start);
        for row in y.clone() {
            let at = levels.at(
                (row + 1 - block.y.start) as usize,
                (slice + 1 - block.z.start) as usize,
            );
            planes.finish_row(row, &mut levels.data[at..][..nx as usize])?;
        }
    }
    Ok(levels)
}

/// Distances within one slice, in rows that are made when they are needed.
struct Planes<'a, T> {
    bits: &'a SolidBits,
    metric: &'a Metric,
    slab: u32,
    /// Slices that are known.
    z: Range<u32>,
    /// Weighted squares of the steps along z.
    squares: Vec<T>,
    /// The first of the rows that can be needed.
    first: u32,
    /// Steps along z to solid voxels: for each row, those of all slices.
    columns: &'a mut [u8],
    /// Which groups of rows have them.
    has_columns: Vec<bool>,
    /// The bits of a group of rows, by slices, and its columns beside the slab.
    group_bits: &'a mut [u64],
    group_columns: Vec<u8>,
    /// The slice that is worked on, counted from the first.
    slice: usize,
    /// Its rows after the pass along x, of whole chunks.
    plane: &'a mut [T],
    /// Which of them are there.
    ready: Vec<bool>,
    /// A row with room for the farthest steps on both sides.
    padded: Vec<T>,
}

/// Rows whose bits are read at once.
const GROUP: usize = 16;

/// Room beside a row for the farthest steps, a chunk's width more than the reach.
const PAD: usize = 256;

impl<'a, T: Level> Planes<'a, T> {
    fn new(
        bits: &'a SolidBits,
        metric: &'a Metric,
        block: &Block,
        z: Range<u32>,
        buffers: &'a mut DistanceBuffers<T>,
    ) -> Self {
        let [nx, ny, _] = bits.grid().dims.0;
        let reach = u32::from(metric.reach()) + 1;
        let rows = block.y.start.saturating_sub(reach)..(block.y.end + reach).min(ny);
        let cap = u64::from(metric.cap());
        let square = |steps: u8| {
            let weight = u64::from(metric.step_levels()[2]);
            let level = weight * u64::from(steps) * u64::from(steps);
            match steps < metric.reach() {
                true => T::of(level.min(cap) as u32),
                false => T::of(cap as u32),
            }
        };
        let width = (nx as usize).next_multiple_of(CHUNK);
        let words = bits.grid().row_words();
        Planes {
            bits,
            metric,
            slab: block.slab,
            columns: room(&mut buffers.columns, nx as usize * z.len() * rows.len()),
            has_columns: vec![false; rows.len().div_ceil(GROUP)],
            group_bits: room(&mut buffers.bits, words * z.len() * GROUP),
            group_columns: Vec::new(),
            z,
            squares: (0..=u8::MAX).map(square).collect(),
            first: rows.start,
            slice: 0,
            plane: room(&mut buffers.plane, width * rows.len()),
            ready: vec![false; rows.len()],
            padded: vec![T::of(metric.cap()); width + 2 * PAD],
        }
    }

    /// Goes to a slice.
    fn begin(&mut self, slice: u32) {
        self.slice = slice as usize;
        self.ready.fill(false);
    }

    fn nx(&self) -> usize {
        self.bits.grid().dims.0[0] as usize
    }

    fn width(&self) -> usize {
        self.nx().next_multiple_of(CHUNK)
    }

    /// Makes a row, counted from the first, of the slice.
    fn make(&mut self, row: usize) -> Result<()> {
        if !self.has_columns[row / GROUP] {
            self.read_group(row / GROUP)?;
        }
        let (nx, width) = (self.nx(), self.width());
        let columns = &self.columns[(row * self.z.len() + self.slice) * nx..][..nx];
        let out = &mut self.plane[row * width..][..width];
        let [weight, ..] = self.metric.step_levels();
        let (reach, cap) = (self.metric.reach(), T::of(self.metric.cap()));
        match dispatch!(square_all(
            columns,
            reach,
            &self.squares,
            &mut self.padded[PAD..]
        )) {
            true => dispatch!(along_x(&self.padded, weight, out)),
            false => out.fill(cap),
        }
        // what is beyond the row's end is no distance
        out[nx..].fill(T::default());
        self.ready[row] = true;
        Ok(())
    }

    /// Finds the steps along z from each voxel of a group of rows, in all slices, to the nearest solid voxel.
    fn read_group(&mut self, group: usize) -> Result<()> {
        let (nx, words, slices) = (self.nx(), self.bits.grid().row_words(), self.z.len());
        let slab = self.bits.grid().slab(self.slab);
        let first = group * GROUP;
        let rows = GROUP.min(self.ready.len() - first);
        let y = self.first + first as u32..self.first + (first + rows) as u32;
        for (z, rows) in self.z.clone().zip(self.group_bits.chunks_mut(words * rows)) {
            self.bits.rows(y.clone(), z, rows)?;
        }
        self.group_columns.resize(2 * nx * rows, 0);
        let (before, behind) = self.group_columns.split_at_mut(nx * rows);
        self.bits
            .columns(y.clone(), self.slab, Side::Before, before)?;
        self.bits.columns(y, self.slab, Side::Behind, behind)?;
        let columns = before.chunks_mut(nx).zip(behind.chunks_mut(nx));
        let out = self.columns[first * slices * nx..].chunks_mut(slices * nx);
        for (row, ((before, behind), out)) in columns.zip(out).enumerate() {
            let of_slice = |s: usize| &self.group_bits[(s * rows + row) * words..][..words];
            let reach = self.metric.reach();
            // the state before the slab is that of the slice below it
            let forward = out.chunks_mut(nx).enumerate().zip(self.z.clone());
            dispatch!(pass_columns(
                forward.map(|((s, out), z)| (z >= slab.start, out, of_slice(s))),
                before,
                reach,
                |out, column| out.copy_from_slice(column),
            ));
            let backward = out.chunks_mut(nx).enumerate().zip(self.z.clone()).rev();
            dispatch!(pass_columns(
                backward.map(|((s, out), z)| (z < slab.end, out, of_slice(s))),
                behind,
                reach,
                |out, column| {
                    let pairs = out.iter_mut().zip(column);
                    pairs.for_each(|(out, &column)| *out = column.min(*out));
                },
            ));
        }
        self.has_columns[group] = true;
        Ok(())
    }

    /// The levels of a row of the slice.
    fn finish_row(&mut self, y: u32, out: &mut [T]) -> Result<()> {
        let row = (y - self.first) as usize;
        if !self.ready[row] {
            self.make(row)?;
        }
        let mut first = 0;
        while let Some(missing) = dispatch!(self.along_y(row, &mut first, out)) {
            self.make(missing)?;
        }
        Ok(())
    }

    /// The pass along y for the chunks of a row from `first` on. Returns a row that has to be made before it can go on
    /// from where `first` is then.
    #[inline(always)]
    fn along_y(&self, row: usize, first: &mut usize, out: &mut [T]) -> Option<usize> {
        let (width, weight) = (self.width(), self.metric.step_levels()[1]);
        let chunk = |row: usize, c: usize| -> &[T; CHUNK] {
            let chunk = self.plane[row * width + c * CHUNK..].first_chunk();
            chunk.expect("rows are of whole chunks")
        };
        for (c, out) in out.chunks_mut(CHUNK).enumerate().skip(*first) {
            *first = c;
            let mut best = *chunk(row, c);
            let mut most = greatest(&best);
            let mut k = 1;
            while squared(weight, k) < most {
                let more = T::of(squared(weight, k));
                // outside of the volume nothing is known to be solid
                for beside in [row.wrapping_sub(k), row + k] {
                    match self.ready.get(beside) {
                        Some(true) => lower(&mut best, chunk(beside, c), more),
                        Some(false) => return Some(beside),
                        None => {}
                    }
                }
                if k.is_multiple_of(4) {
                    most = greatest(&best);
                }
                k += 1;
            }
            out.copy_from_slice(&best[..out.len()]);
        }
        None
    }
}

/// Takes columns through rows, in the order given; where the flag is false, `column` holds the state of that row.
#[inline(always)]
fn pass_columns<'a>(
    rows: impl Iterator<Item = (bool, &'a mut [u8], &'a [u64])>,
    column: &mut [u8],
    reach: u8,
    mut put: impl FnMut(&mut [u8], &[u8]),
) {
    for (moves, found, bits) in rows {
        if moves {
            step(column, bits, reach);
        }
        put(found, column);
    }
}

/// Writes the levels of steps along z, of which `squares` has all; false if none is below the reach.
#[inline(always)]
fn square_all<T: Level>(columns: &[u8], reach: u8, squares: &[T], out: &mut [T]) -> bool {
    // steps are at most the reach, and the cap is its square
    match squares[1].get() {
        1 => {
            for (out, &steps) in out.iter_mut().zip(columns) {
                *out = T::of(u32::from(steps) * u32::from(steps));
            }
        }
        _ => {
            for (out, &steps) in out.iter_mut().zip(columns) {
                *out = squares[usize::from(steps)];
            }
        }
    }
    columns
        .iter()
        .fold(u8::MAX, |least, &steps| least.min(steps))
        < reach
}

/// The level of `k` steps along an axis; some steps beyond the reach, too.
#[inline(always)]
fn squared(weight: u32, k: usize) -> u32 {
    weight * (k * k) as u32
}

#[inline(always)]
fn greatest<T: Level>(levels: &[T; CHUNK]) -> u32 {
    let most = levels.iter().fold(T::default(), |a, &b| a.max(b));
    most.get()
}

#[inline(always)]
fn lower<T: Level>(best: &mut [T; CHUNK], from: &[T; CHUNK], more: T) {
    for (best, &from) in best.iter_mut().zip(from) {
        *best = from.plus(more).min(*best);
    }
}

/// The pass along x: `out[x]` is the least of `padded[PAD + x + k]` plus `weight` times the square of k.
#[inline(always)]
fn along_x<T: Level>(padded: &[T], weight: u32, out: &mut [T]) {
    for (c, out) in out.as_chunks_mut::<CHUNK>().0.iter_mut().enumerate() {
        let at = PAD + c * CHUNK;
        let from =
            |at: usize| -> &[T; CHUNK] { padded[at..].first_chunk().expect("there is room") };
        let mut best = *from(at);
        let mut most = greatest(&best);
        let mut k = 1;
        while squared(weight, k) < most {
            let more = T::of(squared(weight, k));
            lower(&mut best, from(at - k), more);
            lower(&mut best, from(at + k), more);
            if k.is_multiple_of(4) {
                most = greatest(&best);
            }
            k += 1;
        }
        *out = best;
    }
}
