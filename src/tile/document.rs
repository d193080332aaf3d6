//! The JSON chunk of a tile in node layout.

use crate::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, TRIANGLE_STRIP, TRIANGLES};
use crate::manifest::{Form, Layout, Primitives};
use crate::tile::body::Body;
use crate::tile::codec::{TileCodec, codec};
use crate::tile::paint::{Paints, Rgb};
use crate::tile::store::{Accessor, IndicesAt, Stored};
use crate::tile::{Extras, MAX_NODES};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// What all tiles of a set have in common.
#[derive(Debug, Clone)]
pub struct TileHead {
    /// The root node's matrix.
    pub matrix: [f64; 16],
    /// Primitives, encoding and layout.
    pub form: Form,
    /// The codec of the encoding.
    pub codec: &'static dyn TileCodec,
    /// What the root node of a coarser level's node says of it; nothing of a tile.
    pub node: Option<NodeExtras>,
}

/// `extras` of the root node in the file of a node of a coarser level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct NodeExtras {
    /// The level, from 1 on.
    pub level: u32,
    /// How far surfaces lie from those of the tiles, in voxels.
    pub error: f64,
    /// How many rows of the table, the last ones, are of fins.
    pub fin_rows: u32,
}

impl TileHead {
    /// Of tiles in a form.
    pub fn new(matrix: [f64; 16], form: Form) -> Self {
        TileHead {
            matrix,
            form,
            codec: codec(form.encoding),
            node: None,
        }
    }

    /// True if a tile of so many pieces takes the merged layout.
    pub fn merges(&self, pieces: usize) -> bool {
        match self.form.layout {
            Layout::Auto => pieces > MAX_NODES,
            Layout::Nodes => false,
            Layout::Merged => true,
        }
    }

    /// True if the body of a tile of so many pieces is in the file as [`Body::write`] makes it.
    pub fn is_plain(&self, pieces: usize) -> bool {
        self.codec.keeps_floats() && !self.merges(pieces)
    }

    /// The extensions that a reader must know, and those used in the layout.
    pub(super) fn extensions(&self, merged: bool) -> [Vec<&'static str>; 2] {
        let required = self.codec.extensions().to_vec();
        let mut used = required.clone();
        if merged {
            used.extend(["EXT_mesh_features", "EXT_structural_metadata"]);
        }
        [required, used]
    }
}

/// One surface piece as it appears in the file.
#[derive(Debug, Clone)]
pub struct Node {
    /// Name of node and mesh.
    pub name: String,
    /// Its numbers.
    pub extras: Extras,
    /// Its colour; none is the common grey.
    pub colour: Option<Rgb>,
}

impl Node {
    /// A node whose JSON is at least as wide as any.
    pub fn widest() -> Self {
        let most = u64::MAX;
        Node {
            name: format!("cell_{most}_object_{most}"),
            extras: Extras::widest(),
            colour: None,
        }
    }
}

/// `asset.generator`.
pub(crate) const GENERATOR: &str = concat!("alvis ", env!("CARGO_PKG_VERSION"));

#[derive(Serialize)]
struct Document<'a> {
    asset: Value,
    #[serde(rename = "extensionsUsed", skip_serializing_if = "Vec::is_empty")]
    used: Vec<&'static str>,
    #[serde(rename = "extensionsRequired", skip_serializing_if = "Vec::is_empty")]
    required: Vec<&'static str>,
    scene: u32,
    scenes: [Value; 1],
    nodes: Vec<DocNode<'a>>,
    meshes: Vec<Mesh<'a>>,
    materials: Vec<Value>,
    accessors: Vec<Accessor>,
    #[serde(rename = "bufferViews")]
    buffer_views: Vec<Value>,
    buffers: Vec<Value>,
}

#[derive(Serialize)]
#[serde(untagged)]
enum DocNode<'a> {
    Root {
        name: &'static str,
        matrix: &'a [f64; 16],
        children: Vec<u32>,
    },
    Piece {
        name: &'a str,
        mesh: u32,
        #[serde(skip_serializing_if = "Option::is_none")]
        translation: Option<[i32; 3]>,
        #[serde(skip_serializing_if = "Option::is_none")]
        scale: Option<[f64; 3]>,
        extras: &'a Extras,
    },
}

#[derive(Serialize)]
struct Mesh<'a> {
    name: &'a str,
    primitives: [Primitive; 1],
}

#[derive(Serialize)]
struct Primitive {
    attributes: Attributes,
    indices: usize,
    material: usize,
    mode: u32,
}

/// The accessors of a primitive's attributes.
#[derive(Serialize)]
#[serde(rename_all = "UPPERCASE")]
struct Attributes {
    normal: usize,
    position: usize,
}

/// The material of every primitive: a rough light grey that shows both sides.
pub(crate) fn material() -> Value {
    json!({
        "name": "surface",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7
        },
        "doubleSided": true
    })
}

/// glTF mode of a kind of primitive.
pub(crate) fn mode(primitives: Primitives) -> u32 {
    match primitives {
        Primitives::Strips => TRIANGLE_STRIP,
        Primitives::Triangles => TRIANGLES,
    }
}

/// The buffer views of positions, normals and indices.
pub(crate) fn geometry_views(body: &Body) -> Vec<Value> {
    let vertex_bytes = 12 * u64::from(body.vertices);
    let indices = body.indices_start();
    vec![
        json!({"buffer": 0, "byteOffset": 0, "byteLength": vertex_bytes, "byteStride": 12, "target": ARRAY_BUFFER}),
        json!({"buffer": 0, "byteOffset": vertex_bytes, "byteLength": vertex_bytes, "byteStride": 12, "target": ARRAY_BUFFER}),
        json!({"buffer": 0, "byteOffset": indices, "byteLength": body.bytes - indices, "target": ELEMENT_ARRAY_BUFFER}),
    ]
}

/// The JSON of a tile in node layout with its body as it is, a node per piece of `body`, without
/// padding.
pub fn node_json(head: &TileHead, body: &Body, nodes: &[Node]) -> Vec<u8> {
    node_document(head, &Stored::plain(head.codec, body), body, nodes)
}

/// Room that the JSON of tiles in node layout takes at most, whatever the nodes. It is found once for all tiles,
/// without the numbers that are a tile's own.
#[derive(Debug)]
pub struct WidestNodes {
    /// What the tiles have in common.
    pub(super) head: TileHead,
    /// Bytes without pieces.
    none: usize,
    /// For one piece.
    one: usize,
    /// For each other one.
    more: usize,
}

impl WidestNodes {
    /// Of the tiles of a set.
    pub fn new(head: &TileHead) -> Self {
        let none = Stored {
            codec: head.codec,
            base: [0; 3],
            views: Vec::new(),
            buffers: Vec::new(),
            indices: Vec::new(),
        };
        let with = |pieces| with_widest(head, &none, &Body::default(), pieces);
        let (one, two) = (with(1), with(2));
        let own = OwnNumbers::of(&none, &Body::default());
        WidestNodes {
            head: head.clone(),
            none: with(0) - own.tile,
            one: one - own.tile - own.piece,
            more: two - one - own.piece,
        }
    }

    /// At least as many bytes as [`node_document`] can return for this body: a few more, since all pieces are
    /// taken for the widest.
    pub(super) fn room(&self, stored: &Stored, body: &Body) -> usize {
        let (own, pieces) = (OwnNumbers::of(stored, body), body.pieces.len());
        let Some(others) = pieces.checked_sub(1) else {
            return self.none + own.tile;
        };
        // a piece has five numbers of nodes, meshes and accessors, counted with one digit
        let digits = (3 * pieces + 2).ilog10() as usize;
        let more = others * (self.more + own.piece);
        self.one + own.tile + own.piece + more + pieces * 5 * digits
    }
}

/// Bytes of JSON for numbers that tiles do not have in common.
struct OwnNumbers {
    tile: usize,
    /// For each piece at most.
    piece: usize,
}

impl OwnNumbers {
    fn of(stored: &Stored, body: &Body) -> Self {
        let accessors = stored.accessors(&body.widest_piece(), widest_place(stored, body));
        let piece = (accessors, stored.transform());
        OwnNumbers {
            tile: json_bytes(&(&stored.views, &stored.buffers)),
            piece: json_bytes(&piece),
        }
    }
}

fn json_bytes<T: Serialize>(value: &T) -> usize {
    let json = serde_json::to_vec(value);
    json.expect("plain data serialises").len()
}

/// View and byte of indices than which none lie further from the beginning of their view.
fn widest_place(stored: &Stored, body: &Body) -> IndicesAt {
    IndicesAt {
        view: stored.views.len(),
        byte: body.bytes,
    }
}

/// Bytes of the JSON of a tile with so many of the widest pieces.
fn with_widest(head: &TileHead, stored: &Stored, body: &Body, pieces: usize) -> usize {
    let body = Body {
        pieces: vec![body.widest_piece(); pieces],
        ..*body
    };
    let stored = Stored {
        indices: vec![widest_place(stored, &body); pieces],
        views: stored.views.clone(),
        buffers: stored.buffers.clone(),
        ..*stored
    };
    node_document(head, &stored, &body, &vec![Node::widest(); pieces]).len()
}

/// As [`node_json`] for geometry stored in any way.
pub(super) fn node_document(
    head: &TileHead,
    stored: &Stored,
    body: &Body,
    nodes: &[Node],
) -> Vec<u8> {
    debug_assert_eq!(body.pieces.len(), nodes.len());
    let mut all = vec![DocNode::Root {
        name: "alvis",
        matrix: &head.matrix,
        children: (1..=nodes.len() as u32).collect(),
    }];
    let mut paints = Paints::default();
    let transform = stored.transform();
    let mut meshes = Vec::with_capacity(nodes.len());
    let mut accessors = Vec::with_capacity(3 * nodes.len());
    for (i, (node, piece)) in nodes.iter().zip(&body.pieces).enumerate() {
        all.push(DocNode::Piece {
            name: &node.name,
            mesh: i as u32,
            translation: transform.map(|t| t.translation),
            scale: transform.map(|t| t.scale),
            extras: &node.extras,
        });
        meshes.push(Mesh {
            name: &node.name,
            primitives: [Primitive {
                attributes: Attributes {
                    normal: 3 * i + 1,
                    position: 3 * i,
                },
                indices: 3 * i + 2,
                material: paints.index(node.colour),
                mode: mode(head.form.primitives),
            }],
        });
        accessors.extend(stored.accessors(piece, stored.indices[i]));
    }
    let [required, used] = head.extensions(false);
    let document = Document {
        asset: json!({"version": "2.0", "generator": GENERATOR}),
        used,
        required,
        scene: 0,
        scenes: [json!({"nodes": [0]})],
        nodes: all,
        meshes,
        materials: paints.materials,
        accessors,
        buffer_views: stored.views.clone(),
        buffers: stored.buffers.clone(),
    };
    serde_json::to_vec(&document).expect("plain data serialises")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tile::PieceRange;
    use crate::tile::codec::CODECS;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn bodies() -> impl Strategy<Value = Body> {
        let bound = prop::array::uniform3(-256..16_777_216i32);
        let vertices = (0..300_000u32, 0..300_000u32);
        let piece = (vertices, bound.clone(), bound, 0..1_000_000u32);
        let piece = piece.prop_map(|((first, vertices), min, max, indices)| {
            let mut piece = PieceRange::zeroed();
            (piece.first_vertex, piece.vertices, piece.indices) = (first, vertices, indices);
            (piece.min, piece.max) = (min, max);
            piece
        });
        prop::collection::vec(piece, 0..120).prop_map(|mut pieces| {
            let vertices = pieces.iter().map(|p| p.first_vertex + p.vertices).max();
            let vertices = vertices.unwrap_or(0);
            let mut bytes = 24 * u64::from(vertices);
            for piece in &mut pieces {
                piece.first_index_byte = bytes;
                bytes += 4 * u64::from(piece.indices);
            }
            Body {
                pieces,
                vertices,
                bytes,
            }
        })
    }

    proptest! {
        #[test]
        fn no_json_is_wider_than_the_widest(body in bodies(), strips in any::<bool>()) {
            let primitives = if strips { Primitives::Strips } else { Primitives::Triangles };
            let form = Form { primitives, ..Form::default() };
            let head = TileHead::new([-0.1 - f64::EPSILON; 16], form);
            let nodes = vec![Node::widest(); body.pieces.len()];
            let found = node_json(&head, &body, &nodes).len();
            let stored = Stored::plain(head.codec, &body);
            let widest = WidestNodes::new(&head).room(&stored, &body);
            // six coordinates, two counts and three places of a piece, of a few digits less each
            let most = found + 6 * 13 * body.pieces.len() + 5 * 10 * body.pieces.len();
            prop_assert!((found..=most).contains(&widest), "{found} {widest}");
        }
    }

    proptest! {
        /// As if each tile's JSON were written out.
        #[test]
        fn room_is_that_of_the_widest_pieces(
            body in bodies(), kind in 0..CODECS.len(), base in prop::array::uniform3(0..100_000i32),
        ) {
            let codec = CODECS[kind];
            let head = TileHead { codec, ..TileHead::new([-0.1 - f64::EPSILON; 16], Form::default()) };
            let stored = Stored { base, ..Stored::plain(codec, &body) };
            let widest = WidestNodes::new(&head);
            let written = |pieces| with_widest(&head, &stored, &body, pieces);
            for pieces in [0, 1, 2, 3] {
                let some = Body { pieces: vec![body.widest_piece(); pieces], ..body };
                prop_assert_eq!(widest.room(&stored, &some), written(pieces) + if pieces > 2 { 3 * 5 } else { 0 });
            }
        }
    }
}
