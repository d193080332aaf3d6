//! Unpacking a strip or tile, and undoing the predictor.

use crate::volume::Endian;
use crate::volume::codecs::zstd;
use flate2::bufread::ZlibDecoder;
use std::io::{BufRead, Error, ErrorKind, Read, Result};
use weezl::{BitOrder, LzwStatus, decode::Decoder};

/// How a page is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    Zstd,
}

impl Compression {
    /// No byte can unpack to more than this: 128 bytes in 2 for PackBits, 258 in 2 bits for Deflate
    /// (<https://zlib.net/zlib_tech.html>), a whole table of 4096 in 12 bits for LZW. Sizes beyond it
    /// are refused before anything is allocated for them.
    pub(crate) fn most(self) -> u64 {
        match self {
            Compression::None => 1,
            Compression::PackBits => 64,
            Compression::Deflate => 1032,
            Compression::Lzw => 2731,
            // a block of 128 KiB of one byte in 4 (RFC 8878, 3.1.1.2)
            Compression::Zstd => 32_768,
        }
    }
}

/// Fills `out` from a packed chunk. A chunk that decodes to more is clipped: some writers pad the
/// last strip to full height.
pub(crate) fn unpack(how: Compression, from: impl BufRead, out: &mut [u8]) -> Result<()> {
    match how {
        Compression::None => { from }.read_exact(out),
        Compression::Deflate => ZlibDecoder::new(from).read_exact(out),
        Compression::Lzw => lzw(from, out),
        Compression::PackBits => pack_bits(from, out),
        Compression::Zstd => zstd::decode(from, out),
    }
}

fn lzw(mut from: impl BufRead, out: &mut [u8]) -> Result<()> {
    let mut decoder = Decoder::with_tiff_size_switch(BitOrder::Msb, 8);
    let mut done = 0;
    while done < out.len() {
        let packed = from.fill_buf()?;
        let at_end = packed.is_empty();
        let step = decoder.decode_bytes(packed, &mut out[done..]);
        from.consume(step.consumed_in);
        done += step.consumed_out;
        let status = step
            .status
            .map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
        let stuck = step.consumed_in == 0 && step.consumed_out == 0;
        if done < out.len() && (matches!(status, LzwStatus::Done) || (at_end && stuck)) {
            return Err(ErrorKind::UnexpectedEof.into());
        }
    }
    Ok(())
}

fn pack_bits(mut from: impl BufRead, out: &mut [u8]) -> Result<()> {
    let mut done = 0;
    while done < out.len() {
        let mut byte = [0];
        from.read_exact(&mut byte)?;
        let n = byte[0] as i8;
        let rest = &mut out[done..];
        if n >= 0 {
            let count = (n as usize + 1).min(rest.len());
            from.read_exact(&mut rest[..count])?;
            done += count;
        } else if n != -128 {
            from.read_exact(&mut byte)?;
            let count = (1 - isize::from(n)) as usize;
            let count = count.min(rest.len());
            rest[..count].fill(byte[0]);
            done += count;
        }
    }
    Ok(())
}

/// How samples were prepared before packing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Predictor {
    None,
    /// Differences to the sample on the left.
    Horizontal,
    /// Byte planes, most significant first, and differences of their bytes.
    FloatingPoint,
}

/// Turns rows of `width` samples of `sample` bytes into the machine's byte order and undoes the
/// predictor.
pub(crate) fn restore(
    rows: &mut [u8],
    width: usize,
    sample: usize,
    endian: Endian,
    predictor: Predictor,
) {
    if predictor == Predictor::FloatingPoint {
        planes(rows, width, sample);
        return;
    }
    match sample {
        2 => whole::<2>(rows, width, endian, predictor, |a, b| {
            u16::from_ne_bytes(a)
                .wrapping_add(u16::from_ne_bytes(b))
                .to_ne_bytes()
        }),
        4 => whole::<4>(rows, width, endian, predictor, |a, b| {
            u32::from_ne_bytes(a)
                .wrapping_add(u32::from_ne_bytes(b))
                .to_ne_bytes()
        }),
        8 => whole::<8>(rows, width, endian, predictor, |a, b| {
            u64::from_ne_bytes(a)
                .wrapping_add(u64::from_ne_bytes(b))
                .to_ne_bytes()
        }),
        _ => whole::<1>(rows, width, endian, predictor, |[a], [b]| {
            [a.wrapping_add(b)]
        }),
    }
}

fn whole<const N: usize>(
    rows: &mut [u8],
    width: usize,
    endian: Endian,
    predictor: Predictor,
    add: impl Fn([u8; N], [u8; N]) -> [u8; N],
) {
    let samples = rows.as_chunks_mut::<N>().0;
    if endian != Endian::NATIVE {
        samples.iter_mut().for_each(|s| s.reverse());
    }
    if predictor == Predictor::Horizontal {
        for row in samples.chunks_exact_mut(width) {
            let mut left = [0; N];
            for s in row {
                left = add(left, *s);
                *s = left;
            }
        }
    }
}

fn planes(rows: &mut [u8], width: usize, sample: usize) {
    let mut bytes = vec![0; width * sample];
    for row in rows.chunks_exact_mut(width * sample) {
        let mut left = 0u8;
        for (to, from) in bytes.iter_mut().zip(&*row) {
            left = left.wrapping_add(*from);
            *to = left;
        }
        for (i, out) in row.chunks_exact_mut(sample).enumerate() {
            for (plane, out) in out.iter_mut().enumerate() {
                *out = bytes[plane * width + i];
            }
            if Endian::NATIVE == Endian::Little {
                out.reverse();
            }
        }
    }
}
