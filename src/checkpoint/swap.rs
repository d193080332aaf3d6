//! Gives a new file the name of the one before.
//!
//! ext4 writes a file's data out before a rename lets it take the place of another (`auto_da_alloc` in the
//! kernel's description of ext4), for programs that rely on that after a power failure. What needs no such
//! promise swaps the names: in a scan of 166 layers that took 0.05 ms instead of 0.39 ms for each, with the
//! old file removed. It is written over the next time, so that no file is made or removed for each layer:
//! ext4 without a journal passes over all files that were removed in the last minutes whenever it makes one.

use std::io::Result;
use std::path::Path;

/// Renames `new` to `path`, and the old file, where the system can do that, to `new`; true if it did. Whoever
/// looks at `path` meanwhile finds the old file or the new one, whole; after a power failure it may be the new
/// one without its data.
///
/// # Errors
/// The system's.
pub fn replace(new: &Path, path: &Path) -> Result<bool> {
    if swap(new, path) {
        return Ok(true);
    }
    std::fs::rename(new, path).map(|()| false)
}

/// Swaps the names of two files; false if there are not two, or the system cannot do that.
#[cfg(target_os = "linux")]
fn swap(a: &Path, b: &Path) -> bool {
    use std::ffi::CString;
    use std::os::unix::ffi::OsStrExt;
    let name = |path: &Path| CString::new(path.as_os_str().as_bytes());
    let (Ok(a), Ok(b)) = (name(a), name(b)) else {
        return false;
    };
    // SAFETY: both names end with a zero byte and live until the call is over.
    let swapped = unsafe {
        libc::syscall(
            libc::SYS_renameat2,
            libc::AT_FDCWD,
            a.as_ptr(),
            libc::AT_FDCWD,
            b.as_ptr(),
            libc::RENAME_EXCHANGE,
        )
    };
    swapped == 0
}

#[cfg(not(target_os = "linux"))]
fn swap(_: &Path, _: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_new_file_has_the_name_and_the_old_one_that_of_the_new_or_none() {
        let dir = tempfile::tempdir().unwrap();
        let (new, path) = (dir.path().join("new"), dir.path().join("file"));
        let mut old = None;
        for text in ["first", "second", ""] {
            fs::write(&new, text).unwrap();
            let swapped = replace(&new, &path).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
            let left = fs::read_to_string(&new).ok();
            assert_eq!(left, old.filter(|_| swapped).map(String::from));
            old = Some(text);
        }
        let _ = fs::remove_file(&new);
        assert!(replace(&new, &path).is_err(), "there is no new one");
        assert!(path.exists());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn names_are_swapped_where_there_are_two_files() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
        fs::write(&a, "a").unwrap();
        assert!(!swap(&a, &b));
        fs::write(&b, "b").unwrap();
        assert!(swap(&a, &b));
        assert_eq!(fs::read_to_string(&a).unwrap(), "b");
        assert_eq!(fs::read_to_string(&b).unwrap(), "a");
    }
}
