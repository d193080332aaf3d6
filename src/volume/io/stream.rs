//! Compressed samples: decoded forwards, with a window of what was decoded last.

use crate::error::{Error, Result};
use crate::store::File;
use crate::sys::locks::lock;
use crate::volume::io::byte_rle::ByteRle;
use crate::volume::io::byte_source::{ByteSource, Part, Rows};
use crate::volume::io::data::{Encoding, open_file};
use flate2::bufread::{DeflateDecoder, GzDecoder, ZlibDecoder};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Mutex;

/// Bytes are decoded in blocks of this size.
const BLOCK: u64 = 1 << 20;
/// The window never exceeds this, however large the slices are.
const MAX_WINDOW: u64 = 128 << 20;
/// The window has this size at least, so that bands of a slab of small slices can be read in turn.
const MIN_WINDOW: u64 = 16 << 20;

/// Samples in one or more compressed files of equal share.
///
/// Reading inside the window (at least the last 4 slices, unless they exceed [`MAX_WINDOW`]) or
/// forwards is fast; going further back begins anew.
pub(crate) struct StreamSource {
    layout: StreamLayout,
    state: Mutex<State>,
}

/// What of the streams does not change.
pub(crate) struct StreamLayout {
    pub(crate) parts: Vec<Part>,
    pub(crate) encoding: Encoding,
    /// Decoded bytes to skip at the beginning of each part.
    pub(crate) skip: u64,
    /// Sample bytes in each part.
    pub(crate) part_bytes: u64,
    /// Sample bytes of a slice.
    pub(crate) slice_bytes: u64,
}

impl StreamLayout {
    fn total(&self) -> u64 {
        self.part_bytes * self.parts.len() as u64
    }

    /// Blocks that the window holds.
    fn window(&self) -> u64 {
        let bytes = (self.slice_bytes * 4 + BLOCK).clamp(MIN_WINDOW, MAX_WINDOW);
        bytes.min(self.total()).div_ceil(BLOCK)
    }
}

#[derive(Default)]
struct State {
    decoder: Option<Box<dyn Read + Send>>,
    /// The part that `decoder` reads, or the next one to open.
    part: usize,
    /// Sample bytes decoded of that part.
    done: u64,
    /// Index of the first block in `window`.
    first: u64,
    /// Blocks decoded last, in order.
    window: VecDeque<Vec<u8>>,
}

impl StreamSource {
    pub(crate) fn new(layout: StreamLayout) -> Self {
        StreamSource {
            layout,
            state: Mutex::default(),
        }
    }
}

impl ByteSource for StreamSource {
    fn read_rows(&self, rows: Rows, out: &mut [u8]) -> Result<()> {
        let mut state = lock(&self.state);
        for (start, row) in rows.split(out) {
            let (mut position, mut rest) = (start, row);
            while !rest.is_empty() {
                let block = match state.block(&self.layout, position / BLOCK) {
                    Ok(block) => block,
                    Err(error) => {
                        // what is in the window of a broken stream is not to be trusted
                        *state = State::default();
                        return Err(error);
                    }
                };
                let inside = &block[(position % BLOCK) as usize..];
                let count = inside.len().min(rest.len());
                let (now, later) = rest.split_at_mut(count);
                now.copy_from_slice(&inside[..count]);
                position += count as u64;
                rest = later;
            }
        }
        Ok(())
    }

    fn random_access(&self) -> bool {
        false
    }

    fn held_bytes(&self) -> u64 {
        self.layout.window() * BLOCK
    }
}

impl State {
    /// The block of this index (inside the samples), decoding as far as needed.
    fn block(&mut self, layout: &StreamLayout, index: u64) -> Result<&[u8]> {
        if index < self.first {
            *self = State::default();
        }
        while index >= self.first + self.window.len() as u64 {
            let next = self.first + self.window.len() as u64;
            let len = (layout.total() - next * BLOCK).min(BLOCK);
            let mut block = if self.window.len() as u64 >= layout.window() {
                self.first += 1;
                self.window.pop_front().unwrap_or_default()
            } else {
                Vec::new()
            };
            block.resize(len as usize, 0);
            self.decode(layout, &mut block)?;
            self.window.push_back(block);
        }
        Ok(&self.window[(index - self.first) as usize])
    }

    /// Decodes the next bytes, from as many parts as they come from.
    fn decode(&mut self, layout: &StreamLayout, mut out: &mut [u8]) -> Result<()> {
        while !out.is_empty() {
            let part = &layout.parts[self.part];
            let fail = |done, e| broken(&part.path, done, layout.part_bytes, e);
            let decoder = match &mut self.decoder {
                Some(decoder) => decoder,
                none => none.insert(start(part, layout)?),
            };
            let wanted = (layout.part_bytes - self.done).min(out.len() as u64) as usize;
            let n = decoder
                .read(&mut out[..wanted])
                .map_err(|e| fail(self.done, e))?;
            if n == 0 {
                return Err(fail(self.done, ErrorKind::UnexpectedEof.into()));
            }
            self.done += n as u64;
            out = &mut out[n..];
            if self.done == layout.part_bytes {
                // reading to the end also lets the decoder compare its checksum
                let more = decoder.read(&mut [0]).map_err(|e| fail(self.done, e))?;
                if more > 0 {
                    return Err(Error::format(
                        &part.path,
                        format!(
                            "a compressed stream of more than {} bytes",
                            layout.part_bytes
                        ),
                        format!("{} bytes, as size and type say", layout.part_bytes),
                    ));
                }
                (self.decoder, self.part, self.done) = (None, self.part + 1, 0);
            }
        }
        Ok(())
    }
}

/// Opens a part and skips to its first sample.
fn start(part: &Part, layout: &StreamLayout) -> Result<Box<dyn Read + Send>> {
    let mut file = open_file(&part.path)?;
    file.seek(SeekFrom::Start(part.offset))
        .map_err(|e| Error::io(&part.path, "read", e))?;
    let reader = BufReader::with_capacity(1 << 16, file);
    let mut decoder: Box<dyn Read + Send> = match layout.encoding {
        Encoding::Zlib => Box::new(ZlibDecoder::new(reader)),
        Encoding::Gzip => Box::new(GzipMembers(Some(GzDecoder::new(reader)))),
        Encoding::Deflate { crc } => Box::new(Checked {
            inner: DeflateDecoder::new(reader),
            hasher: crc32fast::Hasher::new(),
            crc,
        }),
        Encoding::ByteRle { packed } => Box::new(ByteRle::new(reader, packed)),
        Encoding::Raw => Box::new(reader),
    };
    let skipped = std::io::copy(&mut (&mut decoder).take(layout.skip), &mut std::io::sink())
        .map_err(|e| broken(&part.path, 0, layout.part_bytes, e))?;
    if skipped < layout.skip {
        return Err(Error::format(
            &part.path,
            format!("a compressed stream of {skipped} bytes"),
            format!("{} bytes to skip and the samples", layout.skip),
        ));
    }
    Ok(decoder)
}

/// A bare stream whose checksum is compared at its end.
struct Checked {
    inner: DeflateDecoder<BufReader<File>>,
    hasher: crc32fast::Hasher,
    crc: u32,
}

impl Read for Checked {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(out)?;
        self.hasher.update(&out[..n]);
        if n == 0 && !out.is_empty() && self.hasher.clone().finalize() != self.crc {
            return Err(std::io::Error::new(
                ErrorKind::InvalidData,
                "wrong checksum",
            ));
        }
        Ok(n)
    }
}

/// What a failing decoder says of the file.
fn broken(path: &Path, done: u64, need: u64, error: std::io::Error) -> Error {
    let how = match error.kind() {
        ErrorKind::UnexpectedEof => "ends".to_owned(),
        ErrorKind::InvalidInput | ErrorKind::InvalidData => format!("is damaged ({error})"),
        _ => return Error::io(path, "read", error),
    };
    Error::format(
        path,
        format!("a compressed stream that {how} after {done} bytes"),
        format!("{need} bytes, as size and type say"),
    )
}

/// A gzip file of one or more members; zeros behind the last one are padding, as for `gzip`.
struct GzipMembers(Option<GzDecoder<BufReader<File>>>);

impl Read for GzipMembers {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while let Some(mut decoder) = self.0.take() {
            let n = decoder.read(out)?;
            if n > 0 || out.is_empty() {
                self.0 = Some(decoder);
                return Ok(n);
            }
            let mut rest = decoder.into_inner();
            loop {
                let bytes = rest.fill_buf()?;
                match bytes.iter().position(|&b| b != 0) {
                    None if bytes.is_empty() => return Ok(0),
                    None => {
                        let n = bytes.len();
                        rest.consume(n);
                    }
                    Some(zeros) => {
                        rest.consume(zeros);
                        break;
                    }
                }
            }
            self.0 = Some(GzDecoder::new(rest));
        }
        Ok(0)
    }
}
