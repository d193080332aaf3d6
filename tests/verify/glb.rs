//! Tiles for tests: encoded, decoded and changed without any of the library's code.

use serde_json::{Value, json};
use std::path::Path;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Piece {
    pub name: String,
    pub extras: Value,
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

#[derive(Clone, Debug)]
pub struct Tile {
    pub matrix: Value,
    /// 4 or 5.
    pub mode: u64,
    /// Write 32-bit indices where 16 bits suffice.
    pub wide: bool,
    pub pieces: Vec<Piece>,
}

/// Joins a JSON and a BIN chunk to a GLB.
pub fn wrap(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    // room as the converter leaves it
    text.resize(text.len().next_multiple_of(4) + 64, b' ');
    let mut out = b"glTF".to_vec();
    let total = 12 + 8 + text.len() + 8 + bin.len();
    for v in [2, total as u32, text.len() as u32] {
        out.extend(v.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(text);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

/// Splits a GLB into its JSON and BIN chunk.
pub fn unwrap(bytes: &[u8]) -> (Value, Vec<u8>) {
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json = serde_json::from_slice(&bytes[20..20 + n]).unwrap();
    (json, bytes[28 + n..].to_vec())
}

/// Greedy strips joined by degenerates; returns indices and the number of strips.
pub fn stripify(triangles: &[[u32; 3]]) -> (Vec<u32>, u64) {
    let mut by_edge = std::collections::HashMap::new();
    for (i, t) in triangles.iter().enumerate() {
        for k in 0..3 {
            by_edge.insert((t[k], t[(k + 1) % 3]), (i, t[(k + 2) % 3]));
        }
    }
    let mut used = vec![false; triangles.len()];
    let (mut out, mut strips) = (Vec::<u32>::new(), 0);
    for i in 0..triangles.len() {
        if used[i] {
            continue;
        }
        used[i] = true;
        let mut strip = triangles[i].to_vec();
        loop {
            let n = strip.len();
            let (a, b) = (strip[n - 2], strip[n - 1]);
            let edge = if n.is_multiple_of(2) { (a, b) } else { (b, a) };
            match by_edge.get(&edge) {
                Some(&(j, v)) if !used[j] => {
                    used[j] = true;
                    strip.push(v);
                }
                _ => break,
            }
        }
        if let Some(&last) = out.last() {
            out.extend([last, strip[0]]);
            if out.len() % 2 == 1 {
                out.push(strip[0]);
            }
        }
        out.extend(strip);
        strips += 1;
    }
    (out, strips)
}

impl Tile {
    /// The GLB, the number of strips and the number of indices.
    pub fn encode(&self) -> (Vec<u8>, u64, u64) {
        let mut chunks = [Vec::new(), Vec::new(), Vec::new()];
        let (mut strips, mut index_count) = (0, 0);
        let mut accessors = Vec::new();
        let mut meshes = Vec::new();
        let mut nodes = vec![json!({"name": "alvis", "matrix": self.matrix,
            "children": (1..=self.pieces.len()).collect::<Vec<_>>()})];
        for (m, p) in self.pieces.iter().enumerate() {
            let (indices, n) = if self.mode == 5 {
                stripify(&p.triangles)
            } else {
                (p.triangles.concat(), 0)
            };
            strips += n;
            index_count += indices.len() as u64;
            let wide = self.wide || p.positions.len() > 65_535;
            while chunks[2].len() % 4 != 0 {
                chunks[2].push(0);
            }
            let bound = |pick: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                let fold = |a: usize| p.positions.iter().map(|q| q[a]).fold(start, pick);
                (0..3).map(fold).collect()
            };
            accessors.push(
                json!({"bufferView": 0, "byteOffset": chunks[0].len(), "componentType": 5126,
                "type": "VEC3", "count": p.positions.len(),
                "min": bound(f32::min, f32::INFINITY), "max": bound(f32::max, f32::NEG_INFINITY)}),
            );
            accessors.push(json!({"bufferView": 1, "byteOffset": chunks[1].len(),
                "componentType": 5126, "type": "VEC3", "count": p.normals.len()}));
            accessors.push(
                json!({"bufferView": 2, "byteOffset": chunks[2].len(), "type": "SCALAR",
                "componentType": if wide { 5125 } else { 5123 }, "count": indices.len()}),
            );
            chunks[0].extend(p.positions.iter().flatten().flat_map(|v| v.to_le_bytes()));
            chunks[1].extend(p.normals.iter().flatten().flat_map(|v| v.to_le_bytes()));
            for i in indices {
                let bytes = i.to_le_bytes();
                chunks[2].extend(if wide { &bytes[..] } else { &bytes[..2] });
            }
            meshes.push(
                json!({"name": p.name, "primitives": [{"mode": self.mode, "material": 0,
                "attributes": {"POSITION": 3 * m, "NORMAL": 3 * m + 1}, "indices": 3 * m + 2}]}),
            );
            nodes.push(json!({"name": p.name, "mesh": m, "extras": p.extras}));
        }
        let mut bin = Vec::new();
        let mut views = Vec::new();
        for (i, chunk) in chunks.iter().enumerate() {
            let mut view = json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": chunk.len()});
            view["target"] = 34963.into();
            if i < 2 {
                view["byteStride"] = 12.into();
                view["target"] = 34962.into();
            }
            views.push(view);
            bin.extend(chunk);
            bin.resize(bin.len().next_multiple_of(4), 0);
        }
        let doc = json!({"asset": {"version": "2.0", "generator": "tests"}, "scene": 0,
            "scenes": [{"nodes": [0]}], "nodes": nodes, "meshes": meshes, "accessors": accessors,
            "materials": [{"name": "surface", "doubleSided": true, "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0, "roughnessFactor": 0.7}}],
            "bufferViews": views,
            "buffers": [{"byteLength": bin.len()}]});
        (wrap(&doc, &bin), strips, index_count)
    }

    pub fn decode(bytes: &[u8]) -> Tile {
        let (doc, bin) = unwrap(bytes);
        let number = |v: &Value| v.as_u64().unwrap_or(0) as usize;
        let words = |accessor: &Value| -> Vec<u8> {
            let a = &doc["accessors"][number(accessor)];
            let view = &doc["bufferViews"][number(&a["bufferView"])];
            let start = number(&view["byteOffset"]) + number(&a["byteOffset"]);
            let size = match (a["type"].as_str(), a["componentType"].as_u64()) {
                (Some("VEC3"), _) => 12,
                (_, Some(5123)) => 2,
                _ => 4,
            };
            bin[start..start + size * number(&a["count"])].to_vec()
        };
        let floats = |accessor: &Value| -> Vec<[f32; 3]> {
            let float = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
            let vec3 = |b: &[u8]| [float(&b[..4]), float(&b[4..8]), float(&b[8..])];
            words(accessor).chunks(12).map(vec3).collect()
        };
        let mut mode = 4;
        let mut pieces = Vec::new();
        for node in &doc["nodes"].as_array().unwrap()[1..] {
            let primitive = &doc["meshes"][number(&node["mesh"])]["primitives"][0];
            mode = primitive["mode"].as_u64().unwrap();
            let wide = doc["accessors"][number(&primitive["indices"])]["componentType"] == 5125;
            let raw = words(&primitive["indices"]);
            let indices: Vec<u32> = if wide {
                raw.chunks(4)
                    .map(|b| u32::from_le_bytes(b.try_into().unwrap()))
                    .collect()
            } else {
                raw.chunks(2)
                    .map(|b| u16::from_le_bytes(b.try_into().unwrap()).into())
                    .collect()
            };
            let triangles = if mode == 5 {
                let turn = |(k, w): (usize, &[u32])| {
                    if k % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[1], w[0], w[2]]
                    }
                };
                let real = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[0] != t[2];
                indices
                    .windows(3)
                    .enumerate()
                    .map(turn)
                    .filter(real)
                    .collect()
            } else {
                indices.chunks(3).map(|t| [t[0], t[1], t[2]]).collect()
            };
            pieces.push(Piece {
                name: node["name"].as_str().unwrap().to_owned(),
                extras: node["extras"].clone(),
                positions: floats(&primitive["attributes"]["POSITION"]),
                normals: floats(&primitive["attributes"]["NORMAL"]),
                triangles,
            });
        }
        Tile {
            matrix: doc["nodes"][0]["matrix"].clone(),
            mode,
            wide: false,
            pieces,
        }
    }
}

/// The columns of a merged tile's table: component type, and the value of what is missing.
const COLUMNS: [(&str, &str, Option<f64>); 15] = [
    ("cell", "UINT64", None),
    ("object", "UINT32", None),
    ("surface", "UINT32", None),
    ("triangles", "UINT32", None),
    ("voxels", "FLOAT64", Some(-1.0)),
    ("volume", "FLOAT64", Some(-1.0)),
    ("mesh_volume", "FLOAT64", Some(-1.0)),
    ("area", "FLOAT64", Some(-1.0)),
    ("equivalent_diameter", "FLOAT64", Some(-1.0)),
    ("sphericity", "FLOAT64", Some(-1.0)),
    ("form_factor", "FLOAT64", Some(-1.0)),
    ("elongation", "FLOAT64", Some(-1.0)),
    ("flatness", "FLOAT64", Some(-1.0)),
    ("euler_characteristic", "INT32", Some(i32::MIN as f64)),
    ("touches_border", "UINT8", Some(255.0)),
];

pub fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

pub fn write_json(path: &Path, value: &Value) {
    std::fs::write(path, value.to_string()).unwrap();
}

pub fn crc32(bytes: &[u8]) -> String {
    // bit by bit, as in the definition of CRC-32 (IEEE 802.3)
    let mut crc = u32::MAX;
    for b in bytes {
        crc ^= u32::from(*b);
        for _ in 0..8 {
            crc = crc >> 1 ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    format!("crc32:{:08x}", !crc)
}

impl Tile {
    /// The tile in the merged layout: one primitive with feature ids and a property table. Returns
    /// what [`Tile::encode`] does.
    pub fn encode_merged(&self) -> (Vec<u8>, u64, u64) {
        let mut all = Piece {
            name: "cells".into(),
            extras: json!({}),
            ..Piece::default()
        };
        let mut features = Vec::new();
        for (row, p) in self.pieces.iter().enumerate() {
            let base = all.positions.len() as u32;
            all.positions.extend(&p.positions);
            all.normals.extend(&p.normals);
            all.triangles
                .extend(p.triangles.iter().map(|t| t.map(|i| i + base)));
            features.extend(p.positions.iter().map(|_| row as f32));
        }
        let n = self.pieces.len();
        let one = Tile {
            pieces: vec![all],
            ..self.clone()
        };
        let (glb, strips, indices) = one.encode();
        let (mut doc, mut bin) = unwrap(&glb);
        let mut view = |doc: &mut Value, bytes: Vec<u8>| {
            bin.resize(bin.len().next_multiple_of(8), 0);
            let views = doc["bufferViews"].as_array_mut().unwrap();
            views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()}));
            bin.extend(bytes);
            views.len() - 1
        };
        let ids = view(
            &mut doc,
            features.iter().flat_map(|f| f.to_le_bytes()).collect(),
        );
        doc["bufferViews"][ids]["byteStride"] = 4.into();
        doc["bufferViews"][ids]["target"] = 34962.into();
        let accessors = doc["accessors"].as_array_mut().unwrap();
        accessors.push(
            json!({"bufferView": ids, "componentType": 5126, "type": "SCALAR",
            "count": features.len()}),
        );
        let accessor = accessors.len() - 1;
        let mut properties = json!({});
        let mut columns = json!({});
        for (key, kind, none) in COLUMNS {
            let value = |p: &Piece| p.extras[key].as_f64().or(none);
            let bytes = |p: &Piece| {
                let v = value(p).unwrap();
                match kind {
                    "UINT8" => (v as u8).to_le_bytes().to_vec(),
                    "INT32" => (v as i32).to_le_bytes().to_vec(),
                    "UINT32" => (v as u32).to_le_bytes().to_vec(),
                    "UINT64" => (v as u64).to_le_bytes().to_vec(),
                    _ => v.to_le_bytes().to_vec(),
                }
            };
            let at = view(&mut doc, self.pieces.iter().flat_map(bytes).collect());
            properties[key] = json!({"type": "SCALAR", "componentType": kind});
            if let Some(none) = none {
                properties[key]["noData"] = match kind {
                    "FLOAT64" => none.into(),
                    _ => (none as i64).into(),
                };
            }
            columns[key] = json!({"values": at});
        }
        doc["nodes"][1].as_object_mut().unwrap().remove("extras");
        let primitive = &mut doc["meshes"][0]["primitives"][0];
        primitive["attributes"]["_FEATURE_ID_0"] = accessor.into();
        primitive["extensions"] = json!({"EXT_mesh_features": {"featureIds":
            [{"featureCount": n, "attribute": 0, "propertyTable": 0}]}});
        doc["extensions"] = json!({"EXT_structural_metadata": {
            "schema": {"id": "alvis", "classes": {"piece":
                {"description": "Surface pieces; lengths in mm", "properties": properties,
                "extras": {"unit": "mm"}}}},
            "propertyTables": [{"name": "pieces", "class": "piece", "count": n, "properties": columns}]}});
        doc["extensionsUsed"] = json!(["EXT_mesh_features", "EXT_structural_metadata"]);
        bin.resize(bin.len().next_multiple_of(4), 0);
        doc["buffers"][0]["byteLength"] = bin.len().into();
        (wrap(&doc, &bin), strips, indices)
    }
}
