//! A median filter as a volume.

use super::median_network::{lower_median, medians_of_27, medians_of_125};
use super::neighbourhood::{Filtered, Neighbourhood, Region, RowBytes, Window};
use super::ordered::{Key, Ordered};
use crate::error::{Error, Result};
use crate::sys::simd::dispatch;
use crate::volume::{Dtype, Volume, with_voxel_type};
use std::ops::Range;

/// A volume of which each voxel is the median of those in a cube around it.
///
/// Values are those of `scipy.ndimage.median_filter(volume, size=2 * radius + 1, mode="nearest")`, to the last bit.
///
/// A sample that is NaN stays NaN and counts for no other voxel: these are the median of the numbers in their cube, of
/// an even number of them the lower one of the two in the middle. Infinities are numbers.
pub type Medianed<'a> = Filtered<'a, Median>;

impl<'a> Filtered<'a, Median> {
    /// Filters `inner` with cubes of `2 * radius + 1` voxels along each axis.
    ///
    /// # Errors
    /// [`Error::Usage`] unless the radius is 1 or 2.
    pub fn new(inner: Box<dyn Volume + 'a>, radius: u32) -> Result<Self> {
        if !(1..=2).contains(&radius) {
            let expected = "a radius of 1 or 2 voxels";
            return Err(Error::usage("--median", radius.to_string(), expected));
        }
        Ok(Filtered::around(inner, Median { radius }))
    }
}

/// A median.
#[derive(Debug, Clone, Copy)]
pub struct Median {
    /// In voxels.
    radius: u32,
}

impl Neighbourhood for Median {
    fn radius(&self) -> [u32; 3] {
        [self.radius; 3]
    }

    fn output(&self, input: Dtype) -> Dtype {
        input
    }

    fn rows_kept(&self, rows: u64) -> u64 {
        rows + 2 * u64::from(self.radius)
    }

    fn row_bytes(&self, input: Dtype, width: u64) -> RowBytes {
        let bytes = (width + 2 * u64::from(self.radius)) * input.bytes() as u64;
        RowBytes {
            usual: bytes,
            most: bytes,
        }
    }

    fn window(&self, input: Dtype, region: Region, slots: usize) -> Box<dyn Window> {
        with_voxel_type!(input, T => Box::new(Keys::<T>::new(self.radius as usize, region, slots)))
    }
}

/// Slices of a region as keys, with copies of the ends of rows.
struct Keys<T: Ordered> {
    radius: usize,
    region: Region,
    samples: Vec<T>,
    /// Rows of own voxels and those around, slot by slot.
    keys: Vec<T::Key>,
    /// Those of which samples are missing.
    missing: Vec<bool>,
    /// Keys of a row, and its samples.
    medians: Vec<T::Key>,
    values: Vec<T>,
    /// Where any sample across a row is missing.
    gaps: Vec<bool>,
    /// The numbers in a cube.
    numbers: Vec<T::Key>,
}

impl<T: Ordered> Keys<T> {
    fn new(radius: usize, region: Region, slots: usize) -> Self {
        let (width, rows) = (region.own[0].len(), region.read[1].len());
        let padded = width + 2 * radius;
        Keys {
            radius,
            samples: vec![T::zeroed(); region.samples()],
            keys: vec![T::Key::LOWEST; slots * rows * padded],
            missing: vec![false; slots * rows],
            medians: vec![T::Key::LOWEST; width],
            values: vec![T::zeroed(); width],
            gaps: vec![false; padded],
            numbers: Vec::new(),
            region,
        }
    }

    /// Samples of a row with copies of its ends.
    fn padded(&self) -> usize {
        self.region.own[0].len() + 2 * self.radius
    }

    #[inline(always)]
    fn take_rows(&mut self, slot: usize) {
        let (width, padded) = (self.region.width(), self.padded());
        let [before, _] = self.region.copies();
        let rows = self.region.read[1].len();
        let keys = self.keys[slot * rows * padded..].chunks_exact_mut(padded);
        let missing = &mut self.missing[slot * rows..][..rows];
        let samples = self.samples.chunks_exact(width);
        for ((samples, keys), missing) in samples.zip(keys).zip(missing) {
            let (copies, rest) = keys.split_at_mut(before);
            let (own, behind) = rest.split_at_mut(width);
            let mut numbers = true;
            for (key, sample) in own.iter_mut().zip(samples) {
                *key = sample.key();
                numbers &= T::is_number(*key);
            }
            copies.fill(own[0]);
            behind.fill(own[width - 1]);
            *missing = !numbers;
        }
    }

    /// The rows that own row `j` is made of.
    fn rows<'a>(&'a self, slots: &'a [usize], j: usize) -> impl Iterator<Item = usize> + 'a {
        let count = self.region.read[1].len();
        let of_slot = move |tap| move |slot: &usize| slot * count + self.region.row(j, tap);
        (0..=2 * self.radius).flat_map(move |tap| slots.iter().map(of_slot(tap)))
    }

    /// Fills the first `x.len()` medians with those of a part of row `j`.
    #[inline(always)]
    fn row(&mut self, slots: &[usize], x: &Range<usize>, j: usize) {
        let mut at = [0; 25];
        for (at, row) in at.iter_mut().zip(self.rows(slots, j)) {
            *at = row;
        }
        let (padded, length) = (self.padded(), x.len() + 2 * self.radius);
        let keys = |row: usize| &self.keys[row * padded + x.start..][..length];
        let medians = &mut self.medians[..x.len()];
        match self.radius {
            1 => medians_of_27(std::array::from_fn(|i| keys(at[i])), medians),
            _ => medians_of_125(at.map(keys), medians),
        }
        let rows = &at[..(2 * self.radius + 1) * slots.len()];
        if T::DTYPE.is_float() && rows.iter().any(|&row| self.missing[row]) {
            self.mend(rows, x);
        }
        for (value, key) in self.values.iter_mut().zip(&self.medians[..x.len()]) {
            *value = T::of_key(*key);
        }
    }

    /// Takes the medians again where samples are missing.
    fn mend(&mut self, rows: &[usize], x: &Range<usize>) {
        let (padded, side) = (self.padded(), 2 * self.radius + 1);
        let keys = |row: usize| &self.keys[row * padded + x.start..][..x.len() + side - 1];
        self.gaps.fill(false);
        for &row in rows.iter().filter(|&&row| self.missing[row]) {
            for (gap, key) in self.gaps.iter_mut().zip(keys(row)) {
                *gap |= !T::is_number(*key);
            }
        }
        let centre = keys(rows[rows.len() / 2]);
        for i in (0..x.len()).filter(|&i| self.gaps[i..i + side].contains(&true)) {
            let own = centre[i + self.radius];
            self.medians[i] = own;
            if T::is_number(own) {
                let cube = rows.iter().flat_map(|&row| &keys(row)[i..i + side]);
                self.numbers.clear();
                self.numbers.extend(cube.filter(|key| T::is_number(**key)));
                self.medians[i] = lower_median(&mut self.numbers);
            }
        }
    }
}

impl<T: Ordered> Window for Keys<T> {
    fn samples(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.samples)
    }

    fn take(&mut self, slot: usize) {
        dispatch!(self.take_rows(slot));
    }

    fn put(&mut self, slots: &[usize], x: Range<usize>, y: Range<usize>, out: &mut [u8]) {
        for (j, out) in y.zip(out.chunks_exact_mut(x.len() * size_of::<T>())) {
            dispatch!(self.row(slots, &x, j));
            out.copy_from_slice(bytemuck::cast_slice(&self.values[..x.len()]));
        }
    }
}
