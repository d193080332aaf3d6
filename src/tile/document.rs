//! The JSON chunk of a tile in node layout.

use crate::grid::LATTICE;
use crate::manifest::Primitives;
use crate::tile::Extras;
use crate::tile::body::{Body, BodyPiece};
use serde::Serialize;
use serde_json::{Value, json};

/// What all tiles of a set have in common.
#[derive(Debug, Clone)]
pub struct TileHead {
    /// The root node's matrix.
    pub matrix: [f64; 16],
    /// Kind of the primitives.
    pub primitives: Primitives,
}

/// One surface piece as it appears in the file.
#[derive(Debug, Clone)]
pub struct Node {
    /// Name of node and mesh.
    pub name: String,
    /// Its numbers.
    pub extras: Extras,
}

impl Node {
    /// A node whose JSON is at least as wide as any.
    pub fn widest() -> Self {
        let most = u64::MAX;
        Node {
            name: format!("cell_{most}_object_{most}"),
            extras: Extras::widest(),
        }
    }
}

/// `asset.generator`.
pub(crate) const GENERATOR: &str = concat!("alvis ", env!("CARGO_PKG_VERSION"));

/// Component types of glTF.
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const FLOAT: u32 = 5126;
/// Targets of buffer views.
pub(crate) const ARRAY_BUFFER: u32 = 34962;
pub(crate) const ELEMENT_ARRAY_BUFFER: u32 = 34963;

#[derive(Serialize)]
struct Document<'a> {
    asset: Value,
    scene: u32,
    scenes: [Value; 1],
    nodes: Vec<DocNode<'a>>,
    meshes: Vec<Value>,
    materials: [Value; 1],
    accessors: Vec<Value>,
    #[serde(rename = "bufferViews")]
    buffer_views: Vec<Value>,
    buffers: [Value; 1],
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
        extras: &'a Extras,
    },
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
        Primitives::Strips => 5,
        Primitives::Triangles => 4,
    }
}

/// A coordinate in lattice steps as the `f32` of the file.
pub(crate) fn coordinate(steps: i32) -> f32 {
    steps as f32 / LATTICE as f32
}

/// The three accessors of a piece.
pub(super) fn accessors(body: &Body, piece: &BodyPiece) -> [Value; 3] {
    let vertex_bytes = 12 * u64::from(piece.first_vertex);
    let (min, max) = (piece.min.map(coordinate), piece.max.map(coordinate));
    let width = if piece.wide() {
        UNSIGNED_INT
    } else {
        UNSIGNED_SHORT
    };
    [
        json!({"bufferView": 0, "byteOffset": vertex_bytes, "componentType": FLOAT,
               "count": piece.vertices, "type": "VEC3", "min": min, "max": max}),
        json!({"bufferView": 1, "byteOffset": vertex_bytes, "componentType": FLOAT,
               "count": piece.vertices, "type": "VEC3"}),
        json!({"bufferView": 2, "byteOffset": piece.first_index_byte - body.indices_start(),
               "componentType": width, "count": piece.indices, "type": "SCALAR"}),
    ]
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

/// The JSON of a tile in node layout, a node per piece of `body`, without padding.
pub fn node_json(head: &TileHead, body: &Body, nodes: &[Node]) -> Vec<u8> {
    debug_assert_eq!(body.pieces.len(), nodes.len());
    let mut all = vec![DocNode::Root {
        name: "alvis",
        matrix: &head.matrix,
        children: (1..=nodes.len() as u32).collect(),
    }];
    let mut meshes = Vec::with_capacity(nodes.len());
    let mut all_accessors = Vec::with_capacity(3 * nodes.len());
    for (i, (node, piece)) in nodes.iter().zip(&body.pieces).enumerate() {
        all.push(DocNode::Piece {
            name: &node.name,
            mesh: i as u32,
            extras: &node.extras,
        });
        meshes.push(json!({"name": node.name, "primitives": [{
            "attributes": {"POSITION": 3 * i, "NORMAL": 3 * i + 1},
            "indices": 3 * i + 2, "material": 0, "mode": mode(head.primitives)
        }]}));
        all_accessors.extend(accessors(body, piece));
    }
    let document = Document {
        asset: json!({"version": "2.0", "generator": GENERATOR}),
        scene: 0,
        scenes: [json!({"nodes": [0]})],
        nodes: all,
        meshes,
        materials: [material()],
        accessors: all_accessors,
        buffer_views: geometry_views(body),
        buffers: [json!({"byteLength": body.bytes})],
    };
    serde_json::to_vec(&document).expect("plain data serialises")
}

/// The file's bytes before the BIN chunk's data: both headers and the JSON, padded with spaces to
/// `room` bytes. `None` if the JSON does not fit.
pub fn write_head(json: &[u8], room: usize, bin_bytes: u64) -> Option<Vec<u8>> {
    debug_assert!(room.is_multiple_of(4) && bin_bytes.is_multiple_of(4));
    let total = 12 + 8 + room as u64 + 8 + bin_bytes;
    if json.len() > room || total > u64::from(u32::MAX) {
        return None;
    }
    let mut out = Vec::with_capacity(28 + room);
    let word = |out: &mut Vec<u8>, v: u32| out.extend(v.to_le_bytes());
    out.extend(b"glTF");
    word(&mut out, 2);
    word(&mut out, total as u32);
    word(&mut out, room as u32);
    out.extend(b"JSON");
    out.extend(json);
    out.resize(20 + room, b' ');
    word(&mut out, bin_bytes as u32);
    out.extend(b"BIN\0");
    Some(out)
}
