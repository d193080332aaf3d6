//! `meshopt` (EXT_meshopt_compression, version 0 of the codec): what `quantized` has, in compressed views.
//!
//! Lengths are checked before anything is decoded: no stream of the codec is shorter than 1/64 of
//! what it decodes to, no two may use the same bytes, and all of them together decode to what the
//! tile states. So a hostile file cannot ask for memory out of proportion to its size.

use super::octahedral::{Kind, decode_filter, quantize};
use super::quantized::{self, Quantized};
use super::streams;
use super::{MAX_SHIFT, Reach, TileCodec, VertexFormat};
use crate::gltf::accessors::Element;
use crate::gltf::bin_writer::{Bin, IndexList, Section, Views};
use crate::gltf::container::{Fault, ReadError, fail};
use crate::gltf::read_json::{BufferView, Compressed, Document};
use crate::grid::LATTICE;
use crate::manifest::{Encoding, Primitives};
use crate::tile::body::Body;
use crate::tile::store::Refused;
use serde_json::{Value, json};
use std::borrow::Cow;

/// What the extension is named.
pub(super) const EXTENSION: &str = "EXT_meshopt_compression";

/// The numbers of [`Quantized`], compressed; of nodes of coarser levels, in steps of a power of two.
#[derive(Debug)]
pub struct Meshopt {
    /// The power for nodes, which may reach beyond their cubes; nothing for tiles.
    coarse: Option<u32>,
}

/// Of tiles.
pub static TILES: Meshopt = Meshopt { coarse: None };

/// Of nodes, by the power.
pub static COARSE: [Meshopt; 1 + MAX_SHIFT as usize] = {
    let mut all = [const { Meshopt { coarse: None } }; 1 + MAX_SHIFT as usize];
    let mut shift = 0;
    while shift < all.len() {
        all[shift].coarse = Some(shift as u32);
        shift += 1;
    }
    all
};

impl Meshopt {
    /// The corner of what a node holds.
    fn corner(body: &Body, shift: u32) -> Result<[i32; 3], Refused> {
        let [min, max] = body.bounds();
        let base = min.map(|v| v.div_euclid(LATTICE as i32));
        let steps = |a: usize| (max[a] - base[a] * LATTICE as i32) >> shift;
        match (0..3).all(|a| steps(a) <= i32::from(u16::MAX)) {
            true => Ok(base),
            false => Err(Refused::TooWide(quantized::REACH)),
        }
    }
}

impl TileCodec for Meshopt {
    fn encoding(&self) -> Encoding {
        Encoding::Meshopt
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[quantized::EXTENSION, EXTENSION]
    }

    fn reach(&self) -> Option<Reach> {
        Quantized.reach()
    }

    fn vertices(&self) -> VertexFormat {
        Quantized.vertices()
    }

    fn shift(&self) -> u32 {
        self.coarse.unwrap_or(0)
    }

    fn base(&self, body: &Body, low: [u32; 3]) -> Result<[i32; 3], Refused> {
        match self.coarse {
            None => Quantized.base(body, low),
            Some(shift) => Self::corner(body, shift),
        }
    }

    fn encode_positions<'a>(&self, floats: &'a [[u8; 12]], base: [i32; 3]) -> Cow<'a, [u8]> {
        Cow::Owned(quantized::encode(floats, base, self.shift()))
    }

    /// Codes, of which the filter makes the vectors that [`Quantized`] stores.
    fn encode_normals<'a>(&self, floats: &'a [[u8; 12]]) -> Cow<'a, [u8]> {
        Cow::Owned(quantize(floats, Kind::Code).into_flattened())
    }

    fn decode_positions(&self, bytes: &[u8], base: [f32; 3], out: &mut [[f32; 3]]) {
        quantized::decode(bytes, base, self.shift(), out);
    }

    fn decode_normals(&self, bytes: &[u8], out: &mut [[f32; 3]]) {
        Quantized.decode_normals(bytes, out);
    }

    fn has_odd_filler(&self, positions: &[u8], normals: &[u8]) -> [bool; 2] {
        Quantized.has_odd_filler(positions, normals)
    }

    fn put_vertices(&self, bin: &mut Bin, data: &[u8], stride: usize) {
        let stream = match stride {
            4 => streams::vertices(data.as_chunks::<4>().0),
            8 => streams::vertices(data.as_chunks::<8>().0),
            _ => unreachable!("vertices of {stride} bytes"),
        };
        bin.compressed(&stream);
    }

    fn put_indices(&self, bin: &mut Bin, list: &IndexList) {
        let (indices, vertices) = (list.indices, list.vertices as usize);
        let stream = match list.kind {
            Primitives::Strips => streams::sequence(indices),
            Primitives::Triangles => {
                ::meshopt::encode_index_buffer(indices, vertices).expect("cannot fail")
            }
        };
        bin.compressed(&stream);
    }

    fn add_view(&self, views: &mut Views, part: Section, compressed: u32) {
        let (count, stride, mode) = match part {
            Section::Vertices { count, stride, .. } => (count, stride, "ATTRIBUTES"),
            Section::Indices { count, wide, kind } => {
                let mode = match kind {
                    Primitives::Strips => "INDICES",
                    Primitives::Triangles => "TRIANGLES",
                };
                (count, Element::index(wide).stride as usize, mode)
            }
            Section::Column(_) => unreachable!("columns are never compressed"),
        };
        let mut stream = json!({
            "buffer": 0, "byteOffset": views.end, "byteLength": compressed,
            "byteStride": stride, "count": count, "mode": mode
        });
        if let Section::Vertices { normals: true, .. } = part {
            stream["filter"] = FILTER.into();
        }
        let length = part.bytes() as u64;
        let view = json!({
            "buffer": 1, "byteOffset": views.fallback, "byteLength": length,
            "extensions": {EXTENSION: stream}
        });
        views.end += compressed as usize;
        views.fallback += length.next_multiple_of(4);
        views.add(part, view);
    }

    fn buffers(&self, views: &Views) -> Vec<Value> {
        let mut buffers = vec![views.chunk()];
        if views.fallback > 0 {
            buffers.push(json!({
                "byteLength": views.fallback, "extensions": {EXTENSION: {"fallback": true}}
            }));
        }
        buffers
    }

    fn decompress(&self, doc: &Document, bin: &[u8]) -> Result<Vec<Option<Vec<u8>>>, ReadError> {
        let mut budget = bin.len() as u64;
        let mut decoded = Vec::with_capacity(doc.buffer_views.len());
        for (i, view) in doc.buffer_views.iter().enumerate() {
            decoded.push(match &view.extensions.meshopt {
                None => None,
                Some(stream) => {
                    let place = format!("/bufferViews/{i}/extensions/{EXTENSION}");
                    let bytes = check(doc, bin, view, stream, &mut budget)
                        .and_then(|encoded| decode(encoded, stream))
                        .or_else(|message| fail(Fault::Compression, place, message))?;
                    Some(bytes)
                }
            });
        }
        Ok(decoded)
    }

    fn has_odd_end(&self, bytes: &[u8], stream: &Compressed) -> bool {
        !ends_plainly(bytes, stream)
    }
}

/// What normals are decoded with.
const FILTER: &str = "OCTAHEDRAL";

/// Checks a compressed view and returns its stream. `budget` is what of the BIN chunk no other
/// stream has used.
fn check<'a>(
    doc: &Document,
    bin: &'a [u8],
    view: &BufferView,
    stream: &Compressed,
    budget: &mut u64,
) -> Result<&'a [u8], String> {
    let fallback = doc.buffers.get(1);
    let fallback = fallback
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
fn decode(encoded: &[u8], stream: &Compressed) -> Result<Vec<u8>, String> {
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
        ("ATTRIBUTES", _) if ::meshopt::decode_vertex_version(encoded) != Some(0) => None,
        ("ATTRIBUTES", 4) => ::meshopt::decode_vertex_buffer::<[u8; 4]>(encoded, count)
            .ok()
            .map(Vec::into_flattened),
        ("ATTRIBUTES", _) => ::meshopt::decode_vertex_buffer::<[u8; 8]>(encoded, count)
            .ok()
            .map(Vec::into_flattened),
        ("TRIANGLES", 2) => narrow(::meshopt::decode_index_buffer(encoded, count).ok()),
        ("TRIANGLES", _) => wide(::meshopt::decode_index_buffer(encoded, count).ok()),
        (_, 2) => narrow(::meshopt::decode_index_sequence(encoded, count).ok()),
        _ => wide(::meshopt::decode_index_sequence(encoded, count).ok()),
    };
    let Some(mut bytes) = made else {
        return Err(format!(
            "found {length} bytes that are no stream of {count} elements in mode {}",
            stream.mode
        ));
    };
    if filter == "OCTAHEDRAL" {
        bytes
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .for_each(decode_filter);
    }
    Ok(bytes)
}

fn narrow(indices: Option<Vec<u16>>) -> Option<Vec<u8>> {
    Some(indices?.iter().flat_map(|i| i.to_le_bytes()).collect())
}

fn wide(indices: Option<Vec<u32>>) -> Option<Vec<u8>> {
    Some(indices?.iter().flat_map(|i| i.to_le_bytes()).collect())
}

/// True if a stream ends as encoders have it: vertices with the first one behind zeros, 32 bytes
/// in all, indices with 4 zeros, and triangles with the table of 16 bytes that the encoder has.
fn ends_plainly(bytes: &[u8], stream: &Compressed) -> bool {
    const TABLE: [u8; 16] = *b"\x00\x76\x87\x56\x67\x78\xa9\x86\x65\x89\x68\x98\x01\x69\0\0";
    let zeros = |end: Option<&[u8]>| end.is_some_and(|end| end.iter().all(|b| *b == 0));
    match stream.mode.as_str() {
        "ATTRIBUTES" => {
            let filler = 32usize.saturating_sub(stream.byte_stride as usize);
            zeros(bytes.last_chunk::<32>().map(|end| &end[..filler]))
        }
        "INDICES" => zeros(bytes.last_chunk::<4>().map(|end| &end[..])),
        _ => bytes.ends_with(&TABLE),
    }
}
