//! The steps by which a chunk's bytes were packed, undone.

use crate::volume::Endian;
use crate::volume::codecs::blosc::{self, Broken};
use crate::volume::codecs::zstd;
use crate::volume::formats::zarr::filter::Filter;
use crate::volume::formats::zarr::kind::Kind;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use serde_json::Value;
use std::io::Read;

/// A step from numbers or bytes to bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Packing {
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
    /// Numbers that stand for others.
    Filter(Filter),
}

impl Packing {
    /// The step of a name in the metadata of either version, with its settings, for numbers of a type. Names of
    /// numcodecs may have that in front.
    pub(crate) fn find(name: &str, set: &Value, plain: (Kind, Endian)) -> Option<Packing> {
        let name = name.strip_prefix("numcodecs.").unwrap_or(name);
        Some(match name {
            "gzip" => Packing::Gzip,
            "zlib" => Packing::Zlib,
            "zstd" => Packing::Zstd,
            "lz4" => Packing::Lz4,
            "blosc" => Packing::Blosc,
            "crc32c" => Packing::Crc32c,
            "shuffle" => {
                let item = match &set["elementsize"] {
                    // what numcodecs takes
                    Value::Null => 4,
                    item => item.as_u64().filter(|n| (1..=64).contains(n))?,
                };
                Packing::Shuffle(item as usize)
            }
            _ => Packing::Filter(Filter::find(name, set, plain)?),
        })
    }

    /// Bytes that the step makes of `size`, if that is known before.
    fn packed(&self, size: usize) -> Option<usize> {
        match self {
            Packing::Crc32c => Some(size + 4),
            Packing::Shuffle(_) => Some(size),
            Packing::Filter(filter) => Some(filter.packed(size)),
            _ => None,
        }
    }

    /// Unpacks to `size` bytes if that is known, or else to at most `most`.
    fn undo(&self, from: Vec<u8>, size: Option<usize>, most: usize) -> Result<Vec<u8>, Broken> {
        let bad = |e: std::io::Error| Broken::Damaged(format!("a damaged chunk ({e})"));
        let stream = |reader: &mut dyn Read| {
            let mut out = Vec::with_capacity(size.unwrap_or(0));
            let mut reader = reader.take(size.unwrap_or(most) as u64 + 1);
            reader.read_to_end(&mut out).map_err(bad)?;
            Ok(out)
        };
        let out = match self {
            Packing::Gzip => stream(&mut MultiGzDecoder::new(&from[..]))?,
            Packing::Zlib => stream(&mut ZlibDecoder::new(&from[..]))?,
            Packing::Crc32c => checked(from)?,
            Packing::Shuffle(item) => {
                let mut out = vec![0; from.len()];
                blosc::unshuffle(*item, &from, &mut out);
                out
            }
            Packing::Filter(filter) => match size {
                Some(size) => filter.undo(from, size)?,
                None => return Err(Broken::Unsupported("a filter behind a compressor".into())),
            },
            Packing::Zstd | Packing::Lz4 | Packing::Blosc => {
                let size = match size {
                    Some(size) => size,
                    None => self.stated(&from, most)?,
                };
                let mut out = vec![0; size];
                match self {
                    Packing::Zstd => zstd::decode(&from[..], &mut out).map_err(bad)?,
                    Packing::Lz4 => lz4(&from, &mut out)?,
                    _ => blosc::decode(&from, &mut out)?,
                }
                out
            }
        };
        match size {
            Some(size) if out.len() != size => Err(wrong_size(out.len(), size)),
            None if out.len() > most => Err(wrong_size(out.len(), most)),
            _ => Ok(out),
        }
    }

    /// The size that the packed bytes state, where it is not known before.
    fn stated(&self, from: &[u8], most: usize) -> Result<usize, Broken> {
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

fn wrong_size(found: usize, expected: usize) -> Broken {
    Broken::Damaged(format!("a chunk of {found} bytes for {expected}"))
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

/// Bytes before each step, in the order in which they are taken, of which the first has `size`; `None` behind
/// what compresses.
fn sizes(steps: &[Packing], size: usize) -> Vec<Option<usize>> {
    let mut sizes = vec![Some(size)];
    for step in steps {
        let before = sizes.last().copied().flatten();
        sizes.push(before.and_then(|n| step.packed(n)));
    }
    sizes
}

/// The most bytes that a chunk of `size` has between its steps.
pub(crate) fn largest(steps: &[Packing], size: usize) -> usize {
    let known = sizes(steps, size).into_iter().flatten().max();
    // what is packed can be a little larger than what is not
    let most = known.unwrap_or(size);
    most + most / 8 + 65_536
}

/// Undoes all steps; they are in the order in which they were taken.
///
/// # Errors
/// What is wrong with the bytes, or the name of what is not unpacked.
pub(crate) fn unpack(steps: &[Packing], from: Vec<u8>, size: usize) -> Result<Vec<u8>, Broken> {
    let most = largest(steps, size);
    let before = sizes(steps, size);
    let mut bytes = from;
    for (step, size) in steps.iter().zip(before).rev() {
        bytes = step.undo(bytes, size, most)?;
    }
    match bytes.len() == size {
        true => Ok(bytes),
        false => Err(wrong_size(bytes.len(), size)),
    }
}

/// The bytes in front of their checksum.
fn checked(mut from: Vec<u8>) -> Result<Vec<u8>, Broken> {
    match from.split_last_chunk::<4>() {
        Some((bytes, sum)) if crc32c(bytes) == u32::from_le_bytes(*sum) => {
            from.truncate(from.len() - 4);
            Ok(from)
        }
        _ => Err(Broken::Damaged("a chunk with a wrong checksum".into())),
    }
}

/// The CRC-32 of Castagnoli's polynomial (RFC 3720, B.4).
pub(crate) fn crc32c(bytes: &[u8]) -> u32 {
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
