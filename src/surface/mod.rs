//! Marching cubes on the bits of a band: vertices on the lattice, triangles, neighbours and normals.

mod active_cubes;
mod assign_pieces;
mod caps;
pub mod case_table;
mod cell_numbers;
mod chords;
mod edges;
mod mesher;
mod samples;
mod split_pieces;
mod sums;
mod triangles;
mod vertex;
mod vertex_buffer;
mod vertex_shares;
mod vertices;

pub use assign_pieces::{Piece, PieceIndex, VertexAssignment, assign_vertices};
pub use chords::{
    BandEdges, ChordEnd, ChordFinder, ChordScale, Chords, FoundChords, WALL_AREA_STEPS, WALL_BINS,
};
pub use edges::Edges;
pub use mesher::{
    BYTES_PER_CUBE, BYTES_PER_TRIANGLE, BandView, CellsView, MeshSettings, Sizes, TileBox,
    TileMesh, TileMesher,
};
pub use split_pieces::BYTES_PER_SPLIT_VERTEX;

#[cfg(test)]
mod tests;
