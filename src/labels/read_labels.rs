//! A volume of labels, read once: the cell of each voxel.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::labels::cell_rows::{CellPiece, CellRows, CellRowsWriter};
use crate::progress::Progress;
use crate::volume::{Volume, Voxel, with_voxel_type};
use std::path::Path;

/// Bytes of samples that are read at once.
const AT_ONCE: usize = 4 << 20;

impl CellRows {
    /// The labels of a volume, for one of size `dims`: whole numbers, of which those below 0 are no cells, see
    /// [`label_below_0`](super::cell_rows::label_below_0). They are kept in temporary files in the
    /// directory `dir`, 8 bytes for each stretch of voxels along x with the same label. With them comes the checksum that
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
                format!("samples of type {}", header.dtype),
                "whole numbers: u8, u16, u32, i8, i16 or i32",
            )
            .with_hint("in Python labels.astype('uint32'), if they are below 2^32"));
        }
        let mut reader = Reader {
            dims,
            rows: CellRowsWriter::new(dims, dir)?,
            crc: crc32fast::Hasher::new(),
        };
        progress.begin("labels", dims.0[2].into());
        with_voxel_type!(header.dtype, T => reader.read::<T>(labels, progress))?;
        let checksum = format!("crc32:{:08x}", reader.crc.finalize());
        Ok((reader.rows.finish()?, checksum))
    }
}

struct Reader {
    dims: Dims,
    rows: CellRowsWriter,
    crc: crc32fast::Hasher,
}

impl Reader {
    fn read<T: Voxel>(&mut self, labels: &dyn Volume, progress: &dyn Progress) -> Result<()> {
        let [nx, ny, nz] = self.dims.0;
        let row_bytes = nx as usize * size_of::<T>();
        let at_once = (AT_ONCE / row_bytes).clamp(1, ny as usize);
        let mut samples = vec![T::zeroed(); at_once * nx as usize];
        for z in 0..nz {
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
            pieces.push(CellPiece::of_label(x as u32, label));
        }
        self.rows.push(y, z, &pieces)
    }
}
