//! Copies what is kept: rows of the tables, pieces of the tiles.

use crate::error::{Error, Result};
use crate::grid::{LATTICE, Tiling};
use crate::manifest::{
    Bounds, Group, Layer, Manifest, Primitives, ShardWriter, TileEntry, Totals, checksum_text,
    file_inside,
};
use crate::progress::Progress;
use crate::sys::files::write_file;
use crate::table::{Row, Table};
use crate::tile::{Part, PartPiece, TilePlace, part, tile_path};
use crate::transform::select::choice::Choice;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// What was kept of the tables.
#[derive(Debug, Default)]
pub struct Rows {
    cells: u64,
    surfaces: u64,
    /// Surfaces of each kept object: how many were kept, and how many there are.
    objects: BTreeMap<u64, [u64; 2]>,
    vertices: u64,
    border_edges: u64,
    voxels_above: u64,
}

impl Rows {
    /// True if every object in the part has all its surfaces.
    fn complete(&self) -> bool {
        self.objects.values().all(|[kept, all]| kept == all)
    }
}

/// Copies the rows of kept cells, their surfaces and the objects of these.
///
/// # Errors
/// [`Error::Io`], or [`Error::Format`] if a table is damaged.
pub fn tables(from: &Path, to: &Path, manifest: &Manifest, choice: &Choice) -> Result<Rows> {
    let mut rows = Rows::default();
    filter(from, to, manifest, Table::Cells, |_, id| {
        let keep = choice.style(id).is_some();
        rows.cells += u64::from(keep);
        Ok(keep)
    })?;
    let reader = Table::Surfaces.open(from, manifest)?;
    let column = |name: &str| {
        reader
            .column(name)
            .ok_or_else(|| Error::format(reader.path(), "none", format!("a column {name}")))
    };
    let [cell, object] = [column("cell")?, column("object")?];
    let [vertices, border] = [column("vertices")?, column("border_edges")?];
    filter(from, to, manifest, Table::Surfaces, |row, _| {
        let keep = choice.style(row.whole(cell)?).is_some();
        let counts = rows.objects.entry(row.whole(object)?).or_default();
        counts[1] = counts[1].saturating_add(1);
        if keep {
            counts[0] += 1;
            rows.surfaces += 1;
            rows.vertices = rows.vertices.saturating_add(row.whole(vertices)?);
            rows.border_edges = rows.border_edges.saturating_add(row.whole(border)?);
        }
        Ok(keep)
    })?;
    rows.objects.retain(|_, [kept, _]| *kept > 0);
    // objects without any surface stay if nothing was left out
    let all = rows.cells == manifest.totals.cells;
    let reader = Table::Objects.open(from, manifest)?;
    let voxels = reader.column("voxels");
    let mut lone = Vec::new();
    filter(from, to, manifest, Table::Objects, |row, id| {
        let keep = all || rows.objects.contains_key(&id);
        if let (true, Some(voxels)) = (keep, voxels) {
            rows.voxels_above = rows.voxels_above.saturating_add(row.whole(voxels)?);
        }
        if keep && !rows.objects.contains_key(&id) {
            lone.push(id);
        }
        Ok(keep)
    })?;
    rows.objects.extend(lone.into_iter().map(|id| (id, [0, 0])));
    Ok(rows)
}

/// Copies the rows that `keep` accepts by their id.
fn filter(
    from: &Path,
    to: &Path,
    manifest: &Manifest,
    table: Table,
    mut keep: impl FnMut(&Row, u64) -> Result<bool>,
) -> Result<()> {
    let mut reader = table.open(from, manifest)?;
    let path = to.join(table.file());
    let failed = |e| Error::io(&path, "write", e);
    let mut out = BufWriter::new(File::create(&path).map_err(failed)?);
    let header: Vec<String> = reader.columns().iter().map(|c| c.header()).collect();
    writeln!(out, "{}", header.join(",")).map_err(failed)?;
    let id = reader.column("id").unwrap_or(0);
    while let Some(row) = reader.next_row()? {
        let id = row.whole(id)?;
        if keep(&row, id)? {
            writeln!(out, "{}", row.line()?).map_err(failed)?;
        }
    }
    out.flush().map_err(failed)
}

/// Copies the kept pieces of all tiles, with shards, and brings the manifest's layers and sums up to
/// date.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`] if a tile or shard is damaged, [`Error::Interrupted`].
pub fn tiles(
    from: &Path,
    to: &Path,
    manifest: &mut Manifest,
    choice: &Choice,
    rows: &Rows,
    progress: &dyn Progress,
) -> Result<()> {
    manifest.cap &= rows.complete();
    let layers = std::mem::take(&mut manifest.layers);
    progress.begin(
        "tiles",
        layers.iter().map(|l| l.tiles).fold(0, u64::saturating_add),
    );
    let copier = Copier {
        from,
        to,
        manifest,
        choice,
        rows,
        progress,
    };
    let mut totals = Totals {
        voxels_nan: manifest.totals.voxels_nan,
        vertices: rows.vertices,
        cells: rows.cells,
        objects: rows.objects.len() as u64,
        surfaces: rows.surfaces,
        border_edges: if manifest.cap { 0 } else { rows.border_edges },
        voxels_above: rows.voxels_above,
        ..Totals::default()
    };
    let mut kept = Vec::new();
    for layer in &layers {
        kept.extend(copier.layer(layer, &mut totals)?);
    }
    let edges = (3 * totals.triangles + totals.border_edges) / 2;
    totals.euler_characteristic = totals.vertices as i64 - edges as i64 + totals.triangles as i64;
    manifest.layers = kept;
    manifest.totals = totals;
    Ok(())
}

struct Copier<'a> {
    from: &'a Path,
    to: &'a Path,
    manifest: &'a Manifest,
    choice: &'a Choice,
    rows: &'a Rows,
    progress: &'a dyn Progress,
}

impl Copier<'_> {
    /// Copies a layer; `None` if no tile of it is left.
    fn layer(&self, layer: &Layer, totals: &mut Totals) -> Result<Option<Layer>> {
        let all = self.manifest.shard_tiles(self.from, layer)?;
        let dir = self.to.join(format!("tiles/z{:04}", layer.z));
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
        let make = |entry: TileEntry| {
            if self.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let made = self.tile(&entry, layer.z)?;
            self.progress.advance(1);
            Ok(made)
        };
        let mut shard: Option<ShardWriter> = None;
        all.make_all(make, |made| {
            let Some((entry, part)) = made else {
                return Ok(());
            };
            add(totals, &entry, &part.pieces);
            if shard.is_none() {
                shard = Some(ShardWriter::create(self.to, layer.z)?);
            }
            shard.as_mut().map_or(Ok(()), |shard| shard.add(&entry))
        })?;
        let Some(shard) = shard else {
            std::fs::remove_dir(&dir).map_err(|e| Error::io(&dir, "remove the directory", e))?;
            return Ok(None);
        };
        shard.finish().map(|(layer, _)| Some(layer.layer()))
    }

    /// Copies a tile's kept pieces; the file's bytes are dropped once written.
    fn tile(&self, entry: &TileEntry, z: u32) -> Result<Option<(TileEntry, Part)>> {
        let path = file_inside(self.from, &entry.path, "read the tile")?;
        let bad = |found: String, expected: &str| Err(Error::format(&path, found, expected));
        let grid = self.manifest.grid;
        let tiling = Tiling {
            dims: grid.dims,
            macrocube: grid.macrocube,
        };
        let tiles = tiling.tiles();
        if entry.grid[2] != z || (0..3).any(|a| entry.grid[a] >= tiles[a]) {
            return bad(
                format!("macrocube {:?}", entry.grid),
                "one of the layer and grid",
            );
        }
        let keeps = |cell: u64| match cell {
            0 => self.manifest.cap,
            cell => self.choice.style(cell).is_some(),
        };
        if !entry.groups.iter().any(|g| keeps(g.cell)) {
            return Ok(None);
        }
        let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read the tile", e))?;
        if checksum_text(crc32fast::hash(&bytes)) != entry.checksum {
            return bad(
                "another checksum than the index states".into(),
                &entry.checksum,
            );
        }
        let place = TilePlace {
            primitives: self.manifest.primitives,
            low: tiling.lowest(entry.grid),
            dims: grid.dims.0,
        };
        let style = |ids: &crate::tile::read::PieceIds| match ids.cell {
            0 => (self.manifest.cap && self.rows.objects.contains_key(&ids.object)).then_some(None),
            cell => self.choice.style(cell),
        };
        let made = part(&bytes, &place, style).map_err(|e| {
            Error::format(&path, e.to_string(), "a tile").with_hint("`alvis verify` says more")
        })?;
        let Some(mut part) = made else {
            return Ok(None);
        };
        let target = self.to.join(tile_path(entry.grid));
        write_file(&target, &[&part.file])?;
        let entry = described(entry.grid, self.manifest.primitives, &part);
        part.file = Vec::new();
        Ok(Some((entry, part)))
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

/// Adds a tile to the sums.
fn add(totals: &mut Totals, entry: &TileEntry, pieces: &[PartPiece]) {
    totals.add_tile(entry);
    for piece in pieces {
        totals.volume6 += piece.volume6;
        totals.vertices += piece.outside;
        if piece.ids.cell == 0 {
            totals.cap_triangles += piece.ids.triangles;
        }
    }
}
