//! A file that is open for reading, here or in a bucket.

use super::{is_remote, remote::Object};
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// An open file, read at positions or forward. An object is the one that was there when it was opened: reading another one
/// in its place is an error.
#[derive(Debug)]
pub(crate) enum File {
    Local(std::fs::File),
    Remote {
        object: Object,
        /// Where it is read next.
        at: AtomicU64,
    },
}

impl File {
    /// Opens a file; of one in a bucket the first bytes come with it.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`]; what the system or the store answers.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        match is_remote(path) {
            true => Ok(Self::remote(Object::open(path)?)),
            false => std::fs::File::open(path).map(File::Local),
        }
    }

    /// The same for a file of which a few parts are read, each once: no more is fetched than is asked for.
    ///
    /// # Errors
    /// As of [`File::open`].
    #[cfg_attr(not(feature = "zarr"), allow(dead_code))]
    pub fn open_for_parts(path: &Path) -> Result<Self> {
        match is_remote(path) {
            true => Ok(Self::remote(Object::open_for_parts(path)?)),
            false => std::fs::File::open(path).map(File::Local),
        }
    }

    pub(super) fn remote(object: Object) -> Self {
        let at = AtomicU64::new(0);
        File::Remote { object, at }
    }

    /// The file of the system, if it is one.
    pub fn local(&self) -> Option<&std::fs::File> {
        match self {
            File::Local(file) => Some(file),
            File::Remote { .. } => None,
        }
    }

    /// The file of the system, or one with the same bytes that goes when it is closed.
    ///
    /// # Errors
    /// What the system or the store answers.
    pub fn on_disk(mut self) -> Result<std::fs::File> {
        if let Some(file) = self.local() {
            return file.try_clone();
        }
        let mut copy = tempfile::tempfile()?;
        std::io::copy(&mut self, &mut copy)?;
        copy.rewind()?;
        Ok(copy)
    }

    /// Bytes of it.
    ///
    /// # Errors
    /// The system's.
    pub fn len(&self) -> Result<u64> {
        match self {
            File::Local(file) => Ok(file.metadata()?.len()),
            File::Remote { object, .. } => Ok(object.len()),
        }
    }

    /// Fills `out` from byte `position` on.
    ///
    /// # Errors
    /// [`ErrorKind::UnexpectedEof`] if it ends before; what the system or the store answers.
    pub fn read_exact_at(&self, out: &mut [u8], position: u64) -> Result<()> {
        match self {
            File::Local(file) => file.read_exact_at(out, position),
            File::Remote { object, .. } => {
                let end = position.checked_add(out.len() as u64);
                match end.is_some_and(|end| end <= object.len()) {
                    true => object.read(position, out),
                    false => Err(ErrorKind::UnexpectedEof.into()),
                }
            }
        }
    }

    /// Reads what there is from byte `position` on, at most what `out` holds; returns how much.
    ///
    /// # Errors
    /// What the system or the store answers.
    pub fn read_at(&self, out: &mut [u8], position: u64) -> Result<usize> {
        match self {
            File::Local(file) => file.read_at(out, position),
            File::Remote { object, .. } => {
                let left = object.len().saturating_sub(position);
                let count = left.min(out.len() as u64) as usize;
                object.read(position, &mut out[..count])?;
                Ok(count)
            }
        }
    }
}

impl From<std::fs::File> for File {
    fn from(file: std::fs::File) -> Self {
        File::Local(file)
    }
}

impl Read for &File {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        match self {
            File::Local(file) => (&mut &*file).read(out),
            File::Remote { at, .. } => {
                let count = self.read_at(out, at.load(Ordering::Relaxed))?;
                at.fetch_add(count as u64, Ordering::Relaxed);
                Ok(count)
            }
        }
    }
}

impl Seek for &File {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        match self {
            File::Local(file) => (&mut &*file).seek(to),
            File::Remote { object, at } => {
                let next = match to {
                    SeekFrom::Start(to) => Some(to),
                    SeekFrom::End(by) => object.len().checked_add_signed(by),
                    SeekFrom::Current(by) => at.load(Ordering::Relaxed).checked_add_signed(by),
                };
                let next = next.ok_or_else(|| Error::from(ErrorKind::InvalidInput))?;
                at.store(next, Ordering::Relaxed);
                Ok(next)
            }
        }
    }
}

impl Read for File {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        (&*self).read(out)
    }
}

impl Seek for File {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        (&*self).seek(to)
    }
}
