//! The surface pieces of a tile, each with vertices and indices of its own, from either layout.

use super::paint::{Rgb, named, of_vertex};
use super::read::{PieceIds, Pieces, Primitive, Tile};
use crate::gltf::TRIANGLES;
use crate::gltf::container::{Fault, ReadError, fail};
use crate::grid::LATTICE;
use crate::manifest::Primitives;

/// A piece with its own geometry.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Its ids.
    pub ids: PieceIds,
    /// Name of its node; empty in the merged layout.
    pub name: String,
    /// Its colour; none is the common grey.
    pub colour: Option<Rgb>,
    /// Positions in voxel coordinates.
    pub positions: Vec<[f32; 3]>,
    /// Normals, as many.
    pub normals: Vec<[f32; 3]>,
    /// A list of triangles or a stitched strip; every index is below the number of positions.
    pub indices: Vec<u32>,
}

/// Takes a tile apart into its pieces, in the order of nodes or rows.
///
/// # Errors
/// [`ReadError`] if modes, indices or feature ids are not those of a tile of this kind.
pub fn pieces(tile: &Tile, kind: Primitives) -> Result<Vec<Piece>, ReadError> {
    let mut out = Vec::with_capacity(tile.primitives.len());
    for primitive in &tile.primitives {
        let at = format!("/nodes/{}/mesh", primitive.node);
        let mode = super::document::mode(kind);
        if primitive.mode != mode {
            let message = format!("found mode {}, expected {mode}", primitive.mode);
            return fail(Fault::Structure, at, message);
        }
        let mut indices = Vec::new();
        primitive.indices.read_into(&mut indices);
        let vertices = primitive.positions.len();
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= vertices) {
            let message = format!("found index {bad}, expected one below {vertices}");
            return fail(Fault::Accessor, at, message);
        }
        if kind == Primitives::Triangles && !indices.len().is_multiple_of(3) {
            let message = format!(
                "found {} indices, expected three to a triangle",
                indices.len()
            );
            return fail(Fault::Structure, at, message);
        }
        match &primitive.pieces {
            Pieces::One(ids) => out.push(Piece {
                ids: *ids,
                name: primitive.name.clone(),
                colour: named(&primitive.material),
                positions: primitive.positions.iter().collect(),
                normals: primitive.normals.unit().collect(),
                indices,
            }),
            Pieces::Merged(rows, ids) => {
                let split = split(primitive, rows.get(), ids, &indices)
                    .or_else(|message| fail(Fault::Structure, at, message))?;
                out.extend(split);
            }
        }
    }
    Ok(out)
}

/// The piece that a vertex of a merged primitive belongs to, and its number there.
#[derive(Clone, Copy)]
struct Owner {
    piece: usize,
    vertex: u32,
}

/// Takes a merged primitive apart by the rows of its vertices.
fn split(
    primitive: &Primitive,
    rows: &[[u8; 4]],
    ids: &[PieceIds],
    indices: &[u32],
) -> Result<Vec<Piece>, String> {
    let piece = |&ids: &PieceIds| Piece {
        ids,
        name: String::new(),
        colour: None,
        positions: Vec::new(),
        normals: Vec::new(),
        indices: Vec::new(),
    };
    let mut own: Vec<Piece> = ids.iter().map(piece).collect();
    let owners = split_vertices(primitive, rows, &mut own)?;
    match primitive.mode {
        TRIANGLES => split_list(indices, &owners, &mut own)?,
        _ => split_strip(indices, &owners, &mut own)?,
    }
    Ok(own)
}

/// Adds vertices to their pieces.
fn split_vertices(
    primitive: &Primitive,
    rows: &[[u8; 4]],
    own: &mut [Piece],
) -> Result<Vec<Owner>, String> {
    let mut owners = Vec::with_capacity(rows.len());
    let vertices = primitive.positions.iter().zip(primitive.normals.unit());
    let colours = primitive.colours.as_ref().map(|c| c.chunks::<8>());
    for (vertex, (row, (position, normal))) in rows.iter().zip(vertices).enumerate() {
        let value = f32::from_le_bytes(*row);
        let is_row = value >= 0.0 && value.fract() == 0.0;
        let (row, count) = (value as usize, own.len());
        let Some(piece) = own.get_mut(row).filter(|_| is_row) else {
            return Err(format!(
                "found feature id {value}, expected a row of {count}"
            ));
        };
        if let (true, Some(colours)) = (piece.positions.is_empty(), colours) {
            piece.colour = of_vertex(&colours[vertex]);
        }
        owners.push(Owner {
            piece: row,
            vertex: piece.positions.len() as u32,
        });
        piece.positions.push(position);
        piece.normals.push(normal);
    }
    Ok(owners)
}

fn mixed() -> String {
    "a triangle has vertices of several features".to_owned()
}

/// Adds the triangles of a list to their pieces.
fn split_list(indices: &[u32], owners: &[Owner], own: &mut [Piece]) -> Result<(), String> {
    for t in indices.as_chunks::<3>().0 {
        let [a, b, c] = t.map(|i| owners[i as usize]);
        if a.piece != b.piece || b.piece != c.piece {
            return Err(mixed());
        }
        own[a.piece].indices.extend([a.vertex, b.vertex, c.vertex]);
    }
    Ok(())
}

/// Gives each piece its part of a stitched strip.
fn split_strip(indices: &[u32], owners: &[Owner], own: &mut [Piece]) -> Result<(), String> {
    let owner = |i: u32| owners[i as usize];
    for t in indices.windows(3) {
        let [a, b, c] = [t[0], t[1], t[2]].map(|i| owner(i).piece);
        let drawn = t[0] != t[1] && t[1] != t[2] && t[0] != t[2];
        if drawn && (a != b || b != c) {
            return Err(mixed());
        }
    }
    let mut start = 0;
    for run in indices.chunk_by(|&a, &b| owner(a).piece == owner(b).piece) {
        let piece = owner(run[0]).piece;
        if !own[piece].indices.is_empty() {
            return Err("a feature's strip is in several places".to_owned());
        }
        let strip: Vec<u32> = run.iter().map(|&i| owner(i).vertex).collect();
        own[piece].indices = trimmed(&strip, start % 2 == 1);
        start += run.len();
    }
    Ok(())
}

/// A strip without the repeated entries that join it to its neighbours, such that its first entry
/// counts as even; `odd` says that the first entry given counts as odd.
fn trimmed(run: &[u32], odd: bool) -> Vec<u32> {
    let repeats = run.iter().take_while(|&&i| i == run[0]).count();
    let mut start = repeats - 1;
    let mut strip = Vec::with_capacity(run.len() + 1);
    if (start % 2 == 1) != odd {
        match start {
            0 => strip.push(run[0]),
            _ => start -= 1,
        }
    }
    strip.extend_from_slice(&run[start..]);
    while let [.., a, b] = strip[..]
        && a == b
        && strip.len() > 3
    {
        strip.pop();
    }
    strip
}

impl Piece {
    /// The triangles that are drawn, oriented.
    pub fn list(&self, kind: Primitives) -> Vec<[u32; 3]> {
        let mut list =
            Vec::with_capacity(self.ids.triangles.min(self.indices.len() as u64) as usize);
        self.triangles(kind, |t| list.push(t));
        list
    }

    /// Smallest and largest coordinates in lattice steps.
    ///
    /// # Errors
    /// [`ReadError`] if a position is not on the lattice.
    pub fn bounds(&self) -> Result<[[i32; 3]; 2], ReadError> {
        let mut bounds = [[i32::MAX; 3], [i32::MIN; 3]];
        for p in self.lattice()? {
            for a in 0..3 {
                bounds[0][a] = bounds[0][a].min(p[a]);
                bounds[1][a] = bounds[1][a].max(p[a]);
            }
        }
        Ok(bounds)
    }

    /// Calls `each` for every triangle that is drawn, oriented.
    pub fn triangles(&self, kind: Primitives, mut each: impl FnMut([u32; 3])) {
        match kind {
            Primitives::Triangles => {
                for &[a, b, c] in self.indices.as_chunks::<3>().0 {
                    if a != b && b != c && a != c {
                        each([a, b, c]);
                    }
                }
            }
            Primitives::Strips => {
                for (k, w) in self.indices.windows(3).enumerate() {
                    let (a, b, c) = (w[0], w[1], w[2]);
                    if a != b && b != c && a != c {
                        each(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                    }
                }
            }
        }
    }

    /// The number of strips that are stitched here: within a strip no entry follows itself.
    pub fn strips(&self) -> u64 {
        let mut strips = 0;
        let mut joint = true;
        for w in self.indices.windows(3) {
            if w[0] == w[1] || w[1] == w[2] {
                joint = true;
            } else if w[0] != w[2] {
                strips += u64::from(joint);
                joint = false;
            }
        }
        strips
    }

    /// The positions in lattice steps.
    ///
    /// # Errors
    /// [`ReadError`] if one is not on the lattice or far outside any grid.
    pub fn lattice(&self) -> Result<Vec<[i32; 3]>, ReadError> {
        lattice(&self.positions)
    }
}

/// Positions in lattice steps.
///
/// # Errors
/// [`ReadError`] if one is not on the lattice or far outside any grid.
pub fn lattice(positions: &[[f32; 3]]) -> Result<Vec<[i32; 3]>, ReadError> {
    let limit = (crate::grid::MAX_DIM * LATTICE) as f32;
    let steps = |v: f32| {
        let (s, whole) = (v * LATTICE as f32, (v * LATTICE as f32) as i32);
        (whole as f32 == s && s.abs() <= limit).then_some(whole)
    };
    let point = |p: &[f32; 3]| match p.map(steps) {
        [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
        _ => fail(
            Fault::Accessor,
            "",
            format!("found the position {p:?}, expected multiples of 1/{LATTICE} in the grid"),
        ),
    };
    positions.iter().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strip::{append_strip, unstrip};
    use proptest::prelude::*;

    proptest! {
        /// Strips that were joined come apart into what they were.
        #[test]
        fn joined_strips_come_apart(
            strips in prop::collection::vec(prop::collection::vec(0u32..6, 3..9), 1..6)
        ) {
            let strips: Vec<Vec<u32>> = strips
                .into_iter()
                .filter(|s| s[0] != s[1] && s[1] != s[2] && s[0] != s[2])
                .collect();
            let mut all = Vec::new();
            for (n, strip) in strips.iter().enumerate() {
                append_strip(&mut all, strip, 10 * n as u32);
            }
            let mut start = 0;
            for run in all.chunk_by(|a, b| a / 10 == b / 10) {
                let n = (run[0] / 10) as usize;
                let own: Vec<u32> = run.iter().map(|i| i % 10).collect();
                prop_assert_eq!(
                    unstrip(&trimmed(&own, start % 2 == 1)),
                    unstrip(&strips[n])
                );
                start += run.len();
            }
        }
    }
}
