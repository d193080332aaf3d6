//! A volume whose samples lie in files: boxes cut into as few reads as possible.

use crate::error::Result;
use crate::volume::io::byte_source::{ByteSource, Rows};
use crate::volume::{Dtype, Header, Volume};
use std::ops::Range;

/// A header and the bytes of its samples.
pub(crate) struct FileVolume {
    header: Header,
    source: Box<dyn ByteSource>,
    /// The bytes of the source are not in the machine's order.
    swap: bool,
}

impl FileVolume {
    pub(crate) fn new(header: Header, source: Box<dyn ByteSource>, swap: bool) -> Self {
        FileVolume {
            swap: swap && header.dtype.bytes() > 1,
            header,
            source,
        }
    }

    fn slices(&self, z: Range<u32>) -> Range<u64> {
        let bytes = self.header.dims.slice_voxels() * self.header.dtype.bytes() as u64;
        let nz = self.header.dims.0[2];
        u64::from(z.start.min(nz)) * bytes..u64::from(z.end.min(nz)) * bytes
    }
}

impl Volume for FileVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let dims = self.header.dims;
        let sample = self.header.dtype.bytes();
        let at = |k: u32| dims.linear([x.start, y.start, k]) * sample as u64;
        let row = x.len() * sample;
        let whole_rows = x.len() == dims.0[0] as usize;
        if whole_rows && y.len() == dims.0[1] as usize {
            self.source
                .read_rows(Rows::one(at(z.start), out.len()), out)?;
        } else {
            let band = row * y.len();
            for (k, out) in z.clone().zip(out.chunks_exact_mut(band)) {
                let rows = if whole_rows {
                    Rows::one(at(k), band)
                } else {
                    Rows {
                        start: at(k),
                        bytes: row,
                        stride: u64::from(dims.0[0]) * sample as u64,
                    }
                };
                self.source.read_rows(rows, out)?;
            }
        }
        if self.swap {
            swap_in_place(self.header.dtype, out);
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.source.random_access()
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }

    fn mapped_bytes(&self, z: Range<u32>) -> u64 {
        let bytes = self.slices(z);
        if self.source.is_map() {
            bytes.end - bytes.start
        } else {
            0
        }
    }

    fn prefetch(&self, z: Range<u32>) {
        self.source.prefetch(self.slices(z));
    }

    fn release(&self, z: Range<u32>) {
        self.source.release(self.slices(z));
    }
}

/// Reverses the bytes of every sample.
fn swap_in_place(dtype: Dtype, bytes: &mut [u8]) {
    fn swap<const N: usize>(bytes: &mut [u8]) {
        for sample in bytes.as_chunks_mut::<N>().0 {
            sample.reverse();
        }
    }
    match dtype.bytes() {
        2 => swap::<2>(bytes),
        4 => swap::<4>(bytes),
        8 => swap::<8>(bytes),
        _ => {}
    }
}
