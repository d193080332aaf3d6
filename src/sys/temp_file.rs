//! Temporary files beside what they are for.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Result};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

static NUMBER: AtomicU64 = AtomicU64::new(0);

/// A new file in `dir` that has no name any more: its space is free again once it is closed, also if
/// the process dies.
///
/// # Errors
/// The system's, if the file cannot be made there.
pub fn unnamed(dir: &Path) -> Result<File> {
    loop {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let path = dir.join(format!(".scratch-{}-{number}", std::process::id()));
        let made = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&path);
        match made {
            // left by a process with this number that was killed between the two calls
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            made => return made.and_then(|file| std::fs::remove_file(&path).map(|()| file)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::FileExt;

    #[test]
    fn the_file_has_no_name_and_works() {
        let dir = tempfile::tempdir().unwrap();
        let file = unnamed(dir.path()).unwrap();
        assert_eq!(dir.path().read_dir().unwrap().count(), 0);
        file.write_all_at(b"abc", 0).unwrap();
        let mut read = [0; 3];
        file.read_exact_at(&mut read, 0).unwrap();
        assert_eq!(&read, b"abc");
        assert!(unnamed(&dir.path().join("missing")).is_err());
    }
}
