//! A small tile set on disk, of which a fuzz target replaces one file before all readers look at it.

use alvis::grid::Dims;
use alvis::manifest::Form;
use alvis::tileset::TileSet;
use alvis::phantom::{Phantom, Shape, render};
use alvis::convert::{ConvertOptions, convert};
use alvis::progress::Quiet;
use alvis::table::Table;
use alvis::tile::TileMesh;
use alvis::verify::{VerifyOptions, verify};
use alvis::volume::Dtype;
use serde_json::Value;
use std::path::PathBuf;

/// A tile set that lives as long as the process.
pub struct Set {
    _temporary: tempfile::TempDir,
    /// Its directory.
    pub dir: PathBuf,
    /// The manifest as written.
    pub manifest: Value,
    /// The shard of layer 0 as written.
    pub shard: Value,
    /// The path of a tile in layer 0.
    pub tile: String,
}

impl Set {
    /// Converts a small body in the given form.
    pub fn new(form: Form, cap: bool) -> Self {
        let temporary = tempfile::tempdir().expect("a temporary directory");
        let dir = temporary.path().join("set");
        let phantom = Phantom::new(Shape::Sphere { radius: 4.0 });
        let volume = render(&phantom, Dims::new([10, 9, 8]).unwrap(), Dtype::U8).unwrap();
        let options = ConvertOptions {
            threshold: volume.threshold(),
            // few tiles, since each input has all of them read
            macrocube: [6, 16, 4],
            cap,
            primitives: form.primitives,
            encoding: form.encoding,
            layout: form.layout,
            ..ConvertOptions::default()
        };
        convert(&volume, &options, &dir, &Quiet).expect("it converts");
        let json = |path: &str| -> Value {
            serde_json::from_slice(&std::fs::read(dir.join(path)).unwrap()).unwrap()
        };
        let (manifest, shard) = (json("index.json"), json("index/z0000.json"));
        let tile = shard["tiles"][0]["path"].as_str().unwrap().to_owned();
        Set { _temporary: temporary, dir, manifest, shard, tile }
    }

    /// Replaces the manifest.
    pub fn put_manifest(&self, bytes: &[u8]) {
        std::fs::write(self.dir.join("index.json"), bytes).unwrap();
    }

    /// Replaces the shard of layer 0 and brings size and checksum in the manifest up to date.
    pub fn put_shard(&self, bytes: &[u8]) {
        std::fs::write(self.dir.join("index/z0000.json"), bytes).unwrap();
        let mut manifest = self.manifest.clone();
        manifest.as_object_mut().unwrap().remove("checksum");
        manifest["layers"][0]["bytes"] = bytes.len().into();
        manifest["layers"][0]["checksum"] = checksum(bytes);
        self.put_manifest(&serde_json::to_vec(&manifest).unwrap());
    }

    /// Replaces the first tile and brings the shard up to date.
    pub fn put_tile(&self, bytes: &[u8]) {
        std::fs::write(self.dir.join(&self.tile), bytes).unwrap();
        let mut shard = self.shard.clone();
        shard["tiles"][0]["bytes"] = bytes.len().into();
        shard["tiles"][0]["checksum"] = checksum(bytes);
        self.put_shard(&serde_json::to_vec(&shard).unwrap());
    }

    /// The first tile as written.
    pub fn tile_bytes(&self) -> Vec<u8> {
        std::fs::read(self.dir.join(&self.tile)).unwrap()
    }

    /// Lets everything that reads tile sets read this one.
    pub fn read(&self) {
        let options = VerifyOptions { threads: 1, max_issues: 20, ..VerifyOptions::default() };
        let _ = verify(&self.dir, &options, &Quiet);
        let Ok(set) = TileSet::open(&self.dir) else { return };
        for entry in set.tiles().take(64).flatten() {
            let _ = set.read_tile(&entry);
        }
        for table in [Table::Cells, Table::Objects, Table::Surfaces] {
            if let Ok(mut table) = table.open(&self.dir, set.manifest()) {
                while let Ok(Some(_)) = table.next_row() {}
            }
        }
        let _ = alvis::view::TileIndex::read(&set);
    }
}

/// Reads the bytes of a tile by themselves, and then as the first of the set's if they are one; of
/// those that are none, one in sixteen, since few get far and it takes a hundred times as long.
pub fn read_tile(bytes: &[u8], set: &Set) {
    let mesh = TileMesh::read(bytes);
    let sound = mesh.is_ok();
    for piece in mesh.iter().flat_map(|m| &m.pieces) {
        assert_eq!(piece.positions.len(), piece.normals.len());
        for &t in &piece.triangles {
            let _ = piece.corners(t);
        }
    }
    if sound || crc32fast::hash(bytes).is_multiple_of(16) {
        set.put_tile(bytes);
        set.read();
    }
}

/// As the index states it.
pub fn checksum(bytes: &[u8]) -> Value {
    format!("crc32:{:08x}", crc32fast::hash(bytes)).into()
}

/// The forms that tiles come in, by a byte of the input.
pub fn forms() -> [Set; 4] {
    use alvis::manifest::{Encoding, Layout, Primitives};
    let form = |primitives, encoding, layout| Form { primitives, encoding, layout };
    [
        Set::new(form(Primitives::Strips, Encoding::Float, Layout::Auto), false),
        Set::new(form(Primitives::Triangles, Encoding::Quantized, Layout::Nodes), true),
        Set::new(form(Primitives::Strips, Encoding::Meshopt, Layout::Merged), false),
        Set::new(form(Primitives::Triangles, Encoding::Float, Layout::Merged), true),
    ]
}
