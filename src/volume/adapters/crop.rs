//! A part of a volume as a volume of its own.

use crate::error::Result;
use crate::grid::Crop;
use crate::volume::{Header, Volume};
use std::ops::Range;
use std::path::Path;

/// A box of another volume: its voxel (0, 0, 0) is the crop's first voxel, and its origin the place
/// of that voxel.
pub struct Cropped<'a> {
    volume: Box<dyn Volume + 'a>,
    header: Header,
    start: [u32; 3],
}

impl<'a> Cropped<'a> {
    /// Cuts `crop` out of `volume`.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if the box leaves the volume or has fewer than 2 voxels along an
    /// axis.
    pub fn new(volume: Box<dyn Volume + 'a>, crop: &Crop) -> Result<Self> {
        let whole = volume.header();
        let header = Header {
            dims: crop.dims_in(whole.dims)?,
            placement: whole.placement.shifted(crop.start()),
            ..whole.clone()
        };
        Ok(Cropped {
            volume,
            header,
            start: crop.start(),
        })
    }

    /// `crop` of `volume`; all of it without one.
    ///
    /// # Errors
    /// Those of [`Cropped::new`].
    pub fn part(volume: Box<dyn Volume + 'a>, crop: Option<&Crop>) -> Result<Box<dyn Volume + 'a>> {
        match crop {
            Some(crop) => Ok(Box::new(Cropped::new(volume, crop)?)),
            None => Ok(volume),
        }
    }

    fn shift(&self, axis: usize, range: Range<u32>) -> Range<u32> {
        let end = self.header.dims.0[axis];
        let start = self.start[axis];
        start + range.start.min(end)..start + range.end.min(end)
    }
}

impl Volume for Cropped<'_> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let [x, y, z] = [self.shift(0, x), self.shift(1, y), self.shift(2, z)];
        self.volume.read_box(x, y, z, out)
    }

    fn random_access(&self) -> bool {
        self.volume.random_access()
    }

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.volume.decoded_once(dir)?;
        Ok(once.map(|volume| -> Box<dyn Volume + '_> {
            Box::new(Cropped {
                volume,
                header: self.header.clone(),
                start: self.start,
            })
        }))
    }

    fn grain(&self) -> [u32; 3] {
        self.volume.grain()
    }

    fn held_bytes(&self) -> u64 {
        self.volume.held_bytes()
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        self.volume.mapped_bytes(self.shift(2, z))
    }

    fn measured(&self, y: u32, z: u32) -> Option<Range<u32>> {
        let [first, above, below] = self.start;
        let row = self.volume.measured(y + above, z + below)?;
        let own = |x: u32| x.saturating_sub(first).min(self.header.dims.0[0]);
        Some(own(row.start)..own(row.end))
    }

    fn prefetch(&self, z: Range<u32>) {
        self.volume.prefetch(self.shift(2, z));
    }

    fn release(&self, z: Range<u32>) {
        self.volume.release(self.shift(2, z));
    }
}
