//! Gives the tiles their ids and measures.

use crate::error::{Error, Result};
use crate::grid::{LATTICE, Placement, Tiling};
use crate::manifest::{Bounds, Group, Layer, Shard, TileEntry, Totals, checksum_text};
use crate::measure::{ComponentRecord, Measures, RecordTable};
use crate::pipeline::anew::{Buffers, anew_path, read_back, write_anew};
use crate::pipeline::forward::SlabRecord;
use crate::pipeline::keep::Keeper;
use crate::pipeline::ration::{at_once, parts};
use crate::pipeline::resolve::Resolved;
use crate::pipeline::shards::{Ends, FinishedLayer, Part, shard_path};
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::surfaces::WHOLE;
use crate::pipeline::tilefile::{TileRecord, WrittenPiece, too_large, too_wide};
use crate::pipeline::writers::Writers;
use crate::progress::Progress;
use crate::tile::{
    Body, BodyPiece, Extras, Node, Refused, TileHead, group_body, name, node_json, tile_file,
    tile_path, write_head,
};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{OpenOptions, create_dir_all};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// What finishing needs to know of the whole set.
#[derive(Clone, Copy)]
pub struct FinishSettings<'a> {
    /// Directory that will become the tile set.
    pub dir: &'a Path,
    /// What all tiles have in common.
    pub head: &'a TileHead,
    /// Spacing and unit of the measures.
    pub placement: &'a Placement,
    /// The macrocubes.
    pub tiling: Tiling,
    /// Bring tiles that are written anew to the disk.
    pub writers: Option<&'a Writers>,
    /// Bytes that tiles may take while they are finished.
    pub memory: u64,
}

/// The settings with the sums of all components.
struct Finisher<'a> {
    settings: FinishSettings<'a>,
    cells: &'a RecordTable<ComponentRecord>,
}

/// What the nodes of a cell say.
#[derive(Clone, Copy)]
struct Cell {
    id: u64,
    measures: Measures,
    has_surfaces: bool,
}

/// Pieces of some tiles whose cells are measured once for all of them, at most: 5 MB of measures.
const KNOWN_PIECES: usize = 1 << 14;

/// The ids of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Ids {
    object: u64,
    /// 0 for a cap.
    cell: u64,
    /// 0 for a cap.
    surface: u64,
}

/// Final ids in terms of a slab.
struct IdsOfSlab {
    classes: Vec<u64>,
    surfaces: Vec<u64>,
    whole: Vec<u64>,
}

impl IdsOfSlab {
    fn of(&self, p: &WrittenPiece) -> Ids {
        let object = self.classes[p.object as usize];
        if p.is_cap() {
            return Ids {
                object,
                cell: 0,
                surface: 0,
            };
        }
        let surface = match p.surface & WHOLE {
            0 => self.surfaces[p.surface as usize],
            _ => self.whole[(p.surface & !WHOLE) as usize],
        };
        Ids {
            object,
            cell: self.classes[p.cell as usize],
            surface,
        }
    }
}

/// Gives all tiles their ids, layer by layer, and counts in how many tiles each component is. Returns the
/// layers that have tiles.
///
/// # Errors
/// [`Error::Interrupted`], [`Error::Io`], [`Error::Usage`] if a tile would pass 4 GiB, and [`Error::Format`]
/// if a shard from before is not as it was written.
pub fn finish(
    slabs: &[SlabRecord],
    spool: &mut Spool,
    resolved: &mut Resolved,
    (settings, keeper): (&FinishSettings, &mut Keeper),
    totals: &mut Totals,
    progress: &dyn Progress,
) -> Result<Vec<Layer>> {
    let before = keeper.finished();
    let mut ends = Ends::begin(settings, keeper, slabs.len(), totals, progress)?;
    let mut behind = None;
    for (i, slab) in slabs.iter().enumerate() {
        if (i as u32) < before {
            let finished = finished_layer(settings, resolved, slab, spool)?;
            ends.add(finished);
        } else if progress.interrupted() {
            behind.map_or(Ok(()), |part| ends.take(part))?;
            return Err(Error::Interrupted);
        } else {
            let take = |part| ends.take(part);
            let slab = (slab, i);
            behind = Some(finish_tiles(settings, resolved, slab, spool, behind, take)?);
        }
    }
    behind.map_or(Ok(()), |part| ends.take(part))?;
    ends.end()
}

/// Finishes the tiles of slab `number`, a few at a time, and counts those of each component.
///
/// `take` is called with the part `behind` and each of the layer's, but beside the making of the part after
/// it: what it does to files need not be waited for. The last part is returned.
///
/// # Errors
/// [`Error::Io`], [`Error::Usage`] if a tile would pass 4 GiB, and those of `take`.
fn finish_tiles(
    settings: &FinishSettings,
    resolved: &mut Resolved,
    (slab, number): (&SlabRecord, usize),
    spool: &mut Spool,
    mut behind: Option<Part>,
    mut take: impl FnMut(Part) -> Result<()> + Send,
) -> Result<Part> {
    let tiles = spool.get(&slab.tiles)?;
    let places = &resolved.slabs[number];
    let ids = IdsOfSlab {
        classes: resolved.ids.get(&places.classes)?,
        surfaces: resolved.ids.get(&places.surfaces)?,
        whole: resolved.ids.get(&places.whole)?,
    };
    let mut parts = parts(&tiles, settings.memory).into_iter().peekable();
    loop {
        let tiles = parts.next().unwrap_or_default();
        let mut jobs = Vec::with_capacity(tiles.len());
        for tile in tiles {
            let place = Place::new(tile.pieces_at, tile.pieces as usize);
            jobs.push((tile, spool.get::<WrittenPiece>(&place)?));
        }
        let finisher = Finisher {
            settings: *settings,
            cells: &resolved.cells,
        };
        let (taken, made) = rayon::join(
            || behind.take().map_or(Ok(()), &mut take),
            || finisher.finish_all(&jobs, &ids),
        );
        taken?;
        let tiles = made?;
        for (tile, _) in &tiles {
            count_tile(resolved, tile)?;
        }
        let last = parts.peek().is_none();
        let part = Part {
            layer: slab.layer,
            tiles,
            last,
        };
        if last {
            return Ok(part);
        }
        behind = Some(part);
    }
}

/// What was made of a slab in a process before this one; counts the tiles of each component.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] if the shard is not as it was written.
fn finished_layer(
    settings: &FinishSettings,
    resolved: &mut Resolved,
    slab: &SlabRecord,
    spool: &mut Spool,
) -> Result<Option<FinishedLayer>> {
    let tiles = spool.get(&slab.tiles)?;
    if tiles.is_empty() {
        return Ok(None);
    }
    let name = shard_path(slab.layer);
    let path = settings.dir.join(&name);
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
    let shard = serde_json::from_slice::<Shard>(&bytes).ok().filter(|s| {
        let grids = s.tiles.iter().map(|t| t.grid);
        s.z == slab.layer && grids.eq(tiles.iter().map(|t| t.grid))
    });
    let Some(shard) = shard else {
        return Err(changed(&path, bytes.len() as u64, bytes.len() as u64));
    };
    let mut totals = Totals::default();
    for tile in &shard.tiles {
        count_tile(resolved, tile)?;
        totals.add_tile(tile);
    }
    let entry = Layer {
        z: slab.layer,
        path: name,
        tiles: totals.tiles,
        bytes: bytes.len() as u64,
        checksum: checksum_text(crc32fast::hash(&bytes)),
    };
    Ok(Some(FinishedLayer { entry, totals }))
}

/// Adds a tile to the counts of all components in it.
fn count_tile(resolved: &mut Resolved, tile: &TileEntry) -> Result<()> {
    let distinct = |get: fn(&Group) -> u64| {
        let open = tile.groups.iter().filter(|g| g.cell != 0);
        let mut ids: Vec<u64> = open.map(get).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    };
    for id in distinct(|g| g.object) {
        resolved.objects.update(id - 1, |r| r.tiles += 1)?;
    }
    for id in distinct(|g| g.cell) {
        resolved.cells.update(id - 1, |r| r.tiles += 1)?;
    }
    for id in distinct(|g| g.surface) {
        resolved.surfaces.update(id - 1, |r| r.tiles += 1)?;
    }
    Ok(())
}

impl Finisher<'_> {
    fn finish_all(
        &self,
        tiles: &[(&TileRecord, Vec<WrittenPiece>)],
        ids: &IdsOfSlab,
    ) -> Result<Vec<(TileEntry, Vec<u8>)>> {
        let known = self.cells_of(tiles, ids)?;
        let finish = |buffers: &mut Buffers, (tile, pieces): &(&TileRecord, Vec<WrittenPiece>)| {
            let ids: Vec<Ids> = pieces.iter().map(|p| ids.of(p)).collect();
            let entry = self.finish_tile(tile, (pieces, &ids, &known), buffers)?;
            let text = serde_json::to_vec(&entry).expect("plain data serialises");
            Ok((entry, text))
        };
        let threads = rayon::current_num_threads();
        let records = tiles.iter().map(|(tile, _)| *tile);
        let together = match at_once(records, self.settings.memory, threads) {
            few if few < threads => few,
            _ => tiles.len().max(1),
        };
        let mut finished = Vec::with_capacity(tiles.len());
        for tiles in tiles.chunks(together) {
            let made = tiles.par_iter().map_init(Buffers::default, finish);
            finished.extend(made.collect::<Result<Vec<_>>>()?);
        }
        Ok(finished)
    }

    /// The cells of some tiles by rising id, unless there are too many pieces. Most lie in several tiles.
    fn cells_of(
        &self,
        tiles: &[(&TileRecord, Vec<WrittenPiece>)],
        ids: &IdsOfSlab,
    ) -> Result<Vec<Cell>> {
        if tiles.iter().map(|(_, pieces)| pieces.len()).sum::<usize>() > KNOWN_PIECES {
            return Ok(Vec::new());
        }
        let pieces = tiles.iter().flat_map(|(_, pieces)| pieces);
        let all = pieces.map(|p| ids.of(p).cell);
        let mut cells: Vec<u64> = all.filter(|&cell| cell != 0).collect();
        cells.sort_unstable();
        cells.dedup();
        cells.into_par_iter().map(|id| self.cell(id)).collect()
    }

    fn cell(&self, id: u64) -> Result<Cell> {
        let record = self.cells.get(id - 1)?;
        Ok(Cell {
            id,
            measures: Measures::of(&record, self.settings.placement, false),
            has_surfaces: record.surfaces > 1,
        })
    }

    fn finish_tile(
        &self,
        tile: &TileRecord,
        (pieces, ids, known): (&[WrittenPiece], &[Ids], &[Cell]),
        buffers: &mut Buffers,
    ) -> Result<TileEntry> {
        let body = Body {
            pieces: pieces.iter().map(|p| p.body).collect(),
            vertices: tile.vertices,
            bytes: tile.body_bytes,
        };
        let (groups, group_ids) = group(ids);
        let grouped = groups.len() < pieces.len();
        let path = self.settings.dir.join(tile_path(tile.grid));
        if !grouped && self.settings.head.is_plain(groups.len()) {
            let nodes = self.nodes(&body, &group_ids, known)?;
            let json = node_json(self.settings.head, &body, &nodes);
            let room = tile.room as usize;
            let head =
                write_head(&json, room, tile.body_bytes).ok_or_else(|| too_large(tile.grid))?;
            let bytes = head.len() as u64 + tile.body_bytes;
            let file = OpenOptions::new()
                .write(true)
                .open(&path)
                .map_err(|e| Error::io(&path, "open", e))?;
            let found = file.metadata().map_err(|e| Error::io(&path, "stat", e))?;
            if found.len() != bytes {
                return Err(changed(&path, found.len(), bytes));
            }
            file.write_all_at(&head, 0)
                .map_err(|e| Error::io(&path, "write", e))?;
            let mut crc = crc32fast::Hasher::new();
            crc.update(&head);
            crc.combine(&crc32fast::Hasher::new_with_initial_len(
                tile.crc,
                tile.body_bytes,
            ));
            return Ok(entry(
                tile,
                &body,
                &group_ids,
                None,
                (bytes, crc.finalize()),
            ));
        }
        self.rewrite_tile(tile, &body, (&groups, &group_ids, known), (&path, buffers))
    }

    /// Writes a tile anew, beside the old one: pieces that turned out to be one are joined, the layout
    /// is the merged one, or numbers are stored in another way.
    fn rewrite_tile(
        &self,
        tile: &TileRecord,
        body: &Body,
        (groups, group_ids, known): (&[Vec<usize>], &[Ids], &[Cell]),
        (path, buffers): (&Path, &mut Buffers),
    ) -> Result<TileEntry> {
        let head = self.settings.head;
        let bytes = read_back(path, &mut buffers.old)?;
        let start = bytes.len().saturating_sub(body.bytes as usize);
        if crc32fast::hash(&bytes[start..]) != tile.crc {
            let len = bytes.len() as u64;
            return Err(changed(path, len, len.max(body.bytes)));
        }
        let (body, bin) = if groups.len() < body.pieces.len() {
            let (body, bin) = group_body(body, &bytes[start..], groups, head.form.primitives);
            (Cow::Owned(body), Cow::Owned(bin))
        } else {
            (Cow::Borrowed(body), Cow::Borrowed(&bytes[start..]))
        };
        let nodes = self.nodes(&body, group_ids, known)?;
        let low = |a: usize| self.settings.tiling.cubes(a, tile.grid[a]).start;
        let file = tile_file(head, std::array::from_fn(low), (&body, &bin), &nodes).map_err(
            |refused| match refused {
                Refused::TooLarge => too_large(tile.grid),
                Refused::TooWide => too_wide(self.settings.tiling.macrocube),
            },
        )?;
        drop(bin);
        let anew = self.settings.dir.join(anew_path(tile.grid));
        if let Some(dir) = anew.parent() {
            create_dir_all(dir).map_err(|e| Error::io(dir, "create the directory", e))?;
        }
        let size_and_crc = (file.bytes.len() as u64, crc32fast::hash(&file.bytes));
        write_anew(anew, &file.bytes, (self.settings.writers, &mut buffers.new))?;
        let indices = Some(file.indices);
        Ok(entry(tile, &body, group_ids, indices, size_and_crc))
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
fn changed(path: &Path, found: u64, expected: u64) -> Error {
    let expected = format!("{expected} bytes as the conversion wrote them");
    Error::format(path, format!("{found} bytes"), expected)
        .with_hint("something else has changed the file: convert again without --resume")
}

/// The shard's entry of a tile.
fn entry(
    tile: &TileRecord,
    body: &Body,
    ids: &[Ids],
    indices: Option<u64>,
    (bytes, crc): (u64, u32),
) -> TileEntry {
    let sum = |get: fn(&BodyPiece) -> u32| body.pieces.iter().map(|p| u64::from(get(p))).sum();
    let bound = |start: i32, get: fn(&BodyPiece) -> [i32; 3], pick: fn(i32, i32) -> i32| {
        let steps = body
            .pieces
            .iter()
            .map(get)
            .fold([start; 3], |a, b| std::array::from_fn(|i| pick(a[i], b[i])));
        steps.map(|v| f64::from(v) / f64::from(LATTICE))
    };
    TileEntry {
        path: tile_path(tile.grid),
        grid: tile.grid,
        bounds: Bounds {
            min: bound(i32::MAX, |p| p.min, i32::min),
            max: bound(i32::MIN, |p| p.max, i32::max),
        },
        vertices: u64::from(body.vertices),
        triangles: sum(|p| p.triangles),
        strips: sum(|p| p.strips),
        indices: indices.unwrap_or_else(|| sum(|p| p.indices)),
        bytes,
        checksum: checksum_text(crc),
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

/// Pieces with the same ids, in the order of their first piece.
fn group(ids: &[Ids]) -> (Vec<Vec<usize>>, Vec<Ids>) {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut group_ids = Vec::new();
    let mut known: BTreeMap<Ids, usize> = BTreeMap::new();
    for (piece, &id) in ids.iter().enumerate() {
        let next = groups.len();
        let at = *known.entry(id).or_insert(next);
        if at == next {
            groups.push(Vec::new());
            group_ids.push(id);
        }
        groups[at].push(piece);
    }
    (groups, group_ids)
}
