//! Rounding by steps that any processor takes for several numbers at a time, as casts with a test of each
//! number's range are not.

/// From here on up, neighbouring numbers are 1 apart, and the lowest bits are those of the whole number.
const WHOLE: f64 = (1u64 << 52) as f64;

/// Rounds a number from 0 to 2^51 half up.
#[inline(always)]
pub fn round(v: f64) -> f64 {
    let up = v + 0.5;
    let near = (up + WHOLE) - WHOLE;
    if near > up { near - 1.0 } else { near }
}

/// A whole number from 0 to 2^32 - 1 as an integer.
#[inline(always)]
pub fn integer(whole: f64) -> u32 {
    (whole + WHOLE).to_bits() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn halves_go_up(v in 0.0..4_294_967_295.0f64, whole in 0..u32::MAX) {
            for v in [v, f64::from(whole), f64::from(whole) + 0.5, (f64::from(whole) + 0.5).next_down()] {
                prop_assert_eq!(round(v), v.round());
                prop_assert_eq!(integer(round(v)), v.round() as u32);
            }
        }
    }
}
