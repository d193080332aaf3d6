//! The sweep over the tiles: layer by layer, while other threads check the tiles ahead of it.

use super::against::{Band, CubeTriangles, Rule, Voxels};
use super::ahead::{self, Fetched, Spare, Stream};
use super::code::Code;
use super::dust::Filled;
use super::foreign;
use super::index::{self, Tiles};
use super::labels::CellLabels;
use super::laws::Found;
use super::ledger::Ledger;
use super::report::Issues;
use super::split;
use super::sweep::Sweep;
use super::tile::{self, Context, Outcome, Samples, Workspace};
use super::walls::WallLedger;
use crate::error::{Error, Result};
use crate::manifest::TileEntry;
use crate::progress::Progress;
use crate::sys::locks::lock;
use crate::volume::Volume;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::iter::Peekable;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard};

/// The volume that the tiles are compared with.
pub(super) struct Original<'a> {
    band: Band<'a>,
    rule: Rule,
    voxels: Voxels,
    /// The labels that cells were made by, if they are there.
    pub labels: Option<CellLabels<'a>>,
}

impl<'a> Original<'a> {
    /// `None` without a volume, or with one of another size, which is an issue.
    ///
    /// # Errors
    /// As of [`Filled::find`].
    pub fn new(
        volume: Option<&'a dyn Volume>,
        cx: &Context,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<Option<Self>> {
        let manifest = cx.manifest;
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
        let filled =
            dust.map(|dust| Filled::find(volume, manifest, dust, cx.edge, progress, issues));
        Ok(Some(Original {
            band: Band::new(volume, filled.transpose()?),
            rule: Rule {
                threshold: manifest.threshold,
                cap: manifest.cap,
                triangles: CubeTriangles::new(manifest.ambiguous),
            },
            voxels: Voxels::default(),
            labels: None,
        }))
    }

    /// The cells of all voxels, where these are split.
    ///
    /// # Errors
    /// As of [`split::find`].
    pub fn split_again(
        &mut self,
        cx: &Context,
        pool: &rayon::ThreadPool,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<Option<CellLabels<'a>>> {
        let (volume, filled) = self.band.take_source();
        let threads = pool.current_num_threads();
        let cells = split::find(volume, filled, cx, threads, progress, issues)?;
        Ok(cells.map(CellLabels::of_split))
    }

    fn samples(&self) -> Samples<'_> {
        Samples {
            band: &self.band,
            rule: &self.rule,
            labels: self.labels.as_ref(),
        }
    }
}

/// The events of the sweep, in order.
enum Event {
    /// A layer begins; false if its tiles cannot be read.
    Begin(u32, bool),
    /// A tile of it.
    Tile,
    /// It ends.
    End(LayerTiles),
}

/// The results of a layer's tiles, complete when all of them have been seen.
#[derive(Default)]
struct LayerTiles {
    z: u32,
    /// Their places, y first.
    places: Vec<[u32; 2]>,
    strips: u64,
}

impl LayerTiles {
    fn new(z: u32) -> Self {
        LayerTiles {
            z,
            ..LayerTiles::default()
        }
    }

    fn add(&mut self, entry: &TileEntry) {
        self.places.push([entry.grid[1], entry.grid[0]]);
        self.strips = self.strips.saturating_add(entry.strips);
    }
}

/// The tiles of a set, layer by layer, on their way to be checked: some beyond those that are joined, so that there
/// is always something to check.
struct Feed<'a> {
    cx: &'a Context<'a>,
    /// Number of the next layer.
    next: usize,
    layer: Option<(Tiles<'a>, LayerTiles)>,
    events: VecDeque<(Event, Issues)>,
}

impl<'a> Feed<'a> {
    fn new(cx: &'a Context<'a>) -> Self {
        Feed {
            cx,
            next: 0,
            layer: None,
            events: VecDeque::new(),
        }
    }

    fn add(&mut self, event: Event, issues: Issues) {
        self.events.push_back((event, issues));
    }

    /// Goes on by one tile, which `check` gets with its place, or to the next layer; false at the end.
    fn advance(&mut self, check: impl FnOnce(TileEntry, u64)) -> bool {
        let mut issues = Issues::new(self.cx.max_issues);
        let Some((tiles, layer)) = &mut self.layer else {
            let Some(layer) = self.cx.manifest.layers.get(self.next) else {
                return false;
            };
            let (root, tiling) = (self.cx.root, self.cx.tiling);
            let tiles = index::shard(root, tiling, self.next, layer, &mut issues);
            self.next += 1;
            self.add(Event::Begin(layer.z, tiles.is_some()), issues);
            self.layer = tiles.map(|tiles| (tiles, LayerTiles::new(layer.z)));
            return true;
        };
        match tiles.next() {
            Some(Ok(entry)) => {
                let place = layer.places.len() as u64;
                layer.add(&entry);
                check(entry, place);
                self.add(Event::Tile, issues);
            }
            Some(Err(e)) => {
                changed(layer.z, &e, &mut issues);
                self.end(issues);
            }
            None => self.end(issues),
        }
        true
    }

    fn end(&mut self, issues: Issues) {
        if let Some((_, layer)) = self.layer.take() {
            self.add(Event::End(layer), issues);
        }
    }
}

/// Runs the sweep.
pub(super) struct Run<'a> {
    cx: &'a Context<'a>,
    pool: &'a rayon::ThreadPool,
    workspaces: Vec<Mutex<Workspace>>,
    spare: Spare,
    progress: &'a dyn Progress,
}

/// The state that the sweep changes.
struct State<'s, 'v> {
    original: Option<Original<'v>>,
    sweep: Sweep,
    found: &'s mut Found,
    issues: &'s mut Issues,
}

impl State<'_, '_> {
    /// All tiles of a layer have been joined.
    fn end_layer(&mut self, layer: &LayerTiles) -> Result<()> {
        self.found.strips = self.found.strips.saturating_add(layer.strips);
        self.sweep.end_layer(layer.z, self.issues)
    }
}

/// The tiles of a layer by rows along x.
struct Row<'a> {
    tiles: Option<Peekable<Tiles<'a>>>,
    /// Those that have been seen.
    layer: LayerTiles,
}

impl Row<'_> {
    /// The next tiles in row `y` of `nx` macrocubes that can be checked at once by so many threads, with their places
    /// in the shard; and where the row goes on behind them.
    fn part(
        &mut self,
        y: u32,
        nx: u32,
        threads: usize,
        issues: &mut Issues,
    ) -> (Vec<(TileEntry, u64)>, u32) {
        let (mut part, mut used) = (Vec::new(), 0u64);
        while let Some(next) = self.tiles.as_mut().and_then(Peekable::peek) {
            if let Ok(entry) = next {
                if entry.grid[1] != y {
                    break;
                }
                used = used.saturating_add(ahead::all_bytes(entry));
                if used > ahead::room(threads) && !part.is_empty() {
                    return (part, entry.grid[0]);
                }
            }
            match self.tiles.as_mut().and_then(Iterator::next) {
                Some(Ok(entry)) => {
                    let place = self.layer.places.len() as u64;
                    self.layer.add(&entry);
                    part.push((entry, place));
                }
                Some(Err(e)) => {
                    changed(self.layer.z, &e, issues);
                    self.tiles = None;
                }
                None => {}
            }
        }
        (part, nx)
    }
}

/// Says that a shard, whose text was sound before, cannot be read again.
fn changed(z: u32, error: &Error, issues: &mut Issues) {
    let message = format!("it was changed meanwhile: {error}");
    issues.add(Code::ShardSyntax, index::shard_path(z), message);
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
            sweep: Sweep::new(
                Ledger::new(self.cx.manifest.cells.is_some()),
                self.cx.manifest.may_gape(),
            ),
            found,
            issues,
        };
        state.sweep.walls = self.cx.walls.map(WallLedger::new);
        if state.original.is_some() {
            self.compare_layers(&mut state)?;
        } else {
            let check = |entry: &TileEntry, fetched: &mut Fetched| {
                tile::check(self.cx, entry, fetched, None, &mut self.workspace())
            };
            ahead::stream(self.cx, self.pool, &self.spare, check, |stream| {
                self.check_layers(stream, &mut state)
            })?;
        }
        if let Some(original) = state.original {
            state.found.voxels = Some(original.voxels);
            if let Some((voxels, contacts)) = original.labels.map(CellLabels::into_ledgers) {
                (state.found.by_cells, state.found.contacts) = (Some(voxels), contacts);
            }
        }
        Ok(state.sweep)
    }

    /// Joins the tiles of all layers, which are checked meanwhile.
    fn check_layers(&self, checks: &Stream<Outcome>, state: &mut State) -> Result<()> {
        let mut feed = Feed::new(self.cx);
        let mut next = 0;
        loop {
            while checks.has_room() && feed.advance(|entry, place| checks.push(entry, place)) {}
            let Some((event, issues)) = feed.events.pop_front() else {
                break;
            };
            state.issues.append(issues);
            match event {
                Event::Begin(z, sound) => {
                    (next..z).try_for_each(|empty| state.end_layer(&LayerTiles::new(empty)))?;
                    next = z + 1;
                    if !sound {
                        state.sweep.lose_layer(z);
                    }
                }
                Event::Tile => match checks.result() {
                    Some(outcome) => self.join(outcome, state)?,
                    // a check that panicked goes on doing so where the pool is left
                    None => return Ok(()),
                },
                Event::End(layer) => {
                    state.end_layer(&layer)?;
                    foreign::foreign_tiles(self.cx.root, layer.z, &layer.places, state.issues)?;
                }
            }
        }
        let all = self.cx.tiling.tiles()[2];
        (next..all).try_for_each(|empty| state.end_layer(&LayerTiles::new(empty)))
    }

    /// Compares the tiles of all layers with the volume and joins them.
    fn compare_layers(&self, state: &mut State) -> Result<()> {
        let mut next = 0;
        for (index, layer) in self.cx.manifest.layers.iter().enumerate() {
            let z = layer.z;
            (next..z).try_for_each(|empty| self.compare_layer(empty, None, state).map(|_| ()))?;
            next = z + 1;
            let (root, tiling) = (self.cx.root, self.cx.tiling);
            let tiles = index::shard(root, tiling, index, layer, state.issues);
            let Some(tiles) = tiles else {
                state.sweep.lose_layer(z);
                continue;
            };
            let layer = self.compare_layer(z, Some(tiles), state)?;
            foreign::foreign_tiles(self.cx.root, z, &layer.places, state.issues)?;
        }
        let all = self.cx.tiling.tiles()[2];
        (next..all).try_for_each(|empty| self.compare_layer(empty, None, state).map(|_| ()))
    }

    /// Compares a layer with the volume, row by row of macrocubes along x, and joins its tiles, if it has any.
    fn compare_layer(&self, z: u32, tiles: Option<Tiles>, state: &mut State) -> Result<LayerTiles> {
        let [nx, rows, _] = self.cx.tiling.tiles();
        let mut row = Row {
            tiles: tiles.map(Iterator::peekable),
            layer: LayerTiles::new(z),
        };
        for y in 0..rows {
            if let Some(original) = &mut state.original {
                let region = self.cx.region([0, y, z]);
                original.band.load([y, z], &region)?;
                if let Some(labels) = &mut original.labels {
                    labels.load(&region)?;
                }
            }
            let mut x = 0;
            while x < nx {
                let (part, end) = row.part(y, nx, self.pool.current_num_threads(), state.issues);
                for outcome in self.compare_part([x..end, y..y + 1, z..z + 1], &part, state) {
                    self.join(outcome, state)?;
                }
                x = end;
            }
        }
        if let Some(original) = &state.original {
            original.band.release();
        }
        state.end_layer(&row.layer)?;
        Ok(row.layer)
    }

    /// Checks a part of a row of macrocubes, empty ones included, and compares it with the volume. Its tiles come
    /// with their places in the shard.
    fn compare_part(
        &self,
        [x, y, z]: [Range<u32>; 3],
        tiles: &[(TileEntry, u64)],
        state: &State,
    ) -> Vec<Outcome> {
        let Some(original) = &state.original else {
            return Vec::new();
        };
        let macrocube = |x| match tiles.binary_search_by_key(&x, |(tile, _)| tile.grid[0]) {
            Ok(i) => self.check(&tiles[i].0, tiles[i].1, original),
            Err(_) => self.empty([x, y.start, z.start], original),
        };
        self.pool
            .install(|| x.into_par_iter().map(macrocube).collect())
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
            if let Some(labels) = &mut original.labels {
                labels.add(&outcome.cells.voxels, &outcome.cells.contacts)?;
            }
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
        lock(&self.workspaces[thread])
    }

    fn check(&self, entry: &TileEntry, place: u64, original: &Original) -> Outcome {
        let mut fetched = ahead::fetch(self.cx, entry, place, &self.spare);
        let original = Some(original.samples());
        let workspace = &mut self.workspace();
        let outcome = tile::check(self.cx, entry, &mut fetched, original, workspace);
        self.spare.put(fetched.file);
        outcome
    }

    fn empty(&self, grid: [u32; 3], original: &Original) -> Outcome {
        tile::empty(self.cx, grid, original.samples(), &mut self.workspace())
    }
}
