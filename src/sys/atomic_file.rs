//! Files that appear under their name whole, or not at all.

use std::borrow::{Borrow, BorrowMut};
use std::fs::{File, Permissions};
use std::io::{ErrorKind, Result, Seek, SeekFrom, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use tempfile::{NamedTempFile, TempPath};

/// Who may read and write, before the user's mask.
const MODE: u32 = 0o666;

/// A file in the making. Dropped before [`NewFile::keep`], it leaves nothing behind.
///
/// Where the system can make files without a name (`O_TMPFILE` of Linux, on most file systems), nothing is left of it
/// if the process is killed, either. Elsewhere it lies beside its final place until then, as `.alvis-….partial`.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    inner: Inner,
}

#[derive(Debug)]
enum Inner {
    Nameless(File),
    Named(NamedTempFile),
}

impl NewFile {
    /// An empty file, which is to be `path`.
    ///
    /// # Errors
    /// If `path` is a directory, or its directory cannot be written to.
    pub fn create(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        let inner = match nameless(directory(path)) {
            Some(file) => Inner::Nameless(file),
            None => Inner::Named(named(directory(path))?),
        };
        Ok(NewFile {
            path: path.to_path_buf(),
            inner,
        })
    }

    /// Gives it its name; one that is there already is replaced, or, without `replace`, stays.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] without `replace`; the system's.
    pub fn keep(self, replace: bool) -> Result<()> {
        let renamed = |path: TempPath| match replace {
            true => path.persist(&self.path),
            false => path.persist_noclobber(&self.path),
        };
        match self.inner {
            Inner::Named(file) => renamed(file.into_temp_path()).map_err(|e| e.error),
            Inner::Nameless(file) => match link(&file, &self.path) {
                // a link replaces nothing, a rename does
                Err(e) if replace && e.kind() == ErrorKind::AlreadyExists => {
                    let beside =
                        builder().make_in(directory(&self.path), |path| link(&file, path))?;
                    renamed(beside.into_temp_path()).map_err(|e| e.error)
                }
                done => done,
            },
        }
    }
}

impl Borrow<File> for NewFile {
    fn borrow(&self) -> &File {
        match &self.inner {
            Inner::Nameless(file) => file,
            Inner::Named(file) => file.as_file(),
        }
    }
}

impl BorrowMut<File> for NewFile {
    fn borrow_mut(&mut self) -> &mut File {
        match &mut self.inner {
            Inner::Nameless(file) => file,
            Inner::Named(file) => file.as_file_mut(),
        }
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        BorrowMut::<File>::borrow_mut(self).write(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        BorrowMut::<File>::borrow_mut(self).flush()
    }
}

impl Seek for NewFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        BorrowMut::<File>::borrow_mut(self).seek(to)
    }
}

/// The directory of a file.
pub fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() => dir,
        _ => Path::new("."),
    }
}

fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".alvis-").suffix(".partial");
    // the default, 0600, would stay with the finished file
    builder.permissions(Permissions::from_mode(MODE));
    builder
}

fn named(dir: &Path) -> Result<NamedTempFile> {
    builder().tempfile_in(dir)
}

/// A file without a name in `dir`, if there can be one that gets a name later.
#[cfg(target_os = "linux")]
fn nameless(dir: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let file = File::options()
        .read(true)
        .write(true)
        .mode(MODE)
        .custom_flags(libc::O_TMPFILE)
        .open(dir)
        .ok()?;
    // what a name is given by
    handle(&file).exists().then_some(file)
}

#[cfg(not(target_os = "linux"))]
fn nameless(_: &Path) -> Option<File> {
    None
}

/// The open file as the system shows it among those of this process.
#[cfg(target_os = "linux")]
fn handle(file: &File) -> PathBuf {
    use std::os::fd::AsRawFd;
    format!("/proc/self/fd/{}", file.as_raw_fd()).into()
}

/// Gives a file without a name this one.
#[cfg(target_os = "linux")]
fn link(file: &File, path: &Path) -> Result<()> {
    use std::ffi::CString;
    use std::os::unix::ffi::OsStrExt;
    let from = CString::new(handle(file).as_os_str().as_bytes())?;
    let to = CString::new(path.as_os_str().as_bytes())?;
    // SAFETY: both names end with a zero byte and live until the call is over.
    let failed = unsafe {
        libc::linkat(
            libc::AT_FDCWD,
            from.as_ptr(),
            libc::AT_FDCWD,
            to.as_ptr(),
            libc::AT_SYMLINK_FOLLOW,
        )
    };
    match failed {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

#[cfg(not(target_os = "linux"))]
fn link(_: &File, _: &Path) -> Result<()> {
    Err(ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    type Make = fn(&Path) -> Result<NewFile>;

    /// Both ways, as far as the system has them.
    fn ways() -> [Make; 2] {
        let named_only = |path: &Path| {
            let inner = Inner::Named(named(directory(path))?);
            let path = path.to_path_buf();
            Ok(NewFile { path, inner })
        };
        [NewFile::create, named_only]
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(dir).unwrap();
        entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_file_is_there_whole_or_not_at_all() {
        for make in ways() {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("file");
            make(&path).unwrap().write_all(b"dropped").unwrap();
            assert!(names(dir.path()).is_empty());
            for text in ["first", "second", ""] {
                let mut file = make(&path).unwrap();
                file.write_all(text.as_bytes()).unwrap();
                file.keep(true).unwrap();
                assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
                assert_eq!(names(dir.path()), ["file"]);
            }
            let mut file = make(&path).unwrap();
            file.write_all(b"another").unwrap();
            assert_eq!(
                file.keep(false).unwrap_err().kind(),
                ErrorKind::AlreadyExists
            );
            assert_eq!(std::fs::read(&path).unwrap(), b"");
            assert_eq!(names(dir.path()), ["file"]);
            let path = dir.path().join("new");
            make(&path).unwrap().keep(false).unwrap();
            assert_eq!(names(dir.path()).len(), 2);
        }
    }

    #[test]
    fn others_may_read_it_as_far_as_the_mask_allows() {
        let dir = tempfile::tempdir().unwrap();
        let usual = dir.path().join("usual");
        std::fs::write(&usual, "").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        for (n, make) in ways().into_iter().enumerate() {
            let path = dir.path().join(n.to_string());
            make(&path).unwrap().keep(true).unwrap();
            assert_eq!(mode(&path), mode(&usual));
        }
    }

    #[test]
    fn a_directory_is_no_file() {
        let dir = tempfile::tempdir().unwrap();
        let made = NewFile::create(dir.path());
        assert_eq!(made.unwrap_err().kind(), ErrorKind::IsADirectory);
        assert!(NewFile::create(&dir.path().join("no/file")).is_err());
    }
}
