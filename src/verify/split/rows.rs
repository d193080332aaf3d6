//! The cell of each voxel, by rows, on the disk: a volume as one of labels is, 0 where there is none.

use crate::error::{Error, Result};
use crate::grid::{Dims, Endian, Placement};
use crate::split::PartPiece;
use crate::volume::{Dtype, Header, Volume};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::os::unix::fs::FileExt;

/// Bits of where a row's pieces begin; above them is how many these are, at most 65,536.
const START_BITS: u32 = 47;

/// Writes a [`CellVolume`]; rows come in any order, those of a slice best by rising y.
pub(super) struct CellVolumeWriter {
    dims: Dims,
    pieces: BufWriter<File>,
    /// Pieces so far.
    count: u64,
    starts: File,
    /// Words of rows one after the other, to be written from this row on.
    first: u64,
    pending: Vec<u64>,
}

fn failed(e: std::io::Error) -> Error {
    Error::io(std::env::temp_dir(), "write or read a temporary file in", e)
}

impl CellVolumeWriter {
    /// # Errors
    /// [`Error::Io`] if a temporary file cannot be made, here and below if it cannot be written.
    pub fn new(dims: Dims) -> Result<Self> {
        Ok(CellVolumeWriter {
            dims,
            pieces: BufWriter::new(tempfile::tempfile().map_err(failed)?),
            count: 0,
            starts: tempfile::tempfile().map_err(failed)?,
            first: 0,
            pending: Vec::new(),
        })
    }

    /// Takes the pieces of a row.
    pub fn row(&mut self, y: u32, z: u32, pieces: &[PartPiece]) -> Result<()> {
        let row = u64::from(z) * u64::from(self.dims.0[1]) + u64::from(y);
        if row != self.first + self.pending.len() as u64 {
            self.write_starts()?;
            self.first = row;
        }
        self.pending
            .push((pieces.len() as u64) << START_BITS | self.count);
        for piece in pieces {
            let Ok(cell) = u32::try_from(piece.part) else {
                let found = format!("{} cells", piece.part);
                return Err(Error::usage("--against", found, "fewer than 2^32 cells"));
            };
            let ends = u64::from(piece.start) << 48 | u64::from(piece.last) << 32;
            let word = ends | u64::from(cell);
            self.pieces.write_all(&word.to_ne_bytes()).map_err(failed)?;
        }
        self.count += pieces.len() as u64;
        Ok(())
    }

    fn write_starts(&mut self) -> Result<()> {
        let bytes = bytemuck::cast_slice(&self.pending);
        self.starts
            .write_all_at(bytes, 8 * self.first)
            .map_err(failed)?;
        self.pending.clear();
        Ok(())
    }

    /// All rows have come.
    pub fn finish(mut self) -> Result<CellVolume> {
        self.write_starts()?;
        let pieces = self.pieces.into_inner();
        Ok(CellVolume {
            header: Header {
                format: "memory",
                dims: self.dims,
                dtype: Dtype::U32,
                endian: Endian::NATIVE,
                placement: Placement::default(),
            },
            pieces: pieces.map_err(|e| failed(e.into_error()))?,
            starts: self.starts,
        })
    }
}

/// The cell of each voxel as a sample; 0 for none.
pub(in crate::verify) struct CellVolume {
    header: Header,
    pieces: File,
    starts: File,
}

impl Volume for CellVolume {
    fn header(&self) -> &Header {
        &self.header
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        let ny = u64::from(self.header.dims.0[1]);
        let (mut starts, mut pieces) = (Vec::new(), Vec::new());
        out.fill(0);
        let mut rows = out.chunks_exact_mut(4 * x.len());
        for z in z {
            let first = u64::from(z) * ny + u64::from(y.start);
            read(&self.starts, first, &mut starts, y.len())?;
            for (start, row) in starts.iter().zip(&mut rows) {
                let (first, count) = (start & ((1 << START_BITS) - 1), start >> START_BITS);
                read(&self.pieces, first, &mut pieces, count as usize)?;
                for piece in &pieces {
                    let inside = |at: u64| (at as u32).clamp(x.start, x.end) - x.start;
                    let first = inside(piece >> 48) as usize;
                    let end = inside((piece >> 32 & 0xFFFF) + 1) as usize;
                    let cell = (*piece as u32).to_ne_bytes();
                    let voxels = row[4 * first..4 * end].chunks_exact_mut(4);
                    voxels.for_each(|voxel| voxel.copy_from_slice(&cell));
                }
            }
        }
        Ok(())
    }
}

/// Reads words of a file from the one of this number on.
fn read(file: &File, first: u64, words: &mut Vec<u64>, count: usize) -> Result<()> {
    words.resize(count, 0);
    let bytes = bytemuck::cast_slice_mut(words);
    file.read_exact_at(bytes, 8 * first).map_err(failed)
}
