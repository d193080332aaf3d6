//! Reading an index for use: unlike the verifier, which reports all that is wrong, this stops at the
//! first thing that is.

use crate::error::{Error, Result};
use crate::grid::{Dims, LATTICE, Placement, check_filters};
use crate::manifest::{FORMAT, FORMAT_VERSION, Layer, Manifest, Shard, ShardTiles};
use crate::store::{File, is_remote};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

/// The manifest's name in the directory of a tile set.
pub const MANIFEST: &str = "index.json";
/// Name of the directory in it for what is not finished.
pub const PARTIAL: &str = ".alvis-partial";

/// The manifest's file in the directory of a tile set.
///
/// # Errors
/// As of [`file_inside`]; [`Error::Format`] if a conversion into the directory is not finished, or if a directory
/// above or below is the tile set.
pub fn manifest_file(dir: &Path, action: &'static str) -> Result<PathBuf> {
    file_inside(dir, MANIFEST, action).map_err(|error| {
        if dir.is_file() {
            let hint = match sets_beside(dir).as_slice() {
                [] => "`alvis convert` makes one of a volume".to_owned(),
                sets => format!("did you mean {}?", sets.join(" or ")),
            };
            return Error::format(dir, "a file", "the directory of a tile set").with_hint(&hint);
        }
        let missing =
            matches!(&error, Error::Io { source, .. } if source.kind() == ErrorKind::NotFound);
        if !missing || !dir.is_dir() {
            return error;
        }
        if dir.join(PARTIAL).is_dir() {
            let found = "a conversion that is not finished";
            return Error::format(dir, found, "a tile set")
                .with_hint(
                    "if `alvis convert` was interrupted, the same with --resume goes on with it; type other commands again",
                );
        }
        match sets_beside(dir).as_slice() {
            [] => error,
            sets => Error::format(dir, format!("no {MANIFEST}"), "a tile set")
                .with_hint(format!("did you mean {}?", sets.join(" or "))),
        }
    })
}

/// The tile sets one directory below `dir` or above it, by name: an index or a directory of tiles is easily taken
/// for the tile set.
fn sets_beside(dir: &Path) -> Vec<String> {
    const MOST: usize = 3;
    let below = std::fs::read_dir(dir).into_iter().flatten().flatten();
    let mut below: Vec<PathBuf> = below.map(|entry| dir.join(entry.file_name())).collect();
    below.sort();
    let above = dir.parent().filter(|p| !p.as_os_str().is_empty());
    let all = below.into_iter().chain(above.map(Path::to_path_buf));
    let sets = all.filter(|path| path.join(MANIFEST).is_file());
    sets.map(|path| path.display().to_string())
        .take(MOST)
        .collect()
}

impl Manifest {
    /// Reads the manifest of the tile set in `dir` and checks what its readers rely on: format,
    /// grid, lattice and placement.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::Format`] if it is not a manifest of this format.
    pub fn open(dir: &Path) -> Result<Manifest> {
        let path = dir.join(MANIFEST);
        let real = manifest_file(dir, "read the index")?;
        let Head {
            format,
            format_version: version,
        } = parse(&path, &real)?;
        if format != FORMAT || version != FORMAT_VERSION {
            return Err(Error::format(
                &path,
                format!("format {format} version {version}"),
                format!("\"{FORMAT}\" version {FORMAT_VERSION}"),
            ));
        }
        let manifest: Manifest = parse(&path, &real)?;
        manifest.check(&path)?;
        Ok(manifest)
    }

    fn check(&self, path: &Path) -> Result<()> {
        let grid = self.grid;
        let bad = |found: String, expected: &str| Err(Error::format(path, found, expected));
        if Dims::new(grid.dims.0.map(u64::from)).is_err() || grid.macrocube.contains(&0) {
            return bad(
                format!(
                    "a grid of {} with macrocubes {:?}",
                    grid.dims, grid.macrocube
                ),
                "2 to 65536 voxels and at least 1 cube per axis",
            );
        }
        if self.lattice != LATTICE {
            return bad(format!("lattice {}", self.lattice), "256");
        }
        let tiles = self.tiling().tiles();
        if self.layers.len() as u64 > u64::from(tiles[2])
            || !self.layers.windows(2).all(|w| w[0].z < w[1].z)
        {
            return bad(
                format!("{} layers", self.layers.len()),
                "layers by rising z inside the grid",
            );
        }
        if self.placement.shear().is_some() {
            let directions = format!("directions {:?}", self.placement.directions);
            return bad(directions, "axes at right angles");
        }
        if let Err(e) = check_filters(&self.filters) {
            return bad(e.to_string(), "filters that can be");
        }
        if let Some(unit) = self.table_unit
            && self.placement.in_unit(unit).is_err()
        {
            let found = format!("tables in {unit} of a grid in {}", self.placement.unit);
            return bad(found, "tables in a unit of length of a grid in one");
        }
        self.placement
            .check()
            .or_else(|e| bad(e.to_string(), "a placement that can be"))
    }

    /// The placement in the unit of tables and measures.
    pub fn measured(&self) -> Placement {
        let unit = self.table_unit.unwrap_or(self.placement.unit);
        // another unit has been checked where the manifest was opened
        self.placement.in_unit(unit).unwrap_or(self.placement)
    }

    /// Reads the shard of a layer of the tile set in `dir`, all of it: [`Manifest::shard_tiles`] takes less memory.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] if it is not the shard of that layer.
    pub fn shard(&self, dir: &Path, layer: &Layer) -> Result<Shard> {
        self.shard_tiles(dir, layer).and_then(Shard::collect)
    }

    /// The tiles in the shard of a layer of the tile set in `dir`, each read when it is asked for.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the shard lies outside. What is wrong with its text is an error among
    /// the tiles.
    pub fn shard_tiles(&self, dir: &Path, layer: &Layer) -> Result<ShardTiles> {
        let path = file_inside(dir, &layer.path, "read the shard")?;
        ShardTiles::open(path, layer.z)
    }
}

/// True for a relative path of plain names with `/` between them, which cannot lead outside by
/// itself, here or on another system: no empty part, no `.` or `..`, no `\`, `:` or NUL.
pub fn is_plain(relative: &str) -> bool {
    let strange = |part: &str| {
        part.is_empty() || part == "." || part == ".." || part.contains(['\\', ':', '\0'])
    };
    !relative.split('/').any(strange)
}

/// The file at a manifest's relative path. Links are not looked at: see [`file_inside`].
///
/// # Errors
/// [`Error::Format`] if the path is not [plain](is_plain).
pub fn inside(dir: &Path, relative: &str) -> Result<PathBuf> {
    if !is_plain(relative) {
        return Err(Error::format(
            dir.join(MANIFEST),
            format!("the path {relative:?}"),
            "a relative path inside the directory",
        ));
    }
    Ok(dir.join(relative))
}

/// The regular file at a manifest's relative path, with links resolved: it lies below `dir`, and
/// opening it does not wait, as opening a pipe may. `action` is for messages. In a bucket there are neither links nor
/// pipes: whether there is such an object is told when it is opened.
///
/// # Errors
/// [`Error::Format`] if the path is not [plain](is_plain), leads outside by a link, or is no regular
/// file; [`Error::Io`] if there is nothing.
pub fn file_inside(dir: &Path, relative: &str, action: &'static str) -> Result<PathBuf> {
    let path = inside(dir, relative)?;
    if is_remote(dir) {
        return Ok(path);
    }
    let failed = |e| Error::io(&path, action, e);
    let real = path.canonicalize().map_err(failed)?;
    let found = if !real.starts_with(dir.canonicalize().map_err(failed)?) {
        format!("a link to {}", real.display())
    } else if !real.metadata().map_err(failed)?.is_file() {
        "a folder, pipe or device".to_owned()
    } else {
        return Ok(real);
    };
    Err(Error::format(&path, found, "a file inside the tile set"))
}

/// What tells the format.
#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: serde_json::Value,
    #[serde(default)]
    format_version: serde_json::Value,
}

/// Parses the file at `real`, called `path` in messages, without its text in memory.
fn parse<T: DeserializeOwned>(path: &Path, real: &Path) -> Result<T> {
    let file = File::open(real).map_err(|e| Error::io(path, "read the index", e))?;
    serde_json::from_reader(BufReader::with_capacity(1 << 16, file)).map_err(|e| {
        match e.io_error_kind() {
            Some(_) => Error::io(path, "read the index", e.into()),
            None => Error::format(path, e.to_string(), "a tile set's index"),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_inside() {
        let dir = Path::new("set");
        assert_eq!(
            inside(dir, "tiles/z0/a.glb").unwrap(),
            Path::new("set/tiles/z0/a.glb")
        );
        for bad in [
            "",
            "/etc/passwd",
            "../x",
            "a/../../x",
            "a\\..\\b",
            "./x",
            "a//b",
            "c:x",
        ] {
            assert!(inside(dir, bad).is_err(), "{bad}");
        }
    }
}
