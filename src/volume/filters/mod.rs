//! Filters: volumes around a volume that hand out other samples than it has. Each box is the same part of the whole
//! filtered volume, whoever asks for it in whatever pieces.

mod clamp;
mod downsample;
mod each_sample;
mod invert;

use crate::error::Result;
use crate::grid::{Dtype, Filter, Filtered, check_filters};
use crate::volume::adapters::copied_first::CopiedFirst;
use crate::volume::{Opened, Volume};
use std::path::Path;

impl Opened {
    /// The same after filters, in their order: size, place and type of the volume are those that they make of it. A
    /// stream that they would read back and forth is copied to an unnamed file in `scratch` when it is first read.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if a number is out of range, or a filter cannot be applied to what the ones before it
    /// make.
    pub fn filter(mut self, filters: &[Filter], scratch: &Path) -> Result<Self> {
        let before = self.filtered.iter().flat_map(|f| &f.filters);
        check_filters(&before.chain(filters).copied().collect::<Vec<_>>())?;
        if filters.is_empty() {
            return Ok(self);
        }
        let header = self.volume.header();
        let new = Filtered {
            filters: Vec::new(),
            dims: header.dims,
            dtype: header.dtype,
        };
        if !self.volume.random_access() && filters.iter().any(reads_neighbours) {
            self.volume = Box::new(CopiedFirst::new(self.volume, scratch));
        }
        for filter in filters {
            self.notes.extend(note(filter, self.volume.header().dtype));
            self.volume = wrap(filter, self.volume)?;
        }
        let filtered = self.filtered.get_or_insert(new);
        filtered.filters.extend_from_slice(filters);
        Ok(self)
    }
}

/// Puts one filter around a volume.
///
/// # Errors
/// As of [`Opened::filter`].
pub(crate) fn wrap<'a>(
    filter: &Filter,
    inner: Box<dyn Volume + 'a>,
) -> Result<Box<dyn Volume + 'a>> {
    filter.check()?;
    Ok(match *filter {
        Filter::Invert {} => Box::new(invert::inverted(inner)),
        Filter::Clamp { low, high } => Box::new(clamp::clamped(inner, low, high)?),
        Filter::Downsample { .. } => Box::new(downsample::Downsampled::new(inner, filter)?),
    })
}

/// True if a sample depends on those of other slices.
fn reads_neighbours(filter: &Filter) -> bool {
    match filter {
        Filter::Invert {} | Filter::Clamp { .. } => false,
        Filter::Downsample { .. } => true,
    }
}

/// What a user should know of what a filter does to samples of a type.
fn note(filter: &Filter, dtype: Dtype) -> Option<String> {
    match filter {
        Filter::Downsample { .. } if !dtype.is_float() => Some(format!(
            "means of blocks are rounded to whole numbers of {dtype}"
        )),
        _ => None,
    }
}
