//! Buffer views of a tile, decompressed where EXT_meshopt_compression says that they are compressed.
//!
//! Lengths are checked before anything is decoded: no stream of the codec is shorter than 1/64 of
//! what it decodes to, no two may use the same bytes, and all of them together decode to what the
//! tile states. So a hostile file cannot ask for memory out of proportion to its size.

use crate::gltf::container::{Fault, Result, fail};
use crate::gltf::read_json::{BufferView, Compressed, Document};
use std::ops::Range;
use std::sync::Arc;

/// Part of the file, or of what was decompressed from it.
#[derive(Debug, Clone)]
pub(crate) struct Bytes<'a> {
    source: Source<'a>,
    range: Range<usize>,
}

#[derive(Debug, Clone)]
enum Source<'a> {
    File(&'a [u8]),
    Own(Arc<Vec<u8>>),
}

impl<'a> Bytes<'a> {
    fn new(source: Source<'a>) -> Self {
        let mut all = Bytes {
            source,
            range: 0..0,
        };
        all.range.end = all.source.get().len();
        all
    }

    /// The bytes.
    pub fn get(&self) -> &[u8] {
        &self.source.get()[self.range.clone()]
    }

    /// The bytes in pieces of N; what is left over is dropped.
    pub fn chunks<const N: usize>(&self) -> &[[u8; N]] {
        self.get().as_chunks::<N>().0
    }

    /// The `length` bytes from `start` on, if there are as many.
    pub fn part(&self, start: u64, length: u64) -> Option<Self> {
        let end = start.checked_add(length)?;
        let whole = self.range.len() as u64;
        (end <= whole).then(|| Bytes {
            source: self.source.clone(),
            range: self.range.start + start as usize..self.range.start + end as usize,
        })
    }
}

impl Source<'_> {
    fn get(&self) -> &[u8] {
        match self {
            Source::File(bytes) => bytes,
            Source::Own(bytes) => bytes,
        }
    }
}

/// The BIN chunk with the views that had to be decompressed.
pub(crate) struct Buffers<'a> {
    bin: &'a [u8],
    /// Per view what it decodes to; nothing for plain views.
    decoded: Vec<Option<Bytes<'a>>>,
}

impl<'a> Buffers<'a> {
    /// Decompresses what is compressed; plain views are looked at when they are used.
    ///
    /// # Errors
    /// [`Fault::Compression`] if a compressed view cannot be what it says.
    pub fn new(doc: &Document, bin: &'a [u8]) -> Result<Self> {
        let mut budget = bin.len() as u64;
        let mut decoded = Vec::with_capacity(doc.buffer_views.len());
        for (i, view) in doc.buffer_views.iter().enumerate() {
            decoded.push(match &view.extensions.meshopt {
                None => None,
                Some(stream) => {
                    let place = format!("/bufferViews/{i}/extensions/EXT_meshopt_compression");
                    let bytes = check(doc, bin, view, stream, &mut budget)
                        .and_then(|encoded| decode(encoded, stream))
                        .or_else(|message| fail(Fault::Compression, place, message))?;
                    Some(Bytes::new(Source::Own(Arc::new(bytes))))
                }
            });
        }
        Ok(Buffers { bin, decoded })
    }

    /// The chunk without its compressed views, for the table, which is never compressed.
    pub fn plain(bin: &'a [u8]) -> Self {
        Buffers {
            bin,
            decoded: Vec::new(),
        }
    }

    /// The bytes of view `index`.
    ///
    /// # Errors
    /// [`Fault::Accessor`] if there is no such view, or it does not lie in the BIN chunk.
    pub fn view(&self, doc: &Document, index: usize) -> Result<Bytes<'a>> {
        if let Some(Some(bytes)) = self.decoded.get(index) {
            return Ok(bytes.clone());
        }
        let place = format!("/bufferViews/{index}");
        let Some(v) = doc.buffer_views.get(index) else {
            return fail(Fault::Accessor, place, "it does not exist");
        };
        let length = self.chunk_length(doc)?;
        let chunk = Bytes::new(Source::File(&self.bin[..length]));
        match chunk.part(v.byte_offset, v.byte_length) {
            Some(part) if v.buffer == 0 => Ok(part),
            _ => fail(
                Fault::Accessor,
                place,
                format!(
                    "{} bytes at byte {} of buffer {} do not lie in the buffer of {length} bytes",
                    v.byte_length, v.byte_offset, v.buffer
                ),
            ),
        }
    }

    /// The length of buffer 0, which is the BIN chunk.
    fn chunk_length(&self, doc: &Document) -> Result<usize> {
        let length = match doc.buffers.first() {
            Some(b) if b.uri.is_none() && doc.buffers.len() <= 2 => b.byte_length,
            _ => {
                return fail(
                    Fault::Accessor,
                    "/buffers",
                    "expected the BIN chunk, and behind it a fallback buffer at most",
                );
            }
        };
        // the chunk is padded to a multiple of 4, the buffer need not be
        if length > self.bin.len() as u64 || self.bin.len() as u64 - length > 3 {
            return fail(
                Fault::Accessor,
                "/buffers/0",
                format!(
                    "states {length} bytes, the BIN chunk has {}",
                    self.bin.len()
                ),
            );
        }
        Ok(length as usize)
    }
}

/// Checks a compressed view and returns its stream. `budget` is what of the BIN chunk no other
/// stream has used.
fn check<'a>(
    doc: &Document,
    bin: &'a [u8],
    view: &BufferView,
    stream: &Compressed,
    budget: &mut u64,
) -> std::result::Result<&'a [u8], String> {
    let fallback = doc
        .buffers
        .get(1)
        .filter(|b| b.uri.is_none() && b.extensions.meshopt.as_ref().is_some_and(|m| m.fallback));
    let Some(fallback) = fallback.filter(|b| view.buffer == 1 && b.byte_length < 1 << 32) else {
        return Err("expected a view of buffer 1, a fallback buffer below 4 GiB".into());
    };
    let size = stream.count.checked_mul(stream.byte_stride);
    let end = view.byte_offset.checked_add(view.byte_length);
    if stream.count == 0
        || size != Some(view.byte_length)
        || end.is_none_or(|end| end > fallback.byte_length)
    {
        return Err(format!(
            "found {} elements of {} bytes for a view of {} bytes at byte {}, expected as many as \
             the view has, inside the fallback buffer of {} bytes",
            stream.count,
            stream.byte_stride,
            view.byte_length,
            view.byte_offset,
            fallback.byte_length
        ));
    }
    let end = stream.byte_offset.checked_add(stream.byte_length);
    let inside = end.is_some_and(|end| end <= bin.len() as u64);
    if stream.buffer != 0 || !inside || stream.byte_length > *budget {
        return Err(format!(
            "{} bytes at byte {} of buffer {} do not lie in the BIN chunk of {} bytes, or other \
             streams use them",
            stream.byte_length,
            stream.byte_offset,
            stream.buffer,
            bin.len()
        ));
    }
    *budget -= stream.byte_length;
    let start = stream.byte_offset as usize;
    Ok(&bin[start..start + stream.byte_length as usize])
}

/// Decodes a stream whose place and size have been checked.
fn decode(encoded: &[u8], stream: &Compressed) -> std::result::Result<Vec<u8>, String> {
    let filter = stream.filter.as_deref().unwrap_or("NONE");
    let (count, length) = (stream.count, encoded.len() as u64);
    // the shortest streams, see the bitstreams in the specification of EXT_meshopt_compression
    let (known, shortest) = match (stream.mode.as_str(), stream.byte_stride, filter) {
        // 2 bits for 16 bytes that do not change, a header and the first vertex
        ("ATTRIBUTES", 4, "NONE" | "OCTAHEDRAL") | ("ATTRIBUTES", 8, "NONE") => {
            (true, (count * stream.byte_stride).div_ceil(64) + 33)
        }
        // a byte for a triangle, a header and a table of 16 bytes
        ("TRIANGLES", 2 | 4, "NONE") => (count % 3 == 0, count / 3 + 17),
        // a byte for an index, a header and 4 bytes at the end
        ("INDICES", 2 | 4, "NONE") => (true, count + 5),
        _ => (false, 0),
    };
    if !known {
        return Err(format!(
            "found mode {} of {count} elements of {} bytes with filter {filter}, expected ATTRIBUTES \
             of 4 or 8 bytes, OCTAHEDRAL with 4 alone, or TRIANGLES or INDICES of 2 or 4 bytes",
            stream.mode, stream.byte_stride
        ));
    }
    if length < shortest {
        return Err(format!(
            "found {length} bytes for {count} elements, expected at least {shortest}"
        ));
    }
    let count = count as usize;
    let made = match (stream.mode.as_str(), stream.byte_stride) {
        // version 0 is the one that the extension has
        ("ATTRIBUTES", _) if meshopt::decode_vertex_version(encoded) != Some(0) => None,
        ("ATTRIBUTES", 4) => meshopt::decode_vertex_buffer::<[u8; 4]>(encoded, count)
            .ok()
            .map(Vec::into_flattened),
        ("ATTRIBUTES", _) => meshopt::decode_vertex_buffer::<[u8; 8]>(encoded, count)
            .ok()
            .map(Vec::into_flattened),
        ("TRIANGLES", 2) => narrow(meshopt::decode_index_buffer(encoded, count).ok()),
        ("TRIANGLES", _) => wide(meshopt::decode_index_buffer(encoded, count).ok()),
        (_, 2) => narrow(meshopt::decode_index_sequence(encoded, count).ok()),
        _ => wide(meshopt::decode_index_sequence(encoded, count).ok()),
    };
    let Some(mut bytes) = made else {
        return Err(format!(
            "found {length} bytes that are no stream of {count} elements in mode {}",
            stream.mode
        ));
    };
    if filter == "OCTAHEDRAL" {
        bytes.as_chunks_mut::<4>().0.iter_mut().for_each(octahedral);
    }
    Ok(bytes)
}

fn narrow(indices: Option<Vec<u16>>) -> Option<Vec<u8>> {
    Some(indices?.iter().flat_map(|i| i.to_le_bytes()).collect())
}

fn wide(indices: Option<Vec<u32>>) -> Option<Vec<u8>> {
    Some(indices?.iter().flat_map(|i| i.to_le_bytes()).collect())
}

/// The octahedral filter of EXT_meshopt_compression for components of 8 bits: x and y on the
/// octahedron and the value of one become a vector of length 127.
fn octahedral(e: &mut [u8; 4]) {
    let [mut x, mut y, one] = [0, 1, 2].map(|i| f32::from(e[i] as i8));
    let z = one - x.abs() - y.abs();
    let below = z.min(0.0);
    x += if x >= 0.0 { below } else { -below };
    y += if y >= 0.0 { below } else { -below };
    let scale = 127.0 / (x * x + y * y + z * z).sqrt();
    for (byte, v) in e.iter_mut().zip([x, y, z]) {
        let rounded = v * scale + if v >= 0.0 { 0.5 } else { -0.5 };
        // towards zero; out of range saturates, no number becomes 0
        *byte = rounded as i8 as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The decoder of the library that wrote the specification, on all codes.
    #[test]
    fn the_filter_is_that_of_meshoptimizer() {
        let mut codes: Vec<[i8; 4]> = Vec::new();
        for x in -127..=127i8 {
            for y in -127..=127i8 {
                codes.push([x, y, 127, 0]);
            }
        }
        let mut own: Vec<[u8; 4]> = codes.iter().map(|c| c.map(|v| v as u8)).collect();
        own.iter_mut().for_each(octahedral);
        meshopt::decode_filter_oct(&mut codes);
        // its vector instructions round halves to even, the specification's formula away from zero
        let mut other = 0;
        for (own, theirs) in own.iter().zip(&codes) {
            for (a, &b) in own.iter().zip(theirs) {
                other += u32::from(*a as i8 != b);
                assert!((*a as i8).abs_diff(b) <= 1, "{own:?} {theirs:?}");
            }
        }
        assert!(other < 1000, "{other} of 65,025 codes");
    }

    #[test]
    fn no_code_breaks_the_filter() {
        for bits in (0..=u32::MAX >> 8).step_by(37) {
            octahedral(&mut bits.to_le_bytes());
        }
    }
}
