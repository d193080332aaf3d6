//! What a parent has to know of a child: an entry of the index, of a tile or a node, in few bytes.

use crate::error::Result;
use crate::manifest::{Bounds, NodeEntry, TileEntry};
use crate::tileset::Stated;
use std::path::Path;

/// A tile or a node.
#[derive(Debug, Clone)]
pub struct Entry {
    pub path: String,
    pub grid: [u32; 3],
    pub bounds: Bounds,
    pub vertices: u64,
    pub triangles: u64,
    pub pieces: u64,
    pub bytes: u64,
    pub checksum: String,
    /// 0 of tiles.
    pub error: f64,
    /// Half the width of its fins, in voxels; 0 of tiles.
    pub fin_width: f64,
}

impl Entry {
    /// Of a tile.
    pub fn of_tile(tile: TileEntry) -> Self {
        Entry {
            pieces: tile.groups.len() as u64,
            path: tile.path,
            grid: tile.grid,
            bounds: tile.bounds,
            vertices: tile.vertices,
            triangles: tile.triangles,
            bytes: tile.bytes,
            checksum: tile.checksum,
            error: 0.0,
            fin_width: 0.0,
        }
    }

    /// Of a node.
    pub fn of_node(node: NodeEntry) -> Self {
        Entry {
            // of those alone that have fins is the number known; others are not many
            pieces: u64::from(node.fin_rows),
            path: node.path,
            grid: node.grid,
            bounds: node.bounds,
            vertices: node.vertices,
            triangles: node.triangles + node.fin_triangles,
            bytes: node.bytes,
            checksum: node.checksum,
            error: node.error,
            fin_width: node.fin_width,
        }
    }

    /// Its file below a directory.
    ///
    /// # Errors
    /// Those of [`Stated::read`].
    pub fn read(&self, dir: &Path) -> Result<Vec<u8>> {
        let stated = Stated {
            path: &self.path,
            bytes: self.bytes,
            checksum: &self.checksum,
        };
        stated.read(dir)
    }
}

/// Bytes that a node takes while it is made, for each vertex and triangle of its children, and of a child while it is
/// read, for each byte, vertex, triangle and piece.
const VERTEX: u64 = 200;
const TRIANGLE: u64 = 60;
const READ_BYTE: u64 = 2;
const READ_VERTEX: u64 = 60;
const READ_TRIANGLE: u64 = 40;
const READ_PIECE: u64 = 4 << 10;

/// Bytes that the node over these children takes while it is made.
pub fn memory(children: &[Entry]) -> u64 {
    let all = |bytes: fn(&Entry) -> u64| children.iter().map(bytes).fold(0, u64::saturating_add);
    let held = all(|c| c.vertices.saturating_mul(VERTEX))
        .saturating_add(all(|c| c.triangles.saturating_mul(TRIANGLE)));
    let read = |c: &Entry| {
        let parts = [
            c.bytes.saturating_mul(READ_BYTE),
            c.vertices.saturating_mul(READ_VERTEX),
            c.triangles.saturating_mul(READ_TRIANGLE),
            c.pieces.saturating_mul(READ_PIECE),
        ];
        parts.into_iter().fold(0, u64::saturating_add)
    };
    held.saturating_add(children.iter().map(read).max().unwrap_or(0))
}
