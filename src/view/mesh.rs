//! A tile as the page draws it: one draw call, and nothing to unpack.
//!
//! All numbers are little-endian. A header of 48 bytes, then vertices, slots and indices:
//!
//! | bytes | header |
//! |---|---|
//! | 0 | `ALVM` |
//! | 4 | version, 1 |
//! | 8, 12, 16 | vertices, indices, slots |
//! | 20 | bytes of an index: 2, or 4 where there are more than 65,535 vertices |
//! | 24 | triangles |
//! | 28, 32, 36 | origin x, y, z on the lattice of 256 steps a voxel, signed |
//! | 40 | shift: a vertex lies at origin + (x, y, z << shift) |
//! | 44 | bytes of a vertex, 12 |
//!
//! A vertex is x, y, z of 16 bits; the low 16 bits of its slot; its normal on the octahedron, two signed bytes, 127 as
//! one; the high 8 bits of its slot; flags, of which bit 0 says that it is of a cap. A slot is the surface, the cell
//! and the object, 32 bits each, 0 where there is none. Indices are one strip, in which the largest number begins a
//! new one. Its triangles wind counter-clockwise seen from the cell in voxel coordinates, into which normals point.

use crate::grid::{LATTICE, Tiling};
use crate::manifest::{Manifest, Primitives};
use crate::tile::pieces::Piece;
use crate::tile::read::Tile;
use crate::tile::recode::strip_all;
use crate::tile::{counted_pieces, octahedral_codes};

/// Bytes of the header, a vertex and a slot.
const HEADER: usize = 48;
const VERTEX: usize = 12;
const SLOT: usize = 12;
/// Vertices of a tile whose indices take two bytes.
const NARROW: u64 = u16::MAX as u64;
/// Bit of a vertex of a cap.
const CAP: u8 = 1;

/// What all meshes of a set have in common, which is why vertices of two tiles meet.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    tiling: Tiling,
    primitives: Primitives,
    /// Voxels by which caps may lie before a macrocube.
    margin: i32,
    shift: u32,
}

impl Frame {
    /// That of a tile set.
    pub fn of(manifest: &Manifest) -> Self {
        let tiling = Tiling {
            dims: manifest.grid.dims,
            macrocube: manifest.grid.macrocube,
        };
        let margin = i32::from(manifest.cap);
        // a cap lies half a voxel behind the last one, too
        let beyond = u64::from(LATTICE) * 3 / 2 * u64::from(manifest.cap);
        let most = |a: usize| u64::from(tiling.macrocube[a].min(tiling.dims.0[a] - 1));
        let cubes = (0..3).map(most).max().unwrap_or(0);
        let reach = cubes * u64::from(LATTICE) + beyond;
        // the origin is rounded down by up to one step
        let fits = |shift: &u32| match shift {
            0 => reach <= NARROW,
            _ => (reach >> shift) + 2 <= NARROW,
        };
        Frame {
            tiling,
            primitives: manifest.primitives,
            margin,
            shift: (0..u32::BITS).find(fits).unwrap_or(0),
        }
    }

    fn origin(&self, grid: [u32; 3]) -> [i32; 3] {
        let low = self.tiling.lowest(grid);
        low.map(|v| ((v as i32 - self.margin) * LATTICE as i32) >> self.shift << self.shift)
    }

    /// Bytes of [`Frame::mesh`] at most, by what the index says of a tile; 0 if that cannot be told beforehand.
    pub fn bytes(&self, vertices: u64, pieces: u64, indices: u64) -> u32 {
        if self.primitives == Primitives::Triangles {
            return 0;
        }
        let width = if vertices > NARROW { 4 } else { 2 };
        let parts = [
            HEADER as u64,
            vertices.saturating_mul(VERTEX as u64),
            pieces.saturating_mul(SLOT as u64),
            indices.saturating_add(pieces).saturating_mul(width),
        ];
        let sum = parts.into_iter().fold(0, u64::saturating_add);
        u32::try_from(sum).unwrap_or(0)
    }

    /// The mesh of a tile, given as the bytes of its file.
    ///
    /// # Errors
    /// What is wrong with the tile.
    pub fn mesh(&self, grid: [u32; 3], file: &[u8]) -> Result<Vec<u8>, String> {
        let tile = Tile::read(file).map_err(|e| e.to_string())?;
        let mut pieces = counted_pieces(&tile, self.primitives).map_err(|e| e.to_string())?;
        drop(tile);
        let triangles = pieces.iter().map(|p| p.ids.triangles).sum::<u64>();
        if self.primitives == Primitives::Triangles {
            strip_all(&mut pieces);
        }
        let vertices: usize = pieces.iter().map(|p| p.positions.len()).sum();
        let wide = vertices as u64 > NARROW;
        let origin = self.origin(grid);
        let strips: usize = pieces.iter().map(|p| p.indices.len() + 1).sum();
        let width = if wide { 4 } else { 2 };
        let room = HEADER + VERTEX * vertices + SLOT * pieces.len() + width * strips;
        let mut out = Vec::with_capacity(room);
        out.resize(HEADER, 0);
        for (slot, piece) in pieces.iter().enumerate() {
            self.put_vertices(&mut out, origin, slot as u32, piece)?;
        }
        for piece in &pieces {
            for id in [piece.ids.surface, piece.ids.cell, piece.ids.object] {
                let id = u32::try_from(id)
                    .map_err(|_| format!("found the id {id}, expected one of 32 bits"))?;
                out.extend(id.to_le_bytes());
            }
        }
        let before = out.len();
        match wide {
            true => put_strips(&mut out, &pieces, |i| i.to_le_bytes()),
            false => put_strips(&mut out, &pieces, |i| (i as u16).to_le_bytes()),
        }
        let number =
            |n: usize| u32::try_from(n).map_err(|_| "found more than 2^32 vertices".to_owned());
        let head = Header {
            counts: [
                number(vertices)?,
                number((out.len() - before) / width)?,
                number(pieces.len())?,
            ],
            width: width as u32,
            triangles: u32::try_from(triangles).unwrap_or(u32::MAX),
            origin,
            shift: self.shift,
        };
        out[..HEADER].copy_from_slice(&head.bytes());
        Ok(out)
    }

    fn put_vertices(
        &self,
        out: &mut Vec<u8>,
        origin: [i32; 3],
        slot: u32,
        piece: &Piece,
    ) -> Result<(), String> {
        if slot >> 24 != 0 {
            return Err(format!("found {slot} pieces, expected fewer than 2^24"));
        }
        let [low, middle, high, _] = slot.to_le_bytes();
        let flags = if piece.ids.cell == 0 { CAP } else { 0 };
        let points = piece.lattice().map_err(|e| e.to_string())?;
        let half = (1 << self.shift) >> 1;
        for (point, normal) in points.iter().zip(octahedral_codes(&piece.normals)) {
            let step = |a: usize| u16::try_from((point[a] - origin[a] + half) >> self.shift);
            let (Ok(x), Ok(y), Ok(z)) = (step(0), step(1), step(2)) else {
                let at = point.map(|v| f64::from(v) / f64::from(LATTICE));
                return Err(format!(
                    "found a vertex at {at:?}, expected it in the tile's macrocube"
                ));
            };
            let [[x0, x1], [y0, y1], [z0, z1]] = [x, y, z].map(u16::to_le_bytes);
            let [u, v] = normal.map(|c| c as u8);
            out.extend([x0, x1, y0, y1, z0, z1, low, middle, u, v, high, flags]);
        }
        Ok(())
    }
}

/// Appends the strips of all pieces as one, with the largest number between them.
fn put_strips<const N: usize>(out: &mut Vec<u8>, pieces: &[Piece], bytes: impl Fn(u32) -> [u8; N]) {
    let mut first_vertex = 0;
    let mut begun = false;
    for piece in pieces {
        if !piece.indices.is_empty() {
            if begun {
                out.extend(bytes(u32::MAX));
            }
            begun = true;
            out.extend(piece.indices.iter().flat_map(|&i| bytes(first_vertex + i)));
        }
        first_vertex += piece.positions.len() as u32;
    }
}

/// What stands first.
struct Header {
    /// Vertices, indices and slots.
    counts: [u32; 3],
    width: u32,
    triangles: u32,
    origin: [i32; 3],
    shift: u32,
}

impl Header {
    fn bytes(&self) -> [u8; HEADER] {
        let [vertices, indices, slots] = self.counts;
        let [x, y, z] = self.origin.map(i32::cast_unsigned);
        let magic = u32::from_le_bytes(*b"ALVM");
        let words = [
            magic,
            1,
            vertices,
            indices,
            slots,
            self.width,
            self.triangles,
            x,
            y,
            z,
            self.shift,
            VERTEX as u32,
        ];
        let mut bytes = [0; HEADER];
        for (out, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *out = word.to_le_bytes();
        }
        bytes
    }
}
