//! The tile: one GLB per macrocube.
//!
//! # The file
//! A tile is a GLB (glTF 2.0 binary): 12 bytes of header, the JSON chunk (padded with spaces, in long
//! tiles up to a sector of the disk), the BIN chunk. All numbers in it are little endian.
//!
//! - `asset.generator` names this program; `scene` 0 has one root node, node 0, named `alvis`, the
//!   same in every tile of a set: its `matrix` is the manifest's `transform` (voxel coordinates to
//!   metres, Y up) and its children are nodes 1..n.
//! - One material, `surface`: light grey, rough, double sided.
//! - **Node layout** (up to [`MAX_NODES`] pieces): for every surface piece, that is every (cell,
//!   object) pair, a node with a mesh of its own, both of the same name: `cell_17`, or
//!   `cell_17_object_3` where a cell borders more than one object in the whole volume, or
//!   `cap_object_3` for a cap. Node i+1 has mesh i, and mesh i one primitive with three accessors of
//!   its own: POSITION (float vec3, with min and max), NORMAL (float vec3), indices (unsigned
//!   short, or unsigned int where the piece has more than 65,535 vertices). The primitive's mode is
//!   5 (strip) or 4 (list), the same in every tile of a set.
//! - The node's `extras` is a flat object of numbers: `cell`, `object`, `surface`, `triangles` (of
//!   this piece in this tile), and measures of the cell (of the whole cell, not of the piece).
//! - **Merged layout** (more than [`MAX_NODES`] pieces): one node and mesh `cells`; its primitive also
//!   has `_FEATURE_ID_0` (float), an index into the rows of an EXT_structural_metadata property
//!   table with the same columns as `extras`; the unit is in the class's own `extras`.
//! - Three buffer views: positions (stride 12), normals (stride 12), indices; merged tiles have
//!   more for the features and the table's columns.
//! - A part that was coloured has a material per colour, named `colour_rrggbb` in sRGB, or in the
//!   merged layout linear `COLOR_0` of 4 x 16 bits.
//!
//! # Encodings
//! The manifest's `encoding` says how numbers are stored; the layout is free in each. A codec for each does it.
//!
//! - `float`: as above, plain glTF 2.0 without required extensions.
//! - `quantized` (KHR_mesh_quantization): POSITION is an unsigned short vec3 (stride 8), lattice steps
//!   from a corner; nodes have that corner as `translation`, in whole voxels, and a `scale` of 1/256.
//!   It is the macrocube's lowest voxel, a voxel lower along axes where caps lie outside. NORMAL is a
//!   normalized byte vec3 (stride 4), at most 0.9 degrees off.
//! - `meshopt` (also EXT_meshopt_compression, version 0 of the codec): the same numbers in compressed
//!   views of a fallback buffer. Positions, feature ids and colours are ATTRIBUTES, normals ATTRIBUTES
//!   with the filter OCTAHEDRAL, strips INDICES, lists TRIANGLES, and all pieces' indices of one
//!   width are one view. The table is not compressed.
//!
//! Steps, corner and 1/256 are exact, so two tiles have the same bits for a vertex on their plane in
//! voxel coordinates. In metres too if the root's matrix is of powers of two; else programs that
//! round a node's whole matrix to 32 bits differ in the last one.
//!
//! Positions are voxel coordinates, multiples of 1/256 and exact in `f32`. A vertex is strictly
//! inside a lattice edge: exactly one coordinate is not a multiple of 1 (caps apart, whose vertices
//! outside the volume lie at -0.5 or n-0.5). Strips of a piece are joined by degenerate
//! triangles; triangle k of a strip is (k, k+1, k+2) for even k and (k+1, k, k+2) for odd k, and
//! winds counter-clockwise seen from the below side.
//!
//! # Reading
//! A [`Tile`](read::Tile) is the file, checked and not copied; its primitives are taken apart to pieces, each with
//! vertices of its own. Of these [`TileMesh`] is made for programs that want triangles, and what the copies of
//! `select` and `repack` start from.

mod body;
mod codec;
mod contents;
pub(crate) mod document;
mod encoded;
mod extras;
pub(crate) mod features;
mod file;
mod merged;
mod mesh;
mod padding;
mod paint;
pub(crate) mod part;
pub(crate) mod pieces;
pub mod read;
mod reader;
pub(crate) mod recode;
pub(crate) mod refused;
mod store;
mod unusual;

pub(crate) use body::{Body, Grouped, PieceRange};
pub(crate) use codec::{codec, octahedral_codes};
pub(crate) use contents::{counted_pieces, name};
pub(crate) use document::{GENERATOR, Node, TileHead, WidestNodes, material};
pub(crate) use encoded::{
    Description, Encoded, EncodedBody, EncodedLayout, FloatBody, decode, describe, encode,
    widest_description,
};
pub use extras::Extras;
pub(crate) use file::{aligned, plain_head, tile_file, tile_file_with};
pub use mesh::{SurfacePiece, TileMesh};
pub(crate) use paint::Rgb;
pub(crate) use part::{Part, PartPiece, TilePlace, part};
pub use read::PieceIds;
pub(crate) use recode::recode;
pub(crate) use refused::{check_reach, refused, too_large};
pub(crate) use store::Refused;

pub(crate) use crate::gltf::container::{head_bytes, write_head};

/// The most surface pieces that a tile keeps as nodes; with more it takes the merged layout.
/// Programs load thousands of nodes slowly: MeshLab takes 0.7 s for 500 and 30 s for 2000.
pub const MAX_NODES: usize = 500;

/// Path of a tile below the directory of its set.
pub fn tile_path([x, y, z]: [u32; 3]) -> String {
    format!("tiles/z{z:04}/y{y:04}_x{x:04}.glb")
}
