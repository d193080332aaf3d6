//! Slices of a volume, seen coarsely: means of some slices each, and each slice as a small picture.

use super::image::split;
use crate::error::{Error, Result};
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::ops::Range;

/// Slices that are read at most.
const SLICES: u32 = 32;
/// Means of slices that follow each other, at most.
const GROUPS: u32 = 8;
/// Pixels along the longer side of a mean at most; each stands for a square of voxels then.
const PIXELS: u32 = 1024;
/// The same of a slice by itself.
const COARSE: u32 = 96;
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
    fn of([nx, ny]: [u32; 2], most: u32) -> Self {
        let pixel = nx.max(ny).div_ceil(most);
        Raster {
            width: nx.div_ceil(pixel) as usize,
            height: ny.div_ceil(pixel) as usize,
            pixel,
        }
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

/// Where the pixels of a slice by itself lie.
pub(super) fn coarse(size: [u32; 2]) -> Raster {
    Raster::of(size, COARSE)
}

/// Means of finite samples, in the making.
struct Sums {
    raster: Raster,
    sums: Vec<f64>,
    counts: Vec<u32>,
}

impl Sums {
    fn new(raster: Raster) -> Self {
        Sums {
            raster,
            sums: vec![0.0; raster.len()],
            counts: vec![0; raster.len()],
        }
    }

    /// Adds a row of voxels.
    fn add<T: Voxel>(&mut self, y: u32, samples: &[T]) {
        let pixel = self.raster.pixel;
        let start = (y / pixel) as usize * self.raster.width;
        for (x, samples) in samples.chunks(pixel as usize).enumerate() {
            for v in samples.iter().map(|v| v.to_f64()).filter(|v| v.is_finite()) {
                self.sums[start + x] += v;
                self.counts[start + x] += 1;
            }
        }
    }

    /// The means, NaN where no sample is finite; begins anew.
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

/// The mean of some slices that follow each other.
#[derive(Debug)]
pub(super) struct Group {
    pub pixels: Vec<f32>,
    /// The mean of their numbers.
    pub z: f64,
}

/// A slice by itself.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    pub z: u32,
    pub pixels: Vec<f32>,
}

/// Slices that are evenly spread over a range of them.
#[derive(Debug)]
pub(super) struct Seen {
    pub raster: Raster,
    pub groups: Vec<Group>,
    /// By rising number.
    pub slices: Vec<Coarse>,
}

impl Seen {
    /// Reads some slices of a range.
    ///
    /// # Errors
    /// The volume's; [`Error::Interrupted`].
    pub fn read<T: Voxel>(
        volume: &dyn Volume,
        range: &Range<u32>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let [nx, ny, _] = volume.header().dims.0;
        let raster = Raster::of([nx, ny], PIXELS);
        let coarse = coarse([nx, ny]);
        let slices = SLICES.min(range.len() as u32);
        let groups = GROUPS.min(slices);
        let mut seen = Seen {
            raster,
            groups: Vec::new(),
            slices: Vec::new(),
        };
        let mut sums = Sums::new(raster);
        let mut of_group = Vec::new();
        progress.begin("region", slices.into());
        for i in 0..slices {
            let at = (2 * u64::from(i) + 1) * range.len() as u64 / (2 * u64::from(slices));
            let z = range.start + at as u32;
            let pixels = read_slice::<T>(volume, z, coarse, Some(&mut sums), progress)?;
            seen.slices.push(Coarse { z, pixels });
            of_group.push(f64::from(z));
            let group_of = |i: u32| i * groups / slices;
            if i + 1 == slices || group_of(i + 1) != group_of(i) {
                seen.groups.push(Group {
                    pixels: sums.take(),
                    z: of_group.iter().sum::<f64>() / of_group.len() as f64,
                });
                of_group.clear();
            }
            progress.advance(1);
        }
        Ok(seen)
    }
}

impl Seen {
    /// The slices between those that show nothing bright, where few of all do; `None` otherwise.
    pub fn few(&self, range: &Range<u32>) -> Option<Range<u32>> {
        let pixels = self.slices.iter().flat_map(|slice| &slice.pixels);
        let (threshold, _) = split(pixels.map(|v| f64::from(*v)))?;
        let bright = |slice: &Coarse| {
            let bright = slice.pixels.iter().filter(|v| f64::from(**v) >= threshold);
            bright.count()
        };
        let bright: Vec<usize> = self.slices.iter().map(bright).collect();
        let most = *bright.iter().max()?;
        let first = bright.iter().position(|n| 2 * n > most)?;
        let last = bright.iter().rposition(|n| 2 * n > most)?;
        let before = first.checked_sub(1).map(|i| self.slices[i].z + 1);
        let after = self.slices.get(last + 1).map(|slice| slice.z);
        let part = before.unwrap_or(range.start)..after.unwrap_or(range.end);
        (2 * part.len() < range.len()).then_some(part)
    }
}

/// Reads one slice as a small picture, and adds it to a mean.
///
/// # Errors
/// The volume's; [`Error::Interrupted`].
fn read_slice<T: Voxel>(
    volume: &dyn Volume,
    z: u32,
    coarse: Raster,
    mut mean: Option<&mut Sums>,
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    let mut own = Sums::new(coarse);
    for_each_row::<T>(volume, z, progress, |y, row| {
        own.add(y, row);
        if let Some(mean) = &mut mean {
            mean.add(y, row);
        }
    })?;
    Ok(own.take())
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

/// Reads one more slice as those of [`Seen::slices`].
///
/// # Errors
/// The volume's; [`Error::Interrupted`].
pub(super) fn one_more<T: Voxel>(
    volume: &dyn Volume,
    z: u32,
    coarse: Raster,
    progress: &dyn Progress,
) -> Result<Coarse> {
    let pixels = read_slice::<T>(volume, z, coarse, None, progress)?;
    Ok(Coarse { z, pixels })
}
