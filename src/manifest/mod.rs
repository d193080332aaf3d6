//! The index of a tile set: `index.json`, the manifest, and one shard per layer of macrocubes.
//!
//! These types are the interface between the producer, the verifier and other programs; their JSON
//! form is `schema/manifest.schema.json` and `schema/shard.schema.json`. Every path is relative to
//! the directory of the manifest, with `/` between its parts.

pub(crate) mod batch;
mod form;
mod levels;
mod open;
mod parts_by;
mod seal;
mod selection;
mod shard;
mod shard_text;
mod shard_writer;
mod tables;

pub(crate) use batch::batch;
pub use form::{Encoding, Form, Layout, Primitives};
pub use levels::{
    DEFAULT_PIXELS, LEVELS, LEVELS_FORMAT, LEVELS_VERSION, Level, Levels, LevelsEntry, NodeEntry,
    NodeShard, TILESET,
};
pub(crate) use levels::{check_json, level_file, node_path, node_shard_path, tileset_path};
pub use open::{MANIFEST, PARTIAL, file_inside, inside, is_plain, manifest_file};
pub use parts_by::{PartsBy, SPLIT_VERSION};
pub(crate) use seal::{checksum_of, own_checksum, sums_of};
pub use selection::{ColourBy, Paint, Painted, Selection, Step, Table, WholeTotals};
pub(crate) use selection::{LEGEND, LEGEND_SVG};
pub use shard::ShardTiles;
pub(crate) use shard_text::{ShardFault, ShardText};
pub(crate) use shard_writer::{ShardWriter, entry_text, shard_path};
pub(crate) use tables::{
    COMPONENTS, COMPONENTS_PARQUET, NECKS, NECKS_PARQUET, WALLS, WALLS_PARQUET,
};
pub use tables::{ParquetTables, TableChecksums, Tables};

use crate::error::Result;
use crate::grid::{Ambiguous, Crop, Dims, Placement, Tiling, Unit, filtered_dims, filtered_dtype};
use crate::grid::{Dtype, Endian};
pub use crate::grid::{Filter, Origin, Part, Provenance, Region};
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

/// Value of [`Manifest::format`].
pub const FORMAT: &str = "alvis-tiles";
/// Value of [`Manifest::format_version`] that this library reads and writes.
pub const FORMAT_VERSION: u32 = 1;

/// `index.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// The program that wrote the tiles.
    pub generator: Generator,
    /// The volume the tiles were made from.
    pub source: Source,
    /// What was done to the samples before they were compared with the threshold, in this order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<Filter>,
    /// The region of interest, of which voxels outside were taken for one phase; all of the grid if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<Region>,
    /// The grid the tiles cover (the crop, if there is one) and its macrocubes.
    pub grid: GridInfo,
    /// Spacing, unit, origin and directions of `grid`, flat: see [`Placement`].
    #[serde(flatten)]
    pub placement: Placement,
    /// Unit of lengths in tables and in the measures that tiles carry; that of the placement if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table_unit: Option<Unit>,
    /// The iso value T: a voxel v is above iff v >= T.
    pub threshold: f64,
    /// Which voxels an ambiguous face joins.
    pub ambiguous: Ambiguous,
    /// True if the surface is closed half a voxel outside the volume's faces.
    pub cap: bool,
    /// What cells are, where they are not the components of below voxels but parts of these.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cells: Option<PartsBy>,
    /// What was left out as dust, if anything was to be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dust: Option<Dust>,
    /// Kind of every primitive in every tile.
    pub primitives: Primitives,
    /// How every tile stores its numbers.
    #[serde(default)]
    pub encoding: Encoding,
    /// Which tiles have one mesh for all their pieces.
    #[serde(default)]
    pub layout: Layout,
    /// Lattice steps per voxel: 256.
    pub lattice: u32,
    /// The root node's matrix: voxel coordinates to metres, Y up, column-major.
    pub transform: [f64; 16],
    /// Sums over all tiles.
    pub totals: Totals,
    /// One entry per layer of macrocubes that has a tile, by rising z.
    pub layers: Vec<Layer>,
    /// The tables of cells, objects and surfaces.
    pub tables: Tables,
    /// How the set was chosen from another one; absent if it is a whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// Levels of detail over the tiles; absent if there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lod: Option<LevelsEntry>,
    /// Checksum of this file, as [`TileEntry::checksum`], with its own eight digits as zeros;
    /// `None` until it is written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksum: Option<String>,
}

impl Manifest {
    /// How macrocubes cover the grid.
    pub fn tiling(&self) -> Tiling {
        Tiling {
            dims: self.grid.dims,
            macrocube: self.grid.macrocube,
        }
    }

    /// Size of the volume that the filters make of the source, before the crop.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if they make none.
    pub fn filtered_dims(&self) -> Result<Dims> {
        filtered_dims(self.source.dims, &self.filters)
    }

    /// Type of the samples that were compared with the threshold.
    pub fn filtered_dtype(&self) -> Dtype {
        filtered_dtype(self.source.dtype, &self.filters)
    }

    /// True if surfaces may end inside of the grid: in a part, where a cell that was left out touched one that was not.
    pub(crate) fn may_gape(&self) -> bool {
        self.is_part() && self.cells.is_some()
    }

    /// True if the set lacks components of the whole that it was selected from: then ids have gaps,
    /// and what a whole surface obeys need not hold. A painted copy of all cells is a whole.
    pub fn is_part(&self) -> bool {
        let t = &self.totals;
        self.selection.as_ref().is_some_and(|s| {
            (s.of.cells, s.of.objects, s.of.surfaces) != (t.cells, t.objects, t.surfaces)
        })
    }
}

/// The program that wrote a tile set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Generator {
    /// `alvis`.
    pub name: String,
    /// Its version.
    pub version: String,
}

/// The volume that tiles were made from, with what is needed to open it again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// The input's file name, without its directory.
    pub name: String,
    /// `raw`, `metaimage`, `nrrd`, ...
    pub format: String,
    /// Size of the whole volume in voxels, before filters and crop.
    pub dims: Dims,
    /// Sample type, before filters.
    pub dtype: Dtype,
    /// How the values follow from what the file stores, as it states; absent if they are what it stores.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub values: Option<String>,
    /// Byte order in the file.
    pub endian: Endian,
    /// Bytes before the first sample of a headerless raw file; 0 for other formats.
    pub offset: u64,
    /// The part that was converted, in voxels of the whole volume after filters; absent if all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<Crop>,
    /// What was asked for of an input that may hold several volumes.
    #[serde(flatten)]
    pub part: Part,
    /// Where spacing, unit and origin came from.
    pub provenance: Provenance,
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

/// Components that were left out and filled with the other phase, since they have few voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dust {
    /// Components of fewer voxels were left out.
    pub min_voxels: u64,
    /// Number of objects left out.
    pub objects: u64,
    /// Their voxels.
    pub object_voxels: u64,
    /// Number of cells left out, counted after the objects were filled.
    pub cells: u64,
    /// Their voxels.
    pub cell_voxels: u64,
}

/// The grid that tiles cover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct GridInfo {
    /// Voxels per axis.
    pub dims: Dims,
    /// Cubes per macrocube and axis.
    pub macrocube: [u32; 3],
    /// Macrocubes per axis.
    pub tiles: [u32; 3],
}

/// Sums over a tile set. Counts of a set without `--cap` are those of the open surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Totals {
    /// Tiles written; a macrocube without surface has none.
    pub tiles: u64,
    /// Triangles, degenerates of strips not counted; caps are counted.
    pub triangles: u64,
    /// Lattice vertices, each counted once; caps are counted.
    pub vertices: u64,
    /// Vertices as written: those on shared planes once per tile and node.
    pub tile_vertices: u64,
    /// Strips before stitching; 0 for triangle lists.
    pub strips: u64,
    /// Index entries of strips, stitches included; 0 for triangle lists.
    pub strip_indices: u64,
    /// Connected components of above voxels.
    pub objects: u64,
    /// Cells: connected components of below voxels, or parts of them where the manifest says what cells are.
    pub cells: u64,
    /// Connected components of below voxels, where cells are parts of them; 0 and not written where they are the cells.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub components: u64,
    /// Openings between cells of one component: rows of the table of necks; 0 and not written where there is none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub necks: u64,
    /// Pairs of cells with a wall between them: rows of the table of walls; 0 and not written where there is none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub walls: u64,
    /// Connected components of triangles (without caps).
    pub surfaces: u64,
    /// Triangle edges without a mate: where an open surface meets the volume's faces; 0 with caps.
    pub border_edges: u64,
    /// Vertices - edges + triangles of the whole surface, caps included.
    pub euler_characteristic: i64,
    /// Triangles of caps, contained in `triangles`.
    pub cap_triangles: u64,
    /// Bytes of all tiles.
    pub bytes: u64,
    /// Above voxels.
    pub voxels_above: u64,
    /// NaN samples, which count as below.
    pub voxels_nan: u64,
    /// 6 times the signed volume that the surface's triangles span with the origin, in lattice
    /// units (voxel/256)^3: an exact integer, as a decimal string since it may pass 2^53.
    #[serde(with = "decimal")]
    pub volume6: i128,
}

impl Totals {
    /// Adds what a tile's entry says of the tile, which may be anything in an index from elsewhere.
    pub(crate) fn add_tile(&mut self, tile: &TileEntry) {
        let add = |sum: &mut u64, value: u64| *sum = sum.saturating_add(value);
        add(&mut self.tiles, 1);
        add(&mut self.tile_vertices, tile.vertices);
        add(&mut self.triangles, tile.triangles);
        add(&mut self.strips, tile.strips);
        add(&mut self.bytes, tile.bytes);
        if tile.strips > 0 {
            add(&mut self.strip_indices, tile.indices);
        }
    }
}

/// One layer of macrocubes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layer {
    /// z index of the macrocubes.
    pub z: u32,
    /// The shard's path: `index/z0003.json`.
    pub path: String,
    /// Tiles in the shard.
    pub tiles: u64,
    /// Bytes of the shard file.
    pub bytes: u64,
    /// Checksum of the shard file, see [`TileEntry::checksum`].
    pub checksum: String,
}

/// A layer in few bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct LayerRecord {
    /// See [`Layer`].
    pub z: u32,
    /// CRC-32 of the shard file.
    pub crc: u32,
    /// See [`Layer`].
    pub tiles: u64,
    /// See [`Layer`].
    pub bytes: u64,
}

/// `index/zNNNN.json`: the tiles of one layer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shard {
    /// z index of the macrocubes.
    pub z: u32,
    /// The tiles, by rising y, then x.
    pub tiles: Vec<TileEntry>,
}

/// One tile in a shard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileEntry {
    /// `tiles/z0003/y0002_x0005.glb`.
    pub path: String,
    /// Macrocube index, x first.
    pub grid: [u32; 3],
    /// Bounding box of the vertices in voxel coordinates.
    #[serde(rename = "box")]
    pub bounds: Bounds,
    /// Vertices in the file.
    pub vertices: u64,
    /// Triangles, degenerates not counted.
    pub triangles: u64,
    /// Strips before stitching; 0 for triangle lists.
    pub strips: u64,
    /// Index entries in the file.
    pub indices: u64,
    /// Size of the file.
    pub bytes: u64,
    /// `crc32:` and 8 hexadecimal digits: the CRC-32 (IEEE 802.3, as in gzip) of the whole file.
    pub checksum: String,
    /// The surface pieces, in the order of the file's nodes (or features).
    pub groups: Vec<Group>,
}

/// A box in voxel coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: [f64; 3],
    /// Largest coordinates.
    pub max: [f64; 3],
}

/// One surface piece of a tile: all its triangles between one cell and one object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// The cell; 0 for a cap.
    pub cell: u64,
    /// The object.
    pub object: u64,
    /// The surface; 0 for a cap.
    pub surface: u64,
    /// Vertices of the piece.
    pub vertices: u64,
    /// Triangles of the piece, degenerates not counted.
    pub triangles: u64,
}

impl std::fmt::Display for Group {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "cell {}, object {}, surface {} with {} vertices and {} triangles",
            self.cell, self.object, self.surface, self.vertices, self.triangles
        )
    }
}

/// `i128` as a decimal string.
mod decimal {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(v: &i128, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(v)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<i128, D::Error> {
        let text = String::deserialize(d)?;
        text.parse().map_err(D::Error::custom)
    }
}

/// The checksum text of a CRC-32.
pub fn checksum_text(crc: u32) -> String {
    format!("crc32:{crc:08x}")
}
