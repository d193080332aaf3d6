//! The binary chunk of a tile: positions, normals and indices, piece by piece.

use crate::grid::LATTICE;
use crate::manifest::Primitives;
use crate::mesh::{TileMesh, by_surface};
use crate::strip::{Stripifier, Triangle, append_strip};
use bytemuck::{Pod, Zeroable};

/// Where a piece lies in the body and what it counts.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct BodyPiece {
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

impl BodyPiece {
    /// Of no vertices, at the beginning.
    const NONE: BodyPiece = BodyPiece {
        first_index_byte: 0,
        first_vertex: 0,
        vertices: 0,
        triangles: 0,
        indices: 0,
        strips: 0,
        min: [i32::MAX; 3],
        max: [i32::MIN; 3],
        reserved: 0,
    };

    /// Adds the counts of another piece, but for its indices, which are to be joined first.
    fn add(&mut self, other: &BodyPiece) {
        self.vertices += other.vertices;
        self.triangles += other.triangles;
        self.strips += other.strips;
        for a in 0..3 {
            self.min[a] = self.min[a].min(other.min[a]);
            self.max[a] = self.max[a].max(other.max[a]);
        }
    }

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
    pub pieces: Vec<BodyPiece>,
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

    /// Writes the body of a mesh: the indices, behind the vertices in its chunk. Pieces that are known to be of one
    /// surface are one.
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
        let (mut indices, mut part) = (Vec::new(), Vec::new());
        for surface in by_surface(pieces).chunk_by(|&a, &b| pieces[a].first == pieces[b].first) {
            indices.clear();
            let mut joined = BodyPiece {
                first_index_byte: chunk.bytes().len() as u64,
                first_vertex: pieces[surface[0]].first_vertex,
                ..BodyPiece::NONE
            };
            for &number in surface {
                let piece = &pieces[number];
                let faces = &mut triangles[piece.faces()];
                let mut make = |out: &mut Vec<u32>| match primitives {
                    Primitives::Strips => stripifier.stripify(faces, out) as u32,
                    Primitives::Triangles => list(faces, out),
                };
                // most surfaces are of one piece
                let strips = if joined.vertices == 0 {
                    make(&mut indices)
                } else {
                    part.clear();
                    let strips = make(&mut part);
                    append_indices(&mut indices, &part, joined.vertices, primitives);
                    strips
                };
                joined.add(&BodyPiece {
                    vertices: piece.vertices,
                    triangles: piece.triangles,
                    strips,
                    min: piece.min,
                    max: piece.max,
                    ..BodyPiece::NONE
                });
            }
            joined.indices = indices.len() as u32;
            write_indices(&joined, &indices, |bytes| chunk.extend_from_slice(bytes));
            body.pieces.push(joined);
        }
        body.bytes = chunk.bytes().len() as u64;
        body
    }

    /// Smallest and largest vertex coordinates of all pieces in lattice steps; nothing if there is none.
    pub fn bounds(&self) -> [[i32; 3]; 2] {
        let bound = |get: fn(&BodyPiece) -> [i32; 3], pick: fn(i32, i32) -> i32| {
            let all = self.pieces.iter().map(get);
            all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
                .unwrap_or_default()
        };
        [bound(|p| p.min, i32::min), bound(|p| p.max, i32::max)]
    }

    /// A piece whose numbers have at least as many digits as those of any of the body.
    pub fn widest_piece(&self) -> BodyPiece {
        let far = |a: usize| {
            let all = self.pieces.iter().map(|p| p.min[a].max(p.max[a]));
            // a voxel's last step has the longest fraction; two digits before it make up for a sign
            all.fold(10 * LATTICE as i32, i32::max) | (LATTICE as i32 - 1)
        };
        let far = std::array::from_fn(far);
        BodyPiece {
            first_index_byte: self.bytes,
            first_vertex: self.vertices,
            vertices: self.vertices,
            indices: u32::try_from(self.bytes).unwrap_or(u32::MAX),
            min: far,
            max: far,
            ..BodyPiece::zeroed()
        }
    }

    /// The indices of a piece, read from the body's bytes.
    pub fn indices(&self, piece: &BodyPiece, bytes: &[u8]) -> Vec<u32> {
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

/// Appends the triangles of a piece, whose first element is none; returns that these are no strips.
fn list(piece: &[Triangle], out: &mut Vec<u32>) -> u32 {
    out.extend(piece[1..].iter().flat_map(Triangle::corners));
    0
}

/// Hands out a piece's indices in their width, padded to 4 bytes, a few hundred at a time.
pub(super) fn write_indices(piece: &BodyPiece, indices: &[u32], mut put: impl FnMut(&[u8])) {
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

/// Pieces of a body joined to groups, which are the pieces of another body.
pub struct Grouped<'a> {
    /// That body.
    pub body: Body,
    /// Its pieces' indices.
    indices: Vec<Vec<u32>>,
    from: &'a Body,
    bytes: &'a [u8],
    groups: &'a [Vec<usize>],
}

impl<'a> Grouped<'a> {
    /// Joins pieces: `groups[g]` lists those of the new piece g, in the order in which their vertices, triangles and
    /// strips follow each other there.
    pub fn new(
        from: &'a Body,
        bytes: &'a [u8],
        groups: &'a [Vec<usize>],
        primitives: Primitives,
    ) -> Self {
        let mut body = Body {
            vertices: from.vertices,
            ..Body::default()
        };
        body.bytes = body.indices_start();
        let mut first_vertex = 0;
        let mut indices = Vec::with_capacity(groups.len());
        for group in groups {
            let (piece, of_piece) = join_pieces(from, bytes, group, primitives);
            let piece = BodyPiece {
                first_vertex,
                first_index_byte: body.bytes,
                ..piece
            };
            first_vertex += piece.vertices;
            body.bytes += piece.index_bytes();
            body.pieces.push(piece);
            indices.push(of_piece);
        }
        Grouped {
            body,
            indices,
            from,
            bytes,
            groups,
        }
    }

    /// Hands out the bytes of the new body in their order, part by part.
    pub fn write(&self, mut put: impl FnMut(&[u8])) {
        for attribute in 0..2 {
            let base = 12 * self.from.vertices as usize * attribute;
            for &p in self.groups.iter().flatten() {
                let piece = &self.from.pieces[p];
                let first = base + 12 * piece.first_vertex as usize;
                put(&self.bytes[first..first + 12 * piece.vertices as usize]);
            }
        }
        for (piece, indices) in self.body.pieces.iter().zip(&self.indices) {
            write_indices(piece, indices, &mut put);
        }
    }

    /// The bytes of the new body.
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.body.bytes as usize);
        self.write(|part| bytes.extend_from_slice(part));
        bytes
    }
}

/// The counts and indices of several pieces as one.
fn join_pieces(
    body: &Body,
    bytes: &[u8],
    group: &[usize],
    primitives: Primitives,
) -> (BodyPiece, Vec<u32>) {
    let mut joined = BodyPiece::NONE;
    let mut indices = Vec::new();
    for &p in group {
        let piece = &body.pieces[p];
        let part = body.indices(piece, bytes);
        append_indices(&mut indices, &part, joined.vertices, primitives);
        joined.add(piece);
    }
    joined.indices = indices.len() as u32;
    (joined, indices)
}
