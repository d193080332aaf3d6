//! Filters of HDF5 plugins, by their registered numbers
//! (<https://github.com/HDFGroup/hdf5_plugins/blob/master/docs/RegisteredFilterPlugins.md>).

use crate::volume::codecs::blosc::{self, Broken};
use crate::volume::codecs::zstd;
use crate::volume::io::paged::MAX_CHUNK;
use hdf5_reader::FilterRegistry;
use hdf5_reader::error::Error as H5Error;

/// Filters of plugins that are not read.
const OTHERS: [(&str, &str); 4] = [
    ("307", "bzip2"),
    ("32013", "ZFP"),
    ("32017", "SZ"),
    ("32026", "Blosc 2"),
];

/// A filter in words, by its number.
pub(crate) fn name(number: &str) -> String {
    let known = OTHERS.iter().find(|(id, _)| *id == number);
    let known = known.map_or(String::new(), |(_, name)| format!(" ({name})"));
    format!("the HDF5 filter {number}{known}")
}

/// True for the library's own filters and those of [`registry`].
pub(crate) fn is_known(id: u16) -> bool {
    matches!(id, 1..=6 | 32_000 | 32_001 | 32_004 | 32_008 | 32_015)
}

/// The library's own filters and these.
pub(crate) fn registry() -> FilterRegistry {
    let mut registry = FilterRegistry::new();
    registry.register(
        32_000,
        Box::new(|filter, from, _| {
            // the third number is the size of a chunk
            let size = filter.client_data.get(2).copied().unwrap_or(0) as usize;
            sized(size, "LZF", |out| lzf(from, out).is_some())
        }),
    );
    registry.register(
        32_001,
        Box::new(|_, from, _| {
            let mut out = room(blosc::size(from).unwrap_or(0), "Blosc")?;
            match blosc::decode(from, &mut out) {
                Ok(()) => Ok(out),
                Err(Broken::Damaged(what)) => Err(H5Error::FilterError(what)),
                Err(Broken::Unsupported(what)) => Err(H5Error::UnsupportedFilter(format!(
                    "filter id 32001, {what}"
                ))),
            }
        }),
    );
    registry.register(
        32_008,
        Box::new(|filter, from, _| bitshuffled(&filter.client_data, from)),
    );
    registry.register(
        32_015,
        Box::new(|_, from, _| {
            let size = content(from).unwrap_or(0);
            sized(size, "Zstandard", |out| zstd::decode(from, out).is_ok())
        }),
    );
    registry
}

fn damaged(name: &str) -> H5Error {
    H5Error::FilterError(format!("a damaged chunk of {name}"))
}

fn room(size: usize, name: &str) -> Result<Vec<u8>, H5Error> {
    if size == 0 || size as u64 > MAX_CHUNK {
        return Err(damaged(name));
    }
    Ok(vec![0; size])
}

fn sized(
    size: usize,
    name: &str,
    fill: impl FnOnce(&mut [u8]) -> bool,
) -> Result<Vec<u8>, H5Error> {
    let mut out = room(size, name)?;
    if fill(&mut out) {
        Ok(out)
    } else {
        Err(damaged(name))
    }
}

/// The size that a Zstandard frame states (RFC 8878, 3.1.1.1).
fn content(frame: &[u8]) -> Option<usize> {
    let descriptor = *frame.get(4)?;
    let single = descriptor & 0x20 != 0;
    let skip = 5 + usize::from(!single) + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let field = frame.get(skip..)?;
    let size = match (descriptor >> 6, single) {
        (0, false) => return None,
        (0, true) => u64::from(*field.first()?),
        (1, _) => u64::from(u16::from_le_bytes(*field.first_chunk()?)) + 256,
        (2, _) => u64::from(u32::from_le_bytes(*field.first_chunk()?)),
        _ => u64::from_le_bytes(*field.first_chunk()?),
    };
    usize::try_from(size).ok()
}

/// Bits of items in blocks, packed or not (<https://github.com/kiyo-masui/bitshuffle>).
fn bitshuffled(numbers: &[u32], from: &[u8]) -> Result<Vec<u8>, H5Error> {
    let bad = || damaged("bitshuffle");
    let number = |i: usize| numbers.get(i).copied().unwrap_or(0) as usize;
    let (item, packing) = (number(2).max(1), number(4));
    if !matches!(packing, 0 | 2 | 3) {
        let what = format!("filter id 32008, packing {packing}");
        return Err(H5Error::UnsupportedFilter(what));
    }
    // 8 KiB, in items, a multiple of 8 of them
    let usual = (8192 / item / 8 * 8).max(128);
    let (total, block, mut rest) = if packing == 0 {
        let block = if number(3) > 0 { number(3) } else { usual };
        (from.len(), block.checked_mul(item).ok_or_else(bad)?, from)
    } else {
        let total = u64::from_be_bytes(*from.first_chunk().ok_or_else(bad)?) as usize;
        let block = from.get(8..12).ok_or_else(bad)?;
        let block = u32::from_be_bytes([block[0], block[1], block[2], block[3]]) as usize;
        (total, block, &from[12..])
    };
    let mut out = room(total, "bitshuffle")?;
    if block == 0 || block % (8 * item) != 0 {
        return Err(bad());
    }
    // items beyond the last whole group of 8 are as they are
    let whole = total / (8 * item) * (8 * item);
    let mut shuffled = vec![0; block.min(whole)];
    for out in out[..whole].chunks_mut(block) {
        let shuffled = &mut shuffled[..out.len()];
        if packing == 0 {
            let (now, later) = rest.split_at_checked(out.len()).ok_or_else(bad)?;
            shuffled.copy_from_slice(now);
            rest = later;
        } else {
            let (len, after) = rest.split_first_chunk::<4>().ok_or_else(bad)?;
            let len = u32::from_be_bytes(*len) as usize;
            let (packed, later) = after.split_at_checked(len).ok_or_else(bad)?;
            let done = match packing {
                2 => blosc::lz4(packed, shuffled),
                _ => zstd::decode(packed, shuffled).is_ok(),
            };
            if !done {
                return Err(bad());
            }
            rest = later;
        }
        blosc::unshuffle_bits(item, shuffled, out);
    }
    let tail = &mut out[whole..];
    tail.copy_from_slice(rest.get(..tail.len()).ok_or_else(bad)?);
    Ok(out)
}

/// LZF (<http://oldhome.schmorp.de/marc/liblzf.html>). `None` if it is damaged.
fn lzf(from: &[u8], out: &mut [u8]) -> Option<()> {
    let mut from = from.iter().map(|&b| usize::from(b));
    let mut done = 0;
    while let Some(control) = from.next() {
        if control < 32 {
            for _ in 0..=control {
                *out.get_mut(done)? = from.next()? as u8;
                done += 1;
            }
            continue;
        }
        let mut len = control >> 5;
        if len == 7 {
            len += from.next()?;
        }
        let distance = ((control & 31) << 8) + from.next()?;
        let start = done.checked_sub(distance + 1)?;
        for i in start..start + len + 2 {
            *out.get_mut(done)? = out[i];
            done += 1;
        }
    }
    (done == out.len()).then_some(())
}
