//! The region of interest of a volume: which of its voxels are inside, and the volume with others filled.

mod bits;
mod filled;

pub(crate) use bits::{InsideBits, row_words};
pub use filled::Filled;
pub(crate) use filled::wrong_size;

use crate::error::Result;
use crate::grid::{Crop, Cylinder, Dims};
use std::ops::Range;
use std::sync::Arc;

/// Which voxels of a volume are inside its region of interest.
#[derive(Debug, Clone)]
pub struct RegionVoxels {
    /// Size of the volume, or of the crop.
    dims: Dims,
    /// First voxel of the crop.
    start: [u32; 3],
    inside: Inside,
}

#[derive(Debug, Clone)]
enum Inside {
    /// For each row of a slice of the crop, the voxels inside along x: the same in all slices.
    Rows(Arc<[Range<u32>]>),
    /// Bits of the whole volume in a file.
    Bits(Arc<InsideBits>),
}

impl RegionVoxels {
    /// Those of a cylinder in a volume of this size.
    ///
    /// # Errors
    /// Those of [`Cylinder::check`].
    pub fn cylinder(cylinder: &Cylinder, dims: Dims) -> Result<Self> {
        cylinder.check(dims)?;
        let rows = (0..dims.0[1]).map(|y| row_of(cylinder, dims.0[0], y));
        Ok(RegionVoxels {
            dims,
            start: [0; 3],
            inside: Inside::Rows(rows.collect()),
        })
    }

    /// Those of a mask, which has been read.
    pub(crate) fn mask(bits: InsideBits) -> Self {
        RegionVoxels {
            dims: bits.dims(),
            start: [0; 3],
            inside: Inside::Bits(Arc::new(bits)),
        }
    }

    /// The same in a crop of the volume.
    ///
    /// # Errors
    /// Those of [`Crop::dims_in`].
    pub fn cropped(&self, crop: &Crop) -> Result<Self> {
        let dims = crop.dims_in(self.dims)?;
        let start = crop.start();
        let inside = match &self.inside {
            Inside::Rows(rows) => {
                let cut = |x: u32| x.clamp(crop.x.start, crop.x.end) - start[0];
                let rows = &rows[crop.y.start as usize..crop.y.end as usize];
                let rows = rows.iter().map(|row| cut(row.start)..cut(row.end));
                Inside::Rows(rows.collect())
            }
            Inside::Bits(bits) => Inside::Bits(bits.clone()),
        };
        Ok(RegionVoxels {
            dims,
            start: std::array::from_fn(|a| self.start[a] + start[a]),
            inside,
        })
    }

    /// Size of the volume that it is of.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// The rows `y` of slice `z`, in words of 64 voxels, the lowest bit first: a bit is set if the voxel is inside.
    /// Bits beyond the end of a row are 0. `out` is overwritten; it has [`row_words`] words for each row then.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the file of a mask cannot be read back.
    pub(crate) fn rows(&self, y: Range<u32>, z: u32, out: &mut Vec<u64>) -> Result<()> {
        let words = row_words(self.dims.0[0]);
        out.clear();
        out.resize(words * y.len(), 0);
        match &self.inside {
            Inside::Rows(rows) => {
                let rows = &rows[y.start as usize..y.end as usize];
                for (row, out) in rows.iter().zip(out.chunks_exact_mut(words)) {
                    set_bits(out, row);
                }
                Ok(())
            }
            Inside::Bits(bits) => {
                let [x, above, below] = self.start;
                let y = above + y.start..above + y.end;
                bits.rows(x..x + self.dims.0[0], y, below + z, out)
            }
        }
    }

    /// Number of voxels inside.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the file of a mask cannot be read back.
    pub fn count(&self) -> Result<u64> {
        let [_, ny, nz] = self.dims.0;
        if let Inside::Rows(rows) = &self.inside {
            let slice: u64 = rows.iter().map(|row| row.len() as u64).sum();
            return Ok(slice * u64::from(nz));
        }
        // as many rows at once as fit a few pages
        const ROWS: u32 = 64;
        let (mut words, mut count) = (Vec::new(), 0);
        for z in 0..nz {
            for y in (0..ny).step_by(ROWS as usize) {
                self.rows(y..(y + ROWS).min(ny), z, &mut words)?;
                count += words.iter().map(|w| u64::from(w.count_ones())).sum::<u64>();
            }
        }
        Ok(count)
    }
}

/// The voxels of a row that a cylinder holds.
fn row_of(cylinder: &Cylinder, nx: u32, y: u32) -> Range<u32> {
    let dy = f64::from(y) - cylinder.centre[1];
    let half = (cylinder.radius * cylinder.radius - dy * dy)
        .max(0.0)
        .sqrt();
    // a voxel more on either side than the root says, which may be rounded
    let near = |x: f64| x.clamp(0.0, f64::from(nx)) as u32;
    let from = near((cylinder.centre[0] - half).floor() - 1.0);
    let to = near((cylinder.centre[0] + half).ceil() + 2.0);
    let mut inside = (from..to).filter(|&x| cylinder.holds(x, y));
    match inside.next() {
        Some(first) => first..inside.next_back().unwrap_or(first) + 1,
        None => 0..0,
    }
}

/// Sets the bits of a range.
fn set_bits(words: &mut [u64], range: &Range<u32>) {
    for (w, word) in words.iter_mut().enumerate() {
        let first = 64 * w as u32;
        let bit = |x: u32| x.saturating_sub(first).min(64);
        let (from, to) = (bit(range.start), bit(range.end));
        if from < to {
            *word |= (!0 >> (64 - (to - from))) << from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_of_a_cylinder_are_the_voxels_that_it_holds(
            centre in prop::array::uniform2(-20.0..150.0), radius in 0.1..120.0, nx in 2u32..140, ny in 2u32..40,
            from in (0u32..60, 0u32..10),
        ) {
            let (cylinder, dims) = (Cylinder { centre, radius }, Dims([nx, ny, 3]));
            let holds_any = (0..ny).any(|y| (0..nx).any(|x| cylinder.holds(x, y)));
            let Ok(all) = RegionVoxels::cylinder(&cylinder, dims) else {
                prop_assert!(!holds_any);
                return Ok(());
            };
            let (x, y) = (from.0.min(nx - 2), from.1.min(ny - 2));
            let crop = Crop { x: x..nx, y: y..ny, z: 1..3 };
            let part = all.cropped(&crop).unwrap();
            let mut words = Vec::new();
            let mut count = 0;
            for (region, [dx, dy]) in [(&all, [0, 0]), (&part, [x, y])] {
                let [nx, ny, nz] = region.dims().0;
                region.rows(0..ny, 1, &mut words).unwrap();
                prop_assert_eq!(words.len(), ny as usize * row_words(nx));
                for (y, row) in (0..).zip(words.chunks_exact(row_words(nx))) {
                    for x in 0..64 * row.len() as u32 {
                        let bit = row[x as usize / 64] >> (x % 64) & 1 == 1;
                        prop_assert_eq!(bit, x < nx && cylinder.holds(x + dx, y + dy), "{} {}", x, y);
                    }
                }
                count = words.iter().map(|w| u64::from(w.count_ones())).sum();
                prop_assert_eq!(region.count().unwrap(), count * u64::from(nz));
            }
            prop_assert!(count <= u64::from(nx) * u64::from(ny));
        }
    }
}
