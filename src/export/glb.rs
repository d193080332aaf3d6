//! GLB (glTF 2.0, section 4): one node with the tiles' matrix and one mesh with one primitive, a list of
//! triangles with 32-bit indices. Positions are voxel coordinates, exact, and lie beside their normal and
//! the id of their cell (`_FEATURE_ID_0` of EXT_mesh_features; 0 for a cap) in one buffer view.

use super::format::{Coded, Counts, Writer, push_floats, too_large};
use super::front::Numbers;
use super::sheet::Sheet;
use crate::error::Result;
use crate::gltf::container::write_head;
use crate::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, TRIANGLES, UNSIGNED_INT};
use crate::grid::LATTICE;
use crate::manifest::Manifest;
use crate::tile::{GENERATOR, material};
use serde_json::{Value, json};

/// Bytes for the JSON, padded with spaces.
const ROOM: usize = 4096;
/// Headers of the file and of both chunks.
const HEADERS: usize = 28;
/// Largest id that a float holds exactly.
const MOST_ID: u64 = 1 << 24;

/// Writes GLB.
pub(super) struct Glb {
    matrix: [f64; 16],
    cells: u64,
    /// True if ids are written.
    ids: bool,
}

impl Glb {
    /// The writer for a tile set whose cells have ids up to `largest_cell`.
    pub fn new(manifest: &Manifest, largest_cell: u64) -> Self {
        let cells = largest_cell;
        Glb {
            matrix: manifest.transform,
            cells,
            ids: cells <= MOST_ID,
        }
    }

    fn stride(&self) -> u64 {
        if self.ids { 28 } else { 24 }
    }

    fn bin_bytes(&self, vertices: u64, triangles: u64) -> u64 {
        let vertices = vertices.saturating_mul(self.stride());
        vertices.saturating_add(triangles.saturating_mul(12))
    }

    fn document(&self, counts: &Counts) -> Value {
        let Counts {
            vertices,
            triangles,
            bounds,
        } = *counts;
        let bound = |which: usize| bounds[which].map(|v| f64::from(v) / f64::from(LATTICE));
        let attribute = |offset: u32, shape: &str| json!({"bufferView": 0, "byteOffset": offset, "componentType": FLOAT, "count": vertices, "type": shape});
        let mut position = attribute(0, "VEC3");
        position["min"] = json!(bound(0));
        position["max"] = json!(bound(1));
        let corners = json!({"bufferView": 1, "byteOffset": 0, "componentType": UNSIGNED_INT, "count": 3 * triangles, "type": "SCALAR"});
        let mut accessors = vec![position, attribute(12, "VEC3"), corners];
        let mut primitive = json!({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0, "mode": TRIANGLES});
        if self.ids {
            accessors.push(attribute(24, "SCALAR"));
            primitive["attributes"]["_FEATURE_ID_0"] = 3.into();
            primitive["extensions"] = json!({"EXT_mesh_features": {"featureIds": [{"featureCount": self.cells.max(1), "attribute": 0, "label": "cell"}]}});
        }
        let vertex_bytes = vertices * self.stride();
        let bytes = self.bin_bytes(vertices, triangles);
        let mut doc = json!({
            "asset": {"version": "2.0", "generator": GENERATOR},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "alvis", "matrix": self.matrix, "mesh": 0}],
            "meshes": [{"name": "surface", "primitives": [primitive]}],
            "materials": [material()],
            "accessors": accessors,
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": vertex_bytes, "byteStride": self.stride(), "target": ARRAY_BUFFER},
                {"buffer": 0, "byteOffset": vertex_bytes, "byteLength": bytes - vertex_bytes, "target": ELEMENT_ARRAY_BUFFER}
            ],
            "buffers": [{"byteLength": bytes}],
        });
        if self.ids {
            doc["extensionsUsed"] = json!(["EXT_mesh_features"]);
        }
        doc
    }
}

impl Writer for Glb {
    fn head(&self, counts: &Counts) -> Vec<u8> {
        let json = self.document(counts).to_string();
        let bytes = self.bin_bytes(counts.vertices, counts.triangles);
        let head = write_head(json.as_bytes(), ROOM, bytes);
        head.expect("few numbers, and the size was checked")
    }

    fn encode(&self, sheet: &Sheet, numbers: &Numbers) -> Coded {
        let mut coded = Coded {
            vertices: Vec::with_capacity(sheet.points.len() * self.stride() as usize),
            faces: Vec::with_capacity(sheet.triangles.len() * 12),
        };
        for (piece, vertices, triangles) in sheet.parts() {
            for i in vertices.filter(|&i| numbers.all[i] >= numbers.first) {
                let point = sheet.points[i].map(|v| v as f32 / LATTICE as f32);
                push_floats(&mut coded.vertices, point);
                push_floats(&mut coded.vertices, sheet.normals[i]);
                if self.ids {
                    coded.vertices.extend((piece.cell as f32).to_le_bytes());
                }
            }
            for t in triangles {
                let corners = t.map(|i| (numbers.all[i as usize] as u32).to_le_bytes());
                coded.faces.extend(corners.as_flattened());
            }
        }
        coded
    }

    fn check(&self, vertices: u64, triangles: u64) -> Result<()> {
        const MOST: u64 = u32::MAX as u64;
        let head = (HEADERS + ROOM) as u64;
        let bytes = self.bin_bytes(vertices, triangles).saturating_add(head);
        if bytes <= MOST {
            return Ok(());
        }
        Err(too_large(
            format!("{bytes} bytes for {vertices} vertices and {triangles} triangles"),
            "less than 4 GiB in a GLB file".to_string(),
        ))
    }

    fn sizes(&self) -> [u64; 2] {
        [self.stride(), 12]
    }

    fn apart(&self) -> bool {
        true
    }

    fn warning(&self) -> Option<String> {
        (!self.ids).then(|| {
            format!(
                "ids of cells are left out: they go up to {}, and a GLB holds them exactly up to {MOST_ID}; a .ply has them",
                self.cells
            )
        })
    }
}
