//! Slices of a volume, seen coarsely: each as a small picture, and means of some slices each.

use crate::error::{Error, Result};
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::ops::Range;

/// Slices that are read at most.
pub(super) const SLICES: u32 = 32;
/// Means of slices that follow each other, at most.
const GROUPS: usize = 8;
/// Pixels along the longer side of a mean at most; each stands for a square of voxels then.
const PIXELS: u32 = 1024;
/// The same of a slice by itself.
const COARSE: u32 = 128;
/// Bytes of samples that are read at once, unless a row has more.
const SAMPLES: usize = 2 << 20;

/// Where pixels lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raster {
    pub width: usize,
    pub height: usize,
    /// Voxels along the side of a pixel.
    pub pixel: u32,
}

impl Raster {
    /// Of slices of `nx` x `ny` voxels, with so many pixels along the longer side at most.
    fn of(volume: &dyn Volume, most: u32) -> Self {
        let [nx, ny, _] = volume.header().dims.0;
        let pixel = nx.max(ny).div_ceil(most);
        Raster {
            width: nx.div_ceil(pixel) as usize,
            height: ny.div_ceil(pixel) as usize,
            pixel,
        }
    }

    /// Of slices by themselves.
    pub fn coarse(volume: &dyn Volume) -> Self {
        Raster::of(volume, COARSE)
    }

    /// Of means of slices.
    pub fn fine(volume: &dyn Volume) -> Self {
        Raster::of(volume, PIXELS)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// The voxel, of a pixel with fractions, that lies in the middle of it.
    pub fn voxel(&self, pixel: f64) -> f64 {
        pixel * f64::from(self.pixel) + (f64::from(self.pixel) - 1.0) / 2.0
    }
}

/// Means of finite numbers, in the making.
struct Sums {
    sums: Vec<f64>,
    counts: Vec<u32>,
}

impl Sums {
    fn new(raster: Raster) -> Self {
        Sums {
            sums: vec![0.0; raster.len()],
            counts: vec![0; raster.len()],
        }
    }

    fn add(&mut self, i: usize, v: f64) {
        if v.is_finite() {
            self.sums[i] += v;
            self.counts[i] += 1;
        }
    }

    /// The means, NaN where no number is finite; begins anew.
    fn take(&mut self) -> Vec<f32> {
        let mean = |(sum, count): (&mut f64, &mut u32)| {
            let (sum, count) = (std::mem::take(sum), std::mem::take(count));
            (sum / f64::from(count)) as f32
        };
        self.sums
            .iter_mut()
            .zip(&mut self.counts)
            .map(mean)
            .collect()
    }
}

/// A slice, or the mean of some.
#[derive(Debug)]
pub(super) struct Picture {
    pub z: u32,
    /// NaN where nothing is seen.
    pub pixels: Vec<f32>,
}

impl Picture {
    /// Reads one slice.
    ///
    /// # Errors
    /// The volume's; [`Error::Interrupted`].
    pub fn read<T: Voxel>(
        volume: &dyn Volume,
        z: u32,
        raster: Raster,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let mut sums = Sums::new(raster);
        for_each_row::<T>(volume, z, progress, |y, row| {
            let start = (y / raster.pixel) as usize * raster.width;
            for (x, samples) in row.chunks(raster.pixel as usize).enumerate() {
                samples.iter().for_each(|v| sums.add(start + x, v.to_f64()));
            }
        })?;
        let pixels = sums.take();
        Ok(Picture { z, pixels })
    }
}

impl Picture {
    /// True if all pixels are of one value, or none shows anything.
    pub fn is_blank(&self) -> bool {
        let first = self.pixels[0];
        let is_first = |v: &f32| *v == first || v.is_nan() && first.is_nan();
        self.pixels.iter().all(is_first)
    }
}

/// Which slices of a range are looked at: evenly spread ones.
pub(super) fn spread(range: &Range<u32>) -> Vec<u32> {
    let n = SLICES.min(range.len() as u32);
    let at = |i: u32| (2 * u64::from(i) + 1) * range.len() as u64 / (2 * u64::from(n));
    (0..n).map(|i| range.start + at(i) as u32).collect()
}

/// A slice, moved by some voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moved {
    pub z: u32,
    pub by: [f64; 2],
}

/// Reads slices and takes the means of some that follow each other, moved against their shift.
///
/// # Errors
/// The volume's; [`Error::Interrupted`].
pub(super) fn means<T: Voxel>(
    volume: &dyn Volume,
    slices: &[Moved],
    raster: Raster,
    progress: &dyn Progress,
) -> Result<Vec<Picture>> {
    let groups = GROUPS.min(slices.len());
    let mut sums = Sums::new(raster);
    let mut means = Vec::new();
    progress.begin("sample", slices.len() as u64);
    for (i, slice) in slices.iter().enumerate() {
        let own = Picture::read::<T>(volume, slice.z, raster, progress)?;
        let moved = slice
            .by
            .map(|v| (v / f64::from(raster.pixel)).round() as i64);
        let [dx, dy] = moved;
        let from = |v: usize, by: i64, n: usize| (v as i64 + by).clamp(0, n as i64 - 1) as usize;
        for y in 0..raster.height {
            let start = from(y, dy, raster.height) * raster.width;
            for x in 0..raster.width {
                let v = own.pixels[start + from(x, dx, raster.width)];
                sums.add(y * raster.width + x, v.into());
            }
        }
        let group_of = |i: usize| i * groups / slices.len();
        if i + 1 == slices.len() || group_of(i + 1) != group_of(i) {
            let pixels = sums.take();
            means.push(Picture { z: slice.z, pixels });
        }
        progress.advance(1);
    }
    Ok(means)
}

/// Calls `each` with the rows of a slice, of which some are held at a time.
///
/// # Errors
/// The volume's; [`Error::Interrupted`].
pub(super) fn for_each_row<T: Voxel>(
    volume: &dyn Volume,
    z: u32,
    progress: &dyn Progress,
    mut each: impl FnMut(u32, &[T]),
) -> Result<()> {
    let [nx, ny, _] = volume.header().dims.0;
    let rows = (SAMPLES / (nx as usize * size_of::<T>())).clamp(1, ny as usize);
    let mut samples = vec![T::zeroed(); nx as usize * rows];
    for y in (0..ny).step_by(rows) {
        if progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let y = y..(y + rows as u32).min(ny);
        let samples = &mut samples[..nx as usize * y.len()];
        let out = bytemuck::cast_slice_mut(samples);
        volume.read_box(0..nx, y.clone(), z..z + 1, out)?;
        y.zip(samples.chunks_exact(nx as usize))
            .for_each(|(y, row)| each(y, row));
    }
    volume.release(z..z + 1);
    Ok(())
}
