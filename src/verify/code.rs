//! The kinds of findings. Each has a broken tile set among the tests that yields exactly it.

use serde::Serialize;

macro_rules! codes {
    ($($(#[$doc:meta])* $name:ident = $text:literal, $breaks:literal;)*) => {
        /// What is wrong, by kind; in JSON the name is in upper case: `CHECKSUM`, `FLIPPED_TRIANGLE`.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
        #[non_exhaustive]
        pub enum Code {
            $($(#[$doc])* #[serde(rename = $text)] $name,)*
        }

        impl Code {
            /// Every code.
            pub const ALL: &[Code] = &[$(Code::$name),*];

            /// The name in JSON and in messages.
            pub fn name(self) -> &'static str {
                match self {
                    $(Code::$name => $text,)*
                }
            }

            /// True if the surface cannot be rebuilt from what was found, so that sums over it say
            /// nothing more: totals, laws and tables are not compared then.
            pub(super) fn breaks_surface(self) -> bool {
                match self {
                    $(Code::$name => $breaks,)*
                }
            }
        }
    };
}

codes! {
    /// `index.json` is not JSON, or lacks a member, or a member has the wrong type.
    ManifestSyntax = "MANIFEST_SYNTAX", true;
    /// The manifest's `format` or `format_version` is not one that this program reads.
    FormatVersion = "FORMAT_VERSION", true;
    /// A member of the manifest is out of range or contradicts another one.
    ManifestValue = "MANIFEST_VALUE", false;
    /// A member of a JSON file that the format does not have, that is there twice or is missing, or a value that
    /// the format does not list.
    ForeignMember = "FOREIGN_MEMBER", false;
    /// The source that the manifest states is not the volume that the tiles are compared with.
    SourceMismatch = "SOURCE_MISMATCH", false;
    /// A part has a cell that its condition leaves out, or a condition that cannot be read.
    Selection = "SELECTION", false;
    /// The colour of a piece, or what the manifest says of colours, is not that of the cell.
    Paint = "PAINT", false;
    /// A path is absolute, has `..` or another strange part, or a symbolic link leads outside.
    PathOutside = "PATH_OUTSIDE", true;
    /// A path is not the one that the format gives to that layer, tile or table.
    PathName = "PATH_NAME", true;
    /// A file that the index names does not exist or cannot be read.
    MissingFile = "MISSING_FILE", true;
    /// A file below `tiles/` or `index/` that the index does not name.
    ForeignFile = "FOREIGN_FILE", false;
    /// A file has another size than the index says.
    FileSize = "FILE_SIZE", false;
    /// A file has another checksum than the index says.
    Checksum = "CHECKSUM", false;
    /// A shard is not JSON, or lacks a member, or a member has the wrong type.
    ShardSyntax = "SHARD_SYNTAX", true;
    /// A member of a shard is out of range, out of order or contradicts the manifest.
    ShardValue = "SHARD_VALUE", true;
    /// A tile is not a GLB of one JSON and one BIN chunk that fill the file.
    GlbContainer = "GLB_CONTAINER", true;
    /// A tile's JSON chunk is not JSON, or a member has the wrong type.
    GltfSyntax = "GLTF_SYNTAX", true;
    /// Scene, nodes, meshes or primitives are not laid out as a tile's are.
    GltfStructure = "GLTF_STRUCTURE", true;
    /// An accessor is of the wrong type, misaligned or outside the buffer.
    GltfAccessor = "GLTF_ACCESSOR", true;
    /// Something in a tile is used by nothing, or is not what those that use it take it for: an extension, an
    /// accessor, a view, a material, a description, or bytes.
    GltfUnused = "GLTF_UNUSED", false;
    /// A compressed buffer view is not what it says, or cannot be decoded.
    MeshoptBuffer = "MESHOPT_BUFFER", true;
    /// A tile's encoding or layout is not the manifest's.
    TileEncoding = "TILE_ENCODING", false;
    /// An accessor's `min` or `max` is not that of its values.
    AccessorBounds = "ACCESSOR_BOUNDS", false;
    /// A primitive's mode is not the manifest's `primitives`.
    PrimitiveMode = "PRIMITIVE_MODE", true;
    /// The root node's matrix is not the manifest's `transform`.
    RootMatrix = "ROOT_MATRIX", false;
    /// A node's or mesh's name is not that of its cell and object.
    NodeName = "NODE_NAME", false;
    /// A node's `extras` lack an id, are nested, or hold no whole number where an id should be.
    NodeExtras = "NODE_EXTRAS", true;
    /// The shard's groups are not the pieces that the tile holds.
    GroupMismatch = "GROUP_MISMATCH", true;
    /// The shard's counts of a tile are not those of the file.
    TileCount = "TILE_COUNT", false;
    /// The shard's box of a tile is not that of its vertices.
    TileBox = "TILE_BOX", false;
    /// Indices have 32 bits where 16 suffice, or the other way round.
    IndexType = "INDEX_TYPE", false;
    /// An index points beyond the piece's vertices.
    IndexRange = "INDEX_RANGE", true;
    /// A coordinate is NaN or infinite.
    PositionNotFinite = "POSITION_NOT_FINITE", true;
    /// A vertex is not strictly inside one lattice edge, on a multiple of 1/256 voxel.
    PositionOffLattice = "POSITION_OFF_LATTICE", true;
    /// A vertex lies outside its macrocube.
    PositionOutsideTile = "POSITION_OUTSIDE_TILE", true;
    /// Two vertices of a tile lie on one lattice edge.
    DuplicateVertex = "DUPLICATE_VERTEX", true;
    /// A vertex that pieces of cells share has another place or normal in one than in the other.
    SeamDiffers = "SEAM_DIFFERS", true;
    /// A vertex that no triangle uses.
    UnusedVertex = "UNUSED_VERTEX", true;
    /// A normal is not finite or not of unit length.
    NormalInvalid = "NORMAL_INVALID", false;
    /// A normal is not that of the volume's gradient.
    NormalDiffers = "NORMAL_DIFFERS", false;
    /// A triangle without area that is no joint of a strip.
    DegenerateTriangle = "DEGENERATE_TRIANGLE", true;
    /// A triangle that does not lie in one cube.
    TriangleOutsideCube = "TRIANGLE_OUTSIDE_CUBE", true;
    /// Two triangles with the same three vertices in the same order.
    DuplicateTriangle = "DUPLICATE_TRIANGLE", true;
    /// A triangle that winds against its neighbours.
    FlippedTriangle = "FLIPPED_TRIANGLE", true;
    /// More than two triangles share an edge.
    EdgeRepeated = "EDGE_REPEATED", true;
    /// Edges that no other triangle continues, neither in the tile nor across its planes, and that
    /// do not lie on an open face of the volume.
    Hole = "HOLE", true;
    /// Triangles that are connected carry different ids.
    SurfaceMixed = "SURFACE_MIXED", true;
    /// Parts that are not connected have one surface id.
    SurfaceSplit = "SURFACE_SPLIT", true;
    /// Two surfaces lie between the same cell and the same object.
    PairRepeated = "PAIR_REPEATED", true;
    /// Pieces of cells that touch do not stand by rising cell in a tile.
    PartOrder = "PART_ORDER", true;
    /// Triangles that begin at one voxel are of several cells, or of another than its label says.
    CellMixed = "CELL_MIXED", true;
    /// Ids of surfaces, cells or objects are not 1 to n.
    IdGap = "ID_GAP", true;
    /// Ids do not rise with the first voxel of cells and objects, or the first vertex of surfaces.
    IdOrder = "ID_ORDER", false;
    /// Surfaces + 1 is not objects + cells.
    Law = "LAW", true;
    /// A sum in the manifest is not that of the tiles.
    TotalsMismatch = "TOTALS_MISMATCH", false;
    /// The dust that was left out differs from the components of the volume that are below the size.
    Dust = "DUST", false;
    /// A table has no header, or another one, or a field is not what its column holds.
    TableSyntax = "TABLE_SYNTAX", false;
    /// A table lacks a row, repeats one or has one too many.
    TableRows = "TABLE_ROWS", false;
    /// A value in a table is not that of the rebuilt surface.
    TableValue = "TABLE_VALUE", false;
    /// The measures that tiles carry on a cell's pieces are not those of its row in the table.
    CarriedMeasure = "CARRIED_MEASURE", false;
    /// The volume has another size than the tiles' grid.
    VolumeMismatch = "VOLUME_MISMATCH", true;
    /// The volume has a sign change where the tile has no vertex.
    MissingVertex = "MISSING_VERTEX", true;
    /// The tile has a vertex where the volume has no sign change.
    ExtraVertex = "EXTRA_VERTEX", true;
    /// A vertex is not where the volume's samples put it.
    VertexMisplaced = "VERTEX_MISPLACED", true;
    /// A cube has more or fewer triangles than its eight bits ask for.
    TriangleCount = "TRIANGLE_COUNT", true;
    /// The bits that the mesh implies are not those of the volume: the surface is inside out.
    BitsDiffer = "BITS_DIFFER", true;
    /// The index of levels, a list of nodes or a tileset is not JSON, or not as the format has it.
    LodSyntax = "LOD_SYNTAX", false;
    /// A number in the index of levels or in a list of nodes is out of range, or is not the sum of what it counts.
    LodValue = "LOD_VALUE", false;
    /// The file of a node is none, or is not as its entry says.
    LodNode = "LOD_NODE", false;
    /// A row of a node has ids or measures that nothing below it has.
    LodIds = "LOD_IDS", false;
    /// An edge of a level that nothing continues, in the node or across its planes, off the volume's open faces.
    LodEdge = "LOD_EDGE", false;
    /// The border of what lies below a node runs further from that of the node than it states.
    LodCurve = "LOD_CURVE", false;
    /// Fins that do not cover the border on both sides by what may be seen through, or lie elsewhere.
    LodFins = "LOD_FINS", false;
    /// A node that stands for nothing, or something that no node stands for.
    LodTree = "LOD_TREE", false;
    /// The box of a node does not hold it and all below it, or is larger.
    LodBox = "LOD_BOX", false;
    /// The error of a node is not more than those below it.
    LodError = "LOD_ERROR", false;
    /// The tree in 3D Tiles is not that of the levels.
    LodTileset = "LOD_TILESET", false;
}
