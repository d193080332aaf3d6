//! What a sweep holds in memory, and how it gets by with less.

use crate::convert::scan::band::BandSource;
use crate::convert::scan::workspace_pool::WorkspacePool;
use crate::error::{Error, Result};
use crate::sys::background_writer::BackgroundWriters;

/// How much of a slab is in memory at once.
#[derive(Debug, Clone, Copy)]
pub struct Mode {
    /// Bands of it.
    pub bands_at_once: u32,
    /// Bands of the next slabs besides.
    pub ahead: u32,
    /// All bands of the next slab besides those, where components often turn out to be one.
    pub next_slab: bool,
}

impl Mode {
    /// The next one that needs less memory, if there is any.
    fn smaller(self) -> Option<Mode> {
        match self {
            Mode {
                next_slab: true, ..
            } => Some(Mode {
                next_slab: false,
                ..self
            }),
            Mode { ahead: 1.., .. } => Some(Mode { ahead: 0, ..self }),
            Mode {
                bands_at_once: 1, ..
            } => None,
            Mode { bands_at_once, .. } => Some(Mode {
                bands_at_once: bands_at_once / 2,
                ..self
            }),
        }
    }
}

/// What a typed sweep works with.
pub struct Parts<'a, T> {
    /// Makes bands.
    pub source: BandSource<'a, T>,
    /// Buffers for making tiles.
    pub pool: WorkspacePool,
    /// What of a slab is in memory.
    pub mode: Mode,
    /// Bring tiles to the disk, while there is memory for that.
    pub writers: Option<BackgroundWriters>,
}

impl<T> Parts<'_, T> {
    /// Takes the next way that needs less memory, after `error` said that there is not enough.
    ///
    /// # Errors
    /// `error` if there is none; [`Error::Io`] of a tile that was on its way to the disk.
    pub fn shrink(&mut self, error: Error) -> Result<()> {
        if !self.mode.next_slab
            && let Some(writers) = self.writers.take()
        {
            return writers.wait();
        }
        self.mode = self.mode.smaller().ok_or(error)?;
        Ok(())
    }
}
