//! The memory map: the only `unsafe` code of the volume readers.
//!
//! A mapped file that another program shortens while it is read ends this process with SIGBUS (the
//! command has a handler that says so); the length is checked when the map is made, and the reader
//! with positioned reads is the way out for files that may change.

use crate::error::{Error, Result};
use memmap2::{Advice, Mmap, MmapOptions, UncheckedAdvice};
use std::fs::File;
use std::ops::Range;
use std::path::Path;

/// A read-only map of a part of a file.
#[derive(Debug)]
pub(crate) struct Map {
    map: Mmap,
}

impl Map {
    /// Maps `len` bytes (above 0) from `offset` on. The file must hold them: this is checked here.
    pub(crate) fn new(path: &Path, file: &File, offset: u64, len: u64) -> Result<Self> {
        let found = file.metadata().map_err(|e| Error::io(path, "stat", e))?;
        let end = offset.checked_add(len);
        if end.is_none_or(|end| end > found.len()) {
            return Err(Error::format(
                path,
                format!("{} bytes", found.len()),
                format!("{len} bytes after the first {offset}"),
            ));
        }
        let bytes = usize::try_from(len).map_err(|_| {
            Error::unsupported(
                path,
                format!("mapping {len} bytes on this machine"),
                "use --io read",
            )
        })?;
        // SAFETY: the map is read-only and private to this type, and lies inside the file as it is
        // now. What remains is the duty of the user, which the command's help states: nobody
        // changes or shortens the input while it is read. Samples are plain numbers, of which every
        // bit pattern is valid, so a change can make results wrong but not the types.
        let map = unsafe { MmapOptions::new().offset(offset).len(bytes).map(file) }
            .map_err(|e| Error::io(path, "map", e))?;
        Ok(Map { map })
    }

    /// The mapped bytes.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Asks the system to fetch these bytes ahead. A refusal changes speed only.
    pub(crate) fn prefetch(&self, bytes: Range<u64>) {
        if let Some((start, len)) = self.clip(bytes) {
            let _ = self.map.advise_range(Advice::WillNeed, start, len);
        }
    }

    /// Fetches these bytes now, in one call rather than in a fault for every few pages.
    #[cfg(target_os = "linux")]
    pub(crate) fn populate(&self, bytes: Range<u64>) {
        if let Some((start, len)) = self.clip(bytes) {
            let _ = self.map.advise_range(Advice::PopulateRead, start, len);
        }
    }

    #[cfg(not(target_os = "linux"))]
    pub(crate) fn populate(&self, _bytes: Range<u64>) {}

    /// Gives the pages of these bytes back; reading them again fetches them again.
    pub(crate) fn release(&self, bytes: Range<u64>) {
        if let Some((start, len)) = self.clip(bytes) {
            // SAFETY: MADV_DONTNEED drops pages, which is unsound for private written memory. This
            // map is of a file and never written: the next access reads the same bytes from it.
            let _ = unsafe {
                self.map
                    .unchecked_advise_range(UncheckedAdvice::DontNeed, start, len)
            };
        }
    }

    fn clip(&self, bytes: Range<u64>) -> Option<(usize, usize)> {
        let total = self.map.len();
        let at = |b: u64| usize::try_from(b).unwrap_or(total).min(total);
        let (start, end) = (at(bytes.start), at(bytes.end));
        (start < end).then(|| (start, end - start))
    }
}
