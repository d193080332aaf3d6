//! A tile with some of its pieces left out or painted: geometry is copied, bit for bit.

use super::contents::{Contents, name};
use super::encoded::FloatBody;
use super::file::tile_file;
use super::paint::Rgb;
use super::pieces::Piece;
use super::read::{PieceIds, Tile};
use super::store::Refused;
use crate::gltf::container::{Fault, ReadError, fail};
use crate::manifest::Primitives;

/// What [`part`] made of a tile.
#[derive(Debug)]
pub struct Part {
    /// The file; its pieces are in the order of the source.
    pub file: Vec<u8>,
    /// What was kept.
    pub pieces: Vec<PartPiece>,
    /// Index entries.
    pub indices: u64,
}

/// A piece that was kept.
#[derive(Debug, Clone, Copy)]
pub struct PartPiece {
    /// Its ids and triangles.
    pub ids: PieceIds,
    /// Its vertices.
    pub vertices: u64,
    /// Strips before stitching; 0 for lists.
    pub strips: u64,
    /// 6 times the signed volume that its triangles span with the origin, in lattice units.
    pub volume6: i128,
    /// Vertices outside the grid, which only caps have, without those on the tile's lower planes:
    /// so each is counted in one tile.
    pub outside: u64,
    /// Box of its vertices in lattice steps.
    pub bounds: [[i32; 3]; 2],
}

/// Makes the part of a tile whose pieces get a style: `None` leaves a piece out, `Some(None)` gives
/// it the common grey. `None` if nothing is left. `several` says which cells border more than one object in the part:
/// the nodes of these have the object in their names.
///
/// Encoding and layout stay: a merged tile is merged however few pieces are left. Colours are
/// materials, in the merged layout vertex colours. Colours that the source has are not kept.
///
/// # Errors
/// [`ReadError`] if the tile cannot be read, or its indices or positions are none of a tile's, or the
/// part passes 4 GiB.
pub fn part(
    bytes: &[u8],
    tile_at: &TilePlace,
    style: impl Fn(&PieceIds) -> Option<Option<Rgb>>,
    several: &dyn Fn(u64) -> bool,
) -> Result<Option<Part>, ReadError> {
    let mut contents = Contents::of(&Tile::read(bytes)?, tile_at.primitives, several)?;
    contents.keep(|node, piece| {
        let colour = style(&piece.ids);
        node.colour = colour.flatten();
        node.name = name(piece.ids.cell, piece.ids.object, several(piece.ids.cell));
        colour.is_some()
    });
    if contents.pieces.is_empty() {
        return Ok(None);
    }
    let measured: Vec<PartPiece> = contents
        .pieces
        .iter()
        .map(|p| measure(p, tile_at))
        .collect::<Result<_, _>>()?;
    let head = contents.head(&contents.form(tile_at.primitives));
    let (body, bin) = contents.body()?;
    let floats = FloatBody {
        body: &body,
        bytes: &bin,
    };
    match tile_file(&head, tile_at.low, floats, &contents.nodes) {
        Ok(made) => Ok(Some(Part {
            indices: made.indices,
            file: made.into_bytes(),
            pieces: measured,
        })),
        Err(refused) => refuse(refused),
    }
}

/// A refusal as what is wrong with the tile.
pub(super) fn refuse<T>(refused: Refused) -> Result<T, ReadError> {
    match refused {
        Refused::TooLarge => fail(Fault::Container, "", "the new tile would pass 4 GiB"),
        Refused::TooWide(reach) => fail(
            Fault::Accessor,
            "",
            format!(
                "found vertices more than {} steps from the macrocube's corner, expected fewer for {} bits",
                reach.steps(),
                reach.bits
            ),
        ),
    }
}

/// What the index knows of a tile.
#[derive(Debug, Clone, Copy)]
pub struct TilePlace {
    /// Kind of primitives.
    pub primitives: Primitives,
    /// Its lowest voxel.
    pub low: [u32; 3],
    /// Voxels of the grid.
    pub dims: [u32; 3],
}

/// Counts and sums of a piece.
fn measure(piece: &Piece, at: &TilePlace) -> Result<PartPiece, ReadError> {
    let end = at.dims.map(|n| (n as i32 - 1) * 256);
    let low = at.low.map(|v| v as i32 * 256);
    let points = piece.lattice()?;
    let outside = |p: &&[i32; 3]| {
        let out = (0..3).any(|a| p[a] < 0 || p[a] > end[a]);
        // a vertex on the lower plane is in the tile before as well
        out && (0..3).all(|a| low[a] == 0 || p[a] != low[a])
    };
    let mut volume6 = 0i128;
    piece.triangles(at.primitives, |t| {
        let [a, b, c] = t.map(|i| points[i as usize].map(i64::from));
        let cross = |u: usize, v: usize| i128::from(b[u] * c[v] - b[v] * c[u]);
        volume6 += i128::from(a[0]) * cross(1, 2)
            + i128::from(a[1]) * cross(2, 0)
            + i128::from(a[2]) * cross(0, 1);
    });
    Ok(PartPiece {
        ids: piece.ids,
        vertices: piece.positions.len() as u64,
        strips: match at.primitives {
            Primitives::Strips => piece.strips(),
            Primitives::Triangles => 0,
        },
        volume6,
        outside: points.iter().filter(outside).count() as u64,
        bounds: piece.bounds()?,
    })
}
