//! The manifest and its shards: read, and checked for what they say by themselves.

use super::closed::{self, Schema};
use super::code::Code;
use super::files::{self, Expected};
use super::report::Issues;
use crate::direct::Buffer;
use crate::error::{Error, Result};
use crate::grid::{Dims, LATTICE, Tiling};
use crate::manifest::{FORMAT, FORMAT_VERSION, Layer, Manifest, Shard, TileEntry};
use crate::manifest::{manifest_file, own_checksum};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;

/// The manifest's file.
pub(super) const MANIFEST: &str = "index.json";

/// Reads the manifest. `None` if it is damaged, which is an issue.
///
/// # Errors
/// [`Error::Io`] if the file is missing or cannot be read: then there is nothing to verify.
pub(super) fn manifest(root: &Path, issues: &mut Issues) -> Result<Option<Manifest>> {
    #[derive(Deserialize)]
    struct Head {
        format: Option<serde_json::Value>,
        format_version: Option<serde_json::Value>,
    }
    let path = manifest_file(root, "read the manifest")?;
    let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read the manifest", e))?;
    let syntax = |e: serde_json::Error, issues: &mut Issues| {
        issues.add(Code::ManifestSyntax, MANIFEST, e.to_string());
    };
    let head: Head = match serde_json::from_slice(&bytes) {
        Ok(head) => head,
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
    match serde_json::from_slice::<Manifest>(&bytes) {
        Ok(manifest) => {
            check_own(&manifest, &bytes, issues);
            check_members(&closed::MANIFEST, &bytes, MANIFEST, issues);
            Ok(check(&manifest, issues).then_some(manifest))
        }
        Err(e) => {
            syntax(e, issues);
            Ok(None)
        }
    }
}

/// Reports members that the format does not have.
fn check_members(schema: &Schema, json: &[u8], path: &str, issues: &mut Issues) {
    // what is no JSON has been reported
    for (pointer, message) in schema.walk(json).unwrap_or_default() {
        issues.add(Code::ForeignMember, format!("{path}#{pointer}"), message);
    }
}

/// Compares the manifest's checksum with what it states itself, if it does.
fn check_own(m: &Manifest, bytes: &[u8], issues: &mut Issues) {
    let Some(stated) = &m.checksum else {
        return;
    };
    let found = own_checksum(bytes, stated);
    if found != *stated {
        let message = format!(
            "found {found}, expected {stated} as it states: the file was changed (leave out the \
             member `checksum` if that was on purpose)"
        );
        issues.add(Code::Checksum, MANIFEST, message);
    }
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
    let grid = &m.grid;
    if Dims::new(grid.dims.0.map(u64::from)).is_err() || grid.macrocube.contains(&0) {
        let message = format!(
            "found {} voxels and macrocubes of {:?} cubes, expected 2 to 65536 voxels and at least 1 cube per axis",
            grid.dims, grid.macrocube
        );
        wrong("grid", message);
        return false;
    }
    let tiling = Tiling {
        dims: grid.dims,
        macrocube: grid.macrocube,
    };
    if tiling.tiles() != grid.tiles {
        let message = format!("found {:?}, expected {:?}", grid.tiles, tiling.tiles());
        wrong("grid/tiles", message);
    }
    if m.lattice != LATTICE {
        wrong(
            "lattice",
            format!("found {}, expected {LATTICE}", m.lattice),
        );
        return false;
    }
    if !m.threshold.is_finite() {
        wrong(
            "threshold",
            format!("found {}, expected a finite number", m.threshold),
        );
    }
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
    check_crop(m, &mut wrong);
    check_counts(m, &mut wrong);
    let rising = m.layers.windows(2).all(|w| w[0].z < w[1].z);
    if !rising
        || m.layers
            .iter()
            .any(|l| l.z >= tiling.tiles()[2] || l.tiles == 0)
    {
        let message = "expected layers with tiles by rising z inside the grid".to_owned();
        wrong("layers", message);
        return false;
    }
    true
}

fn check_crop(m: &Manifest, wrong: &mut impl FnMut(&str, String)) {
    let dims = match &m.source.crop {
        None => Ok(m.source.dims),
        Some(crop) => crop.dims_in(m.source.dims),
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
    let t = &m.totals;
    if let Some(of) = m.selection.as_ref().map(|s| s.of) {
        let all = [of.cells, of.objects, of.surfaces, of.voxels_above];
        let own = [t.cells, t.objects, t.surfaces, t.voxels_above];
        if own.iter().zip(all).any(|(own, all)| *own > all) {
            let message = format!("found {all:?} of the whole, and {own:?} of the part");
            wrong("selection/of", message);
        }
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
    if m.source.offset != 0 && m.source.format != "raw" {
        let message = format!("found {} for {}", m.source.offset, m.source.format);
        wrong("source/offset", message);
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

/// Looks for files that the manifest does not name; those of a layer follow with its shard.
///
/// # Errors
/// [`Error::Io`] if a directory cannot be listed.
pub(super) fn foreign_files(root: &Path, manifest: &Manifest, issues: &mut Issues) -> Result<()> {
    let names = |f: fn(u32) -> String| manifest.layers.iter().map(|l| f(l.z)).collect();
    let shards: BTreeSet<String> = names(|z| shard_path(z).replace("index/", ""));
    files::foreign(root, "index", &shards, issues)?;
    files::foreign(root, "tiles", &names(tile_dir), issues)
}

/// Reads the shard of layer number `index`; `None` if it is missing or damaged.
pub(super) fn shard(
    root: &Path,
    tiling: Tiling,
    (index, layer): (usize, &Layer),
    issues: &mut Issues,
) -> Option<Shard> {
    let at = format!("{MANIFEST}#/layers/{index}");
    let expected = Expected {
        path: &layer.path,
        bytes: layer.bytes,
        checksum: &layer.checksum,
        at: &at,
    };
    let mut bytes = Buffer::default();
    if !files::fetch(root, &expected, &mut bytes, issues) {
        return None;
    }
    files::compare(&expected, bytes.get(), issues);
    let named = shard_path(layer.z);
    if layer.path != named {
        let message = format!("found {}, expected {named}", layer.path);
        issues.add(Code::PathName, format!("{at}/path"), message);
        return None;
    }
    let shard: Shard = match serde_json::from_slice(bytes.get()) {
        Ok(shard) => shard,
        Err(e) => {
            issues.add(Code::ShardSyntax, &layer.path, e.to_string());
            return None;
        }
    };
    check_members(&closed::SHARD, bytes.get(), &layer.path, issues);
    if shard.z != layer.z || shard.tiles.len() as u64 != layer.tiles {
        let message = format!(
            "found z {} with {} tiles, expected z {} with {} tiles as in {at}",
            shard.z,
            shard.tiles.len(),
            layer.z,
            layer.tiles
        );
        issues.add(Code::ShardValue, &layer.path, message);
        return None;
    }
    check_order(&shard, tiling, &layer.path, issues).then_some(shard)
}

/// Checks that tiles lie in the layer, in order, at their paths.
fn check_order(shard: &Shard, tiling: Tiling, path: &str, issues: &mut Issues) -> bool {
    let place = |t: &TileEntry| (t.grid[1], t.grid[0]);
    let [nx, ny, _] = tiling.tiles();
    for (i, tile) in shard.tiles.iter().enumerate() {
        let [x, y, z] = tile.grid;
        let after = i == 0 || place(&shard.tiles[i - 1]) < place(tile);
        if x >= nx || y >= ny || z != shard.z || !after {
            let message = format!(
                "found {:?}, expected a macrocube of layer {} inside the grid, by rising y, then x",
                tile.grid, shard.z
            );
            issues.add(Code::ShardValue, format!("{path}#/tiles/{i}/grid"), message);
            return false;
        }
        let named = format!("tiles/{}/{}", tile_dir(z), tile_name(tile.grid));
        // a path that leads outside is reported as that when the tile is read
        let outside = tile.path.starts_with('/') || tile.path.split('/').any(|p| p == "..");
        if tile.path != named && !outside {
            let message = format!("found {}, expected {named}", tile.path);
            issues.add(Code::PathName, format!("{path}#/tiles/{i}/path"), message);
            return false;
        }
    }
    true
}
