//! Brings files to the disk, behind the conversion.

use crate::error::{Error, Result};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A conversion that has not run for so long is rather done again after a power failure.
const YOUNG: Duration = Duration::from_secs(5);
/// From the beginning of one sync to that of the next.
const PAUSE: Duration = Duration::from_secs(2);
/// What the name of a checkpoint ends with if it and all that it relies on are on the disk.
pub const SAFE: &str = ".safe";

/// Syncs the file system of a work directory in a thread of its own.
#[derive(Debug)]
pub struct Disk {
    work: PathBuf,
    start: Instant,
    /// The files that are published under the name of [`SAFE`] ones once they are on the disk.
    names: &'static [&'static str],
    last: Option<Instant>,
    running: Option<JoinHandle<std::io::Result<()>>>,
    /// The system cannot do it.
    off: bool,
}

impl Disk {
    /// For a conversion that begins now.
    pub fn new(work: &Path, names: &'static [&'static str]) -> Self {
        Disk {
            work: work.to_path_buf(),
            start: Instant::now(),
            names,
            last: None,
            running: None,
            off: false,
        }
    }

    /// True once a sync has begun.
    pub fn is_used(&self) -> bool {
        self.last.is_some() && !self.off
    }

    /// Begins a sync if the conversion has run for some seconds, the last one is over and was not
    /// just now. True if one has begun: it covers all that was written before.
    ///
    /// # Errors
    /// [`Error::Io`] if the last one failed.
    pub fn begin(&mut self) -> Result<bool> {
        if self.running.as_ref().is_some_and(|r| !r.is_finished()) {
            return Ok(false);
        }
        self.wait()?;
        let now = Instant::now();
        let recent = self.last.is_some_and(|last| now - last < PAUSE);
        if self.off || recent || now - self.start < YOUNG {
            return Ok(false);
        }
        self.last = Some(now);
        self.start_sync()?;
        Ok(true)
    }

    fn start_sync(&mut self) -> Result<()> {
        let fail = |e| Error::io(&self.work, "sync", e);
        // here, not in the thread: the conversion goes on to write over the files that are copied
        let copies = copy(&self.work, self.names).map_err(fail)?;
        let work = self.work.clone();
        let thread = std::thread::Builder::new().name("sync".into());
        let begun = thread.spawn(move || publish(&work, copies));
        self.running = Some(begun.map_err(fail)?);
        Ok(())
    }

    /// Waits for the sync that is under way, if there is one.
    ///
    /// # Errors
    /// [`Error::Io`] if it failed. What was written may be lost then although it can still be read, so
    /// checkpoints that are not known to be on the disk are removed.
    pub fn wait(&mut self) -> Result<()> {
        let Some(running) = self.running.take() else {
            return Ok(());
        };
        let Err(error) = running.join().expect("it does not panic") else {
            return Ok(());
        };
        if is_unable(&error) {
            self.off = true;
            return Ok(());
        }
        for name in self.names {
            let _ = std::fs::remove_file(self.work.join(name));
        }
        Err(Error::io(&self.work, "sync", error))
    }

    /// Brings everything to the disk, if that has been done before in this conversion.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(&mut self) -> Result<()> {
        self.wait()?;
        if self.is_used() {
            self.start_sync()?;
        }
        self.wait()
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = self.wait();
    }
}

/// Copies the checkpoints as they are; returns the copies, and the names that they are to get.
fn copy(work: &Path, names: &[&str]) -> std::io::Result<Vec<(PathBuf, PathBuf)>> {
    let mut copies = Vec::new();
    for name in names {
        let (from, to) = (work.join(name), work.join(format!("{name}{SAFE}")));
        let copy = work.join(format!("{name}{SAFE}.new"));
        if from.exists() {
            std::fs::copy(&from, &copy)?;
            copies.push((copy, to));
        }
    }
    Ok(copies)
}

/// Syncs, and publishes the copies that were made before.
fn publish(work: &Path, copies: Vec<(PathBuf, PathBuf)>) -> std::io::Result<()> {
    sync(&File::open(work)?)?;
    for (copy, to) in copies {
        std::fs::rename(copy, to)?;
    }
    Ok(())
}

/// Errors that say that this system does not sync file systems, rather than that it failed.
fn is_unable(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{InvalidInput, Unsupported};
    matches!(error.kind(), InvalidInput | Unsupported)
}

#[cfg(target_os = "linux")]
fn sync(dir: &File) -> std::io::Result<()> {
    use std::os::fd::AsRawFd;
    // SAFETY: the descriptor is open as long as `dir` lives; the call has no other arguments.
    match unsafe { libc::syncfs(dir.as_raw_fd()) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

#[cfg(not(target_os = "linux"))]
fn sync(_dir: &File) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}
