//! Weighted sums of rows: one pass of a Gaussian, along whichever axis.

use bytemuck::Pod;
use std::ops::{Add, Div, Mul};

/// A number that sums are kept in.
pub trait Real:
    Pod
    + Send
    + Sync
    + PartialEq
    + Add<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + 'static
{
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as f32
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
}

/// How far a Gaussian of a standard deviation of `sigma` voxels reaches: `int(4 sigma + 0.5)`, as `scipy.ndimage` has
/// it.
pub(super) fn reach(sigma: f64) -> u32 {
    (4.0 * sigma + 0.5) as u32
}

/// The weights of voxels at distances 0, 1, ... up to the reach: `exp(-d^2 / 2 sigma^2)`, divided by the sum over both
/// sides.
pub(crate) fn weights<F: Real>(sigma: f64) -> Vec<F> {
    let weight = |d: u32| match d {
        0 => 1.0,
        _ => {
            let d = f64::from(d) / sigma;
            libm::exp(-0.5 * d * d)
        }
    };
    let half: Vec<f64> = (0..=reach(sigma)).map(weight).collect();
    let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
    half.iter().map(|w| F::of(w / sum)).collect()
}

/// Fills `out[i]` with the sum over d of `weights[d] * (source[at[r - d] + i] + source[at[r + d] + i])`, where r is the
/// largest distance; that of distance 0 counts once. Sums begin at the largest distance and end with 0.
///
/// `at` has the 2 r + 1 places in `source` at which rows of `out.len()` numbers begin.
#[inline(always)]
pub(super) fn weigh<F: Real>(source: &[F], at: &[usize], weights: &[F], out: &mut [F]) {
    let (count, radius) = (out.len(), weights.len() - 1);
    let row = |tap: usize| &source[at[tap]..][..count];
    let pair = |d: usize| Pair {
        before: row(radius - d),
        after: row(radius + d),
        weight: weights[d],
    };
    let centre = Centre {
        row: row(radius),
        weight: weights[0],
    };
    let mut d = radius;
    // numbers of pairs are known to the compiler, so that rows are passed over few times
    while d > 4 {
        let pairs = [pair(d), pair(d - 1), pair(d - 2), pair(d - 3)];
        match d == radius {
            true => sweep::<F, 4, true, false>(pairs, centre, out),
            false => sweep::<F, 4, false, false>(pairs, centre, out),
        }
        d -= 4;
    }
    match (d, d == radius) {
        (0, _) => sweep::<F, 0, true, true>([], centre, out),
        (1, true) => sweep::<F, 1, true, true>([pair(1)], centre, out),
        (1, false) => sweep::<F, 1, false, true>([pair(1)], centre, out),
        (2, true) => sweep::<F, 2, true, true>([pair(2), pair(1)], centre, out),
        (2, false) => sweep::<F, 2, false, true>([pair(2), pair(1)], centre, out),
        (3, true) => sweep::<F, 3, true, true>([pair(3), pair(2), pair(1)], centre, out),
        (3, false) => sweep::<F, 3, false, true>([pair(3), pair(2), pair(1)], centre, out),
        (_, first) => {
            let pairs = [pair(4), pair(3), pair(2), pair(1)];
            match first {
                true => sweep::<F, 4, true, true>(pairs, centre, out),
                false => sweep::<F, 4, false, true>(pairs, centre, out),
            }
        }
    }
}

/// Two rows at the same distance from the centre, on either side.
#[derive(Clone, Copy)]
struct Pair<'a, F> {
    before: &'a [F],
    after: &'a [F],
    weight: F,
}

/// The row in the middle.
#[derive(Clone, Copy)]
struct Centre<'a, F> {
    row: &'a [F],
    weight: F,
}

/// Adds pairs of rows to `out`, in their order, which begins with the `FIRST` and ends with the centre of the `LAST`.
#[inline(always)]
fn sweep<F: Real, const PAIRS: usize, const FIRST: bool, const LAST: bool>(
    pairs: [Pair<F>; PAIRS],
    centre: Centre<F>,
    out: &mut [F],
) {
    let count = out.len();
    // of one length, which spares the comparisons below
    let pairs = pairs.map(|pair| Pair {
        before: &pair.before[..count],
        after: &pair.after[..count],
        ..pair
    });
    let row = &centre.row[..count];
    for i in 0..count {
        let mut sum = out[i];
        for (nth, pair) in pairs.iter().enumerate() {
            let term = (pair.before[i] + pair.after[i]) * pair.weight;
            sum = if FIRST && nth == 0 { term } else { sum + term };
        }
        if LAST {
            let term = row[i] * centre.weight;
            sum = match FIRST && PAIRS == 0 {
                true => term,
                false => sum + term,
            };
        }
        out[i] = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sys::simd::dispatch;

    /// For every reach, sums are those of the definition, in the same order, to the last bit.
    #[test]
    fn sums_are_taken_in_one_order() {
        for radius in 0..19usize {
            let count = 37;
            let source: Vec<f32> = (0..count + 4 * radius)
                .map(|i| ((i * 7919) % 1009) as f32 * 0.37 - 100.0)
                .collect();
            let weights = weights::<f32>(radius as f64 / 4.0);
            assert_eq!(weights.len(), radius + 1);
            let at: Vec<usize> = (0..=2 * radius).map(|t| 2 * t).collect();
            let expected: Vec<f32> = (0..count)
                .map(|i| {
                    let pair = |d: usize| source[at[radius - d] + i] + source[at[radius + d] + i];
                    let pairs = (1..=radius).rev().map(|d| pair(d) * weights[d]);
                    let centre = source[at[radius] + i] * weights[0];
                    match pairs.reduce(|sum, term| sum + term) {
                        Some(sum) => sum + centre,
                        None => centre,
                    }
                })
                .collect();
            let mut out = vec![0.0; count];
            dispatch!(weigh(&source, &at, &weights, &mut out));
            assert_eq!(out, expected, "{radius}");
            out.fill(f32::NAN);
            weigh(&source, &at, &weights, &mut out);
            assert_eq!(out, expected, "{radius}");
        }
    }

    #[test]
    fn weights_are_those_of_scipy() {
        // scipy.ndimage._filters._gaussian_kernel1d(1.0, 0, 4)[4:]
        let known = [
            0.39894346935609776,
            0.24197144565660075,
            0.05399112742070441,
            0.00443186162003127,
            0.00013383062461474175,
        ];
        let found = weights::<f64>(1.0);
        assert_eq!(found.len(), known.len());
        for (found, known) in found.iter().zip(known) {
            assert!((found / known - 1.0).abs() < 1e-14, "{found} {known}");
        }
        let reaches = [0.0, 0.1, 0.125, 0.5, 1.0, 1.1, 2.6].map(reach);
        assert_eq!(reaches, [0, 0, 1, 2, 4, 4, 10]);
        assert_eq!(weights::<f32>(0.0), [1.0]);
    }
}
