//! The merged layout: one mesh for a tile of very many pieces, whose ids and measures are rows of an
//! EXT_structural_metadata property table that `_FEATURE_ID_0` points into.

use super::body::PieceRange;
use super::document::{GENERATOR, Node, TileHead, material, mode};
use super::encoded::{Description, EncodedBody};
use super::paint::vertex_colour;
use super::store::{Accessor, IndicesAt, Refused, Stored};
use crate::gltf::accessors::Element;
use crate::gltf::bin_writer::{Section, Views};
use crate::measure::{CARRIED, CARRIED_COLUMNS, Field, Get};
use crate::tile::Extras;
use bytemuck::Zeroable;
use serde_json::{Map, Value, json};

/// Values of measures that are missing in the table, by their kind: no count and no real number is negative.
const NO_NUMBER: f64 = -1.0;
const NO_SIGNED: i32 = i32::MIN;
const NO_FLAG: u8 = 255;

/// A column of the property table.
struct Column {
    name: &'static str,
    kind: &'static str,
    no_data: Option<Value>,
    bytes: Vec<u8>,
}

/// Ids, or counts of triangles.
fn id_column(name: &'static str, values: Vec<u64>) -> Column {
    let narrow: Option<Vec<u32>> = values.iter().map(|&v| u32::try_from(v).ok()).collect();
    let (kind, bytes) = match narrow {
        Some(narrow) => ("UINT32", bytemuck::cast_slice(&narrow).to_vec()),
        None => ("UINT64", bytemuck::cast_slice(&values).to_vec()),
    };
    Column {
        name,
        kind,
        no_data: None,
        bytes,
    }
}

/// Measure number `i` of the cells.
fn measure_column(i: usize, rows: &[&Extras]) -> Column {
    let column = &CARRIED_COLUMNS[i];
    let fields = rows.iter().map(|row| row.measures[i]);
    let (kind, no_data, bytes) = match column.get {
        Get::Count(_) | Get::Real(_) => {
            let values: Vec<f64> = fields.map(number).collect();
            (
                "FLOAT64",
                json!(NO_NUMBER),
                bytemuck::cast_slice(&values).to_vec(),
            )
        }
        Get::Signed(_) => {
            let values: Vec<i32> = fields.map(signed).collect();
            (
                "INT32",
                json!(NO_SIGNED),
                bytemuck::cast_slice(&values).to_vec(),
            )
        }
        Get::Flag(_) => ("UINT8", json!(NO_FLAG), fields.map(flag).collect()),
    };
    Column {
        name: column.name,
        kind,
        no_data: Some(no_data),
        bytes,
    }
}

fn number(field: Option<Field>) -> f64 {
    match field {
        Some(Field::Count(v)) => v as f64,
        Some(Field::Real(v)) => v,
        _ => NO_NUMBER,
    }
}

fn signed(field: Option<Field>) -> i32 {
    match field {
        Some(Field::Signed(v)) => v.clamp(-i64::from(i32::MAX), i64::from(i32::MAX)) as i32,
        _ => NO_SIGNED,
    }
}

fn flag(field: Option<Field>) -> u8 {
    match field {
        Some(Field::Flag(v)) => v.into(),
        _ => NO_FLAG,
    }
}

/// The columns of the property table, the same as the fields of [`Extras`].
fn columns(rows: &[&Extras]) -> Vec<Column> {
    let ids = |get: fn(&Extras) -> u64| rows.iter().map(|row| get(row)).collect();
    let mut all = vec![
        id_column("cell", ids(|r| r.cell)),
        id_column("object", ids(|r| r.object)),
        id_column("surface", ids(|r| r.surface)),
        id_column("triangles", ids(|r| r.triangles)),
    ];
    all.extend((0..CARRIED).map(|i| measure_column(i, rows)));
    all
}

/// What is written of a tile in merged layout whose geometry is encoded, a row of the table per piece.
///
/// # Errors
/// [`Refused::TooWide`].
pub(super) fn merged_document(
    head: &TileHead,
    low: [u32; 3],
    encoded: EncodedBody,
    nodes: &[Node],
) -> Result<Description, Refused> {
    let EncodedBody { body, layout } = encoded;
    let painted = is_painted(nodes);
    let mut views = layout.views(head, body, painted);
    let table = Table::new(nodes, &mut views);
    let stored = Stored {
        codec: head.codec,
        base: head.codec.base(body, low)?,
        buffers: head.codec.buffers(&views),
        views: views.views,
        indices: Vec::new(),
    };
    let mut node = json!({"name": "cells", "mesh": 0});
    if let Some(transform) = stored.transform() {
        node["translation"] = json!(transform.translation);
        node["scale"] = json!(transform.scale);
    }
    let mut root = json!({"name": "alvis", "matrix": head.matrix, "children": [1]});
    if let Some(extras) = head.node {
        root["extras"] = json!(extras);
    }
    let [required, used] = head.extensions(true);
    let mut document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [root, node],
        "meshes": [{"name": "cells", "primitives": [primitive(head, painted, nodes.len())]}],
        "materials": [merged_material(painted)],
        "accessors": accessors(&stored, encoded, painted),
        "bufferViews": stored.views,
        "buffers": stored.buffers,
        "extensions": {"EXT_structural_metadata": table.extension(nodes)}
    });
    if !required.is_empty() {
        document["extensionsRequired"] = json!(required);
    }
    Ok(Description {
        json: serde_json::to_vec(&document).expect("plain data serialises"),
        table: table.bytes,
    })
}

/// The one primitive, whose accessors are those of [`accessors`].
fn primitive(head: &TileHead, painted: bool, pieces: usize) -> Value {
    let mut attributes = json!({"POSITION": 0, "NORMAL": 1, "_FEATURE_ID_0": 3});
    if painted {
        attributes["COLOR_0"] = 4.into();
    }
    json!({
        "attributes": attributes,
        "indices": 2, "material": 0, "mode": mode(head.form.primitives),
        "extensions": {"EXT_mesh_features": {"featureIds": [
            {"featureCount": pieces, "attribute": 0, "propertyTable": 0}
        ]}}
    })
}

/// The one material.
fn merged_material(painted: bool) -> Value {
    let mut plain = material();
    if painted {
        // vertex colours multiply the factor
        plain["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 1.0, 1.0, 1.0]);
    }
    plain
}

/// Of positions, normals, indices, rows, and colours if there are any.
fn accessors(stored: &Stored, encoded: EncodedBody, painted: bool) -> Vec<Accessor> {
    let mut whole = PieceRange::zeroed();
    whole.vertices = encoded.body.vertices;
    whole.indices = encoded.layout.indices;
    [whole.min, whole.max] = encoded.body.bounds();
    let indices = IndicesAt {
        view: INDICES,
        byte: 0,
    };
    let mut all = stored.accessors(&whole, indices).to_vec();
    all.push(Accessor::new(ROWS, Element::FLOAT, whole.vertices));
    all.extend(painted.then(|| Accessor::new(COLOURS, Element::COLOUR, whole.vertices)));
    all
}

/// Bytes of the JSON of [`merged_document`] at most, whatever the nodes.
///
/// # Errors
/// [`Refused::TooWide`].
pub(super) fn widest_merged(
    head: &TileHead,
    low: [u32; 3],
    encoded: EncodedBody,
) -> Result<usize, Refused> {
    let json = merged_document(head, low, encoded, &[Node::widest()])?.json;
    // more pieces make numbers longer, which have ten digits at most: where each column begins and how long it is,
    // how many features and rows there are, and how long the buffer is
    let numbers = 2 * columns(&[]).len() + 3;
    Ok(json.len() + 9 * numbers)
}

/// The views behind those of positions and normals.
const INDICES: usize = 2;
const ROWS: usize = 3;
const COLOURS: usize = 4;

/// True if some of the pieces have a colour.
fn is_painted(nodes: &[Node]) -> bool {
    nodes.iter().any(|n| n.colour.is_some())
}

/// The vertex colours of the pieces, if any has one.
pub(super) fn colours(nodes: &[Node]) -> Option<Vec<[u8; 8]>> {
    let all = nodes.iter().map(|n| vertex_colour(n.colour));
    is_painted(nodes).then(|| all.collect())
}

/// The property table: its columns' kinds, where their values are, and these.
struct Table {
    kinds: Map<String, Value>,
    values: Map<String, Value>,
    /// From where the geometry ends.
    bytes: Vec<u8>,
}

impl Table {
    /// Puts the columns of the pieces behind the geometry.
    fn new(nodes: &[Node], views: &mut Views) -> Self {
        let rows: Vec<&Extras> = nodes.iter().map(|n| &n.extras).collect();
        let mut table = Table {
            kinds: Map::new(),
            values: Map::new(),
            bytes: Vec::new(),
        };
        // the geometry ends on a multiple of 8 bytes
        let geometry = views.end.next_multiple_of(8);
        for column in columns(&rows) {
            let mut kind = json!({"type": "SCALAR", "componentType": column.kind});
            if let Some(value) = column.no_data {
                kind["noData"] = value;
            }
            table.kinds.insert(column.name.into(), kind);
            let at = views.plain(Section::Column(column.bytes.len()));
            let start = views.end - geometry - column.bytes.len();
            table.bytes.resize(start, 0);
            table.bytes.extend_from_slice(&column.bytes);
            table
                .values
                .insert(column.name.into(), json!({"values": at}));
        }
        table.bytes.resize(table.bytes.len().next_multiple_of(4), 0);
        table
    }

    /// EXT_structural_metadata with this one table.
    fn extension(&self, nodes: &[Node]) -> Value {
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
