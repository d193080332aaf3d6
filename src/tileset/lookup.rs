//! Tiles by their numbers, for programs that are asked for one after the other.

use crate::error::{Error, Result};
use crate::grid::Tiling;
use crate::manifest::{Bounds, MANIFEST, TileEntry, checksum_text};
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
        let grid = set.manifest().grid;
        let most = Tiling {
            dims: grid.dims,
            macrocube: grid.macrocube,
        }
        .tiles();
        let mut lookup = TileLookup::default();
        // a shard may be long, and most of it is not kept
        let layers = set.manifest().layers.par_iter();
        let layers = layers.map(|layer| -> Result<Vec<_>> {
            let tiles = set.manifest().shard_tiles(set.dir(), layer)?;
            tiles.map(|entry| Ok(without_groups(entry?))).collect()
        });
        for (entry, pieces) in layers.collect::<Result<Vec<_>>>()?.into_iter().flatten() {
            if (0..3).any(|a| entry.grid[a] >= most[a]) {
                let found = format!("a tile {:?} in {}", entry.grid, entry.path);
                let expected = format!("tiles of a grid of {most:?}");
                return Err(Error::format(set.dir().join(MANIFEST), found, expected));
            }
            lookup.tiles.push(KnownTile::of(set, &entry, pieces)?);
            if entry.path != tile_path(entry.grid) {
                lookup.other_paths.insert(entry.grid, entry.path);
            }
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

    /// What [`TileSet::tile_bytes`] needs of a tile; the rest is empty.
    pub fn entry(&self, tile: &KnownTile) -> TileEntry {
        TileEntry {
            path: self.path(tile),
            grid: tile.grid,
            bounds: Bounds {
                min: [0.0; 3],
                max: [0.0; 3],
            },
            vertices: tile.vertices,
            triangles: tile.triangles,
            strips: 0,
            indices: tile.indices,
            bytes: tile.bytes,
            checksum: tile.checksum(),
            groups: Vec::new(),
        }
    }
}

impl KnownTile {
    fn of(set: &TileSet, entry: &TileEntry, pieces: usize) -> Result<Self> {
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
            pieces: u32::try_from(pieces).unwrap_or(u32::MAX),
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

/// A tile without its pieces, and their number.
fn without_groups(entry: TileEntry) -> (TileEntry, usize) {
    let pieces = entry.groups.len();
    let groups = Vec::new();
    (TileEntry { groups, ..entry }, pieces)
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
            let known = lookup.entry(tile);
            assert_eq!(
                set.tile_bytes(&known).unwrap(),
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
