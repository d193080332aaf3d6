//! A tile's geometry as its codec stores it: what accessors and nodes say of it, and why it may not be stored.

use super::body::{Body, PieceRange};
use super::codec::{Reach, TileCodec};
use super::document::{TileHead, geometry_views};
use super::encoded::EncodedBody;
use crate::gltf::accessors::Element;
use crate::grid::{LATTICE, coordinate};
use serde::Serialize;
use serde_json::{Value, json};

/// An accessor of glTF. There are three to a piece, so they are no [`Value`]s, which are slow to make.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    buffer_view: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    byte_offset: Option<u64>,
    component_type: u32,
    count: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<Corner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<Corner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    normalized: Option<bool>,
    #[serde(rename = "type")]
    kind: &'static str,
}

impl Accessor {
    /// So many elements of a view, from its beginning.
    pub fn new(buffer_view: usize, element: Element, count: u32) -> Self {
        Accessor {
            buffer_view,
            byte_offset: None,
            component_type: element.component,
            count,
            max: None,
            min: None,
            normalized: element.normalized.then_some(true),
            kind: element.shape,
        }
    }
}

/// A corner of a box as positions are stored.
#[derive(Debug, Clone, Copy, Serialize)]
#[serde(untagged)]
enum Corner {
    Voxels([f64; 3]),
    Steps([i32; 3]),
}

/// Where the indices of a piece begin.
#[derive(Debug, Clone, Copy)]
pub(super) struct IndicesAt {
    /// The view.
    pub view: usize,
    /// Byte of it.
    pub byte: u64,
}

/// How geometry is stored, as far as accessors and nodes have to say it.
pub(super) struct Stored {
    /// The encoding.
    pub codec: &'static dyn TileCodec,
    /// The corner in voxels that positions count from, if they are lattice steps.
    pub base: [i32; 3],
    /// Buffer views; the first two are positions and normals.
    pub views: Vec<Value>,
    /// The buffers.
    pub buffers: Vec<Value>,
    /// Of each piece.
    pub indices: Vec<IndicesAt>,
}

/// Why geometry cannot be stored as asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// The file would pass the 4 GiB of a GLB.
    TooLarge,
    /// The vertices lie further from the macrocube's corner than the encoding reaches.
    TooWide(Reach),
}

impl Stored {
    /// The body as it is, which is what a codec of floats stores.
    pub fn plain(codec: &'static dyn TileCodec, body: &Body) -> Self {
        let start = body.indices_start();
        let place = |p: &PieceRange| IndicesAt {
            view: 2,
            byte: p.first_index_byte - start,
        };
        Stored {
            codec,
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
    pub fn encoded(head: &TileHead, low: [u32; 3], encoded: EncodedBody) -> Result<Self, Refused> {
        let EncodedBody { body, layout } = encoded;
        let views = layout.views(head, body, false);
        // positions and normals come first, then narrow indices if there are any, then wide ones
        let any_narrow = body.pieces.iter().any(|p| !p.wide() && p.indices > 0);
        let mut before = [0; 2];
        let place = |piece: &PieceRange| {
            let wide = piece.wide();
            let before = &mut before[usize::from(wide)];
            let first = std::mem::replace(before, *before + u64::from(piece.indices));
            IndicesAt {
                view: 2 + usize::from(wide && any_narrow),
                byte: first * Element::index(wide).stride,
            }
        };
        Ok(Stored {
            codec: head.codec,
            base: head.codec.base(body, low)?,
            buffers: head.codec.buffers(&views),
            indices: body.pieces.iter().map(place).collect(),
            views: views.views,
        })
    }

    /// The accessors of a piece's positions, normals and indices, which begin `at` some place.
    pub fn accessors(&self, p: &PieceRange, at: IndicesAt) -> [Accessor; 3] {
        let format = self.codec.vertices();
        let of_vertices = |view: usize, element: Element| Accessor {
            byte_offset: Some(element.stride * u64::from(p.first_vertex)),
            ..Accessor::new(view, element, p.vertices)
        };
        let corner = |v: [i32; 3]| match format.steps {
            true => Corner::Steps(std::array::from_fn(|a| {
                (v[a] - self.base[a] * LATTICE as i32) >> self.codec.shift()
            })),
            // as f64, since an f32 that is not rounded may have more digits
            false => Corner::Voxels(v.map(|v| coordinate(v).into())),
        };
        [
            Accessor {
                min: Some(corner(p.min)),
                max: Some(corner(p.max)),
                ..of_vertices(0, format.position)
            },
            of_vertices(1, format.normal),
            Accessor {
                byte_offset: Some(at.byte),
                ..Accessor::new(at.view, Element::index(p.wide()), p.indices)
            },
        ]
    }

    /// What a node that shows positions has as transform; nothing if they are in voxels.
    pub fn transform(&self) -> Option<Transform> {
        let step = f64::from(1 << self.codec.shift()) / f64::from(LATTICE);
        self.codec.vertices().steps.then_some(Transform {
            translation: self.base,
            scale: [step; 3],
        })
    }
}

/// The transform of a node.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Transform {
    pub translation: [i32; 3],
    pub scale: [f64; 3],
}
