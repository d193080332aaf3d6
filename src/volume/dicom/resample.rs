//! Slices at uneven steps or shifted sideways as a regular grid, by linear interpolation.
//!
//! A voxel of the grid lies between two slices; in each of them it lies between four pixels. So two
//! frames at a time are all that is read. Outside of a slice there is the fill.

use super::super::paged::{Cut, Page, Pages};
use super::super::{Dtype, Voxel, with_voxel_type};
use super::order::{Place, Stack};
use super::pixel::Frames;
use crate::error::{Error, Result};
use crate::grid::{Dims, MAX_DIM, Placement};
use std::ops::Range;
use std::path::Path;

/// The grid on which slices are interpolated.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Grid {
    pub(super) size: [u32; 3],
    pub(super) placement: Placement,
    /// Pixel of a slice without shift that the grid's first voxel is at: 0 or below.
    start: [f64; 2],
    step: f64,
}

impl Grid {
    /// A grid that holds all slices, with the finest step between them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if it would be far larger than the slices are.
    pub(super) fn over(path: &Path, stack: &Stack, size: [u32; 2]) -> Result<Grid> {
        let span = stack.places.last().map_or(0.0, |p| p.depth);
        let count = (span / stack.finest_step()).round().max(1.0);
        let step = span / count;
        let ends = [0, 1].map(|a| {
            let shifts = stack.places.iter().map(|p| p.aside[a]);
            let low = shifts.clone().fold(0.0, f64::min);
            let high = shifts.fold(0.0, f64::max);
            // a shift by rounding does not make the grid larger
            let slack = 0.01;
            (
                (low + slack).floor().min(0.0),
                (high - slack).ceil().max(0.0),
            )
        });
        let wide = [0, 1].map(|a| f64::from(size[a]) + ends[a].1 - ends[a].0);
        let all = [wide[0], wide[1], count + 1.0];
        let far = (0..2).any(|a| wide[a] > 4.0 * f64::from(size[a]));
        if far || all.iter().any(|n| n.is_nan() || *n > f64::from(MAX_DIM)) {
            let what = format!(
                "a regular grid of {:.0} x {:.0} x {:.0} voxels",
                all[0], all[1], all[2]
            );
            let hint = "the slices lie too far aside of each other, or too close together";
            return Err(Error::unsupported(path, what, hint));
        }
        let start = ends.map(|(low, _)| low);
        let mut placement = stack.placement;
        placement.origin = placement.world([start[0], start[1], 0.0]);
        placement.spacing[2] = step;
        Ok(Grid {
            size: all.map(|n| n as u32),
            placement,
            start,
            step,
        })
    }

    pub(super) fn dims(&self) -> Result<Dims> {
        Dims::new(self.size.map(u64::from))
    }
}

/// The slices of a regular grid.
pub(super) struct Resampled {
    pub(super) inner: Frames,
    pub(super) places: Vec<Place>,
    pub(super) grid: Grid,
    /// The value outside of the slices.
    pub(super) fill: f64,
}

impl Pages for Resampled {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        let depth = f64::from(k) * self.grid.step;
        let after = self.places.partition_point(|p| p.depth <= depth);
        let low = after.clamp(1, self.places.len() - 1) - 1;
        let [a, b] = [self.places[low], self.places[low + 1]];
        let part = ((depth - a.depth) / (b.depth - a.depth)).clamp(0.0, 1.0);
        Ok(Box::new(Between {
            owner: self,
            slices: [(low as u32, 1.0 - part), (low as u32 + 1, part)],
        }))
    }

    fn largest(&self) -> (u64, u32) {
        let (voxels, rows) = self.inner.largest();
        if rows == 0 {
            return (0, 0);
        }
        let [x, y, _] = self.grid.size.map(u64::from);
        // both frames beside the page itself
        (x * y + 2 * voxels, self.grid.size[1])
    }
}

/// A slice of the grid, between two of the slices with their shares.
struct Between<'a> {
    owner: &'a Resampled,
    slices: [(u32, f64); 2],
}

impl Page for Between<'_> {
    fn cut(&self) -> Cut {
        Cut {
            width: self.owner.grid.size[0],
            rows: self.owner.grid.size[1],
            padded: false,
        }
    }

    fn decode(&self, _: u32, out: &mut [u8]) -> Result<()> {
        let y = 0..self.owner.grid.size[1];
        with_voxel_type!(self.owner.inner.dtype, T => self.mix::<T>(y, out))
    }

    fn rows(&self, y: Range<u32>, out: &mut [u8]) -> Result<bool> {
        if self.owner.inner.largest().1 > 0 {
            return Ok(false);
        }
        with_voxel_type!(self.owner.inner.dtype, T => self.mix::<T>(y, out))?;
        Ok(true)
    }
}

impl Between<'_> {
    fn mix<T: Voxel>(&self, y: Range<u32>, out: &mut [u8]) -> Result<()> {
        let width = self.owner.grid.size[0] as usize;
        let mut sums = vec![0.0f64; width * y.len()];
        for (slice, share) in self.slices {
            if share > 0.0 {
                self.add::<T>(slice, share, y.clone(), &mut sums)?;
            }
        }
        let dtype = self.owner.inner.dtype;
        for (out, sum) in out.chunks_exact_mut(dtype.bytes()).zip(sums) {
            put(dtype, sum, out);
        }
        Ok(())
    }

    /// Adds the share of a slice to rows `y` of the grid.
    fn add<T: Voxel>(&self, slice: u32, share: f64, y: Range<u32>, sums: &mut [f64]) -> Result<()> {
        let owner = self.owner;
        let [nx, ny] = owner.inner.size.map(|n| n as usize);
        let shift = owner.places[slice as usize].aside;
        let shift = [0, 1].map(|a| owner.grid.start[a] - shift[a]);
        let top = (f64::from(y.start) + shift[1])
            .floor()
            .clamp(0.0, ny as f64) as usize;
        // the row after the last is looked at even if its share is 0
        let end = (f64::from(y.end) + shift[1]).ceil() + 1.0;
        let end = end.clamp(0.0, ny as f64) as usize;
        let pixels: Vec<T> = self.pixels(slice, top..end)?;
        let value = |i: usize, j: usize| pixels[(j - top) * nx + i].to_f64();
        let width = owner.grid.size[0] as usize;
        for (row, j) in sums.chunks_exact_mut(width).zip(y) {
            let Some((j, next_j, part_y)) = between(f64::from(j) + shift[1], ny) else {
                row.iter_mut().for_each(|sum| *sum += share * owner.fill);
                continue;
            };
            for (i, sum) in row.iter_mut().enumerate() {
                let found = match between(i as f64 + shift[0], nx) {
                    None => owner.fill,
                    Some((i, next_i, part_x)) => {
                        let along = |j| value(i, j) * (1.0 - part_x) + value(next_i, j) * part_x;
                        along(j) * (1.0 - part_y) + along(next_j) * part_y
                    }
                };
                *sum += share * found;
            }
        }
        Ok(())
    }

    /// Rows of a slice.
    fn pixels<T: Voxel>(&self, slice: u32, rows: Range<usize>) -> Result<Vec<T>> {
        let [nx, ny] = self.owner.inner.size.map(|n| n as usize);
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let page = self.owner.inner.page(slice)?;
        let mut out = vec![T::zeroed(); nx * rows.len()];
        let range = rows.start as u32..rows.end as u32;
        if !page.rows(range, bytemuck::cast_slice_mut(&mut out))? {
            let mut whole = vec![T::zeroed(); nx * ny];
            page.decode(0, bytemuck::cast_slice_mut(&mut whole))?;
            out.copy_from_slice(&whole[rows.start * nx..rows.end * nx]);
        }
        Ok(out)
    }
}

/// The pixels before and after a place among `count` and the share of the latter; `None` outside.
fn between(at: f64, count: usize) -> Option<(usize, usize, f64)> {
    // half a hundredth of a pixel beyond the edge is rounding
    let last = (count - 1) as f64;
    if !(-0.005..=last + 0.005).contains(&at) {
        return None;
    }
    let at = at.clamp(0.0, last);
    let low = at.floor() as usize;
    Some((low, (low + 1).min(count - 1), at - at.floor()))
}

fn put(dtype: Dtype, value: f64, out: &mut [u8]) {
    // casts of floats saturate
    let whole = value.round();
    match dtype {
        Dtype::U8 => out.copy_from_slice(&(whole as u8).to_ne_bytes()),
        Dtype::I8 => out.copy_from_slice(&(whole as i8).to_ne_bytes()),
        Dtype::U16 => out.copy_from_slice(&(whole as u16).to_ne_bytes()),
        Dtype::I16 => out.copy_from_slice(&(whole as i16).to_ne_bytes()),
        Dtype::U32 => out.copy_from_slice(&(whole as u32).to_ne_bytes()),
        Dtype::I32 => out.copy_from_slice(&(whole as i32).to_ne_bytes()),
        Dtype::F32 => out.copy_from_slice(&(value as f32).to_ne_bytes()),
        Dtype::F64 => out.copy_from_slice(&value.to_ne_bytes()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_between_pixels() {
        assert_eq!(between(0.25, 3), Some((0, 1, 0.25)));
        assert_eq!(between(2.0, 3), Some((2, 2, 0.0)));
        assert_eq!(between(-0.001, 3), Some((0, 1, 0.0)));
        assert_eq!((between(-0.5, 3), between(2.5, 3)), (None, None));
    }
}
