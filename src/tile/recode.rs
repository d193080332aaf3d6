//! A tile in another form: other primitives, encoding or layout, and the same surface.

use super::contents::Contents;
use super::encoded::FloatBody;
use super::file::tile_file;
use super::part::{TilePlace, refuse};
use super::pieces::Piece;
use super::read::Tile;
use crate::gltf::container::ReadError;
use crate::manifest::{Form, Primitives};
use crate::strip::{Stripifier, connect};

/// What [`recode`] made.
#[derive(Debug)]
pub struct Recoded {
    /// The file.
    pub file: Vec<u8>,
    /// Index entries in it.
    pub indices: u64,
    /// The number of strips if they were made anew.
    pub strips: Option<u64>,
}

/// Writes a tile in the form that is wanted. Vertices, their order, ids, measures and colours stay,
/// and so does the order of triangles where primitives stay of a kind: strips to the entry, lists
/// but that compressed ones may begin at another corner. Normals are rounded by the quantized
/// encodings; rounded ones are not rounded again.
///
/// # Errors
/// [`ReadError`] if the tile cannot be read, or the new one cannot be written.
pub fn recode(
    bytes: &[u8],
    at: &TilePlace,
    wanted: &Form,
    several: &dyn Fn(u64) -> bool,
) -> Result<Recoded, ReadError> {
    let mut contents = Contents::of(&Tile::read(bytes)?, at.primitives, several)?;
    let strips = match (at.primitives, wanted.primitives) {
        (Primitives::Triangles, Primitives::Strips) => Some(strip_all(&mut contents.pieces)),
        (Primitives::Strips, Primitives::Triangles) => {
            for piece in &mut contents.pieces {
                piece.indices = piece.list(at.primitives).into_flattened();
            }
            Some(0)
        }
        _ => None,
    };
    let head = contents.head(wanted);
    let (body, bin) = contents.body()?;
    let floats = FloatBody {
        body: &body,
        bytes: &bin,
    };
    match tile_file(&head, at.low, floats, &contents.nodes) {
        Ok(made) => Ok(Recoded {
            indices: made.indices,
            file: made.into_bytes(),
            strips,
        }),
        Err(refused) => refuse(refused),
    }
}

/// Turns lists into strips; returns the number of strips.
pub fn strip_all(pieces: &mut [Piece]) -> u64 {
    let mut stripifier = Stripifier::default();
    let mut strips = 0;
    for piece in pieces {
        let list = piece.list(Primitives::Triangles);
        piece.indices.clear();
        strips += stripifier.stripify(&mut connect(&list), &mut piece.indices) as u64;
    }
    strips
}
