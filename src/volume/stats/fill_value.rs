//! The sample that voxels outside of a region are given.

use crate::error::{Error, Result};
use crate::grid::{Fill, Voxel, with_voxel_type};
use crate::progress::Progress;
use crate::volume::Volume;
use crate::volume::region::RegionVoxels;
use crate::volume::stats::inside::for_each_inside;
use crate::volume::stats::walk::Walk;

/// Slices that are read for it at most.
const SLICES: u32 = 32;

/// The sum of some samples.
struct Sum {
    /// The first row of the piece that they are of, by z and y.
    place: [u32; 2],
    sum: f64,
    count: u64,
}

/// The sample for voxels outside of a region, as far beyond the threshold as the mean of the samples of the other phase
/// inside is before it, so that the surface between the two lies half-way; as near to that as the type allows. The mean
/// is of up to 32 slices.
///
/// # Errors
/// The volume's; [`Error::Usage`] if no sample of the type is on that side of the threshold; [`Error::Interrupted`].
pub fn fill_value(
    volume: &dyn Volume,
    region: &RegionVoxels,
    threshold: f64,
    fill: Fill,
    progress: &dyn Progress,
) -> Result<f64> {
    with_voxel_type!(volume.header().dtype, T => {
        let mean = other_mean::<T>(volume, region, threshold, fill, progress)?;
        let wanted = 2.0 * threshold - mean.unwrap_or(threshold);
        beyond::<T>(wanted, threshold, fill)
    })
}

/// The mean of the samples inside that are not of the phase of what is outside; `None` if none was seen.
fn other_mean<T: Voxel>(
    volume: &dyn Volume,
    region: &RegionVoxels,
    threshold: f64,
    fill: Fill,
    progress: &dyn Progress,
) -> Result<Option<f64>> {
    let header = volume.header();
    let slabs = SLICES.min(header.dims.0[2] - 1);
    let walk = Walk::sampled(header.dims, size_of::<T>(), slabs);
    progress.begin("region", walk.pieces());
    let mut sums = walk.fold(
        volume,
        progress,
        Vec::new,
        |sums: &mut Vec<Sum>, piece, samples: &[T]| {
            let mut sum = Sum {
                place: [piece.z.start, piece.y.start],
                sum: 0.0,
                count: 0,
            };
            for_each_inside(volume, Some(region), piece, samples, |inside| {
                for v in inside.iter().map(|v| v.to_f64()).filter(|v| v.is_finite()) {
                    if (v >= threshold) == (fill == Fill::Air) {
                        sum.sum += v;
                        sum.count += 1;
                    }
                }
            })?;
            sums.push(sum);
            Ok(())
        },
        |mut a, b| {
            a.extend(b);
            a
        },
    )?;
    // in one order, whatever the threads
    sums.sort_by_key(|sum| sum.place);
    let count: u64 = sums.iter().map(|sum| sum.count).sum();
    let sum: f64 = sums.iter().map(|sum| sum.sum).sum();
    Ok((count > 0).then(|| sum / count as f64))
}

/// The sample nearest to `wanted` that is on the right side of the threshold.
fn beyond<T: Voxel>(wanted: f64, threshold: f64, fill: Fill) -> Result<f64> {
    let none = || {
        let found = format!("{fill} outside, and threshold {threshold}");
        let side = match fill {
            Fill::Material => "not above the largest sample",
            Fill::Air => "above the smallest sample",
        };
        let expected = format!("a threshold that is {side} of {}", T::DTYPE);
        Error::usage("--roi-fill", found, expected)
    };
    let above = T::ceil_from(threshold);
    let nearest = T::nearest(wanted);
    let sample = match fill {
        Fill::Material => match above {
            Some(least) if nearest >= least => nearest,
            Some(least) => least,
            None => return Err(none()),
        },
        Fill::Air => match above {
            Some(least) if nearest >= least => before(least).ok_or_else(none)?,
            _ => nearest,
        },
    };
    match sample.to_f64().is_finite() {
        true => Ok(sample.to_f64()),
        false => Err(none()),
    }
}

/// The largest sample below another one; `None` if there is none.
fn before<T: Voxel>(sample: T) -> Option<T> {
    let value = sample.to_f64();
    let next = match T::DTYPE.is_float() {
        // a step of f32 is one of f64, too
        true if size_of::<T>() == 4 => f64::from((value as f32).next_down()),
        true => value.next_down(),
        false => value - 1.0,
    };
    let next = T::nearest(next);
    (next < sample).then_some(next)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Cylinder, Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;

    #[test]
    fn it_lies_beyond_the_threshold_and_within_the_type() {
        use Fill::{Air, Material};
        assert_eq!(beyond::<u8>(180.0, 100.0, Material).unwrap(), 180.0);
        assert_eq!(beyond::<u8>(480.0, 250.5, Material).unwrap(), 255.0);
        // what is asked for is of the other phase
        assert_eq!(beyond::<u8>(90.0, 100.5, Material).unwrap(), 101.0);
        assert_eq!(beyond::<u8>(120.0, 100.0, Air).unwrap(), 99.0);
        assert_eq!(beyond::<i16>(-40_000.0, 0.0, Air).unwrap(), -32_768.0);
        assert_eq!(beyond::<f32>(0.5, 0.25, Material).unwrap(), 0.5);
        let just_below = beyond::<f32>(0.25, 0.25, Air).unwrap();
        assert!(just_below < 0.25 && just_below > 0.249_999);
        let message = |r: Result<f64>| r.unwrap_err().to_string();
        assert!(message(beyond::<u8>(300.0, 256.0, Material)).contains("largest sample of u8"));
        assert!(message(beyond::<u8>(-3.0, 0.0, Air)).contains("smallest sample of u8"));
    }

    #[test]
    fn the_surface_between_lies_half_way() {
        let dims = Dims([20, 20, 4]);
        let mut samples = Vec::new();
        for i in 0..1600u32 {
            // outside is darker, and does not count
            let (x, y) = (i % 20, i / 20 % 20);
            let inside = libm::hypot(f64::from(x) - 9.5, f64::from(y) - 9.5) < 8.0;
            samples.push(match (inside, x % 2) {
                (false, _) => 1u16,
                (true, 0) => 100,
                (true, _) => 900,
            });
        }
        let volume = MemoryVolume::new(dims, Placement::default(), samples).unwrap();
        let cylinder = Cylinder {
            centre: [9.5; 2],
            radius: 7.0,
        };
        let region = RegionVoxels::cylinder(&cylinder, dims).unwrap();
        let value = |fill| fill_value(&volume, &region, 400.0, fill, &Quiet).unwrap();
        assert_eq!((value(Fill::Material), value(Fill::Air)), (700.0, 0.0));
    }
}
