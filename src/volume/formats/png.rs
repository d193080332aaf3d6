//! PNG slices of 8 or 16 bit grey.
//!
//! Values are handed out as they are stored: gamma, palettes and transparency are not applied, and
//! the physical size of pixels (`pHYs`), which most programs set for paper, is told and not used.

use crate::error::{Error, Result};
use crate::grid::{Dims, MAX_DIM};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, Slices};
use crate::volume::io::blob::Blob;
use crate::volume::io::paged::{Cut, MAX_CHUNK, Page, Pages};
use crate::volume::options::OpenOptions;
use crate::volume::{Dtype, Endian};
use std::path::Path;

const MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The format, of slices alone.
pub(crate) const FORMAT: Format = Format {
    name: "png",
    title: "PNG",
    extensions: &["png"],
    starts: is_png,
    slices: Some(Slices {
        parse: |path, blobs, _, options| parse(path, blobs, options),
        is_single: |_| Ok(true),
        placed: false,
    }),
    ..Format::BASE
};

/// True if a file begins as PNG does.
pub(crate) fn is_png(head: &[u8]) -> bool {
    head.starts_with(MAGIC)
}

/// Size and type of one slice, by its first bytes.
fn shape(blob: &Blob) -> Result<([u32; 2], Dtype)> {
    // length, name and the 13 bytes of the first part, IHDR
    let head = blob.head(29)?;
    let Some((b"IHDR", ihdr)) = head.get(12..29).and_then(|h| h.split_first_chunk::<4>()) else {
        return Err(Error::format(
            blob.path(),
            "a PNG that ends in its header",
            "a whole PNG",
        ));
    };
    let side = |at: usize| u32::from_be_bytes([ihdr[at], ihdr[at + 1], ihdr[at + 2], ihdr[at + 3]]);
    let size = [side(0), side(4)];
    let dtype = match (ihdr[8], ihdr[9]) {
        (8, 0) => Dtype::U8,
        (16, 0) => Dtype::U16,
        (bits, colour) => {
            let kind = match colour {
                0 => "grey",
                2 => "RGB",
                3 => "palette",
                4 => "grey with transparency",
                6 => "RGB with transparency",
                _ => "unknown",
            };
            return Err(Error::unsupported(
                blob.path(),
                format!("a PNG of {bits}-bit samples, {kind}"),
                "save the slices as 8 or 16 bit grey",
            ));
        }
    };
    let bytes = u64::from(size[0]) * u64::from(size[1]) * dtype.bytes() as u64;
    if size.iter().any(|n| !(1..=MAX_DIM).contains(n)) || bytes > MAX_CHUNK {
        let what = format!("a PNG of {} x {} pixels", size[0], size[1]);
        return Err(Error::unsupported(
            blob.path(),
            what,
            "save it as TIFF with small strips",
        ));
    }
    // Deflate packs 258 bytes into 2 bits at best
    if bytes > blob.len().saturating_mul(1032) {
        let found = format!("{} bytes for {bytes} bytes of samples", blob.len());
        return Err(Error::format(blob.path(), found, "a whole PNG"));
    }
    Ok((size, dtype))
}

/// What to say of the size of pixels that a slice states.
fn physical(blob: &Blob) -> Result<Option<String>> {
    let bytes = blob.open()?;
    let mut decoder = png::Decoder::new(bytes.reader(0, bytes.len()));
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    // damage is told when samples are read
    let Ok(reader) = decoder.read_info() else {
        return Ok(None);
    };
    let stated = reader.info().pixel_dims;
    let metres = stated.filter(|p| p.unit == png::Unit::Meter && p.xppu > 0 && p.yppu > 0);
    Ok(metres.map(|p| {
        let [x, y] = [p.xppu, p.yppu].map(|n| format!("{:.4}", 1000.0 / f64::from(n)));
        format!(
            "pixels of {x} x {y} mm, as the first PNG states (pHYs), are not used: give --spacing and --unit if that \
             is of the scan"
        )
    }))
}

/// Looks at the header of every slice.
///
/// # Errors
/// [`Error::Unsupported`] for colours and other depths, [`Error::Format`] for slices that differ.
pub(crate) fn parse(
    path: &Path,
    blobs: Vec<Blob>,
    options: &OpenOptions,
) -> Result<VolumeDescriptor> {
    let Some(first) = blobs.first() else {
        return Err(Error::format(path, "no PNG", "slices"));
    };
    let (size, dtype) = shape(first)?;
    for blob in &blobs {
        let (found, kind) = shape(blob)?;
        if (found, kind) != (size, dtype) {
            let ([x, y], [nx, ny]) = (found, size);
            return Err(Error::format(
                blob.path(),
                format!("{x} x {y} of {kind}"),
                format!("{nx} x {ny} of {dtype}, as the first slice is"),
            ));
        }
    }
    let dims = Dims::new([size[0].into(), size[1].into(), blobs.len() as u64])
        .map_err(|e| e.of_header(path, "slices"))?;
    Ok(VolumeDescriptor {
        endian: Some(Endian::Big),
        notes: match options.spacing {
            None => physical(first)?.into_iter().collect(),
            Some(_) => Vec::new(),
        },
        ..VolumeDescriptor::new(
            "png",
            dims,
            dtype,
            Samples::Pages(Box::new(PngPages { blobs, size, dtype })),
        )
    })
}

struct PngPages {
    blobs: Vec<Blob>,
    size: [u32; 2],
    dtype: Dtype,
}

impl Pages for PngPages {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        Ok(Box::new(PngPage {
            blob: &self.blobs[k as usize],
            size: self.size,
            dtype: self.dtype,
        }))
    }

    fn largest(&self) -> (u64, u32) {
        let [nx, ny] = self.size;
        (u64::from(nx) * u64::from(ny), ny)
    }
}

struct PngPage<'a> {
    blob: &'a Blob,
    size: [u32; 2],
    dtype: Dtype,
}

impl Page for PngPage<'_> {
    fn cut(&self) -> Cut {
        Cut {
            width: self.size[0],
            rows: self.size[1],
            padded: false,
        }
    }

    fn decode(&self, _index: u32, out: &mut [u8]) -> Result<()> {
        let bytes = self.blob.open()?;
        let wrong = |e: png::DecodingError| {
            let found = format!("a damaged PNG ({e})");
            Error::format(self.blob.path(), found, "a whole slice")
        };
        let mut decoder = png::Decoder::new(bytes.reader(0, bytes.len()));
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.ignore_checksums(false);
        let mut reader = decoder.read_info().map_err(wrong)?;
        if reader.output_buffer_size() != Some(out.len()) || shape(self.blob)?.0 != self.size {
            return Err(Error::format(
                self.blob.path(),
                "another size than when it was opened",
                "a file that does not change while it is read",
            ));
        }
        reader.next_frame(out).map_err(wrong)?;
        // the rest holds the checksum of the samples
        reader.finish().map_err(wrong)?;
        if self.dtype.bytes() == 2 && Endian::NATIVE == Endian::Little {
            out.as_chunks_mut::<2>()
                .0
                .iter_mut()
                .for_each(|s| s.reverse());
        }
        Ok(())
    }
}
