//! The samples of a slice.

use crate::error::{Error, Result};
use crate::volume::{RegionVoxels, Volume, Voxel, row_words, with_voxel_type};
use serde::Serialize;

/// An axis of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Fastest in the file.
    X,
    /// Rows.
    Y,
    /// Slices.
    Z,
}

impl Axis {
    /// The axes that run to the right and down in a slice across this one.
    pub fn plane(self) -> [usize; 2] {
        match self {
            Axis::X => [1, 2],
            Axis::Y => [0, 2],
            Axis::Z => [0, 1],
        }
    }
}

/// The samples of one slice, row by row.
#[derive(Debug, Clone)]
pub struct Slice {
    /// The axis it lies across.
    pub axis: Axis,
    /// Its voxel along that axis.
    pub at: u32,
    /// Voxels to the right and down.
    pub size: [u32; 2],
    /// The samples, exactly.
    pub values: Vec<f64>,
}

impl Slice {
    /// 1 where a voxel of the slice is inside a region of the volume that it is of, else 0.
    ///
    /// # Errors
    /// Those of the region.
    pub fn inside(&self, region: &RegionVoxels) -> Result<Self> {
        let [nx, ny, nz] = region.dims().0;
        let words = row_words(nx);
        let (mut values, mut rows) = (Vec::with_capacity(self.values.len()), Vec::new());
        let bit = |row: &[u64], x: u32| (row[x as usize / 64] >> (x % 64) & 1) as f64;
        match self.axis {
            Axis::X => {
                for z in 0..nz {
                    region.rows(0..ny, z, &mut rows)?;
                    values.extend(rows.chunks_exact(words).map(|row| bit(row, self.at)));
                }
            }
            Axis::Y => {
                for z in 0..nz {
                    region.rows(self.at..self.at + 1, z, &mut rows)?;
                    values.extend((0..nx).map(|x| bit(&rows, x)));
                }
            }
            Axis::Z => {
                region.rows(0..ny, self.at, &mut rows)?;
                let rows = rows.chunks_exact(words);
                values.extend(rows.flat_map(|row| (0..nx).map(|x| bit(row, x))));
            }
        }
        Ok(Slice {
            values,
            ..self.clone()
        })
    }

    /// Reads the slice at voxel `at` along `axis`.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is outside the volume, and what reading returns.
    pub fn read(volume: &dyn Volume, axis: Axis, at: u32) -> Result<Self> {
        let header = volume.header();
        let dims = header.dims.0;
        if at >= dims[axis as usize] {
            let expected = format!("0 to {}", dims[axis as usize] - 1);
            return Err(Error::usage("--at", at.to_string(), expected));
        }
        let mut ranges = dims.map(|n| 0..n);
        ranges[axis as usize] = at..at + 1;
        let [x, y, z] = ranges;
        let size = axis.plane().map(|a| dims[a]);
        let count = size[0] as usize * size[1] as usize;
        let mut bytes = vec![0; count * header.dtype.bytes()];
        volume.read_box(x, y, z, &mut bytes)?;
        let values = with_voxel_type!(header.dtype, T => {
            bytes
                .chunks_exact(std::mem::size_of::<T>())
                .map(|b| bytemuck::pod_read_unaligned::<T>(b).to_f64())
                .collect()
        });
        Ok(Slice {
            axis,
            at,
            size,
            values,
        })
    }

    /// The sample at a voxel of the slice.
    pub fn value(&self, [x, y]: [u32; 2]) -> f64 {
        self.values[y as usize * self.size[0] as usize + x as usize]
    }

    /// The share of the slice's voxels that are above a threshold, 0 to 1; of those inside a region, whose voxels are 1 in
    /// `inside`, if there is one. NaN if none is.
    pub fn share_above(&self, threshold: f64, inside: Option<&Slice>) -> f64 {
        let (mut above, mut all) = (0u64, 0u64);
        for (i, &value) in self.values.iter().enumerate() {
            let counts = inside.is_none_or(|inside| inside.values[i] != 0.0);
            all += u64::from(counts);
            above += u64::from(counts && value >= threshold);
        }
        above as f64 / all as f64
    }

    /// True if a voxel is above a threshold; NaN is below.
    pub fn above(&self, voxel: [u32; 2], threshold: f64) -> bool {
        self.value(voxel) >= threshold
    }

    /// The 0.5th and 99.5th percentile of its finite samples.
    pub fn window(&self) -> Option<[f64; 2]> {
        let mut finite: Vec<f64> = self
            .values
            .iter()
            .copied()
            .filter(|v| v.is_finite())
            .collect();
        let last = finite.len().checked_sub(1)?;
        let edge = finite.len() / 200;
        let mut pick = |at: usize| *finite.select_nth_unstable_by(at, f64::total_cmp).1;
        Some([pick(edge), pick(last - edge)])
    }
}
