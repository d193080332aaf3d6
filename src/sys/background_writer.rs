//! Threads that write tiles while others are made.

use crate::error::{Error, Result};
use crate::sys::direct_io::{self, Buffer};
use crate::sys::files::write_body;
use crate::sys::locks::{lock, wait};
use crate::sys::memory_pool::MemoryReservation;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// Threads that make tiles for each that writes them: a core makes about 150 MB/s.
const MAKERS: usize = 4;
/// Tiles that a writer has at hand and to come. With two of them, one in six of a foam's tiles found it
/// busy.
const EACH: usize = 4;

/// Tiles that are on their way at most where `threads` make them.
pub const fn in_flight(threads: usize) -> usize {
    EACH * threads.div_ceil(MAKERS)
}

/// A tile to write.
pub struct Job {
    /// Where to.
    pub path: PathBuf,
    /// Where in the file the body begins; what comes before it is written later.
    pub start: usize,
    /// Its bytes from there to its end.
    pub body: Buffer,
}

/// A job that somebody does.
struct NumberedJob {
    /// Its number among all that were put in the queue.
    number: u64,
    job: Job,
}

/// Writes tiles in threads of its own. A tile that finds all of them busy is written through the page
/// cache by whoever brings it, so a slow disk holds up nothing that memory could take.
pub struct BackgroundWriters {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    /// Bytes that a buffer on its way may have.
    limit: u64,
    /// The memory of these buffers.
    _held: MemoryReservation,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Job>,
    /// Jobs that were put in the queue so far, which numbers them.
    handed: u64,
    /// Numbers of the jobs in hands.
    writing: Vec<u64>,
    /// Buffers that wait for use. With those on their way there are always as many, and all are used in
    /// turn: how much memory they take does not hang on who is faster.
    spare: VecDeque<Buffer>,
    failed: Option<Error>,
    closed: bool,
}

impl BackgroundWriters {
    /// Writers that have `in_flight` tiles on their way at most, whose buffers have `limit` bytes at
    /// most, which `held` takes; `None` for no tiles, or without room for them.
    pub fn new(in_flight: usize, limit: u64, mut held: MemoryReservation) -> Option<Self> {
        held.grow_to(in_flight as u64 * limit).ok()?;
        let shared = Arc::new(Shared::default());
        let one = |i: usize| {
            let shared = shared.clone();
            let named = std::thread::Builder::new().name(format!("write {i}"));
            named.spawn(move || shared.run()).ok()
        };
        let threads: Vec<_> = (0..in_flight / EACH).filter_map(one).collect();
        let buffers = EACH * threads.len();
        shared.lock().spare = (0..buffers).map(|_| Buffer::default()).collect();
        (buffers > 0).then_some(BackgroundWriters {
            shared,
            threads,
            limit,
            _held: held,
        })
    }

    /// Writes a tile now or later. Returns a buffer for the next one.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn put(&self, job: Job) -> Result<Buffer> {
        if job.body.capacity() as u64 <= self.limit {
            let mut state = self.shared.lock();
            if let Some(spare) = state.spare.pop_front() {
                state.queue.push_back(job);
                state.handed += 1;
                drop(state);
                self.shared.changed.notify_all();
                return Ok(spare);
            }
        }
        write_body(&job.path, job.start, job.body.get())?;
        Ok(job.body)
    }

    /// Tiles that were left to be written later, so far.
    pub fn handed(&self) -> u64 {
        self.shared.lock().handed
    }

    /// True if the first `count` of these are written, or have failed.
    pub fn is_done(&self, count: u64) -> bool {
        self.shared.lock().done() >= count
    }

    /// Waits until the first `count` of these are written; helps meanwhile.
    ///
    /// # Errors
    /// [`Error::Io`] of the first of all that could not be.
    pub fn wait_for(&self, count: u64) -> Result<()> {
        let mut state = self.shared.lock();
        while state.done() < count {
            state = match state.take(count) {
                Some(job) => self.shared.write(job, state),
                None => self.shared.sleep(state),
            };
        }
        state.failed.take().map_or(Ok(()), Err)
    }
}

impl Drop for BackgroundWriters {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

impl State {
    /// Jobs that were taken out of the queue so far, hence the number of the first one in it.
    fn taken(&self) -> u64 {
        self.handed - self.queue.len() as u64
    }

    /// Jobs that are done before the first one that is not.
    fn done(&self) -> u64 {
        let in_hands = self.writing.iter().min();
        in_hands.copied().unwrap_or(self.taken())
    }

    /// The next job in the queue if it is one of the first `count`.
    fn take(&mut self, count: u64) -> Option<NumberedJob> {
        let number = self.taken();
        if number >= count {
            return None;
        }
        let job = self.queue.pop_front()?;
        self.writing.push(number);
        Some(NumberedJob { number, job })
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    fn sleep<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        wait(&self.changed, state)
    }

    /// Writes a tile that was taken while others have the state.
    fn write<'a>(
        &'a self,
        taken: NumberedJob,
        state: MutexGuard<'a, State>,
    ) -> MutexGuard<'a, State> {
        drop(state);
        let NumberedJob { number, job } = taken;
        let written = direct_io::write(&job.path, job.start, job.body.get());
        let mut state = self.lock();
        state.writing.retain(|&other| other != number);
        state.spare.push_back(job.body);
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
            if let Some(job) = state.take(u64::MAX) {
                state = self.write(job, state);
            } else if state.closed {
                return;
            } else {
                state = self.sleep(state);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sys::memory_pool::MemoryPool;

    fn room(bytes: u64) -> MemoryReservation {
        MemoryReservation::new(&MemoryPool::new(bytes, "program", 0), "writes")
    }

    fn job(path: PathBuf, body: &[u8], mut buffer: Buffer) -> Job {
        buffer.begin(0, body.len());
        buffer.extend_from_slice(body);
        Job {
            path,
            start: direct_io::SECTOR,
            body: buffer,
        }
    }

    #[test]
    fn every_tile_is_written_whole_whoever_writes_it() {
        let dir = tempfile::tempdir().unwrap();
        let writers = BackgroundWriters::new(2 * EACH, 500_000, room(4_000_000)).unwrap();
        let body = |i: usize| vec![i as u8; 1 + i * 12_345 % 700_000];
        std::thread::scope(|scope| {
            for thread in 0..3 {
                let (writers, dir) = (&writers, dir.path());
                scope.spawn(move || {
                    let mut buffer = Buffer::default();
                    for i in (thread..60).step_by(3) {
                        let job = job(dir.join(i.to_string()), &body(i), buffer);
                        buffer = writers.put(job).unwrap();
                    }
                });
            }
        });
        writers.wait_for(writers.handed()).unwrap();
        assert_eq!(writers.shared.lock().spare.len(), 2 * EACH);
        for i in 0..60 {
            let found = std::fs::read(dir.path().join(i.to_string())).unwrap();
            assert!(
                found == [vec![0; direct_io::SECTOR], body(i)].concat(),
                "{i}"
            );
        }
    }

    #[test]
    fn a_tile_that_cannot_be_written_is_told_of_when_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let writers = BackgroundWriters::new(EACH, 240_000, room(1_000_000)).unwrap();
        let missing = dir.path().join("missing").join("tile");
        let buffer = Buffer::default();
        writers
            .put(job(missing.clone(), &[1; 200_000], buffer))
            .unwrap();
        match writers.wait_for(writers.handed()) {
            Err(Error::Io { path, .. }) => assert_eq!(path, missing),
            other => panic!("{other:?}"),
        }
        writers.wait_for(writers.handed()).unwrap();
    }

    #[test]
    fn those_before_are_waited_for_and_no_others() {
        let dir = tempfile::tempdir().unwrap();
        let (pipe, file) = (dir.path().join("pipe"), dir.path().join("file"));
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let writers = BackgroundWriters::new(EACH, 240_000, room(1_000_000)).unwrap();
        // nobody gets further with a pipe until somebody reads from it, and then no bytes can be placed in it
        for path in [&pipe, &file] {
            let job = job(path.clone(), &[1; 200_000], Buffer::default());
            writers.put(job).unwrap();
        }
        assert_eq!(writers.handed(), 2);
        while writers.shared.lock().writing != [0] {
            std::thread::yield_now();
        }
        writers.wait_for(0).unwrap();
        assert!(writers.is_done(0) && !writers.is_done(1) && !writers.is_done(2));
        std::thread::scope(|scope| {
            scope.spawn(|| std::fs::File::open(&pipe).unwrap());
            match writers.wait_for(1) {
                Err(Error::Io { path, .. }) => assert_eq!(path, pipe),
                other => panic!("{other:?}"),
            }
        });
        writers.wait_for(writers.handed()).unwrap();
        assert!(writers.is_done(2) && file.exists());
    }

    #[test]
    fn without_room_there_are_none() {
        let pool = MemoryPool::new(1_000_000, "program", 0);
        let held = || MemoryReservation::new(&pool, "writes");
        assert!(BackgroundWriters::new(EACH, 300_000, held()).is_none());
        assert!(BackgroundWriters::new(0, 1, held()).is_none());
        drop(BackgroundWriters::new(EACH, 250_000, held()).unwrap());
        held().grow_to(1_000_000).unwrap();
    }
}
