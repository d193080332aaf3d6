//! A compressed volume, decoded into a temporary file while it is read from there.

use crate::error::{Error, Result};
use crate::sys::locks::{lock, wait};
use crate::volume::adapters::temp_copy::TemporaryCopy;
use crate::volume::{Header, Volume};
use std::ops::Range;
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard};

/// Copies a volume like [`spool`], in a thread of its own, while `read` reads from the copy: a box whose slices
/// are not there yet is waited for. For volumes that a single thread decodes. Slices that `read` did not ask for
/// may be missing from the copy when it returns.
///
/// # Errors
/// Those of [`spool`] and of `read`.
///
/// [`spool`]: crate::volume::adapters::temp_copy()
pub(crate) fn spool_beside<R>(
    volume: &dyn Volume,
    dir: &Path,
    read: impl FnOnce(&dyn Volume) -> Result<R>,
) -> Result<R> {
    let copy = TemporaryCopy::new(volume.header(), dir)?;
    let filling = Filling {
        copy: &copy,
        state: Mutex::default(),
        changed: Condvar::new(),
    };
    let made = std::thread::scope(|scope| {
        let fill = || filling.fill(volume);
        let thread = std::thread::Builder::new().name("unpack".into());
        let thread = thread.spawn_scoped(scope, fill);
        let thread = thread.map_err(|e| Error::io(dir, "start a thread for unpacking into", e))?;
        let stop = Stop(&filling);
        let made = read(&filling);
        drop(stop);
        match thread.join() {
            Ok(()) => made,
            Err(panic) => std::panic::resume_unwind(panic),
        }
    });
    // what readers were told is that there is nothing to wait for
    let failed = filling.lock().failed.take();
    match failed {
        Some(error) if made.is_err() => Err(error),
        _ => made,
    }
}

/// A copy that is being written.
struct Filling<'a> {
    copy: &'a TemporaryCopy<'a>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Slices that are there.
    slices: u32,
    /// No others will come.
    ended: bool,
    /// Why not.
    failed: Option<Error>,
    /// Nobody reads any more.
    stopped: bool,
}

impl Filling<'_> {
    fn lock(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }

    fn fill(&self, volume: &dyn Volume) {
        let end = End(self);
        let filled = |slices| {
            let mut state = self.lock();
            state.slices = slices;
            self.changed.notify_all();
            !state.stopped
        };
        let done = self.copy.fill(volume, filled);
        self.lock().failed = done.err();
        drop(end);
    }
}

/// Tells readers that the last slice has come, whatever it was that ended it.
struct End<'a>(&'a Filling<'a>);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

/// Tells the writer that nobody reads any more, also if a reader panics.
struct Stop<'a>(&'a Filling<'a>);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.lock().stopped = true;
    }
}

impl Volume for Filling<'_> {
    fn header(&self) -> &Header {
        self.copy.volume.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let mut state = self.lock();
        while state.slices < z.end.min(self.header().dims.0[2]) {
            if state.ended {
                // the writer's error takes its place
                return Err(Error::Interrupted);
            }
            state = wait(&self.changed, state);
        }
        drop(state);
        self.copy.volume.read_box(x, y, z, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slices of one byte each, their own numbers, that come when they are let; slice `broken` never does.
    struct Slow {
        header: Header,
        broken: u32,
        turns: Mutex<std::sync::mpsc::Receiver<()>>,
    }

    impl Slow {
        fn new(broken: u32) -> (std::sync::mpsc::Sender<()>, Slow) {
            let (turn, turns) = std::sync::mpsc::channel();
            // pieces of one slice each
            let dims = crate::grid::Dims([2048, 4096, 6]);
            let header = Header {
                format: "test",
                dims,
                dtype: crate::volume::Dtype::U8,
                endian: crate::volume::Endian::NATIVE,
                placement: Default::default(),
            };
            let turns = Mutex::new(turns);
            let slow = Slow {
                header,
                broken,
                turns,
            };
            (turn, slow)
        }
    }

    impl Volume for Slow {
        fn header(&self) -> &Header {
            &self.header
        }

        fn fill_box(
            &self,
            _: Range<u32>,
            _: Range<u32>,
            z: Range<u32>,
            out: &mut [u8],
        ) -> Result<()> {
            let _ = self.turns.lock().unwrap().recv();
            assert_eq!(z.len(), 1);
            out.fill(z.start as u8);
            match z.start == self.broken {
                true => Err(Error::usage("slice", "broken", "a whole one")),
                false => Ok(()),
            }
        }

        fn random_access(&self) -> bool {
            false
        }
    }

    fn slice(volume: &dyn Volume, k: u32) -> Result<u8> {
        let mut out = [9];
        volume.read_box(5..6, 7..8, k..k + 1, &mut out)?;
        Ok(out[0])
    }

    #[test]
    fn slices_are_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let (turn, slow) = Slow::new(99);
        let read = |volume: &dyn Volume| {
            for k in 0..6 {
                turn.send(()).unwrap();
                assert_eq!(slice(volume, k)?, k as u8);
                assert_eq!(slice(volume, 0)?, 0);
            }
            Ok("done")
        };
        assert_eq!(spool_beside(&slow, dir.path(), read).unwrap(), "done");
    }

    #[test]
    fn whoever_waits_hears_of_failures() {
        let dir = tempfile::tempdir().unwrap();
        let (turn, slow) = Slow::new(2);
        drop(turn);
        let read = |volume: &dyn Volume| {
            let all = std::thread::scope(|scope| {
                let wait = || slice(volume, 4);
                [scope.spawn(wait), scope.spawn(wait)].map(|thread| thread.join().unwrap())
            });
            assert_eq!(slice(volume, 1)?, 1);
            all.into_iter().collect::<Result<Vec<u8>>>()
        };
        let error = spool_beside(&slow, dir.path(), read).unwrap_err();
        assert!(error.to_string().contains("a whole one"), "{error}");
        // who did not need it does not hear of it
        let (turn, slow) = Slow::new(2);
        drop(turn);
        assert_eq!(spool_beside(&slow, dir.path(), |v| slice(v, 1)).unwrap(), 1);
    }

    #[test]
    fn a_reader_that_stops_is_not_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let (turn, slow) = Slow::new(99);
        let read = move |volume: &dyn Volume| {
            turn.send(()).unwrap();
            slice(volume, 0)?;
            // slices come by themselves from here on
            drop(turn);
            Err::<(), _>(Error::usage("the reader", "enough", "more"))
        };
        let error = spool_beside(&slow, dir.path(), read).unwrap_err();
        assert!(error.to_string().contains("enough"), "{error}");
    }
}
