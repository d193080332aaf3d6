//! Floats of 16 bits as floats of 32, which hold each of them exactly.

use crate::error::Result;
use crate::volume::Endian;
use crate::volume::io::byte_source::{ByteSource, Rows};
use half::f16;
use std::ops::Range;

/// The string of bytes of a source of floats of 16 bits, with 32 for each, in the machine's order.
pub(crate) struct HalfSource {
    inner: Box<dyn ByteSource>,
    endian: Endian,
}

impl HalfSource {
    pub(crate) fn new(inner: Box<dyn ByteSource>, endian: Endian) -> Self {
        HalfSource { inner, endian }
    }

    fn inside(bytes: Range<u64>) -> Range<u64> {
        bytes.start / 2..bytes.end / 2
    }
}

impl ByteSource for HalfSource {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        let stored = Rows {
            start: rows.start / 2,
            bytes: rows.bytes / 2,
            stride: rows.stride / 2,
        };
        // what is stored fits the rear half, and is read from there before it is written over
        let middle = out.len() / 2;
        self.inner.read_rows(stored, &mut out[middle..])?;
        for i in 0..out.len() / 4 {
            let bytes = [out[middle + 2 * i], out[middle + 2 * i + 1]];
            let value = match self.endian {
                Endian::Little => f16::from_le_bytes(bytes),
                Endian::Big => f16::from_be_bytes(bytes),
            };
            out[4 * i..4 * i + 4].copy_from_slice(&value.to_f32().to_ne_bytes());
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        self.inner.random_access()
    }

    fn held_bytes(&self) -> u64 {
        self.inner.held_bytes()
    }

    fn is_map(&self) -> bool {
        self.inner.is_map()
    }

    fn prefetch(&self, bytes: Range<u64>) {
        self.inner.prefetch(HalfSource::inside(bytes));
    }

    fn release(&self, bytes: Range<u64>) {
        self.inner.release(HalfSource::inside(bytes));
    }
}
