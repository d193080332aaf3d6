//! A tile's geometry in the form of its set, without what its nodes say: so it can be written before that is known.

use super::body::{Body, append_indices, is_wide};
use super::document::{Node, TileHead, WidestNodes, node_document, node_json};
use super::merged::{merged_document, widest_merged};
use super::store::{Refused, Stored};
use crate::gltf::accessors::Element;
use crate::gltf::bin_writer::{Bin, IndexList, Section, Views};
use bytemuck::{Pod, Zeroable};
use std::borrow::Cow;

/// Pieces whose geometry is floats.
#[derive(Clone, Copy)]
pub struct FloatBody<'a> {
    /// The pieces.
    pub body: &'a Body,
    /// The body's bytes.
    pub bytes: &'a [u8],
}

/// Pieces whose geometry is encoded.
#[derive(Clone, Copy)]
pub struct EncodedBody<'a> {
    /// The pieces as they were before.
    pub body: &'a Body,
    /// How they were encoded.
    pub layout: &'a EncodedLayout,
}

/// What is written of a tile besides its geometry.
#[derive(Debug)]
pub struct Description {
    /// The JSON, without padding.
    pub json: Vec<u8>,
    /// What comes behind the geometry in the BIN chunk: in merged layout the table.
    pub table: Vec<u8>,
}

/// Parts of a BIN chunk that can be compressed, at most: positions, normals, indices, and rows and colours or
/// other indices.
const PARTS: usize = 5;

/// What a reader has to be told of encoded geometry besides its body.
#[repr(C)]
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct EncodedLayout {
    /// Bytes of each compressed part, in order.
    lengths: [u32; PARTS],
    /// Index entries of the tile.
    pub indices: u32,
}

/// Encoded geometry.
#[derive(Debug)]
pub struct Encoded<'a> {
    /// The beginning of the BIN chunk, or all of it.
    pub bytes: Cow<'a, [u8]>,
    /// What tells its parts.
    pub layout: EncodedLayout,
}

/// Encodes pieces of a tile whose macrocube has its lowest voxel at `low`. In a plain tile they stay as they are. The
/// pieces have `colours` if all have one, which the merged layout stores with the vertices.
///
/// # Errors
/// [`Refused::TooWide`] if the vertices reach too far for the encoding.
pub fn encode<'a>(
    head: &TileHead,
    low: [u32; 3],
    floats: FloatBody<'a>,
    colours: Option<&[[u8; 8]]>,
) -> Result<Encoded<'a>, Refused> {
    let FloatBody { body, bytes } = floats;
    let of_pieces = || body.pieces.iter().map(|p| p.indices).sum();
    if head.is_plain(body.pieces.len()) {
        let layout = EncodedLayout {
            indices: of_pieces(),
            ..EncodedLayout::default()
        };
        let bytes = Cow::Borrowed(bytes);
        return Ok(Encoded { bytes, layout });
    }
    let mut bin = Bin::default();
    floats.put_vertices(&mut bin, head, low)?;
    let indices = if head.merges(body.pieces.len()) {
        let indices = floats.put_joined(&mut bin, head);
        let row = |i: usize| (i as f32).to_le_bytes();
        put_per_vertex(&mut bin, head, body, row);
        if let Some(colours) = colours {
            put_per_vertex(&mut bin, head, body, |i| colours[i]);
        }
        // what comes behind is no part of the geometry
        bin.pad(8);
        indices
    } else {
        floats.put_pieces(&mut bin, head);
        bin.pad(4);
        of_pieces()
    };
    let mut lengths = [0; PARTS];
    lengths[..bin.lengths.len()].copy_from_slice(&bin.lengths);
    Ok(Encoded {
        bytes: Cow::Owned(bin.bytes),
        layout: EncodedLayout { lengths, indices },
    })
}

/// Bytes of the JSON of a tile with this geometry at most, whatever its nodes, the widest of which take `nodes` in
/// its set.
///
/// # Errors
/// [`Refused::TooWide`].
pub fn widest_description(
    nodes: &WidestNodes,
    low: [u32; 3],
    encoded: EncodedBody,
) -> Result<usize, Refused> {
    let (head, body) = (&nodes.head, encoded.body);
    if head.is_plain(body.pieces.len()) {
        return Ok(nodes.room(&Stored::plain(head.codec, body), body));
    }
    if head.merges(body.pieces.len()) {
        return widest_merged(head, low, encoded);
    }
    Ok(nodes.room(&Stored::encoded(head, low, encoded)?, body))
}

/// What is written of a tile with this geometry.
///
/// # Errors
/// [`Refused::TooWide`].
pub fn describe(
    head: &TileHead,
    low: [u32; 3],
    encoded: EncodedBody,
    nodes: &[Node],
) -> Result<Description, Refused> {
    let alone = |json| Description {
        json,
        table: Vec::new(),
    };
    if head.is_plain(nodes.len()) {
        return Ok(alone(node_json(head, encoded.body, nodes)));
    }
    if head.merges(nodes.len()) {
        return merged_document(head, low, encoded, nodes);
    }
    let stored = Stored::encoded(head, low, encoded)?;
    Ok(alone(node_document(head, &stored, encoded.body, nodes)))
}

/// Adds what is the same of each vertex of a piece.
fn put_per_vertex<const N: usize>(
    bin: &mut Bin,
    head: &TileHead,
    body: &Body,
    of_piece: impl Fn(usize) -> [u8; N],
) {
    let pieces = body.pieces.iter().enumerate();
    let all: Vec<[u8; N]> = pieces
        .flat_map(|(i, p)| std::iter::repeat_n(of_piece(i), p.vertices as usize))
        .collect();
    head.codec.put_vertices(bin, all.as_flattened(), N);
}

impl EncodedLayout {
    /// The views of the geometry. Merged, these are of positions, normals, indices, rows, and colours if it is
    /// `painted`; else of positions, normals, and indices of either width that there are.
    pub(super) fn views(&self, head: &TileHead, body: &Body, painted: bool) -> Views {
        let vertices = |element: Element, normals| Section::Vertices {
            count: body.vertices as usize,
            stride: element.stride as usize,
            normals,
        };
        let indices = |count, wide| Section::Indices {
            count,
            wide,
            kind: head.form.primitives,
        };
        let format = head.codec.vertices();
        let mut parts = vec![
            vertices(format.position, false),
            vertices(format.normal, true),
        ];
        if head.merges(body.pieces.len()) {
            parts.push(indices(self.indices as usize, is_wide(body.vertices)));
            parts.push(vertices(Element::FLOAT, false));
            parts.extend(painted.then(|| vertices(Element::COLOUR, false)));
        } else {
            let count = |wide| {
                let of_width = body.pieces.iter().filter(move |p| p.wide() == wide);
                of_width.map(|p| p.indices as usize).sum()
            };
            let both = [false, true].map(|wide| indices(count(wide), wide));
            parts.extend(both.into_iter().filter(|part| part.bytes() > 0));
        }
        let mut views = Views::default();
        for (part, &length) in parts.into_iter().zip(&self.lengths) {
            head.codec.add_view(&mut views, part, length);
        }
        views
    }
}

impl FloatBody<'_> {
    /// Adds positions and normals to a chunk.
    ///
    /// # Errors
    /// [`Refused::TooWide`].
    fn put_vertices(&self, bin: &mut Bin, head: &TileHead, low: [u32; 3]) -> Result<(), Refused> {
        let n = 12 * self.body.vertices as usize;
        let (positions, _) = self.bytes[..n].as_chunks::<12>();
        let (normals, _) = self.bytes[n..2 * n].as_chunks::<12>();
        let (codec, format) = (head.codec, head.codec.vertices());
        let base = codec.base(self.body, low)?;
        let positions = codec.encode_positions(positions, base);
        codec.put_vertices(bin, &positions, format.position.stride as usize);
        drop(positions);
        let normals = codec.encode_normals(normals);
        codec.put_vertices(bin, &normals, format.normal.stride as usize);
        Ok(())
    }

    /// Adds the indices of all pieces, those of either width together.
    fn put_pieces(&self, bin: &mut Bin, head: &TileHead) {
        let most = self.body.pieces.iter().map(|p| p.vertices).max();
        for wide in [false, true] {
            let of_width = || self.body.pieces.iter().filter(|p| p.wide() == wide);
            let count = of_width().map(|p| p.indices as usize).sum();
            let mut indices = Vec::with_capacity(count);
            of_width().for_each(|p| indices.extend(self.body.indices(p, self.bytes)));
            if !indices.is_empty() {
                let list = IndexList {
                    indices: &indices,
                    wide,
                    kind: head.form.primitives,
                    vertices: most.unwrap_or(0),
                };
                head.codec.put_indices(bin, &list);
            }
        }
    }

    /// Adds the indices of all pieces as one list or stitched strip over the tile's vertices; returns their number.
    fn put_joined(&self, bin: &mut Bin, head: &TileHead) -> u32 {
        let FloatBody { body, bytes } = *self;
        let joints = 3 * body.pieces.len();
        let count = body
            .pieces
            .iter()
            .map(|p| p.indices as usize)
            .sum::<usize>();
        let mut all = Vec::with_capacity(count + joints);
        for piece in &body.pieces {
            let part = body.indices(piece, bytes);
            append_indices(&mut all, &part, piece.first_vertex, head.form.primitives);
        }
        let list = IndexList {
            indices: &all,
            wide: is_wide(body.vertices),
            kind: head.form.primitives,
            vertices: body.vertices,
        };
        head.codec.put_indices(bin, &list);
        all.len() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{Encoding, Form, Layout, Primitives};
    use crate::strip::append_strip;
    use crate::tile::codec::{CODECS, codec};
    use crate::tile::contents::Contents;
    use crate::tile::pieces::Piece;
    use crate::tile::{PieceIds, name, tile_file};
    use proptest::prelude::*;

    type Vertex = ([i32; 3], [f32; 3]);

    /// Vertices on the lattice of a macrocube, and triangles of three of them each.
    fn pieces() -> impl Strategy<Value = Vec<(Vec<Vertex>, Vec<[u32; 3]>)>> {
        let vertex = (
            prop::array::uniform3(0..=64 * 256i32),
            prop::array::uniform3(-1.0f32..1.0),
        );
        let piece = prop::collection::vec(vertex, 3..40).prop_flat_map(|vertices| {
            let n = vertices.len() as u32;
            let corners = (0..n, 1..n, 1..n).prop_filter("three", |(_, b, c)| b != c);
            let triangle = corners.prop_map(move |(a, b, c)| [a, (a + b) % n, (a + c) % n]);
            (Just(vertices), prop::collection::vec(triangle, 1..60))
        });
        prop::collection::vec(piece, 1..8)
    }

    fn contents(pieces: &[(Vec<Vertex>, Vec<[u32; 3]>)], kind: Primitives) -> Contents {
        let piece = |(i, (vertices, triangles)): (u64, &(Vec<Vertex>, Vec<[u32; 3]>))| {
            let mut indices = Vec::new();
            for triangle in triangles {
                match kind {
                    Primitives::Strips => append_strip(&mut indices, triangle, 0),
                    Primitives::Triangles => indices.extend(triangle),
                }
            }
            let unit = |n: [f32; 3]| {
                let length = n.iter().map(|c| c * c).sum::<f32>().sqrt();
                n.map(|c| c / length)
            };
            Piece {
                ids: PieceIds {
                    cell: i,
                    object: 1,
                    surface: i,
                    triangles: triangles.len() as u64,
                },
                name: name(i, 1, false),
                colour: None,
                positions: vertices
                    .iter()
                    .map(|(p, _)| p.map(crate::grid::coordinate))
                    .collect(),
                normals: vertices.iter().map(|&(_, n)| unit(n)).collect(),
                indices,
            }
        };
        let pieces: Vec<Piece> = (1..).zip(pieces).map(piece).collect();
        Contents::of_pieces(codec(Encoding::default()), pieces)
    }

    fn forms() -> impl Iterator<Item = Form> {
        let primitives = [Primitives::Strips, Primitives::Triangles];
        let encodings = CODECS.map(|codec| codec.encoding());
        let layouts = [Layout::Nodes, Layout::Merged];
        let all = primitives.into_iter().flat_map(move |primitives| {
            encodings.into_iter().flat_map(move |encoding| {
                layouts.into_iter().map(move |layout| Form {
                    primitives,
                    encoding,
                    layout,
                })
            })
        });
        all.filter(|form| !codec(form.encoding).keeps_floats() || form.layout == Layout::Merged)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        /// Encoded geometry is the tile's own, and has room for any description.
        #[test]
        fn what_is_encoded_before_nodes_are_known_is_the_tile(pieces in pieces(), caps in any::<bool>()) {
            let low = [u32::from(caps); 3];
            for form in forms() {
                let contents = contents(&pieces, form.primitives);
                let (body, bytes) = contents.body().unwrap();
                let head = TileHead::new(contents.matrix, form);
                let floats = FloatBody { body: &body, bytes: &bytes };
                let encoded = encode(&head, low, floats, None).unwrap();
                let what = EncodedBody { body: &body, layout: &encoded.layout };
                let file = tile_file(&head, low, floats, &contents.nodes).unwrap();
                let Description { json, table } = describe(&head, low, what, &contents.nodes).unwrap();
                prop_assert!([&encoded.bytes[..], &table].concat() == *file.bin);
                prop_assert_eq!(file.indices, u64::from(encoded.layout.indices));
                prop_assert!(file.head[20..].starts_with(&json));
                let widest = widest_description(&WidestNodes::new(&head), low, what).unwrap();
                let nodes = vec![Node::widest(); body.pieces.len()];
                let long = describe(&head, low, what, &nodes).unwrap().json.len();
                prop_assert!(json.len() <= long && long <= widest, "{} {long} {widest}", json.len());
            }
        }
    }

    #[test]
    fn vertices_out_of_reach_are_refused() {
        let far = vec![
            ([0; 3], [1.0; 3]),
            ([256 * 256, 0, 0], [1.0; 3]),
            ([0, 1, 0], [1.0; 3]),
        ];
        let contents = contents(&[(far, vec![[0, 1, 2]])], Primitives::Strips);
        let (body, bytes) = contents.body().unwrap();
        for form in forms() {
            let head = TileHead::new(contents.matrix, form);
            let floats = FloatBody {
                body: &body,
                bytes: &bytes,
            };
            let encoded = encode(&head, [0; 3], floats, None);
            match head.codec.reach() {
                None => assert!(encoded.is_ok()),
                Some(reach) => assert_eq!(encoded.unwrap_err(), Refused::TooWide(reach)),
            }
        }
    }
}
