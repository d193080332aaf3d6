//! The manifest and its shards: read, and checked for what they say by themselves.

use super::closed::{self, Schema};
use super::code::Code;
use super::files::{self, Expected};
use super::parts;
use super::report::Issues;
use super::selection::check_selection;
use crate::error::{Error, Result};
use crate::grid::{Dims, LATTICE, Tiling, check_filters};
use crate::manifest::{FORMAT, FORMAT_VERSION, Layer, Manifest, PartsBy, SPLIT_VERSION, TileEntry};
use crate::manifest::{ShardFault, ShardText, ShardTiles};
use crate::manifest::{manifest_file, own_checksum};
use crate::store::File;
use serde::Deserialize;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// The manifest's file.
pub(super) const MANIFEST: &str = "index.json";

/// Reads the manifest. `None` if it is damaged, which is an issue.
///
/// # Errors
/// [`Error::Io`] if there is none, or it cannot be read: then there is nothing to verify. [`Error::Format`] if it is a
/// folder, pipe or device.
pub(super) fn manifest(root: &Path, issues: &mut Issues) -> Result<Option<Manifest>> {
    #[derive(Deserialize)]
    struct Head {
        format: Option<serde_json::Value>,
        format_version: Option<serde_json::Value>,
    }
    // as of every other file of the set: a link that leads outside or nowhere is an issue
    let is_link = |path: &Path| path.symlink_metadata().is_ok_and(|m| m.is_symlink());
    if is_link(&root.join(MANIFEST)) && files::resolve(root, MANIFEST, MANIFEST, issues).is_none() {
        return Ok(None);
    }
    let path = manifest_file(root, "read the manifest")?;
    let failed = |e| Error::io(&path, "read the manifest", e);
    let mut file = File::open(&path).map_err(failed)?;
    let syntax = |e: serde_json::Error, issues: &mut Issues| {
        issues.add(Code::ManifestSyntax, MANIFEST, e.to_string());
    };
    let head: Head = match serde_json::from_reader(BufReader::new(&file)) {
        Ok(head) => head,
        Err(e) if e.is_io() => return Err(failed(e.into())),
        Err(e) => {
            syntax(e, issues);
            return Ok(None);
        }
    };
    let known =
        head.format == Some(FORMAT.into()) && head.format_version == Some(FORMAT_VERSION.into());
    if let (false, Some(format), Some(version)) = (known, &head.format, &head.format_version) {
        let message = format!(
            "found format {format} version {version}, this program reads \"{FORMAT}\" version {FORMAT_VERSION}"
        );
        issues.add(Code::FormatVersion, MANIFEST, message);
        return Ok(None);
    }
    file.rewind().map_err(failed)?;
    match serde_json::from_reader::<_, Manifest>(BufReader::with_capacity(1 << 16, &file)) {
        Ok(manifest) => {
            check_own(&manifest, &file, issues).map_err(failed)?;
            check_members(&closed::MANIFEST, &file, MANIFEST, issues).map_err(failed)?;
            Ok(check(&manifest, issues).then_some(manifest))
        }
        Err(e) if e.is_io() => Err(failed(e.into())),
        Err(e) => {
            syntax(e, issues);
            Ok(None)
        }
    }
}

/// Reports members that the format does not have, of a file that has been read before.
fn check_members(
    schema: &Schema,
    mut file: &File,
    path: &str,
    issues: &mut Issues,
) -> std::io::Result<()> {
    file.rewind()?;
    // what is no JSON has been reported
    let found = schema.walk_file(BufReader::with_capacity(1 << 16, file));
    for (pointer, message) in found.unwrap_or_default() {
        issues.add(Code::ForeignMember, format!("{path}#{pointer}"), message);
    }
    Ok(())
}

/// Compares the manifest's checksum with what it states itself; that it states none is a missing member.
fn check_own(m: &Manifest, file: &File, issues: &mut Issues) -> std::io::Result<()> {
    let Some(stated) = &m.checksum else {
        return Ok(());
    };
    let found = own_checksum(file, stated)?;
    if found != *stated {
        let message = format!(
            "found {found}, expected {stated} as it states: the file was changed after it was written"
        );
        issues.add(Code::Checksum, MANIFEST, message);
    }
    Ok(())
}

/// Checks the manifest's values; false if the tiles cannot be read by them.
fn check(m: &Manifest, issues: &mut Issues) -> bool {
    let mut wrong = |pointer: &str, message: String| {
        issues.add(
            Code::ManifestValue,
            format!("{MANIFEST}#/{pointer}"),
            message,
        );
    };
    if !check_grid(m, &mut wrong) {
        return false;
    }
    if !m.threshold.is_finite() {
        wrong(
            "threshold",
            format!("found {}, expected a finite number", m.threshold),
        );
    }
    if !check_placement(m, &mut wrong) {
        return false;
    }
    match check_filters(&m.filters) {
        Ok(()) => check_crop(m, &mut wrong),
        Err(e) => wrong("filters", e.to_string()),
    }
    check_counts(m, &mut wrong);
    let rising = m.layers.windows(2).all(|w| w[0].z < w[1].z);
    let [_, _, nz] = m.tiling().tiles();
    if !rising || m.layers.iter().any(|l| l.z >= nz || l.tiles == 0) {
        let message = "expected layers with tiles by rising z inside the grid".to_owned();
        wrong("layers", message);
        return false;
    }
    true
}

/// Checks the grid and the lattice; false if the tiles cannot be read by them.
fn check_grid(m: &Manifest, wrong: &mut impl FnMut(&str, String)) -> bool {
    let grid = &m.grid;
    if Dims::new(grid.dims.0.map(u64::from)).is_err() || grid.macrocube.contains(&0) {
        let message = format!(
            "found {} voxels and macrocubes of {:?} cubes, expected 2 to 65536 voxels and at least 1 cube per axis",
            grid.dims, grid.macrocube
        );
        wrong("grid", message);
        return false;
    }
    let tiles = m.tiling().tiles();
    if tiles != grid.tiles {
        let message = format!("found {:?}, expected {tiles:?}", grid.tiles);
        wrong("grid/tiles", message);
    }
    if m.lattice != LATTICE {
        let message = format!("found {}, expected {LATTICE}", m.lattice);
        wrong("lattice", message);
        return false;
    }
    true
}

/// Checks where the grid lies, and the transform, which follows from that; false if nothing can be measured by it.
fn check_placement(m: &Manifest, wrong: &mut impl FnMut(&str, String)) -> bool {
    if let Err(e) = m.placement.check() {
        wrong("spacing", e.to_string());
        return false;
    }
    if let Some(Err(e)) = m.table_unit.map(|unit| m.placement.in_unit(unit)) {
        wrong("table_unit", e.to_string());
        return false;
    }
    let expected = m.placement.gltf_matrix();
    let scale = expected.iter().fold(0f64, |s, v| s.max(v.abs()));
    let same = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * scale;
    if !m.transform.iter().zip(&expected).all(same) {
        let message = format!(
            "found {:?}, expected {expected:?} by spacing, unit, origin and directions",
            m.transform
        );
        wrong("transform", message);
    }
    true
}

fn check_crop(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let whole = match m.filtered_dims() {
        Ok(whole) => whole,
        Err(e) => return wrong("filters", e.to_string()),
    };
    let dims = match &m.source.crop {
        None => Ok(whole),
        Some(crop) => crop.dims_in(whole),
    };
    match dims {
        Ok(dims) if dims == m.grid.dims => {}
        Ok(dims) => {
            let message = format!("found {}, expected {dims} as in source", m.grid.dims);
            wrong("grid/dims", message);
        }
        Err(e) => wrong("source/crop", e.to_string()),
    }
}

/// Checks counts that the tiles do not show.
fn check_counts(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    if let Some(selection) = &m.selection {
        check_selection(selection, &m.totals, wrong);
    }
    if let Some(d) = &m.dust {
        let fits = |(count, voxels): (u64, u64)| {
            let most = count.saturating_mul(d.min_voxels.saturating_sub(1));
            (count..=most.max(count)).contains(&voxels)
        };
        let all = [(d.objects, d.object_voxels), (d.cells, d.cell_voxels)];
        if d.min_voxels < 2 || !all.into_iter().all(fits) {
            let message = format!("found {d:?}, expected components of fewer voxels than the size");
            wrong("dust", message);
        }
    }
    check_name(&m.source.name, "source/name", wrong);
    check_parts(m, wrong);
    check_walls(m, wrong);
    check_parquet(m, wrong);
    if m.source.offset != 0 && m.source.format != "raw" {
        let message = format!("found {} for {}", m.source.offset, m.source.format);
        wrong("source/offset", message);
    }
}

fn check_name(name: &str, at: &str, wrong: &mut impl FnMut(&str, String)) {
    if name.contains(['/', '\0']) || name == "." || name == ".." {
        let message = format!("found {name:?}, expected a file name without its directory");
        wrong(at, message);
    }
}

/// Checks what is there where cells are parts of components, and nowhere else.
fn check_parts(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let (tables, parts) = (&m.tables, m.cells.is_some());
    let sums = tables.checksums.as_ref();
    let own = [
        ("tables/components", tables.components.is_some()),
        ("tables/necks", tables.necks.is_some()),
        (
            "tables/checksums/components",
            sums.is_some_and(|sums| sums.components.is_some()),
        ),
        (
            "tables/checksums/necks",
            sums.is_some_and(|sums| sums.necks.is_some()),
        ),
    ];
    for (at, _) in own.into_iter().filter(|(_, there)| *there != parts) {
        let message = match parts {
            true => "found none, expected one: cells are parts of components",
            false => "found one, expected none: cells are the components",
        };
        wrong(at, message.to_owned());
    }
    let counts = [
        ("totals/components", m.totals.components),
        ("totals/necks", m.totals.necks),
    ];
    for (at, count) in counts.into_iter().filter(|(_, n)| !parts && *n != 0) {
        let message = format!("found {count}, expected none: cells are the components");
        wrong(at, message);
    }
    match &m.cells {
        Some(PartsBy::Labels {
            file, unlabelled, ..
        }) => {
            check_name(file, "cells/file", wrong);
            if *unlabelled == Some(0) {
                let message = "found 0, expected none".to_owned();
                wrong("cells/unlabelled", message);
            }
        }
        Some(PartsBy::Split { version, .. }) if *version != SPLIT_VERSION => {
            let message = format!("found {version}, expected {SPLIT_VERSION}");
            wrong("cells/version", message);
        }
        _ => parts::check_index(m, wrong),
    }
}

/// Checks that the table of walls has a checksum, and is counted only where there is one.
fn check_walls(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let has_table = m.tables.walls.is_some();
    let sums = m.tables.checksums.as_ref();
    if sums.is_some_and(|sums| sums.walls.is_some() != has_table) {
        let message = match has_table {
            true => "found none, expected that of tables/walls",
            false => "found one, expected none: there is no table of walls",
        };
        wrong("tables/checksums/walls", message.to_owned());
    }
    if !has_table && m.totals.walls != 0 {
        let message = format!(
            "found {}, expected none: there is no table of walls",
            m.totals.walls
        );
        wrong("totals/walls", message);
    }
}

/// Checks that of the tables that not all sets have those are there as Parquet that are there at all, if any is.
fn check_parquet(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let tables = &m.tables;
    let Some(parquet) = &tables.parquet else {
        return;
    };
    let sums = parquet.checksums.as_ref();
    for (name, csv, path, sum) in [
        (
            "components",
            &tables.components,
            &parquet.components,
            sums.map(|sums| &sums.components),
        ),
        (
            "necks",
            &tables.necks,
            &parquet.necks,
            sums.map(|sums| &sums.necks),
        ),
        (
            "walls",
            &tables.walls,
            &parquet.walls,
            sums.map(|sums| &sums.walls),
        ),
    ] {
        let message = match csv {
            Some(_) => "found none, expected one: there is this table as CSV",
            None => "found one, expected none: there is no such table as CSV",
        };
        if path.is_some() != csv.is_some() {
            wrong(&format!("tables/parquet/{name}"), message.to_owned());
        }
        if sum.is_some_and(|sum| sum.is_some() != csv.is_some()) {
            wrong(
                &format!("tables/parquet/checksums/{name}"),
                message.to_owned(),
            );
        }
    }
}

/// The path that the format gives to a layer's shard.
pub(super) fn shard_path(z: u32) -> String {
    format!("index/z{z:04}.json")
}

/// The directory of a layer's tiles, below `tiles`.
pub(super) fn tile_dir(z: u32) -> String {
    format!("z{z:04}")
}

/// The name of a tile in its layer's directory.
pub(super) fn tile_name(grid: [u32; 3]) -> String {
    format!("y{:04}_x{:04}.glb", grid[1], grid[0])
}

/// Counts and sums up the bytes that are read.
struct Summed {
    file: File,
    bytes: u64,
    crc: crc32fast::Hasher,
}

impl Read for Summed {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let found = self.file.read(out)?;
        self.bytes += found as u64;
        self.crc.update(&out[..found]);
        Ok(found)
    }
}

/// The contents of a shard, read to its end.
struct Scanned<'a> {
    file: File,
    bytes: u64,
    crc: u32,
    z: Option<u32>,
    tiles: u64,
    order: Order<'a>,
    /// Why it is no shard.
    fault: Option<String>,
}

impl<'a> Scanned<'a> {
    /// Reads a file to its end.
    ///
    /// # Errors
    /// The system's.
    fn read(file: File, mut order: Order<'a>) -> std::io::Result<Self> {
        let summed = Summed {
            file,
            bytes: 0,
            crc: crc32fast::Hasher::new(),
        };
        let mut text = ShardText::new(BufReader::with_capacity(1 << 16, summed));
        let mut tiles = 0;
        let fault = loop {
            match text.next_tile() {
                Ok(Some(tile)) => order.add(&tile),
                Ok(None) => break None,
                Err(fault) => break Some(fault),
            }
            tiles += 1;
        };
        let z = text.z();
        let mut rest = text.into_input();
        let drained = std::io::copy(&mut rest, &mut std::io::sink());
        let fault = match (fault, drained) {
            (Some(ShardFault::Io(e)), _) | (_, Err(e)) => return Err(e),
            (Some(ShardFault::Json(message)), _) => Some(message),
            (None, _) => None,
        };
        let Summed { file, bytes, crc } = rest.into_inner();
        Ok(Scanned {
            file,
            bytes,
            crc: crc.finalize(),
            z,
            tiles,
            order,
            fault,
        })
    }

    /// Checks the shard by itself and against its layer, which is at `at`; false if its tiles cannot be read.
    fn check(self, layer: &Layer, at: &str, issues: &mut Issues) -> std::io::Result<bool> {
        let named = shard_path(layer.z);
        if layer.path != named {
            let message = format!("found {}, expected {named}", layer.path);
            issues.add(Code::PathName, format!("{at}/path"), message);
            return Ok(false);
        }
        if let Some(message) = self.fault {
            issues.add(Code::ShardSyntax, &layer.path, message);
            return Ok(false);
        }
        check_members(&closed::SHARD, &self.file, &layer.path, issues)?;
        let (z, tiles) = (self.z, self.tiles);
        if z != Some(layer.z) || tiles != layer.tiles {
            let message = format!(
                "found z {} with {tiles} tiles, expected z {} with {} tiles as in {at}",
                z.unwrap_or_default(),
                layer.z,
                layer.tiles
            );
            issues.add(Code::ShardValue, &layer.path, message);
            return Ok(false);
        }
        if let Some((code, place, message)) = self.order.wrong {
            issues.add(code, place, message);
            return Ok(false);
        }
        Ok(true)
    }
}

/// Reads the shard of layer number `index` to its end and checks it; `None` if it is missing or damaged. Its tiles
/// are read again, one at a time.
pub(super) fn shard<'a>(
    root: &Path,
    tiling: Tiling,
    index: usize,
    layer: &'a Layer,
    issues: &mut Issues,
) -> Option<Tiles<'a>> {
    let at = format!("{MANIFEST}#/layers/{index}");
    let expected = Expected {
        path: &layer.path,
        bytes: layer.bytes,
        checksum: &layer.checksum,
        at: &at,
    };
    let real = files::resolve(root, &layer.path, &at, issues)?;
    let scanned = files::open(&real).and_then(|f| Scanned::read(f, Order::new(layer, tiling)));
    let checked = scanned.and_then(|scanned| {
        files::compare_sums(&expected, scanned.bytes, || scanned.crc, issues);
        scanned.check(layer, &at, issues)
    });
    match checked {
        Ok(true) => {}
        Ok(false) => return None,
        Err(e) => {
            let message = format!("cannot be read: {e}");
            issues.add(Code::MissingFile, &layer.path, message);
            return None;
        }
    }
    match ShardTiles::open(real, layer.z) {
        Ok(tiles) => Some(Tiles {
            tiles,
            order: Order::new(layer, tiling),
        }),
        Err(e) => {
            let message = format!("cannot be read again: {e}");
            issues.add(Code::MissingFile, &layer.path, message);
            None
        }
    }
}

/// The tiles of a shard that has been checked. It is read again, so they are checked again, too: it may be another
/// one by now.
pub(super) struct Tiles<'a> {
    tiles: ShardTiles,
    order: Order<'a>,
}

impl Iterator for Tiles<'_> {
    type Item = Result<TileEntry>;

    fn next(&mut self) -> Option<Self::Item> {
        let tile = self.tiles.next()?;
        let checked = tile.and_then(|tile| {
            self.order.add(&tile);
            match self.order.wrong.take() {
                None => Ok(tile),
                Some((_, place, message)) => Err(Error::format(place, message, "it as before")),
            }
        });
        Some(checked)
    }
}

/// Checks that tiles lie in the layer, in order, at their paths.
struct Order<'a> {
    layer: &'a Layer,
    tiling: Tiling,
    /// The number of the next tile, and the place of the one before, y first.
    next: u64,
    before: Option<[u32; 2]>,
    /// The first fault, and where it is.
    wrong: Option<(Code, String, String)>,
}

impl<'a> Order<'a> {
    fn new(layer: &'a Layer, tiling: Tiling) -> Self {
        Order {
            layer,
            tiling,
            next: 0,
            before: None,
            wrong: None,
        }
    }

    /// Takes the next tile.
    fn add(&mut self, tile: &TileEntry) {
        let i = self.next;
        self.next += 1;
        if self.wrong.is_none() {
            self.wrong = self.check(tile).map(|(code, member, message)| {
                let place = format!("{}#/tiles/{i}/{member}", self.layer.path);
                (code, place, message)
            });
        }
    }

    fn check(&mut self, tile: &TileEntry) -> Option<(Code, &'static str, String)> {
        let [nx, ny, _] = self.tiling.tiles();
        let [x, y, z] = tile.grid;
        let after = self
            .before
            .replace([y, x])
            .is_none_or(|before| before < [y, x]);
        if x >= nx || y >= ny || z != self.layer.z || !after {
            let message = format!(
                "found {:?}, expected a macrocube of layer {} inside the grid, by rising y, then x",
                tile.grid, self.layer.z
            );
            return Some((Code::ShardValue, "grid", message));
        }
        let named = format!("tiles/{}/{}", tile_dir(z), tile_name(tile.grid));
        // a path that leads outside is reported as that when the tile is read
        let outside = tile.path.starts_with('/') || tile.path.split('/').any(|p| p == "..");
        let message = || format!("found {}, expected {named}", tile.path);
        (tile.path != named && !outside).then(|| (Code::PathName, "path", message()))
    }
}
