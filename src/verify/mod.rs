//! The verifier: rebuilds the whole surface from the tiles and proves that it has no hole.
//!
//! It is independent of the conversion: it knows glTF, the lattice, the manifest and the laws, and
//! shares no code with labelling, meshing or the making of strips.
//!
//! # What it proves
//! By the tiles alone:
//! 1. The index is sound, its paths stay inside the directory, and every file is there, of the stated
//!    size and checksum, and no other file is there.
//! 2. Each tile is a GLB laid out as [`crate::tile`] says, with the pieces, counts, box and ids of its
//!    entry. Its vertices lie on the lattice, strictly inside a lattice edge, one per edge; normals
//!    have unit length; triangles have an area and lie in one cube.
//! 3. The surface has no hole: every directed edge occurs once, and its reverse once in the same tile
//!    or in the tile across the plane; what is left lies on the volume's faces, and with caps nothing
//!    is left. Everything is compared as integers in units of voxel / 256.
//! 4. Surfaces are the connected components: each carries one surface, cell and object, no two share
//!    a (cell, object) pair, ids are 1 to n, and surfaces + 1 = objects + cells.
//! 5. The manifest's sums and the tables' measures are those of the rebuilt surface.
//!
//! It cannot see by the tiles alone that a whole component is missing, if the sums were made from what
//! is left. With the volume it proves in addition:
//! 6. Every lattice edge with a sign change has exactly one vertex, at the place that its two samples
//!    give it, no other has one, and each cube has the triangles that its eight bits ask for. Triangles
//!    face from above to below at every vertex, so the bits that the mesh implies are the volume's.
//!
//! # Memory
//! Tiles are streamed. What is kept: the open edges on the planes of one layer of macrocubes, the
//! surfaces that reach them, the shard of a layer, and for each thread a tile. Finished surfaces are
//! sorted on disk. With the volume, a row of macrocubes along x is in memory as well.

mod code;
mod edges;
mod files;
mod index;
mod ledger;
mod piece;
mod report;
mod seen;
mod spill;
mod sweep;
mod tile;

pub use code::Code;
pub use report::{Issue, Report, Severity};

use crate::error::{Error, Result};
use crate::manifest::{Manifest, Primitives, TileEntry};
use crate::progress::Progress;
use crate::volume::Volume;
use ledger::{Kind, Laws, Ledger};
use rayon::prelude::*;
use report::Issues;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;
use sweep::Sweep;
use tile::{Context, Counts, Outcome, Workspace};

/// What [`verify`] is asked for.
#[derive(Clone, Copy)]
pub struct VerifyOptions<'a> {
    /// The volume that the tiles were made from, already cropped as the manifest says.
    pub against: Option<&'a dyn Volume>,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
    /// Findings to keep; the report says how many were left out.
    pub max_issues: usize,
}

impl Default for VerifyOptions<'_> {
    fn default() -> Self {
        VerifyOptions {
            against: None,
            threads: 0,
            max_issues: 1000,
        }
    }
}

/// Verifies the tile set in the directory `dir`. The report is the same for any number of threads,
/// but for its time and memory.
///
/// # Errors
/// [`Error::Io`] if there is no readable `index.json`, or the system refuses to list a directory, to
/// read the volume or to write temporary files; [`Error::Interrupted`] on request. Everything that
/// is wrong with the tile set itself is an issue in the report.
pub fn verify(dir: &Path, options: &VerifyOptions, progress: &dyn Progress) -> Result<Report> {
    let start = Instant::now();
    let root = dir
        .canonicalize()
        .map_err(|e| Error::io(dir, "open the tile set", e))?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads)
        .build()
        .map_err(|e| Error::usage("--threads", options.threads.to_string(), e.to_string()))?;
    let mut issues = Issues::new(options.max_issues);
    let mut found = Found::default();
    if let Some(manifest) = index::manifest(&root, &mut issues)? {
        let cx = Context::new(&root, &manifest, options.max_issues);
        let run = Run {
            cx: &cx,
            pool: &pool,
            workspaces: workspaces(&pool),
            progress,
        };
        foreign_files(&root, &manifest, &mut issues)?;
        let ledger = run.tiles(&mut found, &mut issues)?;
        laws(ledger, &manifest, &mut found, &mut issues)?;
    }
    Ok(report(found, issues, options, start))
}

fn workspaces(pool: &rayon::ThreadPool) -> Vec<Mutex<Workspace>> {
    let one = || Mutex::new(Workspace::default());
    (0..pool.current_num_threads()).map(|_| one()).collect()
}

/// What was counted.
#[derive(Default)]
struct Found {
    counts: Counts,
    tiles: u64,
    strips: u64,
    euler: i64,
    /// Surfaces, cells, objects.
    ids: [u64; 3],
}

fn report(found: Found, issues: Issues, options: &VerifyOptions, start: Instant) -> Report {
    let c = found.counts;
    Report {
        ok: !issues.any_error(),
        against: options.against.is_some(),
        tiles: found.tiles,
        triangles: c.triangles,
        cap_triangles: c.cap_triangles,
        vertices: c.vertices,
        tile_vertices: c.tile_vertices,
        border_edges: c.border_edges,
        surfaces: found.ids[0],
        cells: found.ids[1],
        objects: found.ids[2],
        euler_characteristic: found.euler,
        bytes: c.bytes,
        issues_omitted: issues.omitted,
        issues: issues.list,
        seconds: start.elapsed().as_secs_f64(),
        peak_rss_bytes: report::peak_rss_bytes(),
    }
}

/// Looks for files that the manifest does not name; those of a layer follow with its shard.
fn foreign_files(root: &Path, manifest: &Manifest, issues: &mut Issues) -> Result<()> {
    let names = |f: fn(u32) -> String| manifest.layers.iter().map(|l| f(l.z)).collect();
    let shards: BTreeSet<String> = names(|z| index::shard_path(z).replace("index/", ""));
    files::foreign(root, "index", &shards, issues)?;
    files::foreign(root, "tiles", &names(index::tile_dir), issues)
}

/// The sweep over the tiles.
struct Run<'a> {
    cx: &'a Context<'a>,
    pool: &'a rayon::ThreadPool,
    workspaces: Vec<Mutex<Workspace>>,
    progress: &'a dyn Progress,
}

impl Run<'_> {
    /// Reads all tiles, layer by layer, and returns the finished surfaces.
    fn tiles(&self, found: &mut Found, issues: &mut Issues) -> Result<Ledger> {
        let manifest = self.cx.manifest;
        let mut sweep = Sweep::new(Ledger::new());
        let total = manifest
            .layers
            .iter()
            .map(|l| l.tiles)
            .fold(0, u64::saturating_add);
        self.progress.begin("verify", total);
        for layer in manifest.layers.iter().enumerate() {
            let z = layer.1.z;
            // a layer without an entry has no tiles: what waits on its planes is a hole
            match index::shard(self.cx.root, self.cx.tiling, layer, issues) {
                Some(shard) => {
                    if z > 0 {
                        sweep.end_gap(z - 1, issues)?;
                    }
                    self.layer(&shard.tiles, &mut sweep, found, issues)?;
                    let names = shard
                        .tiles
                        .iter()
                        .map(|t| index::tile_name(t.grid))
                        .collect();
                    let dir = format!("tiles/{}", index::tile_dir(z));
                    files::foreign(self.cx.root, &dir, &names, issues)?;
                    sweep.end_layer(z, issues)?;
                }
                None => sweep.lose_layer(z),
            }
        }
        sweep.end_gap(u32::MAX, issues)?;
        found.counts.edges += sweep.matched;
        Ok(sweep.ledger)
    }

    /// Checks the tiles of a layer in parallel and joins them in order.
    fn layer(
        &self,
        tiles: &[TileEntry],
        sweep: &mut Sweep,
        found: &mut Found,
        issues: &mut Issues,
    ) -> Result<()> {
        let batch = 32 * self.workspaces.len();
        for (b, batch_tiles) in tiles.chunks(batch).enumerate() {
            if self.progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let check = |(i, entry): (usize, &TileEntry)| self.check(b * batch + i, entry);
            let outcomes: Vec<Outcome> = self
                .pool
                .install(|| batch_tiles.par_iter().enumerate().map(check).collect());
            for (outcome, entry) in outcomes.into_iter().zip(batch_tiles) {
                found.tiles += 1;
                found.strips = found.strips.saturating_add(entry.strips);
                found.counts.add(&outcome.counts);
                issues.append(outcome.issues);
                sweep.add(outcome.front, issues)?;
            }
            self.progress.advance(batch_tiles.len() as u64);
        }
        Ok(())
    }

    fn check(&self, index: usize, entry: &TileEntry) -> Outcome {
        let thread = rayon::current_thread_index().unwrap_or(0);
        let mut workspace = match self.workspaces[thread].lock() {
            Ok(workspace) => workspace,
            // a workspace is cleared before use, so a panic elsewhere cannot have spoiled it
            Err(poisoned) => poisoned.into_inner(),
        };
        let at = format!("{}#/tiles/{index}", index::shard_path(entry.grid[2]));
        tile::check(self.cx, entry, &at, &mut workspace)
    }
}

/// Checks what holds between all surfaces, the manifest's sums, and the tables.
fn laws(ledger: Ledger, manifest: &Manifest, found: &mut Found, issues: &mut Issues) -> Result<()> {
    let c = found.counts;
    found.euler = c.vertices as i64 - c.edges as i64 + c.triangles as i64;
    found.ids[0] = ledger.surfaces;
    let mut all = Kind::ALL.map(Laws::new);
    let sorted = ledger.into_sorted()?;
    for (mut rows, laws) in sorted.into_iter().zip(&mut all) {
        let mut own = Issues::new(usize::MAX);
        while let Some(group) = rows.next_group()? {
            laws.add(&group, &mut own);
        }
        if !issues.broken() {
            issues.append(own);
        }
    }
    found.ids = [found.ids[0], all[1].count, all[2].count];
    if !issues.broken() {
        all.iter().for_each(|l| l.finish(issues));
    }
    let [surfaces, cells, objects] = found.ids;
    if !issues.broken() && surfaces > 0 && surfaces + 1 != cells + objects {
        let message = format!(
            "found {surfaces} surfaces, {objects} objects and {cells} cells, expected surfaces + 1 = objects + cells"
        );
        issues.add(Code::Law, "index.json#/totals", message);
    }
    if !issues.broken() {
        totals(manifest, found, issues);
    }
    Ok(())
}

/// Compares the manifest's sums with those of the tiles.
fn totals(manifest: &Manifest, found: &Found, issues: &mut Issues) {
    let (t, c) = (&manifest.totals, &found.counts);
    let strips = manifest.primitives == Primitives::Strips;
    let [surfaces, cells, objects] = found.ids;
    let pairs: [(&str, i128, i128); 15] = [
        ("tiles", t.tiles.into(), found.tiles.into()),
        ("triangles", t.triangles.into(), c.triangles.into()),
        ("vertices", t.vertices.into(), c.vertices.into()),
        (
            "tile_vertices",
            t.tile_vertices.into(),
            c.tile_vertices.into(),
        ),
        ("strips", t.strips.into(), found.strips.into()),
        (
            "strip_indices",
            t.strip_indices.into(),
            if strips { c.indices.into() } else { 0 },
        ),
        ("border_edges", t.border_edges.into(), c.border_edges.into()),
        (
            "euler_characteristic",
            t.euler_characteristic.into(),
            found.euler.into(),
        ),
        (
            "cap_triangles",
            t.cap_triangles.into(),
            c.cap_triangles.into(),
        ),
        ("bytes", t.bytes.into(), c.bytes.into()),
        ("volume6", t.volume6, c.volume6),
        ("surfaces", t.surfaces.into(), surfaces.into()),
        // a volume of one phase has a cell or an object, but no surface that would show it
        (
            "cells",
            t.cells.into(),
            if surfaces > 0 { cells } else { t.cells }.into(),
        ),
        (
            "objects",
            t.objects.into(),
            if surfaces > 0 { objects } else { t.objects }.into(),
        ),
        (
            "objects + cells",
            i128::from(t.objects) + i128::from(t.cells),
            i128::from(surfaces) + 1,
        ),
    ];
    for (name, stated, sum) in pairs {
        if stated != sum {
            let message = format!("found {sum} in the tiles, stated {stated}");
            issues.add(
                Code::TotalsMismatch,
                format!("index.json#/totals/{name}"),
                message,
            );
        }
    }
}
