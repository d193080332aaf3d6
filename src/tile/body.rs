//! The binary chunk of a tile: positions, normals and indices, piece by piece.

use crate::grid::LATTICE;
use crate::manifest::Primitives;
use crate::strip::{Stripifier, Triangle, append_strip};
use crate::surface::TileMesh;
use bytemuck::{Pod, Zeroable};

/// Where a piece lies in the body and what it counts.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct PieceRange {
    /// Byte of its first index in the body.
    pub first_index_byte: u64,
    /// First vertex.
    pub first_vertex: u32,
    /// Number of vertices.
    pub vertices: u32,
    /// Number of triangles.
    pub triangles: u32,
    /// Number of index entries.
    pub indices: u32,
    /// Strips before stitching; 0 for lists.
    pub strips: u32,
    /// Smallest vertex coordinates in lattice steps.
    pub min: [i32; 3],
    /// Largest ones.
    pub max: [i32; 3],
    reserved: u32,
}

/// True if indices of so many vertices are of 4 bytes: 65,535 stays free, for glTF forbids it.
pub(super) fn is_wide(vertices: u32) -> bool {
    vertices > 65_535
}

impl PieceRange {
    /// True if its indices are of 4 bytes.
    pub fn wide(&self) -> bool {
        is_wide(self.vertices)
    }

    /// Bytes of its indices, padding included.
    fn index_bytes(&self) -> u64 {
        let width = if self.wide() { 4 } else { 2 };
        (u64::from(self.indices) * width).next_multiple_of(4)
    }
}

/// Layout of a tile's BIN chunk: all positions, all normals, then each piece's indices, padded to 4
/// bytes.
#[derive(Debug, Clone, Default)]
pub struct Body {
    /// The pieces in order.
    pub pieces: Vec<PieceRange>,
    /// Vertices of all pieces.
    pub vertices: u32,
    /// Bytes of the chunk.
    pub bytes: u64,
}

impl Body {
    /// First byte of the indices.
    pub fn indices_start(&self) -> u64 {
        24 * u64::from(self.vertices)
    }

    /// Writes the body of a mesh: the indices, behind the vertices in its chunk.
    pub fn write(mesh: &mut TileMesh, primitives: Primitives, stripifier: &mut Stripifier) -> Body {
        let mut body = Body {
            vertices: mesh.chunk.vertices() as u32,
            ..Body::default()
        };
        let TileMesh {
            pieces,
            chunk,
            triangles,
        } = mesh;
        chunk.truncate();
        let mut indices = Vec::new();
        for piece in pieces.iter() {
            let faces = &mut triangles[piece.faces()];
            indices.clear();
            let strips = match primitives {
                Primitives::Strips => stripifier.stripify(faces, &mut indices),
                Primitives::Triangles => {
                    list(faces, &mut indices);
                    0
                }
            };
            let piece = PieceRange {
                first_index_byte: chunk.bytes().len() as u64,
                first_vertex: piece.first_vertex,
                vertices: piece.vertices,
                triangles: piece.triangles,
                indices: indices.len() as u32,
                strips: strips as u32,
                min: piece.min,
                max: piece.max,
                ..PieceRange::default()
            };
            write_indices(&piece, &indices, |bytes| chunk.extend_from_slice(bytes));
            body.pieces.push(piece);
        }
        body.bytes = chunk.bytes().len() as u64;
        body
    }

    /// Smallest and largest vertex coordinates of all pieces in lattice steps; nothing if there is none.
    pub fn bounds(&self) -> [[i32; 3]; 2] {
        let bound = |get: fn(&PieceRange) -> [i32; 3], pick: fn(i32, i32) -> i32| {
            let all = self.pieces.iter().map(get);
            all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
                .unwrap_or_default()
        };
        [bound(|p| p.min, i32::min), bound(|p| p.max, i32::max)]
    }

    /// A piece whose numbers have at least as many digits as those of any of the body.
    pub fn widest_piece(&self) -> PieceRange {
        let far = |a: usize| {
            let all = self.pieces.iter().map(|p| p.min[a].max(p.max[a]));
            // a voxel's last step has the longest fraction; two digits before it make up for a sign
            all.fold(10 * LATTICE as i32, i32::max) | (LATTICE as i32 - 1)
        };
        let far = std::array::from_fn(far);
        PieceRange {
            first_index_byte: self.bytes,
            first_vertex: self.vertices,
            vertices: self.vertices,
            indices: u32::try_from(self.bytes).unwrap_or(u32::MAX),
            min: far,
            max: far,
            ..PieceRange::default()
        }
    }

    /// The indices of a piece, read from the body's bytes.
    pub fn indices(&self, piece: &PieceRange, bytes: &[u8]) -> Vec<u32> {
        let start = piece.first_index_byte as usize;
        let data = &bytes[start..start + piece.index_bytes() as usize];
        let count = piece.indices as usize;
        if piece.wide() {
            let (words, _) = data.as_chunks::<4>();
            words[..count]
                .iter()
                .map(|&w| u32::from_le_bytes(w))
                .collect()
        } else {
            let (words, _) = data.as_chunks::<2>();
            words[..count]
                .iter()
                .map(|&w| u32::from(u16::from_le_bytes(w)))
                .collect()
        }
    }
}

/// Appends the triangles of a piece, whose first element is none.
fn list(piece: &[Triangle], out: &mut Vec<u32>) {
    out.extend(piece[1..].iter().flat_map(Triangle::corners));
}

/// Hands out a piece's indices in their width, padded to 4 bytes, a few hundred at a time.
pub(super) fn write_indices(piece: &PieceRange, indices: &[u32], mut put: impl FnMut(&[u8])) {
    if piece.wide() {
        return put(bytemuck::cast_slice(indices));
    }
    let mut low = [0u16; 512];
    for indices in indices.chunks(low.len()) {
        for (low, &index) in low.iter_mut().zip(indices) {
            *low = (index as u16).to_le();
        }
        put(bytemuck::cast_slice(&low[..indices.len()]));
    }
    if !indices.len().is_multiple_of(2) {
        put(&[0; 2]);
    }
}

/// Adds the indices of a piece, plus `offset`, to those of others.
pub(super) fn append_indices(
    all: &mut Vec<u32>,
    piece: &[u32],
    offset: u32,
    primitives: Primitives,
) {
    match primitives {
        Primitives::Strips => append_strip(all, piece, offset),
        Primitives::Triangles => all.extend(piece.iter().map(|i| i + offset)),
    }
}
