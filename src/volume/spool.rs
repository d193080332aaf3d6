//! A compressed volume, decoded once into a temporary file.

use super::file::FileVolume;
use super::source::FileSource;
use super::{Header, Volume};
use crate::error::{Error, Result};
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes that are decoded and written at a time, unless a row or a chunk has more.
pub(crate) const PIECE: u64 = 8 << 20;
/// Rows of chunks are decoded over the volume's full width if they have at most this many bytes.
const MAX_PIECE: u64 = 64 << 20;

/// Writes the samples of a volume, in the machine's byte order, to an unnamed temporary file in the
/// directory `dir` and returns a volume that reads from there, at random and with the same header.
/// The file needs `voxels * bytes per sample` of disk space and goes away with the volume, also if
/// the process dies.
///
/// # Errors
/// [`Error::Io`] if the file cannot be made or the disk is full; the volume's own errors.
pub fn spool(volume: &dyn Volume, dir: &Path) -> Result<Box<dyn Volume>> {
    let copy = TemporaryCopy::new(volume.header(), dir)?;
    copy.fill(volume, |_| true)?;
    Ok(Box::new(copy.volume))
}

/// Does the same in a thread of its own, while `read` reads from there: boxes whose slices are not there yet are
/// waited for. For volumes that are decoded in the calling thread alone.
///
/// # Errors
/// Those of [`spool`] and of `read`.
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

/// A file for all samples, and the volume in it.
struct TemporaryCopy<'a> {
    file: Arc<File>,
    dir: &'a Path,
    volume: FileVolume,
}

impl<'a> TemporaryCopy<'a> {
    fn new(header: &Header, dir: &'a Path) -> Result<Self> {
        let file = crate::scratch::unnamed(dir)
            .map_err(|e| Error::io(dir, "write a temporary copy of the volume", e))?;
        let file = Arc::new(file);
        let source = FileSource {
            file: file.clone(),
            path: dir.join("(temporary copy of the volume)"),
            offset: 0,
        };
        let volume = FileVolume::new(header.clone(), Box::new(source), false);
        Ok(TemporaryCopy { file, dir, volume })
    }

    /// Writes all slices, and says so to `filled` of each few of them by their end, as long as that is true.
    fn fill(&self, volume: &dyn Volume, filled: impl Fn(u32) -> bool) -> Result<()> {
        let header = volume.header();
        let [nx, ny, nz] = header.dims.0;
        let [gx, gy, gz] = volume.grain();
        let sample = header.dtype.bytes() as u64;
        let row = u64::from(nx) * sample;
        // whole slices if they fit, else whole rows of whole slabs of chunks
        let slices = multiple(PIECE / (row * u64::from(ny)), gz, nz);
        let rows = multiple(PIECE / (row * u64::from(slices)), gy, ny);
        let thick = u64::from(slices) * u64::from(rows);
        let columns = match row * thick <= MAX_PIECE {
            true => nx,
            false => multiple(MAX_PIECE / (sample * thick), gx, nx),
        };
        let mut buffer = Vec::new();
        for z in pieces(nz, slices) {
            for y in pieces(ny, rows) {
                for x in pieces(nx, columns) {
                    buffer.resize(x.len() * y.len() * z.len() * sample as usize, 0);
                    let part = [x.clone(), y.clone(), z.clone()];
                    volume.read_box(x, y.clone(), z.clone(), &mut buffer)?;
                    write(&self.file, header.dims.0, &part, &buffer).map_err(|e| {
                        Error::io(self.dir, "write a temporary copy of the volume", e)
                    })?;
                }
            }
            volume.release(z.clone());
            if !filled(z.end) {
                break;
            }
        }
        Ok(())
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
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
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

    fn read_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let mut state = self.lock();
        while state.slices < z.end.min(self.header().dims.0[2]) {
            if state.ended {
                // the writer's error takes its place
                return Err(Error::Interrupted);
            }
            let woken = self.changed.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
        drop(state);
        self.copy.volume.read_box(x, y, z, out)
    }
}

/// `wanted` as a multiple of `grain`, at least one of them, unless there are only `most`.
pub(super) fn multiple(wanted: u64, grain: u32, most: u32) -> u32 {
    let grain = u64::from(grain.max(1));
    let count = (wanted / grain).max(1) * grain;
    count.min(u64::from(most)) as u32
}

fn pieces(total: u32, step: u32) -> impl Iterator<Item = Range<u32>> {
    (0..total)
        .step_by(step as usize)
        .map(move |at| at..at.saturating_add(step).min(total))
}

/// Writes a box of samples to its place in a file of them all, in as few pieces as it has.
fn write(
    file: &File,
    [nx, ny, _]: [u32; 3],
    [x, y, z]: &[Range<u32>; 3],
    samples: &[u8],
) -> std::io::Result<()> {
    let voxels = x.len() * y.len() * z.len();
    let sample = samples.len() / voxels;
    let whole_rows = x.len() == nx as usize;
    let run = match (whole_rows, y.len() == ny as usize) {
        (true, true) => voxels,
        (true, false) => x.len() * y.len(),
        _ => x.len(),
    };
    for (i, run_of) in samples.chunks_exact(run * sample).enumerate() {
        let first = i * run / x.len();
        let (k, j) = (first / y.len(), first % y.len());
        let row = u64::from(z.start + k as u32) * u64::from(ny) + u64::from(y.start + j as u32);
        let at = (row * u64::from(nx) + u64::from(x.start)) * sample as u64;
        file.write_all_at(run_of, at)?;
    }
    Ok(())
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

        fn read_box(
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

    #[test]
    fn boxes_land_in_their_places() {
        let dims = [5u32, 4, 3];
        let all: Vec<u8> = (0..120).collect();
        for steps in [[5, 4, 3], [5, 4, 1], [5, 3, 2], [2, 3, 2], [1, 1, 1]] {
            let file = tempfile::tempfile().unwrap();
            for z in pieces(3, steps[2]) {
                for y in pieces(4, steps[1]) {
                    for x in pieces(5, steps[0]) {
                        let mut part = Vec::new();
                        for k in z.clone() {
                            for j in y.clone() {
                                let row = ((k * 4 + j) * 5) as usize * 2;
                                let [a, b] = [x.start, x.end].map(|i| row + 2 * i as usize);
                                part.extend(&all[a..b]);
                            }
                        }
                        let asked = [x, y.clone(), z.clone()];
                        write(&file, dims, &asked, &part).unwrap();
                    }
                }
            }
            let mut found = vec![0; 120];
            file.read_exact_at(&mut found, 0).unwrap();
            assert_eq!(found, all, "{steps:?}");
        }
    }
}
