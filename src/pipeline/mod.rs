//! The conversion, in the order of its stages.

mod band;
mod forward;
mod options;
mod plan;
mod spool;
mod surfaces;
mod tilefile;

pub use options::{ConvertOptions, ConvertReport};

use crate::error::Result;
use crate::progress::Progress;
use crate::volume::Volume;
use std::path::Path;

/// Converts a volume to a tile set in the directory `out`.
///
/// # Errors
/// See [`crate::Error`]; nothing is left under a final name then.
pub fn convert(
    _volume: &dyn Volume,
    _options: &ConvertOptions,
    _out: &Path,
    _progress: &dyn Progress,
) -> Result<ConvertReport> {
    Err(crate::Error::Interrupted)
}
