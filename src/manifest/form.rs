//! The form of tiles: primitives, encoding and layout.

use super::Manifest;
use serde::{Deserialize, Serialize};

/// Kind of the primitives of a tile set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Primitives {
    /// glTF mode 5: strips of a node stitched by degenerate triangles.
    #[default]
    Strips,
    /// glTF mode 4: triangle lists.
    Triangles,
}

/// How tiles store positions, normals and indices. Positions are exact in each, see [`crate::tile`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// 32-bit floats, plain glTF 2.0: every program reads it.
    #[default]
    Float,
    /// Lattice steps in 16 bits and normals in 8 (KHR_mesh_quantization). Tiles reach over at most
    /// 65,535 steps, 255 voxels, along each axis.
    Quantized,
    /// The same, compressed (EXT_meshopt_compression): for viewers on the web.
    Meshopt,
}

/// How a tile keeps its surface pieces apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// A node for each piece, up to [`crate::tile::MAX_NODES`] of them, else merged.
    #[default]
    Auto,
    /// A node for each piece, however many there are.
    Nodes,
    /// One mesh with feature ids and a property table.
    Merged,
}

/// The form that tiles are written in: the same surface, for other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Form {
    /// Kind of primitives.
    pub primitives: Primitives,
    /// How numbers are stored.
    pub encoding: Encoding,
    /// How pieces are kept apart.
    pub layout: Layout,
}

impl Form {
    /// The form that a tile set has.
    pub fn of(manifest: &Manifest) -> Self {
        Form {
            primitives: manifest.primitives,
            encoding: manifest.encoding,
            layout: manifest.layout,
        }
    }

    /// What most programs read and Blender makes most of: strips, floats, a node for each piece.
    pub const BLENDER: Form = Form {
        primitives: Primitives::Strips,
        encoding: Encoding::Float,
        layout: Layout::Auto,
    };
    /// Lists, since MeshLab reads no strips.
    pub const MESHLAB: Form = Form {
        primitives: Primitives::Triangles,
        ..Form::BLENDER
    };
    /// Smallest: compressed, and one mesh to a tile, in which a viewer picks cells by feature ids. On a
    /// foam of 256 x 256 x 256 voxels tiles take 4.3 bytes a triangle, and 5.3 as lists.
    pub const WEB: Form = Form {
        primitives: Primitives::Strips,
        encoding: Encoding::Meshopt,
        layout: Layout::Merged,
    };
}
