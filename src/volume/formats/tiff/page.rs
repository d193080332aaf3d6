//! One page: what its tags say, and decoding its strips or tiles.

use crate::error::{Error, Result};
use crate::grid::MAX_DIM;
use crate::volume::formats::tiff::codec::{self, Compression, Predictor};
use crate::volume::formats::tiff::ifd::Directory;
use crate::volume::io::blob::Bytes;
use crate::volume::io::paged::{Cut, MAX_CHUNK, Page};
use crate::volume::{Dtype, Endian};
use half::f16;
use std::ops::Range;

/// A page of one number per pixel.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) size: [u32; 2],
    pub(crate) dtype: Dtype,
    /// Samples are stored as f16, and handed out as f32.
    half: bool,
    pub(crate) endian: Endian,
    pub(crate) compression: Compression,
    pub(crate) predictor: Predictor,
    pub(crate) cut: Cut,
    /// Position of each chunk, and the bytes that it may take up.
    chunks: Vec<(u64, u64)>,
}

impl Layout {
    /// Reads the tags of a page.
    ///
    /// # Errors
    /// [`Error::Unsupported`] by name for colours, packed bits, 64-bit integers and other
    /// compressions; [`Error::Format`] for tags that contradict each other or the file's length.
    pub(crate) fn parse(bytes: &Bytes, dir: &Directory, endian: Endian) -> Result<Self> {
        let at = Place {
            bytes,
            position: dir.position,
        };
        let size = [at.extent(dir, 256)?, at.extent(dir, 257)?];
        at.one_layer(dir)?;
        let (dtype, half) = at.dtype(dir)?;
        let compression = at.compression(dir)?;
        let predictor = at.predictor(dir, dtype, compression)?;
        let cut = at.cut(dir, size)?;
        let mut layout = Layout {
            size,
            dtype,
            half,
            endian,
            compression,
            predictor,
            cut,
            chunks: Vec::new(),
        };
        layout.chunks = at.chunks(dir, &layout)?;
        Ok(layout)
    }

    /// The same page with its samples so many bytes further on in the file.
    pub(crate) fn shifted(mut self, by: u64) -> Self {
        for (position, _) in &mut self.chunks {
            *position = position.saturating_add(by);
        }
        self
    }

    /// Number of strips or tiles.
    pub(crate) fn chunks(&self) -> usize {
        self.chunks.len()
    }

    /// Bytes of a stored sample.
    fn sample(&self) -> usize {
        if self.half { 2 } else { self.dtype.bytes() }
    }

    /// True if what is stored is what is handed out, but for the byte order.
    pub(crate) fn is_direct(&self) -> bool {
        self.compression == Compression::None && !self.cut.padded && !self.half
    }

    fn row_bytes(&self) -> u64 {
        u64::from(self.cut.width) * self.sample() as u64
    }

    /// Bytes of a chunk with all its rows, or of the lower last strip.
    fn chunk_bytes(&self, index: usize) -> u64 {
        let rows = if self.cut.padded {
            self.cut.rows
        } else {
            let top = index as u64 * u64::from(self.cut.rows);
            let left = u64::from(self.size[1]).saturating_sub(top);
            left.min(u64::from(self.cut.rows)) as u32
        };
        u64::from(rows) * self.row_bytes()
    }

    /// Where the samples begin if the page is one uncompressed piece.
    pub(crate) fn in_one_piece(&self) -> Option<u64> {
        let (first, _) = *self.chunks.first()?;
        let mut next = first;
        let joined = self.chunks.iter().enumerate().all(|(i, (position, _))| {
            let joined = *position == next;
            next = next.saturating_add(self.chunk_bytes(i));
            joined
        });
        (self.is_direct() && joined).then_some(first)
    }
}

/// Where a page is, for messages.
struct Place<'a> {
    bytes: &'a Bytes,
    position: u64,
}

impl Place<'_> {
    fn wrong(&self, found: String, expected: impl Into<String>) -> Error {
        let found = format!("{found} in the page at {}", self.position);
        Error::format(self.bytes.path(), found, expected)
    }

    fn no(&self, what: impl Into<String>, hint: &str) -> Error {
        Error::unsupported(self.bytes.path(), what, hint)
    }

    fn extent(&self, dir: &Directory, tag: u16) -> Result<u32> {
        let n = dir.number(tag, 0)?;
        if (1..=u64::from(MAX_DIM)).contains(&n) {
            return Ok(n as u32);
        }
        let side = if tag == 256 { "width" } else { "height" };
        Err(self.wrong(format!("a {side} of {n}"), format!("1 to {MAX_DIM}")))
    }

    /// A page of one plane: SGI's ImageDepth and TileDepth put several into one.
    fn one_layer(&self, dir: &Directory) -> Result<()> {
        for (tag, name) in [(32997, "ImageDepth"), (32998, "TileDepth")] {
            let depth = dir.number(tag, 1)?;
            if depth != 1 {
                let what = format!("a TIFF page of {depth} planes (SGI's tag {name})");
                return Err(self.no(what, "save it with a page for every slice"));
            }
        }
        Ok(())
    }

    fn dtype(&self, dir: &Directory) -> Result<(Dtype, bool)> {
        let samples = dir.number(277, 1)?;
        let photometric = dir.number(262, 1)?;
        let colour = match photometric {
            0 | 1 | 3 => "",
            2 => "RGB",
            4 => "a mask",
            5 => "CMYK",
            6 => "YCbCr",
            8..=10 => "Lab",
            _ => "of an unknown colour space",
        };
        if samples != 1 || !colour.is_empty() {
            let what = match colour {
                "" => format!("a TIFF with {samples} samples per pixel"),
                _ => format!("a TIFF that is {colour}, with {samples} samples per pixel"),
            };
            return Err(self.no(what, "convert it to grey values, one number per pixel"));
        }
        if dir.number(266, 1)? != 1 {
            return Err(self.no("a TIFF with reversed bits (FillOrder 2)", "save it again"));
        }
        let (bits, format) = (dir.number(258, 1)?, dir.number(339, 1)?);
        let dtype = match (bits, format) {
            (8, 1 | 4) => Dtype::U8,
            (8, 2) => Dtype::I8,
            (16, 1 | 4) => Dtype::U16,
            (16, 2) => Dtype::I16,
            (32, 1 | 4) => Dtype::U32,
            (32, 2) => Dtype::I32,
            (16 | 32, 3) => Dtype::F32,
            (64, 3) => Dtype::F64,
            _ => {
                let kind = match format {
                    1 | 4 => "unsigned integers",
                    2 => "signed integers",
                    3 => "floating-point numbers",
                    _ => "complex or unknown numbers",
                };
                let what = format!("a TIFF of {bits}-bit {kind}");
                return Err(self.no(what, "convert it to 8 or 16 bits, or to f32"));
            }
        };
        Ok((dtype, (bits, format) == (16, 3)))
    }

    fn compression(&self, dir: &Directory) -> Result<Compression> {
        let name = match dir.number(259, 1)? {
            1 => return Ok(Compression::None),
            5 => return Ok(Compression::Lzw),
            8 | 32946 => return Ok(Compression::Deflate),
            32773 => return Ok(Compression::PackBits),
            50000 | 34926 => return Ok(Compression::Zstd),
            2..=4 => "CCITT fax".to_owned(),
            6 | 7 => "JPEG".to_owned(),
            33003 | 33005 | 34712 => "JPEG 2000".to_owned(),
            34887 => "LERC".to_owned(),
            34925 => "LZMA".to_owned(),
            50001 => "WebP".to_owned(),
            50002 | 52546 => "JPEG XL".to_owned(),
            code => format!("number {code}"),
        };
        Err(self.no(
            format!("the TIFF compression {name}"),
            "save it uncompressed or with Deflate, Zstandard, LZW or PackBits",
        ))
    }

    fn predictor(
        &self,
        dir: &Directory,
        dtype: Dtype,
        compression: Compression,
    ) -> Result<Predictor> {
        let packed = matches!(
            compression,
            Compression::Lzw | Compression::Deflate | Compression::Zstd
        );
        match dir.number(317, 1)? {
            1 => Ok(Predictor::None),
            2 if packed => Ok(Predictor::Horizontal),
            3 if packed && dtype.is_float() => Ok(Predictor::FloatingPoint),
            n => Err(self.no(
                format!("the TIFF predictor {n} for {dtype} and {compression:?}"),
                "save it without a predictor",
            )),
        }
    }

    fn cut(&self, dir: &Directory, [width, height]: [u32; 2]) -> Result<Cut> {
        let padded = dir.numbers(322)?.is_some() || dir.numbers(324)?.is_some();
        if padded {
            return Ok(Cut {
                width: self.extent_of_tile(dir, 322)?,
                rows: self.extent_of_tile(dir, 323)?,
                padded,
            });
        }
        let rows = dir.number(278, u64::from(height))?;
        if rows == 0 {
            return Err(self.wrong("strips of 0 rows".into(), "1 or more"));
        }
        Ok(Cut {
            width,
            rows: rows.min(u64::from(height)) as u32,
            padded,
        })
    }

    fn extent_of_tile(&self, dir: &Directory, tag: u16) -> Result<u32> {
        let n = dir.number(tag, 0)?;
        if (1..=u64::from(MAX_DIM)).contains(&n) {
            return Ok(n as u32);
        }
        Err(self.wrong(format!("tiles of {n} pixels"), format!("1 to {MAX_DIM}")))
    }

    fn chunks(&self, dir: &Directory, layout: &Layout) -> Result<Vec<(u64, u64)>> {
        let cut = layout.cut;
        let full = u64::from(cut.rows) * layout.row_bytes();
        if full > MAX_CHUNK && layout.compression != Compression::None {
            let what = format!("a compressed TIFF with strips or tiles of {full} bytes");
            return Err(self.no(what, "save it with smaller strips or tiles"));
        }
        let [across, down] = [
            layout.size[0].div_ceil(cut.width),
            layout.size[1].div_ceil(cut.rows),
        ];
        let count = u64::from(across) * u64::from(down);
        let (offsets, counts) = if cut.padded { (324, 325) } else { (273, 279) };
        let positions = dir.numbers(offsets)?.unwrap_or_default();
        if positions.len() as u64 != count {
            let found = format!("{} strips or tiles", positions.len());
            return Err(self.wrong(found, format!("{count}, as the page's size asks for")));
        }
        let lengths = match dir.numbers(counts)? {
            Some(lengths) if lengths.len() == positions.len() => lengths,
            None if layout.compression == Compression::None => (0..positions.len())
                .map(|i| layout.chunk_bytes(i))
                .collect(),
            other => {
                let found = format!("{} lengths of strips", other.unwrap_or_default().len());
                return Err(self.wrong(found, format!("{count}")));
            }
        };
        let chunks: Vec<_> = positions.into_iter().zip(lengths).collect();
        for (i, &(position, len)) in chunks.iter().enumerate() {
            let need = match layout.compression {
                Compression::None => layout.chunk_bytes(i),
                _ => len,
            };
            let end = position.saturating_add(need);
            let short = layout.chunk_bytes(i) > len.saturating_mul(layout.compression.most());
            if end > self.bytes.len() || position == 0 || need == 0 || short {
                let found = format!("strip {i} of {len} bytes at {position}");
                let file = self.bytes.len();
                return Err(self
                    .wrong(found, format!("{need} bytes inside the file's {file}"))
                    .with_hint("the file is cut short or damaged"));
            }
        }
        Ok(chunks)
    }
}

/// A page and the file it is in.
pub(crate) struct TiffPage {
    pub(crate) bytes: Bytes,
    pub(crate) layout: std::sync::Arc<Layout>,
}

impl Page for TiffPage {
    fn cut(&self) -> Cut {
        self.layout.cut
    }

    fn decode(&self, index: u32, out: &mut [u8]) -> Result<()> {
        self.stored(out, |out| self.unpack(index, out).map(|()| true))
            .map(drop)
    }

    fn rows(&self, y: Range<u32>, out: &mut [u8]) -> Result<bool> {
        let layout = &self.layout;
        if layout.compression != Compression::None || layout.cut.padded {
            return Ok(false);
        }
        self.stored(out, |out| self.read(y, out))
    }
}

impl TiffPage {
    /// Fills `out` by `read`, which is given room for samples as they are stored.
    fn stored(&self, out: &mut [u8], read: impl FnOnce(&mut [u8]) -> Result<bool>) -> Result<bool> {
        if !self.layout.half {
            return read(out);
        }
        let mut stored = vec![0; out.len() / 2];
        let done = read(&mut stored)?;
        let samples = stored.as_chunks::<2>().0.iter();
        for (out, from) in out.as_chunks_mut::<4>().0.iter_mut().zip(samples) {
            *out = f16::from_bits(u16::from_ne_bytes(*from))
                .to_f32()
                .to_ne_bytes();
        }
        Ok(done)
    }

    /// Unpacks a strip or tile.
    fn unpack(&self, index: u32, out: &mut [u8]) -> Result<()> {
        let layout = &self.layout;
        let (position, len) = layout.chunks[index as usize];
        let len = match layout.compression {
            Compression::None => out.len() as u64,
            _ => len,
        };
        let total = out.len();
        let reader = self.bytes.reader(position, len);
        codec::unpack(layout.compression, reader, out).map_err(|e| {
            Error::format(
                self.bytes.path(),
                format!("strip or tile {index} at {position} that is damaged ({e})"),
                format!("{total} bytes of samples in its {len} bytes"),
            )
        })?;
        self.restore(out);
        Ok(())
    }

    /// Reads rows that are stored as they are.
    fn read(&self, y: Range<u32>, out: &mut [u8]) -> Result<bool> {
        let layout = &self.layout;
        let row = layout.row_bytes();
        let mut rest = &mut out[..];
        let mut next = y.start;
        while next < y.end {
            let strip = next / layout.cut.rows;
            let top = strip * layout.cut.rows;
            let end = y.end.min(top.saturating_add(layout.cut.rows));
            let (now, later) = rest.split_at_mut((u64::from(end - next) * row) as usize);
            let (position, _) = layout.chunks[strip as usize];
            self.bytes
                .read_at(position + u64::from(next - top) * row, now)?;
            (rest, next) = (later, end);
        }
        self.restore(out);
        Ok(true)
    }

    fn restore(&self, rows: &mut [u8]) {
        let layout = &self.layout;
        codec::restore(
            rows,
            layout.cut.width as usize,
            layout.sample(),
            layout.endian,
            layout.predictor,
        );
    }
}
