//! The pieces of tiles that are kept.

use crate::error::Result;
use crate::grid::LATTICE;
use crate::manifest::{Bounds, Group, Manifest, Primitives, TileEntry, Totals, checksum_text};
use crate::progress::Progress;
use crate::tile::read::{PieceIds, ReadError};
use crate::tile::{Part, PartPiece, Rgb, TilePlace, part, tile_path};
use crate::tileset::{TileSet, TilesetWriter, with_euler_characteristic};
use crate::transform::new_tiles::{MakeTile, NewTile, make_tiles};
use crate::transform::select::choice::Choice;
use crate::transform::select::rows::Rows;

/// Copies the kept pieces of all tiles, with their entries, and brings what the manifest `made` says of caps and its
/// sums up to date.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io), [`Error::Format`](crate::Error::Format) if a tile or shard is damaged,
/// [`Error::Interrupted`](crate::Error::Interrupted).
pub fn copy_tiles(
    set: &TileSet,
    writer: &mut TilesetWriter,
    made: &mut Manifest,
    kept: &Kept,
    progress: &dyn Progress,
) -> Result<()> {
    let rows = kept.rows;
    made.cap = kept.caps;
    let mut sums = TileSums::default();
    make_tiles(set, kept, writer, progress, |tile| sums.add(&tile))?;
    made.totals = with_euler_characteristic(Totals {
        voxels_nan: made.totals.voxels_nan,
        vertices: rows.vertices.saturating_add(sums.cap_vertices),
        cap_triangles: sums.cap_triangles,
        volume6: sums.volume6,
        cells: rows.cells,
        objects: rows.objects.len() as u64,
        surfaces: rows.surfaces,
        border_edges: if kept.caps { 0 } else { rows.border_edges },
        voxels_above: rows.voxels_above,
        ..writer.written()
    });
    Ok(())
}

/// Sums over kept pieces that entries of tiles do not have.
#[derive(Debug, Clone, Copy, Default)]
pub struct TileSums {
    volume6: i128,
    cap_vertices: u64,
    cap_triangles: u64,
}

impl TileSums {
    fn of(pieces: &[PartPiece]) -> Self {
        let mut sums = TileSums::default();
        for piece in pieces {
            sums.volume6 += piece.volume6;
            sums.cap_vertices += piece.outside;
            if piece.ids.cell == 0 {
                sums.cap_triangles += piece.ids.triangles;
            }
        }
        sums
    }

    fn add(&mut self, other: &TileSums) {
        self.volume6 += other.volume6;
        self.cap_vertices += other.cap_vertices;
        self.cap_triangles += other.cap_triangles;
    }
}

/// What is kept of a tile set.
pub struct Kept<'a> {
    /// What was chosen, and its colours.
    pub choice: &'a Choice,
    /// The rows of the tables.
    pub rows: &'a Rows,
    /// Caps stay.
    pub caps: bool,
    /// What tiles are made of.
    pub primitives: Primitives,
}

impl Kept<'_> {
    /// The style of a piece: `None` if it is left out. Caps, which are of no cell, are never painted.
    fn style(&self, ids: &PieceIds) -> Option<Option<Rgb>> {
        match ids.cell {
            0 => (self.caps && self.rows.objects.contains_key(&ids.object)).then_some(None),
            _ => self.choice.style(ids),
        }
    }
}

impl MakeTile for Kept<'_> {
    type Sums = TileSums;

    fn wants(&self, entry: &TileEntry) -> bool {
        entry.groups.iter().any(|group| {
            let ids = PieceIds {
                cell: group.cell,
                object: group.object,
                surface: group.surface,
                triangles: group.triangles,
            };
            self.style(&ids).is_some()
        })
    }

    fn make(
        &self,
        entry: TileEntry,
        bytes: &[u8],
        place: &TilePlace,
    ) -> Result<Option<NewTile<TileSums>>, ReadError> {
        let several = |cell| self.rows.several.contains(cell);
        let Some(part) = part(bytes, place, |ids| self.style(ids), &several)? else {
            return Ok(None);
        };
        Ok(Some(NewTile {
            entry: described(entry.grid, self.primitives, &part),
            sums: TileSums::of(&part.pieces),
            file: part.file,
        }))
    }
}

/// The shard's entry of a part.
fn described(grid: [u32; 3], primitives: Primitives, part: &Part) -> TileEntry {
    let sum = |get: fn(&PartPiece) -> u64| part.pieces.iter().map(get).sum::<u64>();
    let bound = |which: usize, pick: fn(i32, i32) -> i32| {
        let all = part.pieces.iter().map(|p| p.bounds[which]);
        let folded = all.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])));
        folded
            .unwrap_or_default()
            .map(|v| f64::from(v) / f64::from(LATTICE))
    };
    TileEntry {
        path: tile_path(grid),
        grid,
        bounds: Bounds {
            min: bound(0, i32::min),
            max: bound(1, i32::max),
        },
        vertices: sum(|p| p.vertices),
        triangles: sum(|p| p.ids.triangles),
        strips: match primitives {
            Primitives::Strips => sum(|p| p.strips),
            Primitives::Triangles => 0,
        },
        indices: part.indices,
        bytes: part.file.len() as u64,
        checksum: checksum_text(crc32fast::hash(&part.file)),
        groups: part
            .pieces
            .iter()
            .map(|p| Group {
                cell: p.ids.cell,
                object: p.ids.object,
                surface: p.ids.surface,
                vertices: p.vertices,
                triangles: p.ids.triangles,
            })
            .collect(),
    }
}
