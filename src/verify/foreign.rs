//! Files in the directory of a tile set that do not belong there.

use super::code::Code;
use super::index::{MANIFEST, shard_path, tile_dir, tile_name};
use super::report::{Issue, Issues, Severity};
use crate::error::{Error, Result};
use crate::lod::moving_in;
use crate::manifest::{LEGEND, LEGEND_SVG, Manifest, PARTIAL};
use crate::store::{self, Entry};
use std::collections::BTreeMap;
use std::path::Path;

/// Looks for files that the manifest does not name; those of a layer follow with its shard. A conversion that has been
/// interrupted is none of this set.
///
/// # Errors
/// [`Error::Io`] if a directory cannot be listed.
pub(super) fn foreign_files(root: &Path, manifest: &Manifest, issues: &mut Issues) -> Result<()> {
    let selection = manifest.selection.as_ref();
    let painted = selection.is_some_and(|s| s.colour_by.is_some());
    let tables = ["cells.csv", "objects.csv", "surfaces.csv"];
    let of_parts = ["components.csv", "necks.csv"];
    let has_parquet = manifest.tables.parquet.is_some();
    // levels that take the place of others are moved in while the index names none
    let has_levels = manifest.lod.is_some() || moving_in(root);
    let top = |name: &str| {
        let as_csv = name.strip_suffix(".parquet").filter(|_| has_parquet);
        let csv = as_csv.map_or(name.to_owned(), |stem| format!("{stem}.csv"));
        let csv = csv.as_str();
        [MANIFEST, "index", "tiles", PARTIAL].contains(&name)
            || (has_levels && ["lod", "tileset.json"].contains(&name))
            || tables.contains(&csv)
            || (manifest.cells.is_some() && of_parts.contains(&csv))
            || (manifest.tables.walls.is_some() && csv == "walls.csv")
            || (painted && [LEGEND, LEGEND_SVG].contains(&name))
    };
    foreign(root, "", top, issues)?;
    let has = |z: &u32| manifest.layers.binary_search_by_key(z, |l| l.z).is_ok();
    let layer = |name: &str| name.strip_prefix('z')?.parse().ok().filter(has);
    let shard = |name: &str| {
        let z = name.strip_suffix(".json").and_then(layer);
        z.is_some_and(|z| shard_path(z).strip_prefix("index/") == Some(name))
    };
    foreign(root, "index", shard, issues)?;
    let tiles = |name: &str| layer(name).is_some_and(|z| tile_dir(z) == name);
    foreign(root, "tiles", tiles, issues)
}

/// Looks for files in the directory of a layer's tiles that its shard does not name. `tiles` are those that it
/// does, by their places (y, x), which rise.
///
/// # Errors
/// [`Error::Io`] if the directory cannot be listed.
pub(super) fn foreign_tiles(
    root: &Path,
    z: u32,
    tiles: &[[u32; 2]],
    issues: &mut Issues,
) -> Result<()> {
    let named = |name: &str| {
        let place = name
            .strip_prefix('y')?
            .strip_suffix(".glb")?
            .split_once("_x")?;
        let [y, x] = [place.0.parse().ok()?, place.1.parse().ok()?];
        let has = tiles.binary_search(&[y, x]).is_ok();
        (has && tile_name([x, y, z]) == name).then_some(())
    };
    let dir = format!("tiles/{}", tile_dir(z));
    foreign(root, &dir, |name| named(name).is_some(), issues)
}

/// True for the names of files that systems write into folders of others by themselves.
fn is_of_system(name: &str) -> bool {
    const NAMES: [&str; 4] = [".DS_Store", "Thumbs.db", "desktop.ini", ".directory"];
    const BEGIN: [&str; 3] = [".nfs", ".fuse_hidden", "._"];
    NAMES.contains(&name) || BEGIN.iter().any(|begin| name.starts_with(begin))
}

/// Files of a directory that do not belong there.
enum Stray {
    /// A file that the index does not name.
    Foreign,
    /// A file that the system has written.
    System,
    /// A link to something in the tile set; those that lead outside are reported when they are followed.
    Link,
}

impl Stray {
    fn of(root: &Path, dir: &Path, entry: &Entry, is_known: bool) -> Option<Stray> {
        let inside = || {
            let real = dir.join(&entry.name).canonicalize();
            real.is_ok_and(|real| real.starts_with(root))
        };
        match is_known {
            true => (entry.is_link && inside()).then_some(Stray::Link),
            false if entry.is_file && is_of_system(&entry.name.to_string_lossy()) => {
                Some(Stray::System)
            }
            false => Some(Stray::Foreign),
        }
    }

    fn issue(&self, path: String) -> Issue {
        let issue = |message| Issue::new(Code::ForeignFile, path, message);
        match self {
            Stray::Foreign => issue("found, expected only what the index names"),
            Stray::Link => issue("found a link, expected the file or directory itself"),
            Stray::System => Issue {
                severity: Severity::Warning,
                ..issue("found a file that is named as those of the system are")
            },
        }
    }
}

/// Reports everything in the directory `path`, empty for the top, whose name is not `known`, or that is a link; a
/// missing directory holds nothing foreign.
///
/// # Errors
/// [`Error::Io`] if the directory is there but cannot be listed.
pub(super) fn foreign(
    root: &Path,
    path: &str,
    known: impl Fn(&str) -> bool,
    issues: &mut Issues,
) -> Result<()> {
    let dir = root.join(path);
    if dir.canonicalize().is_ok_and(|real| !real.starts_with(root)) {
        let message = "found a link to a folder outside the tile set";
        issues.add(Code::PathOutside, path, message);
        return Ok(());
    }
    let entries = match store::list(&dir) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Error::io(&dir, "list the directory", e)),
    };
    let mut found = BTreeMap::new();
    for entry in entries {
        let entry = entry.map_err(|e| Error::io(&dir, "list the directory", e))?;
        let name = entry.name.to_string_lossy().into_owned();
        if let Some(stray) = Stray::of(root, &dir, &entry, known(&name)) {
            found.insert(name, stray);
        }
    }
    for (name, stray) in found {
        let path = match path {
            "" => name,
            _ => format!("{path}/{name}"),
        };
        issues.push(stray.issue(path));
    }
    Ok(())
}
