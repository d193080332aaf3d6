//! Samples as whole numbers in the same order, of which medians are taken.

use crate::volume::Voxel;
use bytemuck::Pod;

/// A signed whole number that stands for a sample.
pub trait Key: Pod + Ord + Send + Sync + 'static {
    /// Bits of it.
    const BITS: u32;
    /// The lowest.
    const LOWEST: Self;

    /// This number with one of its bits set, where it is clear, counting from [`Key::LOWEST`] as 0.
    fn with_bit(self, bit: u32) -> Self;

    /// How many of the highest bits are the same in another number.
    fn bits_shared(self, other: Self) -> u32;

    /// This number with all but so many of its highest bits clear, counting from [`Key::LOWEST`] as 0.
    fn highest_bits(self, bits: u32) -> Self;

    /// One more, if so. Counts are below 128.
    fn plus(self, one: bool) -> Self;

    /// A count.
    fn of_count(count: u8) -> Self;
}

macro_rules! key {
    ($($t:ty)*) => {$(
        impl Key for $t {
            const BITS: u32 = <$t>::BITS;
            const LOWEST: Self = <$t>::MIN;
            #[inline(always)]
            fn with_bit(self, bit: u32) -> Self {
                self.wrapping_add(1 << bit)
            }
            #[inline(always)]
            fn bits_shared(self, other: Self) -> u32 {
                (self ^ other).leading_zeros()
            }
            #[inline(always)]
            fn highest_bits(self, bits: u32) -> Self {
                match bits {
                    0 => Self::LOWEST,
                    _ => self & -1 << (Self::BITS - bits),
                }
            }
            #[inline(always)]
            fn plus(self, one: bool) -> Self {
                self.wrapping_add(<$t>::from(one))
            }
            #[inline(always)]
            fn of_count(count: u8) -> Self {
                count as $t
            }
        }
    )*};
}

key! { i8 i16 i32 i64 }

/// A sample that has a key.
pub trait Ordered: Voxel {
    /// Ordered as samples are; of zeros, the negative one comes first.
    type Key: Key;

    /// The key of this sample: another sample has another one.
    fn key(self) -> Self::Key;

    /// The sample of a key.
    fn of_key(key: Self::Key) -> Self;

    /// False for NaN.
    fn is_number(key: Self::Key) -> bool;
}

macro_rules! ordered_integers {
    ($($t:ty => $key:ty, $first:expr;)*) => {$(
        impl Ordered for $t {
            type Key = $key;
            #[inline(always)]
            fn key(self) -> $key {
                (self ^ $first) as $key
            }
            #[inline(always)]
            fn of_key(key: $key) -> Self {
                key as $t ^ $first
            }
            #[inline(always)]
            fn is_number(_: $key) -> bool {
                true
            }
        }
    )*};
}

ordered_integers! {
    u8 => i8, 0x80;
    i8 => i8, 0;
    u16 => i16, 0x8000;
    i16 => i16, 0;
    u32 => i32, 0x8000_0000;
    i32 => i32, 0;
}

macro_rules! ordered_floats {
    ($($t:ty => $key:ty, $bits:ty;)*) => {$(
        impl Ordered for $t {
            type Key = $key;
            #[inline(always)]
            fn key(self) -> $key {
                let bits = self.to_bits() as $key;
                // of negative floats, all bits but the sign turn
                bits ^ (bits >> (<$key>::BITS - 1)) & <$key>::MAX
            }
            #[inline(always)]
            fn of_key(key: $key) -> Self {
                let bits = key ^ (key >> (<$key>::BITS - 1)) & <$key>::MAX;
                <$t>::from_bits(bits as $bits)
            }
            #[inline(always)]
            fn is_number(key: $key) -> bool {
                const INFINITE: $key = <$t>::INFINITY.to_bits() as $key;
                // keys of minus infinity and infinity
                (-INFINITE - 1..=INFINITE).contains(&key)
            }
        }
    )*};
}

ordered_floats! {
    f32 => i32, u32;
    f64 => i64, u64;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_order<T: Ordered>(samples: &[T]) {
        for pair in samples.windows(2) {
            assert!(pair[0].key() < pair[1].key(), "{pair:?}");
        }
        for sample in samples {
            let bytes = [*sample, T::of_key(sample.key())];
            let [before, after] = bytes.each_ref().map(bytemuck::bytes_of);
            assert_eq!(before, after);
            assert!(T::is_number(sample.key()));
        }
    }

    #[test]
    fn keys_are_ordered_as_samples_are() {
        in_order(&[0u8, 1, 127, 128, 255]);
        in_order(&[-128i8, -1, 0, 1, 127]);
        in_order(&[0u16, 1, 32767, 32768, 65535]);
        in_order(&[i16::MIN, -1, 0, 1, i16::MAX]);
        in_order(&[0, 1, i32::MAX as u32, 1 << 31, u32::MAX]);
        in_order(&[i32::MIN, -1, 0, 1, i32::MAX]);
        let infinite = f32::INFINITY;
        in_order(&[
            -infinite,
            f32::MIN,
            -1.0,
            -1e-45,
            -0.0,
            0.0,
            1e-45,
            2.0,
            infinite,
        ]);
        let infinite = f64::INFINITY;
        in_order(&[
            -infinite,
            f64::MIN,
            -1.0,
            -5e-324,
            -0.0,
            0.0,
            5e-324,
            infinite,
        ]);
    }

    #[test]
    fn nan_is_no_number_and_stays_as_it_is() {
        for bits in [0x7FC0_0000, 0xFFC0_0000, 0x7F80_0001, 0xFFFF_FFFFu32] {
            let key = f32::from_bits(bits).key();
            assert!(!f32::is_number(key));
            assert_eq!(f32::of_key(key).to_bits(), bits);
        }
        assert!(!f64::is_number(f64::NAN.key()) && !f64::is_number((-f64::NAN).key()));
    }

    #[test]
    fn bits_are_those_above_the_lowest() {
        assert_eq!(i8::LOWEST.with_bit(7).with_bit(0), 1);
        let raised = |key: i8, bits| key.highest_bits(bits);
        let found = [0, 1, 2, 8].map(|bits| raised(0b0111_0101, bits));
        assert_eq!(found, [-128, 0, 64, 0b0111_0101]);
        assert_eq!(
            (
                3i16.bits_shared(2),
                3i16.bits_shared(3),
                (-1i16).bits_shared(0)
            ),
            (15, 16, 0)
        );
    }
}
