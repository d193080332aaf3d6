//! Slices at uneven steps, shifted sideways or with axes that are not at right angles, as a regular grid, by linear
//! interpolation.
//!
//! A voxel of the grid lies between two slices; in each of them it lies between four pixels. So two slices at a time
//! are all that is read. Outside of a slice there is the fill.

mod grid;

pub(crate) use grid::Grid;
#[cfg_attr(not(feature = "dicom"), allow(unused_imports))]
pub(crate) use grid::{Place, SlicePlaces};

use crate::error::Result;
use crate::grid::Placement;
use crate::volume::{Dtype, Header, Volume, Voxel, with_voxel_type};
use grid::SliceShare;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// Bytes of sums that a thread holds, unless a row has more.
const PIECE: usize = 1 << 20;

/// What outside of slices stands for samples of a type: nothing, or air where numbers are signed as those of CT.
pub(crate) fn fill(dtype: Dtype) -> f64 {
    match dtype {
        Dtype::F32 | Dtype::F64 => f64::NAN,
        Dtype::I8 => -128.0,
        Dtype::I16 | Dtype::I32 => -1000.0,
        Dtype::U8 | Dtype::U16 | Dtype::U32 => 0.0,
    }
}

/// A volume on a regular grid, out of one that has none.
pub(crate) struct Resampled<'a> {
    inner: Box<dyn Volume + 'a>,
    grid: Grid,
    header: Header,
}

impl<'a> Resampled<'a> {
    /// # Errors
    /// As those of [`Dims::new`].
    pub(crate) fn new(
        inner: Box<dyn Volume + 'a>,
        grid: Grid,
        placement: Placement,
    ) -> Result<Self> {
        let header = Header {
            dims: grid.dims()?,
            placement,
            ..inner.header().clone()
        };
        Ok(Resampled {
            inner,
            grid,
            header,
        })
    }

    /// Fills the part `x` by `y` of slice `k`.
    fn slice<T: Voxel>(
        &self,
        k: u32,
        x: &Range<u32>,
        y: &Range<u32>,
        out: &mut [u8],
    ) -> Result<()> {
        let dtype = self.header.dtype;
        let rows = (PIECE / (8 * x.len())).clamp(1, y.len());
        let mut sums = vec![0.0f64; rows * x.len()];
        for (i, out) in out.chunks_mut(rows * x.len() * dtype.bytes()).enumerate() {
            let top = y.start + (i * rows) as u32;
            let count = out.len() / (x.len() * dtype.bytes());
            let sums = &mut sums[..count * x.len()];
            sums.fill(0.0);
            for of in self.grid.between(k) {
                if of.share > 0.0 {
                    self.add::<T>(of, x, top..top + count as u32, sums)?;
                }
            }
            for (out, sum) in out.chunks_exact_mut(dtype.bytes()).zip(sums) {
                put(dtype, *sum, out);
            }
        }
        Ok(())
    }

    /// The pixel of a slice, along x and y, at the grid's first voxel; its rows lean besides.
    fn shift(&self, slice: u32) -> [f64; 2] {
        let aside = self.grid.places[slice as usize].aside;
        [0, 1].map(|a| self.grid.start[a] - aside[a])
    }

    /// The pixel of row `v` of a slice at the grid's first voxel.
    fn left_of(&self, v: f64, slice: u32) -> f64 {
        let rows = self.inner.header().dims.0[1];
        self.shift(slice)[0] - self.grid.lean * v.clamp(0.0, f64::from(rows - 1))
    }

    /// The pixels of a part of a slice, row by row.
    fn pixels<T: Voxel>(
        &self,
        slice: u32,
        columns: Range<u32>,
        rows: Range<u32>,
    ) -> Result<Vec<T>> {
        let mut pixels = vec![T::zeroed(); columns.len() * rows.len()];
        if !pixels.is_empty() {
            let out = bytemuck::cast_slice_mut(&mut pixels);
            self.inner.read_box(columns, rows, slice..slice + 1, out)?;
        }
        Ok(pixels)
    }

    /// Adds the share of a slice to a part of the grid.
    fn add<T: Voxel>(
        &self,
        of: SliceShare,
        x: &Range<u32>,
        y: Range<u32>,
        sums: &mut [f64],
    ) -> Result<()> {
        let SliceShare { slice, share } = of;
        let fill = &self.grid.fill;
        let [nx, ny, _] = self.inner.header().dims.0.map(|n| n as usize);
        let below = self.shift(slice)[1];
        let row_at = |j: u32| f64::from(j) + below;
        let left_of = |v: f64| self.left_of(v, slice);
        let span = |low: f64, high: f64, n: usize| {
            let [low, high] = [low.floor(), high.ceil() + 1.0];
            low.clamp(0.0, n as f64) as u32..high.clamp(0.0, n as f64) as u32
        };
        let rows = span(row_at(y.start), row_at(y.end - 1) + 1e-2, ny);
        let lefts = [y.start, y.end - 1].map(|j| left_of(row_at(j)));
        let columns = span(
            f64::from(x.start) + lefts[0].min(lefts[1]) - 1e-2,
            f64::from(x.end - 1) + lefts[0].max(lefts[1]) + 1e-2,
            nx,
        );
        let width = columns.len();
        let pixels = self.pixels::<T>(slice, columns.clone(), rows.clone())?;
        // along a row of the slice, NaN only where it has a share
        let along = |j: usize, i: f64| {
            let (low, next, part) = between(i, nx)?;
            let at = |i: usize| {
                pixels[(j - rows.start as usize) * width + i - columns.start as usize].to_f64()
            };
            Some(mixed(part, || at(low), || at(next)))
        };
        for (row, j) in sums.chunks_exact_mut(x.len()).zip(y) {
            let at = row_at(j);
            let Some((low, next, part)) = between(at, ny) else {
                row.iter_mut().for_each(|sum| *sum += share * fill);
                continue;
            };
            let left = left_of(at);
            for (sum, i) in row.iter_mut().zip(x.clone()) {
                let i = f64::from(i) + left;
                let above = || along(low, i).unwrap_or(*fill);
                let below = || along(next, i).unwrap_or(*fill);
                *sum += share * mixed(part, above, below);
            }
        }
        Ok(())
    }
}

impl Resampled<'_> {
    /// The voxels of row `y` of the grid that lie inside of a slice.
    fn row_inside(&self, y: u32, slice: u32) -> Range<u32> {
        let [nx, ny, _] = self.inner.header().dims.0.map(|n| n as usize);
        let at = f64::from(y) + self.shift(slice)[1];
        if between(at, ny).is_none() {
            return 0..0;
        }
        let left = self.left_of(at, slice);
        // a voxel more on either side than the rounded sums say
        let near = |x: f64| x.clamp(0.0, f64::from(self.grid.size[0])) as u32;
        let from = near((-left).floor() - 1.0);
        let to = near((nx as f64 - left).ceil() + 1.0);
        let is_inside = |x: &u32| between(f64::from(*x) + left, nx).is_some();
        let mut inside = (from..to).filter(is_inside);
        let first = inside.next().unwrap_or(0);
        // inside is one stretch
        let last = (from..to).rev().find(is_inside);
        first..last.map_or(first, |x| x + 1)
    }
}

impl Volume for Resampled<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let slice = out.len() / z.len();
        let fill = |(i, out): (usize, &mut [u8])| {
            let k = z.start + i as u32;
            with_voxel_type!(self.header.dtype, T => self.slice::<T>(k, &x, &y, out))
        };
        match self.random_access() {
            true => out
                .par_chunks_exact_mut(slice)
                .enumerate()
                .try_for_each(fill),
            // forward through a stream
            false => out.chunks_exact_mut(slice).enumerate().try_for_each(fill),
        }
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn grain(&self) -> [u32; 3] {
        self.inner.grain()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let Some(inner) = self.inner.decoded_once(dir)? else {
            return Ok(None);
        };
        let placement = self.header.placement;
        let same = Resampled::new(inner, self.grid.clone(), placement)?;
        Ok(Some(Box::new(same)))
    }

    fn held_bytes(&self) -> u64 {
        // sums, and the pixels that they are of, which are more by what rows and slices lean over
        let row = u64::from(self.header.dims.0[0]) * 8;
        let lean = (PIECE as f64 * (2.0 + self.grid.lean.abs())) as u64;
        self.inner.held_bytes()
            + rayon::current_num_threads() as u64 * (lean + PIECE as u64 + 6 * row)
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.inner.mapped_bytes(self.grid.slices(z))
    }

    /// Those that no fill has a share in.
    fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
        let of = self.grid.between(z).into_iter().filter(|of| of.share > 0.0);
        of.map(|of| self.row_inside(y, of.slice))
            .reduce(|a, b| a.start.max(b.start)..a.end.min(b.end))
            .map(|x| x.start..x.end.max(x.start))
    }

    fn prefetch(&self, z: Range<u32>) {
        self.inner.prefetch(self.grid.slices(z));
    }

    fn release(&self, z: Range<u32>) {
        // all but what the next slice needs too
        let done = self.grid.slices(z.clone());
        let next = match z.end < self.grid.size[2] {
            true => self.grid.slices(z.end..z.end + 1).start,
            false => done.end,
        };
        self.inner.release(done.start.min(next)..done.end.min(next));
    }
}

/// Two values by the share of the second; one without a share is not looked at.
fn mixed(part: f64, first: impl FnOnce() -> f64, second: impl FnOnce() -> f64) -> f64 {
    match part {
        0.0 => first(),
        1.0 => second(),
        _ => first() * (1.0 - part) + second() * part,
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
    // and so is what keeps it from a pixel's centre
    let near = at.round();
    let at = if (at - near).abs() < 1e-9 { near } else { at };
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
    use crate::grid::Dims;
    use crate::volume::MemoryVolume;
    use glam::DVec3;

    #[test]
    fn places_between_pixels() {
        assert_eq!(between(0.25, 3), Some((0, 1, 0.25)));
        assert_eq!(between(2.0, 3), Some((2, 2, 0.0)));
        assert_eq!(between(-0.001, 3), Some((0, 1, 0.0)));
        assert_eq!((between(-0.5, 3), between(2.5, 3)), (None, None));
    }

    /// A volume of a linear function of space, on axes that are not at right angles, is that function again.
    #[test]
    fn upright_values_are_those_of_space() {
        let dims = Dims::new([7, 6, 5]).unwrap();
        let unit = |v: [f64; 3]| DVec3::from(v).normalize().into();
        for directions in [
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.2, 1.0]],
            [[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [-0.2, 0.1, 1.0]],
            [[0.0, 0.0, -1.0], [0.0, 1.0, -0.4], [1.0, 0.3, 0.1]],
            [[-1.0, 0.0, 0.0], [0.25, 1.0, 0.1], [0.0, 0.3, 1.0]],
        ] {
            let place = Placement {
                spacing: [0.5, 0.75, 2.0],
                origin: [1.0, -2.0, 3.0],
                directions: directions.map(unit),
                ..Placement::default()
            };
            let function = |[x, y, z]: [f64; 3]| 3.0 * x - 2.0 * y + 0.5 * z + 1.0;
            let voxels =
                (0..dims.voxels() as u32).map(|i| [i % 7, i / 7 % 6, i / 42].map(f64::from));
            let values: Vec<f64> = voxels.map(|v| function(place.world(v))).collect();
            let inner = MemoryVolume::new(dims, place, values).unwrap();
            let grid = Grid::upright(Path::new("v"), place, dims, f64::NAN).unwrap();
            assert_eq!(grid.placement.shear(), None);
            let placement = grid.placement;
            let volume = Resampled::new(Box::new(inner), grid, placement).unwrap();
            let [nx, ny, nz] = volume.header.dims.0;
            let mut bytes = vec![0; volume.header.dims.voxels() as usize * 8];
            volume.read_box(0..nx, 0..ny, 0..nz, &mut bytes).unwrap();
            let found: Vec<f64> = bytemuck::pod_collect_to_vec(&bytes);
            // what is told to be measured is what no fill has a share in
            for (row, values) in found.chunks_exact(nx as usize).enumerate() {
                let (y, z) = (row as u32 % ny, row as u32 / ny);
                let measured = volume.measured(y, z).unwrap();
                for (x, value) in (0..).zip(values) {
                    assert_eq!(measured.contains(&x), !value.is_nan(), "{x} {y} {z}");
                }
            }
            let mut inside = 0;
            // the exact place of a voxel of the grid among those of the volume
            let back = glam::DMat3::from_cols_array_2d(&place.directions)
                * glam::DMat3::from_diagonal(place.spacing.into());
            for (i, value) in (0..).zip(&found) {
                let world = placement.world([i % nx, i / nx % ny, i / (nx * ny)].map(f64::from));
                let at = back.inverse() * (DVec3::from(world) - DVec3::from(place.origin));
                let beyond = (at - DVec3::new(6.0, 5.0, 4.0)).max(-at).max_element();
                if beyond < -1e-6 {
                    // spacings are rounded to the decimals that files mean, by 1e-7 of a step at most
                    let apart = (value - function(world)).abs();
                    assert!(apart < 1e-5, "{at} {value} {apart}");
                    inside += 1;
                } else if beyond > 1e-2 {
                    assert!(value.is_nan(), "{at} {value}");
                }
            }
            assert!(inside > 40, "{inside}");
        }
    }

    /// Bytes of a grid with rows beside its slices, through all that can lie around it.
    #[test]
    fn what_fills_the_grid_up_is_not_counted() {
        use crate::grid::{Crop, Filter, Sigma};
        use crate::progress::Quiet;
        use crate::volume::{Cropped, filtered, measured_voxels, statistics};
        let dims = Dims::new([8, 8, 6]).unwrap();
        let unit = |v: [f64; 3]| DVec3::from(v).normalize().into();
        let place = Placement {
            directions: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0]].map(unit),
            ..Placement::default()
        };
        let values: Vec<i16> = (0..384).map(|i| 10 + i % 50).collect();
        let resampled = || {
            let inner = MemoryVolume::new(dims, place, values.clone()).unwrap();
            let grid = Grid::upright(Path::new("v"), place, dims, fill(Dtype::I16)).unwrap();
            let placement = grid.placement;
            Box::new(Resampled::new(Box::new(inner), grid, placement).unwrap())
        };
        let count = |volume: &dyn Volume| {
            let found = statistics(volume, None, &Quiet).unwrap();
            let [low, high] = found.range.unwrap();
            assert!(low >= 10.0 && high < 60.0, "{low} {high}");
            assert_eq!(found.voxels, measured_voxels(volume));
            assert!(found.voxels < volume.header().dims.voxels());
            found.voxels
        };
        let all = count(&*resampled());
        assert!((200..384).contains(&all), "{all}");
        let [nx, ny, nz] = resampled().header.dims.0;
        let crop = Crop {
            x: 1..nx,
            y: 2..ny,
            z: 1..nz,
        };
        assert!(count(&*Cropped::part(resampled(), Some(&crop)).unwrap()) < all);
        let halves = Filter::Downsample { factor: 2 };
        assert!(8 * count(&*filtered(&halves, resampled()).unwrap()) <= all);
        // nor what filters mix with it
        let sigma = Sigma([0.25; 3]);
        for filter in [Filter::Median { radius: 1 }, Filter::Smooth { sigma }] {
            assert!(count(&*filtered(&filter, resampled()).unwrap()) < all);
        }
    }
}
