//! The merged layout: one mesh for a tile of very many pieces, whose ids and measures are rows of an
//! EXT_structural_metadata property table that `_FEATURE_ID_0` points into.

use crate::manifest::Primitives;
use crate::strip::append_strip;
use crate::tile::Extras;
use crate::tile::body::Body;
use crate::tile::document::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, GENERATOR, TileHead, UNSIGNED_INT, UNSIGNED_SHORT,
    coordinate, material, mode, write_head,
};
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
fn columns(rows: &[Extras]) -> Vec<Column> {
    let id = |name: &'static str, get: &dyn Fn(&Extras) -> u64| {
        let values: Vec<u64> = rows.iter().map(get).collect();
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

/// The whole file of a tile in merged layout, with one row of `rows` per piece of `body`. `None` if
/// it would pass the 4 GiB of a GLB.
pub fn merged_file(
    head: &TileHead,
    body: &Body,
    bytes: &[u8],
    rows: &[Extras],
) -> Option<(Vec<u8>, u64)> {
    let (indices, wide) = merged_indices(body, bytes, head.primitives);
    let mut bin = bytes[..body.indices_start() as usize].to_vec();
    let mut views = vec![
        view(
            0,
            12 * u64::from(body.vertices),
            Some(12),
            Some(ARRAY_BUFFER),
        ),
        view(
            12 * u64::from(body.vertices),
            12 * u64::from(body.vertices),
            Some(12),
            Some(ARRAY_BUFFER),
        ),
    ];
    let mut push = |bin: &mut Vec<u8>, data: &[u8], target: Option<u32>| {
        views.push(view(bin.len() as u64, data.len() as u64, None, target));
        bin.extend_from_slice(data);
        bin.resize(bin.len().next_multiple_of(8), 0);
        views.len() - 1
    };
    bin.resize(bin.len().next_multiple_of(8), 0);
    if wide {
        push(
            &mut bin,
            bytemuck::cast_slice(&indices),
            Some(ELEMENT_ARRAY_BUFFER),
        );
    } else {
        let narrow: Vec<u16> = indices.iter().map(|&i| i as u16).collect();
        push(
            &mut bin,
            bytemuck::cast_slice(&narrow),
            Some(ELEMENT_ARRAY_BUFFER),
        );
    }
    let features: Vec<f32> = body
        .pieces
        .iter()
        .enumerate()
        .flat_map(|(i, p)| std::iter::repeat_n(i as f32, p.vertices as usize))
        .collect();
    push(
        &mut bin,
        bytemuck::cast_slice(&features),
        Some(ARRAY_BUFFER),
    );
    let mut classes = Map::new();
    let mut table = Map::new();
    for column in columns(rows) {
        let mut class = json!({"type": "SCALAR", "componentType": column.kind});
        if let Some(value) = column.no_data {
            class["noData"] = value;
        }
        classes.insert(column.name.into(), class);
        let at = push(&mut bin, &column.bytes, None);
        table.insert(column.name.into(), json!({"values": at}));
    }
    let width = if wide { UNSIGNED_INT } else { UNSIGNED_SHORT };
    let min = fold(body, |p| p.min, i32::min).map(coordinate);
    let max = fold(body, |p| p.max, i32::max).map(coordinate);
    let unit = rows.iter().find_map(|r| r.unit);
    let accessor = |view: usize, kind: u32, count: u64, shape: &str| json!({"bufferView": view, "byteOffset": 0, "componentType": kind, "count": count, "type": shape});
    let vertices = u64::from(body.vertices);
    let mut positions = accessor(0, FLOAT, vertices, "VEC3");
    positions["min"] = json!(min);
    positions["max"] = json!(max);
    let document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "extensionsUsed": ["EXT_mesh_features", "EXT_structural_metadata"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "alvis", "matrix": head.matrix, "children": [1]},
            {"name": "cells", "mesh": 0}
        ],
        "meshes": [{"name": "cells", "primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "_FEATURE_ID_0": 3},
            "indices": 2, "material": 0, "mode": mode(head.primitives),
            "extensions": {"EXT_mesh_features": {"featureIds": [
                {"featureCount": rows.len(), "attribute": 0, "propertyTable": 0}
            ]}}
        }]}],
        "materials": [material()],
        "accessors": [
            positions,
            accessor(1, FLOAT, vertices, "VEC3"),
            accessor(2, width, indices.len() as u64, "SCALAR"),
            accessor(3, FLOAT, vertices, "SCALAR")
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": bin.len()}],
        "extensions": {"EXT_structural_metadata": {
            "schema": {"id": "alvis", "classes": {"piece": {
                "description": format!("Surface pieces; lengths in {}", unit.unwrap_or("voxel")),
                "properties": classes
            }}},
            "propertyTables": [{"name": "pieces", "class": "piece", "count": rows.len(), "properties": table}]
        }}
    });
    let json = serde_json::to_vec(&document).expect("plain data serialises");
    let mut file = write_head(&json, json.len().next_multiple_of(4), bin.len() as u64)?;
    file.extend_from_slice(&bin);
    Some((file, indices.len() as u64))
}

fn view(offset: u64, length: u64, stride: Option<u32>, target: Option<u32>) -> Value {
    let mut v = json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    if let Some(stride) = stride {
        v["byteStride"] = json!(stride);
    }
    if let Some(target) = target {
        v["target"] = json!(target);
    }
    v
}

fn fold(
    body: &Body,
    get: impl Fn(&super::BodyPiece) -> [i32; 3],
    pick: fn(i32, i32) -> i32,
) -> [i32; 3] {
    let mut all = body.pieces.iter().map(get);
    let first = all.next().unwrap_or_default();
    all.fold(first, |a, b| std::array::from_fn(|i| pick(a[i], b[i])))
}

/// All pieces' indices as one list or stitched strip over the tile's vertices, and whether they need
/// 4 bytes.
fn merged_indices(body: &Body, bytes: &[u8], primitives: Primitives) -> (Vec<u32>, bool) {
    let mut all = Vec::new();
    for piece in &body.pieces {
        let part = body.indices(piece, bytes);
        match primitives {
            Primitives::Strips => append_strip(&mut all, &part, piece.first_vertex),
            Primitives::Triangles => all.extend(part.iter().map(|i| i + piece.first_vertex)),
        }
    }
    (all, body.vertices > 65_535)
}
