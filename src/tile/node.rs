//! The files of nodes of coarser levels: tiles in the form for the web, whose positions are multiples of some lattice
//! steps, whose root node says how coarse they are, and whose last rows are fins.

use super::body::Body;
use super::codec::{MAX_SHIFT, coarse};
use super::contents::body_of;
use super::document::{Node, NodeExtras, TileHead};
use super::encoded::FloatBody;
use super::file::tile_file;
use super::mesh::SurfacePiece;
use super::pieces::{Piece, lattice, pieces};
use super::read::{PieceIds, Tile};
use super::store::Refused;
use super::{Extras, codec};
use crate::gltf::container::{Fault, ReadError, fail};
use crate::grid::coordinate;
use crate::manifest::{Form, Primitives};
use serde::Deserialize;

/// A part of a surface, as tiles and nodes have it.
#[derive(Debug, Clone)]
pub(crate) struct SurfacePart {
    /// Ids and measures; of the number of triangles nothing is held.
    pub extras: Extras,
    /// Vertices in lattice steps.
    pub points: Vec<[i32; 3]>,
    /// Unit normals, as many.
    pub normals: Vec<[f32; 3]>,
    /// Corners of the triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// The parts of surfaces that a tile holds.
///
/// # Errors
/// [`ReadError`] if it is no tile of primitives of that kind.
pub(crate) fn parts_of_tile(bytes: &[u8], kind: Primitives) -> Result<Vec<SurfacePart>, ReadError> {
    parts(&Tile::read(bytes)?, kind)
}

/// The parts of surfaces that the file of a node holds, without its fins.
///
/// # Errors
/// [`ReadError`] if it is no file of a node.
pub(crate) fn parts_of_node(bytes: &[u8]) -> Result<Vec<SurfacePart>, ReadError> {
    let tile = Tile::read_node(bytes)?;
    let fins = node_extras(&tile)?.fin_rows as usize;
    let mut parts = parts(&tile, Form::WEB.primitives)?;
    match parts.len().checked_sub(fins) {
        Some(surfaces) => parts.truncate(surfaces),
        None => return fail(Fault::Extras, "/nodes/0/extras", "more fins than rows"),
    }
    Ok(parts)
}

/// The same of pieces that have been read of a tile or a node already.
///
/// # Errors
/// [`ReadError`] if a position is not on the lattice.
pub(crate) fn parts_of_pieces(
    tile: &Tile,
    pieces: Vec<SurfacePiece>,
) -> Result<Vec<SurfacePart>, ReadError> {
    let measured = tile.primitives.iter().flat_map(|p| &p.measured);
    let part = |(piece, measured): (SurfacePiece, _)| {
        Ok(SurfacePart {
            extras: Extras::measured(&piece.ids, measured),
            points: lattice(&piece.positions)?,
            normals: piece.normals,
            triangles: piece.triangles,
        })
    };
    pieces.into_iter().zip(measured).map(part).collect()
}

/// What the root node of a node's file says.
///
/// # Errors
/// [`ReadError`] if it says nothing.
pub(crate) fn node_extras(tile: &Tile) -> Result<NodeExtras, ReadError> {
    #[derive(Deserialize)]
    struct Nodes {
        nodes: Vec<Root>,
    }
    #[derive(Deserialize)]
    struct Root {
        extras: Option<NodeExtras>,
    }
    // other nodes have extras of another kind, or none
    let found = serde_json::from_slice::<Nodes>(tile.json());
    let extras = found
        .ok()
        .and_then(|doc| doc.nodes.into_iter().next()?.extras);
    extras.map_or_else(
        || {
            fail(
                Fault::Extras,
                "/nodes/0/extras",
                "expected level, error and fin_rows",
            )
        },
        Ok,
    )
}

fn parts(tile: &Tile, kind: Primitives) -> Result<Vec<SurfacePart>, ReadError> {
    let measured = tile.primitives.iter().flat_map(|p| &p.measured);
    let part = |(piece, measured): (Piece, _)| {
        Ok(SurfacePart {
            extras: Extras::measured(&piece.ids, measured),
            points: piece.lattice()?,
            triangles: piece.list(kind),
            normals: piece.normals,
        })
    };
    pieces(tile, kind)?
        .into_iter()
        .zip(measured)
        .map(part)
        .collect()
}

/// A part of a surface that is to be written.
#[derive(Debug)]
pub(crate) struct NodePart {
    /// Ids, measures and the number of triangles.
    pub extras: Extras,
    /// Vertices in lattice steps, multiples of the node's.
    pub points: Vec<[i32; 3]>,
    /// Unit normals, as many.
    pub normals: Vec<[f32; 3]>,
    /// A stitched strip.
    pub strip: Vec<u32>,
}

/// What the files of a level have in common.
#[derive(Debug, Clone)]
pub(crate) struct NodeForm {
    /// The root node's matrix.
    pub matrix: [f64; 16],
    /// Positions are multiples of 2^`shift` lattice steps.
    pub shift: u32,
}

/// A node's file and what its entry says of it.
#[derive(Debug)]
pub(crate) struct NodeFile {
    pub bytes: Vec<u8>,
    /// Index entries.
    pub indices: u64,
    /// Vertices.
    pub vertices: u64,
    /// Box of the vertices in lattice steps.
    pub bounds: [[i32; 3]; 2],
}

/// The smallest power of two of lattice steps in which 16 bits reach over so many steps with some room; `None` if
/// that is more than any file has.
pub(crate) fn shift_for(steps: u64) -> Option<u32> {
    // fins and caps reach beyond the cubes
    const ROOM: u64 = 60_000;
    (0..=MAX_SHIFT).find(|&shift| steps >> shift <= ROOM)
}

/// Writes the file of a node.
///
/// # Errors
/// [`Refused`] if it would be too large, or reaches too far.
pub(crate) fn node_file(
    form: &NodeForm,
    extras: NodeExtras,
    parts: Vec<NodePart>,
) -> Result<NodeFile, Refused> {
    let mut head = TileHead::new(form.matrix, Form::WEB);
    head.codec = coarse(form.shift).unwrap_or(codec(Form::WEB.encoding));
    head.node = Some(extras);
    let mut nodes = Vec::with_capacity(parts.len());
    let mut pieces = Vec::with_capacity(parts.len());
    for part in parts {
        pieces.push(piece(&part));
        nodes.push(Node {
            name: String::new(),
            extras: part.extras,
            colour: None,
        });
    }
    let (body, bin): (Body, Vec<u8>) = body_of(&pieces).expect("points lie on the lattice");
    drop(pieces);
    let floats = FloatBody {
        body: &body,
        bytes: &bin,
    };
    let made = tile_file(&head, [0; 3], floats, &nodes)?;
    Ok(NodeFile {
        indices: made.indices,
        vertices: body.vertices.into(),
        bounds: body.bounds(),
        bytes: made.into_bytes(),
    })
}

fn piece(part: &NodePart) -> Piece {
    let Extras {
        cell,
        object,
        surface,
        triangles,
        ..
    } = part.extras;
    Piece {
        ids: PieceIds {
            cell,
            object,
            surface,
            triangles,
        },
        name: String::new(),
        colour: None,
        positions: part.points.iter().map(|p| p.map(coordinate)).collect(),
        normals: part.normals.clone(),
        indices: part.strip.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn part(cell: u64, points: Vec<[i32; 3]>) -> NodePart {
        NodePart {
            extras: Extras::ids(cell, 1, cell, 1),
            normals: vec![[0.0, 0.0, 1.0]; points.len()],
            strip: vec![0, 1, 2],
            points,
        }
    }

    proptest! {
        /// What is written comes back to the step, fins apart, in every step that there is.
        #[test]
        fn a_node_comes_back(
            shift in 0..=MAX_SHIFT,
            points in prop::collection::vec(prop::array::uniform3(-100..20_000i32), 3..20),
        ) {
            let points: Vec<_> = points.iter().map(|p| p.map(|v| v << shift)).collect();
            let form = NodeForm { matrix: [0.5; 16], shift };
            let extras = NodeExtras { level: 3, error: 0.25, fin_rows: 1 };
            let parts = vec![part(4, points.clone()), part(4, points.clone())];
            let made = node_file(&form, extras, parts).unwrap();
            let back = parts_of_node(&made.bytes).unwrap();
            prop_assert_eq!(back.len(), 1);
            prop_assert_eq!(&back[0].points, &points);
            prop_assert_eq!(&back[0].triangles, &vec![[0, 1, 2]]);
            prop_assert_eq!(back[0].extras.cell, 4);
            let tile = Tile::read_node(&made.bytes).unwrap();
            prop_assert_eq!(node_extras(&tile).unwrap(), extras);
            prop_assert_eq!(shift > 0, Tile::read(&made.bytes).is_err() && shift > 0);
        }
    }

    #[test]
    fn steps_grow_with_what_a_node_covers() {
        assert_eq!(shift_for(128 * 256), Some(0));
        assert_eq!(shift_for(256 * 256), Some(1));
        assert_eq!(shift_for(65_535 * 256), None);
    }
}
