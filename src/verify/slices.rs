//! The volume's bits, slice by slice, without voxels that were filled.

use super::region_edge::RegionEdge;
use super::spill::Merge;
use crate::error::Result;
use crate::volume::{Volume, Voxel, with_voxel_type};

/// A run of voxels, as a number by which they are in order: z, y, and the first and last x.
pub(super) type Run = u64;

pub(super) fn run([y, z]: [u32; 2], [first, last]: [u32; 2]) -> Run {
    u64::from(z) << 48 | u64::from(y) << 32 | u64::from(first) << 16 | u64::from(last)
}

pub(super) fn row_of(run: Run) -> [u32; 2] {
    [(run >> 32 & 0xFFFF) as u32, (run >> 48) as u32]
}

pub(super) fn ends_of(run: Run) -> [u32; 2] {
    [(run >> 16 & 0xFFFF) as u32, (run & 0xFFFF) as u32]
}

/// The volume's bits, slice by slice, without what has been filled so far.
pub(super) struct Slices<'a> {
    volume: &'a dyn Volume,
    threshold: f64,
    edge: RegionEdge<'a>,
    pub filled: Option<Merge<1>>,
    pub next: Option<[u64; 1]>,
    words: Vec<u64>,
    /// 1 for a voxel that is above.
    pub bits: Vec<u8>,
    /// A bit for each voxel that is in the region of interest, in words of 64 for each row.
    pub inside: Vec<u64>,
}

impl<'a> Slices<'a> {
    /// Of all of a volume; `edge` is that of its region.
    pub fn new(volume: &'a dyn Volume, threshold: f64, edge: RegionEdge<'a>) -> Self {
        Slices {
            volume,
            threshold,
            edge,
            filled: None,
            next: None,
            words: Vec::new(),
            bits: Vec::new(),
            inside: Vec::new(),
        }
    }

    /// Those of a volume without what was filled, if that is known.
    ///
    /// # Errors
    /// [`Error::Io`] if a temporary file cannot be read back.
    pub fn without(
        volume: &'a dyn Volume,
        threshold: f64,
        mut filled: Option<Merge<1>>,
    ) -> Result<Self> {
        let next = filled.as_mut().map_or(Ok(None), Merge::next)?;
        Ok(Slices {
            filled,
            next,
            ..Slices::new(volume, threshold, RegionEdge::None)
        })
    }

    /// Voxels along x, y and z.
    pub fn dims(&self) -> [u32; 3] {
        self.volume.header().dims.0
    }

    /// Of each voxel of the slice that was read, 1 if it is above; x first, then y.
    pub fn bits(&self) -> &[u8] {
        &self.bits
    }

    /// Reads a slice, which comes after those before.
    ///
    /// # Errors
    /// The volume's, and [`Error::Io`] if a temporary file cannot be read back.
    pub fn read(&mut self, z: u32) -> Result<()> {
        let header = self.volume.header();
        let [nx, ny, _] = header.dims.0;
        let samples = nx as usize * ny as usize;
        let bytes = samples * header.dtype.bytes();
        self.words.resize(bytes.div_ceil(8), 0);
        let out = &mut bytemuck::cast_slice_mut(&mut self.words)[..bytes];
        self.volume.read_box(0..nx, 0..ny, z..z + 1, out)?;
        self.volume.release(z..z + 1);
        self.edge.slice([nx, ny], z, &mut self.inside)?;
        self.bits.clear();
        with_voxel_type!(header.dtype, T => {
            let all: &[T] = bytemuck::cast_slice(&self.words);
            let above = |v: &T| u8::from(v.to_f64() >= self.threshold);
            self.bits.extend(all[..samples].iter().map(above));
        });
        while let Some([run]) = self.next.filter(|r| row_of(r[0])[1] <= z) {
            let ([y, at], [first, last]) = (row_of(run), ends_of(run));
            if at == z {
                let start = y as usize * nx as usize;
                let voxels = start + first as usize..start + last as usize + 1;
                self.bits[voxels].iter_mut().for_each(|b| *b ^= 1);
            }
            self.next = self.filled.as_mut().map_or(Ok(None), Merge::next)?;
        }
        Ok(())
    }
}
