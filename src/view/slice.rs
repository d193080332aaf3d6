//! Slices of the volume as pictures, in memory that does not grow with the volume.

use crate::error::{Error, Result};
use crate::preview::Axis;
use crate::volume::{Stamp, Volume, Voxel, with_voxel_type};
use std::time::SystemTime;

/// Pixels along a side at most; of larger slices every n-th voxel is shown.
const SIDE: u32 = 4096;
/// Bytes of samples that are read at a time.
const BLOCK: usize = 4 << 20;

/// The volume that tiles were made of, filtered and cut as they were.
pub struct Slices {
    volume: Box<dyn Volume>,
    stamp: Stamp,
}

impl std::fmt::Debug for Slices {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Slices of {}", self.volume.header().dims)
    }
}

/// Which slice, and how.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// The axis that it lies across.
    pub axis: Axis,
    /// Its voxel along that axis.
    pub at: u32,
    /// Samples that are black and white; the smallest and the largest one if none are given.
    pub range: Option<[f64; 2]>,
}

/// A slice to show.
#[derive(Debug)]
pub struct SlicePicture {
    /// Grey, 8 bits.
    pub png: Vec<u8>,
    /// Voxels from pixel to pixel.
    pub step: u32,
    /// Samples that are black and white.
    pub range: [f64; 2],
}

impl Slices {
    /// Of a volume that is as its stamp says until it is written to.
    pub fn new(volume: Box<dyn Volume>, stamp: Stamp) -> Self {
        Slices { volume, stamp }
    }

    /// When the volume was written to last, as far as the system tells.
    pub fn last_change(&self) -> Option<SystemTime> {
        self.stamp.last_change
    }

    /// Draws a slice. May take 100 MiB.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is outside; [`Error::InputChanged`]; [`Error::Interrupted`] if it is not needed any more;
    /// what reading returns.
    pub fn picture(&self, wanted: Wanted, is_needed: &dyn Fn() -> bool) -> Result<SlicePicture> {
        let Wanted { axis, at, range } = wanted;
        let dims = self.volume.header().dims.0;
        if at >= dims[axis as usize] {
            let expected = format!("0 to {}", dims[axis as usize] - 1);
            return Err(Error::usage("the slice", at.to_string(), expected));
        }
        let sides = axis.plane().map(|a| dims[a]);
        let step = sides
            .map(|n| n.div_ceil(SIDE))
            .into_iter()
            .max()
            .unwrap_or(1);
        let values = self.read(wanted, step, is_needed)?;
        self.stamp.check()?;
        let range = range.unwrap_or_else(|| ends(&values));
        let size = sides.map(|n| n.div_ceil(step));
        let grey: Vec<u8> = values.into_iter().map(|v| shade(v, range)).collect();
        let png = encoded(size, &grey).map_err(|e| Error::io("the slice", "write as PNG", e))?;
        Ok(SlicePicture { png, step, range })
    }

    /// The samples of a slice, every n-th along both its sides.
    fn read(&self, wanted: Wanted, step: u32, is_needed: &dyn Fn() -> bool) -> Result<Vec<f32>> {
        let Wanted { axis, at, .. } = wanted;
        let header = self.volume.header();
        let (dims, width) = (header.dims.0, header.dtype.bytes());
        let [right, down] = axis.plane();
        let row = dims[right] as usize * width;
        // rows between those that are shown are not read
        let together = if step == 1 {
            (BLOCK / row).max(1) as u32
        } else {
            1
        };
        let mut values = Vec::new();
        let mut bytes = Vec::new();
        for first in (0..dims[down]).step_by((step * together) as usize) {
            if !is_needed() {
                return Err(Error::Interrupted);
            }
            let rows = together.min(dims[down] - first);
            let mut ranges = dims.map(|n| 0..n);
            ranges[axis as usize] = at..at + 1;
            ranges[down] = first..first + rows;
            bytes.resize(rows as usize * row, 0);
            let [x, y, z] = ranges;
            self.volume.read_box(x, y, z, &mut bytes)?;
            for row in bytes.chunks_exact(row) {
                with_voxel_type!(header.dtype, T => {
                    let samples = row.chunks_exact(width).step_by(step as usize);
                    values.extend(samples.map(|b| bytemuck::pod_read_unaligned::<T>(b).to_f64() as f32));
                });
            }
        }
        Ok(values)
    }
}

/// The smallest and the largest of the numbers; 0 and 1 if there are none.
fn ends(values: &[f32]) -> [f64; 2] {
    let finite = values.iter().filter(|v| v.is_finite());
    let ends = finite.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &v| {
        [low.min(v), high.max(v)]
    });
    if ends[0] <= ends[1] {
        ends.map(f64::from)
    } else {
        [0.0, 1.0]
    }
}

/// Black to white; what is no number is black.
fn shade(value: f32, [low, high]: [f64; 2]) -> u8 {
    let share = (f64::from(value) - low) / (high - low);
    // a range without an extent has values on either side of it, and on it; no number becomes 0
    (255.0 * share).round().clamp(0.0, 255.0) as u8
}

fn encoded([width, height]: [u32; 2], grey: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(grey)?;
    writer.finish()?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::volume::MemoryVolume;

    fn slices(dims: [u64; 3], sample: impl Fn([u32; 3]) -> u16) -> Slices {
        let dims = Dims::new(dims).unwrap();
        let [nx, ny, nz] = dims.0;
        let mut samples = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                samples.extend((0..nx).map(|x| sample([x, y, z])));
            }
        }
        let volume = MemoryVolume::new(dims, Placement::default(), samples).unwrap();
        Slices::new(Box::new(volume), Stamp::default())
    }

    fn wanted(axis: Axis, at: u32, range: Option<[f64; 2]>) -> Wanted {
        Wanted { axis, at, range }
    }

    fn decoded(png: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .unwrap();
        let mut grey = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut grey).unwrap();
        (info.width, info.height, grey)
    }

    #[test]
    fn each_axis_has_its_plane() {
        let all = slices([3, 4, 5], |[x, y, z]| (x + 10 * y + 40 * z) as u16);
        for (axis, at, size) in [
            (Axis::X, 2, [4, 5]),
            (Axis::Y, 3, [3, 5]),
            (Axis::Z, 4, [3, 4]),
        ] {
            let made = all
                .picture(wanted(axis, at, Some([0.0, 255.0])), &|| true)
                .unwrap();
            let (width, height, grey) = decoded(&made.png);
            assert_eq!(([width, height], made.step), (size, 1));
            for v in 0..height {
                for u in 0..width {
                    let mut voxel = [at; 3];
                    let [right, down] = axis.plane();
                    (voxel[right], voxel[down]) = (u, v);
                    let expected = voxel[0] + 10 * voxel[1] + 40 * voxel[2];
                    assert_eq!(u32::from(grey[(v * width + u) as usize]), expected);
                }
            }
        }
        assert!(matches!(
            all.picture(wanted(Axis::Z, 5, None), &|| true),
            Err(Error::Usage { .. })
        ));
        let own = all.picture(wanted(Axis::Z, 0, None), &|| true).unwrap();
        assert_eq!(own.range, [0.0, 32.0]);
        assert_eq!(decoded(&own.png).2[..3], [0, 8, 16]);
    }

    #[test]
    fn long_slices_leave_voxels_out() {
        let all = slices([10_000, 3, 2], |[x, y, _]| (x % 251 + y) as u16);
        let made = all
            .picture(wanted(Axis::Z, 1, Some([0.0, 255.0])), &|| true)
            .unwrap();
        let (width, height, grey) = decoded(&made.png);
        assert_eq!((made.step, width, height), (3, 3334, 1));
        assert!(
            grey.iter()
                .zip(0u32..)
                .all(|(&v, i)| u32::from(v) == 3 * i % 251)
        );
    }

    #[test]
    fn ranges_without_extent_are_drawn() {
        for (value, range, expected) in [
            (1.0, [1.0, 1.0], 0),
            (2.0, [1.0, 1.0], 255),
            (0.0, [1.0, 1.0], 0),
            (f32::NAN, [0.0, 1.0], 0),
            (0.5, [0.0, 1.0], 128),
            (0.0, [1.0, 0.0], 255),
        ] {
            assert_eq!(shade(value, range), expected, "{value} {range:?}");
        }
        assert_eq!(ends(&[f32::NAN]), [0.0, 1.0]);
    }
}
