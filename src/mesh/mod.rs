//! Marching cubes on the bits of a band: vertices on the lattice, triangles, neighbours and normals.

mod active;
mod cap;
mod chunk;
mod connect;
mod cubes;
mod edges;
mod gather;
mod pieces;
mod sums;
pub mod table;
mod tile;
mod vertex;
mod vertices;

pub use connect::connect;
pub use edges::Edges;
pub use pieces::{CAP, Piece, PieceIndex, Sheets, assign, by_surface};
pub use tile::{
    BYTES_PER_CUBE, BYTES_PER_TRIANGLE, BandView, MeshSettings, Sizes, TileBox, TileMesh,
    TileMesher,
};

#[cfg(test)]
mod tests;
