//! The binary chunk of a tile: positions, normals and indices, piece by piece.

use crate::grid::LATTICE;
use crate::manifest::Primitives;
use crate::strip::{Stripifier, Triangle, append_strip};
use crate::surface::{TileMesh, by_surface};
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
        let mut joined = Joined::default();
        for surface in by_surface(pieces).chunk_by(|&a, &b| pieces[a].first == pieces[b].first) {
            joined.clear();
            for &number in surface {
                let piece = &pieces[number];
                let faces = &mut triangles[piece.faces()];
                joined.add(primitives, |indices| {
                    let strips = match primitives {
                        Primitives::Strips => stripifier.stripify(faces, indices),
                        Primitives::Triangles => {
                            list(faces, indices);
                            0
                        }
                    };
                    PieceRange {
                        vertices: piece.vertices,
                        triangles: piece.triangles,
                        strips: strips as u32,
                        min: piece.min,
                        max: piece.max,
                        ..PieceRange::default()
                    }
                });
            }
            let piece = PieceRange {
                first_index_byte: chunk.bytes().len() as u64,
                first_vertex: pieces[surface[0]].first_vertex,
                ..joined.counts
            };
            write_indices(&piece, &joined.indices, |bytes| {
                chunk.extend_from_slice(bytes)
            });
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
            let mut joined = Joined::default();
            for &p in group {
                let piece = &from.pieces[p];
                joined.add(primitives, |indices| {
                    *indices = from.indices(piece, bytes);
                    *piece
                });
            }
            let piece = PieceRange {
                first_vertex,
                first_index_byte: body.bytes,
                ..joined.counts
            };
            first_vertex += piece.vertices;
            body.bytes += piece.index_bytes();
            body.pieces.push(piece);
            indices.push(joined.indices);
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

/// Several pieces as one.
#[derive(Default)]
struct Joined {
    /// All but where it lies; without pieces, of no meaning but for the number of vertices.
    counts: PieceRange,
    indices: Vec<u32>,
    /// Of the piece that is added.
    part: Vec<u32>,
}

impl Joined {
    /// Begins anew.
    fn clear(&mut self) {
        self.counts = PieceRange::default();
        self.indices.clear();
    }

    /// Adds the piece that `make` makes, with its indices in the empty memory that it is handed.
    fn add(&mut self, primitives: Primitives, make: impl FnOnce(&mut Vec<u32>) -> PieceRange) {
        let all = &mut self.counts;
        if all.vertices == 0 {
            // most have no other
            *all = make(&mut self.indices);
        } else {
            self.part.clear();
            let piece = make(&mut self.part);
            append_indices(&mut self.indices, &self.part, all.vertices, primitives);
            all.vertices += piece.vertices;
            all.triangles += piece.triangles;
            all.strips += piece.strips;
            for a in 0..3 {
                all.min[a] = all.min[a].min(piece.min[a]);
                all.max[a] = all.max[a].max(piece.max[a]);
            }
        }
        all.indices = self.indices.len() as u32;
    }
}
