//! Reads tiles ahead of their checks, so that nobody waits for the disk, and takes them from one layer to
//! the next without a stop.
//!
//! When the tiles of each layer were waited for, two threads were busy for 85 % of the time of verifying a
//! foam of 10 million triangles; since the next layer follows at once, and tiles are joined while others
//! are checked, for 93 %.

use super::files::{self, Expected};
use super::index;
use super::report::Issues;
use super::tile::Context;
use crate::direct::Buffer;
use crate::manifest::{Shard, TileEntry};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Tiles per thread that may be read before the result of the first is taken, so that threads seldom wait.
const OPEN: usize = 32;

/// A tile's file as it was read.
pub(super) struct Fetched {
    /// The entry's place in the shard, for messages.
    pub at: String,
    pub file: Buffer,
    /// False if it could not be read.
    pub found: bool,
    pub issues: Issues,
}

/// A tile that is to be checked.
struct Task {
    layer: Arc<Shard>,
    place: usize,
}

/// Tiles that are read in order, by threads of their own and by those who check them, and what these make
/// of them.
pub(super) struct Stream<'a, R> {
    cx: &'a Context<'a>,
    spare: &'a Spare,
    /// Tiles that may wait for their check.
    most: usize,
    /// Tiles that may have been read, or be read now, whose results were not taken.
    most_open: usize,
    state: Mutex<State<R>>,
    /// There is something else to read or to check.
    changed: Condvar,
    /// There is a result.
    finished: Condvar,
}

struct State<R> {
    tasks: VecDeque<Task>,
    /// Number of the first task, and of the first result that was not taken.
    next: u64,
    taken: u64,
    /// Tiles that readers have at hand.
    reading: usize,
    /// Tiles by their numbers, to be checked.
    ready: VecDeque<(u64, Task, Fetched)>,
    results: BTreeMap<u64, R>,
    /// No tile will be added.
    closed: bool,
    /// A check panicked.
    lost: bool,
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

/// Lets all threads end when there is nothing more to do, or one panics.
struct Close<'s, 'a, R>(&'s Stream<'a, R>);

impl<R> Drop for Close<'_, '_, R> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.closed = true;
        state.lost |= std::thread::panicking();
        state.tasks.clear();
        drop(state);
        self.0.changed.notify_all();
        self.0.finished.notify_all();
    }
}

/// Has `check` called, in all threads of `pool`, with the tiles that `body` pushes, while that takes the
/// results.
pub(super) fn stream<R: Send, T>(
    cx: &Context,
    pool: &rayon::ThreadPool,
    spare: &Spare,
    check: impl Fn(&TileEntry, &mut Fetched) -> R + Sync,
    body: impl FnOnce(&Stream<R>) -> T,
) -> T {
    let threads = pool.current_num_threads();
    // a core checks about 450 MB/s: with one reader to four threads, verifying a foam of 10 million triangles
    // took a tenth more time
    let readers = threads;
    let stream = Stream {
        cx,
        spare,
        // as many as are read at once, and two more: they take memory
        most: readers + 2,
        most_open: OPEN * threads,
        state: Mutex::new(State {
            tasks: VecDeque::new(),
            next: 0,
            taken: 0,
            reading: 0,
            ready: VecDeque::new(),
            results: BTreeMap::new(),
            closed: false,
            lost: false,
        }),
        changed: Condvar::new(),
        finished: Condvar::new(),
    };
    let (stream, check) = (&stream, &check);
    std::thread::scope(|threads| {
        for _ in 0..readers {
            // without it, those who check read more themselves
            let _ = std::thread::Builder::new().spawn_scoped(threads, || stream.read());
        }
        pool.in_place_scope(|scope| {
            scope.spawn_broadcast(|_, _| stream.work(check));
            let _close = Close(stream);
            body(stream)
        })
    })
}

impl<R> Stream<'_, R> {
    fn lock(&self) -> MutexGuard<'_, State<R>> {
        // nothing that is done under the lock panics half way
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn sleep<'s>(&self, state: MutexGuard<'s, State<R>>) -> MutexGuard<'s, State<R>> {
        let woken = self.changed.wait(state);
        woken.unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds the tiles of a layer.
    pub fn push(&self, layer: &Arc<Shard>) {
        let task = |place| Task {
            layer: layer.clone(),
            place,
        };
        let tasks = (0..layer.tiles.len()).map(task);
        self.lock().tasks.extend(tasks);
        self.changed.notify_all();
    }

    /// The result of the next tile, which has been pushed; `None` if there will be none, since a check
    /// panicked.
    pub fn result(&self) -> Option<R> {
        let mut state = self.lock();
        loop {
            let number = state.taken;
            if let Some(result) = state.results.remove(&number) {
                state.taken += 1;
                self.changed.notify_all();
                return Some(result);
            }
            if state.lost {
                return None;
            }
            let woken = self.finished.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// What a reader does until all tiles have been read.
    fn read(&self) {
        let _close = Close(self);
        let mut state = self.lock();
        while !state.closed {
            let full = state.ready.len() + state.reading >= self.most;
            if full || !self.has_task(&state) {
                state = self.sleep(state);
                continue;
            }
            state.reading += 1;
            let fetched = self.fetch_next(state);
            state = self.lock();
            state.reading -= 1;
            state.ready.extend(fetched);
            self.changed.notify_all();
        }
    }

    /// What a thread that checks tiles does until there is none.
    fn work(&self, check: &(impl Fn(&TileEntry, &mut Fetched) -> R + Sync)) {
        let _close = Close(self);
        while let Some((number, task, mut fetched)) = self.take() {
            let result = check(&task.layer.tiles[task.place], &mut fetched);
            self.spare.put(fetched.file);
            self.lock().results.insert(number, result);
            self.finished.notify_one();
        }
    }

    /// A tile that is read but not checked, and its number; `None` after the last one.
    fn take(&self) -> Option<(u64, Task, Fetched)> {
        let mut state = self.lock();
        loop {
            if let Some(fetched) = state.ready.pop_front() {
                self.changed.notify_all();
                return Some(fetched);
            }
            if self.has_task(&state) {
                return self.fetch_next(state);
            }
            if state.closed && (state.reading == 0 || state.lost) {
                return None;
            }
            state = self.sleep(state);
        }
    }

    /// True if there is a tile that may be read.
    fn has_task(&self, state: &State<R>) -> bool {
        !state.tasks.is_empty() && state.next - state.taken < self.most_open as u64
    }

    /// Reads the next tile, while others have the state.
    fn fetch_next(&self, mut state: MutexGuard<State<R>>) -> Option<(u64, Task, Fetched)> {
        let task = state.tasks.pop_front()?;
        let number = state.next;
        state.next += 1;
        drop(state);
        let entry = &task.layer.tiles[task.place];
        let fetched = fetch(self.cx, entry, task.place, self.spare);
        Some((number, task, fetched))
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
