//! The merged layout: one mesh for a tile of very many pieces, whose ids and measures are rows of an
//! EXT_structural_metadata property table that `_FEATURE_ID_0` points into.

use super::bin::Bin;
use super::body::{Body, BodyPiece};
use super::document::{FLOAT, GENERATOR, Node, TileHead, UNSIGNED_SHORT, material, mode};
use super::paint::vertex_colour;
use super::store::{Accessor, Geometry, Refused, Stored, joined};
use crate::tile::Extras;
use bytemuck::Zeroable;
use serde_json::{Map, Value, json};

/// Value of a measure that is missing in the table; no measure is negative but the Euler
/// characteristic, which has its own.
const NO_DATA: f64 = -1.0;
const NO_EULER: i32 = i32::MIN;

/// A column: its name, component type, missing value and bytes.
struct Column {
    name: &'static str,
    kind: &'static str,
    no_data: Option<Value>,
    bytes: Vec<u8>,
}

/// The columns of the property table, the same as the fields of [`Extras`].
fn columns(rows: &[&Extras]) -> Vec<Column> {
    let id = |name: &'static str, get: &dyn Fn(&Extras) -> u64| {
        let values: Vec<u64> = rows.iter().map(|r| get(r)).collect();
        let narrow: Option<Vec<u32>> = values.iter().map(|&v| u32::try_from(v).ok()).collect();
        match narrow {
            Some(v) => (name, "UINT32", None, bytemuck::cast_slice(&v).to_vec()),
            None => (name, "UINT64", None, bytemuck::cast_slice(&values).to_vec()),
        }
    };
    let measure = |name: &'static str, get: &dyn Fn(&Extras) -> Option<f64>| {
        let values: Vec<f64> = rows.iter().map(|r| get(r).unwrap_or(NO_DATA)).collect();
        (
            name,
            "FLOAT64",
            Some(json!(NO_DATA)),
            bytemuck::cast_slice(&values).to_vec(),
        )
    };
    let euler: Vec<i32> = rows
        .iter()
        .map(|r| {
            r.euler_characteristic.map_or(NO_EULER, |e| {
                e.clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32
            })
        })
        .collect();
    let border: Vec<u8> = rows
        .iter()
        .map(|r| r.touches_border.unwrap_or(255))
        .collect();
    [
        id("cell", &|r| r.cell),
        id("object", &|r| r.object),
        id("surface", &|r| r.surface),
        id("triangles", &|r| r.triangles),
        measure("voxels", &|r| r.voxels.map(|v| v as f64)),
        measure("volume", &|r| r.volume),
        measure("mesh_volume", &|r| r.mesh_volume),
        measure("area", &|r| r.area),
        measure("equivalent_diameter", &|r| r.equivalent_diameter),
        measure("sphericity", &|r| r.sphericity),
        measure("form_factor", &|r| r.form_factor),
        measure("elongation", &|r| r.elongation),
        measure("flatness", &|r| r.flatness),
        (
            "euler_characteristic",
            "INT32",
            Some(json!(NO_EULER)),
            bytemuck::cast_slice(&euler).to_vec(),
        ),
        ("touches_border", "UINT8", Some(json!(255)), border),
    ]
    .into_iter()
    .map(|(name, kind, no_data, bytes)| Column {
        name,
        kind,
        no_data,
        bytes,
    })
    .collect()
}

/// The JSON and BIN chunk of a tile in merged layout, a row of the table per piece, and the number of
/// index entries.
pub(super) fn merged_chunks(
    head: &TileHead,
    low: [u32; 3],
    geometry: Geometry,
    nodes: &[Node],
) -> Result<(Vec<u8>, Vec<u8>, u64), Refused> {
    let body = geometry.body;
    let indices = joined(geometry, head.form.primitives);
    let mut whole = BodyPiece::zeroed();
    whole.vertices = body.vertices;
    whole.indices = indices.len() as u32;
    whole.min = fold(body, |p| p.min, i32::min);
    whole.max = fold(body, |p| p.max, i32::max);
    let (mut bin, base) = geometry.vertices(head.form.encoding, low)?;
    let at = bin.indices(&indices, whole.wide(), head.form.primitives, whole.vertices);
    let per_vertex = |i: usize| body.pieces[i].vertices as usize;
    let rows: Vec<[u8; 4]> = (0..nodes.len())
        .flat_map(|i| std::iter::repeat_n((i as f32).to_le_bytes(), per_vertex(i)))
        .collect();
    let rows = bin.vertices(&rows, None);
    let mut attributes = json!({"POSITION": 0, "NORMAL": 1, "_FEATURE_ID_0": 3});
    let mut plain = material();
    let painted = nodes.iter().any(|n| n.colour.is_some()).then(|| {
        let colours: Vec<[u8; 8]> = nodes
            .iter()
            .enumerate()
            .flat_map(|(i, n)| std::iter::repeat_n(vertex_colour(n.colour), per_vertex(i)))
            .collect();
        attributes["COLOR_0"] = 4.into();
        // vertex colours multiply the factor
        plain["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 1.0, 1.0, 1.0]);
        bin.vertices(&colours, None)
    });
    let table = Table::new(nodes, &mut bin);
    let stored = Stored {
        encoding: head.form.encoding,
        base,
        buffers: bin.finish(),
        views: bin.views,
        indices: vec![(at, 0)],
    };
    let mut accessors = stored.accessors(&whole, stored.indices[0]).to_vec();
    let of_vertices = Accessor {
        buffer_view: rows,
        byte_offset: None,
        component_type: FLOAT,
        count: whole.vertices,
        max: None,
        min: None,
        normalized: None,
        kind: "SCALAR",
    };
    accessors.push(of_vertices);
    accessors.extend(painted.map(|view| Accessor {
        buffer_view: view,
        component_type: UNSIGNED_SHORT,
        normalized: Some(true),
        kind: "VEC4",
        ..of_vertices
    }));
    let mut node = json!({"name": "cells", "mesh": 0});
    if let Some((translation, scale)) = stored.transform() {
        node["translation"] = json!(translation);
        node["scale"] = json!(scale);
    }
    let [required, used] = head.extensions(true);
    let mut document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "alvis", "matrix": head.matrix, "children": [1]}, node],
        "meshes": [{"name": "cells", "primitives": [{
            "attributes": attributes,
            "indices": 2, "material": 0, "mode": mode(head.form.primitives),
            "extensions": {"EXT_mesh_features": {"featureIds": [
                {"featureCount": nodes.len(), "attribute": 0, "propertyTable": 0}
            ]}}
        }]}],
        "materials": [plain],
        "accessors": accessors,
        "bufferViews": stored.views,
        "buffers": stored.buffers,
        "extensions": {"EXT_structural_metadata": table.extension(nodes)}
    });
    if !required.is_empty() {
        document["extensionsRequired"] = json!(required);
    }
    let json = serde_json::to_vec(&document).expect("plain data serialises");
    Ok((json, bin.bytes, indices.len() as u64))
}

/// The property table: its columns' kinds and where their values are.
struct Table {
    kinds: Map<String, Value>,
    values: Map<String, Value>,
}

impl Table {
    /// Puts the columns of the pieces into the chunk.
    fn new(nodes: &[Node], bin: &mut Bin) -> Self {
        let rows: Vec<&Extras> = nodes.iter().map(|n| &n.extras).collect();
        let mut table = Table {
            kinds: Map::new(),
            values: Map::new(),
        };
        for column in columns(&rows) {
            let mut kind = json!({"type": "SCALAR", "componentType": column.kind});
            if let Some(value) = column.no_data {
                kind["noData"] = value;
            }
            table.kinds.insert(column.name.into(), kind);
            let at = bin.plain(&column.bytes, None);
            table
                .values
                .insert(column.name.into(), json!({"values": at}));
        }
        table
    }

    /// EXT_structural_metadata with this one table.
    fn extension(self, nodes: &[Node]) -> Value {
        let unit = nodes.iter().find_map(|n| n.extras.unit);
        let mut class = json!({
            "description": format!("Surface pieces; lengths in {}", unit.unwrap_or("voxel")),
            "properties": self.kinds
        });
        if let Some(unit) = unit {
            class["extras"] = json!({"unit": unit});
        }
        json!({
            "schema": {"id": "alvis", "classes": {"piece": class}},
            "propertyTables": [{
                "name": "pieces", "class": "piece", "count": nodes.len(), "properties": self.values
            }]
        })
    }
}

fn fold(body: &Body, get: impl Fn(&BodyPiece) -> [i32; 3], pick: fn(i32, i32) -> i32) -> [i32; 3] {
    let all = body.pieces.iter().map(get);
    all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
        .unwrap_or_default()
}
