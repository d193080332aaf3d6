//! The index of levels of detail: `lod/index.json`, and for each level a shard per layer of nodes.
//!
//! A level is a grid of nodes, each of which stands for 2 x 2 x 2 of the level below; level 0 are the tiles. Paths are
//! relative to the directory of the tile set.

use super::{Bounds, Generator, Manifest, file_inside};
use crate::error::{Error, Result};
use crate::store::File;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};
use std::io::BufReader;
use std::path::Path;

/// Value of [`Levels::format`].
pub const LEVELS_FORMAT: &str = "alvis-lod";
/// Value of [`Levels::format_version`] that this library reads and writes.
pub const LEVELS_VERSION: u32 = 1;
/// Path of the index of levels in a tile set.
pub const LEVELS: &str = "lod/index.json";
/// Path of the root of the tile set in 3D Tiles.
pub const TILESET: &str = "tileset.json";
/// Pixels that viewers of 3D Tiles take for sharp by default.
pub const DEFAULT_PIXELS: f64 = 16.0;

/// What `index.json` says of levels of detail.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LevelsEntry {
    /// [`LEVELS`].
    pub path: String,
    /// How many levels there are, the tiles counted.
    pub levels: u32,
    /// Bytes of the index of levels.
    pub bytes: u64,
    /// Its checksum, see [`super::TileEntry::checksum`].
    pub checksum: String,
}

/// `lod/index.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Levels {
    /// [`LEVELS_FORMAT`].
    pub format: String,
    /// [`LEVELS_VERSION`].
    pub format_version: u32,
    /// The program that made the levels.
    pub generator: Generator,
    /// Share of triangles that a level keeps of the one below.
    pub ratio: f64,
    /// Pixels that an error may have on the screen; `geometricError` of [`TILESET`] follows from it.
    pub pixel_error: f64,
    /// Levels 1, 2, ..., the coarsest last.
    pub levels: Vec<Level>,
}

/// A level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Its number, from 1 on.
    pub level: u32,
    /// Cubes per node and axis.
    pub macrocube: [u64; 3],
    /// Nodes per axis, with those that have no surface.
    pub grid: [u32; 3],
    /// Positions are multiples of so many lattice steps.
    pub step: u32,
    /// Width of the blocks of space in which vertices became one, in lattice steps.
    pub block: u32,
    /// Nodes with a surface.
    pub nodes: u64,
    /// Triangles of surfaces.
    pub triangles: u64,
    /// Triangles of fins.
    pub fin_triangles: u64,
    /// Vertices, those of fins counted.
    pub vertices: u64,
    /// Edges of the curves in which nodes meet, counted in each: one for each fin that is no point, also where collapsed
    /// triangles left none at it.
    pub border_edges: u64,
    /// Cells that have a triangle.
    pub cells: u64,
    /// Bytes of the nodes' files.
    pub bytes: u64,
    /// The largest [`NodeEntry::error`].
    pub error_max: f64,
    /// How far borders lie from those of the level below at most, in voxels.
    pub curve_tolerance: f64,
    /// The largest [`NodeEntry::fin_width`].
    pub fin_width: f64,
    /// The layers of nodes that have one, by rising z.
    pub layers: Vec<super::Layer>,
}

/// The nodes of a layer: a file such as `lod/2/z0003.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeShard {
    /// The level.
    pub level: u32,
    /// z index of the nodes.
    pub z: u32,
    /// The nodes, by rising y, then x.
    pub nodes: Vec<NodeEntry>,
}

/// A node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeEntry {
    /// `lod/2/z0003/y0002_x0005.glb`.
    pub path: String,
    /// Index in the grid of its level, x first.
    pub grid: [u32; 3],
    /// Box of all vertices of the node and of all below it, in voxel coordinates.
    #[serde(rename = "box")]
    pub bounds: Bounds,
    /// How far surfaces of the tiles lie from its own, in voxels: measured from level to level, as what 99.9 % of the
    /// vertices of the level below, and of the middles of triangles of nodes, lie within, and summed up on the way from
    /// the tiles; a surface that is gone counts by half of its diagonal. More than that of any node below.
    pub error: f64,
    /// How far its border lies from those of its children in its planes at most, in voxels.
    pub curve_gap: f64,
    /// Half the width of its fins, in voxels: how far its border lies from those of all nodes below at most.
    pub fin_width: f64,
    /// Vertices in the file.
    pub vertices: u64,
    /// Triangles of surfaces.
    pub triangles: u64,
    /// Triangles of fins.
    pub fin_triangles: u64,
    /// Rows of the property table, the last ones, that are of fins.
    pub fin_rows: u32,
    /// Strips before stitching.
    pub strips: u64,
    /// Index entries in the file.
    pub indices: u64,
    /// Edges of the curves in which it meets others, some of which no triangle of its has any more.
    pub border_edges: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Checksum of the file, see [`super::TileEntry::checksum`].
    pub checksum: String,
}

/// Path of a node of a level from 1 on.
pub(crate) fn node_path(level: u32, [x, y, z]: [u32; 3]) -> String {
    format!("lod/{level}/z{z:04}/y{y:04}_x{x:04}.glb")
}

/// Path of the shard of a layer of nodes.
pub(crate) fn node_shard_path(level: u32, z: u32) -> String {
    format!("lod/{level}/z{z:04}.json")
}

/// Path of a tileset of 3D Tiles below the root, of the node on top of it.
pub(crate) fn tileset_path(level: u32, [x, y, z]: [u32; 3]) -> String {
    format!("lod/tilesets/{level}_z{z}_y{y}_x{x}.json")
}

/// The path of a file of levels of detail, if a text is one, letter by letter: made anew from the numbers in it.
pub(crate) fn level_file(text: &str) -> Option<String> {
    let numbers = text.split(|c: char| !c.is_ascii_digit());
    let numbers = numbers.filter(|digits| !digits.is_empty() && digits.len() <= 10);
    let numbers = numbers.map(|digits| digits.parse::<u32>().ok());
    let numbers: Vec<u32> = numbers.take(5).collect::<Option<_>>()?;
    let made = match numbers[..] {
        [] => vec![LEVELS.to_owned(), TILESET.to_owned()],
        [level, z] => vec![node_shard_path(level, z)],
        [level, z, y, x] => vec![node_path(level, [x, y, z]), tileset_path(level, [x, y, z])],
        _ => Vec::new(),
    };
    made.into_iter().find(|made| made == text)
}

impl Levels {
    /// The levels of the tile set in `dir` with this manifest; `None` if it has the tiles alone.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the index is not one of levels that this version reads.
    pub fn open(dir: &Path, manifest: &Manifest) -> Result<Option<Levels>> {
        let Some(entry) = &manifest.lod else {
            return Ok(None);
        };
        let levels: Levels = parse(dir, &entry.path, "an index of levels")?;
        if levels.format != LEVELS_FORMAT || levels.format_version != LEVELS_VERSION {
            let found = format!("format {} version {}", levels.format, levels.format_version);
            let expected = format!("\"{LEVELS_FORMAT}\" version {LEVELS_VERSION}");
            return Err(Error::format(dir.join(&entry.path), found, expected));
        }
        let numbers = levels.levels.iter().map(|level| level.level);
        if !numbers.eq(1..=levels.levels.len() as u32) || levels.levels.is_empty() {
            let found = format!("{} levels", levels.levels.len());
            return Err(Error::format(
                dir.join(&entry.path),
                found,
                "levels 1, 2, ...",
            ));
        }
        Ok(Some(levels))
    }

    /// The nodes of a level, by rising z, then y, then x; a layer of them at a time is in memory.
    ///
    /// # Errors
    /// An item is an error if a shard is missing or damaged.
    pub fn nodes<'a>(
        dir: &'a Path,
        level: &'a Level,
    ) -> impl Iterator<Item = Result<NodeEntry>> + 'a {
        level.layers.iter().flat_map(move |layer| {
            let (nodes, error) = match NodeShard::open(dir, level.level, layer) {
                Ok(shard) => (shard.nodes, None),
                Err(error) => (Vec::new(), Some(Err(error))),
            };
            error.into_iter().chain(nodes.into_iter().map(Ok))
        })
    }
}

impl NodeShard {
    /// Reads the shard of a layer of a level.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if it is not that of this layer.
    pub fn open(dir: &Path, level: u32, layer: &super::Layer) -> Result<NodeShard> {
        let shard: NodeShard = parse(dir, &layer.path, "a list of nodes")?;
        if (shard.level, shard.z) != (level, layer.z) {
            let found = format!("layer {} of level {}", shard.z, shard.level);
            let expected = format!("layer {} of level {level}", layer.z);
            return Err(Error::format(dir.join(&layer.path), found, expected));
        }
        Ok(shard)
    }
}

/// Refuses a file of the tile set in `dir` that holds no JSON.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`], which says `what` was expected.
pub(crate) fn check_json(dir: &Path, path: &str, what: &str) -> Result<()> {
    parse::<IgnoredAny>(dir, path, what).map(|_| ())
}

/// Reads a JSON file of the tile set in `dir`.
fn parse<T: DeserializeOwned>(dir: &Path, path: &str, what: &str) -> Result<T> {
    let real = file_inside(dir, path, "read the levels")?;
    let path = dir.join(path);
    let file = File::open(&real).map_err(|e| Error::io(&path, "read the levels", e))?;
    serde_json::from_reader(BufReader::with_capacity(1 << 16, file)).map_err(|e| {
        match e.io_error_kind() {
            Some(_) => Error::io(&path, "read the levels", e.into()),
            None => Error::format(&path, e.to_string(), what),
        }
    })
}
