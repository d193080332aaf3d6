//! The file in the making: beside its final name, with triangles aside where vertices come first.

use super::format::{Coded, Counts, Writer};
use crate::error::{Error, Result};
use crate::sys::atomic_file::{NewFile, directory};
use crate::sys::write_out::WriteOut;
use std::fs::File;
use std::io::{BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 18;

/// A file in the making; dropped before [`Sink::finish`], it leaves nothing behind.
pub(super) struct Sink {
    path: PathBuf,
    /// True if a file of that name is replaced.
    force: bool,
    out: BufWriter<WriteOut<NewFile>>,
    faces: Option<BufWriter<WriteOut<File>>>,
}

impl Sink {
    /// Makes the file with room for its head.
    ///
    /// # Errors
    /// [`Error::FileExists`] without `force`; [`Error::Io`] if it cannot be written where `path` is, or `path` is a directory.
    pub fn create(path: &Path, writer: &dyn Writer, force: bool) -> Result<Self> {
        if !force && path.symlink_metadata().is_ok_and(|m| !m.is_dir()) {
            return Err(exists(path));
        }
        let failed = |e| Error::io(path, "create", e);
        let out = NewFile::create(path).map_err(failed)?;
        let faces = match writer.apart() {
            true => Some(tempfile::tempfile_in(directory(path)).map_err(failed)?),
            false => None,
        };
        let mut sink = Sink {
            path: path.to_path_buf(),
            force,
            out: BufWriter::with_capacity(BUFFER, WriteOut::new(out)),
            faces: faces.map(|f| BufWriter::with_capacity(BUFFER, WriteOut::new(f))),
        };
        sink.push(&Coded {
            vertices: writer.head(&Counts::default()),
            faces: Vec::new(),
        })?;
        Ok(sink)
    }

    fn failed(&self) -> impl Fn(std::io::Error) -> Error + use<> {
        let path = self.path.clone();
        move |e| Error::io(&path, "write", e)
    }

    /// Adds a tile.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, coded: &Coded) -> Result<()> {
        let failed = self.failed();
        self.out.write_all(&coded.vertices).map_err(&failed)?;
        match &mut self.faces {
            Some(faces) => faces.write_all(&coded.faces),
            None => self.out.write_all(&coded.faces),
        }
        .map_err(failed)
    }

    /// Completes the file and gives it its name; returns its bytes.
    ///
    /// # Errors
    /// [`Error::FileExists`] if somebody else made it meanwhile; [`Error::Io`].
    pub fn finish(mut self, head: &[u8]) -> Result<u64> {
        let failed = self.failed();
        if let Some(faces) = self.faces.take() {
            let faces = faces.into_inner().map_err(|e| failed(e.into_error()))?;
            let mut faces = faces.into_inner();
            faces.rewind().map_err(&failed)?;
            self.out.flush().map_err(&failed)?;
            self.out.get_mut().append(&mut faces).map_err(&failed)?;
        }
        let out = self.out.into_inner().map_err(|e| failed(e.into_error()))?;
        let mut out = out.into_inner();
        let bytes = out.seek(SeekFrom::End(0)).map_err(&failed)?;
        out.rewind().map_err(&failed)?;
        out.write_all(head).map_err(&failed)?;
        out.keep(self.force).map_err(|e| match e.kind() {
            ErrorKind::AlreadyExists => exists(&self.path),
            _ => failed(e),
        })?;
        Ok(bytes)
    }
}

fn exists(path: &Path) -> Error {
    Error::FileExists {
        path: path.to_path_buf(),
    }
}
