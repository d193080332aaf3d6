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
use crate::manifest::TileEntry;
use crate::sys::direct_io::Buffer;
use crate::sys::locks::{lock, wait};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard};

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
    entry: TileEntry,
    /// Its place in the shard.
    place: u64,
}

/// Bytes that what was found in tiles may take until it is taken, and bytes, for each thread, of the tiles that are
/// read or checked at a time. A tile that takes more is alone.
const FOUND: u64 = 24 << 20;
const CHECKED: u64 = 8 << 20;
/// Bytes for each piece of a tile: what is found of it and its group, and its node as it is read.
const PIECE_FOUND: u64 = 800;
const PIECE_READ: u64 = 2 << 10;

/// Bytes that what is found in a tile takes, with its entry.
fn found_bytes(entry: &TileEntry) -> u64 {
    entry.groups.len() as u64 * PIECE_FOUND
}

/// Bytes that a tile takes while it is read and checked.
fn checked_bytes(entry: &TileEntry) -> u64 {
    // nodes take twice the text that they are read from; pieces of merged tiles have none
    let nodes = entry.groups.len() as u64 * PIECE_READ;
    let pieces = nodes.min(entry.bytes.saturating_mul(2));
    entry.bytes.saturating_add(pieces)
}

/// Bytes that it takes until what was found in it has been joined.
pub(super) fn all_bytes(entry: &TileEntry) -> u64 {
    checked_bytes(entry).saturating_add(found_bytes(entry))
}

/// Bytes of the tiles that may be checked at a time by so many threads.
pub(super) fn room(threads: usize) -> u64 {
    CHECKED * threads as u64
}

/// Tiles that are read in order, by threads of their own and by those who check them, and what these make
/// of them.
pub(super) struct Stream<'a, R> {
    cx: &'a Context<'a>,
    spare: &'a Spare,
    /// Tiles that may wait for their check.
    most: usize,
    /// Tiles that may be open: pushed, and their results not taken.
    most_open: usize,
    /// Bytes of the tiles that may be read or checked at a time.
    room: u64,
    state: Mutex<State<R>>,
    /// There is something to read; or to read or to check, for those who check. One is woken for each thing.
    to_read: Condvar,
    to_check: Condvar,
    /// There is a result.
    finished: Condvar,
}

struct State<R> {
    tasks: VecDeque<Task>,
    /// Number of the first task.
    next: u64,
    /// What is found in each open tile, in bytes.
    open: VecDeque<u64>,
    /// Number of the first of these.
    taken: u64,
    /// Bytes of the tiles that are read or checked now.
    busy: u64,
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
        lock(&self.0)
    }

    fn take(&self) -> Buffer {
        self.lock().pop().unwrap_or_default()
    }

    /// Keeps a buffer for the next file, unless it is so large that few others need it.
    pub fn put(&self, buffer: Buffer) {
        if buffer.capacity() as u64 <= CHECKED {
            self.lock().push(buffer);
        }
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
        self.0.to_read.notify_all();
        self.0.to_check.notify_all();
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
    let readers = threads.min(2 * crate::sys::simd::threads(0));
    let stream = Stream {
        cx,
        spare,
        // as many as are read at once, and two more: they take memory
        most: readers + 2,
        most_open: OPEN * threads,
        room: room(threads),
        state: Mutex::new(State {
            tasks: VecDeque::new(),
            next: 0,
            open: VecDeque::new(),
            taken: 0,
            busy: 0,
            reading: 0,
            ready: VecDeque::new(),
            results: BTreeMap::new(),
            closed: false,
            lost: false,
        }),
        to_read: Condvar::new(),
        to_check: Condvar::new(),
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
        lock(&self.state)
    }

    /// True if there is room for the next tile, or no other one.
    pub fn has_room(&self) -> bool {
        let state = self.lock();
        let found: u64 = state.open.iter().sum();
        state.open.is_empty() || state.open.len() < self.most_open && found < FOUND
    }

    /// Adds a tile, which has this place in its shard.
    pub fn push(&self, entry: TileEntry, place: u64) {
        let mut state = self.lock();
        state.open.push_back(found_bytes(&entry));
        state.tasks.push_back(Task { entry, place });
        drop(state);
        self.to_read.notify_one();
        self.to_check.notify_one();
    }

    /// The result of the next tile, which has been pushed; `None` if there will be none, since a check
    /// panicked.
    pub fn result(&self) -> Option<R> {
        let mut state = self.lock();
        loop {
            let number = state.taken;
            if let Some(result) = state.results.remove(&number) {
                state.taken += 1;
                state.open.pop_front();
                return Some(result);
            }
            if state.lost {
                return None;
            }
            state = wait(&self.finished, state);
        }
    }

    /// The loop of a reader, until all tiles have been read.
    fn read(&self) {
        let _close = Close(self);
        let mut state = self.lock();
        while !state.closed {
            let full = state.ready.len() + state.reading >= self.most;
            if full || !self.has_task(&state) {
                state = wait(&self.to_read, state);
                continue;
            }
            state.reading += 1;
            let fetched = self.fetch_next(state);
            state = self.lock();
            state.reading -= 1;
            state.ready.extend(fetched);
            self.to_check.notify_one();
        }
    }

    /// The loop of a thread that checks tiles, until there is none.
    fn work(&self, check: &(impl Fn(&TileEntry, &mut Fetched) -> R + Sync)) {
        let _close = Close(self);
        while let Some((number, task, mut fetched)) = self.take() {
            let result = check(&task.entry, &mut fetched);
            self.spare.put(fetched.file);
            let mut state = self.lock();
            state.busy -= checked_bytes(&task.entry);
            state.results.insert(number, result);
            drop(state);
            // there may be room for another one now
            self.to_read.notify_one();
            self.to_check.notify_one();
            self.finished.notify_one();
        }
    }

    /// A tile that is read but not checked, and its number; `None` after the last one.
    fn take(&self) -> Option<(u64, Task, Fetched)> {
        let mut state = self.lock();
        loop {
            if let Some(fetched) = state.ready.pop_front() {
                self.to_read.notify_one();
                return Some(fetched);
            }
            if self.has_task(&state) {
                return self.fetch_next(state);
            }
            if state.closed && (state.reading == 0 || state.lost) {
                return None;
            }
            state = wait(&self.to_check, state);
        }
    }

    /// True if there is a tile that may be read.
    fn has_task(&self, state: &State<R>) -> bool {
        state.tasks.front().is_some_and(|task| {
            state.busy == 0 || state.busy.saturating_add(checked_bytes(&task.entry)) <= self.room
        })
    }

    /// Reads the next tile, while others have the state.
    fn fetch_next(&self, mut state: MutexGuard<State<R>>) -> Option<(u64, Task, Fetched)> {
        let task = state.tasks.pop_front()?;
        let number = state.next;
        state.next += 1;
        state.busy += checked_bytes(&task.entry);
        let more = self.has_task(&state);
        drop(state);
        if more {
            self.to_read.notify_one();
            self.to_check.notify_one();
        }
        let fetched = fetch(self.cx, &task.entry, task.place, self.spare);
        Some((number, task, fetched))
    }
}

/// Reads one tile, whose place in the shard is `place`.
pub(super) fn fetch(cx: &Context, entry: &TileEntry, place: u64, spare: &Spare) -> Fetched {
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
