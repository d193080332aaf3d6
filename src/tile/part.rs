//! A tile with some of its pieces left out or painted: geometry is copied, bit for bit.

use super::body::write_indices;
use super::document::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, UNSIGNED_INT, UNSIGNED_SHORT, accessors, coordinate,
    geometry_views, material, write_head,
};
use super::glb::{Fault, Glb, ReadError, fail};
use super::pieces::{Piece, pieces};
use super::read::{PieceIds, Pieces, Tile};
use super::{Body, BodyPiece};
use crate::manifest::Primitives;
use crate::strip::append_strip;
use bytemuck::Zeroable;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// glTF's component type of vertex colours.
const UNSIGNED_BYTE: u32 = 5121;

/// A colour as screens have it: sRGB, red first.
pub type Rgb = [u8; 3];

/// What [`part`] made of a tile.
#[derive(Debug)]
pub struct Part {
    /// The file; its pieces are in the order of the source.
    pub file: Vec<u8>,
    /// What was kept.
    pub pieces: Vec<PartPiece>,
    /// Index entries.
    pub indices: u64,
}

/// A piece that was kept.
#[derive(Debug, Clone, Copy)]
pub struct PartPiece {
    /// Its ids and triangles.
    pub ids: PieceIds,
    /// Its vertices.
    pub vertices: u64,
    /// Strips before stitching; 0 for lists.
    pub strips: u64,
    /// 6 times the signed volume that its triangles span with the origin, in lattice units.
    pub volume6: i128,
    /// Vertices outside the grid, which only caps have, without those on the tile's lower planes:
    /// so each is counted in one tile.
    pub outside: u64,
    /// Box of its vertices in lattice steps.
    pub bounds: [[i32; 3]; 2],
}

/// Makes the part of a tile whose pieces get a style: `None` leaves a piece out, `Some(None)` gives
/// it the common grey. `None` if nothing is left.
///
/// The layout stays: a merged tile is merged however few pieces are left. Colours are materials, in
/// the merged layout vertex colours. Colours that the source has are not kept.
///
/// # Errors
/// [`ReadError`] if the tile cannot be read, or its indices or positions are none of a tile's, or the
/// part passes 4 GiB.
pub fn part(
    bytes: &[u8],
    tile_at: &TilePlace,
    style: impl Fn(&PieceIds) -> Option<Option<Rgb>>,
) -> Result<Option<Part>, ReadError> {
    let tile = Tile::read(bytes)?;
    let source = Source {
        glb: Glb::split(bytes)?,
        primitives: tile_at.primitives,
        merged: matches!(
            tile.primitives.first().map(|p| &p.pieces),
            Some(Pieces::Merged(..))
        ),
    };
    let all = pieces(&tile, tile_at.primitives)?;
    let kept: Vec<(usize, Piece, Option<Rgb>)> = all
        .into_iter()
        .enumerate()
        .filter_map(|(i, p)| style(&p.ids).map(|s| (i, p, s)))
        .collect();
    if kept.is_empty() {
        return Ok(None);
    }
    let measured: Vec<PartPiece> = kept
        .iter()
        .map(|(_, p, _)| measure(p, tile_at))
        .collect::<Result<_, _>>()?;
    let (file, indices) = if source.merged {
        source.merged(&kept, &measured)?
    } else {
        source.nodes(&kept, &measured)?
    };
    Ok(Some(Part {
        file,
        pieces: measured,
        indices,
    }))
}

/// What the index knows of a tile.
#[derive(Debug, Clone, Copy)]
pub struct TilePlace {
    /// Kind of primitives.
    pub primitives: Primitives,
    /// Its lowest voxel.
    pub low: [u32; 3],
    /// Voxels of the grid.
    pub dims: [u32; 3],
}

/// Counts and sums of a piece.
fn measure(piece: &Piece, at: &TilePlace) -> Result<PartPiece, ReadError> {
    let end = at.dims.map(|n| (n as i32 - 1) * 256);
    let low = at.low.map(|v| v as i32 * 256);
    let points = piece.lattice()?;
    let outside = |p: &&[i32; 3]| {
        let out = (0..3).any(|a| p[a] < 0 || p[a] > end[a]);
        // a vertex on the lower plane is in the tile before as well
        out && (0..3).all(|a| low[a] == 0 || p[a] != low[a])
    };
    let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
    for p in &points {
        for a in 0..3 {
            bounds[0][a] = bounds[0][a].min(p[a]);
            bounds[1][a] = bounds[1][a].max(p[a]);
        }
    }
    let mut volume6 = 0i128;
    let mut triangles = 0;
    piece.triangles(at.primitives, |t| {
        triangles += 1;
        let [a, b, c] = t.map(|i| points[i as usize].map(i64::from));
        let cross = |u: usize, v: usize| i128::from(b[u] * c[v] - b[v] * c[u]);
        volume6 += i128::from(a[0]) * cross(1, 2)
            + i128::from(a[1]) * cross(2, 0)
            + i128::from(a[2]) * cross(0, 1);
    });
    if triangles != piece.ids.triangles {
        return fail(
            Fault::Extras,
            "",
            format!(
                "a piece of cell {} states {} triangles and has {triangles}",
                piece.ids.cell, piece.ids.triangles
            ),
        );
    }
    Ok(PartPiece {
        ids: piece.ids,
        vertices: piece.positions.len() as u64,
        strips: match at.primitives {
            Primitives::Strips => piece.strips(),
            Primitives::Triangles => 0,
        },
        volume6,
        outside: points.iter().filter(outside).count() as u64,
        bounds,
    })
}

type Kept<'a> = [(usize, Piece<'a>, Option<Rgb>)];

struct Source<'a> {
    glb: Glb<'a>,
    primitives: Primitives,
    merged: bool,
}

impl Source<'_> {
    fn document(&self) -> Result<Value, ReadError> {
        serde_json::from_slice(self.glb.json).or_else(|e| fail(Fault::Json, "", e.to_string()))
    }

    /// The file of a part in node layout, and its index entries.
    fn nodes(&self, kept: &Kept, measured: &[PartPiece]) -> Result<(Vec<u8>, u64), ReadError> {
        let (body, bin) = body(kept, measured);
        let mut doc = self.document()?;
        let mut paints = Paints::default();
        let mut nodes = vec![doc["nodes"][0].take()];
        nodes[0]["children"] = (1..=kept.len()).collect();
        let mut meshes = Vec::with_capacity(kept.len());
        let mut all_accessors = Vec::with_capacity(3 * kept.len());
        for (i, ((from, _, colour), piece)) in kept.iter().zip(&body.pieces).enumerate() {
            let mut node = doc["nodes"][from + 1].take();
            node["mesh"] = i.into();
            nodes.push(node);
            let mut mesh = doc["meshes"][*from].take();
            let primitive = &mut mesh["primitives"][0];
            primitive["attributes"] = json!({"POSITION": 3 * i, "NORMAL": 3 * i + 1});
            primitive["indices"] = (3 * i + 2).into();
            primitive["material"] = paints.index(*colour).into();
            meshes.push(mesh);
            all_accessors.extend(accessors(&body, piece));
        }
        doc["nodes"] = nodes.into();
        doc["meshes"] = meshes.into();
        doc["accessors"] = all_accessors.into();
        doc["bufferViews"] = geometry_views(&body).into();
        doc["buffers"] = json!([{"byteLength": body.bytes}]);
        doc["materials"] = paints.materials.into();
        let indices = body.pieces.iter().map(|p| u64::from(p.indices)).sum();
        Ok((file(&doc, &bin)?, indices))
    }

    /// The file of a part in merged layout, and its index entries.
    fn merged(&self, kept: &Kept, measured: &[PartPiece]) -> Result<(Vec<u8>, u64), ReadError> {
        let mut doc = self.document()?;
        let vertices: usize = kept.iter().map(|(_, p, _)| p.positions.len()).sum();
        let indices = joined(kept, self.primitives);
        let wide = vertices > 65_535;
        let width = if wide { UNSIGNED_INT } else { UNSIGNED_SHORT };
        let mut bin = Bin::default();
        bin.push_geometry(kept, &indices, wide);
        self.columns(&mut doc, kept, &mut bin)?;
        let accessor = |view: usize, kind: u32, count: usize, shape: &str| json!({"bufferView": view, "byteOffset": 0, "componentType": kind, "count": count, "type": shape});
        let mut list = vec![
            accessor(0, FLOAT, vertices, "VEC3"),
            accessor(1, FLOAT, vertices, "VEC3"),
            accessor(2, width, indices.len(), "SCALAR"),
            accessor(3, FLOAT, vertices, "SCALAR"),
        ];
        let bound = |which: usize, pick: fn(i32, i32) -> i32| -> [f32; 3] {
            let all = measured.iter().map(|p| p.bounds[which]);
            let folded = all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])));
            folded.unwrap_or_default().map(coordinate)
        };
        list[0]["min"] = json!(bound(0, i32::min));
        list[0]["max"] = json!(bound(1, i32::max));
        let mut attributes = json!({"POSITION": 0, "NORMAL": 1, "_FEATURE_ID_0": 3});
        let mut plain = material();
        if kept.iter().any(|(_, _, c)| c.is_some()) {
            let mut colour = accessor(bin.push_colours(kept), UNSIGNED_BYTE, vertices, "VEC4");
            colour["normalized"] = true.into();
            attributes["COLOR_0"] = list.len().into();
            list.push(colour);
            // vertex colours multiply the factor
            plain["pbrMetallicRoughness"]["baseColorFactor"] = json!([1.0, 1.0, 1.0, 1.0]);
        }
        let primitive = &mut doc["meshes"][0]["primitives"][0];
        primitive["attributes"] = attributes;
        primitive["indices"] = 2.into();
        primitive["material"] = 0.into();
        primitive["extensions"]["EXT_mesh_features"]["featureIds"][0]["featureCount"] =
            kept.len().into();
        doc["materials"] = json!([plain]);
        doc["accessors"] = list.into();
        doc["bufferViews"] = bin.views.into();
        doc["buffers"] = json!([{"byteLength": bin.bytes.len()}]);
        Ok((file(&doc, &bin.bytes)?, indices.len() as u64))
    }

    /// Copies the kept rows of the property table.
    fn columns(&self, doc: &mut Value, kept: &Kept, bin: &mut Bin) -> Result<(), ReadError> {
        const AT: &str = "/extensions/EXT_structural_metadata/propertyTables/0";
        let views = doc["bufferViews"].take();
        let tables = &mut doc["extensions"]["EXT_structural_metadata"]["propertyTables"];
        if tables.as_array().map(Vec::len) != Some(1) {
            return fail(Fault::Structure, AT, "expected one property table");
        }
        let table = &mut tables[0];
        let count = table["count"].as_u64().unwrap_or(0) as usize;
        table["count"] = kept.len().into();
        let Some(properties) = table["properties"].as_object_mut() else {
            return fail(Fault::Structure, AT, "expected properties");
        };
        for (name, property) in properties {
            let view = &views[property["values"].as_u64().unwrap_or(u64::MAX) as usize];
            let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
            let length = view["byteLength"].as_u64().unwrap_or(0) as usize;
            let bytes = start
                .checked_add(length)
                .and_then(|end| self.glb.bin.get(start..end));
            let (Some(bytes), 0) = (bytes, length.checked_rem(count).unwrap_or(1)) else {
                return fail(
                    Fault::Accessor,
                    format!("{AT}/properties/{name}"),
                    format!("expected values for {count} rows in the file"),
                );
            };
            let size = length / count;
            let rows = kept
                .iter()
                .filter_map(|(i, _, _)| bytes.get(i * size..(i + 1) * size));
            let at = bin.push(rows.flatten().copied(), None, None);
            property["values"] = at.into();
        }
        Ok(())
    }
}

/// A BIN chunk in the making: every view starts on a multiple of 8 bytes.
#[derive(Default)]
struct Bin {
    bytes: Vec<u8>,
    views: Vec<Value>,
}

impl Bin {
    fn push(
        &mut self,
        data: impl Iterator<Item = u8>,
        stride: Option<u32>,
        target: Option<u32>,
    ) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(data);
        let mut view =
            json!({"buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start});
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.views.len() - 1
    }
}

impl Bin {
    /// Views 0 to 3: positions, normals, indices, and the row of each vertex.
    fn push_geometry(&mut self, kept: &Kept, indices: &[u32], wide: bool) {
        let positions = kept.iter().flat_map(|(_, p, _)| p.positions.iter());
        self.push(positions.flat_map(vec3), Some(12), Some(ARRAY_BUFFER));
        let normals = kept.iter().flat_map(|(_, p, _)| p.normals.iter());
        self.push(normals.flat_map(vec3), Some(12), Some(ARRAY_BUFFER));
        let target = Some(ELEMENT_ARRAY_BUFFER);
        if wide {
            self.push(indices.iter().flat_map(|i| i.to_le_bytes()), None, target);
        } else {
            let narrow = indices.iter().flat_map(|i| (*i as u16).to_le_bytes());
            self.push(narrow, None, target);
        }
        let rows = kept.iter().enumerate().flat_map(|(i, (_, p, _))| {
            std::iter::repeat_n((i as f32).to_le_bytes(), p.positions.len())
        });
        self.push(rows.flatten(), None, Some(ARRAY_BUFFER));
    }

    /// The colour of each vertex; returns the view.
    fn push_colours(&mut self, kept: &Kept) -> usize {
        let colours = kept.iter().flat_map(|(_, p, colour)| {
            std::iter::repeat_n(vertex_colour(*colour), p.positions.len())
        });
        self.push(colours.flatten(), Some(4), Some(ARRAY_BUFFER))
    }
}

/// The body of the kept pieces in node layout, and its bytes.
fn body(kept: &Kept, measured: &[PartPiece]) -> (Body, Vec<u8>) {
    let mut bin: Vec<u8> = Vec::new();
    bin.extend(
        kept.iter()
            .flat_map(|(_, p, _)| p.positions.iter())
            .flat_map(vec3),
    );
    bin.extend(
        kept.iter()
            .flat_map(|(_, p, _)| p.normals.iter())
            .flat_map(vec3),
    );
    let mut body = Body {
        vertices: kept.iter().map(|(_, p, _)| p.positions.len() as u32).sum(),
        ..Body::default()
    };
    let mut first_vertex = 0;
    for ((_, p, _), m) in kept.iter().zip(measured) {
        let mut piece = BodyPiece::zeroed();
        piece.first_index_byte = bin.len() as u64;
        piece.first_vertex = first_vertex;
        piece.vertices = p.positions.len() as u32;
        piece.indices = p.indices.len() as u32;
        [piece.min, piece.max] = m.bounds;
        first_vertex += piece.vertices;
        write_indices(&piece, &p.indices, &mut bin);
        body.pieces.push(piece);
    }
    body.bytes = bin.len() as u64;
    (body, bin)
}

/// All pieces' indices as one list or stitched strip.
fn joined(kept: &Kept, primitives: Primitives) -> Vec<u32> {
    let mut all = Vec::new();
    let mut first = 0;
    for (_, piece, _) in kept {
        match primitives {
            Primitives::Strips => append_strip(&mut all, &piece.indices, first),
            Primitives::Triangles => all.extend(piece.indices.iter().map(|i| i + first)),
        }
        first += piece.positions.len() as u32;
    }
    all
}

fn vec3(v: &[f32; 3]) -> impl Iterator<Item = u8> + use<> {
    v.map(f32::to_le_bytes).into_iter().flatten()
}

/// Puts JSON and BIN chunk together; the BIN chunk's data starts on a multiple of 8 bytes.
fn file(doc: &Value, bin: &[u8]) -> Result<Vec<u8>, ReadError> {
    let json = doc.to_string().into_bytes();
    let room = (json.len() + 28).next_multiple_of(8) - 28;
    let Some(mut file) = write_head(&json, room, bin.len() as u64) else {
        return fail(Fault::Container, "", "the part would pass 4 GiB");
    };
    file.extend_from_slice(bin);
    Ok(file)
}

/// The materials of a tile, each once.
#[derive(Default)]
struct Paints {
    known: BTreeMap<Option<Rgb>, usize>,
    materials: Vec<Value>,
}

impl Paints {
    fn index(&mut self, colour: Option<Rgb>) -> usize {
        let next = self.materials.len();
        let index = *self.known.entry(colour).or_insert(next);
        if index == next {
            let mut paint = material();
            if let Some([r, g, b]) = colour {
                paint["name"] = format!("colour_{r:02x}{g:02x}{b:02x}").into();
                let [r, g, b] = [r, g, b].map(|v| (linear(v) * 1e6).round() / 1e6);
                paint["pbrMetallicRoughness"]["baseColorFactor"] = json!([r, g, b, 1.0]);
            }
            self.materials.push(paint);
        }
        index
    }
}

/// A channel of sRGB (IEC 61966-2-1) as light, 0 to 1: glTF's factors and vertex colours are linear.
pub fn linear(channel: u8) -> f64 {
    let v = f64::from(channel) / 255.0;
    if v <= 0.040_45 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

/// A colour as a vertex has it; none is the common grey, 0.8.
fn vertex_colour(colour: Option<Rgb>) -> [u8; 4] {
    match colour {
        Some(rgb) => {
            let [r, g, b] = rgb.map(|v| (linear(v) * 255.0).round() as u8);
            [r, g, b, 255]
        }
        None => [204, 204, 204, 255],
    }
}
