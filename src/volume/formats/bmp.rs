//! BMP slices of 8 bit grey, as SkyScan's (Bruker's) NRecon writes them.
//!
//! The header is that of <https://learn.microsoft.com/windows/win32/gdi/bitmap-storage>. Pixels are places in a table of
//! colours; they are grey values where place and colour are the same number, and refused otherwise. Rows are stored as
//! they are, the last one first unless the height is negative, so that parts are read without the whole. The physical
//! size of pixels in the header, which programs set for screens, is not used: NRecon states it in its log.

use crate::error::{Error, Result};
use crate::grid::{Dims, MAX_DIM};
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::{Format, Slices};
use crate::volume::io::blob::Blob;
use crate::volume::io::paged::{Cut, Page, Pages};
use crate::volume::{Dtype, Endian};
use std::ops::Range;
use std::path::Path;

/// The format, of slices alone.
pub(crate) const FORMAT: Format = Format {
    name: "bmp",
    title: "BMP",
    extensions: &["bmp"],
    starts: is_bmp,
    slices: Some(Slices {
        parse: |path, blobs, _, _| parse(path, blobs),
        is_single: |_| Ok(true),
        placed: false,
    }),
    ..Format::BASE
};

/// Bytes of both headers and of the longest table of colours behind them.
const HEAD: u64 = 14 + 124 + 1024;

/// Sizes that the second header has in files in use.
const SIZES: [u32; 7] = [12, 40, 52, 56, 64, 108, 124];

/// True if a file begins as BMP does.
fn is_bmp(head: &[u8]) -> bool {
    let size = head.get(14..18).and_then(|h| h.first_chunk());
    head.starts_with(b"BM") && size.is_some_and(|size| SIZES.contains(&u32::from_le_bytes(*size)))
}

/// How a slice lies in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Shape {
    /// Columns and rows.
    size: [u32; 2],
    /// Bytes before the first row that is stored.
    start: u64,
    /// The first row is stored first.
    top_down: bool,
}

impl Shape {
    /// Reads the headers of a slice, and checks that its rows are there.
    fn of(blob: &Blob) -> Result<Self> {
        let head = blob.head(HEAD)?;
        let wrong = |found: String, expected: &str| Error::format(blob.path(), found, expected);
        if head.len() < 54 || !is_bmp(&head) {
            return Err(wrong("a BMP that ends in its header".into(), "a whole BMP"));
        }
        let word =
            |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        if word(14) == 12 {
            return Err(refused(blob, "a BMP of OS/2".into()));
        }
        let (bits, packing) = (u16::from_le_bytes([head[28], head[29]]), word(30));
        match (bits, packing) {
            (8, 0) => {}
            (8, _) => return Err(refused(blob, format!("a packed BMP (method {packing})"))),
            _ => return Err(refused(blob, format!("a BMP of {bits} bits per pixel"))),
        }
        let (width, height) = (word(18) as i32, word(22) as i32);
        let size = [width.max(0).unsigned_abs(), height.unsigned_abs()];
        if size.iter().any(|n| !(1..=MAX_DIM).contains(n)) {
            let found = format!("a BMP of {width} x {height} pixels");
            return Err(wrong(found, &format!("1 to {MAX_DIM} along each side")));
        }
        let table = 14 + word(14) as usize;
        let colours = match word(46) {
            0 => 256,
            n => (n as usize).min(256),
        };
        let Some(table) = head.get(table..table + 4 * colours) else {
            return Err(wrong(
                "a BMP that ends in its colours".into(),
                "a whole BMP",
            ));
        };
        let mut greys = table.chunks_exact(4).zip(0..=u8::MAX);
        if !greys.all(|(colour, grey)| colour[..3] == [grey; 3]) {
            return Err(refused(
                blob,
                "a BMP of colours, or of greys in another order".into(),
            ));
        }
        let shape = Shape {
            size,
            start: word(10).into(),
            top_down: height < 0,
        };
        let need = shape.start + shape.stride() * u64::from(size[1]);
        match blob.len() < need {
            true => Err(wrong(
                format!("{} bytes", blob.len()),
                &format!("{need} bytes, a whole BMP"),
            )),
            false => Ok(shape),
        }
    }

    /// Bytes of a row as it is stored.
    fn stride(&self) -> u64 {
        u64::from(self.size[0]).next_multiple_of(4)
    }
}

fn refused(blob: &Blob, what: String) -> Error {
    let hint = "save the slices as 8 bit grey, or convert them to PNG or TIFF, as with ImageMagick's `mogrify -format \
                png FILES`, and give the folder";
    Error::unsupported(blob.path(), what, hint)
}

/// Looks at the header of every slice.
///
/// # Errors
/// [`Error::Unsupported`] for colours, other depths and packed slices, [`Error::Format`] for slices that differ.
fn parse(path: &Path, blobs: Vec<Blob>) -> Result<VolumeDescriptor> {
    let Some(first) = blobs.first() else {
        return Err(Error::format(path, "no BMP", "slices"));
    };
    let [nx, ny] = Shape::of(first)?.size;
    let mut slices = Vec::with_capacity(blobs.len());
    for blob in blobs {
        let shape = Shape::of(&blob)?;
        if shape.size != [nx, ny] {
            let [x, y] = shape.size;
            let expected = format!("{nx} x {ny}, as the first slice is");
            return Err(Error::format(
                blob.path(),
                format!("{x} x {y} pixels"),
                expected,
            ));
        }
        slices.push((blob, shape));
    }
    let dims = Dims::new([nx.into(), ny.into(), slices.len() as u64])
        .map_err(|e| e.of_header(path, "slices"))?;
    let samples = Samples::Pages(Box::new(BmpPages { slices }));
    Ok(VolumeDescriptor {
        endian: Some(Endian::NATIVE),
        ..VolumeDescriptor::new("bmp", dims, Dtype::U8, samples)
    })
}

struct BmpPages {
    slices: Vec<(Blob, Shape)>,
}

impl Pages for BmpPages {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        let (blob, shape) = &self.slices[k as usize];
        Ok(Box::new(BmpPage {
            blob,
            shape: *shape,
        }))
    }

    fn largest(&self) -> (u64, u32) {
        // rows are read as they are
        (0, 0)
    }
}

struct BmpPage<'a> {
    blob: &'a Blob,
    shape: Shape,
}

impl Page for BmpPage<'_> {
    fn cut(&self) -> Cut {
        Cut {
            width: self.shape.size[0],
            rows: 1,
            padded: false,
        }
    }

    fn decode(&self, index: u32, out: &mut [u8]) -> Result<()> {
        self.rows(index..index + 1, out).map(|_| ())
    }

    fn rows(&self, y: Range<u32>, out: &mut [u8]) -> Result<bool> {
        let Shape {
            size: [nx, ny],
            start,
            top_down,
        } = self.shape;
        let bytes = self.blob.open()?;
        let stride = self.shape.stride();
        let rows = out.chunks_exact_mut(nx as usize);
        let at_once = ((1 << 20) / stride).max(1) as usize;
        let mut stored = Vec::new();
        let mut rows: Vec<(u32, &mut [u8])> = y.zip(rows).collect();
        for group in rows.chunks_mut(at_once) {
            // in the order of the file, whichever that is
            if !top_down {
                group.reverse();
            }
            let first = if top_down {
                group[0].0
            } else {
                ny - 1 - group[0].0
            };
            stored.resize(group.len() * stride as usize, 0);
            bytes.read_at(start + u64::from(first) * stride, &mut stored)?;
            for ((_, row), from) in group.iter_mut().zip(stored.chunks_exact(stride as usize)) {
                row.copy_from_slice(&from[..nx as usize]);
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{OpenOptions, open};
    use std::fs;

    /// A slice of 5 x 3 pixels that count up from `first`.
    fn slice(first: u8, top_down: bool) -> Vec<u8> {
        let height = if top_down { -3i32 } else { 3 };
        let words = [
            54 + 1024 + 24,
            0,
            54 + 1024,
            40,
            5,
            height,
            1 | 8 << 16,
            0,
            24,
            0,
            0,
            0,
            0,
        ];
        let mut out = b"BM".to_vec();
        out.extend(words.iter().flat_map(|w: &i32| w.to_le_bytes()));
        out.extend((0..=255u8).flat_map(|grey| [grey, grey, grey, 0]));
        for row in 0..3u8 {
            let row = if top_down { row } else { 2 - row };
            out.extend((0..5).map(|x| first + 5 * row + x));
            out.extend([0; 3]);
        }
        out
    }

    fn put(slices: &[Vec<u8>]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (k, bytes) in slices.iter().enumerate() {
            fs::write(dir.path().join(format!("s_rec{k:04}.bmp")), bytes).unwrap();
        }
        dir
    }

    #[test]
    fn rows_are_put_the_right_way_round() {
        for top_down in [false, true] {
            let dir = put(&[slice(0, top_down), slice(15, false)]);
            let volume = open(dir.path(), &OpenOptions::default()).unwrap().volume;
            let mut out = [0; 30];
            volume.read_box(0..5, 0..3, 0..2, &mut out).unwrap();
            assert!(out.iter().copied().eq(0..30), "{out:?}");
        }
    }

    #[test]
    fn other_kinds_are_refused_by_name() {
        let with = |at: usize, value: u8| {
            let mut bytes = slice(0, false);
            bytes[at] = value;
            bytes
        };
        for (bytes, says) in [
            (with(28, 24), "24 bits per pixel"),
            (with(30, 1), "a packed BMP (method 1)"),
            (with(14, 12), "OS/2"),
            (with(54 + 4, 7), "colours"),
            (with(18, 0), "0 x 3 pixels"),
            (with(18, 9), "1114 bytes"),
            (slice(0, false)[..500].to_vec(), "ends in its colours"),
            (slice(0, false)[..40].to_vec(), "ends in its header"),
        ] {
            let dir = put(&[bytes.clone(), bytes]);
            let said = open(dir.path(), &OpenOptions::default())
                .unwrap_err()
                .to_string();
            assert!(said.contains(says), "{says}: {said}");
        }
        let mut other = slice(0, false);
        other[22] = 2;
        let dir = put(&[slice(0, false), other]);
        let said = open(dir.path(), &OpenOptions::default())
            .unwrap_err()
            .to_string();
        assert!(
            said.contains("5 x 2 pixels") && said.contains("s_rec0001"),
            "{said}"
        );
    }

    #[test]
    fn the_log_of_nrecon_states_the_size_of_a_voxel() {
        let dir = put(&[slice(0, false), slice(15, false)]);
        let log = "[Reconstruction]\r\nPixel Size (um)=17.51\r\nResult Image Width (pixels)=5\r\n";
        fs::write(dir.path().join("s_rec.log"), log).unwrap();
        // the picture of the whole scan is no slice, in whatever format
        fs::write(dir.path().join("s_rec_spr.bmp"), slice(0, false)).unwrap();
        let grey = image::GrayImage::from_pixel(9, 9, image::Luma([1]));
        grey.save(dir.path().join("t_spr.png")).unwrap();
        let opened = open(dir.path(), &OpenOptions::default()).unwrap();
        let header = opened.volume.header();
        assert_eq!((header.dims.0, header.dtype), ([5, 3, 2], Dtype::U8));
        assert_eq!(header.placement.spacing, [17.51; 3]);
        let notes = opened.notes.join("\n");
        assert!(
            notes.contains("s_rec_spr.bmp") && notes.contains("t_spr.png"),
            "{notes}"
        );
        assert!(notes.contains("is that of s_rec.log"), "{notes}");
    }
}
