//! The tree in 3D Tiles 1.1: each node once, with its file, its box in metres and its error, below the node that stands
//! for it.

use super::entries::{self, Child};
use super::{Below, Set, layer_below};
use crate::error::Result;
use crate::manifest::{Levels, TILESET, tileset_path};
use crate::verify::code::Code;
use crate::verify::foreign::foreign;
use crate::verify::report::Issues;
use glam::{DMat4, DVec3};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Pixels that viewers take for sharp by default.
const PIXELS: f64 = 16.0;
/// Half of the shortest side of a box in voxels.
const THIN: f64 = 1e-3;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    asset: Asset,
    #[serde(rename = "geometricError")]
    error: f64,
    root: Tile,
    extras: Option<Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asset {
    version: String,
    #[serde(rename = "tilesetVersion")]
    tileset_version: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Tile {
    #[serde(rename = "boundingVolume")]
    volume: Volume,
    #[serde(rename = "geometricError")]
    error: f64,
    refine: Option<String>,
    content: Option<Content>,
    #[serde(default)]
    children: Vec<Tile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Volume {
    #[serde(rename = "box")]
    sides: [f64; 12],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    uri: String,
}

/// A tile or a node by its level, 0 for tiles, and its place.
type At = (u32, [u32; 3]);

/// What lies below a layer of nodes, by their places (x, y); nothing if that cannot be read.
type Families = Option<BTreeMap<[u32; 2], Vec<Child>>>;

/// The walk through the tree.
struct Walk<'a> {
    set: &'a Set<'a>,
    levels: &'a Levels,
    /// What lies below the layers of nodes that are needed, by level and z of the nodes above.
    families: BTreeMap<(u32, u32), Families>,
    to_metres: DMat4,
    /// Nodes and tiles that were met.
    met: u64,
    /// Names of the tilesets that were read, but for the first.
    read: BTreeSet<String>,
}

/// Checks `tileset.json` and the tilesets that it names.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) if their directory cannot be listed.
pub(super) fn check(set: &Set, levels: &Levels, issues: &mut Issues) -> Result<()> {
    // (x, y, z) of glTF is (x, -z, y) where z is up
    let turn = DMat4::from_cols(
        DVec3::X.extend(0.0),
        DVec3::Z.extend(0.0),
        (-DVec3::Y).extend(0.0),
        DVec3::ZERO.extend(1.0),
    );
    let mut walk = Walk {
        set,
        levels,
        families: BTreeMap::new(),
        to_metres: turn * DMat4::from_cols_array(&set.manifest.transform),
        met: 0,
        read: BTreeSet::new(),
    };
    let top = levels.levels.len() as u32;
    let Some(roots) = walk.roots() else {
        return Ok(());
    };
    let Some(document) = walk.read(TILESET, issues) else {
        return Ok(());
    };
    match &roots[..] {
        [root] => walk.tile(TILESET, &document.root, (top, root.grid), root, issues),
        roots => {
            let tile = &document.root;
            if tile.content.is_some() || tile.children.len() != roots.len() {
                wrong(
                    TILESET,
                    "expected a root without content over the nodes",
                    issues,
                );
            } else {
                for (tile, root) in tile.children.iter().zip(roots) {
                    walk.tile(TILESET, tile, (top, root.grid), root, issues);
                }
            }
        }
    }
    let all = set.manifest.totals.tiles + levels.levels.iter().map(|l| l.nodes).sum::<u64>();
    if walk.met != all {
        let message = format!("found {} nodes and tiles, expected {all}", walk.met);
        wrong(TILESET, message, issues);
        // those of parts that were not reached would be foreign as well
        return Ok(());
    }
    let known = |name: &str| walk.read.contains(name);
    foreign(set.root, "lod/tilesets", known, issues)
}

/// The error of a tileset with this root: a viewer shows nothing of one whose error is small on the screen.
fn top_error(root: &Tile) -> f64 {
    let squares = root.volume.sides[3..].iter().map(|v| v * v);
    let diagonal = 2.0 * squares.sum::<f64>().sqrt();
    diagonal.max(1.0001 * root.error)
}

fn wrong(path: &str, message: impl Into<String>, issues: &mut Issues) {
    issues.add(Code::LodTileset, path, message);
}

impl Walk<'_> {
    /// The nodes of the coarsest level. `None` if they cannot be read, which has been reported.
    fn roots(&self) -> Option<Vec<Child>> {
        let mut quiet = Issues::new(1);
        let level = self.levels.levels.last()?;
        let mut roots = Vec::new();
        for layer in &level.layers {
            for node in entries::layer(self.set, level, layer, "", &mut quiet)? {
                roots.push(Child::of(node));
            }
        }
        Some(roots)
    }

    /// Reads a tileset and checks its frame.
    fn read(&self, path: &str, issues: &mut Issues) -> Option<Document> {
        let file = crate::verify::files::resolve(self.set.root, path, "the tree", issues)?;
        let text = match crate::verify::files::open(&file).and_then(std::io::read_to_string) {
            Ok(text) => text,
            Err(e) => {
                issues.add(Code::MissingFile, path, format!("cannot be read: {e}"));
                return None;
            }
        };
        let document: Document = match serde_json::from_str(&text) {
            Ok(document) => document,
            Err(e) => {
                issues.add(Code::LodSyntax, path, e.to_string());
                return None;
            }
        };
        let root = &document.root;
        let frame = document.asset.version == "1.1" && root.refine.as_deref() == Some("REPLACE");
        if !frame {
            wrong(
                path,
                "expected version 1.1, and REPLACE at the root",
                issues,
            );
        }
        let error = top_error(root);
        if (document.error - error).abs() > 1e-9 * error {
            let message = format!(
                "found the error {}, expected {error}: the diagonal of the root's box, or a little more than its error",
                document.error
            );
            wrong(path, message, issues);
        }
        self.check_words(path, &document, issues);
        Some(document)
    }

    /// Compares what a tileset says of the set: the checksum of the index of levels, by which viewers tell one state from
    /// others, and in that of the root units and scales.
    fn check_words(&self, path: &str, document: &Document, issues: &mut Issues) {
        let manifest = self.set.manifest;
        let version = manifest.lod.as_ref().map(|lod| lod.checksum.as_str());
        let found = document.asset.tileset_version.as_str();
        if Some(found) != version {
            let version = version.unwrap_or("none");
            let message = format!("found tilesetVersion {found}, expected {version}");
            wrong(path, message, issues);
        }
        let pixels = self.levels.pixel_error;
        let expected = (path == TILESET).then(|| {
            json!({"alvis": {
                "unit": manifest.placement.unit,
                "voxel_metres": self.voxel(),
                "pixel_error": pixels,
                "error_scale": PIXELS / pixels
            }})
        });
        if !same_words(&document.extras, &expected) {
            let text = |v: &Option<Value>| v.as_ref().map_or("none".to_owned(), |v| v.to_string());
            let message = format!(
                "found the extras {}, expected {}",
                text(&document.extras),
                text(&expected)
            );
            wrong(path, message, issues);
        }
    }

    /// Checks a tile of the tileset at `path` and all below it.
    fn tile(&mut self, path: &str, tile: &Tile, at: At, own: &Child, issues: &mut Issues) {
        if !self.same_place(tile, own) {
            let message = format!(
                "found the box {:?} and the error {} of {}, expected those of its entry",
                tile.volume.sides, tile.error, own.path
            );
            return wrong(path, message, issues);
        }
        let uri = tile.content.as_ref().and_then(|c| resolved(path, &c.uri));
        let Some(uri) = uri else {
            let message = format!("found no content inside the set for {}", own.path);
            return wrong(path, message, issues);
        };
        if uri != own.path {
            return self.external(path, tile, &uri, at, own, issues);
        }
        self.met += 1;
        let (level, [x, y, z]) = at;
        let below = match level.checked_sub(1) {
            None => Vec::new(),
            Some(_) => self
                .children(level, z)
                .and_then(|f| f.remove(&[y, x]))
                .unwrap_or_default(),
        };
        if tile.children.len() != below.len() {
            let message = format!(
                "found {} children of {}, expected {}",
                tile.children.len(),
                own.path,
                below.len()
            );
            return wrong(path, message, issues);
        }
        for child in &below {
            let name = |t: &&Tile| self.same_place(t, child);
            match tile.children.iter().find(name) {
                Some(tile) => self.tile(path, tile, (level - 1, child.grid), child, issues),
                None => wrong(
                    path,
                    format!("found no child that is {}", child.path),
                    issues,
                ),
            }
        }
    }

    /// Checks a tile that leads to a tileset of its own, whose root is the node.
    fn external(
        &mut self,
        path: &str,
        tile: &Tile,
        uri: &str,
        at: At,
        own: &Child,
        issues: &mut Issues,
    ) {
        let (level, place) = at;
        let named = tileset_path(level, place);
        if uri != named || path == named || !tile.children.is_empty() {
            let message = format!("found {uri} for {}, expected it or {named}", own.path);
            return wrong(path, message, issues);
        }
        let name = named.rsplit('/').next().unwrap_or_default();
        self.read.insert(name.to_owned());
        if let Some(document) = self.read(&named, issues) {
            self.tile(&named, &document.root, at, own, issues);
        }
    }

    /// What lies below the nodes of a layer.
    fn children(&mut self, level: u32, z: u32) -> Option<&mut BTreeMap<[u32; 2], Vec<Child>>> {
        let (set, levels) = (self.set, self.levels);
        let known = self.families.entry((level, z)).or_insert_with(|| {
            let below = Below {
                set,
                below: (level as usize).checked_sub(2).map(|i| &levels.levels[i]),
            };
            layer_below(&below, z)
        });
        known.as_mut()
    }

    /// True if box and error are those of an entry.
    fn same_place(&self, tile: &Tile, own: &Child) -> bool {
        let (min, max) = (DVec3::from(own.bounds.min), DVec3::from(own.bounds.max));
        let half = (0.5 * (max - min)).max(DVec3::splat(THIN));
        let m = &self.to_metres;
        let centre = m.transform_point3(0.5 * (min + max));
        let columns = [m.x_axis * half.x, m.y_axis * half.y, m.z_axis * half.z];
        let expected = [
            centre.to_array(),
            columns[0].truncate().to_array(),
            columns[1].truncate().to_array(),
            columns[2].truncate().to_array(),
        ];
        let scale = centre.abs().max_element() + half.max_element() * self.voxel();
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-9 * scale;
        let error = own.error * self.voxel() * PIXELS / self.levels.pixel_error;
        tile.volume
            .sides
            .iter()
            .zip(expected.as_flattened())
            .all(near)
            && (tile.error - error).abs() <= 1e-9 * error
    }

    /// The longest side of a voxel in metres.
    fn voxel(&self) -> f64 {
        let m = &self.to_metres;
        let sides = [m.x_axis, m.y_axis, m.z_axis].map(|v| v.truncate().length());
        sides.into_iter().fold(0.0, f64::max)
    }
}

/// True if two values have the same members, and numbers that differ by rounding at most.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len()
                && a.iter()
                    .all(|(name, v)| b.get(name).is_some_and(|w| same(v, w)))
        }
        (Value::Number(a), Value::Number(b)) => {
            let number = |v: &serde_json::Number| v.as_f64().unwrap_or(f64::NAN);
            (number(a) - number(b)).abs() <= 1e-12 * number(b).abs()
        }
        _ => a == b,
    }
}

fn same_words(a: &Option<Value>, b: &Option<Value>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => same(a, b),
        (None, None) => true,
        _ => false,
    }
}

/// The path in the set that a URI in the file at `path` names; `None` if it leads outside or is none of plain names.
fn resolved(path: &str, uri: &str) -> Option<String> {
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in uri.split('/') {
        match part {
            ".." => _ = parts.pop()?,
            _ => parts.push(part),
        }
    }
    let joined = parts.join("/");
    crate::manifest::is_plain(&joined).then_some(joined)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_resolved_inside() {
        let at = "lod/tilesets/3_z0_y0_x0.json";
        assert_eq!(resolved(at, "../2/a.glb").as_deref(), Some("lod/2/a.glb"));
        assert_eq!(
            resolved(at, "../../tiles/b.glb").as_deref(),
            Some("tiles/b.glb")
        );
        assert_eq!(
            resolved("tileset.json", "lod/a.glb").as_deref(),
            Some("lod/a.glb")
        );
        for bad in ["../../../a", "/etc/x", "http://a/b", "a//b", ""] {
            assert_eq!(resolved(at, bad), None, "{bad}");
        }
    }
}
