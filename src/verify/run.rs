//! The sweep over the tiles: layer by layer, while other threads check the tiles ahead of it.

use super::against::{Band, CubeTriangles, Rule, Voxels};
use super::ahead::{self, Fetched, Spare, Stream};
use super::code::Code;
use super::dust::Filled;
use super::laws::Found;
use super::ledger::Ledger;
use super::report::Issues;
use super::sweep::Sweep;
use super::tile::{self, Context, Outcome, Workspace};
use super::{files, index};
use crate::error::{Error, Result};
use crate::manifest::{Manifest, Shard, TileEntry};
use crate::progress::Progress;
use crate::volume::Volume;
use rayon::prelude::*;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The volume that the tiles are compared with.
pub(super) struct Original<'a> {
    band: Band<'a>,
    rule: Rule,
    voxels: Voxels,
}

impl<'a> Original<'a> {
    /// `None` without a volume, or with one of another size, which is an issue.
    ///
    /// # Errors
    /// As of [`Filled::find`].
    pub fn new(
        volume: Option<&'a dyn Volume>,
        manifest: &Manifest,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<Option<Self>> {
        let Some(volume) = volume else {
            return Ok(None);
        };
        let (found, grid) = (volume.header().dims, manifest.grid.dims);
        if found != grid {
            let message = format!("found a volume of {found} voxels, expected {grid}");
            issues.add(Code::VolumeMismatch, "index.json#/grid/dims", message);
            return Ok(None);
        }
        let dust = manifest.dust.as_ref();
        let filled = dust.map(|dust| Filled::find(volume, (manifest, dust), progress, issues));
        Ok(Some(Original {
            band: Band::new(volume, filled.transpose()?),
            rule: Rule {
                threshold: manifest.threshold,
                cap: manifest.cap,
                triangles: CubeTriangles::new(manifest.ambiguous),
            },
            voxels: Voxels::default(),
        }))
    }
}

/// A layer's shard, `None` if it cannot be used, and what was found in it.
struct Loaded {
    shard: Option<Arc<Shard>>,
    issues: Issues,
}

/// The checks of tiles, if they need no volume.
type Checks<'s, 'c> = Option<&'s Stream<'c, Outcome>>;

/// Runs the sweep.
pub(super) struct Run<'a> {
    cx: &'a Context<'a>,
    pool: &'a rayon::ThreadPool,
    workspaces: Vec<Mutex<Workspace>>,
    spare: Spare,
    progress: &'a dyn Progress,
}

/// What the sweep changes.
struct State<'s, 'v> {
    original: Option<Original<'v>>,
    sweep: Sweep,
    found: &'s mut Found,
    issues: &'s mut Issues,
}

impl<'a> Run<'a> {
    pub fn new(cx: &'a Context, pool: &'a rayon::ThreadPool, progress: &'a dyn Progress) -> Self {
        let one = |_| Mutex::new(Workspace::default());
        Run {
            cx,
            pool,
            workspaces: (0..pool.current_num_threads()).map(one).collect(),
            spare: Spare::default(),
            progress,
        }
    }

    /// Reads all tiles, layer by layer, and returns the front with the finished surfaces.
    ///
    /// # Errors
    /// The volume's, the ledger's, or [`Error::Interrupted`].
    pub fn tiles(
        &self,
        original: Option<Original>,
        found: &mut Found,
        issues: &mut Issues,
    ) -> Result<Sweep> {
        let layers = &self.cx.manifest.layers;
        let total = layers.iter().map(|l| l.tiles).fold(0, u64::saturating_add);
        self.progress.begin("verify", total);
        let mut state = State {
            original,
            sweep: Sweep::new(Ledger::new()),
            found,
            issues,
        };
        if state.original.is_some() {
            self.layers(None, &mut state)?;
        } else {
            let check = |entry: &TileEntry, fetched: &mut Fetched| {
                tile::check(self.cx, entry, fetched, None, &mut self.workspace())
            };
            ahead::stream(self.cx, self.pool, &self.spare, check, |stream| {
                self.layers(Some(stream), &mut state)
            })?;
        }
        state.found.voxels = state.original.map(|o| o.voxels);
        Ok(state.sweep)
    }

    /// Goes through all layers. The next one is read before the tiles of one are joined, so that there is
    /// always something to check.
    fn layers(&self, checks: Checks, state: &mut State) -> Result<()> {
        let layers = &self.cx.manifest.layers;
        let mut loaded = self.load(0, checks);
        let mut next = 0;
        for (i, layer) in layers.iter().enumerate() {
            let z = layer.z;
            for empty in next..z {
                self.layer(empty, &[], checks, state)?;
            }
            next = z + 1;
            let Some(Loaded { shard, issues }) = loaded.take() else {
                break;
            };
            loaded = self.load(i + 1, checks);
            state.issues.append(issues);
            let Some(shard) = shard else {
                state.sweep.lose_layer(z);
                continue;
            };
            self.layer(z, &shard.tiles, checks, state)?;
            let names = shard
                .tiles
                .iter()
                .map(|t| index::tile_name(t.grid))
                .collect();
            let dir = format!("tiles/{}", index::tile_dir(z));
            files::foreign(self.cx.root, &dir, &names, state.issues)?;
        }
        for empty in next..self.cx.tiling.tiles()[2] {
            self.layer(empty, &[], checks, state)?;
        }
        Ok(())
    }

    /// Reads the shard of layer number `index`, if there is one, and has its tiles checked.
    fn load(&self, index: usize, checks: Checks) -> Option<Loaded> {
        let layer = self.cx.manifest.layers.get(index)?;
        let mut issues = Issues::new(self.cx.max_issues);
        let shard = index::shard(self.cx.root, self.cx.tiling, (index, layer), &mut issues);
        let shard = shard.map(Arc::new);
        if let (Some(shard), Some(checks)) = (&shard, checks) {
            checks.push(shard);
        }
        Some(Loaded { shard, issues })
    }

    /// Joins the tiles of a layer in order; compares them with the volume first, if there is one.
    fn layer(&self, z: u32, tiles: &[TileEntry], checks: Checks, state: &mut State) -> Result<()> {
        let [_, rows, _] = self.cx.tiling.tiles();
        let mut first = 0;
        if let Some(checks) = checks {
            // a check that panicked goes on doing so where the pool is left
            for outcome in tiles.iter().map_while(|_| checks.result()) {
                self.join(outcome, state)?;
            }
        } else {
            for row in 0..rows {
                let count = tiles[first..].partition_point(|t| t.grid[1] == row);
                let batch = &tiles[first..first + count];
                for outcome in self.compare_row([row, z], batch, first, state)? {
                    self.join(outcome, state)?;
                }
                first += count;
            }
            if let Some(original) = &state.original {
                original.band.release();
            }
        }
        let strips = tiles.iter().map(|t| t.strips);
        state.found.strips = strips.fold(state.found.strips, u64::saturating_add);
        state.sweep.end_layer(z, state.issues)
    }

    /// Checks a row of macrocubes along x, empty ones included, and compares it with the volume.
    /// `first` is the place of the row's first tile in the shard.
    fn compare_row(
        &self,
        [y, z]: [u32; 2],
        tiles: &[TileEntry],
        first: usize,
        state: &mut State,
    ) -> Result<Vec<Outcome>> {
        let Some(original) = &mut state.original else {
            return Ok(Vec::new());
        };
        original.band.load([y, z], &self.cx.region([0, y, z]))?;
        let original = &*original;
        let [nx, _, _] = self.cx.tiling.tiles();
        let macrocube = |x| match tiles.binary_search_by_key(&x, |t| t.grid[0]) {
            Ok(i) => self.check(&tiles[i], first + i, original),
            Err(_) => self.empty([x, y, z], original),
        };
        Ok(self
            .pool
            .install(|| (0..nx).into_par_iter().map(macrocube).collect()))
    }

    /// Adds what was found in the next tile.
    fn join(&self, outcome: Outcome, state: &mut State) -> Result<()> {
        if self.progress.interrupted() {
            return Err(Error::Interrupted);
        }
        state.found.counts.add(&outcome.counts);
        state.issues.append(outcome.issues);
        if let Some(original) = &mut state.original {
            original.voxels.above += outcome.voxels.above;
            original.voxels.nan += outcome.voxels.nan;
        }
        if let Some(front) = outcome.front {
            state.found.tiles += 1;
            self.progress.advance(1);
            state.sweep.add(front, state.issues)?;
        }
        Ok(())
    }

    fn workspace(&self) -> MutexGuard<'_, Workspace> {
        let thread = rayon::current_thread_index().unwrap_or(0);
        // a workspace is cleared before use, so a panic elsewhere cannot have spoiled it
        self.workspaces[thread]
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn check(&self, entry: &TileEntry, index: usize, original: &Original) -> Outcome {
        let mut fetched = ahead::fetch(self.cx, entry, index, &self.spare);
        let original = Some((&original.band, &original.rule));
        let workspace = &mut self.workspace();
        let outcome = tile::check(self.cx, entry, &mut fetched, original, workspace);
        self.spare.put(fetched.file);
        outcome
    }

    fn empty(&self, grid: [u32; 3], original: &Original) -> Outcome {
        let original = (&original.band, &original.rule);
        tile::empty(self.cx, grid, original, &mut self.workspace())
    }
}
