//! Reading a tile back: from the bytes of a GLB to its surface pieces, without copying geometry that is
//! not compressed.
//!
//! Everything the file says is checked against its real size before it is used, so a damaged or
//! hostile file gives a [`ReadError`], never a panic or an allocation out of proportion to the file.

use super::codec::{CODECS, TileCodec, codec_of};
use super::paint::{Rgb, named, of_vertex, vertex_colour};
use super::reader::Reader;
use crate::gltf::buffer_views::{Buffers, Bytes};
use crate::gltf::container::{Result, fail};
use crate::gltf::read_json::Document;
use crate::manifest::{Encoding, Group, Table};

pub use super::codec::{Normals, Positions};
pub use crate::gltf::accessors::Indices;
pub use crate::gltf::container::{Fault, Glb, ReadError};
pub use crate::measure::{MEASURES, Measured};

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

impl PieceIds {
    /// The id of the row of a table that the piece belongs to.
    pub fn of(&self, table: Table) -> u64 {
        match table {
            Table::Cells => self.cell,
            Table::Objects => self.object,
            Table::Surfaces => self.surface,
        }
    }
}

impl From<&Group> for PieceIds {
    fn from(group: &Group) -> Self {
        PieceIds {
            cell: group.cell,
            object: group.object,
            surface: group.surface,
            triangles: group.triangles,
        }
    }
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
    /// Name of the material; empty if there is none.
    pub material: String,
    /// glTF mode: 4 for a list of triangles, 5 for a strip.
    pub mode: u32,
    /// Positions in voxel coordinates.
    pub positions: Positions<'a>,
    /// The position accessor's `min`, in voxel coordinates.
    pub min: [f64; 3],
    /// The position accessor's `max`, in voxel coordinates.
    pub max: [f64; 3],
    /// Normals; as many as positions.
    pub normals: Normals<'a>,
    /// Indices into positions.
    pub indices: Indices<'a>,
    /// The piece or pieces that the primitive holds.
    pub pieces: Pieces<'a>,
    /// What each piece says of its cell.
    pub measured: Vec<Measured>,
    /// Vertex colours, linear, 4 x 16 bits each.
    pub(super) colours: Option<Bytes<'a>>,
}

impl Primitive<'_> {
    /// The colour of the material, or of this vertex if vertices have colours; the inner `None` is the common
    /// grey. `None` if it is no colour that this program writes.
    pub(crate) fn colour(&self, vertex: usize) -> Option<Option<Rgb>> {
        let Some(colours) = &self.colours else {
            return Some(named(&self.material));
        };
        let stored = colours.chunks::<8>().get(vertex)?;
        let colour = of_vertex(stored);
        (vertex_colour(colour) == *stored).then_some(colour)
    }

    /// True if these vertices have the same colour.
    pub(crate) fn are_one_colour(&self, vertices: &[u32]) -> bool {
        let Some(colours) = self.colours.as_ref().map(|c| c.chunks::<8>()) else {
            return true;
        };
        let of = |v: &u32| colours.get(*v as usize);
        vertices.windows(2).all(|w| of(&w[0]) == of(&w[1]))
    }
}

/// Which surface pieces a primitive holds.
#[derive(Debug, Clone)]
pub enum Pieces<'a> {
    /// The node layout: one piece.
    One(PieceIds),
    /// The merged layout: the row of each vertex, and the rows of the table.
    Merged(Rows<'a>, Vec<PieceIds>),
}

/// The row of the property table for each vertex of a merged tile, as floats.
#[derive(Debug, Clone)]
pub struct Rows<'a>(pub(super) Bytes<'a>);

impl Rows<'_> {
    /// Little-endian floats, which may be anything.
    pub fn get(&self) -> &[[u8; 4]] {
        self.0.chunks()
    }
}

/// A tile whose structure has been checked.
#[derive(Debug, Clone)]
pub struct Tile<'a> {
    /// The root node's matrix, column-major.
    pub matrix: [f64; 16],
    /// How numbers are stored.
    pub encoding: Encoding,
    /// The primitives by rising node index.
    pub primitives: Vec<Primitive<'a>>,
    pub(super) codec: &'static dyn TileCodec,
    pub(super) glb: Glb<'a>,
    pub(super) document: Document,
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
        Tile::read_as(bytes, &CODECS)
    }

    /// Reads the bytes of a file of a node of a coarser level, whose positions are multiples of some more lattice
    /// steps and may lie outside of the grid.
    ///
    /// # Errors
    /// As of [`Tile::read`].
    pub(crate) fn read_node(bytes: &'a [u8]) -> Result<Self> {
        Tile::read_with(bytes, &CODECS, true)
    }

    /// The same of a tile in one of some encodings.
    ///
    /// # Errors
    /// As of [`Tile::read`].
    pub(super) fn read_as(bytes: &'a [u8], codecs: &[&'static dyn TileCodec]) -> Result<Self> {
        Tile::read_with(bytes, codecs, false)
    }

    fn read_with(bytes: &'a [u8], codecs: &[&'static dyn TileCodec], coarse: bool) -> Result<Self> {
        let glb = Glb::split(bytes)?;
        let doc: Document =
            serde_json::from_slice(glb.json).or_else(|e| fail(Fault::Json, "", e.to_string()))?;
        let codec = codec_of(&doc, codecs)?;
        let matrix = root_matrix(&doc)?;
        let buffers = Buffers::new(glb.bin, codec.decompress(&doc, glb.bin)?);
        let reader = Reader {
            doc: &doc,
            buffers: &buffers,
            codec,
            coarse,
        };
        let mut used = vec![false; doc.accessors.len()];
        let mut primitives = Vec::with_capacity(doc.meshes.len());
        for mesh in 0..doc.meshes.len() {
            primitives.push(reader.primitive(mesh, &mut used)?);
        }
        Ok(Tile {
            matrix,
            encoding: codec.encoding(),
            primitives,
            codec,
            glb,
            document: doc,
        })
    }

    /// The JSON chunk, padding included.
    pub fn json(&self) -> &'a [u8] {
        self.glb.json
    }

    /// True for the merged layout.
    pub fn is_merged(&self) -> bool {
        matches!(
            self.primitives.first().map(|p| &p.pieces),
            Some(Pieces::Merged(..))
        )
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
    if root.name != "alvis" || root.mesh.is_some() || root.has_trs() {
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
