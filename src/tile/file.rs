//! A whole tile in any encoding and layout, from pieces whose geometry is floats.

use super::document::{Node, TileHead};
use super::encoded::{Description, EncodedBody, FloatBody, describe, encode};
use super::merged::colours;
use super::store::Refused;
use crate::gltf::container::write_head;
use std::borrow::Cow;

/// A tile's file.
#[derive(Debug)]
pub struct TileFile<'a> {
    /// What comes before the BIN chunk's data.
    pub head: Vec<u8>,
    /// That data.
    pub bin: Cow<'a, [u8]>,
    /// Index entries in it.
    pub indices: u64,
}

impl TileFile<'_> {
    /// Its bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        let mut bytes = self.head;
        bytes.extend_from_slice(&self.bin);
        bytes
    }
}

/// Writes the file of a tile whose macrocube has its lowest voxel at `low`, with a node for each piece.
///
/// # Errors
/// [`Refused`] if the file would be too large or the vertices reach too far for the encoding.
pub fn tile_file<'a>(
    head: &TileHead,
    low: [u32; 3],
    floats: FloatBody<'a>,
    nodes: &[Node],
) -> Result<TileFile<'a>, Refused> {
    let colours = colours(nodes);
    let encoded = encode(head, low, floats, colours.as_deref())?;
    let (mut bin, layout) = (encoded.bytes, encoded.layout);
    let body = EncodedBody {
        body: floats.body,
        layout: &layout,
    };
    let Description { json, table } = describe(head, low, body, nodes)?;
    if !table.is_empty() {
        bin.to_mut().extend_from_slice(&table);
    }
    let head =
        write_head(&json, aligned(json.len(), 8), bin.len() as u64).ok_or(Refused::TooLarge)?;
    let indices = layout.indices.into();
    Ok(TileFile { head, bin, indices })
}

/// The next length of a JSON chunk that puts the BIN chunk's data on a multiple of `step` bytes, in turn
/// one of 8, which EXT_structural_metadata asks for.
pub fn aligned(json_bytes: usize, step: usize) -> usize {
    debug_assert!(step.is_multiple_of(8));
    (json_bytes + 28).next_multiple_of(step) - 28
}
