//! The pages of a stack, found and decoded one by one.

use crate::error::Result;
use crate::sys::locks::lock;
use crate::volume::formats::tiff::chain::PageAt;
use crate::volume::formats::tiff::ifd;
use crate::volume::formats::tiff::page::{Layout, TiffPage};
use crate::volume::io::blob::Blob;
use crate::volume::io::paged::{Page, Pages};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// The pages of a stack.
pub(crate) struct TiffPages {
    pub(crate) blobs: Vec<Blob>,
    pub(crate) pages: Vec<PageAt>,
    /// Files were found by what the one that was opened says.
    pub(crate) named: bool,
    /// Voxels of the largest chunk that must be decoded, and the most rows of one.
    pub(crate) largest: (u64, u32),
    /// Tags that were read last, so that bands do not read them anew.
    pub(crate) recent: Mutex<Recent>,
}

/// Where the chunks of some pages are.
#[derive(Default)]
pub(crate) struct Recent {
    layouts: HashMap<u32, Arc<Layout>>,
    chunks: usize,
}

/// Chunks whose positions are kept, at 16 bytes each.
const RECENT: usize = 128 << 10;
/// Pages of so few chunks are as fast to look at anew, and thousands of small things that are kept leave holes in
/// memory.
const FEW: usize = 16;

impl Recent {
    fn insert(&mut self, k: u32, layout: Arc<Layout>) {
        if self.chunks + layout.chunks() > RECENT {
            *self = Recent::default();
        }
        self.chunks += layout.chunks();
        if let Some(old) = self.layouts.insert(k, layout) {
            self.chunks -= old.chunks();
        }
    }
}

impl Pages for TiffPages {
    fn page(&self, k: u32) -> Result<Box<dyn Page + '_>> {
        let recent = || lock(&self.recent);
        let at = self.pages[k as usize];
        let bytes = self.blobs[at.blob as usize].open()?;
        let known = recent().layouts.get(&k).cloned();
        let layout = match known {
            Some(layout) => layout,
            None => {
                let (file, _) = ifd::File::open(&bytes)?;
                let dir = file.directory(at.directory)?;
                let layout = Layout::parse(&bytes, &dir, file.endian)?.shifted(at.shift);
                let layout = Arc::new(layout);
                if layout.chunks() > FEW {
                    recent().insert(k, layout.clone());
                }
                layout
            }
        };
        Ok(Box::new(TiffPage { bytes, layout }))
    }

    fn largest(&self) -> (u64, u32) {
        self.largest
    }

    fn files(&self) -> Vec<PathBuf> {
        match self.named {
            true => self
                .blobs
                .iter()
                .map(|blob| blob.path().to_path_buf())
                .collect(),
            false => Vec::new(),
        }
    }
}
