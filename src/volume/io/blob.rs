//! A stretch of bytes with a beginning of its own: a file, or a member of an archive.

use crate::error::{Error, Result};
use crate::store::File;
use crate::volume::io::byte_source::FileSource;
use crate::volume::io::data;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where the bytes are. Files in a folder are not held open, since there may be thousands.
#[derive(Debug, Clone)]
pub(crate) struct Blob {
    /// The file, or for messages the archive and the member's name.
    path: PathBuf,
    /// `None`: the file at `path`, opened when it is read.
    file: Option<Arc<File>>,
    whole: bool,
    offset: u64,
    len: u64,
}

impl Blob {
    /// A regular file.
    pub(crate) fn file(path: &Path) -> Result<Self> {
        Ok(Blob {
            path: path.to_path_buf(),
            file: None,
            whole: true,
            offset: 0,
            len: data::file_len(path)?,
        })
    }

    /// `len` bytes from `offset` on of an open file, which must hold them.
    pub(crate) fn part(path: PathBuf, file: Arc<File>, offset: u64, len: u64) -> Self {
        Blob {
            path,
            file: Some(file),
            whole: false,
            offset,
            len,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// True for a file of its own, which others can open by its path.
    pub(crate) fn is_whole(&self) -> bool {
        self.whole
    }

    /// Opens it for reading.
    pub(crate) fn open(&self) -> Result<Bytes> {
        let file = match &self.file {
            Some(file) => file.clone(),
            None => Arc::new(data::open_file(&self.path)?),
        };
        Ok(Bytes {
            path: self.path.clone(),
            file,
            offset: self.offset,
            len: self.len,
        })
    }

    /// The same bytes, held open.
    pub(crate) fn held(&self) -> Result<Blob> {
        let bytes = self.open()?;
        Ok(Blob {
            path: bytes.path,
            file: Some(bytes.file),
            whole: self.whole,
            offset: bytes.offset,
            len: bytes.len,
        })
    }

    /// Samples that lie as they are from `offset` on.
    pub(crate) fn samples(&self, offset: u64) -> Result<FileSource> {
        let bytes = self.open()?;
        Ok(FileSource {
            file: bytes.file,
            path: bytes.path,
            offset: bytes.offset + offset,
        })
    }

    /// The first bytes, at most `most`.
    pub(crate) fn head(&self, most: u64) -> Result<Vec<u8>> {
        let mut head = vec![0; most.min(self.len) as usize];
        self.open()?.read_at(0, &mut head)?;
        Ok(head)
    }
}

/// Open bytes, read at positions: threads need no lock.
#[derive(Debug, Clone)]
pub(crate) struct Bytes {
    path: PathBuf,
    file: Arc<File>,
    offset: u64,
    len: u64,
}

impl Bytes {
    /// The open file, in which these bytes are not all.
    pub(crate) fn file(&self) -> Arc<File> {
        self.file.clone()
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Fills `out` from `position` on.
    ///
    /// # Errors
    /// [`Error::Format`] if the bytes end before, [`Error::Io`] if the system refuses.
    pub(crate) fn read_at(&self, position: u64, out: &mut [u8]) -> Result<()> {
        let end = position.checked_add(out.len() as u64);
        if end.is_none_or(|end| end > self.len) {
            return Err(Error::format(
                &self.path,
                format!("{} bytes", self.len),
                format!("{} bytes at position {position}", out.len()),
            )
            .with_hint("the file is cut short or damaged"));
        }
        crate::volume::io::byte_source::read_at(&self.file, &self.path, self.offset + position, out)
    }

    /// A reader of the bytes of this range, clipped to what there is.
    pub(crate) fn reader(&self, position: u64, len: u64) -> BufReader<Section> {
        let start = position.min(self.len);
        let section = Section {
            file: self.file.clone(),
            start: self.offset + start,
            len: len.min(self.len - start),
            at: 0,
        };
        BufReader::with_capacity((section.len as usize).clamp(1, 64 << 10), section)
    }
}

/// A part of a file as a file of its own.
pub(crate) struct Section {
    file: Arc<File>,
    start: u64,
    len: u64,
    at: u64,
}

impl Read for Section {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let left = self.len.saturating_sub(self.at);
        let wanted = (out.len() as u64).min(left) as usize;
        let n = self
            .file
            .read_at(&mut out[..wanted], self.start + self.at)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for Section {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.len.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(std::io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}
