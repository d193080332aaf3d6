//! Nodes of coarser levels by their numbers, and the tree that they and the tiles make.

use super::mesh::Frame;
use crate::error::{Error, Result};
use crate::grid::LATTICE;
use crate::manifest::{LEVELS, Level, NodeEntry};
use crate::tileset::{TileLookup, TileSet};
use crate::view::put;

/// Bytes of a node in `/tree.bin`.
const NODE: u32 = 40;
/// Bit of a node that has a mesh.
const HAS_CONTENT: u32 = 1;

/// A level from 1 on, in memory.
#[derive(Debug)]
struct LoadedLevel {
    told: Level,
    frame: Frame,
    /// By z, then y, then x.
    nodes: Vec<NodeEntry>,
}

/// All levels of a set; none if it has the tiles alone.
#[derive(Debug, Default)]
pub struct NodeLookup {
    levels: Vec<LoadedLevel>,
}

/// A node of the tree: its level, and its place in the grid of that.
#[derive(Debug, Clone, Copy)]
struct At {
    level: u32,
    grid: [u32; 3],
}

fn key([x, y, z]: [u32; 3]) -> [u32; 3] {
    [z, y, x]
}

fn wrong_levels(set: &TileSet, found: String, expected: String) -> Error {
    Error::format(set.dir().join(LEVELS), found, expected)
        .with_hint("`alvis lod --force` makes the levels anew")
}

/// Nodes of a level per axis.
fn grid_of(set: &TileSet, level: &Level) -> Result<[u32; 3]> {
    let tiles = set.manifest().tiling().tiles();
    // so many lattice steps as a voxel has at most, and no more levels than lead to one node
    if level.level >= u32::BITS || !level.step.is_power_of_two() || level.step > LATTICE {
        let found = format!("steps of {} in level {}", level.step, level.level);
        let expected = format!("a power of two up to {LATTICE}, below level 32");
        return Err(wrong_levels(set, found, expected));
    }
    Ok(tiles.map(|n| n.div_ceil(1 << level.level)))
}

impl NodeLookup {
    /// Reads the lists of all levels.
    ///
    /// # Errors
    /// Those of [`TileSet::levels`] and [`TileSet::nodes`]; [`Error::Format`] for a node outside of the grid.
    pub fn read(set: &TileSet) -> Result<Self> {
        let mut levels = Vec::new();
        for told in set.levels()?.map_or_else(Vec::new, |all| all.levels) {
            let grid = grid_of(set, &told)?;
            let mut nodes = set.nodes(&told).collect::<Result<Vec<_>>>()?;
            if let Some(node) = nodes.iter().find(|n| (0..3).any(|a| n.grid[a] >= grid[a])) {
                let found = format!("the node {:?} in level {}", node.grid, told.level);
                let expected = format!("one in a grid of {grid:?}");
                return Err(wrong_levels(set, found, expected));
            }
            nodes.sort_unstable_by_key(|node| key(node.grid));
            let frame = Frame::of_level(set.manifest(), &told);
            levels.push(LoadedLevel { told, frame, nodes });
        }
        Ok(NodeLookup { levels })
    }

    /// The levels as their index tells of them, the finest first.
    pub fn levels(&self) -> impl Iterator<Item = &Level> {
        self.levels.iter().map(|level| &level.told)
    }

    /// A node of a level from 1 on, and what meshes of its level have in common.
    pub fn get(&self, level: u32, grid: [u32; 3]) -> Option<(&NodeEntry, &Frame)> {
        let level = self.levels.get((level as usize).checked_sub(1)?)?;
        let at = level
            .nodes
            .binary_search_by_key(&key(grid), |n| key(n.grid));
        Some((&level.nodes[at.ok()?], &level.frame))
    }

    /// `/tree.bin`: a header of 16 bytes, then nodes of 40 bytes, the coarsest level first. The children of a node follow
    /// each other.
    ///
    /// # Errors
    /// [`Error::Format`] if a tile or a node has no node above it.
    pub fn tree(&self, set: &TileSet, tiles: &TileLookup, frame: &Frame) -> Result<Vec<u8>> {
        let order = self.order(tiles);
        let all = tiles.tiles().len() + self.levels.iter().map(|l| l.nodes.len()).sum::<usize>();
        if order.len() != all {
            let found = format!("{} nodes and tiles under the coarsest ones", order.len());
            return Err(wrong_levels(
                set,
                found,
                format!("all {all} that there are"),
            ));
        }
        let mut out = Vec::with_capacity(16 + NODE as usize * order.len());
        let magic = u32::from_le_bytes(*b"ALVT");
        put(&mut out, &[magic, 1, order.len() as u32, NODE]);
        let tops = order.iter().take_while(|o| o.0.level == order[0].0.level);
        let mut first = tops.count() as u32;
        for &(At { level, grid }, children) in &order {
            let [x, y, z] = grid;
            let [triangles, bytes, error] = self.numbers(At { level, grid }, tiles, frame);
            let child = if children == 0 { 0 } else { first };
            first += children;
            put(
                &mut out,
                &[
                    level,
                    x,
                    y,
                    z,
                    triangles,
                    bytes,
                    error,
                    child,
                    children,
                    HAS_CONTENT,
                ],
            );
        }
        Ok(out)
    }

    /// All nodes under the coarsest ones, level by level, with the number of children of each, which stand in the same
    /// order in the next level.
    fn order(&self, tiles: &TileLookup) -> Vec<(At, u32)> {
        let top = self.levels.len() as u32;
        let mut level: Vec<[u32; 3]> = match self.levels.last() {
            Some(coarsest) => coarsest.nodes.iter().map(|n| n.grid).collect(),
            None => tiles.tiles().iter().map(|t| t.grid).collect(),
        };
        let mut order = Vec::new();
        for number in (0..=top).rev() {
            let mut next = Vec::new();
            for grid in level {
                let before = next.len();
                if number > 0 {
                    next.extend(eight(grid).filter(|&child| match number - 1 {
                        0 => tiles.get(child).is_some(),
                        below => self.get(below, child).is_some(),
                    }));
                }
                let children = (next.len() - before) as u32;
                let at = At {
                    level: number,
                    grid,
                };
                order.push((at, children));
            }
            level = next;
        }
        order
    }

    /// Triangles, bytes of the mesh (0 where that is not known) and the bits of the error in voxels.
    fn numbers(&self, at: At, tiles: &TileLookup, frame: &Frame) -> [u32; 3] {
        let short = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
        if let Some((node, frame)) = self.get(at.level, at.grid) {
            let triangles = short(node.triangles.saturating_add(node.fin_triangles));
            // each part has a strip at least, each fin one of its own
            let strips = node.strips.saturating_sub(node.fin_triangles / 2);
            let pieces = strips.saturating_add(node.fin_rows.into());
            let bytes = frame.bytes(node.vertices, pieces, node.indices);
            return [triangles, bytes, (node.error as f32).to_bits()];
        }
        let Some(tile) = tiles.get(at.grid) else {
            return [0; 3];
        };
        let bytes = frame.bytes(tile.vertices, tile.pieces.into(), tile.indices);
        [short(tile.triangles), bytes, 0f32.to_bits()]
    }
}

/// The places of the children of a node, by z, y and x.
fn eight(grid: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
    (0..8u32).filter_map(move |i| {
        let mut child = [0; 3];
        for (a, c) in child.iter_mut().enumerate() {
            *c = grid[a].checked_mul(2)?.checked_add(i >> a & 1)?;
        }
        Some(child)
    })
}
