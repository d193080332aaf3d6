//! The entries of nodes and of what lies below them.

use super::Set;
use crate::manifest::{Bounds, Layer, Level, NodeEntry, NodeShard, node_path, node_shard_path};
use crate::verify::closed;
use crate::verify::code::Code;
use crate::verify::files::Expected;
use crate::verify::index;
use crate::verify::report::Issues;
use std::collections::BTreeMap;

/// A level, or the tiles, below another one.
pub(super) struct Below<'a> {
    pub set: &'a Set<'a>,
    /// `None` for the tiles.
    pub below: Option<&'a Level>,
}

/// A tile or a node below another one.
#[derive(Debug, Clone)]
pub(super) struct Child {
    pub path: String,
    pub grid: [u32; 3],
    pub bounds: Bounds,
    pub error: f64,
    pub fin_width: f64,
    pub bytes: u64,
    pub checksum: String,
}

impl Child {
    /// Of a node.
    pub fn of(node: NodeEntry) -> Self {
        Child {
            path: node.path,
            grid: node.grid,
            bounds: node.bounds,
            error: node.error,
            fin_width: node.fin_width,
            bytes: node.bytes,
            checksum: node.checksum,
        }
    }
}

/// What lies below a node.
pub(super) struct Family<'a> {
    pub below: &'a Below<'a>,
    pub children: Vec<Child>,
}

impl Below<'_> {
    /// The layers that have something, by rising z.
    pub fn layers(&self) -> Vec<u32> {
        match self.below {
            None => self.set.manifest.layers.iter().map(|l| l.z).collect(),
            Some(level) => level.layers.iter().map(|l| l.z).collect(),
        }
    }

    /// True for the tiles.
    pub fn is_tiles(&self) -> bool {
        self.below.is_none()
    }
}

/// The shard of a layer of nodes, checked by itself.
pub(super) fn layer(
    set: &Set,
    level: &Level,
    layer: &Layer,
    at: &str,
    issues: &mut Issues,
) -> Option<Vec<NodeEntry>> {
    let named = node_shard_path(level.level, layer.z);
    if layer.path != named {
        let message = format!("found {}, expected {named}", layer.path);
        issues.add(Code::PathName, format!("{at}/path"), message);
        return None;
    }
    let expected = Expected {
        path: &layer.path,
        bytes: layer.bytes,
        checksum: &layer.checksum,
        at,
    };
    let shard: NodeShard = set.json(&expected, &closed::NODES, issues)?;
    let place = |n: &NodeEntry| [n.grid[1], n.grid[0]];
    let inside = |n: &NodeEntry| {
        let path = node_path(level.level, n.grid);
        (0..3).all(|a| n.grid[a] < level.grid[a]) && n.grid[2] == layer.z && n.path == path
    };
    let rising = shard.nodes.windows(2).all(|w| place(&w[0]) < place(&w[1]));
    let same = (shard.level, shard.z) == (level.level, layer.z);
    if !(same
        && rising
        && shard.nodes.iter().all(inside)
        && shard.nodes.len() as u64 == layer.tiles)
    {
        let message = format!(
            "found {} nodes of layer {} of level {}, expected {} inside the grid, by rising y, then x, with their paths",
            shard.nodes.len(),
            shard.z,
            shard.level,
            layer.tiles
        );
        issues.add(Code::LodValue, &layer.path, message);
        return None;
    }
    Some(shard.nodes)
}

/// What lies below a layer of nodes, by the y and x of the nodes above. `None` if it cannot be read, which has been
/// reported where it was read for itself.
pub(super) fn layer_below(below: &Below, z: u32) -> Option<BTreeMap<[u32; 2], Vec<Child>>> {
    let mut quiet = Issues::new(1);
    let mut all: BTreeMap<[u32; 2], Vec<Child>> = BTreeMap::new();
    let mut add = |child: Child| {
        let place = [child.grid[1] / 2, child.grid[0] / 2];
        all.entry(place).or_default().push(child);
    };
    let set = below.set;
    match below.below {
        None => {
            let layers = set.manifest.layers.iter().enumerate();
            for (i, layer) in layers.filter(|(_, l)| l.z / 2 == z) {
                let tiles = index::shard(set.root, set.tiling, i, layer, &mut quiet)?;
                for tile in tiles {
                    let tile = tile.ok()?;
                    add(Child {
                        path: tile.path,
                        grid: tile.grid,
                        bounds: tile.bounds,
                        error: 0.0,
                        fin_width: 0.0,
                        bytes: tile.bytes,
                        checksum: tile.checksum,
                    });
                }
            }
        }
        Some(level) => {
            for l in level.layers.iter().filter(|l| l.z / 2 == z) {
                for node in layer(set, level, l, "", &mut quiet)? {
                    add(Child::of(node));
                }
            }
        }
    }
    Some(all)
}
