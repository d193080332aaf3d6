//! Values outside of a range become those of its ends.

use super::each_sample::EachSample;
use crate::error::Result;
use crate::grid::Filter;
use crate::volume::{Volume, Voxel, with_voxel_type};

/// The volume with its values kept between `low` and `high`, as [`Filter::Clamp`] says.
///
/// # Errors
/// [`crate::Error::Usage`] if no finite value of the volume's type lies between the two.
pub(crate) fn clamped<'a>(
    inner: Box<dyn Volume + 'a>,
    low: f64,
    high: f64,
) -> Result<EachSample<'a>> {
    let dtype = inner.header().dtype;
    let [least, most] = match dtype.whole_numbers() {
        // one of these in place of a value outside is one of the type
        Some([least, most]) => [low.ceil().max(least), high.floor().min(most)],
        None => [low, high],
    };
    if least > most {
        let whole = dtype.whole_numbers().unwrap_or_default();
        let expected = format!(
            "a range with a value of {dtype} in it, a whole number from {} to {}",
            whole[0], whole[1]
        );
        return Err(Filter::Clamp { low, high }.refused(&format!("{low},{high}"), expected));
    }
    Ok(with_voxel_type!(dtype, T => {
        let [least, most] = [least, most].map(T::nearest);
        // what is beyond a type of floats becomes infinite
        if least.to_f64() == f64::INFINITY || most.to_f64() == f64::NEG_INFINITY {
            let expected = format!("a range with a finite value of {dtype} in it");
            return Err(Filter::Clamp { low, high }.refused(&format!("{low},{high}"), expected));
        }
        EachSample::new(inner, move |v: T| clamp(v, least, most))
    }))
}

/// NaN, which compares with nothing, stays.
fn clamp<T: Voxel>(v: T, least: T, most: T) -> T {
    if v < least {
        least
    } else if v > most {
        most
    } else {
        v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::MemoryVolume;

    fn of<T: Voxel>(samples: [T; 8], low: f64, high: f64) -> Result<Vec<T>> {
        let inner = MemoryVolume::new(Dims([2; 3]), Placement::default(), samples.to_vec());
        let mut out = vec![0; 8 * size_of::<T>()];
        let volume = clamped(Box::new(inner.unwrap()), low, high)?;
        volume.read_box(0..2, 0..2, 0..2, &mut out)?;
        Ok(bytemuck::pod_collect_to_vec(&out))
    }

    #[test]
    fn values_outside_become_the_ends() {
        let bytes = [0u8, 9, 10, 11, 199, 200, 201, 255];
        let kept = [10, 10, 10, 11, 199, 200, 200, 200];
        assert_eq!(of(bytes, 10.0, 200.0).unwrap(), kept);
        assert_eq!(of(bytes, 9.5, 200.9).unwrap(), kept);
        assert_eq!(of(bytes, -1e9, 1e9).unwrap(), bytes);
        assert_eq!(of(bytes, 7.0, 7.0).unwrap(), [7; 8]);
        let signed = [i32::MIN, -5, -4, 0, 1, 2, 3, i32::MAX];
        assert_eq!(of(signed, -4.5, 2.0).unwrap(), [-4, -4, -4, 0, 1, 2, 2, 2]);
        let nan = f32::NAN;
        let floats = [
            nan,
            f32::NEG_INFINITY,
            f32::INFINITY,
            0.05,
            0.1,
            0.5,
            0.9,
            1.0,
        ];
        let kept = of(floats, 0.1, 0.9).unwrap();
        assert!(kept[0].is_nan());
        assert_eq!(kept[1..], [0.1, 0.9, 0.1, 0.1, 0.5, 0.9, 0.9]);
        assert_eq!(of([1e300f64; 8], -1.0, 0.1).unwrap(), [0.1; 8]);
    }

    #[test]
    fn a_range_without_a_value_of_the_type_is_refused() {
        for (low, high) in [(10.2, 10.8), (300.0, 400.0), (-9.0, -3.0)] {
            let message = of([0u8; 8], low, high).unwrap_err().to_string();
            assert!(message.contains("from 0 to 255"), "{message}");
        }
        assert!(of([0.0f32; 8], 10.2, 10.8).is_ok());
        for (low, high) in [(1e39, 1e40), (-1e40, -1e39)] {
            let message = of([0.0f32; 8], low, high).unwrap_err().to_string();
            assert!(message.contains("a finite value of f32"), "{message}");
            assert!(of([0.0f64; 8], low, high).is_ok());
        }
        // one end within the type is enough
        assert_eq!(of([7.0f32; 8], -1e40, 1e39).unwrap(), [7.0; 8]);
    }
}
