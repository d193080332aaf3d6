//! The frames of a series as pages: unpacking and rescaling.

use crate::error::{Error, Result};
use crate::volume::formats::dicom::cell::Cell;
use crate::volume::formats::dicom::element::Fragment;
use crate::volume::formats::dicom::frame::{Frame, Image, Rescale};
use crate::volume::formats::dicom::syntax::Syntax;
use crate::volume::formats::dicom::{element, jpeg, jpegls, rle};
use crate::volume::io::blob::Bytes;
use crate::volume::io::paged::{Cut, Page, Pages};
use crate::volume::{Dtype, Endian};
use flate2::bufread::DeflateDecoder;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::sync::Arc;

/// Stored bytes that are converted at a time.
const PIECE: usize = 1 << 20;

/// Frames in the order of slices.
pub(crate) struct Frames {
    pub(crate) images: Arc<Vec<Image>>,
    pub(crate) frames: Vec<Frame>,
    /// For each file of many packed frames, position and bytes of the fragments of each.
    pub(crate) fragments: Vec<Vec<Vec<Fragment>>>,
    pub(crate) size: [u32; 2],
    pub(crate) dtype: Dtype,
}

impl Frames {
    fn direct(&self) -> bool {
        let plain = |i: &Image| !i.syntax.is_packed() && i.deflated.is_none();
        self.images.iter().all(plain)
    }
}

impl Pages for Frames {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        let frame = &self.frames[k as usize];
        let image = &self.images[frame.file as usize];
        Ok(Box::new(FramePage {
            owner: self,
            bytes: image.blob.open()?,
            image,
            frame,
        }))
    }

    fn largest(&self) -> (u64, u32) {
        if self.direct() {
            return (0, 0);
        }
        let [x, y] = self.size.map(u64::from);
        // besides the frame itself, what it is packed in and what its decoder holds
        (x * y * 6, self.size[1])
    }
}

struct FramePage<'a> {
    owner: &'a Frames,
    bytes: Bytes,
    image: &'a Image,
    frame: &'a Frame,
}

impl Page for FramePage<'_> {
    fn cut(&self) -> Cut {
        Cut {
            width: self.owner.size[0],
            rows: self.owner.size[1],
            padded: false,
        }
    }

    fn decode(&self, _: u32, out: &mut [u8]) -> Result<()> {
        let pixels = self.stored_bytes();
        let cell = self.image.cell;
        if !self.image.syntax.is_packed() {
            let mut stored = vec![0; pixels];
            self.inflate(&mut stored)?;
            self.convert(cell, &stored, out);
            return Ok(());
        }
        let packed = self.packed()?;
        let size = self.owner.size;
        let mut stored = vec![0; pixels];
        let done = match self.image.syntax {
            Syntax::Rle => rle::decode(&packed, cell.bytes, &mut stored),
            Syntax::Jpeg => jpeg::decode(&packed, size, cell.bytes, &mut stored),
            Syntax::JpegLs => jpegls::decode(&packed, size, cell.bytes, &mut stored),
            _ => jpeg::decode_2000(&packed, size, cell.bytes, &mut stored),
        };
        done.map_err(|what| {
            let found = format!("frame {} with {what}", self.frame.index + 1);
            let [x, y] = size;
            let expected = format!("{x} x {y} grey pixels of {} bits", cell.bits);
            Error::format(self.bytes.path(), found, expected)
        })?;
        // every decoder here leaves the least significant byte first
        let cell = Cell {
            endian: Endian::Little,
            ..cell
        };
        self.convert(cell, &stored, out);
        Ok(())
    }

    fn rows(&self, y: Range<u32>, out: &mut [u8]) -> Result<bool> {
        if self.image.syntax.is_packed() || self.image.deflated.is_some() {
            return Ok(false);
        }
        let cell = self.image.cell;
        let row = self.owner.size[0] as usize * cell.bytes;
        let first = u64::from(self.frame.index) * self.stored_bytes() as u64;
        let start = self.image.pixels.0 + first + u64::from(y.start) * row as u64;
        let sample = self.owner.dtype.bytes();
        let mut stored = vec![0; PIECE.min(out.len() / sample * cell.bytes)];
        let step = stored.len() / cell.bytes;
        for (i, out) in out.chunks_mut((step * sample).max(1)).enumerate() {
            let stored = &mut stored[..out.len() / sample * cell.bytes];
            self.bytes
                .read_at(start + (i * step * cell.bytes) as u64, stored)?;
            self.convert(cell, stored, out);
        }
        Ok(true)
    }
}

impl FramePage<'_> {
    fn stored_bytes(&self) -> usize {
        self.owner.size[0] as usize * self.owner.size[1] as usize * self.image.cell.bytes
    }

    /// Reads the frame out of a data set that is packed as a whole.
    fn inflate(&self, out: &mut [u8]) -> Result<()> {
        let start = self.image.deflated.unwrap_or(0);
        let mut reader = BufReader::new(DeflateDecoder::new(self.bytes.reader(start, u64::MAX)));
        let skip = self.image.pixels.0 + u64::from(self.frame.index) * out.len() as u64;
        let skipped = std::io::copy(&mut (&mut reader).take(skip), &mut std::io::sink());
        skipped.and_then(|_| reader.read_exact(out)).map_err(|e| {
            let found = format!("a packed data set that is damaged ({e})");
            Error::format(self.bytes.path(), found, "a whole one")
        })
    }

    /// The packed bytes of the frame.
    fn packed(&self) -> Result<Vec<u8>> {
        let own;
        let known = &self.owner.fragments[self.frame.file as usize];
        let fragments = match known.get(self.frame.index as usize) {
            Some(known) => known,
            None => {
                own = element::fragments(&self.bytes, self.image.pixels.0)?.1;
                &own
            }
        };
        let mut out = Vec::new();
        for &(position, len) in fragments {
            let start = out.len();
            out.resize(start + len as usize, 0);
            self.bytes.read_at(position, &mut out[start..])?;
        }
        Ok(out)
    }

    fn convert(&self, cell: Cell, stored: &[u8], out: &mut [u8]) {
        convert(cell, self.frame.rescale, self.owner.dtype, stored, out);
    }
}

/// True if two frames of one kind have the same pixels, as they are stored, and the same scale. False where that
/// cannot be told without unpacking them.
pub(crate) fn same(images: &[Image], a: &Frame, b: &Frame) -> Result<bool> {
    let [one, other] = [a, b].map(|frame| &images[frame.file as usize]);
    if (a.rescale, one.syntax, one.cell) != (b.rescale, other.syntax, other.cell)
        || one.deflated.is_some()
        || other.deflated.is_some()
    {
        return Ok(false);
    }
    let pieces = |image: &Image, frame: &Frame| -> Result<(Bytes, Vec<Fragment>)> {
        let bytes = image.blob.open()?;
        let len = u64::from(image.size[0]) * u64::from(image.size[1]) * image.cell.bytes as u64;
        let pieces = match image.syntax.is_packed() {
            false => vec![(image.pixels.0 + u64::from(frame.index) * len, len)],
            true if image.frames.len() == 1 => element::fragments(&bytes, image.pixels.0)?.1,
            true => Vec::new(),
        };
        Ok((bytes, pieces))
    };
    let ((one, mine), (other, its)) = (pieces(one, a)?, pieces(other, b)?);
    let lengths = |all: &[Fragment]| all.iter().map(|f| f.1).collect::<Vec<_>>();
    if mine.is_empty() || lengths(&mine) != lengths(&its) {
        return Ok(false);
    }
    let mut buffers = [vec![0; PIECE], vec![0; PIECE]];
    for (&(at, len), &(to, _)) in mine.iter().zip(&its) {
        for start in (0..len).step_by(PIECE) {
            let count = (len - start).min(PIECE as u64) as usize;
            let [x, y] = &mut buffers;
            one.read_at(at + start, &mut x[..count])?;
            other.read_at(to + start, &mut y[..count])?;
            if x[..count] != y[..count] {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// Stored numbers to values of `dtype`.
pub(crate) fn convert(cell: Cell, rescale: Rescale, dtype: Dtype, stored: &[u8], out: &mut [u8]) {
    let whole_cell = cell.bits as usize == 8 * cell.bytes || cell.float;
    let kept = rescale == Rescale::NONE && whole_cell && cell.bytes == dtype.bytes();
    if kept && (cell.endian == Endian::NATIVE || cell.bytes == 1) {
        out.copy_from_slice(stored);
        return;
    }
    match cell.bytes {
        1 => typed::<1>(cell, rescale, dtype, stored, out),
        2 => typed::<2>(cell, rescale, dtype, stored, out),
        4 => typed::<4>(cell, rescale, dtype, stored, out),
        _ => typed::<8>(cell, rescale, dtype, stored, out),
    }
}

fn typed<const N: usize>(
    cell: Cell,
    rescale: Rescale,
    dtype: Dtype,
    stored: &[u8],
    out: &mut [u8],
) {
    let unused = 64 - cell.bits.min(64);
    let bits = |from: &[u8; N]| {
        let mut wide = [0; 8];
        wide[..N].copy_from_slice(from);
        if cell.endian == Endian::Big {
            wide[..N].reverse();
        }
        u64::from_le_bytes(wide)
    };
    let value = |from: &[u8; N]| {
        let bits = bits(from);
        let stored = match (cell.float, N) {
            (true, 4) => f64::from(f32::from_bits(bits as u32)),
            (true, _) => f64::from_bits(bits),
            (false, _) if cell.signed => ((bits << unused) as i64 >> unused) as f64,
            _ => (bits << unused >> unused) as f64,
        };
        rescale.value(stored)
    };
    let samples = stored.as_chunks::<N>().0.iter();
    macro_rules! put {
        ($t:ty) => {
            for (out, from) in out
                .as_chunks_mut::<{ size_of::<$t>() }>()
                .0
                .iter_mut()
                .zip(samples)
            {
                // integers fit by the choice of the type
                *out = (value(from) as $t).to_ne_bytes();
            }
        };
    }
    match dtype {
        Dtype::U8 => put!(u8),
        Dtype::I8 => put!(i8),
        Dtype::U16 => put!(u16),
        Dtype::I16 => put!(i16),
        Dtype::U32 => put!(u32),
        Dtype::I32 => put!(i32),
        Dtype::F32 => put!(f32),
        Dtype::F64 => put!(f64),
    }
}
