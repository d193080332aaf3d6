//! A tile's geometry in the form of its set, without what hangs on ids: so it can be written before these are known.

use super::Extras;
use super::body::{Body, PieceRange, append_indices, is_wide};
use super::contents::{Contents, name};
use super::document::{Node, TileHead, WidestNodes, node_document, node_json, write_head};
use super::file::aligned;
use super::merged::{merged_document, widest_merged};
use super::part::refuse;
use super::store::{Geometry, Refused, Stored};
use crate::gltf::bin_writer::{Bin, Section, Views};
use crate::gltf::container::ReadError;
use crate::manifest::{Encoding, Primitives};
use bytemuck::{Pod, Zeroable};
use std::borrow::Cow;

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
    pub recipe: EncodedLayout,
}

/// Encodes pieces whose geometry is floats: `body` and its `bytes`, of a tile whose macrocube has its lowest voxel at
/// `low`. In a plain tile they stay as they are. The pieces have `colours` if all have one, which the merged layout
/// stores with the vertices.
///
/// # Errors
/// [`Refused::TooWide`] if the vertices reach too far for the encoding.
pub fn encode<'a>(
    head: &TileHead,
    low: [u32; 3],
    (body, bytes): (&Body, &'a [u8]),
    colours: Option<&[[u8; 8]]>,
) -> Result<Encoded<'a>, Refused> {
    let of_pieces = || body.pieces.iter().map(|p| p.indices).sum();
    if head.is_plain(body.pieces.len()) {
        let recipe = EncodedLayout {
            indices: of_pieces(),
            ..EncodedLayout::default()
        };
        let bytes = Cow::Borrowed(bytes);
        return Ok(Encoded { bytes, recipe });
    }
    let encoding = head.form.encoding;
    let geometry = Geometry { body, bytes };
    let mut bin = Bin::new(encoding == Encoding::Meshopt);
    geometry.put_vertices(&mut bin, encoding, low)?;
    let indices = if head.merges(body.pieces.len()) {
        let indices = geometry.put_joined(&mut bin, head.form.primitives);
        let row = |i: usize| (i as f32).to_le_bytes();
        bin.vertices(&per_vertex(body, row));
        if let Some(colours) = colours {
            bin.vertices(&per_vertex(body, |i| colours[i]));
        }
        // what comes behind is no part of the geometry
        bin.pad(8);
        indices
    } else {
        geometry.put_pieces(&mut bin, head.form.primitives);
        bin.pad(4);
        of_pieces()
    };
    let mut lengths = [0; PARTS];
    lengths[..bin.lengths.len()].copy_from_slice(&bin.lengths);
    Ok(Encoded {
        bytes: Cow::Owned(bin.bytes),
        recipe: EncodedLayout { lengths, indices },
    })
}

/// Bytes of the JSON of a tile with this geometry at most, whatever its nodes, the widest of which take `nodes` in
/// its set.
///
/// # Errors
/// [`Refused::TooWide`].
pub fn widest_description(
    (head, nodes): (&TileHead, &WidestNodes),
    low: [u32; 3],
    (body, recipe): (&Body, &EncodedLayout),
) -> Result<usize, Refused> {
    if head.is_plain(body.pieces.len()) {
        return Ok(nodes.room(&Stored::float(body), body));
    }
    if head.merges(body.pieces.len()) {
        return widest_merged(head, low, (body, recipe));
    }
    let stored = Stored::encoded(head, low, body, recipe)?;
    Ok(nodes.room(&stored, body))
}

/// The JSON of a tile with this geometry, without padding, and what comes behind the geometry in the BIN chunk: in
/// merged layout the table.
///
/// # Errors
/// [`Refused::TooWide`].
pub fn describe(
    head: &TileHead,
    low: [u32; 3],
    (body, recipe): (&Body, &EncodedLayout),
    nodes: &[Node],
) -> Result<(Vec<u8>, Vec<u8>), Refused> {
    if head.is_plain(nodes.len()) {
        return Ok((node_json(head, body, nodes), Vec::new()));
    }
    if head.merges(nodes.len()) {
        return merged_document(head, low, (body, recipe), nodes);
    }
    let stored = Stored::encoded(head, low, body, recipe)?;
    Ok((node_document(head, &stored, body, nodes), Vec::new()))
}

/// The pieces as floats again, of the bytes that [`encode`] has made of them: the same positions and triangles, and
/// normals as they were rounded.
///
/// # Errors
/// [`ReadError`] if these are others.
pub fn decode<'a>(
    head: &TileHead,
    low: [u32; 3],
    (body, recipe): (&Body, &EncodedLayout),
    bytes: &'a [u8],
) -> Result<(Body, Cow<'a, [u8]>), ReadError> {
    if head.is_plain(body.pieces.len()) {
        return Ok((body.clone(), Cow::Borrowed(bytes)));
    }
    // as a tile whose pieces have any ids
    let node = |(i, piece): (u64, &PieceRange)| Node {
        name: name(i, i, true),
        extras: Extras::ids(i, i, i, piece.triangles.into()),
        colour: None,
    };
    let nodes: Vec<Node> = (1..).zip(&body.pieces).map(node).collect();
    let file = describe(head, low, (body, recipe), &nodes).and_then(|(json, table)| {
        let bin = (bytes.len() + table.len()) as u64;
        let file = write_head(&json, aligned(json.len(), 8), bin).ok_or(Refused::TooLarge)?;
        Ok([&file[..], bytes, &table].concat())
    });
    let file = file.or_else(refuse)?;
    let contents = Contents::read(&file, head.form.primitives, &|_| false)?;
    drop(file);
    let (mut decoded, bytes) = contents.body()?;
    for (piece, was) in decoded.pieces.iter_mut().zip(&body.pieces) {
        piece.strips = was.strips;
    }
    Ok((decoded, Cow::Owned(bytes)))
}

/// The same of each vertex of a piece.
fn per_vertex<const N: usize>(body: &Body, of_piece: impl Fn(usize) -> [u8; N]) -> Vec<[u8; N]> {
    let pieces = body.pieces.iter().enumerate();
    pieces
        .flat_map(|(i, p)| std::iter::repeat_n(of_piece(i), p.vertices as usize))
        .collect()
}

impl EncodedLayout {
    /// The views of the geometry. Merged, these are of positions, normals, indices, rows, and colours if it is
    /// `painted`; else of positions, normals, and indices of either width that there are.
    pub(super) fn views(&self, head: &TileHead, body: &Body, painted: bool) -> Views {
        let encoding = head.form.encoding;
        let vertices = |stride, filter| Section::Vertices {
            count: body.vertices as usize,
            stride,
            filter,
        };
        let indices = |count, wide| Section::Indices {
            count,
            wide,
            kind: head.form.primitives,
        };
        let [position, normal] = match encoding {
            Encoding::Float => [12, 12],
            Encoding::Quantized | Encoding::Meshopt => [8, 4],
        };
        let mut parts = vec![
            vertices(position, None),
            vertices(normal, Some("OCTAHEDRAL")),
        ];
        if head.merges(body.pieces.len()) {
            parts.push(indices(self.indices as usize, is_wide(body.vertices)));
            parts.push(vertices(4, None));
            parts.extend(painted.then(|| vertices(8, None)));
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
            views.add(part, (encoding == Encoding::Meshopt).then_some(length));
        }
        views
    }
}

impl Geometry<'_> {
    /// Adds the indices of all pieces, those of either width together.
    fn put_pieces(&self, bin: &mut Bin, primitives: Primitives) {
        let most = self.body.pieces.iter().map(|p| p.vertices).max();
        for wide in [false, true] {
            let of_width = || self.body.pieces.iter().filter(|p| p.wide() == wide);
            let count = of_width().map(|p| p.indices as usize).sum();
            let mut indices = Vec::with_capacity(count);
            of_width().for_each(|p| indices.extend(self.body.indices(p, self.bytes)));
            if !indices.is_empty() {
                bin.indices(&indices, wide, primitives, most.unwrap_or(0));
            }
        }
    }

    /// Adds the indices of all pieces as one list or stitched strip over the tile's vertices; returns their number.
    fn put_joined(&self, bin: &mut Bin, primitives: Primitives) -> u32 {
        let Geometry { body, bytes } = *self;
        let joints = 3 * body.pieces.len();
        let count = body
            .pieces
            .iter()
            .map(|p| p.indices as usize)
            .sum::<usize>();
        let mut all = Vec::with_capacity(count + joints);
        for piece in &body.pieces {
            let part = body.indices(piece, bytes);
            append_indices(&mut all, &part, piece.first_vertex, primitives);
        }
        bin.indices(&all, is_wide(body.vertices), primitives, body.vertices);
        all.len() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{Form, Layout};
    use crate::strip::append_strip;
    use crate::tile::pieces::Piece;
    use crate::tile::{PieceIds, tile_file};
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
        let node = |p: &Piece| Node {
            name: p.name.clone(),
            extras: Extras::ids(p.ids.cell, p.ids.object, p.ids.surface, p.ids.triangles),
            colour: None,
        };
        Contents {
            matrix: [1.0; 16],
            encoding: Encoding::Float,
            merged: false,
            nodes: pieces.iter().map(node).collect(),
            pieces,
        }
    }

    /// The triangles of each piece, each from its smallest corner on.
    fn triangles(body: &Body, bytes: &[u8], kind: Primitives) -> Vec<Vec<[u32; 3]>> {
        let of = |piece: &PieceRange| {
            let indices = body.indices(piece, bytes);
            let mut all = Vec::new();
            let mut add = |t: [u32; 3]| {
                let smallest = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
                all.push(std::array::from_fn(|i| t[(smallest + i) % 3]));
            };
            match kind {
                Primitives::Triangles => indices.as_chunks().0.iter().for_each(|&t| add(t)),
                Primitives::Strips => {
                    for (k, w) in indices.windows(3).enumerate() {
                        if w[0] != w[1] && w[1] != w[2] && w[0] != w[2] {
                            add([w[k % 2], w[1 - k % 2], w[2]]);
                        }
                    }
                }
            }
            all
        };
        body.pieces.iter().map(of).collect()
    }

    fn forms() -> impl Iterator<Item = Form> {
        let primitives = [Primitives::Strips, Primitives::Triangles];
        let encodings = [Encoding::Float, Encoding::Quantized, Encoding::Meshopt];
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
        all.filter(|form| (form.encoding, form.layout) != (Encoding::Float, Layout::Nodes))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        /// Encoded geometry is the tile's own, has room for any description, and can be decoded.
        #[test]
        fn what_is_encoded_before_ids_are_known_is_the_tile(pieces in pieces(), caps in any::<bool>()) {
            let low = [u32::from(caps); 3];
            for form in forms() {
                let contents = contents(&pieces, form.primitives);
                let (body, bytes) = contents.body().unwrap();
                let head = TileHead { matrix: contents.matrix, form };
                let encoded = encode(&head, low, (&body, &bytes), None).unwrap();
                let what = (&body, &encoded.recipe);
                let file = tile_file(&head, low, (&body, &bytes), &contents.nodes).unwrap();
                let (json, table) = describe(&head, low, what, &contents.nodes).unwrap();
                prop_assert!([&encoded.bytes[..], &table].concat() == *file.bin);
                prop_assert_eq!(file.indices, u64::from(encoded.recipe.indices));
                prop_assert!(file.head[20..].starts_with(&json));
                let widest = (&head, &WidestNodes::new(&head));
                let widest = widest_description(widest, low, what).unwrap();
                let nodes = vec![Node::widest(); body.pieces.len()];
                let long = describe(&head, low, what, &nodes).unwrap().0.len();
                prop_assert!(json.len() <= long && long <= widest, "{} {long} {widest}", json.len());

                let (back, floats) = decode(&head, low, what, &encoded.bytes).unwrap();
                let positions = 12 * body.vertices as usize;
                prop_assert!(floats[..positions] == bytes[..positions]);
                prop_assert_eq!(
                    triangles(&back, &floats, form.primitives),
                    triangles(&body, &bytes, form.primitives)
                );
                // normals are rounded once
                let again = encode(&head, low, (&back, &floats), None).unwrap();
                let (_, twice) = decode(&head, low, (&back, &again.recipe), &again.bytes).unwrap();
                prop_assert!(floats[..2 * positions] == twice[..2 * positions]);
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
            let head = TileHead {
                matrix: contents.matrix,
                form,
            };
            let encoded = encode(&head, [0; 3], (&body, &bytes), None);
            match form.encoding {
                Encoding::Float => assert!(encoded.is_ok()),
                _ => assert_eq!(encoded.unwrap_err(), Refused::TooWide),
            }
        }
    }
}
