//! One level: its numbers, and its layers of nodes, each made of two layers of the level below.

use super::build::{Built, Recipe, build};
use super::clusters::Rules;
use super::entry::{Entry, memory};
use super::journal::Journal;
use super::planes::Planes;
use crate::error::{Error, Result};
use crate::grid::{LATTICE, Tiling};
use crate::manifest::Primitives;
use crate::manifest::{
    Bounds, Layer, Level, Manifest, NodeEntry, checksum_text, node_path, node_shard_path,
};
use crate::progress::Progress;
use crate::strip::Stripifier;
use crate::sys::files::write_file;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::tile::NodeExtras;
use crate::tile::node::{NodeForm, node_file, parts_of_node, parts_of_tile, shift_for};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Width of the blocks of the first level in voxels, for a ratio of 1/8: so that clusters leave some more triangles
/// than are wanted, and collapsing edges takes the rest where it does least harm.
const FIRST_BLOCK: f64 = 2.2;
/// Width of the blocks of the border, in blocks: curves have no eighth of their edges to keep.
const BORDER_BLOCK: f64 = 1.25;

/// Triangles of a node above the first level that are not too many in any case, as long as all of its level are no
/// more than this share of those of the tiles.
const FLOOR: u64 = 1000;
const FLOOR_SHARE: u64 = 200;

/// How well normals have to agree in blocks, and in those half as wide: the first level is what one looks at from near.
const AGREE: [f32; 2] = [0.85, 0.7];
const AGREE_ABOVE: [f32; 2] = [0.75, 0.75];

/// About so many steps of positions are as wide as a block, as far as they are no coarser than a quarter of a voxel,
/// in which small surfaces that stay as they are do not fall together.
const BLOCK_STEPS: u32 = 16;
const COARSEST: u32 = LATTICE / 4;

/// The numbers of a level.
#[derive(Debug, Clone, Copy)]
pub struct LevelPlan {
    pub level: u32,
    pub rules: Rules,
    pub shift: u32,
    /// Nodes per axis.
    pub grid: [u32; 3],
    pub ratio: f64,
    /// Triangles that are not too many for a node.
    pub floor: usize,
}

impl LevelPlan {
    /// Of a level of a tile set, `below` being the one before it.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if nodes would reach further than their files can say.
    pub fn new(manifest: &Manifest, below: Option<&Level>, ratio: f64) -> Result<Self> {
        let tiling = tiling(manifest);
        let level = below.map_or(1, |below| below.level + 1);
        let steps = |a: usize| {
            let cubes = u64::from(tiling.macrocube[a]) << level;
            cubes.min(u64::from(tiling.dims.0[a] - 1)) * u64::from(LATTICE)
        };
        let most = (0..3).map(steps).max().unwrap_or(0);
        // half a voxel outside of the volume lie the caps, and a node one voxel wide has places between its planes
        let thin = (0..3)
            .any(|a| (tiling.dims.0[a] - 2).is_multiple_of(tiling.macrocube[a] << level.min(20)));
        let finest = if manifest.cap || thin {
            LATTICE / 2
        } else {
            LATTICE
        };
        let shift = shift_for(most).filter(|&shift| 1 << shift <= finest);
        let Some(shift) = shift else {
            return Err(Error::unsupported(
                "OUT",
                format!("level {level} over {} voxels", tiling.dims),
                format!("--levels {level} makes those below it"),
            ));
        };
        let grid = tiling.tiles().map(|n| n.div_ceil(1 << level));
        let nodes = grid.into_iter().map(u64::from).product::<u64>().max(1);
        let (floor, block) = match below {
            None => (0, FIRST_BLOCK * f64::from(LATTICE) * (0.125 / ratio).sqrt()),
            Some(below) => {
                let floor = FLOOR.min(manifest.totals.triangles / FLOOR_SHARE / nodes);
                // where few triangles are left a level need not be as much coarser
                let share = (floor * nodes) as f64 / below.triangles.max(1) as f64;
                let share = share.clamp(ratio, 0.5);
                (floor as usize, f64::from(below.block) / share.sqrt())
            }
        };
        let block = 2 * (block.min(f64::from(1 << 24)) / 2.0).round() as i32;
        // finer than that is bytes for nothing
        let rough = (block as u32 / BLOCK_STEPS).max(1).ilog2();
        let shift = shift.max(rough.min(COARSEST.ilog2()));
        Ok(LevelPlan {
            level,
            rules: Rules {
                block,
                border_block: 2 * (f64::from(block) * BORDER_BLOCK / 2.0).round() as i32,
                agree: if level == 1 { AGREE } else { AGREE_ABOVE },
                step: 1 << shift,
                capped: manifest.cap,
            },
            shift,
            grid,
            ratio,
            floor,
        })
    }

    /// Its layers.
    pub fn layers(&self) -> u32 {
        self.grid[2]
    }
}

/// The macrocubes of a tile set.
pub fn tiling(manifest: &Manifest) -> Tiling {
    Tiling {
        dims: manifest.grid.dims,
        macrocube: manifest.grid.macrocube,
    }
}

/// What makes the nodes of a level.
pub struct Maker<'a> {
    pub plan: LevelPlan,
    pub manifest: &'a Manifest,
    /// Where the children's files lie.
    pub below: &'a Path,
    /// Where to write.
    pub work: &'a Path,
    pub pool: &'a Arc<MemoryPool>,
    pub threads: usize,
    pub progress: &'a dyn Progress,
    /// Counts the nodes that need not be made again.
    pub done: &'a AtomicU64,
}

/// A node that is written.
#[derive(Debug, Serialize, Deserialize)]
pub struct Made {
    pub entry: NodeEntry,
    /// The cells that have a triangle, by rising number.
    pub cells: Vec<u64>,
}

/// The children of each node of a layer, by y and x.
pub fn families(children: Vec<Entry>) -> BTreeMap<[u32; 2], Vec<Entry>> {
    let mut all: BTreeMap<[u32; 2], Vec<Entry>> = BTreeMap::new();
    for child in children {
        let [x, y, _] = child.grid.map(|v| v / 2);
        all.entry([y, x]).or_default().push(child);
    }
    for family in all.values_mut() {
        family.sort_by_key(|c| [c.grid[2], c.grid[1], c.grid[0]]);
    }
    all
}

impl Maker<'_> {
    /// Makes and writes the nodes of a layer over these children, in as many threads as there are and memory allows;
    /// not those that were done before.
    ///
    /// # Errors
    /// [`Error::Memory`] if there is not even memory for one at a time; [`Error::Io`], [`Error::Format`] if a child is
    /// damaged; [`Error::Interrupted`].
    pub fn layer(&self, z: u32, children: Vec<Entry>) -> Result<Vec<Made>> {
        if children.is_empty() {
            return Ok(Vec::new());
        }
        let dir = self.work.join(node_path(self.plan.level, [0, 0, z]));
        let dir = dir.parent().unwrap_or(self.work);
        std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, "create the directory", e))?;
        let mut made = Journal::kept(self.work, self.plan.level, z);
        self.done.fetch_add(made.len() as u64, Ordering::Relaxed);
        self.progress.advance(made.len() as u64);
        let journal = Journal::begin(self.work, self.plan.level, z, &made)?;
        let families: Vec<([u32; 3], Vec<Entry>)> = families(children)
            .into_iter()
            .map(|([y, x], family)| ([x, y, z], family))
            .filter(|(place, _)| made.iter().all(|m| m.entry.grid != *place))
            .collect();
        let most = families.iter().map(|f| memory(&f.1)).max().unwrap_or(0);
        let left = self.pool.left();
        let at_once = (left / most.max(1)).min(self.threads as u64);
        if at_once == 0 {
            return Err(too_little(self.pool, most));
        }
        let mut taken = MemoryReservation::new(self.pool, "nodes in the making");
        taken.grow_to(at_once * most)?;
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(at_once as usize)
            .build()
            .map_err(|e| Error::usage("--threads", at_once.to_string(), e.to_string()))?;
        let new: Result<Vec<Made>> = threads.install(|| {
            let each = families.into_par_iter().with_max_len(1);
            each.map_init(Stripifier::default, |stripifier, (place, family)| {
                let made = self.node(place, &family, stripifier)?;
                journal.add(&made)?;
                self.done.fetch_add(1, Ordering::Relaxed);
                Ok(made)
            })
            .collect()
        });
        made.extend(new?);
        made.sort_by_key(|m| [m.entry.grid[1], m.entry.grid[0]]);
        Ok(made)
    }

    fn node(&self, place: [u32; 3], children: &[Entry], strips: &mut Stripifier) -> Result<Made> {
        if self.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let highest = |value: fn(&Entry) -> f64| children.iter().map(value).fold(0.0, f64::max);
        let recipe = Recipe {
            planes: Planes::of(tiling(self.manifest), self.plan.level, place),
            rules: self.plan.rules,
            ratio: self.plan.ratio,
            floor: self.plan.floor,
            is_first: self.plan.level == 1,
            fin_width: (highest(|c| c.fin_width) * f64::from(LATTICE)) as u32,
        };
        let mut failed = None;
        let parts = children.iter().map_while(|child| match self.read(child) {
            Ok(parts) => Some(parts),
            Err(error) => {
                failed = Some(error);
                None
            }
        });
        let built = build(parts, &recipe, strips);
        if let Some(error) = failed {
            return Err(error);
        }
        let below = highest(|c| c.error);
        let error = rising(below, f64::from(built.error));
        self.write(place, children, built, error)
    }

    fn read(&self, child: &Entry) -> Result<Vec<crate::tile::node::SurfacePart>> {
        let bytes = child.read(self.below)?;
        let kind: Primitives = self.manifest.primitives;
        let parts = match self.plan.level {
            1 => parts_of_tile(&bytes, kind),
            _ => parts_of_node(&bytes),
        };
        let expected = if self.plan.level == 1 {
            "a tile"
        } else {
            "a node"
        };
        parts.map_err(|e| {
            Error::format(self.below.join(&child.path), e.to_string(), expected)
                .with_hint("`alvis verify` says more")
        })
    }

    fn write(&self, place: [u32; 3], children: &[Entry], built: Built, error: f64) -> Result<Made> {
        let level = self.plan.level;
        let surfaces = built.parts.len() - built.fin_rows as usize;
        let mut cells: Vec<u64> = built.parts[..surfaces]
            .iter()
            .map(|p| p.extras.cell)
            .collect();
        cells.retain(|&cell| cell > 0);
        cells.sort_unstable();
        cells.dedup();
        let extras = NodeExtras {
            level,
            error,
            fin_rows: built.fin_rows,
        };
        let form = NodeForm {
            matrix: self.manifest.transform,
            shift: self.plan.shift,
        };
        let path = node_path(level, place);
        let file = node_file(&form, extras, built.parts).map_err(|_| {
            Error::unsupported(&path, "a node of more than 4 GiB or 16 bits of steps", "")
        })?;
        write_file(&self.work.join(&path), &[&file.bytes])?;
        self.progress.advance(1);
        let voxels = |steps: u32| f64::from(steps) / f64::from(LATTICE);
        let own = file
            .bounds
            .map(|p| p.map(|v| f64::from(v) / f64::from(LATTICE)));
        let entry = NodeEntry {
            path,
            grid: place,
            bounds: union(own, children),
            error,
            curve_gap: voxels(built.gap),
            fin_width: voxels(built.fin_width),
            vertices: file.vertices,
            triangles: built.triangles,
            fin_triangles: built.fin_triangles,
            fin_rows: built.fin_rows,
            strips: built.strips,
            indices: file.indices,
            border_edges: built.border_edges,
            bytes: file.bytes.len() as u64,
            checksum: checksum_text(crc32fast::hash(&file.bytes)),
        };
        Ok(Made { entry, cells })
    }
}

/// The refusal of a limit in which not even one node can be made.
fn too_little(pool: &MemoryPool, most: u64) -> Error {
    Error::Memory {
        limit: pool.limit(),
        needed: pool.limit() - pool.left() + most,
        hint: String::new(),
    }
}

/// An error that is more than that of all below, by what was added, in millionths of a voxel.
pub fn rising(below: f64, added: f64) -> f64 {
    let least = (below * 1.0001).max(1.0 / f64::from(LATTICE));
    ((below + added).max(least) * 1e6).ceil() / 1e6
}

fn union([min, max]: [[f64; 3]; 2], children: &[Entry]) -> Bounds {
    let mut all = Bounds { min, max };
    for child in children {
        for a in 0..3 {
            all.min[a] = all.min[a].min(child.bounds.min[a]);
            all.max[a] = all.max[a].max(child.bounds.max[a]);
        }
    }
    all
}

/// Writes the shard of a layer of nodes.
///
/// # Errors
/// [`Error::Io`].
pub fn write_shard(work: &Path, level: u32, z: u32, nodes: &[Made]) -> Result<Layer> {
    let mut text = format!("{{\"level\":{level},\"z\":{z},\"nodes\":[").into_bytes();
    for (i, node) in nodes.iter().enumerate() {
        text.extend_from_slice(if i == 0 { b"\n" } else { b",\n" });
        serde_json::to_writer(&mut text, &node.entry).expect("plain data serialises");
    }
    text.extend_from_slice(b"\n]}\n");
    let path = node_shard_path(level, z);
    let file = work.join(&path);
    let new = file.with_extension("new");
    write_file(&new, &[&text])?;
    std::fs::rename(&new, &file).map_err(|e| Error::io(&file, "move into place", e))?;
    Journal::remove(work, level, z)?;
    Ok(Layer {
        z,
        path,
        tiles: nodes.len() as u64,
        bytes: text.len() as u64,
        checksum: checksum_text(crc32fast::hash(&text)),
    })
}
