//! From grey (0 air, 1 metal) to samples of a type.

use super::random::RowStream;
use crate::volume::{Dtype, Voxel, with_voxel_type};

/// Air and metal as shares of the type's range (of 0..1 for floats).
const AIR: f32 = 0.2;
const METAL: f32 = 0.8;

/// A sample type that a share of its range can be turned into.
trait Sample: Voxel {
    /// Rounds to the nearest; a share outside 0..1 is cut off, except for floats.
    fn from_share(share: f32) -> Self;
}

macro_rules! narrow_sample {
    ($($t:ty, $unsigned:ty;)*) => {$(
        impl Sample for $t {
            #[inline]
            fn from_share(share: f32) -> Self {
                let level = (share * <$unsigned>::MAX as f32 + 0.5) as $unsigned;
                // the distance from the type's smallest value: for signed types a shift by half
                // of the range, which is a wrapping addition
                <$t>::MIN.wrapping_add(level as $t)
            }
        }
    )*};
}
narrow_sample! { u8, u8; i8, u8; u16, u16; i16, u16; }

macro_rules! wide_sample {
    ($($t:ty),*) => {$(
        impl Sample for $t {
            #[inline]
            fn from_share(share: f32) -> Self {
                let level = (f64::from(share) * f64::from(u32::MAX) + 0.5) as u32;
                <$t>::MIN.wrapping_add(level as $t)
            }
        }
    )*};
}
wide_sample! { u32, i32 }

impl Sample for f32 {
    #[inline]
    fn from_share(share: f32) -> Self {
        share
    }
}

impl Sample for f64 {
    #[inline]
    fn from_share(share: f32) -> Self {
        f64::from(share)
    }
}

/// The value half-way between air and metal.
pub fn threshold(dtype: Dtype) -> f64 {
    match dtype {
        Dtype::U8 => f64::from(u8::MAX) / 2.0,
        Dtype::U16 => f64::from(u16::MAX) / 2.0,
        Dtype::U32 => f64::from(u32::MAX) / 2.0,
        Dtype::I8 | Dtype::I16 | Dtype::I32 => -0.5,
        Dtype::F32 | Dtype::F64 => 0.5,
    }
}

/// Adds noise of standard deviation `sigma` (in shares of the contrast) to a row of greys and turns
/// it into samples. `x` is the first voxel; `out` has as many samples as `grey`, at any alignment.
pub fn write_row(
    dtype: Dtype,
    grey: &mut [f32],
    noise: Option<(RowStream, f32)>,
    x: u32,
    out: &mut [u8],
) {
    if let Some((stream, sigma)) = noise {
        for (x, g) in (x..).zip(grey.iter_mut()) {
            *g += sigma * stream.normal(x);
        }
    }
    with_voxel_type!(dtype, T => write_samples::<T>(grey, out));
}

fn write_samples<T: Sample>(grey: &[f32], out: &mut [u8]) {
    let size = size_of::<T>();
    assert_eq!(out.len(), grey.len() * size, "one sample per grey");
    for (g, bytes) in grey.iter().zip(out.chunks_exact_mut(size)) {
        let sample = T::from_share(AIR + (METAL - AIR) * g);
        bytes.copy_from_slice(bytemuck::bytes_of(&sample));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value<T: Sample>(grey: f32) -> f64 {
        let mut bytes = vec![0; size_of::<T>()];
        write_samples::<T>(&[grey], &mut bytes);
        bytemuck::pod_read_unaligned::<T>(&bytes).to_f64()
    }

    #[test]
    fn air_metal_and_noise_fit_every_type() {
        assert_eq!([0.0, 1.0].map(value::<u8>), [51.0, 204.0]);
        assert_eq!([0.0, 1.0].map(value::<i8>), [-77.0, 76.0]);
        assert_eq!([0.0, 1.0].map(value::<u16>), [13107.0, 52428.0]);
        assert_eq!([0.0, 1.0].map(value::<i16>), [-19661.0, 19660.0]);
        assert_eq!([-9.0, 9.0].map(value::<u8>), [0.0, 255.0]);
        assert_eq!([-9.0, 9.0].map(value::<i16>), [-32768.0, 32767.0]);
        assert_eq!(
            [-9.0, 9.0].map(value::<i32>),
            [f64::from(i32::MIN), f64::from(i32::MAX)]
        );
        for dtype in Dtype::ALL {
            let levels = with_voxel_type!(dtype, T => [0.0, 0.49, 0.51, 1.0].map(value::<T>));
            let t = threshold(dtype);
            assert!(levels[0] < levels[1] && levels[1] < t, "{dtype} {levels:?}");
            assert!(t < levels[2] && levels[2] < levels[3], "{dtype} {levels:?}");
        }
    }
}
