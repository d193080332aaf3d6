//! A small reader of tiles that shares nothing with the library but the format.

use serde_json::Value;
use std::collections::HashMap;

/// A triangle in lattice units, its smallest corner first.
pub type Triangle = [[i32; 3]; 3];

/// One surface piece of a tile.
#[derive(Debug, Default)]
pub struct Piece {
    pub cell: u64,
    pub object: u64,
    pub surface: u64,
    /// The `triangles` that the piece states.
    pub stated_triangles: u64,
    /// In the order of the file, joints of strips left out.
    pub triangles: Vec<Triangle>,
    /// Bits of the normal at each position.
    pub normals: HashMap<[i32; 3], [u32; 3]>,
}

impl Piece {
    pub fn is_cap(&self) -> bool {
        self.cell == 0
    }
}

/// Rotates the smallest corner to the front, which keeps the orientation.
pub fn canonical(t: Triangle) -> Triangle {
    let first = (0..3).min_by_key(|&i| t[i]).unwrap();
    std::array::from_fn(|i| t[(first + i) % 3])
}

/// The JSON and the binary chunk of a GLB.
pub fn chunks(bytes: &[u8]) -> (Value, &[u8]) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!((word(4), word(8)), (2, bytes.len()));
    assert_eq!(&bytes[16..20], b"JSON");
    let json = &bytes[20..20 + word(12)];
    let at = 20 + json.len();
    assert_eq!(&bytes[at + 4..at + 8], b"BIN\0");
    let bin = &bytes[at + 8..at + 8 + word(at)];
    assert_eq!(at + 8 + bin.len(), bytes.len());
    (serde_json::from_slice(json).unwrap(), bin)
}

/// Reads a tile.
pub fn read(bytes: &[u8]) -> Vec<Piece> {
    let (doc, bin) = chunks(bytes);
    let reader = Reader { doc: &doc, bin };
    let nodes = doc["nodes"].as_array().unwrap();
    let mut pieces = Vec::new();
    for node in &nodes[1..] {
        let mesh = &doc["meshes"][index(&node["mesh"])];
        assert_eq!(mesh["name"], node["name"]);
        let primitive = &mesh["primitives"][0];
        match primitive["attributes"].get("_FEATURE_ID_0") {
            None => pieces.push(reader.one(node, primitive)),
            Some(features) => pieces.extend(reader.merged(primitive, index(features))),
        }
    }
    pieces
}

fn index(value: &Value) -> usize {
    value.as_u64().unwrap_or_else(|| panic!("{value}")) as usize
}

struct Reader<'a> {
    doc: &'a Value,
    bin: &'a [u8],
}

/// Position and bits of the normal.
type Vertex = ([i32; 3], [u32; 3]);

impl Reader<'_> {
    fn view(&self, at: usize) -> &[u8] {
        let view = &self.doc["bufferViews"][at];
        let start = view.get("byteOffset").map_or(0, index);
        &self.bin[start..start + index(&view["byteLength"])]
    }

    /// The accessor's bytes, of `size` bytes an element.
    fn accessor(&self, at: usize, size: usize) -> &[u8] {
        let accessor = &self.doc["accessors"][at];
        let start = accessor.get("byteOffset").map_or(0, index);
        let view = self.view(index(&accessor["bufferView"]));
        &view[start..start + size * index(&accessor["count"])]
    }

    fn floats(&self, at: usize) -> Vec<[f32; 3]> {
        let word = |b: &[u8], i: usize| f32::from_le_bytes(b[4 * i..4 * i + 4].try_into().unwrap());
        let bytes = self.accessor(at, 12);
        bytes
            .chunks_exact(12)
            .map(|b| [0, 1, 2].map(|i| word(b, i)))
            .collect()
    }

    fn vertices(&self, primitive: &Value) -> Vec<Vertex> {
        let attribute = |name: &str| self.floats(index(&primitive["attributes"][name]));
        let positions = attribute("POSITION").into_iter().map(|p| {
            p.map(|v| {
                assert_eq!((v * 256.0).fract(), 0.0, "{v} is not on the lattice");
                (v * 256.0) as i32
            })
        });
        let normals = attribute("NORMAL").into_iter().map(|n| n.map(f32::to_bits));
        positions.zip(normals).collect()
    }

    fn triangles(&self, primitive: &Value) -> Vec<[usize; 3]> {
        let at = index(&primitive["indices"]);
        let indices: Vec<usize> = match index(&self.doc["accessors"][at]["componentType"]) {
            5123 => {
                let bytes = self.accessor(at, 2).chunks_exact(2);
                bytes
                    .map(|b| usize::from(u16::from_le_bytes([b[0], b[1]])))
                    .collect()
            }
            5125 => {
                let bytes = self.accessor(at, 4).chunks_exact(4);
                bytes
                    .map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize)
                    .collect()
            }
            other => panic!("component type {other}"),
        };
        match index(&primitive["mode"]) {
            4 => indices.as_chunks::<3>().0.to_vec(),
            5 => {
                let windows = indices.windows(3).enumerate();
                let turned = windows.map(|(k, w)| {
                    if k % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[1], w[0], w[2]]
                    }
                });
                turned
                    .filter(|[a, b, c]| a != b && b != c && a != c)
                    .collect()
            }
            other => panic!("mode {other}"),
        }
    }

    fn one(&self, node: &Value, primitive: &Value) -> Piece {
        let extras = &node["extras"];
        let id = |name: &str| {
            extras[name]
                .as_u64()
                .unwrap_or_else(|| panic!("{name}: {extras}"))
        };
        let mut piece = Piece {
            cell: id("cell"),
            object: id("object"),
            surface: id("surface"),
            stated_triangles: id("triangles"),
            ..Piece::default()
        };
        let vertices = self.vertices(primitive);
        for corners in self.triangles(primitive) {
            piece.add(corners.map(|c| vertices[c]));
        }
        assert_eq!(
            piece.normals.len(),
            vertices.len(),
            "unused or repeated vertices"
        );
        piece
    }

    fn merged(&self, primitive: &Value, features: usize) -> Vec<Piece> {
        let table = &self.doc["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
        let column = |name: &str| -> Vec<u64> {
            let bytes = self.view(index(&table["properties"][name]["values"]));
            // few tests have ids that need 8 bytes: the count tells the width
            let width = bytes.len() / index(&table["count"]);
            let chunks = bytes.chunks_exact(width);
            chunks
                .map(|b| b.iter().rev().fold(0, |v, &b| v << 8 | u64::from(b)))
                .collect()
        };
        let [cells, objects, surfaces, counts] =
            ["cell", "object", "surface", "triangles"].map(column);
        let mut pieces: Vec<Piece> = (0..cells.len())
            .map(|i| Piece {
                cell: cells[i],
                object: objects[i],
                surface: surfaces[i],
                stated_triangles: counts[i],
                ..Piece::default()
            })
            .collect();
        let bytes = self.accessor(features, 4).chunks_exact(4);
        let row: Vec<f32> = bytes
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        let vertices = self.vertices(primitive);
        for corners in self.triangles(primitive) {
            let at = row[corners[0]];
            assert!(
                corners.iter().all(|&c| row[c] == at),
                "a triangle of two pieces"
            );
            pieces[at as usize].add(corners.map(|c| vertices[c]));
        }
        pieces
    }
}

impl Piece {
    fn add(&mut self, corners: [Vertex; 3]) {
        for (position, normal) in corners {
            let known = *self.normals.entry(position).or_insert(normal);
            assert_eq!(known, normal, "two normals at {position:?}");
        }
        self.triangles
            .push(canonical(corners.map(|(position, _)| position)));
    }
}
