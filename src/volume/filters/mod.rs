//! Filters: volumes around a volume that hand out other samples than it has.
//!
//! A value depends on the volume alone, to the last bit: not on the box that is asked for, nor on what was read before.
//! Where one is made of those around it, copies of the outermost voxels lie beyond the edges of the volume (`nearest` in
//! `scipy.ndimage`). A stream is read forward, and what of it is needed again is kept.

mod clamp;
mod downsample;
mod each_sample;
pub(crate) mod gaussian_kernel;
mod invert;
pub(crate) mod median;
mod median_network;
mod neighbourhood;
mod ordered;
pub(crate) mod smooth;
#[cfg(test)]
mod tests;

use crate::error::Result;
use crate::grid::{Dtype, Filter, Filtered, check_filters};
use crate::volume::{Opened, Volume};

impl Opened {
    /// The same after filters, in their order: size, place and type of the volume are those that they make of it.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] if a number is out of range, or a filter cannot be applied to what the ones before it
    /// make.
    pub fn filter(mut self, filters: &[Filter]) -> Result<Self> {
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
        for filter in filters {
            self.notes.extend(note(filter, self.volume.header().dtype));
            self.volume = filtered(filter, self.volume)?;
        }
        let all = self.filtered.get_or_insert(new);
        all.filters.extend_from_slice(filters);
        Ok(self)
    }
}

/// A volume after a filter.
///
/// # Errors
/// As of [`Opened::filter`].
pub fn filtered<'a>(filter: &Filter, inner: Box<dyn Volume + 'a>) -> Result<Box<dyn Volume + 'a>> {
    filter.check()?;
    Ok(match *filter {
        Filter::Invert {} => Box::new(invert::inverted(inner)),
        Filter::Clamp { low, high } => Box::new(clamp::clamped(inner, low, high)?),
        Filter::Downsample { .. } => Box::new(downsample::Downsampled::new(inner, filter)?),
        Filter::Smooth { sigma } => Box::new(smooth::Smoothed::along_axes(inner, sigma.0)?),
        Filter::Median { radius } => Box::new(median::Medianed::new(inner, radius)?),
    })
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
