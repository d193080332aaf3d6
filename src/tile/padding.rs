//! Bytes of a tile that nothing uses: there are none but for alignment, and these are zeros, or blanks in JSON.

use super::codec::any_minus_zero;
use super::read::{Pieces, Tile};
use super::unusual::Found;
use crate::gltf::UNSIGNED_SHORT;
use crate::gltf::read_json::{BufferView, Document};
use crate::sys::simd::dispatch;
use std::ops::Range;

/// Bytes that a tile's JSON chunk may have behind the JSON: what ids and measures may come to take, once for the tile
/// and for each piece, and up to a sector of the disk.
const ROOM: usize = 1024;
const SECTOR: usize = 4096;

impl Tile<'_> {
    /// Looks for bytes that nothing uses, or that should be zeros or blanks and are not.
    pub(super) fn padding(&self, found: &mut Found) {
        let doc = &self.document;
        if let Some(message) = json_padding(self.glb.json, doc.nodes.len().max(rows(doc))) {
            found.push((String::new(), message));
        }
        self.chunk(found);
        fallback(doc, found);
        self.views(found);
        self.streams(found);
        self.elements(found);
    }

    /// The parts of the BIN chunk follow one another.
    fn chunk(&self, found: &mut Found) {
        let (doc, bin) = (&self.document, self.glb.bin);
        let part = |v: &BufferView| {
            let [start, length] = v.in_chunk();
            range(start, length)
        };
        let parts = doc.buffer_views.iter().map(part).collect();
        let stated = doc.buffers.first().map_or(0, |b| b.byte_length);
        if let Some(message) = gaps(parts, &[4, 8], stated, |gap| bin.get(gap)) {
            found.push(("/buffers/0".into(), message));
        } else if stated != bin.len() as u64 {
            let message = format!("found {stated} bytes, the BIN chunk has {}", bin.len());
            found.push(("/buffers/0".into(), message));
        }
    }

    /// The elements of each view that accessors use follow one another.
    fn views(&self, found: &mut Found) {
        let doc = &self.document;
        let mut parts: Vec<Vec<Range<u64>>> = vec![Vec::new(); doc.buffer_views.len()];
        for a in &doc.accessors {
            let view = a
                .buffer_view
                .and_then(|v| Some((doc.buffer_views.get(v)?, v)));
            let Some((view, at)) = view else {
                continue;
            };
            let one = view.byte_stride.unwrap_or(match a.component_type {
                UNSIGNED_SHORT => 2,
                _ => 4,
            });
            parts[at].push(range(a.byte_offset, a.count.saturating_mul(one)));
        }
        for (i, (view, parts)) in doc.buffer_views.iter().zip(parts).enumerate() {
            // rows fill a column; of what is decoded nothing is padding
            let bytes = |gap: Range<usize>| {
                let start = usize::try_from(view.byte_offset).ok()?;
                let gap = start.checked_add(gap.start)?..start.checked_add(gap.end)?;
                let plain = !view.is_compressed();
                plain.then(|| self.glb.bin.get(gap)).flatten()
            };
            if !parts.is_empty()
                && let Some(message) = gaps(parts, &[4], view.byte_length, bytes)
            {
                found.push((format!("/bufferViews/{i}"), message));
            }
        }
    }

    /// The bytes at the end of compressed streams that decoders read and do not use.
    fn streams(&self, found: &mut Found) {
        for (i, view) in self.document.buffer_views.iter().enumerate() {
            let Some(stream) = &view.extensions.meshopt else {
                continue;
            };
            let start = stream.byte_offset as usize;
            let bytes = self.glb.bin.get(start..start + stream.byte_length as usize);
            if bytes.is_none_or(|bytes| self.codec.has_odd_end(bytes, stream)) {
                let message = "its stream ends in bytes that say nothing and are not as expected";
                found.push((format!("/bufferViews/{i}"), message.to_owned()));
            }
        }
    }

    /// Components that fill up an element are zeros, and zeros are positive.
    fn elements(&self, found: &mut Found) {
        for p in &self.primitives {
            let rows = match &p.pieces {
                Pieces::Merged(rows, _) => rows.get(),
                Pieces::One(_) => &[],
            };
            let (positions, normals) = (p.positions.bytes.get(), p.normals.bytes.get());
            let [filled, small] = self.codec.has_odd_filler(positions, normals);
            let rows = dispatch!(any_minus_zero(rows));
            for (odd, what) in [(filled, "positions"), (small, "normals"), (rows, "rows")] {
                if odd {
                    let message =
                        format!("{what} have bytes that are not 0 where they say nothing");
                    found.push((format!("/nodes/{}/mesh", p.node), message));
                }
            }
        }
    }
}

/// Rows of the property table.
fn rows(doc: &Document) -> usize {
    let tables = doc.extensions.structural_metadata.iter();
    let tables = tables.flat_map(|m| &m.property_tables);
    tables.map(|t| t.count as usize).max().unwrap_or(0)
}

fn range(start: u64, length: u64) -> Range<u64> {
    start..start.saturating_add(length)
}

/// Says where parts leave more room than alignment to one of `steps` asks for, overlap, or leave bytes that are not
/// zeros; the whole is as long as the last part to the next multiple of 4, or to its end if `bytes` has none.
fn gaps<'b>(
    mut parts: Vec<Range<u64>>,
    steps: &[u64],
    length: u64,
    bytes: impl Fn(Range<usize>) -> Option<&'b [u8]>,
) -> Option<String> {
    parts.sort_unstable_by_key(|p| (p.start, p.end));
    let mut end = 0u64;
    let next = |end: u64, step: u64| end.checked_next_multiple_of(step).unwrap_or(end);
    for part in parts.into_iter().chain(std::iter::once(length..length)) {
        let is_last = part == (length..length);
        let fits = match is_last {
            true => length == end || length == next(end, 4),
            false => part.start == end || steps.iter().any(|s| part.start == next(end, *s)),
        };
        if !fits {
            let message = match part.start < end {
                true => format!(
                    "bytes {} to {end} are used twice, or lie behind its end",
                    part.start
                ),
                false => format!("nothing uses bytes {end} to {}", part.start),
            };
            return Some(message);
        }
        let gap = bytes(end as usize..part.start as usize);
        let blank = part.start == end || gap.is_some_and(|gap| gap.iter().all(|b| *b == 0));
        if !blank {
            return Some(format!("bytes {end} to {} are not zeros", part.start));
        }
        end = part.end;
    }
    None
}

/// The fallback buffer of compressed views, which is the second one and no other, is as long as these, each on a
/// multiple of 4 bytes.
fn fallback(doc: &Document, found: &mut Found) {
    if doc
        .buffers
        .first()
        .is_some_and(|b| b.extensions.meshopt.is_some())
    {
        let message = "the chunk is taken for a fallback buffer, which has no bytes";
        found.push(("/buffers/0".into(), message.into()));
    }
    let Some(buffer) = doc.buffers.get(1) else {
        return;
    };
    let compressed = doc.buffer_views.iter().filter(|v| v.is_compressed());
    let mut end = 0u64;
    for view in compressed {
        if view.byte_offset != end {
            let message = format!("a view begins at byte {}, expected {end}", view.byte_offset);
            return found.push(("/buffers/1".into(), message));
        }
        // a view lies in a buffer below 4 GiB
        end = end.saturating_add(view.byte_length).next_multiple_of(4);
    }
    if buffer.byte_length != end {
        let message = format!("found {} bytes, its views have {end}", buffer.byte_length);
        found.push(("/buffers/1".into(), message));
    }
}

/// Says what is wrong with the white space of the JSON of a tile of so many nodes or rows.
fn json_padding(json: &[u8], pieces: usize) -> Option<String> {
    let used = json.iter().rposition(|b| *b == b'}').map_or(0, |at| at + 1);
    let (text, room) = json.split_at(used);
    let most = SECTOR + ROOM.saturating_mul(1 + pieces);
    if room.len() > most || room.iter().any(|b| *b != b' ') {
        return Some(format!(
            "found {} bytes behind the JSON, expected {most} blanks at most",
            room.len()
        ));
    }
    if !dispatch!(is_loose(text)) {
        return None;
    }
    let at = text.windows(2).position(is_loose).unwrap_or(0);
    Some(format!(
        "found white space between the parts of the JSON, at byte {at} of its chunk"
    ))
}

/// True if a JSON text has white space outside of strings, or an escape, which the names in tiles do not need. All
/// pairs of bytes are looked at together.
#[inline(always)]
fn is_loose(text: &[u8]) -> bool {
    // brackets and braces differ in one bit
    let structural = |b: u8| (b | 32 == b'{') | (b | 32 == b'}') | (b == b',') | (b == b':');
    let pairs = text.iter().zip(text.get(1..).unwrap_or_default());
    pairs.fold(false, |any, (&a, &b)| {
        let blank = ((a == b' ') & structural(b)) | ((b == b' ') & structural(a));
        any | blank | (a < b' ') | (a == b'\\')
    })
}
