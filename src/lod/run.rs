//! All levels of a tile set, one after another.

use super::asked::{
    LodOptions, check, check_begun, check_files, check_free, check_kept, check_tiles, kept_levels,
};
use super::entry::{Entry, memory};
use super::level::{LevelPlan, Made, Maker, families, tiling, write_shard};
use super::tileset_json;
use super::work::{Identity, Work, interrupted};
use crate::error::{Error, Result};
use crate::manifest::{
    Generator, LEVELS, LEVELS_FORMAT, LEVELS_VERSION, Level, Levels, Manifest, NodeEntry,
    NodeShard, node_path, node_shard_path,
};
use crate::progress::Progress;
use crate::sys::files::write_file;
use crate::sys::id_set::IdSet;
use crate::sys::memory_pool::MemoryPool;
use crate::sys::process_memory::peak_rss_bytes;
use crate::tile::read::{Pieces, Tile};
use crate::tileset::{TileSet, refuse_bucket, tidy};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Triangles of a root that a viewer can always show.
const ROOT: u64 = 100_000;
/// What is said of levels for which nothing had to be done, and of those that only had to be moved.
const NOTHING_DONE: &str = "the levels of detail are there and finished: nothing was done";
const MOVED_IN: &str = "the levels of detail had all been made when they were interrupted: what was not in place yet was moved in";
/// Memory that is used for everything but nodes in the making.
const FIXED: u64 = 32 << 20;

/// What was made; the command prints it with `--json`. Lists begin with level 0, the tiles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LodReport {
    /// Levels, the tiles counted.
    pub levels: u32,
    /// Nodes of levels from 1 on.
    pub nodes: u64,
    /// Triangles of their surfaces.
    pub triangles: u64,
    /// Triangles of surfaces.
    pub triangles_by_level: Vec<u64>,
    /// Bytes of the files of levels: nodes, their lists, the index and the tree.
    pub bytes: u64,
    /// As many, or 0 if all of them had been made before.
    pub bytes_written: u64,
    /// How far surfaces of the tiles lie from those of a level, in voxels: the largest of its nodes, see
    /// [`NodeEntry::error`].
    pub error_by_level: Vec<f64>,
    /// Edges of borders that nodes share, counted in each; of the tiles not known.
    pub border_edges_by_level: Vec<Option<u64>>,
    /// Cells that have a triangle.
    pub cells_by_level: Vec<u64>,
    /// Triangles of the nodes of the coarsest level.
    pub root_triangles: u64,
    /// Triangles of fins.
    pub fin_triangles: u64,
    /// Wall time.
    pub seconds: f64,
    /// Largest resident set of the process so far, in bytes.
    pub peak_rss_bytes: u64,
}

/// Makes levels of detail over the tiles of the set in the directory `out`, and adds them to it.
///
/// # Errors
/// [`Error::Usage`] if an option is out of range, if there are levels already and `force` is not set, or if they were
/// interrupted and neither `resume` nor `force` is, or their nodes are others; [`Error::Unsupported`]; [`Error::Memory`];
/// [`Error::Format`] if the set is damaged; [`Error::OutputBusy`]; [`Error::Io`]; [`Error::Interrupted`], as an
/// [`Error::Resumable`] once there is something to go on from.
pub fn lod(out: &Path, options: &LodOptions, progress: &dyn Progress) -> Result<LodReport> {
    let start = Instant::now();
    check(options)?;
    refuse_bucket(out)?;
    let set = TileSet::open(out)?;
    // those that were interrupted may be about to replace these
    if !interrupted(out)
        && let Some(report) = finished(&set, options, start)?
    {
        progress.warn(NOTHING_DONE);
        tidy(out)?;
        return Ok(report);
    }
    check_tiles(&set)?;
    let mut work = Work::open(out)?;
    if work.moved_in() {
        progress.warn(MOVED_IN);
    }
    // what had been interrupted while it was moved in is there now, or somebody else's
    let set = TileSet::open(out)?;
    let manifest = set.manifest().clone();
    if !interrupted(out) {
        let options = LodOptions {
            resume: options.resume || work.moved_in(),
            ..*options
        };
        if let Some(report) = finished(&set, &options, start)? {
            if !work.moved_in() {
                progress.warn(NOTHING_DONE);
            }
            return Ok(report);
        }
    }
    check_free(&set, options)?;
    let goes_on = take_up(&mut work, &manifest, options, progress, out)?;
    let mut run = Run {
        set: &set,
        manifest: &manifest,
        options,
        work: work.dir().to_path_buf(),
        pool: MemoryPool::new(options.memory, "the program", FIXED.min(options.memory)),
        progress,
        done: 0,
        nodes: AtomicU64::new(0),
    };
    let made = run.levels().and_then(|levels| {
        let count = levels.levels.len() as u32 + 1;
        work.keep_levels(count)?;
        let beside = run.finish(&levels)?;
        work.publish(manifest.clone(), count)?;
        Ok(report(&levels, &manifest, beside, start))
    });
    let report = made.map_err(|error| match goes_on || run.is_anything_done() {
        true => {
            work.keep(true);
            run.resumable(error, out)
        }
        false => error,
    })?;
    Ok(LodReport {
        bytes_written: report.bytes,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
        ..report
    })
}

/// Of levels that are finished and asked for, so that nothing is to be done.
fn finished(set: &TileSet, options: &LodOptions, start: Instant) -> Result<Option<LodReport>> {
    let Some(levels) = kept_levels(set, options)? else {
        return Ok(None);
    };
    check_kept(&levels, set, options)?;
    check_files(&levels, set)?;
    let manifest = set.manifest();
    let index = manifest.lod.as_ref().map_or(0, |index| index.bytes);
    let beside = index + bytes_of_shards(&levels) + tileset_json::bytes(set.dir());
    Ok(Some(report(&levels, manifest, beside, start)))
}

/// Begins, or goes on with what was interrupted; true if it is that.
fn take_up(
    work: &mut Work,
    manifest: &Manifest,
    options: &LodOptions,
    progress: &dyn Progress,
    out: &Path,
) -> Result<bool> {
    let wanted = Identity {
        index: manifest.checksum.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        ratio: options.ratio,
        levels: options.levels,
        pixel_error: options.pixel_error,
    };
    let there = interrupted(out);
    if there && !options.resume && !options.force {
        return Err(Error::usage(
            out.display().to_string(),
            "levels of detail that were interrupted",
            "--resume to go on with them, or --force to begin anew",
        ));
    }
    if there && options.resume {
        match work.begun() {
            Some(begun) => {
                if !options.force {
                    check_begun(&begun, &wanted, out)?;
                }
                if begun.has_nodes_of(&wanted) {
                    work.go_on(&wanted)?;
                    return Ok(true);
                }
            }
            None => progress
                .warn("how the interrupted levels of detail were begun cannot be read: they are begun anew"),
        }
    }
    work.keep(false);
    work.begin(&wanted)?;
    Ok(false)
}

/// Levels in the making.
struct Run<'a> {
    set: &'a TileSet,
    manifest: &'a Manifest,
    options: &'a LodOptions,
    work: std::path::PathBuf,
    pool: Arc<MemoryPool>,
    progress: &'a dyn Progress,
    /// Layers that are done.
    done: u64,
    /// Nodes that are done of layers that are not.
    nodes: AtomicU64,
}

impl Run<'_> {
    fn levels(&mut self) -> Result<Levels> {
        self.check_memory()?;
        let mut all = Levels {
            format: LEVELS_FORMAT.to_owned(),
            format_version: LEVELS_VERSION,
            generator: Generator {
                name: "alvis".to_owned(),
                version: env!("CARGO_PKG_VERSION").to_owned(),
            },
            ratio: self.options.ratio,
            pixel_error: self.options.pixel_error,
            levels: Vec::new(),
        };
        let mut before = self.manifest.totals.triangles;
        loop {
            let plan = LevelPlan::new(self.manifest, all.levels.last(), self.options.ratio)?;
            let level = self.level(&plan, all.levels.last())?;
            let is_root = plan.grid == [1; 3];
            let fewer = level.triangles < before;
            let small = level.triangles <= ROOT || !fewer;
            before = level.triangles;
            all.levels.push(level);
            let most = self
                .options
                .levels
                .is_some_and(|most| plan.level + 1 >= most);
            if most || is_root && small {
                return Ok(all);
            }
        }
    }

    /// Refuses a limit that is too small before anything is made.
    fn check_memory(&self) -> Result<()> {
        let layers = tiling(self.manifest).tiles()[2].div_ceil(2);
        let mut most = 0;
        for z in 0..layers {
            let families = families(self.tiles(z)?);
            most = families.values().map(|f| memory(f)).fold(most, u64::max);
        }
        // nodes have fins that tiles have not: those of the next level may take a fifth more
        let needed = FIXED.saturating_add(most.saturating_add(most / 4));
        match needed <= self.pool.limit() {
            true => Ok(()),
            false => Err(Error::Memory {
                limit: self.pool.limit(),
                needed,
                hint: String::new(),
            }),
        }
    }

    /// The tiles below a layer of nodes.
    fn tiles(&self, z: u32) -> Result<Vec<Entry>> {
        let tiles = tiling(self.manifest).tiles();
        let mut all = Vec::new();
        for layer in self.manifest.layers.iter().filter(|l| l.z / 2 == z) {
            for tile in self.manifest.shard_tiles(self.set.dir(), layer)? {
                let tile = tile?;
                if tile.grid[2] != layer.z || (0..3).any(|a| tile.grid[a] >= tiles[a]) {
                    let found = format!("macrocube {:?}", tile.grid);
                    let path = self.set.dir().join(&layer.path);
                    return Err(Error::format(path, found, "one of the layer and grid"));
                }
                all.push(Entry::of_tile(tile));
            }
        }
        Ok(all)
    }

    /// What lies below a layer of nodes of a level; `below` is the level before it.
    fn children(&self, z: u32, below: Option<&Level>) -> Result<Vec<Entry>> {
        let Some(below) = below else {
            return self.tiles(z);
        };
        let mut all = Vec::new();
        for layer in below.layers.iter().filter(|l| l.z / 2 == z) {
            let shard = NodeShard::open(&self.work, below.level, layer)?;
            all.extend(shard.nodes.into_iter().map(Entry::of_node));
        }
        Ok(all)
    }

    fn level(&mut self, plan: &LevelPlan, below: Option<&Level>) -> Result<Level> {
        let tiling = tiling(self.manifest);
        let mut level = Level {
            level: plan.level,
            macrocube: tiling.macrocube.map(|m| u64::from(m) << plan.level),
            grid: plan.grid,
            step: 1 << plan.shift,
            block: plan.rules.block as u32,
            nodes: 0,
            triangles: 0,
            fin_triangles: 0,
            vertices: 0,
            border_edges: 0,
            cells: 0,
            bytes: 0,
            error_max: 0.0,
            curve_tolerance: 0.0,
            fin_width: 0.0,
            layers: Vec::new(),
        };
        let stage = format!("level {}", plan.level);
        let [x, y, z] = plan.grid.map(u64::from);
        self.progress.begin(&stage, x * y * z);
        let mut cells = IdSet::default();
        let dir = self.work.join(format!("lod/{}", plan.level));
        std::fs::create_dir_all(&dir).map_err(|e| Error::io(&dir, "create the directory", e))?;
        for z in 0..plan.layers() {
            let nodes = match self.kept(plan.level, z) {
                Some(nodes) => nodes,
                None => self.layer(plan, z, below)?,
            };
            self.done += 1;
            self.nodes.store(0, Ordering::Relaxed);
            if nodes.is_empty() {
                continue;
            }
            level
                .layers
                .push(write_shard(&self.work, plan.level, z, &nodes)?);
            nodes.iter().for_each(|node| add(&mut level, &node.entry));
            for cell in nodes.iter().flat_map(|node| &node.cells) {
                cells.insert(*cell);
            }
        }
        level.cells = cells.len();
        Ok(level)
    }

    fn layer(&self, plan: &LevelPlan, z: u32, below: Option<&Level>) -> Result<Vec<Made>> {
        let maker = Maker {
            plan: *plan,
            manifest: self.manifest,
            below: match below {
                None => self.set.dir(),
                Some(_) => &self.work,
            },
            work: &self.work,
            pool: &self.pool,
            threads: crate::sys::simd::threads(self.options.threads),
            progress: self.progress,
            done: &self.nodes,
        };
        maker.layer(z, self.children(z, below)?)
    }

    /// The nodes of a layer that was done before the work was interrupted, if all their files are as they were.
    fn kept(&self, level: u32, z: u32) -> Option<Vec<Made>> {
        let text = std::fs::read(self.work.join(node_shard_path(level, z))).ok()?;
        let shard: NodeShard = serde_json::from_slice(&text).ok()?;
        let made = |entry: NodeEntry| {
            let at = node_path(level, entry.grid) == entry.path && entry.grid[2] == z;
            let bytes = Entry::of_node(entry.clone()).read(&self.work).ok()?;
            let tile = Tile::read_node(&bytes).ok().filter(|_| at)?;
            let rows = tile.primitives.iter().flat_map(|p| match &p.pieces {
                Pieces::Merged(_, ids) => ids.clone(),
                Pieces::One(ids) => vec![*ids],
            });
            let rows: Vec<u64> = rows.map(|ids| ids.cell).collect();
            let surfaces = rows.len().checked_sub(entry.fin_rows as usize)?;
            let cells = rows[..surfaces]
                .iter()
                .copied()
                .filter(|&c| c > 0)
                .collect();
            self.progress.advance(1);
            Some(Made { entry, cells })
        };
        shard.nodes.into_iter().map(made).collect()
    }

    fn is_anything_done(&self) -> bool {
        self.done > 0 || self.nodes.load(Ordering::Relaxed) > 0
    }

    /// An error with what is kept and how to go on.
    fn resumable(&self, error: Error, out: &Path) -> Error {
        let when = match error {
            Error::Interrupted => "",
            _ => "once the cause is removed, ",
        };
        Error::Resumable {
            error: Box::new(error),
            path: out.to_path_buf(),
            done: self.done,
            of: self.layers(),
            next: match self.nodes.load(Ordering::Relaxed) {
                0 => format!("{when}the same command with --resume goes on"),
                n => format!(
                    "{when}the same command with --resume goes on, after {} of the next layer",
                    crate::words::things(n, "node")
                ),
            },
        }
    }

    /// Layers of all levels that lead to one root.
    fn layers(&self) -> u64 {
        let tiles = tiling(self.manifest).tiles();
        let most = tiles.into_iter().max().unwrap_or(1);
        let levels = (1..).take_while(|l| *l == 1 || most.div_ceil(1 << (l - 1)) > 1);
        levels
            .map(|l| u64::from(tiles[2].div_ceil(1 << l)))
            .sum::<u64>()
            .max(self.done)
    }

    /// Writes the index and the tree; returns their bytes and those of lists of nodes.
    fn finish(&self, levels: &Levels) -> Result<u64> {
        let mut text = serde_json::to_vec_pretty(levels).expect("plain data serialises");
        text.push(b'\n');
        write_file(&self.work.join(LEVELS), &[&text])?;
        let version = crate::manifest::checksum_text(crc32fast::hash(&text));
        let tree = tileset_json::Tree {
            set: self.set,
            levels,
            work: &self.work,
            version,
        };
        Ok(text.len() as u64 + bytes_of_shards(levels) + tree.write()?)
    }
}

fn add(level: &mut Level, node: &NodeEntry) {
    level.nodes += 1;
    level.triangles += node.triangles;
    level.fin_triangles += node.fin_triangles;
    level.vertices += node.vertices;
    level.border_edges += node.border_edges;
    level.bytes += node.bytes;
    level.error_max = level.error_max.max(node.error);
    level.curve_tolerance = level.curve_tolerance.max(node.curve_gap);
    level.fin_width = level.fin_width.max(node.fin_width);
}

/// Bytes of the lists of nodes.
fn bytes_of_shards(levels: &Levels) -> u64 {
    let layers = levels.levels.iter().flat_map(|l| &l.layers);
    layers.map(|l| l.bytes).sum()
}

/// What there is; `beside` are the bytes of all files but the nodes.
fn report(levels: &Levels, manifest: &Manifest, beside: u64, start: Instant) -> LodReport {
    let totals = &manifest.totals;
    let all = &levels.levels;
    let sum = |value: fn(&Level) -> u64| all.iter().map(value).sum();
    let with_tiles = |first: u64, value: fn(&Level) -> u64| {
        std::iter::once(first)
            .chain(all.iter().map(value))
            .collect()
    };
    LodReport {
        levels: all.len() as u32 + 1,
        nodes: sum(|l| l.nodes),
        triangles: sum(|l| l.triangles),
        triangles_by_level: with_tiles(totals.triangles, |l| l.triangles),
        bytes: sum(|l| l.bytes) + beside,
        bytes_written: 0,
        error_by_level: std::iter::once(0.0)
            .chain(all.iter().map(|l| l.error_max))
            .collect(),
        border_edges_by_level: std::iter::once(None)
            .chain(all.iter().map(|l| Some(l.border_edges)))
            .collect(),
        cells_by_level: with_tiles(totals.cells, |l| l.cells),
        root_triangles: all.last().map_or(0, |l| l.triangles),
        fin_triangles: sum(|l| l.fin_triangles),
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: peak_rss_bytes(),
    }
}
