//! A Gaussian filter as a volume.
//!
//! Rows of a slice are summed along y, these along x, and slices along z, each time from the outermost pair of samples
//! to the one in the middle.
//!
//! Samples that are no finite number are left out: sums over the others, with 0 in their place, are divided by the sum
//! of the others' weights (normalised convolution: Knutsson and Westin, CVPR 1993), relative to what that is where none
//! is missing. So where none is in reach, numbers are divided by exactly 1, and need not be.

use super::gaussian_kernel::{Real, reach, weigh, weights};
use super::neighbourhood::{Filtered, Neighbourhood, Region, RowBytes, Window};
use crate::error::{Error, Result};
use crate::sys::simd::dispatch;
use crate::volume::{Dtype, Volume, Voxel, with_voxel_type};
use bytemuck::Zeroable;
use std::ops::Range;

/// The largest standard deviation, in voxels: voxels within 128 are in reach.
const LARGEST: f64 = 32.0;

/// A volume smoothed by a Gaussian.
///
/// Values are those of `scipy.ndimage.gaussian_filter(volume, sigma, mode="nearest", truncate=4)` but for rounding:
/// f64 where samples are f64, else f32; sums are f32 where samples have at most 16 bits or are f32, else f64.
///
/// A sample that is NaN or infinite stays what it is and reaches no other voxel: these are the mean of the finite
/// samples within reach, with the weights of the Gaussian.
pub type Smoothed<'a> = Filtered<'a, Gaussian>;

impl<'a> Filtered<'a, Gaussian> {
    /// Smooths `inner` with a standard deviation of `sigma` voxels.
    ///
    /// # Errors
    /// [`Error::Usage`] unless 0 < `sigma` <= 32.
    pub fn new(inner: Box<dyn Volume + 'a>, sigma: f64) -> Result<Self> {
        Self::along_axes(inner, [sigma; 3])
    }

    /// Smooths with a standard deviation for each axis, in voxels; 0 leaves an axis as it is.
    ///
    /// # Errors
    /// [`Error::Usage`] unless all are from 0 to 32, and one is not 0.
    pub fn along_axes(inner: Box<dyn Volume + 'a>, sigma: [f64; 3]) -> Result<Self> {
        let allowed = sigma.iter().all(|s| (0.0..=LARGEST).contains(s));
        if !allowed || sigma == [0.0; 3] {
            let [x, y, z] = sigma.map(|s| s.to_string());
            let found = match x == y && y == z {
                true => x,
                false => format!("{x}, {y} and {z} along x, y and z"),
            };
            let expected = format!("a standard deviation above 0 and up to {LARGEST} voxels");
            return Err(Error::usage("--smooth", found, expected));
        }
        Ok(Filtered::around(inner, Gaussian { sigma }))
    }
}

/// A Gaussian.
#[derive(Debug, Clone, Copy)]
pub struct Gaussian {
    /// Standard deviations along the axes, in voxels.
    sigma: [f64; 3],
}

impl Neighbourhood for Gaussian {
    fn radius(&self) -> [u32; 3] {
        self.sigma.map(reach)
    }

    fn output(&self, input: Dtype) -> Dtype {
        with_voxel_type!(input, T => <T as Sample>::Value::DTYPE)
    }

    fn rows_kept(&self, rows: u64) -> u64 {
        rows
    }

    fn row_bytes(&self, input: Dtype, width: u64) -> RowBytes {
        let number = with_voxel_type!(input, T => size_of::<<T as Sample>::Sum>()) as u64;
        RowBytes {
            usual: width * number,
            most: match input.is_float() {
                true => width * (2 * number + 1),
                false => width * number,
            },
        }
    }

    fn window(&self, input: Dtype, region: Region, slots: usize) -> Box<dyn Window> {
        with_voxel_type!(input, T => Box::new(Planes::<T>::new(self.sigma, region, slots)))
    }
}

/// A sample that can be smoothed.
trait Sample: Voxel {
    /// What sums are kept in.
    type Sum: Real;
    /// What values are handed out in.
    type Value: Voxel;

    /// The sample as a number; 0 if it is no finite one.
    fn number(self) -> Self::Sum;

    /// What it is.
    fn kind(self) -> Kind;

    /// A sum as it is handed out.
    fn value(sum: Self::Sum) -> Self::Value;
}

/// What a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    Finite,
    Nan,
    Infinite,
    MinusInfinite,
}

macro_rules! integer_sample {
    ($($t:ty => $sum:ty;)*) => {$(
        impl Sample for $t {
            type Sum = $sum;
            type Value = f32;
            #[inline(always)]
            fn number(self) -> $sum {
                self.into()
            }
            #[inline(always)]
            fn kind(self) -> Kind {
                Kind::Finite
            }
            #[inline(always)]
            fn value(sum: $sum) -> f32 {
                sum as f32
            }
        }
    )*};
}

integer_sample! {
    u8 => f32;
    i8 => f32;
    u16 => f32;
    i16 => f32;
    u32 => f64;
    i32 => f64;
}

macro_rules! float_sample {
    ($($t:ty)*) => {$(
        impl Sample for $t {
            type Sum = $t;
            type Value = $t;
            #[inline(always)]
            fn number(self) -> $t {
                if self.abs() < <$t>::INFINITY { self } else { 0.0 }
            }
            #[inline(always)]
            fn kind(self) -> Kind {
                if self.is_finite() {
                    Kind::Finite
                } else if self.is_nan() {
                    Kind::Nan
                } else if self > 0.0 {
                    Kind::Infinite
                } else {
                    Kind::MinusInfinite
                }
            }
            #[inline(always)]
            fn value(sum: $t) -> $t {
                sum
            }
        }
    )*};
}

float_sample! { f32 f64 }

/// Slices of a region, smoothed along x and y.
struct Planes<T: Sample> {
    region: Region,
    /// Weights along x, y and z.
    weights: [Vec<T::Sum>; 3],
    samples: Vec<T>,
    /// Sums of own voxels, slot by slot.
    sums: Vec<T::Sum>,
    /// Once a sample was missing.
    gaps: Option<Gaps<T::Sum>>,
    /// What a voxel's share of all weights is where none is missing, after passes along y and x, and along z, too.
    whole: [T::Sum; 2],
    lines: Lines<T::Sum>,
    /// Values of a row, sums of its weights, and its values as they are handed out.
    row: Vec<T::Sum>,
    share: Vec<T::Sum>,
    values: Vec<T::Value>,
}

/// Of slices in which samples are missing.
struct Gaps<R> {
    /// Sums of weights of the samples that are there, in the places of the sums of these.
    weights: Vec<R>,
    kinds: Vec<Kind>,
    /// Samples are missing in the slice in a slot.
    of_slot: Vec<bool>,
}

/// Rows on their way through a slice.
struct Lines<R> {
    /// Numbers of the rows that one is made of, each in the place of its number modulo theirs.
    numbers: Vec<R>,
    /// A row after the pass along y, with copies of its ends.
    padded: Vec<R>,
    /// Where rows begin that are summed.
    at: Vec<usize>,
}

impl<T: Sample> Planes<T> {
    fn new(sigma: [f64; 3], region: Region, slots: usize) -> Self {
        let weights = sigma.map(weights::<T::Sum>);
        let [width, height] = [0, 1].map(|a| region.own[a].len());
        let [before, behind] = region.copies();
        let zero = T::Sum::of(0.0);
        let after = |whole: T::Sum, weights: &[T::Sum]| {
            let mut out = [zero];
            weigh(&[whole], &vec![0; 2 * weights.len() - 1], weights, &mut out);
            out[0]
        };
        let in_slice = after(after(T::Sum::of(1.0), &weights[1]), &weights[0]);
        Planes {
            samples: vec![T::zeroed(); region.samples()],
            sums: vec![zero; slots * width * height],
            gaps: None,
            whole: [in_slice, after(in_slice, &weights[2])],
            lines: Lines {
                numbers: vec![zero; (2 * weights[1].len() - 1) * region.width()],
                padded: vec![zero; before + region.width() + behind],
                at: Vec::new(),
            },
            row: vec![zero; width],
            share: vec![zero; width],
            values: vec![T::Value::zeroed(); width],
            weights,
            region,
        }
    }

    /// Own voxels of a slice.
    fn plane(&self) -> usize {
        self.region.own[0].len() * self.region.own[1].len()
    }

    /// Takes what is missing in the slice in hand, if there was ever any.
    fn take_gaps(&mut self, slot: usize) {
        let missing = T::DTYPE.is_float() && !dispatch!(all_are_finite(&self.samples));
        if !missing && self.gaps.is_none() {
            return;
        }
        let plane = self.plane();
        let (total, whole) = (self.sums.len(), self.whole[0]);
        let gaps = self.gaps.get_or_insert_with(|| Gaps {
            weights: vec![whole; total],
            kinds: vec![Kind::Finite; total],
            of_slot: vec![false; total / plane],
        });
        let before = std::mem::replace(&mut gaps.of_slot[slot], missing);
        let weights = &mut gaps.weights[slot * plane..][..plane];
        let kinds = &mut gaps.kinds[slot * plane..][..plane];
        if missing {
            let one = |sample: T| T::Sum::of(f64::from(u8::from(sample.kind() == Kind::Finite)));
            let source = Source {
                region: &self.region,
                weights: &self.weights,
                samples: &self.samples,
            };
            dispatch!(source.smooth(one, &mut self.lines, weights));
            source.tell_kinds(kinds);
        } else if before {
            weights.fill(whole);
            kinds.fill(Kind::Finite);
        }
    }

    /// Fills a row of values with those whose slices begin at `at`, from the outermost one before to that behind.
    #[inline(always)]
    fn row(&mut self, at: &[usize], count: usize, missing: bool) {
        let row = &mut self.row[..count];
        weigh(&self.sums, at, &self.weights[2], row);
        if let Some(gaps) = self.gaps.as_ref().filter(|_| missing) {
            let share = &mut self.share[..count];
            weigh(&gaps.weights, at, &self.weights[2], share);
            let kinds = &gaps.kinds[at[at.len() / 2]..][..count];
            for ((value, share), kind) in row.iter_mut().zip(share).zip(kinds) {
                *value = match kind {
                    Kind::Finite => *value / (*share / self.whole[1]),
                    Kind::Nan => T::Sum::of(f64::NAN),
                    Kind::Infinite => T::Sum::of(f64::INFINITY),
                    Kind::MinusInfinite => T::Sum::of(f64::NEG_INFINITY),
                };
            }
        }
        for (value, sum) in self.values.iter_mut().zip(row) {
            *value = T::value(*sum);
        }
    }
}

#[inline(always)]
fn all_are_finite<T: Sample>(samples: &[T]) -> bool {
    // in pieces, of which all are looked at, so that many are at once
    let finite = |piece: &[T]| {
        let kinds = piece.iter().map(|s| s.kind() == Kind::Finite);
        kinds.fold(true, |all, one| all & one)
    };
    samples.chunks(4096).all(finite)
}

/// A slice that is to be smoothed along y and x.
struct Source<'a, T: Sample> {
    region: &'a Region,
    weights: &'a [Vec<T::Sum>; 3],
    samples: &'a [T],
}

impl<T: Sample> Source<'_, T> {
    /// Fills `out` with the sums of own voxels.
    #[inline(always)]
    fn smooth(&self, number: impl Fn(T) -> T::Sum, lines: &mut Lines<T::Sum>, out: &mut [T::Sum]) {
        let [along_x, along_y, _] = self.weights;
        let (width, taps) = (self.region.width(), 2 * along_y.len() - 1);
        let Lines {
            numbers,
            padded,
            at,
        } = lines;
        let [before, _] = self.region.copies();
        let mut rows = self.samples.chunks_exact(width);
        // rows that were taken
        let mut ready = 0;
        for (j, out) in out.chunks_exact_mut(self.region.own[0].len()).enumerate() {
            while ready <= self.region.row(j, taps - 1) {
                let slot = &mut numbers[ready % taps * width..][..width];
                for (out, sample) in slot.iter_mut().zip(rows.next().unwrap_or_default()) {
                    *out = number(*sample);
                }
                ready += 1;
            }
            at.clear();
            at.extend((0..taps).map(|tap| self.region.row(j, tap) % taps * width));
            let (copies, rest) = padded.split_at_mut(before);
            let (row, behind) = rest.split_at_mut(width);
            weigh(numbers, at, along_y, row);
            copies.fill(row[0]);
            behind.fill(row[width - 1]);
            at.clear();
            at.extend(0..2 * along_x.len() - 1);
            weigh(padded, at, along_x, out);
        }
    }
}

impl<T: Sample> Source<'_, T> {
    /// Fills `out` with what the samples of own voxels are.
    fn tell_kinds(&self, out: &mut [Kind]) {
        let Region { own, read, .. } = self.region;
        let [left, top] = [0, 1].map(|a| (own[a].start - read[a].start) as usize);
        let rows = self.samples.chunks_exact(self.region.width()).skip(top);
        for (kinds, row) in out.chunks_exact_mut(own[0].len()).zip(rows) {
            for (kind, sample) in kinds.iter_mut().zip(&row[left..]) {
                *kind = sample.kind();
            }
        }
    }
}

impl<T: Sample> Window for Planes<T> {
    fn samples(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.samples)
    }

    fn take(&mut self, slot: usize) {
        let plane = self.plane();
        let source = Source {
            region: &self.region,
            weights: &self.weights,
            samples: &self.samples,
        };
        let out = &mut self.sums[slot * plane..][..plane];
        dispatch!(source.smooth(T::number, &mut self.lines, out));
        self.take_gaps(slot);
    }

    fn put(&mut self, slots: &[usize], x: Range<usize>, y: Range<usize>, out: &mut [u8]) {
        let (plane, width, count) = (self.plane(), self.region.own[0].len(), x.len());
        let gaps = self.gaps.as_ref();
        let missing = gaps.is_some_and(|gaps| slots.iter().any(|&slot| gaps.of_slot[slot]));
        let mut at = vec![0; slots.len()];
        for (j, out) in y.zip(out.chunks_exact_mut(count * size_of::<T::Value>())) {
            for (at, slot) in at.iter_mut().zip(slots) {
                *at = slot * plane + j * width + x.start;
            }
            dispatch!(self.row(&at, count, missing));
            out.copy_from_slice(bytemuck::cast_slice(&self.values[..count]));
        }
    }
}
