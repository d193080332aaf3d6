//! A volume that can be read forward alone, copied to a temporary file before anything is read from it.

use crate::error::Result;
use crate::volume::adapters::temp_copy::{PIECE, TemporaryCopy};
use crate::volume::io::file::FileVolume;
use crate::volume::{Header, Volume};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

/// A copy of a stream, made by the first who reads: others wait for it. For those who read the same slices again and
/// again, which a stream would have to begin anew for.
pub(crate) struct CopiedFirst<'a> {
    inner: Box<dyn Volume + 'a>,
    dir: PathBuf,
    copy: OnceLock<FileVolume>,
    making: Mutex<()>,
}

impl<'a> CopiedFirst<'a> {
    /// Will copy to an unnamed file in `dir`, which goes away with this, also if the process dies.
    pub(crate) fn new(inner: Box<dyn Volume + 'a>, dir: &Path) -> Self {
        CopiedFirst {
            inner,
            dir: dir.to_path_buf(),
            copy: OnceLock::new(),
            making: Mutex::default(),
        }
    }

    fn copy(&self) -> Result<&FileVolume> {
        if let Some(copy) = self.copy.get() {
            return Ok(copy);
        }
        let _alone = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(copy) = self.copy.get() {
            return Ok(copy);
        }
        let copy = TemporaryCopy::new(self.inner.header(), &self.dir)?;
        copy.fill(&*self.inner, |_| true)?;
        Ok(self.copy.get_or_init(|| copy.volume))
    }
}

impl Volume for CopiedFirst<'_> {
    fn header(&self) -> &Header {
        self.inner.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        self.copy()?.fill_box(x, y, z, out)
    }

    fn held_bytes(&self) -> u64 {
        self.inner.held_bytes() + PIECE
    }

    fn prefetch(&self, z: Range<u32>) {
        if let Some(copy) = self.copy.get() {
            copy.prefetch(z);
        }
    }

    fn release(&self, z: Range<u32>) {
        if let Some(copy) = self.copy.get() {
            copy.release(z);
        }
    }
}
