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
//! one; the high 8 bits of its slot; flags: bit 0, it is of a cap; bit 1, it is of a fin between blocks of different
//! levels; bit 2, of the side of a fin on which the cell is. A slot is the surface, the cell and the object, 32 bits each,
//! 0 where there is none. Indices are one strip, in which the largest number begins a new one. Its triangles wind
//! counter-clockwise seen from the cell in voxel coordinates, into which normals point.

use crate::grid::{LATTICE, Tiling, coordinate};
use crate::manifest::{Form, Level, Manifest, Primitives};
use crate::tile::node::node_extras;
use crate::tile::pieces::Piece;
use crate::tile::read::Tile;
use crate::tile::recode::strip_all;
use crate::tile::{counted_pieces, octahedral_codes};
use crate::view::put;

/// Bytes of the header, a vertex and a slot.
const HEADER: usize = 48;
const VERTEX: usize = 12;
const SLOT: usize = 12;
/// Vertices of a tile whose indices take two bytes.
const NARROW: u64 = u16::MAX as u64;
/// Bits of a vertex: it is of a cap; of a fin; of the side of a fin on which the cell is.
const CAP: u8 = 1;
const FIN: u8 = 2;
const FIN_IN_CELL: u8 = 4;
/// Corners of a fin.
const FIN_CORNERS: usize = 4;

/// What all meshes of a level have in common, which is why vertices of two tiles meet.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// 0 of the tiles.
    level: u32,
    tiling: Tiling,
    primitives: Primitives,
    /// Lattice steps by which vertices may lie before a block.
    margin: i32,
    /// Lattice steps by which they may lie outside of the volume.
    outside: i32,
    shift: u32,
}

impl Frame {
    /// That of a tile set.
    pub fn of(manifest: &Manifest) -> Self {
        let tiling = manifest.tiling();
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
            level: 0,
            tiling,
            primitives: manifest.primitives,
            margin: i32::from(manifest.cap) * LATTICE as i32,
            outside: 0,
            shift: (0..u32::BITS).find(fits).unwrap_or(0),
        }
    }

    /// That of a level from 1 on, whose positions are multiples of its step and reach beyond its nodes by fins: half of
    /// the room that 16 bits leave is before a node.
    pub fn of_level(manifest: &Manifest, level: &Level) -> Self {
        let tiling = manifest.tiling();
        let shift = level.step.max(1).ilog2();
        let cubes = |a: usize| {
            let long = u64::from(tiling.macrocube[a]) << level.level;
            long.min(u64::from(tiling.dims.0[a] - 1))
        };
        let reach = (0..3).map(cubes).max().unwrap_or(0) * u64::from(LATTICE);
        let room = NARROW.saturating_sub(reach >> shift) / 2;
        Frame {
            level: level.level,
            tiling,
            primitives: Form::WEB.primitives,
            margin: i32::try_from(room << shift).unwrap_or(0),
            outside: i32::from(manifest.cap) * LATTICE as i32 / 2,
            shift,
        }
    }

    fn origin(&self, grid: [u32; 3]) -> [i32; 3] {
        let low = self.tiling.lowest(grid.map(|n| n << self.level));
        low.map(|v| (v as i32 * LATTICE as i32 - self.margin) >> self.shift << self.shift)
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
        let Contents {
            mut pieces,
            fins,
            mut sides,
        } = self.contents(file)?;
        let triangles = pieces.iter().map(|p| p.ids.triangles).sum::<u64>();
        if self.primitives == Primitives::Triangles {
            strip_all(&mut pieces);
        }
        let vertices: usize = pieces.iter().map(|p| p.positions.len()).sum();
        let wide = vertices as u64 > NARROW;
        let origin = self.origin(grid);
        let width = if wide { 4 } else { 2 };
        let strips = pieces.iter().filter(|piece| !piece.indices.is_empty());
        // with a number between two strips
        let strips = strips.map(|piece| piece.indices.len() + 1);
        let indices = strips.sum::<usize>().saturating_sub(1);
        let room = HEADER + VERTEX * vertices + SLOT * pieces.len() + width * indices;
        let mut out = Vec::with_capacity(room);
        let number =
            |n: usize| u32::try_from(n).map_err(|_| "found more than 2^32 vertices".to_owned());
        let [x, y, z] = origin.map(i32::cast_unsigned);
        put(
            &mut out,
            &[
                u32::from_le_bytes(*b"ALVM"),
                1,
                number(vertices)?,
                number(indices)?,
                number(pieces.len())?,
                width as u32,
                u32::try_from(triangles).unwrap_or(u32::MAX),
                x,
                y,
                z,
                self.shift,
                VERTEX as u32,
            ],
        );
        for (slot, piece) in pieces.iter().enumerate() {
            let flags = match slot < fins {
                true => vec![if piece.ids.cell == 0 { CAP } else { 0 }; piece.positions.len()],
                false => std::mem::take(&mut sides[slot - fins]),
            };
            let slot = Slot {
                number: slot as u32,
                piece,
                flags,
            };
            self.put_vertices(&mut out, origin, &slot)?;
        }
        for piece in &pieces {
            for id in [piece.ids.surface, piece.ids.cell, piece.ids.object] {
                let id = u32::try_from(id)
                    .map_err(|_| format!("found the id {id}, expected one of 32 bits"))?;
                out.extend(id.to_le_bytes());
            }
        }
        match wide {
            true => put_strips(&mut out, &pieces, |i| i.to_le_bytes()),
            false => put_strips(&mut out, &pieces, |i| (i as u16).to_le_bytes()),
        }
        Ok(out)
    }

    /// What a file holds, its fins last.
    fn contents(&self, file: &[u8]) -> Result<Contents, String> {
        let read = || match self.level {
            0 => Tile::read(file).map(|tile| (tile, 0)),
            _ => {
                let tile = Tile::read_node(file)?;
                let fins = node_extras(&tile)?.fin_rows as usize;
                Ok((tile, fins))
            }
        };
        let (tile, fins) = read().map_err(|e| e.to_string())?;
        let mut pieces = counted_pieces(&tile, self.primitives).map_err(|e| e.to_string())?;
        let fins = pieces.len().checked_sub(fins);
        let fins = fins.ok_or("found more fins than rows")?;
        // on which side a corner is shows where it was, not where it is brought to
        let sides: Result<Vec<_>, _> = pieces[fins..].iter().map(fin_sides).collect();
        for fin in &mut pieces[fins..] {
            self.keep_inside(fin);
        }
        Ok(Contents {
            pieces,
            fins,
            sides: sides?,
        })
    }

    /// Brings what of a fin is outside of the volume to its faces, where nobody looks between blocks.
    fn keep_inside(&self, fin: &mut Piece) {
        let least = coordinate(-self.outside);
        for point in &mut fin.positions {
            for (v, size) in point.iter_mut().zip(self.tiling.dims.0) {
                *v = v.clamp(least, (size - 1) as f32 - least);
            }
        }
    }

    fn put_vertices(&self, out: &mut Vec<u8>, origin: [i32; 3], slot: &Slot) -> Result<(), String> {
        let Slot {
            number,
            piece,
            flags,
        } = slot;
        if number >> 24 != 0 {
            return Err(format!("found {number} pieces, expected fewer than 2^24"));
        }
        let [low, middle, high, _] = number.to_le_bytes();
        let points = piece.lattice().map_err(|e| e.to_string())?;
        let half = (1 << self.shift) >> 1;
        let codes = octahedral_codes(&piece.normals);
        for ((point, normal), &flags) in points.iter().zip(codes).zip(flags) {
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

/// The pieces of a file.
struct Contents {
    pieces: Vec<Piece>,
    /// The number of the first that are fins.
    fins: usize,
    /// What [`fin_sides`] says of each of these.
    sides: Vec<Vec<u8>>,
}

/// A piece and its place among all.
struct Slot<'a> {
    number: u32,
    piece: &'a Piece,
    /// Of each vertex.
    flags: Vec<u8>,
}

/// Which corners of fins lie where the cell is: normals point there from the edge that a fin is along.
fn fin_sides(piece: &Piece) -> Result<Vec<u8>, String> {
    let corners = piece.positions.as_chunks::<FIN_CORNERS>();
    let (fins, []) = corners else {
        let found = piece.positions.len();
        return Err(format!("found {found} corners of fins, expected four each"));
    };
    let mut sides = Vec::with_capacity(piece.positions.len());
    for (fin, normals) in fins.iter().zip(piece.normals.as_chunks::<FIN_CORNERS>().0) {
        let [a, b, c, d] = fin.map(glam::Vec3::from);
        let across = (b - a) + (d - c);
        let normal: glam::Vec3 = normals.iter().map(|&n| glam::Vec3::from(n)).sum();
        let second = across.dot(normal) > 0.0;
        let side = |is: bool| if is { FIN | FIN_IN_CELL } else { FIN };
        sides.extend([!second, second, !second, second].map(side));
    }
    Ok(sides)
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
