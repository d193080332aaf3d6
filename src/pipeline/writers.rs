//! Threads that write tiles while others are made.

use crate::direct::{self, Buffer};
use crate::error::{Error, Result};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// Threads that make tiles for each that writes them: a core makes about 150 MB/s, and a writer waits
/// twice for a core that is busy with making.
const MAKERS: usize = 4;

/// Threads that write for `threads` that make tiles.
const fn writers(threads: usize) -> usize {
    threads.div_ceil(MAKERS)
}

/// Tiles that are on their way at most: each writer has one at hand and one to come.
pub const fn in_flight(threads: usize) -> usize {
    2 * writers(threads)
}

/// A tile to write.
pub struct Job {
    /// Where to.
    pub path: PathBuf,
    /// What comes before the BIN chunk's data.
    pub head: Vec<u8>,
    /// The BIN chunk's data.
    pub body: Buffer,
}

/// Writes tiles in threads of its own. A tile that finds all of them busy is written through the page
/// cache by whoever brings it, so a slow disk holds up nothing that memory could take.
pub struct Writers {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    /// Bytes that a buffer on its way may have.
    limit: usize,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Job>,
    /// Jobs in hands.
    writing: usize,
    /// Buffers of jobs that are done.
    spare: Vec<Buffer>,
    failed: Option<Error>,
    closed: bool,
}

impl Writers {
    /// Writers for `threads` that make tiles, whose buffers have `limit` bytes at most.
    pub fn new(threads: usize, limit: usize) -> Self {
        let shared = Arc::new(Shared::default());
        let one = |i: usize| {
            let shared = shared.clone();
            let named = std::thread::Builder::new().name(format!("write {i}"));
            named.spawn(move || shared.run()).ok()
        };
        // where no thread can be had, there is one less to wait for
        let threads = (0..writers(threads)).filter_map(one).collect();
        Writers {
            shared,
            threads,
            limit,
        }
    }

    /// Writes a tile now or later. Returns a buffer for the next one.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn put(&self, job: Job) -> Result<Buffer> {
        if job.body.capacity() <= self.limit {
            let mut state = self.shared.lock();
            if state.queue.len() + state.writing < 2 * self.threads.len() {
                state.queue.push_back(job);
                let spare = state.spare.pop().unwrap_or_default();
                drop(state);
                self.shared.changed.notify_all();
                return Ok(spare);
            }
        }
        super::write_file(&job.path, &[&job.head, job.body.get()])?;
        Ok(job.body)
    }

    /// Waits until all tiles are written; helps meanwhile.
    ///
    /// # Errors
    /// [`Error::Io`] of the first that could not be.
    pub fn wait(&self) -> Result<()> {
        let mut state = self.shared.lock();
        loop {
            if let Some(job) = state.queue.pop_front() {
                state = self.shared.write(job, state);
            } else if state.writing > 0 {
                state = self.shared.sleep(state);
            } else {
                break;
            }
        }
        state.failed.take().map_or(Ok(()), Err)
    }
}

impl Drop for Writers {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no thread panicked")
    }

    fn sleep<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed.wait(state).expect("no thread panicked")
    }

    /// Writes a tile while others have the state.
    fn write<'a>(&'a self, job: Job, mut state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        state.writing += 1;
        drop(state);
        let written = direct::write(&job.path, &job.head, job.body.get());
        let mut state = self.lock();
        state.writing -= 1;
        state.spare.push(job.body);
        if let Err((what, error)) = written {
            let error = Error::io(&job.path, what, error);
            state.failed.get_or_insert(error);
        }
        self.changed.notify_all();
        state
    }

    /// What a writer does until the end.
    fn run(&self) {
        let mut state = self.lock();
        loop {
            if let Some(job) = state.queue.pop_front() {
                state = self.write(job, state);
            } else if state.closed {
                return;
            } else {
                state = self.sleep(state);
            }
        }
    }
}
