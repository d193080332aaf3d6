//! How the pixels of a DICOM file are stored, and the type of number that holds their values.

use crate::error::{Error, Result};
use crate::volume::formats::dicom::frame::{Context, Rescale};
use crate::volume::formats::dicom::tag;
use crate::volume::{Dtype, Endian};

/// How a pixel is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cell {
    /// Bytes per pixel: 1, 2 or 4, or 4 and 8 for floating-point numbers.
    pub(crate) bytes: usize,
    /// The low bits that hold the number; those above may hold anything.
    pub(crate) bits: u32,
    pub(crate) signed: bool,
    pub(crate) float: bool,
    pub(crate) endian: Endian,
}

impl Cell {
    /// Reads how the pixels in the element `kind` are stored.
    ///
    /// # Errors
    /// [`Error::Unsupported`] by name for colours and odd sizes of pixels, [`Error::Format`] for pixels that do not
    /// lie in the lowest bits.
    pub(crate) fn read(of: &Context, kind: u32, endian: Endian) -> Result<Cell> {
        let no = |what: String, hint: &str| Err(Error::unsupported(of.path, what, hint));
        let samples = of.set.short(tag::SAMPLES).unwrap_or(1);
        let photometric = of.set.text(tag::PHOTOMETRIC);
        // MONOCHROME1 shows small numbers bright; the numbers are the same
        if samples != 1 || !(photometric.is_empty() || photometric.starts_with("MONOCHROME")) {
            let what = format!("a DICOM image of {samples} samples per pixel, {photometric}");
            return no(what, "only grey images are volumes");
        }
        let allocated = u32::from(of.set.short(tag::BITS_ALLOCATED).unwrap_or(0));
        let float = kind != tag::PIXELS;
        let fits = match kind {
            tag::PIXELS => matches!(allocated, 8 | 16 | 32),
            tag::FLOAT_PIXELS => allocated == 32,
            _ => allocated == 64,
        };
        if !fits {
            let what = format!("a DICOM image of {allocated} bits per pixel");
            return no(what, "convert it to 8, 16 or 32 bits per pixel");
        }
        let bits = match of.set.short(tag::BITS_STORED) {
            Some(bits) if !float => u32::from(bits),
            _ => allocated,
        };
        let high = of.set.short(tag::HIGH_BIT);
        let high = high.map_or(bits, |h| u32::from(h) + 1);
        if bits == 0 || bits > allocated || (!float && high != bits) {
            let found = format!("{bits} bits below bit {high} of {allocated}");
            return Err(of.wrong(found, "pixels in the lowest bits"));
        }
        Ok(Cell {
            bytes: allocated as usize / 8,
            bits,
            signed: of.set.short(tag::SIGNED) == Some(1),
            float,
            endian,
        })
    }

    /// The smallest type that holds every value of these rescales.
    pub(crate) fn dtype(self, rescale: &[Rescale]) -> Dtype {
        if self.float {
            return if self.bytes == 4 {
                Dtype::F32
            } else {
                Dtype::F64
            };
        }
        let (low, high) = self.range();
        let whole = |v: f64| v.fract() == 0.0 && v.abs() < 1e15;
        let same = rescale.windows(2).all(|pair| pair[0] == pair[1]);
        let first = rescale.first().copied().unwrap_or(Rescale::NONE);
        if !same || !whole(first.slope) || !whole(first.intercept) {
            return if self.bits <= 16 {
                Dtype::F32
            } else {
                Dtype::F64
            };
        }
        let ends = [low, high].map(|v| first.slope * v as f64 + first.intercept);
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let mut types = [
            (Dtype::U8, 0.0, 255.0),
            (Dtype::I8, -128.0, 127.0),
            (Dtype::U16, 0.0, 65_535.0),
            (Dtype::I16, -32_768.0, 32_767.0),
            (Dtype::U32, 0.0, f64::from(u32::MAX)),
            (Dtype::I32, f64::from(i32::MIN), f64::from(i32::MAX)),
        ]
        .into_iter()
        .filter(|(dtype, a, b)| dtype.bytes() >= self.bytes && *a <= low && high <= *b);
        types.next().map_or(Dtype::F64, |(dtype, ..)| dtype)
    }

    /// Smallest and largest number of the bits.
    fn range(self) -> (i64, i64) {
        if self.signed {
            (-(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1)
        } else {
            (0, (1 << self.bits) - 1)
        }
    }
}
