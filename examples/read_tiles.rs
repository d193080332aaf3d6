//! Reading a tile set with nothing of alvis but the index: the tiles go through the `gltf` crate, as
//! they would in a program that does not know alvis. Sums the triangles and the volume of each cell.
//!
//! ```sh
//! cargo run --release --example read_tiles -- DIRECTORY
//! ```
//!
//! `alvis::tileset::TileSet::read_tile` gives the same triangles with less code, and those of tiles
//! in merged layout too.

use alvis::tileset::TileSet;
use glam::DVec3;
use gltf::mesh::Mode;
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// What is summed up for a cell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cell {
    /// Triangles in all tiles.
    pub triangles: u64,
    /// Volume inside the triangles, in cubic metres. Without meaning for a cell at the border of the
    /// scan: its surface is open there.
    pub volume: f64,
    /// The same, as the tiles' extras state it in the unit of the set; absent for an open cell.
    pub stated: Option<f64>,
}

/// Sums up the tile set in `dir`, by cell.
pub fn run(dir: &Path) -> Result<BTreeMap<u64, Cell>, Box<dyn Error>> {
    let set = TileSet::open(dir)?;
    let mut cells = BTreeMap::new();
    for entry in set.tiles() {
        let bytes = set.tile_bytes(&entry?)?;
        let tile = gltf::Gltf::from_slice(&bytes)?;
        let bin = tile.blob.as_deref().ok_or("no BIN chunk")?;
        for scene in tile.scenes() {
            for root in scene.nodes() {
                // the same in every tile: voxel coordinates to metres
                let matrix = glam::Mat4::from_cols_array_2d(&root.transform().matrix()).as_dmat4();
                for node in root.children() {
                    add(&node, bin, matrix, &mut cells)?;
                }
            }
        }
    }
    Ok(cells)
}

/// Adds a surface piece to its cell.
fn add(
    node: &gltf::Node,
    bin: &[u8],
    matrix: glam::DMat4,
    cells: &mut BTreeMap<u64, Cell>,
) -> Result<(), Box<dyn Error>> {
    let extras = node.extras().as_ref().ok_or("a tile in merged layout")?;
    let extras: serde_json::Value = serde_json::from_str(extras.get())?;
    let id = extras["cell"].as_u64().ok_or("extras without a cell")?;
    let cell: &mut Cell = cells.entry(id).or_default();
    cell.stated = extras["mesh_volume"].as_f64();
    for primitive in node.mesh().iter().flat_map(|m| m.primitives()) {
        let reader = primitive.reader(|_| Some(bin));
        let positions: Vec<DVec3> = reader
            .read_positions()
            .ok_or("no positions")?
            .map(|p| matrix.transform_point3(DVec3::from(p.map(f64::from))))
            .collect();
        let indices = reader.read_indices().ok_or("no indices")?.into_u32();
        for t in triangles(primitive.mode(), &indices.collect::<Vec<_>>()) {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            cell.triangles += 1;
            // triangles face into the cell, so its volume counts negative
            cell.volume -= a.dot(b.cross(c)) / 6.0;
        }
    }
    Ok(())
}

/// The triangles of a list or strip, without the joints of strips.
fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    if mode == Mode::Triangles {
        return indices.as_chunks::<3>().0.to_vec();
    }
    indices
        .windows(3)
        .enumerate()
        .map(|(k, t)| [t[k % 2], t[1 - k % 2], t[2]])
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect()
}

// a test includes this file for `run` alone
#[cfg_attr(test, allow(dead_code))]
fn main() -> ExitCode {
    let Some(dir) = std::env::args_os().nth(1) else {
        eprintln!("usage: read_tiles DIRECTORY");
        return ExitCode::from(2);
    };
    match run(Path::new(&dir)) {
        Ok(cells) => {
            for (id, cell) in cells {
                let Cell {
                    triangles, volume, ..
                } = cell;
                println!("cell {id}: {triangles} triangles, {volume:.3e} m^3");
            }
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}
