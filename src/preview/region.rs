//! The region of interest in a slice.

use super::slice::Slice;
use crate::error::Result;
use crate::manifest::Manifest;
use crate::volume::RegionVoxels;

/// The region of interest in a slice.
pub struct SliceRegion {
    /// 1 for voxels inside, 0 for others.
    pub inside: Slice,
    /// The samples, those outside as the tiles' surface takes them.
    pub filled: Slice,
}

impl SliceRegion {
    /// That of a slice of the grid, given the region of the volume before the crop; `None` if there is none.
    ///
    /// # Errors
    /// Those of the region.
    pub fn of(
        slice: &Slice,
        region: Option<&RegionVoxels>,
        manifest: Option<&Manifest>,
    ) -> Result<Option<Self>> {
        let Some(region) = region else {
            return Ok(None);
        };
        let crop = manifest.and_then(|m| m.source.crop.as_ref());
        let inside = slice.inside(&region.cropped(crop)?)?;
        let mut filled = slice.clone();
        if let Some(stated) = manifest.and_then(|m| m.region.as_ref()) {
            let values = filled.values.iter_mut().zip(&inside.values);
            let outside = values.filter(|(_, inside)| **inside == 0.0);
            outside.for_each(|(value, _)| *value = stated.fill_value);
        }
        Ok(Some(SliceRegion { inside, filled }))
    }

    /// The samples, those outside all the same.
    pub fn filled_with(&self, value: f64) -> Slice {
        let mut filled = self.filled.clone();
        let values = filled.values.iter_mut().zip(&self.inside.values);
        let outside = values.filter(|(_, inside)| **inside == 0.0);
        outside.for_each(|(sample, _)| *sample = value);
        filled
    }
}
