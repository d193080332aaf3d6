//! A tile's pieces with all that is written of them: what a copy of a tile in another form starts from.

use super::Extras;
use super::body::{Body, PieceRange, write_indices};
use super::codec::TileCodec;
use super::document::{Node, TileHead};
use super::extras::of_pieces;
use super::pieces::{Piece, pieces};
use super::read::{PieceIds, Tile};
use crate::gltf::container::{Fault, ReadError, fail};
use crate::manifest::{Form, Layout, Primitives};
use bytemuck::Zeroable;

/// A tile that was read.
#[derive(Debug)]
pub(super) struct Contents {
    /// The root node's matrix.
    pub matrix: [f64; 16],
    /// How numbers were stored.
    pub codec: &'static dyn TileCodec,
    /// True if it was in merged layout.
    pub merged: bool,
    /// The pieces in order.
    pub pieces: Vec<Piece>,
    /// Names, numbers and colours of the pieces.
    pub nodes: Vec<Node>,
}

impl Contents {
    /// Those of a tile of primitives of a kind. `several` says which cells border more than one object:
    /// the nodes of these have the object in their names. A merged tile has no names that tell.
    ///
    /// # Errors
    /// [`ReadError`] if it is no tile of that kind.
    pub fn of(
        tile: &Tile,
        kind: Primitives,
        several: &dyn Fn(u64) -> bool,
    ) -> Result<Self, ReadError> {
        let merged = tile.is_merged();
        let pieces = counted_pieces(tile, kind)?;
        let nodes = pieces
            .iter()
            .zip(of_pieces(tile)?)
            .map(|(p, extras)| Node {
                name: if merged {
                    name(p.ids.cell, p.ids.object, several(p.ids.cell))
                } else {
                    p.name.clone()
                },
                extras: Extras::read(&p.ids, &extras),
                colour: p.colour,
            })
            .collect();
        Ok(Contents {
            matrix: tile.matrix,
            codec: tile.codec,
            merged,
            pieces,
            nodes,
        })
    }

    /// Pieces without measures and colours, for tests.
    #[cfg(test)]
    pub fn of_pieces(codec: &'static dyn TileCodec, pieces: Vec<Piece>) -> Self {
        let node = |p: &Piece| Node {
            name: p.name.clone(),
            extras: Extras::ids(p.ids.cell, p.ids.object, p.ids.surface, p.ids.triangles),
            colour: None,
        };
        Contents {
            matrix: [1.0; 16],
            codec,
            merged: false,
            nodes: pieces.iter().map(node).collect(),
            pieces,
        }
    }

    /// Keeps the pieces that `keep` accepts; it may change their nodes.
    pub fn keep(&mut self, mut keep: impl FnMut(&mut Node, &Piece) -> bool) {
        let (pieces, nodes) = (
            std::mem::take(&mut self.pieces),
            std::mem::take(&mut self.nodes),
        );
        for (piece, mut node) in pieces.into_iter().zip(nodes) {
            if keep(&mut node, &piece) {
                self.pieces.push(piece);
                self.nodes.push(node);
            }
        }
    }

    /// The form that the tile has.
    pub fn form(&self, primitives: Primitives) -> Form {
        Form {
            primitives,
            encoding: self.codec.encoding(),
            layout: if self.merged {
                Layout::Merged
            } else {
                Layout::Nodes
            },
        }
    }

    /// What the new tile has in common with others.
    pub fn head(&self, wanted: &Form) -> TileHead {
        TileHead::new(self.matrix, *wanted)
    }

    /// The pieces' geometry as a body of floats, and its bytes.
    ///
    /// # Errors
    /// [`ReadError`] if a position is not on the lattice.
    pub fn body(&self) -> Result<(Body, Vec<u8>), ReadError> {
        body_of(&self.pieces)
    }
}

/// The pieces of a tile of primitives of a kind, which have as many triangles as they state.
///
/// # Errors
/// [`ReadError`] if it is no tile of that kind.
pub fn counted_pieces(tile: &Tile, kind: Primitives) -> Result<Vec<Piece>, ReadError> {
    let pieces = pieces(tile, kind)?;
    pieces.iter().try_for_each(|p| check_count(p, kind))?;
    Ok(pieces)
}

/// The geometry of pieces as a body of floats, and its bytes.
///
/// # Errors
/// [`ReadError`] if a position is not on the lattice.
pub fn body_of(pieces: &[Piece]) -> Result<(Body, Vec<u8>), ReadError> {
    let mut bin: Vec<u8> = Vec::new();
    for p in pieces {
        p.positions.iter().for_each(|v| push_vec3(&mut bin, v));
    }
    for p in pieces {
        p.normals.iter().for_each(|v| push_vec3(&mut bin, v));
    }
    let mut body = Body::default();
    for p in pieces {
        let mut piece = PieceRange::zeroed();
        piece.first_index_byte = bin.len() as u64;
        piece.first_vertex = body.vertices;
        piece.vertices = p.positions.len() as u32;
        piece.triangles = p.ids.triangles as u32;
        piece.indices = p.indices.len() as u32;
        [piece.min, piece.max] = p.bounds()?;
        body.vertices += piece.vertices;
        write_indices(&piece, &p.indices, |bytes| bin.extend_from_slice(bytes));
        body.pieces.push(piece);
    }
    body.bytes = bin.len() as u64;
    Ok((body, bin))
}

/// Compares the number of triangles that a piece states with those it has.
fn check_count(piece: &Piece, kind: Primitives) -> Result<(), ReadError> {
    let mut found = 0;
    piece.triangles(kind, |_| found += 1);
    if found == piece.ids.triangles {
        return Ok(());
    }
    let PieceIds {
        cell, triangles, ..
    } = piece.ids;
    let message = format!("a piece of cell {cell} states {triangles} triangles and has {found}");
    fail(Fault::Extras, "", message)
}

fn push_vec3(bin: &mut Vec<u8>, v: &[f32; 3]) {
    v.iter().for_each(|c| bin.extend(c.to_le_bytes()));
}

/// Name of the node of a piece between a cell and an object; `several` if the cell borders more than
/// one object.
pub fn name(cell: u64, object: u64, several: bool) -> String {
    match (cell, several) {
        (0, _) => format!("cap_object_{object}"),
        (_, false) => format!("cell_{cell}"),
        (_, true) => format!("cell_{cell}_object_{object}"),
    }
}
