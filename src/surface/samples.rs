//! Samples around crossed edges, without a bounds check for each.

use crate::sys::simd::prefetch;
use crate::volume::Voxel;

/// The two ends of a crossed edge.
#[derive(Debug, Clone, Copy)]
pub struct Ends<T: Voxel> {
    /// Samples at the lower and the upper end.
    pub values: [T; 2],
    /// Gradients from central differences at the lower and the upper end.
    pub slopes: [[T::Slope; 3]; 2],
}

/// Samples of a band with the strides of its grid.
#[derive(Debug, Clone, Copy)]
pub struct Samples<'a, T> {
    samples: &'a [T],
    strides: [usize; 3],
}

impl<'a, T: Voxel> Samples<'a, T> {
    /// `strides` are the sample steps along x (1), y and z; each at least as long as the one before.
    pub fn new(samples: &'a [T], strides: [usize; 3]) -> Self {
        assert!(strides[0] == 1 && strides[1] >= 1 && strides[2] >= strides[1]);
        Samples { samples, strides }
    }

    /// True if every sample that [`Samples::ends`] reads lies inside for edges whose lower ends are
    /// the samples `first..=last`.
    pub fn covers(&self, first: usize, last: usize) -> bool {
        let reach = self.strides[2];
        first <= last && first >= reach && last + 2 * reach < self.samples.len()
    }

    /// The ends of the edge from sample `p` along `AXIS`, both of them inside the volume by a voxel.
    /// The axis is known when this is compiled, so that samples which both ends need are read once.
    ///
    /// # Safety
    /// `covers(first, last)` was true for some `first <= p <= last`, and `AXIS` is 0, 1 or 2.
    #[inline(always)]
    pub unsafe fn ends<const AXIS: usize>(&self, p: usize) -> Ends<T> {
        // SAFETY: the largest stride is the reach: all indices lie in p - reach ..= p + 2 reach,
        // which the caller has had checked
        let at = |i: usize| unsafe { *self.samples.get_unchecked(i) };
        let [_, y, z] = self.strides;
        let slope = |p: usize, s: usize| at(p + s).central_slope(at(p - s));
        let around = |p: usize| [slope(p, 1), slope(p, y), slope(p, z)];
        let q = p + [1, y, z][AXIS];
        Ends {
            values: [at(p), at(q)],
            slopes: [around(p), around(q)],
        }
    }

    /// Asks for the `count` samples from `first` on to be fetched, which need not be there; a hint that changes speed
    /// alone.
    #[inline(always)]
    pub fn prefetch(&self, first: usize, count: usize) {
        let line = (CACHE_LINE / size_of::<T>()).max(1);
        // one more than lines, for the first seldom begins with one
        for at in (0..count + line - 1).step_by(line) {
            prefetch(self.samples, first.wrapping_add(at));
        }
    }
}

const CACHE_LINE: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Slope;

    fn is_unchecked_equal<T: Voxel>(strides: [usize; 3], all: &[T], [first, last]: [usize; 2]) {
        let samples = Samples::new(all, strides);
        assert!(samples.covers(first, last));
        assert!(!samples.covers(first - 1, last) && !samples.covers(first, last + 1));
        assert!(!samples.covers(last, first) || first == last);
        let value = |p: usize| all[p].to_f64();
        for p in first..=last {
            // SAFETY: covered, as was asserted
            let of_axis = unsafe {
                [
                    samples.ends::<0>(p),
                    samples.ends::<1>(p),
                    samples.ends::<2>(p),
                ]
            };
            for (axis, ends) in of_axis.iter().enumerate() {
                for (end, at) in [p, p + strides[axis]].into_iter().enumerate() {
                    assert_eq!(ends.values[end].to_f64(), value(at));
                    for (a, s) in strides.into_iter().enumerate() {
                        let expected = (value(at + s) - value(at - s)) as f32 / 2.0;
                        assert_eq!(ends.slopes[end][a].to_f32(), expected);
                    }
                }
            }
        }
        for (from, count) in [(0, all.len()), (1, 0), (last, 3), (usize::MAX, 300)] {
            samples.prefetch(from, count);
        }
    }

    #[test]
    fn what_is_read_unchecked_is_what_lies_there_up_to_both_ends() {
        // the first and the last sample with all that is read of it inside
        let (strides, len) = ([1, 4, 12], 60);
        let ends = [strides[2], len - 1 - 2 * strides[2]];
        let bytes: Vec<u8> = (0..len).map(|i| (i * i * 7 % 251) as u8).collect();
        is_unchecked_equal(strides, &bytes, ends);
        let floats: Vec<f32> = bytes.iter().map(|&b| f32::from(b) - 100.5).collect();
        is_unchecked_equal(strides, &floats, ends);
        // a volume of one row: all strides are the same
        is_unchecked_equal([1, 1, 1], &bytes[..4], [1, 1]);
    }
}
