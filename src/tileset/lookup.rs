//! Tiles by their numbers, for programs that are asked for one after the other.

use crate::error::{Error, Result};
use crate::manifest::{MANIFEST, TileEntry, checksum_text};
use crate::tile::tile_path;
use crate::tileset::TileSet;
use rayon::prelude::*;
use std::collections::HashMap;

/// What is kept of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KnownTile {
    /// Its macrocube.
    pub grid: [u32; 3],
    /// CRC-32 of its file.
    crc: u32,
    /// Surface pieces.
    pub pieces: u32,
    /// Bytes of its file.
    pub bytes: u64,
    /// Vertices in it.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Index entries in the file.
    pub indices: u64,
}

/// The tiles of a set, in 64 bytes each.
#[derive(Debug, Clone, Default)]
pub struct TileLookup {
    /// By z, then y, then x.
    tiles: Vec<KnownTile>,
    /// Paths that are not the usual ones, by macrocube.
    other_paths: HashMap<[u32; 3], String>,
}

impl TileLookup {
    /// Reads all shards of a tile set.
    ///
    /// # Errors
    /// Those of [`TileSet::tiles`]; [`Error::Format`] for a tile outside of the grid, or one that is there twice.
    pub fn read(set: &TileSet) -> Result<Self> {
        let most = set.manifest().tiling().tiles();
        let mut lookup = TileLookup::default();
        // a shard may be long, and most of it is not kept
        let layers = set.manifest().layers.par_iter();
        let layers = layers.map(|layer| -> Result<Vec<_>> {
            let tiles = set.manifest().shard_tiles(set.dir(), layer)?;
            tiles.map(|entry| known(set, most, &entry?)).collect()
        });
        for (tile, other) in layers.collect::<Result<Vec<_>>>()?.into_iter().flatten() {
            lookup.tiles.push(tile);
            lookup
                .other_paths
                .extend(other.map(|path| (tile.grid, path)));
        }
        lookup.tiles.sort_unstable_by_key(|tile| key(tile.grid));
        match lookup
            .tiles
            .windows(2)
            .find(|two| two[0].grid == two[1].grid)
        {
            None => Ok(lookup),
            Some(two) => {
                let found = format!("the tile {:?} twice", two[0].grid);
                Err(Error::format(
                    set.dir().join(MANIFEST),
                    found,
                    "each tile once",
                ))
            }
        }
    }

    /// The tiles, by z, then y, then x.
    pub fn tiles(&self) -> &[KnownTile] {
        &self.tiles
    }

    /// The tile of a macrocube.
    pub fn get(&self, grid: [u32; 3]) -> Option<&KnownTile> {
        let at = self.tiles.binary_search_by_key(&key(grid), |t| key(t.grid));
        at.ok().map(|at| &self.tiles[at])
    }

    /// The path of a tile as the index has it.
    pub fn path(&self, tile: &KnownTile) -> String {
        let other = self.other_paths.get(&tile.grid);
        other.cloned().unwrap_or_else(|| tile_path(tile.grid))
    }

    /// The tile whose path in the index is just this text.
    pub fn by_path(&self, path: &str) -> Option<&KnownTile> {
        let named = numbers(path).and_then(|grid| self.get(grid));
        let of = |tile: &&KnownTile| self.path(tile) == path;
        named.filter(of).or_else(|| {
            let mut others = self.other_paths.iter();
            let (grid, _) = others.find(|(_, other)| *other == path)?;
            self.get(*grid)
        })
    }
}

impl KnownTile {
    fn of(set: &TileSet, entry: &TileEntry) -> Result<Self> {
        let digits = entry.checksum.strip_prefix("crc32:");
        let crc = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        let Some(crc) = crc.filter(|&crc| checksum_text(crc) == entry.checksum) else {
            let found = format!("the checksum {:?} of {}", entry.checksum, entry.path);
            let expected = "crc32: and 8 hexadecimal digits";
            return Err(Error::format(set.dir().join(MANIFEST), found, expected));
        };
        Ok(KnownTile {
            grid: entry.grid,
            crc,
            pieces: u32::try_from(entry.groups.len()).unwrap_or(u32::MAX),
            bytes: entry.bytes,
            vertices: entry.vertices,
            triangles: entry.triangles,
            indices: entry.indices,
        })
    }

    /// As the index has it.
    pub fn checksum(&self) -> String {
        checksum_text(self.crc)
    }
}

/// A tile of a grid of so many macrocubes, and its path if that is not the usual one.
fn known(set: &TileSet, most: [u32; 3], entry: &TileEntry) -> Result<(KnownTile, Option<String>)> {
    if (0..3).any(|a| entry.grid[a] >= most[a]) {
        let found = format!("a tile {:?} in {}", entry.grid, entry.path);
        let expected = format!("tiles of a grid of {most:?}");
        return Err(Error::format(set.dir().join(MANIFEST), found, expected));
    }
    let is_other = entry.path != tile_path(entry.grid);
    let tile = KnownTile::of(set, entry)?;
    Ok((tile, is_other.then(|| entry.path.clone())))
}

fn key([x, y, z]: [u32; 3]) -> [u32; 3] {
    [z, y, x]
}

/// The macrocube that a usual path names.
fn numbers(path: &str) -> Option<[u32; 3]> {
    let rest = path.strip_prefix("tiles/z")?.strip_suffix(".glb")?;
    let (z, rest) = rest.split_once("/y")?;
    let (y, x) = rest.split_once("_x")?;
    Some([x.parse().ok()?, y.parse().ok()?, z.parse().ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tileset::reader::tests::ball;

    #[test]
    fn tiles_are_found_by_numbers_and_by_path_alone() {
        let (_dir, set) = ball();
        let lookup = TileLookup::read(&set).unwrap();
        let entries: Vec<TileEntry> = set.tiles().collect::<Result<_>>().unwrap();
        assert_eq!(lookup.tiles().len(), entries.len());
        for entry in &entries {
            let tile = lookup.get(entry.grid).unwrap();
            assert_eq!(lookup.path(tile), entry.path);
            assert_eq!(lookup.by_path(&entry.path), Some(tile));
            let path = lookup.path(tile);
            assert_eq!(
                set.checked_bytes(&path, tile.bytes, &tile.checksum())
                    .unwrap(),
                set.tile_bytes(entry).unwrap()
            );
            assert_eq!(tile.pieces as usize, entry.groups.len());
        }
        assert_eq!(lookup.get([9, 0, 0]), None);
        for other in [
            "",
            "tiles/z0/y0_x0.glb",
            "tiles/z0000/y+000_x0000.glb",
            "../tiles/z0000/y0000_x0000.glb",
        ] {
            assert_eq!(lookup.by_path(other), None, "{other}");
        }
    }
}
