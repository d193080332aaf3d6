//! One writer for each output directory: a lock of the system's on a file, which ends with the process.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long to wait for a lock: a process that was killed holds it until the system has taken its memory
/// back.
const PATIENCE: Duration = Duration::from_secs(2);

/// Between two tries.
const PAUSE: Duration = Duration::from_millis(20);

/// Held while a conversion works.
#[derive(Debug)]
pub struct Lock(File);

impl Drop for Lock {
    fn drop(&mut self) {
        // closing is not enough: a process that is just being started may still hold the file
        let _ = self.0.unlock();
    }
}

impl Lock {
    /// Takes the lock at `path`, making the file. `out` is what the user calls the directory.
    ///
    /// # Errors
    /// [`Error::OutputBusy`] if somebody else holds it for longer than a process takes to die;
    /// [`Error::Io`].
    pub fn take(path: &Path, out: &Path) -> Result<Self> {
        let start = Instant::now();
        loop {
            let file = OpenOptions::new()
                .write(true)
                .create(true)
                .truncate(false)
                .open(path)
                .map_err(|e| Error::io(path, "create", e))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) if start.elapsed() < PATIENCE => {
                    std::thread::sleep(PAUSE);
                    continue;
                }
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::OutputBusy {
                        path: out.to_path_buf(),
                    });
                }
                // a file system without locks: nobody can be told from nobody
                Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => {}
                Err(TryLockError::Error(e)) => return Err(Error::io(path, "lock", e)),
            }
            // whoever held it before may have removed the file after it was opened here
            let ours = file.metadata().map_err(|e| Error::io(path, "lock", e))?;
            let there = std::fs::metadata(path);
            if there.is_ok_and(|t| (t.dev(), t.ino()) == (ours.dev(), ours.ino())) {
                return Ok(Lock(file));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_holder_that_ends_soon_is_waited_for() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lock");
        let first = Lock::take(&path, dir.path()).unwrap();
        let dying = std::thread::spawn(move || {
            std::thread::sleep(5 * PAUSE);
            drop(first);
        });
        assert!(Lock::take(&path, dir.path()).is_ok());
        dying.join().unwrap();
    }

    #[test]
    fn the_second_is_refused_while_the_first_lives() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lock");
        let first = Lock::take(&path, dir.path()).unwrap();
        assert!(matches!(
            Lock::take(&path, dir.path()),
            Err(Error::OutputBusy { .. })
        ));
        drop(first);
        let second = Lock::take(&path, dir.path()).unwrap();
        std::fs::remove_file(&path).unwrap();
        // the file of the second is gone: the third makes its own
        let _third = Lock::take(&path, dir.path()).unwrap();
        drop(second);
        assert!(Lock::take(&path, dir.path()).is_err());
    }
}
