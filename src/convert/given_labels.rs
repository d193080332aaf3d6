//! The cells that a volume of labels gives: read before anything else, or slice by slice where these are needed.

use crate::error::Result;
use crate::grid::Crop;
use crate::labels::{CellRows, LabelSums};
use crate::progress::Progress;
use crate::volume::{Stamp, Volume};
use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Cells that a volume of labels gives.
#[derive(Debug, Clone)]
pub struct Labels {
    /// The name of its file, without its directory.
    pub file: String,
    /// See [`PartsBy::Labels`](crate::manifest::PartsBy::Labels).
    pub checksum: String,
    /// The label of each voxel.
    pub rows: LabelRows,
}

/// The label of each voxel.
#[derive(Debug, Clone)]
pub enum LabelRows {
    /// All of them have been read.
    Read(CellRows),
    /// They are read where they are needed.
    OnDemand(Box<LabelVolume>),
}

/// A volume of labels, of which slices are read when they are needed.
#[derive(Clone)]
pub struct LabelVolume {
    /// The volume, which can be read in any order.
    pub volume: Arc<dyn Volume>,
    /// The largest label of all of it; 0 if none is above that.
    pub largest: u64,
    /// What tells it from any other, as of the input.
    pub stamp: Stamp,
}

impl fmt::Debug for LabelVolume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LabelVolume")
            .field("header", self.volume.header())
            .field("largest", &self.largest)
            .finish_non_exhaustive()
    }
}

impl From<CellRows> for LabelRows {
    fn from(rows: CellRows) -> Self {
        LabelRows::Read(rows)
    }
}

impl Labels {
    /// The labels of slices of a crop, with voxels of none in a cell of their own, whose number is one above the largest
    /// label; temporary files lie in `dir`.
    ///
    /// # Errors
    /// Those of reading them; [`crate::Error::InputChanged`].
    pub fn rows(
        &self,
        crop: Option<&Crop>,
        slices: Range<u32>,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<CellRows> {
        let rows = match &self.rows {
            LabelRows::Read(rows) => rows.clone(),
            LabelRows::OnDemand(labels) => {
                let first = crop.map_or(0, |crop| crop.z.start);
                let slices = first + slices.start..first + slices.end;
                let rows = CellRows::of_labels_in(&*labels.volume, slices, dir, progress)?;
                labels.stamp.check()?;
                rows
            }
        };
        Ok(rows.cropped(crop)?.with_none(self.sums().largest + 1))
    }

    /// What all of them tell.
    pub fn sums(&self) -> LabelSums {
        let largest = match &self.rows {
            LabelRows::Read(rows) => rows.largest(),
            LabelRows::OnDemand(labels) => labels.largest,
        };
        LabelSums {
            largest,
            checksum: self.checksum.clone(),
        }
    }

    /// The most memory that they take while they are read by slices, in bytes.
    pub(super) fn held_bytes(&self) -> u64 {
        match &self.rows {
            LabelRows::Read(_) => 0,
            LabelRows::OnDemand(labels) => labels.volume.held_bytes(),
        }
    }

    /// Refuses labels that were changed since they were opened.
    ///
    /// # Errors
    /// [`crate::Error::InputChanged`].
    pub fn check(&self) -> Result<()> {
        match &self.rows {
            LabelRows::Read(_) => Ok(()),
            LabelRows::OnDemand(labels) => labels.stamp.check().map(|_| ()),
        }
    }
}
