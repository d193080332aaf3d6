//! The primitives of a tile: accessors of the right type, inside the file, each used once.

use super::codec::{MAX_SHIFT, Normals, Positions, TileCodec, coarse};
use super::read::{PieceIds, Pieces, Primitive, Rows};
use crate::gltf::accessors::{Element, Indices};
use crate::gltf::buffer_views::{Buffers, Bytes};
use crate::gltf::container::{Fault, Result, fail};
use crate::gltf::read_json::{self, Document};
use crate::grid::{LATTICE, MAX_DIM};
use crate::measure::Measured;

pub(super) struct Reader<'d, 'a> {
    pub doc: &'d Document,
    pub buffers: &'d Buffers<'a>,
    pub codec: &'static dyn TileCodec,
    /// The file is of a node of a coarser level, whose steps and corner are its own.
    pub coarse: bool,
}

/// Where positions count from, and what stores them.
struct Frame {
    /// The corner in voxels.
    base: [f64; 3],
    codec: &'static dyn TileCodec,
}

/// Hands out the accessors of a primitive, none that another one has.
struct Accessors<'r> {
    place: String,
    primitive: &'r read_json::Primitive,
    /// Which accessors of the tile have been handed out.
    used: &'r mut [bool],
}

impl Accessors<'_> {
    /// That of an attribute; `None` if the primitive does not have it.
    fn optional(&mut self, name: &str) -> Result<Option<usize>> {
        match self.primitive.attributes.get(name) {
            None => Ok(None),
            index => self.take(name, index.copied()).map(Some),
        }
    }

    fn attribute(&mut self, name: &str) -> Result<usize> {
        self.take(name, self.primitive.attributes.get(name).copied())
    }

    fn indices(&mut self) -> Result<usize> {
        self.take("indices", self.primitive.indices)
    }

    fn take(&mut self, name: &str, index: Option<usize>) -> Result<usize> {
        match index.and_then(|i| self.used.get_mut(i).map(|used| (i, used))) {
            Some((i, used)) if !*used => {
                *used = true;
                Ok(i)
            }
            _ => self.fail(
                Fault::Structure,
                format!("{name}: found accessor {index:?}, expected one of its own"),
            ),
        }
    }

    fn fail<T>(&self, fault: Fault, message: impl Into<String>) -> Result<T> {
        fail(fault, &self.place, message)
    }
}

/// What a primitive holds, and what that says of its cells.
struct Held<'a> {
    pieces: Pieces<'a>,
    measured: Vec<Measured>,
}

impl<'a> Reader<'_, 'a> {
    /// Reads mesh `mesh` and its node, `mesh + 1`.
    pub fn primitive(&self, mesh: usize, used: &mut [bool]) -> Result<Primitive<'a>> {
        let node_index = mesh + 1;
        let node = &self.doc.nodes[node_index];
        let prim = self.shown(mesh)?;
        let mut accessors = Accessors {
            place: format!("/meshes/{mesh}/primitives/0"),
            primitive: prim,
            used,
        };
        let positions_at = accessors.attribute("POSITION")?;
        let normals_at = accessors.attribute("NORMAL")?;
        let indices_at = accessors.indices()?;
        let frame = self.frame(node_index)?;
        let format = self.codec.vertices();
        let positions = Positions {
            bytes: self.accessor(positions_at, &format.position)?,
            codec: frame.codec,
            base: frame.base.map(|v| v as f32),
        };
        let normals = Normals {
            bytes: self.accessor(normals_at, &format.normal)?,
            codec: self.codec,
        };
        let vertices = positions.len();
        if vertices != normals.len() {
            let message = format!("found {} normals for {vertices} positions", normals.len());
            return accessors.fail(Fault::Accessor, message);
        }
        let held = self.held(mesh, &mut accessors, vertices)?;
        let colours = self.colours(&mut accessors, vertices)?;
        let material = prim.material.and_then(|m| self.doc.materials.get(m));
        Ok(Primitive {
            node: node_index,
            name: node.name.clone(),
            mesh_name: self.doc.meshes[mesh].name.clone(),
            material: material.map_or(String::new(), |m| m.name.clone()),
            mode: prim.mode.unwrap_or(4),
            min: self.bound(positions_at, "min", &frame)?,
            max: self.bound(positions_at, "max", &frame)?,
            positions,
            normals,
            indices: self.indices(indices_at)?,
            pieces: held.pieces,
            measured: held.measured,
            colours,
        })
    }

    /// The piece of a node, or those of a merged tile.
    fn held(&self, mesh: usize, accessors: &mut Accessors, vertices: usize) -> Result<Held<'a>> {
        let Some(at) = accessors.optional("_FEATURE_ID_0")? else {
            let ids = self.extras(mesh + 1)?;
            return Ok(Held {
                pieces: Pieces::One(ids),
                measured: vec![self.doc.nodes[mesh + 1].extras.measured],
            });
        };
        let rows = Rows(self.accessor(at, &Element::FLOAT)?);
        if rows.get().len() != vertices || self.doc.meshes.len() != 1 {
            let message = "a merged tile has one mesh with a feature id for each vertex";
            return accessors.fail(Fault::Structure, message);
        }
        let ids = super::features::rows(self.doc, self.buffers, accessors.primitive)?;
        let measured = super::features::measured(self.doc, self.buffers, ids.len())?;
        Ok(Held {
            pieces: Pieces::Merged(rows, ids),
            measured,
        })
    }

    fn colours(&self, accessors: &mut Accessors, vertices: usize) -> Result<Option<Bytes<'a>>> {
        let Some(at) = accessors.optional("COLOR_0")? else {
            return Ok(None);
        };
        let colours = self.accessor(at, &Element::COLOUR)?;
        if colours.chunks::<8>().len() != vertices {
            return accessors.fail(Fault::Accessor, "expected a colour for each vertex");
        }
        Ok(Some(colours))
    }

    /// The corner that a node's positions count from, by its translation, and the codec, by its scale; zeros for
    /// positions in voxels, whose nodes have no transform.
    fn frame(&self, node: usize) -> Result<Frame> {
        let n = &self.doc.nodes[node];
        let place = format!("/nodes/{node}");
        if !self.codec.vertices().steps {
            if n.matrix.is_some() || n.has_trs() {
                let message = "expected no transform of its own";
                return fail(Fault::Structure, place, message);
            }
            return Ok(Frame {
                base: [0.0; 3],
                codec: self.codec,
            });
        }
        // fins reach a little further than the grid
        let lowest = if self.coarse {
            -f64::from(MAX_DIM)
        } else {
            -1.0
        };
        let whole = |v: f64| v.fract() == 0.0 && (lowest..f64::from(MAX_DIM)).contains(&v);
        let codec = n.scale.and_then(|scale| self.codec_of_scale(scale));
        match (n.translation, codec) {
            (Some(base), Some(codec))
                if base.into_iter().all(whole) && n.matrix.is_none() && n.rotation.is_none() =>
            {
                Ok(Frame { base, codec })
            }
            _ => fail(
                Fault::Structure,
                place,
                format!(
                    "found translation {:?} and scale {:?}, expected whole voxels of the grid and \
                     1/{LATTICE}, and no other transform",
                    n.translation, n.scale
                ),
            ),
        }
    }

    /// The codec whose steps a node's scale has, if there is one.
    fn codec_of_scale(&self, scale: [f64; 3]) -> Option<&'static dyn TileCodec> {
        let steps = scale[0] * f64::from(LATTICE);
        if scale != [scale[0]; 3] {
            return None;
        }
        match self.coarse {
            false => (steps == 1.0).then_some(self.codec),
            true => {
                let shift = (0..=MAX_SHIFT).find(|&s| steps == f64::from(1 << s))?;
                coarse(shift)
            }
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
    fn accessor(&self, index: usize, want: &Element) -> Result<Bytes<'a>> {
        let a = &self.doc.accessors[index];
        let place = format!("/accessors/{index}");
        check_type(a, want, &place)?;
        let packed = |stride: Option<u64>| stride.map_or(want.fills_stride(), |s| s == want.stride);
        let view = a.buffer_view.filter(|&v| {
            let view = self.doc.buffer_views.get(v);
            packed(view.and_then(|v| v.byte_stride))
        });
        let Some(view) = view else {
            let message = format!("expected a buffer view with stride {}", want.stride);
            return fail(Fault::Accessor, place, message);
        };
        let body = self.buffers.view(self.doc, view)?;
        let in_file = self.doc.buffer_views[view]
            .byte_offset
            .saturating_add(a.byte_offset);
        let part = a
            .count
            .checked_mul(want.stride)
            .and_then(|length| body.part(a.byte_offset, length));
        match part {
            Some(part) if in_file.is_multiple_of(want.component_bytes()) => Ok(part),
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
        let narrow = Element::NARROW_INDEX.component;
        let wide = self.doc.accessors[index].component_type != narrow;
        let bytes = self.accessor(index, &Element::index(wide))?;
        Ok(Indices { bytes, wide })
    }

    /// An accessor's `min` or `max` in voxel coordinates.
    fn bound(&self, accessor: usize, which: &str, frame: &Frame) -> Result<[f64; 3]> {
        let a = &self.doc.accessors[accessor];
        let values = if which == "min" { &a.min } else { &a.max };
        let Some(v) = values.as_deref().and_then(|v| <[f64; 3]>::try_from(v).ok()) else {
            let place = format!("/accessors/{accessor}/{which}");
            return fail(Fault::Accessor, place, "expected three numbers");
        };
        Ok(match self.codec.vertices().steps {
            true => {
                let step = f64::from(1 << frame.codec.shift()) / f64::from(LATTICE);
                std::array::from_fn(|a| frame.base[a] + v[a] * step)
            }
            false => v,
        })
    }
}

/// Compares the type of an accessor with the wanted one.
fn check_type(a: &read_json::Accessor, want: &Element, place: &str) -> Result<()> {
    let found = (a.component_type, a.kind.as_str(), a.normalized);
    let is_wanted = found == (want.component, want.shape, want.normalized);
    if is_wanted && a.sparse.is_none() && a.count > 0 {
        return Ok(());
    }
    if is_wanted && a.sparse.is_none() {
        return fail(Fault::Accessor, place, "its count is 0");
    }
    let normalized = |normalized| if normalized { "normalized " } else { "" };
    fail(
        Fault::Accessor,
        place,
        format!(
            "found {}{} of component type {}, expected {}{} of {}",
            normalized(a.normalized),
            a.kind,
            a.component_type,
            normalized(want.normalized),
            want.shape,
            want.component
        ),
    )
}
