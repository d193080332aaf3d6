//! A volume whose voxels outside of its region of interest have one sample.

use super::{RegionVoxels, for_each_stretch, row_words};
use crate::error::{Error, Result};
use crate::grid::{Dims, Voxel, with_voxel_type};
use crate::volume::{Header, Volume, hand_on};
use std::ops::Range;
use std::path::Path;

/// A volume that hands out one sample for all voxels outside of a region, and the samples of another volume inside.
pub struct Filled<'a> {
    inner: Box<dyn Volume + 'a>,
    region: RegionVoxels,
    /// The sample, in the machine's byte order.
    sample: Vec<u8>,
}

impl<'a> Filled<'a> {
    /// Fills all voxels of `inner` outside of `region` with `value`.
    ///
    /// # Errors
    /// [`Error::Usage`] if the region is that of a volume of another size, or `value` is no sample of the volume's type.
    pub fn new(inner: Box<dyn Volume + 'a>, region: RegionVoxels, value: f64) -> Result<Self> {
        let header = inner.header();
        if region.dims() != header.dims {
            return Err(wrong_size(region.dims(), header.dims));
        }
        let (sample, exact) = with_voxel_type!(header.dtype, T => {
            let sample = T::nearest(value);
            (bytemuck::bytes_of(&sample).to_vec(), sample.to_f64() == value)
        });
        if !exact {
            let found = format!("{value} outside of the region");
            let expected = format!("a sample of type {}", header.dtype);
            return Err(Error::usage("--roi", found, expected));
        }
        Ok(Filled {
            inner,
            region,
            sample,
        })
    }
}

/// A region that is not that of a volume.
pub(crate) fn wrong_size(found: Dims, expected: Dims) -> Error {
    Error::usage(
        "--roi",
        format!("a mask of {found} voxels"),
        format!("one of {expected}, as the volume has after its filters and before --crop"),
    )
}

impl Volume for Filled<'_> {
    fn header(&self) -> &Header {
        self.inner.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        self.inner.read_box(x.clone(), y.clone(), z.clone(), out)?;
        let words = row_words(self.header().dims.0[0]);
        let size = self.sample.len();
        let mut inside = Vec::new();
        let mut rows = out.chunks_exact_mut(x.len() * size);
        for z in z {
            self.region.rows(y.clone(), z, &mut inside)?;
            for (inside, row) in inside.chunks_exact(words).zip(&mut rows) {
                for_each_stretch(inside, &x, |stretch, is_inside| {
                    if !is_inside {
                        let [from, to] =
                            [stretch.start, stretch.end].map(|v| (v - x.start) as usize);
                        let outside = row[from * size..to * size].chunks_exact_mut(size);
                        outside.for_each(|sample| sample.copy_from_slice(&self.sample));
                    }
                });
            }
        }
        Ok(())
    }

    hand_on!(inner);

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.inner.decoded_once(dir)?;
        Ok(once.map(|inner| -> Box<dyn Volume + '_> {
            Box::new(Filled {
                inner,
                region: self.region.clone(),
                sample: self.sample.clone(),
            })
        }))
    }

    fn held_bytes(&self) -> u64 {
        self.inner.held_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Cylinder, Placement};
    use crate::volume::MemoryVolume;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn samples_stay_inside_and_are_one_outside(
            radius in 1.0..90.0, nx in 2u32..150, from in 0u32..150, to in 0u32..150,
        ) {
            let dims = Dims([nx, 9, 2]);
            let cylinder = Cylinder { centre: [f64::from(nx) / 2.0, 4.0], radius };
            let region = RegionVoxels::cylinder(&cylinder, dims).unwrap();
            let sample = |x: u32, y: u32, z: u32| (x + 200 * (y + 9 * z)) as i16;
            let mut samples = Vec::new();
            for z in 0..2 {
                for y in 0..9 {
                    samples.extend((0..nx).map(|x| sample(x, y, z)));
                }
            }
            let volume = MemoryVolume::new(dims, Placement::default(), samples).unwrap();
            let filled = Filled::new(Box::new(volume), region, -7.0).unwrap();
            let (from, to) = (from.min(to).min(nx - 1), from.max(to).min(nx));
            let mut out = vec![0i16; (to - from) as usize * 7];
            filled.read_box(from..to, 2..9, 1..2, bytemuck::cast_slice_mut(&mut out)).unwrap();
            for y in 2..9 {
                for x in from..to {
                    let found = out[((x - from) + (to - from) * (y - 2)) as usize];
                    let expected = if cylinder.holds(x, y) { sample(x, y, 1) } else { -7 };
                    prop_assert_eq!(found, expected);
                }
            }
        }
    }

    #[test]
    fn a_region_is_of_its_volume_and_a_sample_of_its_type() {
        let dims = Dims([4, 4, 4]);
        let volume = MemoryVolume::new(dims, Placement::default(), vec![0u8; 64]).unwrap();
        let cylinder = Cylinder {
            centre: [1.5; 2],
            radius: 1.0,
        };
        let region = |dims| RegionVoxels::cylinder(&cylinder, dims).unwrap();
        let fill = |dims, value| Filled::new(Box::new(&volume), region(dims), value).err();
        let message = |dims, value| fill(dims, value).unwrap().to_string();
        assert!(fill(dims, 255.0).is_none());
        assert!(message(dims, 256.0).contains("a sample of type u8"));
        let other = message(Dims([4, 4, 5]), 1.0);
        assert!(
            other.contains("4 x 4 x 5") && other.contains("4 x 4 x 4"),
            "{other}"
        );
    }
}
