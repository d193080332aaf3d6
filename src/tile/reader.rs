//! The primitives of a tile: accessors of the right type, inside the file, each used once.

use super::read::{PieceIds, Pieces, Primitive, Rows};
use crate::gltf::accessors::{Indices, Normals, Positions};
use crate::gltf::buffer_views::{Buffers, Bytes};
use crate::gltf::container::{Fault, Result, fail};
use crate::gltf::read_json::{self, Document};
use crate::gltf::{BYTE, FLOAT, UNSIGNED_INT, UNSIGNED_SHORT};
use crate::grid::{LATTICE, MAX_DIM};
use crate::manifest::Encoding;

pub(super) struct Reader<'d, 'a> {
    pub doc: &'d Document,
    pub buffers: &'d Buffers<'a>,
    pub encoding: Encoding,
}

/// What an accessor must be.
struct Want {
    component: u32,
    kind: &'static str,
    normalized: bool,
    /// Bytes from one element to the next.
    stride: u64,
    /// True if an element fills its stride, so that the view need not state it.
    tight: bool,
}

const fn tight(component: u32, kind: &'static str, stride: u64) -> Want {
    Want {
        component,
        kind,
        normalized: false,
        stride,
        tight: true,
    }
}

const VEC3: Want = tight(FLOAT, "VEC3", 12);
const SCALAR: Want = tight(FLOAT, "SCALAR", 4);
const NARROW: Want = tight(UNSIGNED_SHORT, "SCALAR", 2);
const WIDE: Want = tight(UNSIGNED_INT, "SCALAR", 4);
const STEPS: Want = Want {
    component: UNSIGNED_SHORT,
    kind: "VEC3",
    normalized: false,
    stride: 8,
    tight: false,
};
const SMALL_NORMALS: Want = Want {
    component: BYTE,
    kind: "VEC3",
    normalized: true,
    stride: 4,
    tight: false,
};
const COLOURS: Want = Want {
    component: UNSIGNED_SHORT,
    kind: "VEC4",
    normalized: true,
    stride: 8,
    tight: true,
};

impl<'a> Reader<'_, 'a> {
    /// Reads mesh `mesh` and its node, `mesh + 1`.
    pub fn primitive(&self, mesh: usize, used: &mut [bool]) -> Result<Primitive<'a>> {
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
        let base = self.base(node_index)?;
        let (points, vectors) = match base {
            None => (&VEC3, &VEC3),
            Some(_) => (&STEPS, &SMALL_NORMALS),
        };
        let positions = Positions {
            bytes: self.accessor(positions_at, points)?,
            base: base.map(|b| b.map(|v| v as f32)),
        };
        let normals = Normals {
            bytes: self.accessor(normals_at, vectors)?,
            quantized: base.is_some(),
        };
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
        let (pieces, measured) = match attribute("_FEATURE_ID_0") {
            None => {
                let ids = self.extras(node_index)?;
                (Pieces::One(ids), vec![node.extras.measured])
            }
            Some(ids) => {
                let at = take("_FEATURE_ID_0", Some(ids))?;
                let rows = Rows(self.accessor(at, &SCALAR)?);
                if rows.get().len() != positions.len() || self.doc.meshes.len() != 1 {
                    return fail(
                        Fault::Structure,
                        place,
                        "a merged tile has one mesh with a feature id for each vertex",
                    );
                }
                let ids = super::features::rows(self.doc, self.buffers, prim)?;
                let measured = super::features::measured(self.doc, self.buffers, ids.len())?;
                (Pieces::Merged(rows, ids), measured)
            }
        };
        let colours = match attribute("COLOR_0") {
            None => None,
            Some(colours) => {
                let at = take("COLOR_0", Some(colours))?;
                Some(self.accessor(at, &COLOURS)?)
            }
        };
        if colours
            .as_ref()
            .is_some_and(|c| c.chunks::<8>().len() != positions.len())
        {
            return fail(Fault::Accessor, place, "expected a colour for each vertex");
        }
        let material = prim.material.and_then(|m| self.doc.materials.get(m));
        Ok(Primitive {
            node: node_index,
            name: node.name.clone(),
            mesh_name: self.doc.meshes[mesh].name.clone(),
            material: material.map_or(String::new(), |m| m.name.clone()),
            mode: prim.mode.unwrap_or(4),
            min: self.bound(positions_at, "min", base)?,
            max: self.bound(positions_at, "max", base)?,
            positions,
            normals,
            indices: self.indices(indices_at)?,
            pieces,
            measured,
            colours,
        })
    }

    /// The corner in voxels that a node's positions count from, by its translation; nothing for
    /// floats, whose nodes have no transform.
    fn base(&self, node: usize) -> Result<Option<[f64; 3]>> {
        let n = &self.doc.nodes[node];
        if self.encoding == Encoding::Float {
            if n.matrix.is_some() || n.has_trs() {
                let message = "expected no transform of its own";
                return fail(Fault::Structure, format!("/nodes/{node}"), message);
            }
            return Ok(None);
        }
        let whole = |v: f64| v.fract() == 0.0 && (-1.0..f64::from(MAX_DIM)).contains(&v);
        match (n.translation, n.scale) {
            (Some(base), Some(scale))
                if base.into_iter().all(whole)
                    && scale == [1.0 / f64::from(LATTICE); 3]
                    && n.matrix.is_none()
                    && n.rotation.is_none() =>
            {
                Ok(Some(base))
            }
            _ => fail(
                Fault::Structure,
                format!("/nodes/{node}"),
                format!(
                    "found translation {:?} and scale {:?}, expected whole voxels of the grid and \
                     1/{LATTICE}, and no other transform",
                    n.translation, n.scale
                ),
            ),
        }
    }

    /// The one primitive of mesh `mesh`, whose node must show it as it is.
    fn shown(&self, mesh: usize) -> Result<&read_json::Primitive> {
        let node = &self.doc.nodes[mesh + 1];
        let place = format!("/nodes/{}", mesh + 1);
        if node.mesh != Some(mesh) || !node.children.is_empty() {
            return fail(
                Fault::Structure,
                place,
                format!("expected a node with mesh {mesh} and no children"),
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

    /// The bytes of accessor `index`, which must be packed as wanted and of the wanted type.
    fn accessor(&self, index: usize, want: &Want) -> Result<Bytes<'a>> {
        let a = &self.doc.accessors[index];
        let place = format!("/accessors/{index}");
        if a.component_type != want.component
            || a.kind != want.kind
            || a.normalized != want.normalized
            || a.sparse.is_some()
        {
            return fail(
                Fault::Accessor,
                place,
                format!(
                    "found {}{} of component type {}, expected {}{} of {}",
                    if a.normalized { "normalized " } else { "" },
                    a.kind,
                    a.component_type,
                    if want.normalized { "normalized " } else { "" },
                    want.kind,
                    want.component
                ),
            );
        }
        if a.count == 0 {
            return fail(Fault::Accessor, place, "its count is 0");
        }
        let packed = |stride: Option<u64>| stride.map_or(want.tight, |s| s == want.stride);
        let view = a.buffer_view.filter(|&v| {
            let view = self.doc.buffer_views.get(v);
            packed(view.and_then(|v| v.byte_stride))
        });
        let Some(view) = view else {
            let message = format!("expected a buffer view with stride {}", want.stride);
            return fail(Fault::Accessor, place, message);
        };
        let body = self.buffers.view(self.doc, view)?;
        let component = match want.component {
            BYTE => 1,
            UNSIGNED_SHORT => 2,
            _ => 4,
        };
        let in_file = self.doc.buffer_views[view]
            .byte_offset
            .saturating_add(a.byte_offset);
        let part = a
            .count
            .checked_mul(want.stride)
            .and_then(|length| body.part(a.byte_offset, length));
        match part {
            Some(part) if in_file.is_multiple_of(component) => Ok(part),
            _ => fail(
                Fault::Accessor,
                place,
                format!(
                    "{} elements of {} bytes at byte {} do not lie, aligned, in its view of {} bytes",
                    a.count,
                    want.stride,
                    a.byte_offset,
                    body.get().len()
                ),
            ),
        }
    }

    fn indices(&self, index: usize) -> Result<Indices<'a>> {
        let wide = self.doc.accessors[index].component_type != UNSIGNED_SHORT;
        let bytes = self.accessor(index, if wide { &WIDE } else { &NARROW })?;
        Ok(Indices { bytes, wide })
    }

    /// An accessor's `min` or `max` in voxel coordinates.
    fn bound(&self, accessor: usize, which: &str, base: Option<[f64; 3]>) -> Result<[f64; 3]> {
        let a = &self.doc.accessors[accessor];
        let values = if which == "min" { &a.min } else { &a.max };
        match values.as_deref().and_then(|v| <[f64; 3]>::try_from(v).ok()) {
            Some(v) => Ok(match base {
                Some(base) => std::array::from_fn(|a| base[a] + v[a] / f64::from(LATTICE)),
                None => v,
            }),
            None => fail(
                Fault::Accessor,
                format!("/accessors/{accessor}/{which}"),
                "expected three numbers",
            ),
        }
    }
}
