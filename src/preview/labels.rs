//! The cells of a slice by the labels that they were made by.

use super::slice::Slice;
use crate::error::{Error, Result};
use crate::manifest::{Manifest, PartsBy};
use crate::table::Table;
use crate::volume::{Cropped, Volume};
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// The volume of labels of a tile set, of the size that the scan has before it is cropped.
#[derive(Clone)]
pub struct LabelVolume(pub Arc<dyn Volume>);

impl fmt::Debug for LabelVolume {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "labels of {:?}", self.0.header())
    }
}

impl LabelVolume {
    /// The cell of each voxel of a slice of the scan, 0 of those above and of those without one.
    ///
    /// # Errors
    /// [`Error::Usage`] if the cells of the set in `dir` are not those of labels, or other things than cells are `chosen`;
    /// those of reading the volume and the table.
    pub(super) fn ids(
        &self,
        dir: &Path,
        manifest: &Manifest,
        slice: &Slice,
        chosen: Table,
    ) -> Result<Vec<u64>> {
        let Some(PartsBy::Labels { unlabelled, .. }) = &manifest.cells else {
            let found = format!("{}, whose cells are others", dir.display());
            let expected = "a tile set made by alvis convert --labels";
            return Err(Error::usage("--labels", found, expected));
        };
        if chosen != Table::Cells {
            let found = format!("it for {}", chosen.name());
            return Err(Error::usage("--labels", found, "it for cells"));
        }
        let whole = self.0.header();
        let expected = manifest.filtered_dims()?;
        if whole.dims != expected || whole.dtype.is_float() {
            let found = format!("{} samples of type {}", whole.dims, whole.dtype);
            let expected = format!("{expected} whole numbers, as the tiles were made by");
            return Err(Error::usage("--labels", found, expected));
        }
        let grid = Cropped::part(Box::new(&*self.0), manifest.source.crop.as_ref())?;
        let labels = Slice::read(&*grid, slice.axis, slice.at)?;
        // that of voxels without a label is the last one; a part may lack it
        let none = match unlabelled {
            Some(_) if !manifest.is_part() => last_cell(dir, manifest)?,
            _ => 0,
        };
        let id = |(label, value): (&f64, &f64)| match *label as i64 {
            _ if *value >= manifest.threshold => 0,
            0 => none,
            label => u64::try_from(label).unwrap_or(0),
        };
        Ok(labels.values.iter().zip(&slice.values).map(id).collect())
    }
}

/// The largest id of a cell.
fn last_cell(dir: &Path, manifest: &Manifest) -> Result<u64> {
    let mut table = Table::Cells.open(dir, manifest)?;
    let id = table.own_column("id")?;
    let mut last = 0;
    while let Some(row) = table.next_row()? {
        last = row.whole(id)?;
    }
    Ok(last)
}
