//! Marching cubes on the bits of a band: vertices on the lattice, triangles, neighbours and normals.

mod cubes;
mod edges;
mod pieces;
pub mod table;
mod tile;
mod vertex;

pub use pieces::Piece;
pub use tile::{BandView, MeshSettings, TileBox, TileMesh, TileMesher, sum_piece};

#[cfg(test)]
mod tests;
