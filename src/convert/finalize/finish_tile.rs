//! A tile gets its ids and measures: before and behind its geometry, or in a file of its own that replaces it.

use crate::convert::finalize::batches::{Ids, Job, group};
use crate::convert::finalize::finisher::{Cell, Finisher};
use crate::convert::finalize::rewrite::{
    Buffers, fill, read_back, replacement_path, write_replacement,
};
use crate::convert::scan::tile_writer::TileRecord;
use crate::error::{Error, Result};
use crate::grid::LATTICE;
use crate::manifest::{Bounds, Group, TileEntry, checksum_text};
use crate::tile::{
    Body, Description, EncodedBody, Extras, Grouped, Node, PieceRange, decode, describe, name,
    refused, tile_path, too_large, write_head,
};
use std::borrow::Cow;
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
        let nodes = self.nodes(&body, &job.ids, known)?;
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
        Ok(entry(tile, &body, &job.ids, file))
    }

    /// Writes a tile anew, beside the old one.
    ///
    /// # Errors
    /// As of [`Finisher::finish_tile`].
    pub(super) fn rewrite_tile(
        &self,
        job: &Job,
        known: &[Cell],
        buffers: &mut Buffers,
    ) -> Result<TileEntry> {
        let tile = &job.tile;
        let (groups, group_ids) = group(&job.ids, &job.carry_over);
        let (head, low) = (
            self.settings.heads.head,
            self.settings.tiling.lowest(tile.grid),
        );
        let path = self.settings.dir.join(tile_path(tile.grid));
        let bytes = read_back(&path, &mut buffers.old)?;
        let place = tile.start()..tile.start() + tile.bin_bytes as usize;
        let not_ours = || changed(&path, bytes.len() as u64, place.end as u64);
        let bytes = bytes.get(place.clone()).ok_or_else(not_ours)?;
        if crc32fast::hash(bytes) != tile.crc {
            return Err(not_ours());
        }
        // as the sweep had it before it was encoded
        let (body, bytes) = match tile.room {
            0 => (job.body(), Cow::Borrowed(bytes)),
            _ => {
                let encoded = EncodedBody {
                    body: &job.body(),
                    layout: &tile.layout,
                };
                decode(head, low, encoded, bytes).map_err(|_| not_ours())?
            }
        };
        let made = Grouped::new(&body, &bytes, &groups, head.form.primitives);
        let nodes = self.nodes(&made.body, &group_ids, known)?;
        let indices = fill(&mut buffers.new, self.settings.heads, low, &made, &nodes)
            .map_err(|e| refused(e, tile.grid, self.settings.tiling))?;
        let new = buffers.new.get();
        let file = TileFile {
            indices,
            bytes: new.len() as u64,
            crc: crc32fast::hash(new),
        };
        let anew = self.settings.dir.join(replacement_path(tile.grid));
        write_replacement(anew, &mut buffers.new, self.settings.writers)?;
        Ok(entry(tile, &made.body, &group_ids, file))
    }

    /// Names and numbers of a tile's pieces.
    fn nodes(&self, body: &Body, ids: &[Ids], known: &[Cell]) -> Result<Vec<Node>> {
        let unit = self.settings.placement.unit.name();
        ids.iter()
            .zip(&body.pieces)
            .map(
                |(
                    &Ids {
                        object,
                        cell,
                        surface,
                    },
                    piece,
                )| {
                    let extras = Extras::ids(cell, object, surface, u64::from(piece.triangles));
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
                },
            )
            .collect()
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
fn entry(tile: &TileRecord, body: &Body, ids: &[Ids], file: TileFile) -> TileEntry {
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
        groups: ids
            .iter()
            .zip(&body.pieces)
            .map(|(ids, p)| Group {
                cell: ids.cell,
                object: ids.object,
                surface: ids.surface,
                vertices: u64::from(p.vertices),
                triangles: u64::from(p.triangles),
            })
            .collect(),
    }
}
