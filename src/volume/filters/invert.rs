//! Dark becomes bright.

use super::each_sample::EachSample;
use crate::volume::{Dtype, Volume};

/// The volume with its values the other way round, as [`crate::grid::Filter::Invert`] says. For whole numbers it is
/// that of scikit-image's `util.invert`, which for floats subtracts from 1 unless they are signed.
pub(crate) fn inverted<'a>(inner: Box<dyn Volume + 'a>) -> EachSample<'a> {
    match inner.header().dtype {
        // the complement of all bits is the largest value less v, or -1 - v
        Dtype::U8 => EachSample::new(inner, |v: u8| !v),
        Dtype::I8 => EachSample::new(inner, |v: i8| !v),
        Dtype::U16 => EachSample::new(inner, |v: u16| !v),
        Dtype::I16 => EachSample::new(inner, |v: i16| !v),
        Dtype::U32 => EachSample::new(inner, |v: u32| !v),
        Dtype::I32 => EachSample::new(inner, |v: i32| !v),
        Dtype::F32 => EachSample::new(inner, |v: f32| -v),
        Dtype::F64 => EachSample::new(inner, |v: f64| -v),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::{MemoryVolume, Voxel};

    fn of<T: Voxel>(samples: [T; 8]) -> Vec<T> {
        let inner = MemoryVolume::new(Dims([2; 3]), Placement::default(), samples.to_vec());
        let mut out = vec![0; 8 * size_of::<T>()];
        let volume = inverted(Box::new(inner.unwrap()));
        volume.read_box(0..2, 0..2, 0..2, &mut out).unwrap();
        bytemuck::pod_collect_to_vec(&out)
    }

    #[test]
    fn ends_of_the_type_change_places() {
        assert_eq!(
            of([0u8, 1, 254, 255, 9, 9, 9, 9])[..5],
            [255, 254, 1, 0, 246]
        );
        assert_eq!(
            of([-128i8, 127, 0, -1, 5, 0, 0, 0])[..5],
            [127, -128, -1, 0, -6]
        );
        assert_eq!(
            of([0u16, 65535, 4095, 1, 2, 3, 4, 5])[..3],
            [65535, 0, 61440]
        );
        assert_eq!(
            of([-1000i16, 3000, -32768, 32767, 0, 0, 0, 0])[..4],
            [999, -3001, 32767, -32768]
        );
        assert_eq!(
            of([0u32, u32::MAX, 7, 0, 0, 0, 0, 0])[..3],
            [u32::MAX, 0, u32::MAX - 7]
        );
        assert_eq!(
            of([i32::MIN, i32::MAX, 7, 0, 0, 0, 0, 0])[..3],
            [i32::MAX, i32::MIN, -8]
        );
        let floats = of([1.5f32, -2.0, 0.0, f32::INFINITY, f32::NAN, 0.0, 0.0, 0.0]);
        assert_eq!(floats[..4], [-1.5, 2.0, 0.0, f32::NEG_INFINITY]);
        assert!(floats[4].is_nan());
        assert_eq!(of([0.1f64; 8]), [-0.1; 8]);
    }
}
