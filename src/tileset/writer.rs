//! A tile set that is being made: the directories of its layers, its tiles, their entries in the index with the sums
//! of them, and the manifest at the end. Whoever makes a tile set, of a volume or of another set, writes it by this.

use crate::error::{Error, Result};
use crate::manifest::{
    COMPONENTS_PARQUET, LayerRecord, Manifest, NECKS_PARQUET, ShardWriter, Tables, TileEntry,
    Totals, WALLS_PARQUET,
};
use crate::sys::files::{remove_if_there, write_file};
use crate::sys::spill_file::SpillFile;
use crate::table::{Table, write_parquet};
use crate::tile::tile_path;
use std::path::{Path, PathBuf};

/// Path of the directory of a layer's tiles in a tile set.
pub fn layer_directory(z: u32) -> String {
    format!("tiles/z{z:04}")
}

/// Writes the file of a tile into the tile set in `dir`, where its layer has a directory.
///
/// # Errors
/// [`Error::Io`].
pub fn write_tile(dir: &Path, grid: [u32; 3], file: &[u8]) -> Result<()> {
    write_file(&dir.join(tile_path(grid)), &[file])
}

/// The sums with the Euler characteristic that follows from the others: vertices less edges plus triangles, where an
/// edge is of two triangles, or of one if it is on the border.
pub fn with_euler_characteristic(totals: Totals) -> Totals {
    let Totals {
        vertices,
        triangles,
        border_edges,
        ..
    } = totals;
    // tables from elsewhere may say anything
    let edges = triangles.saturating_mul(3).saturating_add(border_edges) / 2;
    let euler_characteristic = vertices.wrapping_sub(edges).wrapping_add(triangles) as i64;
    Totals {
        euler_characteristic,
        ..totals
    }
}

/// Writes a tile set into a directory, most often the work directory of an [`Output`](crate::tileset::Output), which
/// has `tiles` and `index`.
///
/// Files of tiles may be written in any order. Their entries come layer by layer, by rising z, and in a layer by y, then
/// x. Memory does not grow with the number of layers.
pub struct TilesetWriter {
    dir: PathBuf,
    /// The shard of the layer at hand, once that has a tile.
    shard: Option<ShardWriter>,
    /// The layers that have tiles.
    layers: SpillFile,
    /// Bytes of their shards.
    index_bytes: u64,
    written: Totals,
}

impl TilesetWriter {
    /// Of a tile set in `dir` that has no tile yet.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn new(dir: &Path) -> Result<Self> {
        Ok(TilesetWriter {
            dir: dir.to_path_buf(),
            shard: None,
            layers: SpillFile::new(dir)?,
            index_bytes: 0,
            written: Totals::default(),
        })
    }

    /// Where it writes.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Makes the directory of a layer, empty.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn make_layer_directory(&self, z: u32) -> Result<()> {
        let dir = self.dir.join(layer_directory(z));
        remove_if_there(&dir)?;
        std::fs::create_dir(&dir).map_err(|e| Error::io(&dir, "create the directory", e))
    }

    /// Adds a tile to the index, `text` as [`entry_text`](crate::manifest::entry_text) makes it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn add(&mut self, tile: &TileEntry, text: &[u8]) -> Result<()> {
        let shard = match &mut self.shard {
            Some(shard) => shard,
            None => {
                let [_, _, z] = tile.grid;
                self.shard.insert(ShardWriter::create(&self.dir, z)?)
            }
        };
        shard.write(tile, text)
    }

    /// Ends a layer, all tiles of which are added. One without tiles has no directory.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn end_layer(&mut self, z: u32) -> Result<()> {
        match self.shard.take() {
            None => remove_if_there(&self.dir.join(layer_directory(z))),
            Some(shard) => {
                let (layer, tiles) = shard.finish()?;
                self.add_layer(layer, &tiles)
            }
        }
    }

    /// Adds a layer whose shard is there already, and the sums of its tiles.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn add_layer(&mut self, layer: LayerRecord, tiles: &Totals) -> Result<()> {
        self.index_bytes += layer.bytes;
        let written = &mut self.written;
        for (sum, value) in [
            (&mut written.tiles, tiles.tiles),
            (&mut written.tile_vertices, tiles.tile_vertices),
            (&mut written.triangles, tiles.triangles),
            (&mut written.strips, tiles.strips),
            (&mut written.strip_indices, tiles.strip_indices),
            (&mut written.bytes, tiles.bytes),
        ] {
            // an index from elsewhere may say anything
            *sum = sum.saturating_add(value);
        }
        self.layers.push(&[layer]).map(|_| ())
    }

    /// The layers that have ended and have tiles.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn layer_records(&mut self) -> Result<Vec<LayerRecord>> {
        let all = self.layers.everything().expect("it holds nothing else");
        self.layers.get(&all)
    }

    /// Sums over the entries of all layers that have ended: tiles, vertices, triangles, strips and bytes.
    pub fn written(&self) -> Totals {
        self.written
    }

    /// Bytes of the shards.
    pub fn index_bytes(&self) -> u64 {
        self.index_bytes
    }

    /// Writes the manifest with all layers, and the tables as Parquet if it names such; those in CSV are there.
    /// Returns the bytes of what it has written.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(mut self, manifest: Manifest) -> Result<u64> {
        let parquet = match &manifest.tables.parquet {
            Some(_) => write_parquet_tables(&self.dir, &manifest.tables)?,
            None => 0,
        };
        let all = self.layers.everything().expect("it holds nothing else");
        let index = manifest.write_sealed_with(&self.dir, &mut |each| {
            let layers = &mut self.layers;
            layers.for_each(&all, |layer: LayerRecord| each(&layer.layer()))
        })?;
        Ok(parquet + index)
    }
}

/// Writes all tables as Parquet beside their CSV files; returns their bytes.
fn write_parquet_tables(dir: &Path, tables: &Tables) -> Result<u64> {
    let parts = tables.components.is_some();
    let mut bytes = 0;
    for table in Table::ALL {
        let [csv, parquet] = [table.file(), table.parquet_file()].map(|name| dir.join(name));
        let may_lack = parts && table != Table::Objects;
        bytes += write_parquet(&csv, &parquet, (table.name(), "id"), may_lack)?;
    }
    let more = [
        (&tables.components, COMPONENTS_PARQUET, ("components", "id")),
        (&tables.necks, NECKS_PARQUET, ("necks", "cell_a")),
        (&tables.walls, WALLS_PARQUET, ("walls", "cell_a")),
    ];
    for (csv, parquet, names) in more {
        if let Some(csv) = csv {
            bytes += write_parquet(&dir.join(csv), &dir.join(parquet), names, false)?;
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{Bounds, entry_text};

    fn tile(grid: [u32; 3], strips: u64) -> TileEntry {
        TileEntry {
            path: tile_path(grid),
            grid,
            bounds: Bounds {
                min: [0.0; 3],
                max: [1.0; 3],
            },
            vertices: 4,
            triangles: 2,
            strips,
            indices: 5,
            bytes: 100,
            checksum: String::new(),
            groups: Vec::new(),
        }
    }

    #[test]
    fn layers_have_directories_and_entries_if_they_have_tiles() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["tiles", "index"] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
        }
        let mut set = TilesetWriter::new(dir.path()).unwrap();
        // what an interrupted conversion left of a layer goes
        std::fs::create_dir(dir.path().join("tiles/z0000")).unwrap();
        write_tile(dir.path(), [7, 7, 0], b"old").unwrap();
        (0..3).for_each(|z| set.make_layer_directory(z).unwrap());
        for grid in [[0, 0, 0], [1, 0, 0], [0, 0, 2]] {
            write_tile(dir.path(), grid, b"tile").unwrap();
            let entry = tile(grid, u64::from(grid[0]));
            set.add(&entry, &entry_text(&entry)).unwrap();
            if grid == [1, 0, 0] {
                set.end_layer(0).unwrap();
                set.end_layer(1).unwrap();
            }
        }
        set.end_layer(2).unwrap();
        let there = |path: &str| dir.path().join(path).exists();
        assert!(!there(&tile_path([7, 7, 0])) && there(&tile_path([0, 0, 2])));
        for (z, has_tiles) in [(0, true), (1, false), (2, true)] {
            assert_eq!(there(&layer_directory(z)), has_tiles, "{z}");
            assert_eq!(there(&crate::manifest::shard_path(z)), has_tiles, "{z}");
        }
        let written = set.written();
        assert_eq!(
            (written.tiles, written.triangles, written.bytes),
            (3, 6, 300)
        );
        // entries of a tile's strips are index entries of strips
        assert_eq!((written.strips, written.strip_indices), (1, 5));
        let shards = [0, 2].map(|z| dir.path().join(crate::manifest::shard_path(z)));
        let bytes = shards.map(|path| path.metadata().unwrap().len());
        assert_eq!(set.index_bytes(), bytes.iter().sum::<u64>());
    }

    #[test]
    fn a_closed_cube_has_the_characteristic_of_a_sphere() {
        let totals = Totals {
            vertices: 8,
            triangles: 12,
            ..Totals::default()
        };
        assert_eq!(with_euler_characteristic(totals).euler_characteristic, 2);
        // two triangles side by side: five edges, four of them on the border
        let open = Totals {
            vertices: 4,
            triangles: 2,
            border_edges: 4,
            ..totals
        };
        assert_eq!(with_euler_characteristic(open).euler_characteristic, 1);
    }
}
