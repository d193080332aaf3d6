//! Blosc chunks: blocks of bytes or bits that are shuffled and packed. Zarr and HDF5 hold them.
//!
//! The format is that of c-blosc 1 (<https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>),
//! which Blosc 2 reads and Zarr writes.

use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// Why a chunk cannot be unpacked.
#[derive(Debug, PartialEq)]
pub(crate) enum Broken {
    /// It is damaged.
    Damaged(String),
    /// It is of a kind that is not unpacked.
    Unsupported(String),
}

/// Bytes in front of the table of blocks.
const HEADER: usize = 16;

/// How the streams of a block are packed.
#[derive(Debug, Clone, Copy)]
enum Packing {
    BloscLz,
    Lz4,
    Zlib,
    Zstd,
}

/// The size of what a chunk unpacks to, as it states.
pub(crate) fn size(chunk: &[u8]) -> Option<usize> {
    let word = chunk.get(4..8)?;
    Some(u32::from_le_bytes([word[0], word[1], word[2], word[3]]) as usize)
}

/// Unpacks a chunk of exactly the size of `out`.
///
/// # Errors
/// What is wrong with it, or the name of what is not unpacked.
pub(crate) fn decode(chunk: &[u8], out: &mut [u8]) -> Result<(), Broken> {
    let damaged = || Broken::Damaged("a damaged Blosc chunk".into());
    let head: &[u8; HEADER] = chunk.first_chunk().ok_or_else(damaged)?;
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (version, flags, item) = (head[0], head[2], usize::from(head[3]));
    let [whole, block] = [4, 8].map(|at| word(at) as usize);
    // version 2 has one size of header; 3 and later are those of Blosc 2
    if version > 2 {
        return Err(Broken::Unsupported(format!(
            "Blosc chunks of version {version}"
        )));
    }
    if whole != out.len() {
        let found = format!("a Blosc chunk of {whole} bytes for {}", out.len());
        return Err(Broken::Damaged(found));
    }
    if flags & 2 != 0 {
        // stored as it is
        let stored = chunk.get(HEADER..HEADER + whole).ok_or_else(damaged)?;
        out.copy_from_slice(stored);
        return Ok(());
    }
    let packing = match flags >> 5 {
        0 => Packing::BloscLz,
        1 => Packing::Lz4,
        3 => Packing::Zlib,
        4 => Packing::Zstd,
        2 => return Err(Broken::Unsupported("Blosc with Snappy".into())),
        n => return Err(Broken::Unsupported(format!("Blosc with compressor {n}"))),
    };
    if item == 0 || block == 0 || flags & 5 == 5 {
        return Err(damaged());
    }
    let mut shuffled = vec![0; block.min(whole)];
    for (i, out) in out.chunks_mut(block).enumerate() {
        let at = HEADER + 4 * i;
        let start = chunk.get(at..at + 4).ok_or_else(damaged)?;
        let start = u32::from_le_bytes([start[0], start[1], start[2], start[3]]) as usize;
        let packed = chunk.get(start..).ok_or_else(damaged)?;
        let last = out.len() < block;
        let split = flags & 0x10 == 0 && !last && item <= 16 && block / item >= 128;
        let streams = if split { item } else { 1 };
        let shuffled = &mut shuffled[..out.len()];
        unpack(packing, packed, streams, shuffled)?;
        if flags & 1 != 0 && item > 1 {
            unshuffle(item, shuffled, out);
        } else if flags & 4 != 0 && out.len() >= item {
            unshuffle_bits(item, shuffled, out);
        } else {
            out.copy_from_slice(shuffled);
        }
    }
    Ok(())
}

/// Unpacks the streams of a block, each with its length in front.
fn unpack(packing: Packing, mut from: &[u8], streams: usize, out: &mut [u8]) -> Result<(), Broken> {
    let damaged = || Broken::Damaged("a damaged Blosc block".into());
    let each = out.len() / streams;
    if each == 0 || each * streams != out.len() {
        return Err(damaged());
    }
    for out in out.chunks_exact_mut(each) {
        let (len, rest) = from.split_first_chunk::<4>().ok_or_else(damaged)?;
        let len = u32::from_le_bytes(*len) as usize;
        let packed = rest.get(..len).ok_or_else(damaged)?;
        from = &rest[len..];
        if len == out.len() {
            out.copy_from_slice(packed);
            continue;
        }
        let done = match packing {
            Packing::BloscLz => blosc_lz(packed, out).is_some(),
            Packing::Lz4 => lz4(packed, out),
            Packing::Zlib => ZlibDecoder::new(packed).read_exact(out).is_ok(),
            Packing::Zstd => crate::volume::codecs::zstd::decode(packed, out).is_ok(),
        };
        if !done {
            return Err(damaged());
        }
    }
    Ok(())
}

/// Fills `out` from an LZ4 block; false if it is damaged or of another size.
pub(crate) fn lz4(packed: &[u8], out: &mut [u8]) -> bool {
    lz4_flex::block::decompress_into(packed, out).is_ok_and(|n| n == out.len())
}

/// Byte planes to items; bytes beyond the last whole item are as they are.
pub(crate) fn unshuffle(item: usize, from: &[u8], out: &mut [u8]) {
    let count = from.len() / item;
    if count == 0 {
        out.copy_from_slice(from);
        return;
    }
    for (byte, plane) in from.chunks_exact(count).take(item).enumerate() {
        let places = out[byte..].iter_mut().step_by(item);
        places.zip(plane).for_each(|(out, from)| *out = *from);
    }
    let done = count * item;
    out[done..].copy_from_slice(&from[done..]);
}

/// Planes of single bits to items. Only whole groups of 8 items are shuffled: of other numbers all is
/// as it is, but for bytes beyond the last whole item.
pub(crate) fn unshuffle_bits(item: usize, from: &[u8], out: &mut [u8]) {
    let count = from.len() / item;
    let groups = if count.is_multiple_of(8) {
        count / 8
    } else {
        0
    };
    let done = groups * 8 * item;
    out[..done].fill(0);
    for (plane, bits) in from[..done].chunks_exact(groups.max(1)).enumerate() {
        let (byte, bit) = (plane / 8, plane % 8);
        for (group, bits) in bits.iter().enumerate() {
            for i in 0..8 {
                out[(group * 8 + i) * item + byte] |= (bits >> i & 1) << bit;
            }
        }
    }
    out[done..].copy_from_slice(&from[done..]);
}

/// BloscLZ, a kin of FastLZ (<https://github.com/Blosc/c-blosc/blob/main/blosc/blosclz.c>). `None`
/// if it is damaged.
fn blosc_lz(from: &[u8], out: &mut [u8]) -> Option<()> {
    let mut from = from.iter().map(|&b| usize::from(b));
    let mut done = 0;
    // the first byte is one of literals, whatever its upper bits
    let mut control = from.next()? & 31;
    loop {
        if control < 32 {
            for _ in 0..=control {
                *out.get_mut(done)? = from.next()? as u8;
                done += 1;
            }
        } else {
            let mut len = (control >> 5) - 1;
            let mut distance = (control & 31) << 8;
            if len == 6 {
                loop {
                    let more = from.next()?;
                    len += more;
                    if more != 255 {
                        break;
                    }
                }
            }
            let low = from.next()?;
            if low == 255 && distance == 31 << 8 {
                // far away: 16 more bits
                distance = (from.next()? << 8) + from.next()? + 8191;
            } else {
                distance += low;
            }
            let start = done.checked_sub(distance + 1)?;
            for i in start..start + len + 3 {
                *out.get_mut(done)? = out[i];
                done += 1;
            }
        }
        match from.next() {
            Some(next) => control = next,
            None => return (done == out.len()).then_some(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffles_are_undone() {
        let mut out = [0; 7];
        unshuffle(3, &[1, 4, 2, 5, 3, 6, 9], &mut out);
        assert_eq!(out, [1, 2, 3, 4, 5, 6, 9]);
        // 8 items of one byte with the values 0 to 7: plane b holds bit b of each
        let planes = [0xaa, 0xcc, 0xf0, 0, 0, 0, 0, 0, 77];
        let mut out = [0; 8];
        unshuffle_bits(1, &planes[..8], &mut out);
        assert_eq!(out, [0, 1, 2, 3, 4, 5, 6, 7]);
        let mut out = [0; 9];
        unshuffle_bits(1, &planes, &mut out);
        assert_eq!(out, planes, "9 items are no whole groups");
    }

    #[test]
    fn blosc_lz_copies_what_overlaps() {
        // 2 literals, then a match of 5 bytes 2 back, then 1 literal
        let mut out = [0; 8];
        assert!(blosc_lz(&[1, b'a', b'b', 3 << 5, 1, 0, b'c'], &mut out).is_some());
        assert_eq!(&out, b"abababac");
        assert!(blosc_lz(&[1, b'a', b'b', 3 << 5, 5, 0, b'c'], &mut out).is_none());
    }
}
