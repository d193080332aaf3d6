//! A tile's vertices, where they stay: in the bytes of its BIN chunk.

use crate::grid::coordinate;
use crate::sys::direct_io::Buffer;

/// Bytes of a position, and of a normal.
const VECTOR: usize = size_of::<[f32; 3]>();

/// The beginning of a tile's BIN chunk: all positions in voxel coordinates, then all unit normals, three
/// floats each. Room for indices is behind them.
#[derive(Debug, Default)]
pub struct VertexBuffer {
    bytes: Buffer,
    vertices: usize,
}

impl VertexBuffer {
    /// Begins anew with `vertices`, which are all to be written yet.
    pub fn begin(&mut self, vertices: usize) {
        let [bytes, all] = bytes_of(vertices);
        self.bytes.begin(bytes, all);
        self.vertices = vertices;
    }

    /// Bytes of memory that [`VertexBuffer::begin`] takes beyond those of vertices and indices.
    pub fn rest_of_page(vertices: usize) -> usize {
        let [bytes, all] = bytes_of(vertices);
        Buffer::rest_of_page(bytes, all)
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// The numbers of all positions, multiples of 1/256 voxel, and then those of all normals.
    pub fn numbers(&self) -> &[f32] {
        bytemuck::cast_slice(&self.bytes.get()[..2 * VECTOR * self.vertices])
    }

    /// Positions and normals, to be written.
    pub fn vectors_mut(&mut self) -> [&mut [[f32; 3]]; 2] {
        let (positions, rest) = self.bytes.get_mut().split_at_mut(VECTOR * self.vertices);
        let normals = &mut rest[..VECTOR * self.vertices];
        [positions, normals].map(bytemuck::cast_slice_mut)
    }

    /// Adds vertices behind the last one: positions in lattice steps with their normals.
    pub fn extend(&mut self, more: &[([i32; 3], [f32; 3])]) {
        if more.is_empty() {
            return;
        }
        let before = self.vertices;
        let kept = self.vectors_mut().map(|vectors| vectors.to_vec());
        self.begin(before + more.len());
        let added = [
            more.iter().map(|(p, _)| p.map(coordinate)).collect(),
            more.iter().map(|&(_, n)| n).collect::<Vec<_>>(),
        ];
        for ((to, kept), added) in self.vectors_mut().into_iter().zip(kept).zip(added) {
            let (old, new) = to.split_at_mut(before);
            old.copy_from_slice(&kept);
            new.copy_from_slice(&added);
        }
    }

    /// Drops what is behind the vertices.
    pub fn truncate(&mut self) {
        self.bytes.truncate(2 * VECTOR * self.vertices);
    }

    /// Adds bytes behind the last one.
    pub fn extend_from_slice(&mut self, more: &[u8]) {
        self.bytes.extend_from_slice(more);
    }

    /// Replaces all bytes; no vertex is left.
    pub fn replace(&mut self, bytes: &[u8]) {
        self.vertices = 0;
        self.bytes.truncate(0);
        self.bytes.extend_from_slice(bytes);
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get()
    }

    /// Takes the bytes; no vertex is left.
    pub fn take(&mut self) -> Buffer {
        self.vertices = 0;
        std::mem::take(&mut self.bytes)
    }

    /// Gives memory for what comes next.
    pub fn give(&mut self, buffer: Buffer) {
        self.vertices = 0;
        self.bytes = buffer;
    }
}

/// Bytes of so many vertices, and with the indices behind them; seldom more.
fn bytes_of(vertices: usize) -> [usize; 2] {
    // two triangles to a vertex, and 10 bytes to a triangle
    [2 * VECTOR, 2 * VECTOR + 20].map(|each| each * vertices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::LATTICE;

    #[test]
    fn vertices_stay_where_they_are_and_what_is_behind_them_is_replaced() {
        let mut chunk = VertexBuffer::default();
        chunk.begin(2);
        let [positions, normals] = chunk.vectors_mut();
        positions.copy_from_slice(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        normals.copy_from_slice(&[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]);
        chunk.extend_from_slice(&[7; 100]);
        assert_eq!(chunk.bytes().len(), 48 + 100);
        // more vertices come behind the last one, and what was behind them is gone
        let half = LATTICE as i32 / 2;
        chunk.extend(&[([-half, 0, 3 * half], [1.0, 0.0, 0.0])]);
        chunk.extend(&[]);
        assert_eq!(chunk.vertices(), 3);
        chunk.extend_from_slice(&[8; 5]);
        chunk.truncate();
        chunk.extend_from_slice(&[9; 3]);
        let all: [[f32; 3]; 6] = [
            [1.0, 2.0, 3.0],
            [4.0, 5.0, 6.0],
            [-0.5, 0.0, 1.5],
            [0.0, 0.0, 1.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0],
        ];
        assert_eq!(chunk.numbers()[..9], *all[..3].as_flattened());
        let (vertices, behind) = chunk.bytes().split_at(72);
        assert_eq!(vertices, bytemuck::cast_slice::<_, u8>(&all));
        assert_eq!(behind, [9; 3]);
        // a tile without vertices may get all of them from its caps
        chunk.begin(0);
        chunk.extend(&[([0; 3], [1.0, 0.0, 0.0])]);
        assert_eq!((chunk.vertices(), chunk.bytes().len()), (1, 24));
        assert_eq!(chunk.take().get().len(), 24);
        assert_eq!((chunk.vertices(), chunk.bytes().len()), (0, 0));
    }

    #[test]
    fn bytes_begin_where_transfers_can_however_many_there_are() {
        let mut chunk = VertexBuffer::default();
        for vertices in [1, 1000, 10, 100_000, 3] {
            chunk.begin(vertices);
            let address = chunk.bytes().as_ptr().addr();
            assert!(address.is_multiple_of(crate::sys::direct_io::SECTOR));
            chunk.extend_from_slice(&vec![0; 20 * vertices]);
            assert_eq!(chunk.bytes().as_ptr().addr(), address, "{vertices}");
        }
    }
}
