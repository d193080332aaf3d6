//! Reading a tile back: from the bytes of a GLB to its surface pieces, without copying geometry.
//!
//! Everything the file says is checked against its real size before it is used, so a damaged or
//! hostile file gives a [`ReadError`], never a panic or an allocation larger than the file.

use super::glb::{Result, fail};
use super::json::{self, Document};

pub use super::glb::{Fault, Glb, ReadError};

/// Three little-endian `f32` per element.
#[derive(Debug, Clone, Copy)]
pub struct Vec3s<'a>(&'a [u8]);

impl<'a> Vec3s<'a> {
    /// Number of vectors.
    pub fn len(self) -> usize {
        self.0.len() / 12
    }

    /// True if there is none.
    pub fn is_empty(self) -> bool {
        self.0.is_empty()
    }

    /// The vectors in order.
    pub fn iter(self) -> impl ExactSizeIterator<Item = [f32; 3]> + 'a {
        let (elements, _) = self.0.as_chunks::<12>();
        elements.iter().map(|e| {
            let at = |i: usize| f32::from_le_bytes([e[i], e[i + 1], e[i + 2], e[i + 3]]);
            [at(0), at(4), at(8)]
        })
    }
}

/// The indices of a primitive.
#[derive(Debug, Clone, Copy)]
pub enum Indices<'a> {
    /// Little-endian 16-bit.
    U16(&'a [[u8; 2]]),
    /// Little-endian 32-bit.
    U32(&'a [[u8; 4]]),
}

impl Indices<'_> {
    /// Number of indices.
    pub fn len(self) -> usize {
        match self {
            Indices::U16(v) => v.len(),
            Indices::U32(v) => v.len(),
        }
    }

    /// True if there is none.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Replaces the contents of `out` by the indices.
    pub fn read_into(self, out: &mut Vec<u32>) {
        out.clear();
        match self {
            Indices::U16(v) => out.extend(v.iter().map(|&b| u32::from(u16::from_le_bytes(b)))),
            Indices::U32(v) => out.extend(v.iter().map(|&b| u32::from_le_bytes(b))),
        }
    }
}

/// The ids of a surface piece, as the tile's node or property table states them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PieceIds {
    /// The cell; 0 for a cap.
    pub cell: u64,
    /// The object.
    pub object: u64,
    /// The surface; 0 for a cap.
    pub surface: u64,
    /// Triangles of the piece in this tile, degenerates not counted.
    pub triangles: u64,
}

/// One primitive with the node that shows it.
#[derive(Debug, Clone)]
pub struct Primitive<'a> {
    /// Index of the node.
    pub node: usize,
    /// Name of the node.
    pub name: String,
    /// Name of the mesh.
    pub mesh_name: String,
    /// glTF mode: 4 for a list of triangles, 5 for a strip.
    pub mode: u32,
    /// Positions in voxel coordinates.
    pub positions: Vec3s<'a>,
    /// The position accessor's `min`.
    pub min: [f64; 3],
    /// The position accessor's `max`.
    pub max: [f64; 3],
    /// Normals; as many as positions.
    pub normals: Vec3s<'a>,
    /// Indices into positions.
    pub indices: Indices<'a>,
    /// The piece or pieces that the primitive holds.
    pub pieces: Pieces<'a>,
}

/// Which surface pieces a primitive holds.
#[derive(Debug, Clone)]
pub enum Pieces<'a> {
    /// The node layout: one piece.
    One(PieceIds),
    /// The merged layout: the row of each vertex, as a float, and the rows of the table.
    Merged(&'a [[u8; 4]], Vec<PieceIds>),
}

/// A tile whose structure has been checked.
#[derive(Debug, Clone)]
pub struct Tile<'a> {
    /// The root node's matrix, column-major.
    pub matrix: [f64; 16],
    /// The primitives by rising node index.
    pub primitives: Vec<Primitive<'a>>,
}

impl<'a> Tile<'a> {
    /// Reads the bytes of a tile's file.
    ///
    /// Names, ids, modes and numbers are handed out as found; only what is needed to reach them
    /// safely is checked: the layout that [`crate::tile`] describes, types, bounds and alignment.
    ///
    /// # Errors
    /// [`ReadError`] with the kind and place of the first damage.
    pub fn read(bytes: &'a [u8]) -> Result<Self> {
        let glb = Glb::split(bytes)?;
        let doc: Document =
            serde_json::from_slice(glb.json).or_else(|e| fail(Fault::Json, "", e.to_string()))?;
        let matrix = root_matrix(&doc)?;
        let reader = Reader {
            doc: &doc,
            bin: glb.bin,
        };
        let mut used = vec![false; doc.accessors.len()];
        let mut primitives = Vec::with_capacity(doc.meshes.len());
        for mesh in 0..doc.meshes.len() {
            primitives.push(reader.primitive(mesh, &mut used)?);
        }
        Ok(Tile { matrix, primitives })
    }
}

/// Checks asset, scene and the root node with its children 1..n.
fn root_matrix(doc: &Document) -> Result<[f64; 16]> {
    let bad = |place: &str, message: String| fail(Fault::Structure, place, message);
    if doc.asset.version != "2.0" {
        return bad(
            "/asset/version",
            format!("found {:?}, expected \"2.0\"", doc.asset.version),
        );
    }
    if let Some(name) = doc.extensions_required.first() {
        return bad(
            "/extensionsRequired",
            format!("found {name}, expected none"),
        );
    }
    let scene = doc.scenes.first().map_or(&[][..], |s| &s.nodes);
    if doc.scene != Some(0) || doc.scenes.len() != 1 || scene != [0] {
        return bad(
            "/scenes",
            format!(
                "found scene {:?} of {} with nodes {scene:?}, expected scene 0 of 1 with node 0",
                doc.scene,
                doc.scenes.len()
            ),
        );
    }
    let (Some(root), n) = (doc.nodes.first(), doc.meshes.len()) else {
        return bad("/nodes", "found none, expected a root node".into());
    };
    if root.name != "alvis" || root.mesh.is_some() || has_trs(root) {
        return bad(
            "/nodes/0",
            format!(
                "found node {:?}, expected \"alvis\" with a matrix and without a mesh",
                root.name
            ),
        );
    }
    if n == 0 || doc.nodes.len() != n + 1 || !root.children.iter().copied().eq(1..=n) {
        return bad(
            "/nodes/0/children",
            format!(
                "found {} children, {} nodes and {n} meshes, expected children 1 to n, a node and a mesh for each",
                root.children.len(),
                doc.nodes.len()
            ),
        );
    }
    match root.matrix {
        Some(matrix) => Ok(matrix),
        None => bad("/nodes/0/matrix", "found none, expected 16 numbers".into()),
    }
}

fn has_trs(node: &json::Node) -> bool {
    node.translation.is_some() || node.rotation.is_some() || node.scale.is_some()
}

struct Reader<'d, 'a> {
    doc: &'d Document,
    bin: &'a [u8],
}

/// What an accessor must be.
struct Want {
    component: u32,
    kind: &'static str,
    bytes: u64,
}

const VEC3: Want = Want {
    component: json::FLOAT,
    kind: "VEC3",
    bytes: 12,
};
const SCALAR: Want = Want {
    component: json::FLOAT,
    kind: "SCALAR",
    bytes: 4,
};

impl<'a> Reader<'_, 'a> {
    /// Reads mesh `mesh` and its node, `mesh + 1`.
    fn primitive(&self, mesh: usize, used: &mut [bool]) -> Result<Primitive<'a>> {
        let node_index = mesh + 1;
        let node = &self.doc.nodes[node_index];
        let prim = self.shown(mesh)?;
        let place = format!("/meshes/{mesh}/primitives/0");
        let mut take = |name: &str, index: Option<usize>| -> Result<usize> {
            match index {
                Some(i) if i < used.len() && !used[i] => {
                    used[i] = true;
                    Ok(i)
                }
                _ => fail(
                    Fault::Structure,
                    &place,
                    format!("{name}: found accessor {index:?}, expected one of its own"),
                ),
            }
        };
        let attribute = |name: &str| prim.attributes.get(name).copied();
        let positions_at = take("POSITION", attribute("POSITION"))?;
        let normals_at = take("NORMAL", attribute("NORMAL"))?;
        let indices_at = take("indices", prim.indices)?;
        let positions = Vec3s(self.accessor(positions_at, &VEC3)?);
        let normals = Vec3s(self.accessor(normals_at, &VEC3)?);
        if positions.len() != normals.len() {
            return fail(
                Fault::Accessor,
                place,
                format!(
                    "found {} normals for {} positions",
                    normals.len(),
                    positions.len()
                ),
            );
        }
        let pieces = match attribute("_FEATURE_ID_0") {
            None => Pieces::One(self.extras(node_index)?),
            Some(ids) => {
                let at = take("_FEATURE_ID_0", Some(ids))?;
                let rows = self.accessor(at, &SCALAR)?.as_chunks::<4>().0;
                if rows.len() != positions.len() || self.doc.meshes.len() != 1 {
                    return fail(
                        Fault::Structure,
                        place,
                        "a merged tile has one mesh with a feature id for each vertex",
                    );
                }
                Pieces::Merged(rows, super::features::rows(self.doc, self.bin, prim)?)
            }
        };
        Ok(Primitive {
            node: node_index,
            name: node.name.clone(),
            mesh_name: self.doc.meshes[mesh].name.clone(),
            mode: prim.mode.unwrap_or(4),
            min: self.bound(positions_at, "min")?,
            max: self.bound(positions_at, "max")?,
            positions,
            normals,
            indices: self.indices(indices_at)?,
            pieces,
        })
    }

    /// The one primitive of mesh `mesh`, whose node must show it as it is.
    fn shown(&self, mesh: usize) -> Result<&json::Primitive> {
        let node = &self.doc.nodes[mesh + 1];
        let place = format!("/nodes/{}", mesh + 1);
        if node.mesh != Some(mesh)
            || !node.children.is_empty()
            || node.matrix.is_some()
            || has_trs(node)
        {
            return fail(
                Fault::Structure,
                place,
                format!(
                    "expected a node with mesh {mesh}, no children and no transform of its own"
                ),
            );
        }
        let place = format!("/meshes/{mesh}/primitives");
        let [prim] = self.doc.meshes[mesh].primitives.as_slice() else {
            return fail(
                Fault::Structure,
                place,
                format!(
                    "found {} primitives, expected 1",
                    self.doc.meshes[mesh].primitives.len()
                ),
            );
        };
        if prim.material.is_some_and(|m| m >= self.doc.materials.len()) {
            return fail(Fault::Structure, place, "its material does not exist");
        }
        Ok(prim)
    }

    fn extras(&self, node: usize) -> Result<PieceIds> {
        let extras = &self.doc.nodes[node].extras;
        let place = format!("/nodes/{node}/extras");
        if let Some(message) = &extras.bad {
            return fail(Fault::Extras, place, message.clone());
        }
        match (extras.cell, extras.object, extras.surface, extras.triangles) {
            (Some(cell), Some(object), Some(surface), Some(triangles)) => Ok(PieceIds {
                cell,
                object,
                surface,
                triangles,
            }),
            _ => fail(
                Fault::Extras,
                place,
                "expected cell, object, surface and triangles",
            ),
        }
    }

    /// The bytes of accessor `index`, which must be tightly packed and of the wanted type.
    fn accessor(&self, index: usize, want: &Want) -> Result<&'a [u8]> {
        let a = &self.doc.accessors[index];
        let place = format!("/accessors/{index}");
        if a.component_type != want.component
            || a.kind != want.kind
            || a.normalized
            || a.sparse.is_some()
        {
            return fail(
                Fault::Accessor,
                place,
                format!(
                    "found {} of component type {}, expected plain {} of {}",
                    a.kind, a.component_type, want.kind, want.component
                ),
            );
        }
        if a.count == 0 {
            return fail(Fault::Accessor, place, "its count is 0");
        }
        let component = if want.component == json::UNSIGNED_SHORT {
            2
        } else {
            4
        };
        let bytes = a.buffer_view.map(|v| {
            let stride = self.doc.buffer_views.get(v).and_then(|v| v.byte_stride);
            (stride.is_none_or(|s| s == want.bytes), v)
        });
        let Some((true, view)) = bytes else {
            return fail(
                Fault::Accessor,
                place,
                format!("expected a buffer view with stride {}", want.bytes),
            );
        };
        let body = view_bytes(self.doc, self.bin, view)?;
        let start = a.byte_offset;
        let end = a
            .count
            .checked_mul(want.bytes)
            .and_then(|n| n.checked_add(start));
        let in_file = self.doc.buffer_views[view]
            .byte_offset
            .saturating_add(start);
        match end {
            Some(end) if end <= body.len() as u64 && in_file.is_multiple_of(component) => {
                Ok(&body[start as usize..end as usize])
            }
            _ => fail(
                Fault::Accessor,
                place,
                format!(
                    "{} elements of {} bytes at byte {start} do not lie, aligned, in its view of {} bytes",
                    a.count,
                    want.bytes,
                    body.len()
                ),
            ),
        }
    }

    fn indices(&self, index: usize) -> Result<Indices<'a>> {
        let want = |component, bytes| Want {
            component,
            kind: "SCALAR",
            bytes,
        };
        if self.doc.accessors[index].component_type == json::UNSIGNED_SHORT {
            let bytes = self.accessor(index, &want(json::UNSIGNED_SHORT, 2))?;
            Ok(Indices::U16(bytes.as_chunks::<2>().0))
        } else {
            let bytes = self.accessor(index, &want(json::UNSIGNED_INT, 4))?;
            Ok(Indices::U32(bytes.as_chunks::<4>().0))
        }
    }

    fn bound(&self, accessor: usize, which: &str) -> Result<[f64; 3]> {
        let a = &self.doc.accessors[accessor];
        let values = if which == "min" { &a.min } else { &a.max };
        match values.as_deref().and_then(|v| <[f64; 3]>::try_from(v).ok()) {
            Some(v) => Ok(v),
            None => fail(
                Fault::Accessor,
                format!("/accessors/{accessor}/{which}"),
                "expected three numbers",
            ),
        }
    }
}

/// The bytes of buffer view `view`.
pub(super) fn view_bytes<'a>(doc: &Document, bin: &'a [u8], view: usize) -> Result<&'a [u8]> {
    let place = format!("/bufferViews/{view}");
    let Some(v) = doc.buffer_views.get(view) else {
        return fail(Fault::Accessor, place, "it does not exist");
    };
    let length = match doc.buffers.as_slice() {
        [b] if b.uri.is_none() => b.byte_length,
        _ => {
            return fail(
                Fault::Accessor,
                "/buffers",
                "expected one buffer, the BIN chunk",
            );
        }
    };
    // the chunk is padded to a multiple of 4, the buffer need not be
    if length > bin.len() as u64 || bin.len() as u64 - length > 3 {
        return fail(
            Fault::Accessor,
            "/buffers/0",
            format!("states {length} bytes, the BIN chunk has {}", bin.len()),
        );
    }
    let end = v.byte_offset.checked_add(v.byte_length);
    match end {
        Some(end) if v.buffer == 0 && end <= length => {
            Ok(&bin[v.byte_offset as usize..end as usize])
        }
        _ => fail(
            Fault::Accessor,
            place,
            format!(
                "{} bytes at byte {} of buffer {} do not lie in the buffer of {length} bytes",
                v.byte_length, v.byte_offset, v.buffer
            ),
        ),
    }
}
