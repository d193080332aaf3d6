//! Reads tiles ahead of their checks, so that nobody waits for the disk.

use super::files::{self, Expected};
use super::index;
use super::report::Issues;
use super::tile::Context;
use crate::direct::Buffer;
use crate::manifest::TileEntry;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};

/// Threads that check tiles for each that reads them: a core checks about 150 MB/s.
const CHECKERS: usize = 4;

/// A tile's file as it was read.
pub(super) struct Fetched {
    /// The entry's place in the shard, for messages.
    pub at: String,
    pub file: Buffer,
    /// False if it could not be read.
    pub found: bool,
    pub issues: Issues,
}

/// Tiles of a layer that are read in order, by threads of their own and by those who check them.
struct Ahead<'a> {
    cx: &'a Context<'a>,
    tiles: &'a [TileEntry],
    /// Place of the first one in the shard.
    first: usize,
    /// Tiles that may wait for their check.
    most: usize,
    spare: &'a Spare,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// The next tile to read.
    next: usize,
    /// Tiles that readers have at hand.
    reading: usize,
    /// Tiles by their numbers, to be checked.
    ready: VecDeque<(usize, Fetched)>,
}

/// Buffers for files that nobody uses now.
#[derive(Default)]
pub(super) struct Spare(Mutex<Vec<Buffer>>);

impl Spare {
    fn lock(&self) -> MutexGuard<'_, Vec<Buffer>> {
        self.0.lock().expect("no thread panicked")
    }

    fn take(&self) -> Buffer {
        self.lock().pop().unwrap_or_default()
    }

    pub fn put(&self, buffer: Buffer) {
        self.lock().push(buffer);
    }
}

/// Lets readers end, also when a check panics.
struct Close<'a>(&'a Ahead<'a>);

impl Drop for Close<'_> {
    fn drop(&mut self) {
        self.0.lock().next = self.0.tiles.len();
        self.0.changed.notify_all();
    }
}

/// Has `check` called with all tiles, in each thread of `pool`, and returns what it makes of them in
/// the order of the tiles. `first` is the place of the first one in the shard.
pub(super) fn each<R: Send>(
    cx: &Context,
    pool: &rayon::ThreadPool,
    (tiles, first): (&[TileEntry], usize),
    spare: &Spare,
    check: impl Fn(&TileEntry, &mut Fetched) -> R + Sync,
) -> Vec<R> {
    let readers = pool.current_num_threads().div_ceil(CHECKERS);
    let ahead = Ahead {
        cx,
        tiles,
        first,
        most: 2 * readers,
        spare,
        state: Mutex::default(),
        changed: Condvar::new(),
    };
    let work = || {
        let mut done = Vec::new();
        while let Some((number, mut fetched)) = ahead.take() {
            done.push((number, check(&tiles[number], &mut fetched)));
            spare.put(fetched.file);
        }
        done
    };
    let mut done: Vec<(usize, R)> = std::thread::scope(|scope| {
        for _ in 0..readers {
            // without it, those who check read more themselves
            let _ = std::thread::Builder::new().spawn_scoped(scope, || ahead.read());
        }
        let _close = Close(&ahead);
        pool.broadcast(|_| work()).into_iter().flatten().collect()
    });
    done.sort_unstable_by_key(|&(number, _)| number);
    done.into_iter().map(|(_, result)| result).collect()
}

impl Ahead<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no thread panicked")
    }

    fn sleep<'s>(&self, state: MutexGuard<'s, State>) -> MutexGuard<'s, State> {
        self.changed.wait(state).expect("no thread panicked")
    }

    /// What a reader does until all tiles have been read.
    fn read(&self) {
        let mut state = self.lock();
        while state.next < self.tiles.len() {
            if state.ready.len() + state.reading >= self.most {
                state = self.sleep(state);
                continue;
            }
            state.reading += 1;
            let fetched = self.fetch_next(state);
            state = self.lock();
            state.reading -= 1;
            state.ready.push_back(fetched);
            self.changed.notify_all();
        }
    }

    /// A tile that is read but not checked, and its number; `None` after the last one.
    fn take(&self) -> Option<(usize, Fetched)> {
        let mut state = self.lock();
        loop {
            if let Some(fetched) = state.ready.pop_front() {
                self.changed.notify_all();
                return Some(fetched);
            }
            if state.next < self.tiles.len() {
                return Some(self.fetch_next(state));
            }
            if state.reading == 0 {
                return None;
            }
            state = self.sleep(state);
        }
    }

    /// Reads the next tile, while others have the state.
    fn fetch_next(&self, mut state: MutexGuard<State>) -> (usize, Fetched) {
        let number = state.next;
        state.next += 1;
        drop(state);
        let place = self.first + number;
        let fetched = fetch(self.cx, &self.tiles[number], place, self.spare);
        (number, fetched)
    }
}

/// Reads one tile, whose place in the shard is `place`.
pub(super) fn fetch(cx: &Context, entry: &TileEntry, place: usize, spare: &Spare) -> Fetched {
    let at = format!("{}#/tiles/{place}", index::shard_path(entry.grid[2]));
    let mut issues = Issues::new(cx.max_issues);
    let mut file = spare.take();
    let expected = Expected::tile(entry, &at);
    let found = files::fetch(cx.root, &expected, &mut file, &mut issues);
    Fetched {
        at,
        file,
        found,
        issues,
    }
}
