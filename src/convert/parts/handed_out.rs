//! The file of what merging hands each part: what has come of the components that arrive in it, and of those that leave it.

use crate::convert::label::Seam;
use crate::convert::parts::directory::{Done, FileSum};
use crate::error::{Error, Result};
use crate::sys::state_codec::{Decoder, Encoder};
use bytemuck::Pod;
use std::path::Path;

/// What a part is handed of the components of its seam, in their order, and what stands before that.
pub struct HandedOut<H, V> {
    /// As many as the caller has.
    pub head: Vec<H>,
    /// Of the components of its first slice.
    pub arrivals: Vec<V>,
    /// Of those of its last slice.
    pub leaving: Vec<V>,
}

impl<H: Pod, V: Pod> HandedOut<H, V> {
    /// Writes it to a new file in a directory.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, dir: &Path, name: &str) -> Result<FileSum> {
        let mut out = Encoder::create(&dir.join(name))?;
        out.array(&self.head)?;
        out.array(&self.arrivals)?;
        out.array(&self.leaving)?;
        out.finish()?;
        FileSum::of(dir, name)
    }

    /// Reads that of the part with this seam.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if the file is damaged, or of other components.
    pub fn read<T>(merged: &Done<T>, name: &str, seam: &Seam) -> Result<Self> {
        let (path, _) = merged.file(name)?;
        let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
        let read = Decoder::new(bytes).and_then(|mut input| {
            Some(HandedOut {
                head: input.array()?,
                arrivals: input.array()?,
                leaving: input.array()?,
            })
        });
        let counts = [seam.arrivals.len(), seam.leaving.len()];
        read.filter(|read| [read.arrivals.len(), read.leaving.len()] == counts)
            .ok_or_else(|| {
                Error::format(&path, "other components", "those of the part's own labels")
            })
    }
}
