//! A volume of labels, read once: the cell of each voxel.

use crate::error::{Error, Result};
use crate::grid::{Dims, Dtype};
use crate::labels::cell_rows::{CellPiece, CellRows, CellRowsWriter};
use crate::progress::Progress;
use crate::volume::{Volume, Voxel, with_voxel_type};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::Path;

/// Bytes of samples that are read at once.
const AT_ONCE: usize = 4 << 20;

/// What all of a volume of labels tells.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LabelSums {
    /// The largest label; 0 if none is above that.
    pub largest: u64,
    /// The checksum that [`crate::manifest::PartsBy::Labels`] states.
    pub checksum: String,
}

impl LabelSums {
    /// Reads all labels of a volume, for one of size `dims`, and keeps none.
    ///
    /// # Errors
    /// As of [`CellRows::of_labels`].
    pub fn of(labels: &dyn Volume, dims: Dims, progress: &dyn Progress) -> Result<Self> {
        check(labels, dims)?;
        let mut reader = Reader::new(dims, None);
        reader.all(labels, 0..dims.0[2], progress)?;
        Ok(reader.sums())
    }
}

impl CellRows {
    /// The labels of a volume, for one of size `dims`: whole numbers, of which those below 0 are no cells and
    /// are refused where a pore has one. They are kept in temporary files in the directory `dir`, 8 bytes for each stretch of voxels along x with the same label. With them comes the checksum that
    /// [`crate::manifest::PartsBy::Labels`] states.
    ///
    /// # Errors
    /// The volume's own; [`Error::Io`]; [`Error::Interrupted`]; [`Error::Usage`] if it is of another size, or of numbers
    /// that are not whole.
    pub fn of_labels(
        labels: &dyn Volume,
        dims: Dims,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<(CellRows, String)> {
        check(labels, dims)?;
        let mut reader = Reader::new(dims, Some(CellRowsWriter::new(dims, dir)?));
        reader.all(labels, 0..dims.0[2], progress)?;
        let checksum = reader.sums().checksum;
        Ok((reader.finish()?, checksum))
    }

    /// The same of some slices alone, without the checksum.
    ///
    /// # Errors
    /// As of [`CellRows::of_labels`].
    pub fn of_labels_in(
        labels: &dyn Volume,
        slices: Range<u32>,
        dir: &Path,
        progress: &dyn Progress,
    ) -> Result<CellRows> {
        let dims = labels.header().dims;
        let rows = CellRowsWriter::of_slices(dims, slices.clone(), dir)?;
        let mut reader = Reader::new(dims, Some(rows));
        reader.all(labels, slices, progress)?;
        reader.finish()
    }
}

/// Refuses what are no labels of a volume of this size.
fn check(labels: &dyn Volume, dims: Dims) -> Result<()> {
    let header = labels.header();
    if header.dims != dims {
        return Err(Error::usage(
            "--labels",
            format!("labels of {} voxels", header.dims),
            format!("{dims}, as the volume has after its filters and before --crop"),
        ));
    }
    if header.dtype.is_float() {
        return Err(Error::usage(
            "--labels",
            match header.dtype {
                // in HDF5 and Zarr
                Dtype::F64 => "samples of type f64, or integers of 64 bits".to_owned(),
                other => format!("samples of type {other}"),
            },
            "whole numbers: u8, u16, u32, i8, i16 or i32",
        )
        .with_hint("in Python labels.astype('uint32'), if they are below 2^32"));
    }
    Ok(())
}

struct Reader {
    dims: Dims,
    /// Where the rows are kept, if they are.
    rows: Option<CellRowsWriter>,
    crc: crc32fast::Hasher,
    largest: i64,
}

impl Reader {
    fn new(dims: Dims, rows: Option<CellRowsWriter>) -> Self {
        Reader {
            dims,
            rows,
            crc: crc32fast::Hasher::new(),
            largest: 0,
        }
    }

    fn sums(&self) -> LabelSums {
        LabelSums {
            largest: self.largest as u64,
            checksum: format!("crc32:{:08x}", self.crc.clone().finalize()),
        }
    }

    fn finish(self) -> Result<CellRows> {
        let rows = self.rows.expect("rows that are kept");
        rows.finish()
    }

    fn all(
        &mut self,
        labels: &dyn Volume,
        slices: Range<u32>,
        progress: &dyn Progress,
    ) -> Result<()> {
        progress.begin("labels", slices.len() as u64);
        let dtype = labels.header().dtype;
        with_voxel_type!(dtype, T => self.read::<T>(labels, slices, progress))
    }

    fn read<T: Voxel>(
        &mut self,
        labels: &dyn Volume,
        slices: Range<u32>,
        progress: &dyn Progress,
    ) -> Result<()> {
        let [nx, ny, _] = self.dims.0;
        let row_bytes = nx as usize * size_of::<T>();
        let at_once = (AT_ONCE / row_bytes).clamp(1, ny as usize);
        let mut samples = vec![T::zeroed(); at_once * nx as usize];
        for z in slices {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            for y in (0..ny).step_by(at_once) {
                let end = ny.min(y + at_once as u32);
                let samples = &mut samples[..(end - y) as usize * nx as usize];
                let bytes = bytemuck::cast_slice_mut(samples);
                labels.read_box(0..nx, y..end, z..z + 1, bytes)?;
                for (y, row) in (y..end).zip(samples.chunks_exact(nx as usize)) {
                    self.row(row, y, z)?;
                }
            }
            labels.release(z..z + 1);
            progress.advance(1);
        }
        Ok(())
    }

    fn row<T: Voxel>(&mut self, row: &[T], y: u32, z: u32) -> Result<()> {
        let mut pieces = Vec::new();
        for (x, label) in row.iter().enumerate() {
            if x > 0 && *label == row[x - 1] {
                continue;
            }
            let label = label.to_f64() as i64;
            self.crc.update(&(x as u64).to_le_bytes());
            self.crc.update(&label.to_le_bytes());
            self.largest = self.largest.max(label);
            pieces.push(CellPiece::of_label(x as u32, label));
        }
        match &mut self.rows {
            Some(rows) => rows.push(y, z, &pieces),
            None => Ok(()),
        }
    }
}
