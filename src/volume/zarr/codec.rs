//! The steps by which a chunk's bytes were packed, undone.

use super::super::blosc::{self, Broken};
use super::super::zstd;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use std::io::Read;

/// A step from bytes to bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Gzip,
    Zlib,
    Zstd,
    /// With the length in front, as numcodecs writes.
    Lz4,
    Blosc,
    /// A checksum behind the bytes.
    Crc32c,
    /// Byte planes of items of this size.
    Shuffle(usize),
}

impl Packing {
    /// The step of a name in the metadata of either version.
    pub(super) fn find(name: &str) -> Option<Packing> {
        Some(match name.strip_prefix("numcodecs.").unwrap_or(name) {
            "gzip" => Packing::Gzip,
            "zlib" => Packing::Zlib,
            "zstd" => Packing::Zstd,
            "lz4" => Packing::Lz4,
            "blosc" => Packing::Blosc,
            "crc32c" => Packing::Crc32c,
            _ => return None,
        })
    }

    /// Unpacks to exactly `size` bytes, or, in between, to at most that.
    fn undo(self, from: &[u8], size: usize, last: bool) -> Result<Vec<u8>, Broken> {
        let damaged = |what: String| Broken::Damaged(what);
        let bad = |e: std::io::Error| Broken::Damaged(format!("a damaged chunk ({e})"));
        let stream = |reader: &mut dyn Read| {
            let mut out = Vec::new();
            reader
                .take(size as u64 + 1)
                .read_to_end(&mut out)
                .map_err(bad)?;
            Ok(out)
        };
        let out = match self {
            Packing::Gzip => stream(&mut MultiGzDecoder::new(from))?,
            Packing::Zlib => stream(&mut ZlibDecoder::new(from))?,
            Packing::Crc32c => return checked(from),
            Packing::Shuffle(item) => {
                let mut out = vec![0; from.len()];
                blosc::unshuffle(item, from, &mut out);
                return Ok(out);
            }
            Packing::Zstd | Packing::Lz4 | Packing::Blosc => {
                let size = if last { size } else { self.stated(from, size)? };
                let mut out = vec![0; size];
                match self {
                    Packing::Zstd => zstd::decode(from, &mut out).map_err(bad)?,
                    Packing::Lz4 => lz4(from, &mut out)?,
                    _ => blosc::decode(from, &mut out)?,
                }
                out
            }
        };
        if out.len() > size || (last && out.len() < size) {
            return Err(damaged(format!(
                "a chunk of {} bytes for {size}",
                out.len()
            )));
        }
        Ok(out)
    }

    /// The size that the packed bytes state, where it is not that of the chunk.
    fn stated(self, from: &[u8], most: usize) -> Result<usize, Broken> {
        let word = match self {
            Packing::Lz4 => from.first_chunk().map(|w| u32::from_le_bytes(*w) as usize),
            Packing::Blosc => blosc::size(from),
            _ => {
                let what = "Zstandard before another compressor".to_owned();
                return Err(Broken::Unsupported(what));
            }
        };
        match word {
            Some(n) if n <= most => Ok(n),
            _ => Err(Broken::Damaged("a damaged chunk".into())),
        }
    }
}

fn lz4(from: &[u8], out: &mut [u8]) -> Result<(), Broken> {
    let damaged = || Broken::Damaged("a damaged LZ4 chunk".into());
    let (len, packed) = from.split_first_chunk::<4>().ok_or_else(damaged)?;
    let whole = u32::from_le_bytes(*len) as usize == out.len();
    if whole && blosc::lz4(packed, out) {
        return Ok(());
    }
    Err(damaged())
}

/// Undoes all steps; they are in the order in which they were taken.
///
/// # Errors
/// What is wrong with the bytes, or the name of what is not unpacked.
pub(super) fn unpack(steps: &[Packing], from: Vec<u8>, size: usize) -> Result<Vec<u8>, Broken> {
    let mut bytes = from;
    for (i, step) in steps.iter().enumerate().rev() {
        // what is packed in between can be a little larger than what is not
        let most = if i == 0 {
            size
        } else {
            size + size / 64 + 4096
        };
        bytes = step.undo(&bytes, most, i == 0)?;
    }
    if bytes.len() != size {
        let what = format!("a chunk of {} bytes for {size}", bytes.len());
        return Err(Broken::Damaged(what));
    }
    Ok(bytes)
}

/// The bytes in front of their checksum.
fn checked(from: &[u8]) -> Result<Vec<u8>, Broken> {
    match from.split_last_chunk::<4>() {
        Some((bytes, sum)) if crc32c(bytes) == u32::from_le_bytes(*sum) => Ok(bytes.to_vec()),
        _ => Err(Broken::Damaged("a chunk with a wrong checksum".into())),
    }
}

/// The CRC-32 of Castagnoli's polynomial (RFC 3720, B.4).
fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut i = 0;
        while i < 256 {
            let (mut word, mut bit) = (i as u32, 0);
            while bit < 8 {
                word = word >> 1 ^ if word & 1 == 1 { 0x82f6_3b78 } else { 0 };
                bit += 1;
            }
            table[i] = word;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |crc, byte| {
        TABLE[(crc ^ u32::from(*byte)) as usize & 255] ^ crc >> 8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        // RFC 3720, B.4: 32 bytes of zeros, and the digits
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }
}
