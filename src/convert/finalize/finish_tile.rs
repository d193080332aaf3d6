//! A tile gets its ids and measures, before and behind its geometry.

use crate::convert::finalize::batches::Job;
use crate::convert::finalize::finisher::{Cell, Finisher};
use crate::convert::mesh::tile_writer::{TileRecord, WrittenPiece};
use crate::convert::resolve::Ids;
use crate::error::{Error, Result};
use crate::grid::LATTICE;
use crate::manifest::{Bounds, Group, TileEntry, checksum_text};
use crate::tile::{
    Body, Description, EncodedBody, Extras, Node, PieceRange, describe, name, refused, tile_path,
    too_large, write_head,
};
use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// The file of a tile.
struct TileFile {
    indices: u64,
    bytes: u64,
    crc: u32,
}

impl Finisher<'_> {
    /// Writes what comes before the geometry of a tile, and behind it, where that is as it is to be.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if something else has changed the file; [`Error::Usage`] if it would pass 4 GiB.
    pub(super) fn finish_tile(&self, job: &Job, known: &[Cell]) -> Result<TileEntry> {
        let (tile, body) = (&job.tile, job.body());
        let nodes = self.nodes(&job.pieces, known)?;
        let (head, low) = (
            self.settings.heads.head,
            self.settings.tiling.lowest(tile.grid),
        );
        let encoded = EncodedBody {
            body: &body,
            layout: &tile.layout,
        };
        let Description { json, table } = describe(head, low, encoded, &nodes)
            .map_err(|e| refused(e, tile.grid, self.settings.tiling))?;
        let more = table.len() as u64;
        let head = write_head(&json, tile.room as usize, tile.bin_bytes + more)
            .ok_or_else(|| too_large(tile.grid))?;
        let bytes = head.len() as u64 + tile.bin_bytes;
        let path = self.settings.dir.join(tile_path(tile.grid));
        let file = OpenOptions::new()
            .write(true)
            .open(&path)
            .map_err(|e| Error::io(&path, "open", e))?;
        let found = file.metadata().map_err(|e| Error::io(&path, "stat", e))?;
        // an interrupted conversion may have written the table already, or some of it
        if !(bytes..=bytes + more).contains(&found.len()) {
            return Err(changed(&path, found.len(), bytes));
        }
        for (part, at) in [(&head, 0), (&table, bytes)] {
            file.write_all_at(part, at)
                .map_err(|e| Error::io(&path, "write", e))?;
        }
        let mut crc = crc32fast::Hasher::new();
        crc.update(&head);
        crc.combine(&crc32fast::Hasher::new_with_initial_len(
            tile.crc,
            tile.bin_bytes,
        ));
        crc.update(&table);
        let file = TileFile {
            indices: tile.layout.indices.into(),
            bytes: bytes + more,
            crc: crc.finalize(),
        };
        Ok(entry(job, &body, file))
    }

    /// Names and numbers of a tile's pieces.
    fn nodes(&self, pieces: &[WrittenPiece], known: &[Cell]) -> Result<Vec<Node>> {
        let unit = self.settings.placement.unit.name();
        let node = |piece: &WrittenPiece| {
            let Ids {
                object,
                cell,
                surface,
            } = piece.ids;
            let extras = Extras::ids(cell, object, surface, u64::from(piece.body.triangles));
            if cell == 0 {
                return Ok(Node {
                    name: name(0, object, false),
                    extras,
                    colour: None,
                });
            }
            let of_cell = match known.binary_search_by_key(&cell, |c| c.id) {
                Ok(at) => known[at],
                Err(_) => self.cell(cell)?,
            };
            Ok(Node {
                name: name(cell, object, of_cell.has_surfaces),
                extras: extras.with_measures(&of_cell.measures, unit),
                colour: None,
            })
        };
        pieces.iter().map(node).collect()
    }
}

/// The error for a tile that is not as this program has written it.
pub(super) fn changed(path: &Path, found: u64, expected: u64) -> Error {
    let expected = format!("{expected} bytes as the conversion wrote them");
    Error::format(path, format!("{found} bytes"), expected).with_hint(
        "something else has changed the file: convert again with --force instead of --resume",
    )
}

/// The shard's entry of a tile.
fn entry(job: &Job, body: &Body, file: TileFile) -> TileEntry {
    let tile: &TileRecord = &job.tile;
    let sum = |get: fn(&PieceRange) -> u32| body.pieces.iter().map(|p| u64::from(get(p))).sum();
    let [min, max] = body
        .bounds()
        .map(|steps| steps.map(|v| f64::from(v) / f64::from(LATTICE)));
    TileEntry {
        path: tile_path(tile.grid),
        grid: tile.grid,
        bounds: Bounds { min, max },
        vertices: u64::from(body.vertices),
        triangles: sum(|p| p.triangles),
        strips: sum(|p| p.strips),
        indices: file.indices,
        bytes: file.bytes,
        checksum: checksum_text(file.crc),
        groups: job.pieces.iter().map(group).collect(),
    }
}

fn group(piece: &WrittenPiece) -> Group {
    Group {
        cell: piece.ids.cell,
        object: piece.ids.object,
        surface: piece.ids.surface,
        vertices: u64::from(piece.body.vertices),
        triangles: u64::from(piece.body.triangles),
    }
}
