//! Medians along a row: of 3 x 3 x 3 samples by a network of comparisons, of 5 x 5 x 5 bit by bit.
//!
//! The network sorts each column of nine once, for the three windows that it lies in. Of three sorted columns, those
//! that cannot be the median are left out by their ranks alone, as Kolte, Smith and Su (A fast median filter using AltiVec,
//! ICCD 1999) do in two dimensions. All loops run along the row, a wide vector at a time.

use super::ordered::Key;

/// Samples of a row that are done at a time, so that what is sorted stays in the nearest cache.
pub(super) const PIECE: usize = 256;

/// Puts the smaller one of two elements first, for each pair of places in turn.
macro_rules! sort_pairs {
    ($all:ident, $($low:literal $high:literal),*) => {$(
        ($all[$low], $all[$high]) = ($all[$low].min($all[$high]), $all[$low].max($all[$high]));
    )*};
}

/// Nine samples in their order, by 25 comparisons (Floyd's network).
#[inline(always)]
fn sort_nine<K: Key>(mut all: [K; 9]) -> [K; 9] {
    // three by three, and these across
    sort_pairs!(all, 0 1, 3 4, 6 7, 1 2, 4 5, 7 8, 0 1, 3 4, 6 7);
    sort_pairs!(all, 0 3, 3 6, 0 3, 1 4, 4 7, 1 4, 2 5, 5 8, 2 5);
    sort_pairs!(all, 1 3, 5 7, 2 6, 4 6, 2 4, 2 3, 5 6);
    all
}

#[inline(always)]
fn middle<K: Key>([a, b, c]: [K; 3]) -> K {
    a.min(b).max(a.max(b).min(c))
}

/// The median of three sorted columns of nine.
///
/// The samples of each rank are sorted across the columns, too. Then the one of rank r (from 1) that is number s of its
/// three has r s - 1 others that are no larger and (10 - r)(4 - s) - 1 that are no smaller: where either is 14 or more,
/// it need not be looked at. Seven of those left out are at the low end, seven at the high end; 13 remain.
#[inline(always)]
fn median_of_columns<K: Key>(of_rank: impl Fn(usize) -> [K; 3]) -> K {
    let least = |rank: usize| {
        let [a, b, c] = of_rank(rank - 1);
        a.min(b).min(c)
    };
    let most = |rank: usize| {
        let [a, b, c] = of_rank(rank - 1);
        a.max(b).max(c)
    };
    let [q1, q2, q3, q4, q5] = [3, 4, 5, 6, 7].map(|rank| middle(of_rank(rank - 1)));
    let low = [6, 7, 8, 9].map(least);
    let high = [1, 2, 3, 4].map(most);
    // both are sorted: Batcher's odd-even merge
    let mut both = [
        low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3],
    ];
    sort_pairs!(both, 0 4, 1 5, 2 6, 3 7, 2 4, 3 5, 1 2, 3 4, 5 6);
    let [_, t2, t3, t4, t5, t6, t7, _] = both;
    // the seventh of two sorted rows
    let a = t7.min(t6.max(q1)).min(t5.max(q2));
    let b = t4.max(q3).min(t3.max(q4)).min(t2.max(q5));
    a.min(b)
}

/// Medians of 27: `rows` are those of a window across the row, each two samples longer than `out`.
#[inline(always)]
pub(super) fn medians_of_27<K: Key>(rows: [&[K]; 9], out: &mut [K]) {
    let mut columns = [[K::LOWEST; PIECE + 2]; 9];
    for (nth, out) in out.chunks_mut(PIECE).enumerate() {
        let count = out.len();
        let rows = rows.map(|row| &row[nth * PIECE..][..count + 2]);
        for i in 0..count + 2 {
            let sorted = sort_nine(rows.map(|row| row[i]));
            for rank in 0..9 {
                columns[rank][i] = sorted[rank];
            }
        }
        for i in 0..count {
            let of_rank = |rank: usize| [0, 1, 2].map(|j| columns[rank][i + j]);
            out[i] = median_of_columns(of_rank);
        }
    }
}

/// Medians of 125: `rows` are those of a window across the row, each four samples longer than `out`.
///
/// The median is the largest number that fewer than 63 samples are below of. Its bits are found one by one, those left
/// out that all samples share.
#[inline(always)]
pub(super) fn medians_of_125<K: Key>(rows: [&[K]; 25], out: &mut [K]) {
    let half = K::of_count(62);
    let mut tried = [K::LOWEST; PIECE];
    let mut below = [K::LOWEST; PIECE];
    for (nth, out) in out.chunks_mut(PIECE).enumerate() {
        let count = out.len();
        let rows = rows.map(|row| &row[nth * PIECE..][..count + 4]);
        let [low, high] = ends(&rows);
        let shared = low.bits_shared(high);
        out.fill(low.highest_bits(shared));
        for bit in (0..K::BITS - shared).rev() {
            for (tried, out) in tried.iter_mut().zip(&*out) {
                *tried = out.with_bit(bit);
            }
            below.fill(K::of_count(0));
            for five in rows.as_chunks::<5>().0 {
                count_below(five, &tried[..count], &mut below[..count]);
            }
            for i in 0..count {
                out[i] = if below[i] <= half { tried[i] } else { out[i] };
            }
        }
    }
}

/// The lowest and the highest of all.
#[inline(always)]
fn ends<K: Key>(rows: &[&[K]]) -> [K; 2] {
    let [mut low, mut high] = [rows[0][0]; 2];
    for row in rows {
        for key in *row {
            low = low.min(*key);
            high = high.max(*key);
        }
    }
    [low, high]
}

/// Adds how many samples of five rows, each in a window of five, are below a number.
#[inline(always)]
fn count_below<K: Key>(rows: &[&[K]; 5], limits: &[K], counts: &mut [K]) {
    let count = limits.len();
    let counts = &mut counts[..count];
    let rows = rows.map(|row| &row[..count + 4]);
    for i in 0..count {
        let mut sum = counts[i];
        for row in rows {
            for j in 0..5 {
                sum = sum.plus(row[i + j] < limits[i]);
            }
        }
        counts[i] = sum;
    }
}

/// The median of any number of keys, at least one: of an even number, the lower one of the two in the middle.
pub(super) fn lower_median<K: Key>(keys: &mut [K]) -> K {
    let middle = (keys.len() - 1) / 2;
    *keys.select_nth_unstable(middle).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sys::simd::dispatch;
    use proptest::prelude::*;

    /// A network of minima and maxima is right if it is so for all inputs of zeros and ones.
    #[test]
    fn networks_sort_zeros_and_ones() {
        for bits in 0..512u32 {
            let all = std::array::from_fn(|i| (bits >> i & 1) as i8);
            let mut expected = all;
            expected.sort_unstable();
            assert_eq!(sort_nine(all), expected);
        }
        for ones in 0..1000 {
            let ones = [ones % 10, ones / 10 % 10, ones / 100];
            let of_rank = |rank: usize| ones.map(|n| i8::from(rank >= 9 - n));
            let mut all: Vec<i8> = (0..9).flat_map(of_rank).collect();
            assert_eq!(median_of_columns(of_rank), lower_median(&mut all));
        }
    }

    fn check<K: Key + std::fmt::Debug>(all: &[K], count: usize, side: usize) {
        let row = |r: usize| &all[r * (count + side - 1)..][..count + side - 1];
        let expected: Vec<K> = (0..count)
            .map(|i| {
                let window = (0..side * side).flat_map(|r| row(r)[i..i + side].to_vec());
                lower_median(&mut window.collect::<Vec<_>>())
            })
            .collect();
        let mut out = vec![K::LOWEST; count];
        match side {
            3 => dispatch!(medians_of_27(std::array::from_fn(row), &mut out)),
            _ => dispatch!(medians_of_125(std::array::from_fn(row), &mut out)),
        }
        assert_eq!(out, expected);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn medians_are_those_of_sorting(
            samples in prop::collection::vec(any::<i64>(), 25 * 300), count in 1..296usize, bits in 1..64u32,
        ) {
            for side in [3, 5] {
                let samples = &samples[..side * side * (count + side - 1)];
                let narrow = |v: &i64| v >> (64 - bits);
                check(&samples.iter().map(|v| narrow(v) as i8).collect::<Vec<_>>(), count, side);
                check(&samples.iter().map(|v| narrow(v) as i16).collect::<Vec<_>>(), count, side);
                check(&samples.iter().map(|v| narrow(v) as i32).collect::<Vec<_>>(), count, side);
                check(&samples.iter().map(narrow).collect::<Vec<_>>(), count, side);
            }
        }
    }
}
