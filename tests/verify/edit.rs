//! Changing a tile set on disk, whoever wrote it: one thing is broken, the rest is made to agree.

use crate::glb::{self, Piece, Tile, crc32, read_json, write_json};
use crate::writer::write_tile;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A tile set that is being changed.
pub struct Set<'a>(pub &'a Path);

/// Where a tile's entry is: the shard's file and its place in it.
pub type Place = (PathBuf, usize);

impl Set<'_> {
    pub fn manifest(&self, edit: impl FnOnce(&mut Value)) {
        let path = self.0.join("index.json");
        let mut value = read_json(&path);
        edit(&mut value);
        write_json(&path, &value);
        self.seal();
    }

    /// Makes the manifest's checksums of the tables, and of itself, agree.
    pub fn seal(&self) {
        crate::seal::seal(self.0);
    }

    /// The places of all tiles.
    pub fn places(&self) -> Vec<Place> {
        let manifest = read_json(&self.0.join("index.json"));
        let mut out = Vec::new();
        for layer in manifest["layers"].as_array().unwrap() {
            let path = self.0.join(layer["path"].as_str().unwrap());
            let n = read_json(&path)["tiles"].as_array().unwrap().len();
            out.extend((0..n).map(|i| (path.clone(), i)));
        }
        out
    }

    pub fn entry(&self, place: &Place) -> Value {
        read_json(&place.0)["tiles"][place.1].clone()
    }

    pub fn file(&self, place: &Place) -> PathBuf {
        self.0.join(self.entry(place)["path"].as_str().unwrap())
    }

    pub fn tile(&self, place: &Place) -> Tile {
        Tile::decode(&fs::read(self.file(place)).unwrap())
    }

    /// Changes an entry, and nothing but the shard's checksum follows.
    pub fn edit_entry(&self, place: &Place, edit: impl FnOnce(&mut Value)) {
        let mut shard = read_json(&place.0);
        edit(&mut shard["tiles"][place.1]);
        write_json(&place.0, &shard);
        self.stamp();
    }

    /// Writes a tile anew and makes entry, shard and totals agree with it.
    pub fn put(&self, place: &Place, tile: &Tile) {
        let grid = self.entry(place)["grid"].clone();
        let at = |a: usize| grid[a].as_u64().unwrap() as usize;
        let mut tile = tile.clone();
        for piece in &mut tile.pieces {
            piece.extras["triangles"] = piece.triangles.len().into();
        }
        let entry = write_tile(self.0, [at(0), at(1), at(2)], &tile);
        self.edit_entry(place, |e| *e = entry);
        self.sum_up();
    }

    pub fn edit_tile(&self, place: &Place, edit: impl FnOnce(&mut Tile)) {
        let mut tile = self.tile(place);
        edit(&mut tile);
        self.put(place, &tile);
    }

    /// Changes a tile's JSON, and makes size and checksum agree.
    pub fn edit_json(&self, place: &Place, edit: impl FnOnce(&mut Value)) {
        let path = self.file(place);
        let (mut json, bin) = glb::unwrap(&fs::read(&path).unwrap());
        edit(&mut json);
        self.put_bytes(place, &glb::wrap(&json, &bin));
    }

    /// Replaces a tile's file, and makes size and checksum agree.
    pub fn put_bytes(&self, place: &Place, bytes: &[u8]) {
        fs::write(self.file(place), bytes).unwrap();
        self.edit_entry(place, |e| {
            e["bytes"] = bytes.len().into();
            e["checksum"] = crc32(bytes).into();
        });
        self.sum_up();
    }

    /// Takes a tile out of its shard and deletes its file.
    pub fn drop_tile(&self, place: &Place) {
        fs::remove_file(self.file(place)).unwrap();
        let mut shard = read_json(&place.0);
        shard["tiles"].as_array_mut().unwrap().remove(place.1);
        write_json(&place.0, &shard);
        self.stamp();
        self.sum_up();
    }

    /// Makes the manifest's layers agree with the shards.
    pub fn stamp(&self) {
        self.manifest(|m| {
            for layer in m["layers"].as_array_mut().unwrap() {
                let bytes = fs::read(self.0.join(layer["path"].as_str().unwrap())).unwrap();
                layer["bytes"] = bytes.len().into();
                layer["checksum"] = crc32(&bytes).into();
                if let Ok(shard) = serde_json::from_slice::<Value>(&bytes) {
                    layer["tiles"] = shard["tiles"].as_array().map_or(0, Vec::len).into();
                }
            }
        });
    }

    /// Makes the manifest's sums over entries agree with the entries.
    fn sum_up(&self) {
        let entries: Vec<Value> = self.places().iter().map(|p| self.entry(p)).collect();
        let sum = |key: &str| {
            entries
                .iter()
                .map(|e| e[key].as_u64().unwrap())
                .sum::<u64>()
        };
        self.manifest(|m| {
            let strips = m["primitives"] == "strips";
            let t = &mut m["totals"];
            t["tiles"] = entries.len().into();
            t["triangles"] = sum("triangles").into();
            t["tile_vertices"] = sum("vertices").into();
            t["strips"] = sum("strips").into();
            t["strip_indices"] = if strips { sum("indices") } else { 0 }.into();
            t["bytes"] = sum("bytes").into();
        });
    }

    /// The surfaces as (surface, cell, object), and in how many tiles each is.
    pub fn surfaces(&self) -> BTreeMap<[u64; 3], usize> {
        let mut out = BTreeMap::new();
        for place in self.places() {
            for group in self.entry(&place)["groups"].as_array().unwrap() {
                let ids = ["surface", "cell", "object"].map(|k| group[k].as_u64().unwrap());
                if ids[1] > 0 {
                    *out.entry(ids).or_insert(0) += 1;
                }
            }
        }
        out
    }

    /// Exchanges the numbers of two surfaces, in tiles and the table.
    pub fn exchange_surfaces(&self, one: [u64; 3], other: [u64; 3]) {
        for place in self.places() {
            self.edit_tile(&place, |tile| {
                for piece in &mut tile.pieces {
                    let own = ids(piece);
                    let to = [(one, other), (other, one)]
                        .into_iter()
                        .find(|(from, _)| *from == own);
                    if let Some((_, to)) = to {
                        piece.extras["surface"] = to[0].into();
                    }
                }
            });
        }
        let path = self.0.join("surfaces.csv");
        let text = fs::read_to_string(&path).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let [a, b] = [one, other].map(|ids| ids[0] as usize);
        lines.swap(a, b);
        for (line, id) in [(a, a), (b, b)] {
            let rest = lines[line].split_once(',').unwrap().1.to_owned();
            lines[line] = format!("{id},{rest}");
        }
        fs::write(path, lines.join("\n") + "\n").unwrap();
        self.seal();
    }

    /// Gives a surface other ids everywhere, and nodes the names that follow.
    pub fn relabel(&self, from: [u64; 3], to: [u64; 3]) {
        let mut pairs: BTreeSet<[u64; 3]> = self.surfaces().into_keys().collect();
        pairs.remove(&from);
        pairs.insert(to);
        for place in self.places() {
            self.edit_tile(&place, |tile| {
                for piece in tile.pieces.iter_mut().filter(|p| ids(p)[1] > 0) {
                    let new = if ids(piece) == from { to } else { ids(piece) };
                    let cells = pairs.iter().filter(|p| p[1] == new[1]);
                    let objects: BTreeSet<u64> = cells.map(|p| p[2]).collect();
                    for (key, id) in ["surface", "cell", "object"].iter().zip(new) {
                        piece.extras[key] = id.into();
                    }
                    piece.name = if objects.len() > 1 {
                        format!("cell_{}_object_{}", new[1], new[2])
                    } else {
                        format!("cell_{}", new[1])
                    };
                }
            });
        }
    }
}

/// A piece's (surface, cell, object).
pub fn ids(piece: &Piece) -> [u64; 3] {
    ["surface", "cell", "object"].map(|k| piece.extras[k].as_u64().unwrap())
}
