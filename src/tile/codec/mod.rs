//! Encodings of tiles: how each stores positions, normals and indices, a file for each. Whatever else writes or reads
//! tiles asks a [`TileCodec`], once for a tile, a piece or a part of the BIN chunk.

mod float;
mod meshopt;
mod octahedral;
mod quantized;
mod streams;
#[cfg(test)]
mod tests;
mod vertices;

pub use float::any_minus_zero;
pub use octahedral::octahedral_codes;
pub use vertices::{Normals, Positions};

use super::body::Body;
use super::store::Refused;
use crate::gltf::accessors::Element;
use crate::gltf::bin_writer::{Bin, IndexList, Section, Views};
use crate::gltf::container::{Fault, ReadError, fail};
use crate::gltf::read_json::{Compressed, Document};
use crate::manifest::Encoding;
use serde_json::Value;
use std::borrow::Cow;
use std::fmt::Debug;

/// An encoding of tiles.
///
/// Before it is encoded, geometry is floats: positions in voxels and unit normals, three little-endian floats each.
/// What is not said here is the same in every encoding.
pub trait TileCodec: Debug + Sync {
    /// Its name in the index.
    fn encoding(&self) -> Encoding;

    /// The extensions of glTF that a reader has to know, in the order of the file.
    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    /// How far vertices may lie from their macrocube's corner; without limit if there is none.
    fn reach(&self) -> Option<Reach> {
        None
    }

    /// Positions are multiples of 2 to this power of lattice steps: more than 0 where a file covers more than 16 bits of
    /// them reach.
    fn shift(&self) -> u32 {
        0
    }

    /// True if positions and normals stay the floats that they were.
    fn keeps_floats(&self) -> bool {
        false
    }

    /// Bytes of buffers for each triangle of a tile while it is encoded.
    fn bytes_per_triangle(&self) -> u64 {
        // for half a vertex, and up to 1.5 index entries, parts of the BIN chunk before they are compressed and after
        30
    }

    /// How vertices are stored.
    fn vertices(&self) -> VertexFormat;

    /// The corner in whole voxels that positions count from, of a tile whose macrocube has its lowest voxel at `low`.
    ///
    /// # Errors
    /// [`Refused::TooWide`] if vertices lie further from it than the encoding reaches.
    fn base(&self, _: &Body, _low: [u32; 3]) -> Result<[i32; 3], Refused> {
        Ok([0; 3])
    }

    /// Positions as they are stored.
    fn encode_positions<'a>(&self, floats: &'a [[u8; 12]], base: [i32; 3]) -> Cow<'a, [u8]>;

    /// Normals as they are stored, before they are compressed.
    fn encode_normals<'a>(&self, floats: &'a [[u8; 12]]) -> Cow<'a, [u8]>;

    /// Positions in voxels, as many as `out` has room for.
    fn decode_positions(&self, bytes: &[u8], base: [f32; 3], out: &mut [[f32; 3]]);

    /// Normals, as many as `out` has room for.
    fn decode_normals(&self, bytes: &[u8], out: &mut [[f32; 3]]);

    /// True for positions, and for normals, if some of their bits say nothing and are not as they are written.
    fn has_odd_filler(&self, positions: &[u8], normals: &[u8]) -> [bool; 2];

    /// Adds vertex data to a chunk, so many bytes to a vertex.
    fn put_vertices(&self, bin: &mut Bin, data: &[u8], _stride: usize) {
        bin.plain(data);
    }

    /// Adds indices to a chunk.
    fn put_indices(&self, bin: &mut Bin, list: &IndexList) {
        bin.plain_indices(list);
    }

    /// Adds the view of vertices or indices, which take so many bytes of the chunk if they are compressed.
    fn add_view(&self, views: &mut Views, part: Section, _compressed: u32) {
        views.plain(part);
    }

    /// The list of buffers that views are in, the chunk first.
    fn buffers(&self, views: &Views) -> Vec<Value> {
        vec![views.chunk()]
    }

    /// What the views of a tile that are compressed decode to, by their numbers; nothing for the others.
    ///
    /// # Errors
    /// [`Fault::Compression`] if one cannot be what it says.
    fn decompress(&self, _: &Document, _bin: &[u8]) -> Result<Vec<Option<Vec<u8>>>, ReadError> {
        Ok(Vec::new())
    }

    /// True if a compressed view ends in bytes that decoders do not use, and that are not as they are written.
    fn has_odd_end(&self, _stream: &[u8], _: &Compressed) -> bool {
        false
    }
}

/// How vertices are stored.
#[derive(Debug, Clone, Copy)]
pub struct VertexFormat {
    /// Of positions.
    pub position: Element,
    /// Of normals.
    pub normal: Element,
    /// Positions are lattice steps from a corner in whole voxels, which nodes have as translation; else they are voxel
    /// coordinates, and nodes have no transform.
    pub steps: bool,
    /// Normals are rounded, so that their lengths are 1 up to 0.7 %.
    pub rounded: bool,
}

/// How far the vertices of a tile may lie from the corner of its macrocube.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reach {
    /// Cubes along each axis of a macrocube.
    pub cubes: u32,
    /// Bits of a position's component, in lattice steps.
    pub bits: u32,
}

impl Reach {
    /// Lattice steps.
    pub fn steps(&self) -> u32 {
        (1 << self.bits) - 1
    }
}

/// All encodings.
pub const CODECS: [&dyn TileCodec; 3] = [&float::Float, &quantized::Quantized, &meshopt::TILES];

/// The codec of an encoding.
pub fn codec(encoding: Encoding) -> &'static dyn TileCodec {
    match encoding {
        Encoding::Float => &float::Float,
        Encoding::Quantized => &quantized::Quantized,
        Encoding::Meshopt => &meshopt::TILES,
    }
}

/// The codec of the nodes of coarser levels whose positions are multiples of 2^`shift` lattice steps; `None` above
/// [`MAX_SHIFT`].
pub fn coarse(shift: u32) -> Option<&'static dyn TileCodec> {
    let codec = meshopt::COARSE.get(shift as usize)?;
    Some(codec)
}

/// A step of a whole voxel, the largest in which all that lies on faces of volumes can be told.
pub const MAX_SHIFT: u32 = 8;

/// The one of some codecs that a tile's required extensions are those of.
///
/// # Errors
/// [`Fault::Structure`] if it is none of them, or a view is compressed in spite of it.
pub(super) fn codec_of(
    doc: &Document,
    codecs: &[&'static dyn TileCodec],
) -> Result<&'static dyn TileCodec, ReadError> {
    let sorted = |mut names: Vec<&'static str>| {
        names.sort_unstable();
        names
    };
    let names = |codec: &&'static dyn TileCodec| sorted(codec.extensions().to_vec());
    let mut required: Vec<&str> = doc.extensions_required.iter().map(String::as_str).collect();
    required.sort_unstable();
    let Some(codec) = codecs.iter().find(|codec| names(codec) == required) else {
        let known: Vec<_> = codecs.iter().map(names).collect();
        let message = format!("found {required:?}, expected one of {known:?}");
        return fail(Fault::Structure, "/extensionsRequired", message);
    };
    let compressed = doc.buffer_views.iter().position(|v| v.is_compressed());
    match compressed.filter(|_| !required.contains(&meshopt::EXTENSION)) {
        Some(view) => fail(
            Fault::Structure,
            format!("/bufferViews/{view}"),
            format!(
                "it is compressed, and {} is not required",
                meshopt::EXTENSION
            ),
        ),
        None => Ok(*codec),
    }
}
