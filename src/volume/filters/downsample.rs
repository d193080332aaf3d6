//! Blocks of voxels become one voxel each: their mean.

use crate::error::Result;
use crate::grid::Filter;
use crate::sys::locks::lock;
use crate::volume::{Header, Volume, Voxel, with_voxel_type};
use std::collections::VecDeque;
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;

/// Bytes that a thread holds, unless a row of blocks takes more.
const PIECE: usize = 1 << 20;
/// Bytes of a block's sum and number of samples.
const SUM: usize = 16;
/// Slices of means that are kept of a stream, for boxes that share some with the one before.
const KEPT: usize = 4;

/// The means of blocks of another volume, as [`Filter::Downsample`] says.
///
/// Sums are of `f64` and in the order of the samples, so that they are the same for any box; those of whole numbers
/// are exact, 16^3 samples of 32 bits being less than 2^53.
pub(crate) struct Downsampled<'a> {
    inner: Box<dyn Volume + 'a>,
    header: Header,
    factor: u32,
    /// Of an inner volume that is read forward: whole slices, the last one last.
    forward: Option<Mutex<VecDeque<Slice>>>,
}

/// The means of a slice.
struct Slice {
    number: u32,
    means: Vec<u8>,
}

/// Sums over the samples of blocks.
struct Sums {
    /// Of those that are numbers.
    sums: Vec<f64>,
    /// How many these are; empty for types without NaN.
    counts: Vec<u32>,
}

impl<'a> Downsampled<'a> {
    /// # Errors
    /// [`crate::Error::Usage`] if less than 2 blocks fit along an axis.
    pub(crate) fn new(inner: Box<dyn Volume + 'a>, filter: &Filter) -> Result<Self> {
        let before = inner.header();
        let header = Header {
            dims: filter.dims(before.dims)?,
            placement: filter.placement(before.placement),
            ..before.clone()
        };
        Ok(Downsampled::around(inner, header, filter.factor()))
    }

    /// `header` is that of the means.
    fn around(inner: Box<dyn Volume + 'a>, header: Header, factor: u32) -> Self {
        Downsampled {
            forward: (!inner.random_access()).then(Mutex::default),
            inner,
            header,
            factor,
        }
    }

    /// Voxels of the blocks of a range.
    fn voxels(&self, blocks: Range<u32>) -> Range<u32> {
        blocks.start * self.factor..blocks.end * self.factor
    }

    /// Rows of blocks of so many that are read together, of `most`.
    fn rows(&self, blocks: usize, most: usize) -> usize {
        let factor = self.factor as usize;
        let samples = factor * factor * self.header.dtype.bytes();
        (PIECE / (blocks * (samples + SUM))).clamp(1, most)
    }

    /// Means of the blocks of one slice of them, of rows `y`.
    fn means<T: Voxel>(&self, x: &Range<u32>, y: Range<u32>, k: u32, out: &mut [u8]) -> Result<()> {
        let factor = self.factor as usize;
        let blocks = x.len() * y.len();
        let mut sums = Sums {
            sums: vec![0.0; blocks],
            counts: match T::DTYPE.is_float() {
                true => vec![0; blocks],
                false => Vec::new(),
            },
        };
        let row = x.len() * factor;
        let rows = self.rows(x.len(), y.len());
        let mut samples = vec![T::zeroed(); row * rows * factor];
        for slice in self.voxels(k..k + 1) {
            for top in y.clone().step_by(rows) {
                let part = top..y.end.min(top + rows as u32);
                let first = (top - y.start) as usize * x.len();
                let samples = &mut samples[..part.len() * factor * row];
                let [x_read, y_read] = [x.clone(), part].map(|blocks| self.voxels(blocks));
                let bytes = bytemuck::cast_slice_mut(samples);
                self.inner
                    .read_box(x_read, y_read, slice..slice + 1, bytes)?;
                for (j, row) in samples.chunks_exact(row).enumerate() {
                    sums.add(first + j / factor * x.len(), row.chunks_exact(factor));
                }
            }
        }
        let all = (factor * factor * factor) as f64;
        for (i, out) in out.chunks_exact_mut(size_of::<T>()).enumerate() {
            let mean = match sums.counts.get(i) {
                // 0 / 0 is NaN
                Some(count) => sums.sums[i] / f64::from(*count),
                None => sums.sums[i] / all,
            };
            out.copy_from_slice(bytemuck::bytes_of(&T::nearest(mean)));
        }
        Ok(())
    }
}

impl Downsampled<'_> {
    /// All means of a slice, which is made unless it is kept.
    fn slice<'b>(&self, kept: &'b mut VecDeque<Slice>, k: u32) -> Result<&'b [u8]> {
        let at = match kept.iter().position(|slice| slice.number == k) {
            Some(at) => at,
            None => {
                let [nx, ny, _] = self.header.dims.0;
                let mut means = match kept.len() < KEPT {
                    true => Vec::new(),
                    false => kept.pop_front().map_or_else(Vec::new, |slice| slice.means),
                };
                let bytes = self.header.dims.slice_voxels() as usize * self.header.dtype.bytes();
                means.resize(bytes, 0);
                with_voxel_type!(self.header.dtype, T => {
                    self.means::<T>(&(0..nx), 0..ny, k, &mut means)
                })?;
                kept.push_back(Slice { number: k, means });
                kept.len() - 1
            }
        };
        Ok(&kept[at].means)
    }

    /// Copies a part of the means of a slice.
    fn part_of(&self, slice: &[u8], [x, y]: [&Range<u32>; 2], out: &mut [u8]) {
        let sample = self.header.dtype.bytes();
        let whole = self.header.dims.0[0] as usize * sample;
        let rows = slice.chunks_exact(whole).skip(y.start as usize);
        for (row, out) in rows.zip(out.chunks_exact_mut(x.len() * sample)) {
            out.copy_from_slice(&row[x.start as usize * sample..][..out.len()]);
        }
    }
}

impl Sums {
    /// Adds samples to the blocks from the first one on.
    fn add<'a, T: Voxel>(&mut self, first: usize, blocks: impl Iterator<Item = &'a [T]>) {
        if self.counts.is_empty() {
            for (sum, block) in self.sums[first..].iter_mut().zip(blocks) {
                *sum += block.iter().map(|v| v.to_f64()).sum::<f64>();
            }
            return;
        }
        let of_blocks = self.sums[first..].iter_mut().zip(&mut self.counts[first..]);
        for ((sum, count), block) in of_blocks.zip(blocks) {
            for v in block.iter().map(|v| v.to_f64()).filter(|v| !v.is_nan()) {
                *sum += v;
                *count += 1;
            }
        }
    }
}

impl Volume for Downsampled<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let row = x.len() * self.header.dtype.bytes();
        if let Some(forward) = &self.forward {
            let mut kept = lock(forward);
            for (k, out) in z.zip(out.chunks_exact_mut(row * y.len())) {
                self.part_of(self.slice(&mut kept, k)?, [&x, &y], out);
            }
            return Ok(());
        }
        let rows = self.rows(x.len(), y.len());
        for (k, out) in z.zip(out.chunks_exact_mut(row * y.len())) {
            for (i, out) in out.chunks_mut(row * rows).enumerate() {
                let top = y.start + (i * rows) as u32;
                let y = top..top + (out.len() / row) as u32;
                with_voxel_type!(self.header.dtype, T => self.means::<T>(&x, y, k, out))?;
            }
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(Downsampled::around(inner, self.header.clone(), self.factor))
        }))
    }

    fn grain(&self) -> [u32; 3] {
        // where a part that is decoded together ends between blocks
        let blocks = |n: u32| match n.is_multiple_of(self.factor) {
            true => n / self.factor,
            false => n,
        };
        self.inner.grain().map(blocks)
    }

    fn held_bytes(&self) -> u64 {
        let factor = u64::from(self.factor);
        let sample = self.header.dtype.bytes() as u64;
        let row = u64::from(self.header.dims.0[0]) * (factor * factor * sample + SUM as u64);
        let piece = row.max(PIECE as u64);
        let own = match self.forward {
            Some(_) => {
                let means = (KEPT as u64 + 1) * sample + SUM as u64;
                piece + self.header.dims.slice_voxels() * means
            }
            None => rayon::current_num_threads() as u64 * piece,
        };
        self.inner.held_bytes() + own
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.inner.mapped_bytes(self.voxels(z))
    }

    /// The blocks of which every voxel was.
    fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
        let slices = self.voxels(z..z + 1);
        let rows = slices.flat_map(|z| self.voxels(y..y + 1).map(move |y| [y, z]));
        let voxels = rows.filter_map(|[y, z]| self.inner.measured(y, z));
        let all = voxels.reduce(|a, b| a.start.max(b.start)..a.end.min(b.end))?;
        let end = (all.end / self.factor).min(self.header.dims.0[0]);
        Some(all.start.div_ceil(self.factor).min(end)..end)
    }

    fn prefetch(&self, z: Range<u32>) {
        self.inner.prefetch(self.voxels(z));
    }

    fn release(&self, z: Range<u32>) {
        self.inner.release(self.voxels(z));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Dtype, Placement, Unit};
    use crate::volume::MemoryVolume;
    use proptest::prelude::*;

    /// Every voxel of a block on its own, and whole numbers as such.
    fn mean<T: Voxel>(block: &[T]) -> f64 {
        let numbers: Vec<f64> = block.iter().map(|v| v.to_f64()).collect();
        if T::DTYPE.is_float() {
            let numbers: Vec<f64> = numbers.into_iter().filter(|v| !v.is_nan()).collect();
            return numbers.iter().sum::<f64>() / numbers.len() as f64;
        }
        let (sum, count) = (
            numbers.iter().map(|v| *v as i128).sum::<i128>(),
            numbers.len() as i128,
        );
        let (low, rest) = (sum.div_euclid(count), sum.rem_euclid(count));
        let up = match (2 * rest).cmp(&count) {
            std::cmp::Ordering::Less => 0,
            std::cmp::Ordering::Equal => low.rem_euclid(2),
            std::cmp::Ordering::Greater => 1,
        };
        (low + up) as f64
    }

    fn as_one_by_one<T: Voxel>(dims: [u32; 3], factor: u32, random: impl Fn(u64) -> T) {
        let [nx, ny, nz] = dims;
        let samples: Vec<T> = (0..u64::from(nx * ny * nz)).map(random).collect();
        let inner = MemoryVolume::new(Dims(dims), Placement::default(), samples.clone()).unwrap();
        let filter = Filter::Downsample { factor };
        let volume = Downsampled::new(Box::new(inner), &filter).unwrap();
        let few = dims.map(|n| n / factor);
        assert_eq!(volume.header().dims, Dims(few));
        let [x, y, z] = few.map(|n| 0..n);
        let mut out = vec![T::zeroed(); few.iter().product::<u32>() as usize];
        volume
            .read_box(x, y, z, bytemuck::cast_slice_mut(&mut out))
            .unwrap();
        for (i, found) in out.iter().enumerate() {
            let i = i as u32;
            let first = [i % few[0], i / few[0] % few[1], i / few[0] / few[1]].map(|v| v * factor);
            let block: Vec<T> = (0..factor.pow(3))
                .map(|b| {
                    let [x, y, z] = [b % factor, b / factor % factor, b / factor / factor];
                    let at = first[0] + x + nx * (first[1] + y + ny * (first[2] + z));
                    samples[at as usize]
                })
                .collect();
            let expected = mean(&block);
            let near = 1e-6 * expected.abs() * f64::from(u8::from(T::DTYPE.is_float()));
            let apart = (found.to_f64() - expected).abs();
            let same = apart <= near || found.to_f64().is_nan() && expected.is_nan();
            assert!(same, "{i}: {found:?}, {expected}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn blocks_become_their_means(
            more in [0u32..9, 0u32..9, 0u32..9],
            factor in 2u32..6,
            seed: u64,
        ) {
            let dims = more.map(|n| 2 * factor + n);
            let bits = |i: u64| {
                let z = (seed ^ i).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                (z ^ z >> 29).wrapping_mul(0xD1B5_4A32_D192_ED03) >> 16
            };
            let real = |i: u64| (bits(i) % 20_000) as f64 / 7.0 - 1000.0;
            as_one_by_one(dims, factor, |i| bits(i) as u8);
            as_one_by_one(dims, factor, |i| bits(i) as i8);
            as_one_by_one(dims, factor, |i| bits(i) as u16);
            as_one_by_one(dims, factor, |i| bits(i) as i16);
            as_one_by_one(dims, factor, |i| bits(i) as u32);
            as_one_by_one(dims, factor, |i| bits(i) as i32);
            // few values, so that there are ties
            as_one_by_one(dims, factor, |i| (bits(i) % 3) as i16 - 1);
            as_one_by_one(dims, factor, |i| if bits(i) % 3 > 0 { f32::NAN } else { real(i) as f32 });
            as_one_by_one(dims, factor, |i| if bits(i) % 50 > 0 { real(i) } else { f64::NAN });
        }
    }

    #[test]
    fn nan_counts_for_nothing() {
        let mut samples = vec![f32::NAN; 64];
        for (at, value) in [(0, 3.0), (1, 5.0), (2, f32::INFINITY)] {
            samples[at] = value;
        }
        let inner = MemoryVolume::new(Dims([4; 3]), Placement::default(), samples).unwrap();
        let half = Filter::Downsample { factor: 2 };
        let volume = Downsampled::new(Box::new(inner), &half).unwrap();
        let mut out = [0f32; 8];
        volume
            .read_box(0..2, 0..2, 0..2, bytemuck::cast_slice_mut(&mut out))
            .unwrap();
        assert_eq!(out[..2], [4.0, f32::INFINITY]);
        assert!(out[2..].iter().all(|v| v.is_nan()));
    }

    #[test]
    fn the_place_follows() {
        let place = Placement {
            spacing: [0.1, 0.2, 0.5],
            unit: Unit::Millimetre,
            origin: [1.0, 2.0, 3.0],
            ..Placement::default()
        };
        let inner = MemoryVolume::new(Dims([9, 8, 12]), place, vec![0u16; 864]).unwrap();
        let filter = Filter::Downsample { factor: 4 };
        let header = Downsampled::new(Box::new(inner), &filter).unwrap().header;
        assert_eq!((header.dims, header.dtype), (Dims([2, 2, 3]), Dtype::U16));
        assert_eq!(header.placement.spacing, [0.4, 0.8, 2.0]);
        let origin = [1.15, 2.3, 3.75];
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!((0..3).all(|a| near(header.placement.origin[a], origin[a])));
    }

    /// What a box takes in pieces is the same as in one.
    #[test]
    fn wide_rows_are_taken_in_pieces() {
        let dims = [20_000, 16, 4];
        as_one_by_one(dims, 2, |i| {
            (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u16
        });
    }
}
