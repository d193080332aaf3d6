//! A tile's geometry in the encoding of its set: from the floats of a [`Body`] to a BIN chunk.

use super::bin::Bin;
use super::body::{Body, BodyPiece};
use super::document::{BYTE, FLOAT, TileHead, UNSIGNED_INT, UNSIGNED_SHORT, geometry_views};
use super::normals::{Kind, quantize};
use crate::grid::{LATTICE, coordinate};
use crate::manifest::{Encoding, Primitives};
use serde::Serialize;
use serde_json::{Value, json};
use std::borrow::Cow;

/// An accessor of glTF. There are three to a piece, so they are no [`Value`]s, which took a tenth of the
/// time of a sparse scan.
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
        let place = |p: &BodyPiece| (2, p.first_index_byte - start);
        Stored {
            encoding: Encoding::Float,
            base: [0; 3],
            views: geometry_views(body),
            buffers: vec![json!({"byteLength": body.bytes})],
            indices: body.pieces.iter().map(place).collect(),
        }
    }

    /// The body's pieces one by one, each with its indices, and the BIN chunk. `low` is the lowest
    /// voxel of the macrocube.
    pub fn pieces<'a>(
        head: &TileHead,
        low: [u32; 3],
        geometry: Geometry<'a>,
    ) -> Result<(Self, Cow<'a, [u8]>), Refused> {
        let Geometry { body, bytes } = geometry;
        if head.form.encoding == Encoding::Float {
            return Ok((Stored::float(body), bytes.into()));
        }
        let (mut bin, base) = geometry.vertices(head.form.encoding, low)?;
        let mut streams: [Vec<u32>; 2] = Default::default();
        let mut places = Vec::with_capacity(body.pieces.len());
        for piece in &body.pieces {
            let stream = &mut streams[usize::from(piece.wide())];
            places.push((piece.wide(), stream.len() as u64));
            stream.extend(body.indices(piece, bytes));
        }
        let vertices = body.pieces.iter().map(|p| p.vertices).max().unwrap_or(0);
        let mut views = [0; 2];
        for (wide, stream) in [false, true].into_iter().zip(&streams) {
            if !stream.is_empty() {
                views[usize::from(wide)] =
                    bin.indices(stream, wide, head.form.primitives, vertices);
            }
        }
        let at = |(wide, first): (bool, u64)| {
            (views[usize::from(wide)], first * if wide { 4 } else { 2 })
        };
        let buffers = bin.finish();
        let stored = Stored {
            encoding: head.form.encoding,
            base,
            views: bin.views,
            buffers,
            indices: places.into_iter().map(at).collect(),
        };
        Ok((stored, bin.bytes.into()))
    }

    /// The three accessors of vertices `first..first + vertices` with bounds `[min, max]` in lattice
    /// steps; indices come from view and byte `at`.
    pub fn accessors(&self, p: &BodyPiece, at: (usize, u64)) -> [Accessor; 3] {
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
    /// A BIN chunk with views 0 and 1, positions and normals, and the corner of 16-bit positions.
    pub fn vertices(&self, encoding: Encoding, low: [u32; 3]) -> Result<(Bin, [i32; 3]), Refused> {
        let n = 12 * self.body.vertices as usize;
        let (positions, _) = self.bytes[..n].as_chunks::<12>();
        let (normals, _) = self.bytes[n..2 * n].as_chunks::<12>();
        let mut bin = Bin::new(encoding == Encoding::Meshopt);
        // as much as it may become with a row number to each vertex
        bin.bytes.reserve_exact(self.bytes.len() + n);
        if encoding == Encoding::Float {
            bin.vertices(positions, None);
            bin.vertices(normals, None);
            return Ok((bin, [0; 3]));
        }
        let base = self.base(low)?;
        let corner = base.map(|b| b * LATTICE as i32);
        let step = |e: &[u8; 12], a: usize| {
            let at = 4 * a;
            let v = f32::from_le_bytes([e[at], e[at + 1], e[at + 2], e[at + 3]]);
            ((v * LATTICE as f32) as i32 - corner[a]) as u16
        };
        let steps: Vec<[u8; 8]> = positions
            .iter()
            .map(|e| {
                let [x, y, z] = [0, 1, 2].map(|a| step(e, a));
                bytemuck::cast([x, y, z, 0].map(u16::to_le_bytes))
            })
            .collect();
        bin.vertices(&steps, None);
        let kind = match encoding {
            Encoding::Meshopt => Kind::Code,
            _ => Kind::Vector,
        };
        bin.vertices(&quantize(normals, kind), Some("OCTAHEDRAL"));
        Ok((bin, base))
    }

    /// The macrocube's corner, a voxel lower along axes where caps lie outside of it; all vertices
    /// are at most 65,535 steps above it.
    fn base(&self, low: [u32; 3]) -> Result<[i32; 3], Refused> {
        let bound = |get: fn(&BodyPiece) -> [i32; 3], pick: fn(i32, i32) -> i32| {
            let all = self.body.pieces.iter().map(get);
            all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
                .unwrap_or_default()
        };
        let (min, max) = (bound(|p| p.min, i32::min), bound(|p| p.max, i32::max));
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
}

/// All pieces' indices as one list or stitched strip over the tile's vertices.
pub(super) fn joined(geometry: Geometry, primitives: Primitives) -> Vec<u32> {
    let Geometry { body, bytes } = geometry;
    let mut all = Vec::new();
    for piece in &body.pieces {
        let part = body.indices(piece, bytes);
        match primitives {
            Primitives::Strips => crate::strip::append_strip(&mut all, &part, piece.first_vertex),
            Primitives::Triangles => all.extend(part.iter().map(|i| i + piece.first_vertex)),
        }
    }
    all
}
