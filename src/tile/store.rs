//! A tile's geometry in the encoding of its set: from the floats of a [`Body`] to a BIN chunk.

use super::body::{Body, PieceRange};
use super::document::{TileHead, geometry_views};
use super::encoded::EncodedLayout;
use crate::gltf::accessors::float3;
use crate::gltf::bin_writer::Bin;
use crate::gltf::quantize_normals::{Kind, quantize};
use crate::gltf::{BYTE, FLOAT, UNSIGNED_INT, UNSIGNED_SHORT};
use crate::grid::{LATTICE, coordinate};
use crate::manifest::Encoding;
use serde::Serialize;
use serde_json::{Value, json};

/// An accessor of glTF. There are three to a piece, so they are no [`Value`]s, which are slow to make.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub byte_offset: Option<u64>,
    pub component_type: u32,
    pub count: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max: Option<Corner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min: Option<Corner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normalized: Option<bool>,
    #[serde(rename = "type")]
    pub kind: &'static str,
}

/// A corner of a box as positions are stored.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(untagged)]
pub(super) enum Corner {
    Voxels([f64; 3]),
    Steps([i32; 3]),
}

/// How geometry is stored, as far as accessors and nodes have to say it.
pub(super) struct Stored {
    /// The encoding.
    pub encoding: Encoding,
    /// The corner in voxels that 16-bit positions count from.
    pub base: [i32; 3],
    /// Buffer views; the first two are positions and normals.
    pub views: Vec<Value>,
    /// The buffers.
    pub buffers: Vec<Value>,
    /// View and byte of the indices of each piece.
    pub indices: Vec<(usize, u64)>,
}

/// Why geometry cannot be stored as asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// The file would pass the 4 GiB of a GLB.
    TooLarge,
    /// The vertices reach further than 16 bits.
    TooWide,
}

/// Pieces with their geometry as floats.
#[derive(Clone, Copy)]
pub(super) struct Geometry<'a> {
    pub body: &'a Body,
    /// The body's bytes.
    pub bytes: &'a [u8],
}

impl Stored {
    /// The body as it is.
    pub fn float(body: &Body) -> Self {
        let start = body.indices_start();
        let place = |p: &PieceRange| (2, p.first_index_byte - start);
        Stored {
            encoding: Encoding::Float,
            base: [0; 3],
            views: geometry_views(body),
            buffers: vec![json!({"byteLength": body.bytes})],
            indices: body.pieces.iter().map(place).collect(),
        }
    }

    /// Encoded pieces one by one, each with its indices.
    ///
    /// # Errors
    /// [`Refused::TooWide`].
    pub fn encoded(
        head: &TileHead,
        low: [u32; 3],
        body: &Body,
        recipe: &EncodedLayout,
    ) -> Result<Self, Refused> {
        let views = recipe.views(head, body, false);
        // positions and normals come first, then narrow indices if there are any, then wide ones
        let any_narrow = body.pieces.iter().any(|p| !p.wide() && p.indices > 0);
        let view = |wide: bool| 2 + usize::from(wide && any_narrow);
        let mut before = [0; 2];
        let place = |piece: &PieceRange| {
            let wide = piece.wide();
            let before = &mut before[usize::from(wide)];
            let first = std::mem::replace(before, *before + u64::from(piece.indices));
            (view(wide), first * if wide { 4 } else { 2 })
        };
        Ok(Stored {
            encoding: head.form.encoding,
            base: base(head.form.encoding, body, low)?,
            buffers: views.buffers(),
            indices: body.pieces.iter().map(place).collect(),
            views: views.views,
        })
    }

    /// The three accessors of vertices `first..first + vertices` with bounds `[min, max]` in lattice
    /// steps; indices come from view and byte `at`.
    pub fn accessors(&self, p: &PieceRange, at: (usize, u64)) -> [Accessor; 3] {
        let first = u64::from(p.first_vertex);
        let vertex = Accessor {
            buffer_view: 0,
            byte_offset: None,
            component_type: FLOAT,
            count: p.vertices,
            max: None,
            min: None,
            normalized: None,
            kind: "VEC3",
        };
        let [position, normal] = match self.encoding {
            Encoding::Float => {
                // as f64, since an f32 that is not rounded may have more digits
                let corner = |v: [i32; 3]| Corner::Voxels(v.map(|v| coordinate(v).into()));
                let vertex = Accessor {
                    byte_offset: Some(12 * first),
                    ..vertex
                };
                [
                    Accessor {
                        min: Some(corner(p.min)),
                        max: Some(corner(p.max)),
                        ..vertex
                    },
                    Accessor {
                        buffer_view: 1,
                        ..vertex
                    },
                ]
            }
            Encoding::Quantized | Encoding::Meshopt => {
                let corner = |v: [i32; 3]| {
                    Corner::Steps(std::array::from_fn(|a| {
                        v[a] - self.base[a] * LATTICE as i32
                    }))
                };
                [
                    Accessor {
                        byte_offset: Some(8 * first),
                        component_type: UNSIGNED_SHORT,
                        min: Some(corner(p.min)),
                        max: Some(corner(p.max)),
                        ..vertex
                    },
                    Accessor {
                        buffer_view: 1,
                        byte_offset: Some(4 * first),
                        component_type: BYTE,
                        normalized: Some(true),
                        ..vertex
                    },
                ]
            }
        };
        let indices = Accessor {
            buffer_view: at.0,
            byte_offset: Some(at.1),
            component_type: if p.wide() {
                UNSIGNED_INT
            } else {
                UNSIGNED_SHORT
            },
            count: p.indices,
            kind: "SCALAR",
            ..vertex
        };
        [position, normal, indices]
    }

    /// Translation and scale of a node that shows positions; none for floats.
    pub fn transform(&self) -> Option<([i32; 3], [f64; 3])> {
        let step = 1.0 / f64::from(LATTICE);
        (self.encoding != Encoding::Float).then_some((self.base, [step; 3]))
    }
}

impl Geometry<'_> {
    /// Adds positions and normals to a chunk.
    ///
    /// # Errors
    /// [`Refused::TooWide`].
    pub fn put_vertices(
        &self,
        bin: &mut Bin,
        encoding: Encoding,
        low: [u32; 3],
    ) -> Result<(), Refused> {
        let n = 12 * self.body.vertices as usize;
        let (positions, _) = self.bytes[..n].as_chunks::<12>();
        let (normals, _) = self.bytes[n..2 * n].as_chunks::<12>();
        let corner = base(encoding, self.body, low)?.map(|b| b * LATTICE as i32);
        let kind = match encoding {
            Encoding::Float => {
                bin.vertices(positions);
                bin.vertices(normals);
                return Ok(());
            }
            Encoding::Quantized => Kind::Vector,
            Encoding::Meshopt => Kind::Code,
        };
        let steps = positions.iter().map(|e| {
            let position = float3(e);
            let step = |a: usize| ((position[a] * LATTICE as f32) as i32 - corner[a]) as u16;
            bytemuck::cast([step(0), step(1), step(2), 0].map(u16::to_le_bytes))
        });
        bin.vertices::<8>(&steps.collect::<Vec<_>>());
        bin.vertices(&quantize(normals, kind));
        Ok(())
    }
}

/// The corner that 16-bit positions count from: the macrocube's, a voxel lower along axes where caps lie outside of
/// it. All vertices are at most 65,535 steps above it.
///
/// # Errors
/// [`Refused::TooWide`] if they are not.
pub(super) fn base(encoding: Encoding, body: &Body, low: [u32; 3]) -> Result<[i32; 3], Refused> {
    if encoding == Encoding::Float {
        return Ok([0; 3]);
    }
    let [min, max] = body.bounds();
    let corner = |a: usize| {
        let low = low[a] as i32;
        if min[a] < low * LATTICE as i32 {
            low - 1
        } else {
            low
        }
    };
    let base: [i32; 3] = std::array::from_fn(corner);
    let fits = |a: usize| {
        let corner = base[a] * LATTICE as i32;
        min[a] >= corner && max[a] - corner <= i32::from(u16::MAX)
    };
    if (0..3).all(fits) {
        Ok(base)
    } else {
        Err(Refused::TooWide)
    }
}
