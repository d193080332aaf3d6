//! Samples as base64 or as decimal numbers, unpacked to an unnamed temporary file.

use crate::error::{Error, Result};
use crate::store;
use crate::volume::formats::vti::Bytes;
use crate::volume::{Dtype, Endian};
use std::fs::File;
use std::io::{BufRead, BufWriter, Read, Write};
use std::sync::Arc;

/// Longer words are no numbers.
const MAX_WORD: usize = 64;

fn temporary() -> Result<BufWriter<File>> {
    let file = tempfile::tempfile_in(std::env::temp_dir()).map_err(disk)?;
    Ok(BufWriter::with_capacity(1 << 18, file))
}

fn finish(out: BufWriter<File>) -> Result<Arc<store::File>> {
    let file = out.into_inner();
    file.map(|file| Arc::new(file.into()))
        .map_err(|e| disk(e.into_error()))
}

fn disk(e: std::io::Error) -> Error {
    let dir = std::env::temp_dir();
    Error::io(dir, "write a temporary copy of the volume", e)
}

/// Decodes base64 from `position` on, up to the next `<`, a character that is not base64's, or
/// `most` bytes. A header that is encoded by itself ends with its own padding. Returns the file and
/// the number of bytes in it.
///
/// # Errors
/// [`Error::Io`] if there is no room for them.
pub(crate) fn base64(bytes: &Bytes, position: u64, most: u64) -> Result<(Arc<store::File>, u64)> {
    let mut out = temporary()?;
    let mut reader = bytes.reader(position, u64::MAX);
    // four characters of six bits make three bytes, one less for each that is padding
    let (mut word, mut count, mut pads, mut done) = (0u32, 0, 0, 0);
    'all: loop {
        let buffer = reader
            .fill_buf()
            .map_err(|e| Error::io(bytes.path(), "read", e))?;
        if buffer.is_empty() {
            break;
        }
        let len = buffer.len();
        for &byte in buffer {
            let six = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                b'=' => 0,
                b' ' | b'\n' | b'\r' | b'\t' => continue,
                _ => break 'all,
            };
            word = word << 6 | u32::from(six);
            (count, pads) = (count + 1, pads + usize::from(byte == b'='));
            if count < 4 {
                continue;
            }
            let kept = 3 - pads.min(2);
            out.write_all(&word.to_be_bytes()[1..1 + kept])
                .map_err(disk)?;
            done += kept as u64;
            (word, count, pads) = (0, 0, 0);
            if done >= most {
                break 'all;
            }
        }
        reader.consume(len);
    }
    Ok((finish(out)?, done))
}

/// Reads decimal numbers from `position` on up to the next `<`, as samples in the machine's order,
/// of which there must be `count`.
///
/// # Errors
/// [`Error::Format`] for other numbers or another count of them.
pub(crate) fn decimal(
    bytes: &Bytes,
    position: u64,
    dtype: Dtype,
    count: u64,
) -> Result<Arc<store::File>> {
    let mut out = temporary()?;
    let mut reader = bytes.reader(position, u64::MAX).take(u64::MAX);
    let mut word = Vec::new();
    let mut done = 0;
    let mut ended = false;
    while !ended {
        let buffer = reader
            .fill_buf()
            .map_err(|e| Error::io(bytes.path(), "read", e))?;
        let len = buffer.len();
        ended = len == 0;
        for &byte in buffer.iter().chain(ended.then_some(&b'<')) {
            if !byte.is_ascii_whitespace() && byte != b'<' {
                word.push(byte);
                if word.len() > MAX_WORD {
                    return Err(no_number(bytes, &word));
                }
                continue;
            }
            if !word.is_empty() {
                put(dtype, &word, &mut out).ok_or_else(|| no_number(bytes, &word))??;
                done += 1;
                word.clear();
            }
            if byte == b'<' || done > count {
                ended = true;
                break;
            }
        }
        reader.consume(len);
    }
    if done != count {
        let found = format!("{done} numbers");
        let expected = format!("{count}, as the extent says");
        return Err(Error::format(bytes.path(), found, expected));
    }
    finish(out)
}

fn no_number(bytes: &Bytes, word: &[u8]) -> Error {
    let found = format!("\"{}\"", word.escape_ascii());
    Error::format(bytes.path(), found, "a number of the array's type")
}

/// The machine's own byte order, in which [`decimal`] writes.
pub(crate) const ORDER: Endian = Endian::NATIVE;

fn put(dtype: Dtype, word: &[u8], out: &mut impl Write) -> Option<Result<()>> {
    let text = std::str::from_utf8(word).ok()?;
    macro_rules! write {
        ($t:ty) => {
            out.write_all(&text.parse::<$t>().ok()?.to_ne_bytes())
        };
    }
    let done = match dtype {
        Dtype::U8 => write!(u8),
        Dtype::I8 => write!(i8),
        Dtype::U16 => write!(u16),
        Dtype::I16 => write!(i16),
        Dtype::U32 => write!(u32),
        Dtype::I32 => write!(i32),
        Dtype::F32 => write!(f32),
        Dtype::F64 => write!(f64),
    };
    Some(done.map_err(disk))
}
