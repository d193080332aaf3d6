//! The tree in 3D Tiles 1.1: `tileset.json`, and a tileset of its own for each node of every third level.
//!
//! Each node has one content, its file, and replaces its children's. Boxes are in metres, Z up, as viewers turn glTF.
//! `geometricError` is the error times the pixels that viewers take for sharp by default, over those that it may have.

use super::entry::Entry;
use crate::error::{Error, Result};
use crate::manifest::{Bounds, DEFAULT_PIXELS, Levels, NodeShard, TILESET, tileset_path};
use crate::sys::files::write_file;
use crate::tileset::TileSet;
use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Levels from one tileset to the next.
const TOGETHER: u32 = 3;
/// The least half of a side of a box in voxels: none is flat.
const THIN: f64 = 1e-3;

/// True if each node of a level has a tileset of its own, where there are so many levels above the tiles.
pub fn has_tileset(level: u32, top: u32) -> bool {
    (1..top).contains(&level) && level.is_multiple_of(TOGETHER)
}

/// The tree that is to be written.
pub struct Tree<'a> {
    pub set: &'a TileSet,
    pub levels: &'a Levels,
    /// Where levels lie and the tree is written to.
    pub work: &'a Path,
    /// Tells one state of the set from others.
    pub version: String,
}

/// Bytes of the tree in the directory of a tile set.
pub fn bytes(dir: &Path) -> u64 {
    let parts = std::fs::read_dir(dir.join("lod/tilesets"));
    let parts = parts.into_iter().flatten().flatten().map(|e| e.path());
    let files = parts.chain([dir.join(TILESET)]);
    files
        .filter_map(|path| Some(path.metadata().ok()?.len()))
        .sum()
}

/// A node by its level and its place there.
#[derive(Debug, Clone, Copy)]
struct At {
    level: u32,
    place: [u32; 3],
}

/// Entries of the layers that are needed at a time.
#[derive(Default)]
struct Layers(BTreeMap<(u32, u32), HashMap<[u32; 2], Entry>>);

impl Tree<'_> {
    /// Writes all files; returns their bytes.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if a shard of the tiles is damaged.
    pub fn write(&self) -> Result<u64> {
        let top = self.top();
        let dir = self.work.join("lod/tilesets");
        let mut bytes = 0;
        for level in (1..top).filter(|&level| has_tileset(level, top)) {
            std::fs::create_dir_all(&dir)
                .map_err(|e| Error::io(&dir, "create the directory", e))?;
            bytes += self.tilesets(level)?;
        }
        let mut layers = Layers::default();
        let roots = self.places(top, &mut layers)?;
        let document = self.root(top, roots, &mut layers)?;
        Ok(bytes + put(&self.work.join(TILESET), &document)?)
    }

    /// The coarsest level.
    fn top(&self) -> u32 {
        self.levels.levels.len() as u32
    }

    /// Writes the tileset of each node of a level.
    fn tilesets(&self, level: u32) -> Result<u64> {
        let mut bytes = 0;
        for layer in &self.levels.levels[level as usize - 1].layers {
            // those of one layer of nodes, and of the layers below it, are in memory
            let mut layers = Layers::default();
            let mut places: Vec<[u32; 2]> = self
                .layer(level, layer.z, &mut layers)?
                .keys()
                .copied()
                .collect();
            places.sort_unstable();
            for [y, x] in places {
                let at = At {
                    level,
                    place: [x, y, layer.z],
                };
                let root = self.tile(at, true, "../", &mut layers)?;
                let document = self.document(root, false);
                bytes += put(&self.work.join("lod").join(external(at)), &document)?;
            }
        }
        Ok(bytes)
    }

    /// The places of all nodes of a level.
    fn places(&self, level: u32, layers: &mut Layers) -> Result<Vec<[u32; 3]>> {
        let mut all = Vec::new();
        for layer in &self.levels.levels[level as usize - 1].layers {
            let nodes = self.layer(level, layer.z, layers)?;
            all.extend(nodes.keys().map(|[y, x]| [*x, *y, layer.z]));
        }
        all.sort_by_key(|[x, y, z]| [*z, *y, *x]);
        Ok(all)
    }

    /// `tileset.json`, whose root is the coarsest node; if there are several of its level it has them as children.
    fn root(&self, level: u32, places: Vec<[u32; 3]>, layers: &mut Layers) -> Result<Value> {
        let tiles = places.into_iter().map(|place| {
            let at = At { level, place };
            let tile = self.tile(at, true, "", layers)?;
            Ok((tile, self.entry(at, layers)?))
        });
        let mut tiles: Vec<(Value, Entry)> = tiles.collect::<Result<_>>()?;
        if let [(tile, _)] = &mut tiles[..] {
            return Ok(self.document(tile.take(), true));
        }
        let mut bounds = tiles[0].1.bounds;
        let mut error = 0.0f64;
        for (_, entry) in &tiles {
            for a in 0..3 {
                bounds.min[a] = bounds.min[a].min(entry.bounds.min[a]);
                bounds.max[a] = bounds.max[a].max(entry.bounds.max[a]);
            }
            error = error.max(entry.error);
        }
        let children: Vec<Value> = tiles.into_iter().map(|(tile, _)| tile).collect();
        let root = json!({
            "boundingVolume": {"box": self.volume(&bounds)},
            "geometricError": self.geometric_error(2.0 * error),
            "children": children
        });
        Ok(self.document(root, true))
    }

    /// A tileset with this root.
    fn document(&self, mut root: Value, is_whole: bool) -> Value {
        root["refine"] = "REPLACE".into();
        let volume: Vec<f64> =
            serde_json::from_value(root["boundingVolume"]["box"].clone()).expect("twelve numbers");
        let diagonal = 2.0 * volume[3..].iter().map(|v| v * v).sum::<f64>().sqrt();
        let own = root["geometricError"].as_f64().unwrap_or(0.0);
        let mut document = json!({
            "asset": {"version": "1.1", "tilesetVersion": self.version},
            // a viewer shows nothing of a tileset whose error is small on the screen
            "geometricError": diagonal.max(1.0001 * own),
            "root": root
        });
        if is_whole {
            let manifest = self.set.manifest();
            document["extras"] = json!({"alvis": {
                "unit": manifest.placement.unit,
                "voxel_metres": self.voxel(),
                "pixel_error": self.levels.pixel_error,
                "error_scale": DEFAULT_PIXELS / self.levels.pixel_error
            }});
        }
        document
    }

    /// A node with all below it, up to those that have a tileset of their own unless it is the root of one. `up` leads
    /// from the tileset's directory to that of the levels' parent.
    fn tile(&self, at: At, is_root: bool, up: &str, layers: &mut Layers) -> Result<Value> {
        let entry = self.entry(at, layers)?;
        let is_external = !is_root && has_tileset(at.level, self.top());
        // beside the tilesets in `lod/tilesets`, or below the root of the set
        let uri = match (up.is_empty(), is_external) {
            (true, true) => format!("lod/{}", external(at)),
            (true, false) => entry.path.clone(),
            (false, true) => external(at).replace("tilesets/", ""),
            (false, false) => match entry.path.strip_prefix("lod/") {
                Some(inside) => format!("{up}{inside}"),
                None => format!("{up}{up}{}", entry.path),
            },
        };
        let mut tile = json!({
            "boundingVolume": {"box": self.volume(&entry.bounds)},
            "geometricError": self.geometric_error(entry.error),
            "content": {"uri": uri}
        });
        if at.level == 0 || is_external {
            return Ok(tile);
        }
        let mut children = Vec::new();
        for child in 0..8u32 {
            let at = At {
                level: at.level - 1,
                place: [0, 1, 2].map(|a| 2 * at.place[a] + (child >> a & 1)),
            };
            let [x, y, z] = at.place;
            if self.layer(at.level, z, layers)?.contains_key(&[y, x]) {
                children.push(self.tile(at, false, up, layers)?);
            }
        }
        tile["children"] = children.into();
        Ok(tile)
    }

    fn entry(&self, at: At, layers: &mut Layers) -> Result<Entry> {
        let [x, y, z] = at.place;
        let layer = self.layer(at.level, z, layers)?;
        let found = layer.get(&[y, x]).cloned();
        found.ok_or_else(|| {
            let found = format!("no node {:?} of level {}", at.place, at.level);
            Error::format(self.work, found, "one that was found before")
        })
    }

    /// The entries of a layer by y and x; none if nothing lies there.
    fn layer<'l>(
        &self,
        level: u32,
        z: u32,
        layers: &'l mut Layers,
    ) -> Result<&'l HashMap<[u32; 2], Entry>> {
        let all = match layers.0.entry((level, z)) {
            std::collections::btree_map::Entry::Occupied(known) => return Ok(known.into_mut()),
            std::collections::btree_map::Entry::Vacant(new) => new,
        };
        let entries: Vec<Entry> = match level.checked_sub(1) {
            None => self.tiles(z)?,
            Some(i) => {
                let level = &self.levels.levels[i as usize];
                match level.layers.iter().find(|layer| layer.z == z) {
                    None => Vec::new(),
                    Some(layer) => {
                        let shard = NodeShard::open(self.work, level.level, layer)?;
                        shard.nodes.into_iter().map(Entry::of_node).collect()
                    }
                }
            }
        };
        let by_place = entries.into_iter().map(|e| ([e.grid[1], e.grid[0]], e));
        Ok(all.insert(by_place.collect()))
    }

    fn tiles(&self, z: u32) -> Result<Vec<Entry>> {
        let manifest = self.set.manifest();
        let Some(layer) = manifest.layers.iter().find(|layer| layer.z == z) else {
            return Ok(Vec::new());
        };
        let tiles = manifest.shard_tiles(self.set.dir(), layer)?;
        tiles.map(|tile| Ok(Entry::of_tile(tile?))).collect()
    }

    /// Voxels to metres, Z up: viewers turn (x, y, z) of glTF to (x, -z, y).
    fn to_metres(&self) -> DMat4 {
        let turn = DMat4::from_cols_array_2d(&[
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]);
        turn * DMat4::from_cols_array(&self.set.manifest().transform)
    }

    /// The longest side of a voxel in metres.
    fn voxel(&self) -> f64 {
        let m = self.to_metres();
        [m.x_axis, m.y_axis, m.z_axis]
            .map(|v| v.truncate().length())
            .into_iter()
            .fold(0.0, f64::max)
    }

    fn geometric_error(&self, error: f64) -> f64 {
        error * self.voxel() * DEFAULT_PIXELS / self.levels.pixel_error
    }

    /// A box as its centre and half of its sides.
    fn volume(&self, bounds: &Bounds) -> [f64; 12] {
        let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
        let half = ((max - min) / 2.0).max(DVec3::splat(THIN));
        let m = self.to_metres();
        let centre = m.transform_point3((min + max) / 2.0);
        let side = |axis: DVec3| m.transform_vector3(axis * half);
        let sides = [side(DVec3::X), side(DVec3::Y), side(DVec3::Z)];
        let mut all = [0.0; 12];
        for (i, v) in [centre, sides[0], sides[1], sides[2]]
            .into_iter()
            .enumerate()
        {
            for a in 0..3 {
                // no 0 has a minus
                all[3 * i + a] = v[a] + 0.0;
            }
        }
        all
    }
}

/// Path of the tileset of a node, below the directory of levels.
fn external(at: At) -> String {
    let path = tileset_path(at.level, at.place);
    path["lod/".len()..].to_owned()
}

fn put(path: &Path, document: &Value) -> Result<u64> {
    let mut text = serde_json::to_vec(document).expect("plain data serialises");
    text.push(b'\n');
    write_file(path, &[&text])?;
    Ok(text.len() as u64)
}
