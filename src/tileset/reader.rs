//! A tile set for its readers: the manifest, then shards and tiles one after another.

use crate::error::{Error, Result};
use crate::manifest::{Level, Levels, Manifest, NodeEntry, Shard, TileEntry};
use crate::manifest::{MANIFEST, checksum_of, checksum_text, file_inside, own_checksum};
use crate::store::File;
use crate::tile::{NodeMesh, TileMesh};
use std::path::{Path, PathBuf};

/// A directory of tiles, open for reading. Holds the manifest; shards and tiles are read when they
/// are asked for.
///
/// # Examples
/// ```no_run
/// let set = alvis::tileset::TileSet::open("foam")?;
/// println!("{} cells", set.manifest().totals.cells);
/// for entry in set.tiles() {
///     let entry = entry?;
///     let tile = set.read_tile(&entry)?;
///     println!("{}: {} pieces", entry.path, tile.pieces.len());
/// }
/// # Ok::<(), alvis::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TileSet {
    dir: PathBuf,
    manifest: Manifest,
}

impl TileSet {
    /// Opens the tile set in the directory `dir`.
    ///
    /// # Errors
    /// [`Error::Io`] if there is no readable `index.json`; [`Error::Format`] if it is not a manifest
    /// that this version reads.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref();
        Ok(TileSet {
            dir: dir.to_path_buf(),
            manifest: Manifest::open(dir)?,
        })
    }

    /// The directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The place of a file that the index names. All reading goes through here, so an index from
    /// elsewhere cannot make this program read other files.
    ///
    /// # Errors
    /// Those of [`file_inside`].
    pub fn path(&self, relative: &str) -> Result<PathBuf> {
        file_inside(&self.dir, relative, "open the file")
    }

    /// Refuses an index and tables that have changed since they were made: what is read of them has to be what checksums
    /// say. Where none are stated, none are compared.
    ///
    /// # Errors
    /// [`Error::Format`] for another checksum; those of [`TileSet::path`].
    pub fn check_tables(&self) -> Result<()> {
        let failed = |path: &Path, e| Error::io(path, "read the table", e);
        let same = |path: &Path, found: String, stated: &str| match found == stated {
            true => Ok(()),
            false => Err(Error::format(
                path,
                format!("the checksum {found}"),
                format!("{stated} as in the index: it has changed since it was made"),
            )),
        };
        if let Some(stated) = &self.manifest.checksum {
            let path = self.dir.join(MANIFEST);
            let file = File::open(&path).map_err(|e| failed(&path, e))?;
            let found = own_checksum(&file, stated).map_err(|e| failed(&path, e))?;
            same(&path, found, stated)?;
        }
        for (name, stated) in self.manifest.tables.sums() {
            let path = self.path(name)?;
            let file = File::open(&path).map_err(|e| failed(&path, e))?;
            same(
                &path,
                checksum_of(file).map_err(|e| failed(&path, e))?,
                stated,
            )?;
        }
        Ok(())
    }

    /// The shards by rising z, each read when it is asked for, all of it: [`TileSet::tiles`] takes less memory.
    ///
    /// # Errors
    /// An item is an error if its file is missing, lies outside or is damaged; the next may be sound.
    pub fn shards(&self) -> impl Iterator<Item = Result<Shard>> + '_ {
        let layers = self.manifest.layers.iter();
        layers.map(|layer| self.manifest.shard(&self.dir, layer))
    }

    /// The entries of all tiles, by rising z, then y, then x, each read when it is asked for.
    ///
    /// # Errors
    /// As [`TileSet::shards`]: one error for a shard that cannot be read to its end.
    pub fn tiles(&self) -> impl Iterator<Item = Result<TileEntry>> + '_ {
        self.manifest.layers.iter().flat_map(|layer| {
            let (tiles, error) = match self.manifest.shard_tiles(&self.dir, layer) {
                Ok(tiles) => (Some(tiles), None),
                Err(error) => (None, Some(Err(error))),
            };
            error.into_iter().chain(tiles.into_iter().flatten())
        })
    }

    /// The bytes of a tile's file, which must have the entry's size and checksum.
    ///
    /// # Errors
    /// As [`TileSet::path`]; [`Error::Format`] for another size or checksum.
    pub fn tile_bytes(&self, entry: &TileEntry) -> Result<Vec<u8>> {
        self.checked_bytes(&entry.path, entry.bytes, &entry.checksum)
    }

    /// The bytes of a file at a path of the index, which must have this size and checksum.
    ///
    /// # Errors
    /// As of [`TileSet::tile_bytes`].
    pub(crate) fn checked_bytes(&self, path: &str, bytes: u64, checksum: &str) -> Result<Vec<u8>> {
        let stated = Stated {
            path,
            bytes,
            checksum,
        };
        stated.read(&self.dir)
    }

    /// The levels of detail over the tiles, if there are any.
    ///
    /// # Errors
    /// Those of [`Levels::open`].
    pub fn levels(&self) -> Result<Option<Levels>> {
        Levels::open(&self.dir, &self.manifest)
    }

    /// The nodes of a level from 1 on, by rising z, then y, then x; a layer of them at a time is in memory.
    ///
    /// # Errors
    /// An item is an error if a list of nodes is missing, lies outside or is damaged.
    pub fn nodes<'a>(&'a self, level: &'a Level) -> impl Iterator<Item = Result<NodeEntry>> + 'a {
        Levels::nodes(&self.dir, level)
    }

    /// The bytes of a node's file, which must have the entry's size and checksum.
    ///
    /// # Errors
    /// As [`TileSet::tile_bytes`].
    pub fn node_bytes(&self, entry: &NodeEntry) -> Result<Vec<u8>> {
        self.checked_bytes(&entry.path, entry.bytes, &entry.checksum)
    }

    /// Reads a node of a level.
    ///
    /// # Errors
    /// As [`TileSet::node_bytes`]; [`Error::Format`] if the file is no node.
    pub fn read_node(&self, entry: &NodeEntry) -> Result<NodeMesh> {
        let bytes = self.node_bytes(entry)?;
        NodeMesh::read(&bytes)
            .map_err(|e| Error::format(self.dir.join(&entry.path), e.to_string(), "a node"))
    }

    /// Reads a tile.
    ///
    /// # Errors
    /// As [`TileSet::tile_bytes`]; [`Error::Format`] if the file is not a tile.
    pub fn read_tile(&self, entry: &TileEntry) -> Result<TileMesh> {
        let bytes = self.tile_bytes(entry)?;
        TileMesh::read(&bytes)
            .map_err(|e| Error::format(self.dir.join(&entry.path), e.to_string(), "a tile"))
    }
}

/// A file as an index states it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stated<'a> {
    /// Below the directory of the set.
    pub path: &'a str,
    pub bytes: u64,
    pub checksum: &'a str,
}

impl Stated<'_> {
    /// The bytes of the file below `dir`, which must have this size and checksum.
    ///
    /// # Errors
    /// Those of [`file_inside`]; [`Error::Format`] for another size or checksum.
    pub fn read(&self, dir: &Path) -> Result<Vec<u8>> {
        let path = file_inside(dir, self.path, "open the file")?;
        let file = File::open(&path).map_err(|e| Error::io(&path, "open the tile", e))?;
        let failed = |e| Error::io(&path, "read the tile", e);
        let len = file.len().map_err(failed)?;
        // before reading: a wrong file may be of any size
        if len != self.bytes {
            return Err(Error::format(
                &path,
                format!("{len} bytes"),
                format!("a file of {} bytes as in the index", self.bytes),
            ));
        }
        let mut bytes = vec![0; len as usize];
        file.read_exact_at(&mut bytes, 0).map_err(failed)?;
        let found = checksum_text(crc32fast::hash(&bytes));
        if found != self.checksum {
            let expected = format!("{} as in the index", self.checksum);
            return Err(Error::format(
                &path,
                format!("the checksum {found}"),
                expected,
            ));
        }
        Ok(bytes)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::convert::{ConvertOptions, convert};
    use crate::grid::Dims;
    use crate::phantom::{Phantom, Shape, render};
    use crate::progress::Quiet;
    use crate::volume::Dtype;

    /// A ball of several tiles.
    pub fn ball() -> (tempfile::TempDir, TileSet) {
        let dir = tempfile::tempdir().unwrap();
        let ball = Phantom::new(Shape::Sphere { radius: 9.0 });
        let volume = render(&ball, Dims::new([24; 3]).unwrap(), Dtype::U8).unwrap();
        let options = ConvertOptions {
            threshold: volume.threshold(),
            macrocube: [8; 3],
            ..ConvertOptions::default()
        };
        convert(&volume, &options, &dir.path().join("set"), &Quiet).unwrap();
        let set = TileSet::open(dir.path().join("set")).unwrap();
        (dir, set)
    }

    #[test]
    fn all_tiles_are_handed_out_in_order() {
        let (_dir, set) = ball();
        let tiles: Vec<TileEntry> = set.tiles().collect::<Result<_>>().unwrap();
        let totals = set.manifest().totals;
        assert_eq!(tiles.len() as u64, totals.tiles);
        assert!(tiles.is_sorted_by_key(|t| (t.grid[2], t.grid[1], t.grid[0])));
        let mut triangles = 0;
        for entry in &tiles {
            let tile = set.read_tile(entry).unwrap();
            assert_eq!(tile.matrix, set.manifest().transform);
            triangles += tile
                .pieces
                .iter()
                .map(|p| p.triangles.len() as u64)
                .sum::<u64>();
        }
        assert_eq!(triangles, totals.triangles);
    }

    #[test]
    fn nothing_outside_is_read() {
        let (dir, set) = ball();
        std::fs::write(dir.path().join("secret"), "x").unwrap();
        for bad in [
            "",
            "../secret",
            "/etc/hosts",
            "tiles/../../secret",
            "a\\b",
            "C:x",
            "a//b",
        ] {
            let error = set.path(bad).unwrap_err();
            assert!(matches!(error, Error::Format { .. }), "{bad}: {error}");
        }
        assert!(matches!(set.path("nothing"), Err(Error::Io { .. })));
        assert!(set.path("index.json").is_ok());
        #[cfg(unix)]
        {
            let link = set.dir().join("link");
            std::os::unix::fs::symlink(dir.path().join("secret"), &link).unwrap();
            let error = set.path("link").unwrap_err();
            assert!(error.to_string().contains("a link to"), "{error}");
        }
    }

    #[test]
    fn damage_is_an_error_and_the_rest_is_still_read() {
        let (_dir, set) = ball();
        let entries: Vec<TileEntry> = set.tiles().collect::<Result<_>>().unwrap();
        let path = set.dir().join(&entries[0].path);
        let mut bytes = std::fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let error = set.read_tile(&entries[0]).unwrap_err().to_string();
        assert!(error.contains("crc32:"), "{error}");
        bytes.pop();
        std::fs::write(&path, &bytes).unwrap();
        let error = set.read_tile(&entries[0]).unwrap_err().to_string();
        assert!(error.contains("bytes"), "{error}");
        std::fs::write(set.dir().join(&set.manifest().layers[0].path), "{").unwrap();
        let (good, bad): (Vec<_>, Vec<_>) = set.tiles().partition(|t| t.is_ok());
        let first = entries.iter().filter(|t| t.grid[2] == 0).count();
        assert_eq!((good.len(), bad.len()), (entries.len() - first, 1));
    }
}
