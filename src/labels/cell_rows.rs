//! Which cell each voxel of a volume belongs to, where that is given: rows of pieces in temporary files.
//!
//! Cells are numbered from 1 on; 0 stands for none. A volume of labels has few changes along a row, so its pieces take
//! much less than its samples.

use crate::error::{Error, Result};
use crate::grid::{Crop, Dims};
use crate::labels::Span;
use crate::sys::spill_file::{Mark, Place, SpillFile};
use crate::sys::temp_file::unnamed;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bits of a piece's cell; above them is its first voxel, which is below 65,536.
const CELL_BITS: u32 = 48;
/// The largest number of a cell: those above stand for labels below 0.
const MOST_CELLS: u64 = (1 << (CELL_BITS - 1)) - 2;
/// Bits of the number of a row's pieces, of which it has at most 65,536; above them is where they begin.
const COUNT_BITS: u32 = 17;
/// Rows whose places are written at once.
const AT_ONCE: usize = 4096;

/// Neighbouring voxels of a row that belong to one cell, up to the next piece or the row's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellPiece(u64);

impl CellPiece {
    /// From voxel `start` on, of `cell`, which is at most [`MOST_CELLS`].
    pub fn new(start: u32, cell: u64) -> Self {
        debug_assert!(cell <= MOST_CELLS);
        CellPiece(u64::from(start) << CELL_BITS | cell)
    }

    /// The same of a label of 32 bits; one below 0 is no cell, see [`label_below_0`].
    pub fn of_label(start: u32, label: i64) -> Self {
        let cell = label as u64 & ((1 << CELL_BITS) - 1);
        CellPiece(u64::from(start) << CELL_BITS | cell)
    }

    /// Its first voxel.
    pub fn start(self) -> u32 {
        (self.0 >> CELL_BITS) as u32
    }

    /// Its cell, or 0.
    pub fn cell(self) -> u64 {
        self.0 & ((1 << CELL_BITS) - 1)
    }
}

/// The label below 0 that stands in the place of a cell, if one does: no voxel that is given to a cell may have it.
pub fn label_below_0(cell: u64) -> Option<i64> {
    let unused = u64::BITS - CELL_BITS;
    (cell > MOST_CELLS + 1).then_some((cell << unused) as i64 >> unused)
}

/// The files of [`CellRows`].
#[derive(Debug)]
struct Files {
    dims: Dims,
    /// The first slice that has rows there.
    first_z: u32,
    pieces: SpillFile,
    rows: File,
    dir: PathBuf,
}

/// Writes rows, in any order, each once.
#[derive(Debug)]
pub struct CellRowsWriter {
    files: Files,
    /// Number of the first row whose place is not written, and the places from there on.
    waiting: (u64, Vec<u64>),
    pieces: u64,
    largest: u64,
}

impl CellRowsWriter {
    /// Of a volume of this size, in files without names in `dir`.
    ///
    /// # Errors
    /// [`Error::Io`], here and below.
    pub fn new(dims: Dims, dir: &Path) -> Result<Self> {
        Self::of_slices(dims, 0..dims.0[2], dir)
    }

    /// The same of some slices alone.
    pub fn of_slices(dims: Dims, slices: Range<u32>, dir: &Path) -> Result<Self> {
        let rows = unnamed(dir).map_err(|e| failed(dir, e))?;
        Self::on(dims, slices, SpillFile::new(dir)?, rows, dir)
    }

    /// The same in these files, which are begun anew.
    pub fn create(dims: Dims, pieces: &Path, rows: &Path) -> Result<Self> {
        let mut options = File::options();
        let options = options.create(true).truncate(true).read(true).write(true);
        let file = options.open(rows).map_err(|e| failed(rows, e))?;
        Self::on(dims, 0..dims.0[2], SpillFile::create(pieces)?, file, rows)
    }

    fn on(
        dims: Dims,
        slices: Range<u32>,
        pieces: SpillFile,
        rows: File,
        dir: &Path,
    ) -> Result<Self> {
        let [nx, ny, _] = dims.0;
        rows.set_len(bytes_of_rows(Dims([nx, ny, slices.len() as u32])))
            .map_err(|e| failed(dir, e))?;
        Ok(CellRowsWriter {
            files: Files {
                dims,
                first_z: slices.start,
                pieces,
                rows,
                dir: dir.to_path_buf(),
            },
            waiting: (0, Vec::new()),
            pieces: 0,
            largest: 0,
        })
    }

    /// Adds the pieces of a row, by rising x, from voxel 0 on.
    pub fn push(&mut self, y: u32, z: u32, pieces: &[CellPiece]) -> Result<()> {
        debug_assert!(pieces.first().is_some_and(|piece| piece.start() == 0));
        let number = row_number(self.files.dims, y, z - self.files.first_z);
        let (first, places) = &self.waiting;
        if first + places.len() as u64 != number || places.len() == AT_ONCE {
            self.write_places()?;
            self.waiting.0 = number;
        }
        self.waiting
            .1
            .push(self.pieces << COUNT_BITS | pieces.len() as u64);
        self.pieces += pieces.len() as u64;
        let cells = pieces.iter().map(|piece| piece.cell());
        let cells = cells.filter(|&cell| label_below_0(cell).is_none());
        self.largest = cells.fold(self.largest, u64::max);
        let words: Vec<u64> = pieces.iter().map(|piece| piece.0).collect();
        self.files.pieces.push(&words).map(|_| ())
    }

    fn write_places(&mut self) -> Result<()> {
        let (first, places) = std::mem::take(&mut self.waiting);
        let files = &self.files;
        files
            .rows
            .write_all_at(bytemuck::cast_slice(&places), 8 * first)
            .map_err(|e| failed(&files.dir, e))
    }

    /// All rows are written.
    pub fn finish(self) -> Result<CellRows> {
        self.finish_marked().map(|(rows, _)| rows)
    }

    /// The same, with a mark by which the file of pieces is opened again.
    pub fn finish_marked(mut self) -> Result<(CellRows, Mark)> {
        self.write_places()?;
        let mark = self.files.pieces.mark()?;
        let rows = CellRows {
            dims: self.files.dims,
            start: [0; 3],
            files: Arc::new(self.files),
            largest: self.largest,
            none: 0,
        };
        Ok((rows, mark))
    }
}

/// Bytes of the places of all rows.
pub fn bytes_of_rows(dims: Dims) -> u64 {
    let [_, ny, nz] = dims.0.map(u64::from);
    8 * ny * nz
}

/// The cell of each voxel of a volume, or of a crop of it.
#[derive(Debug, Clone)]
pub struct CellRows {
    dims: Dims,
    /// First voxel of the crop.
    start: [u32; 3],
    files: Arc<Files>,
    largest: u64,
    /// What stands for no cell.
    none: u64,
}

impl CellRows {
    /// Those that were written to these files, with cells up to `largest`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn reopen(dims: Dims, pieces: SpillFile, rows: &Path, largest: u64) -> Result<Self> {
        let file = File::open(rows).map_err(|e| failed(rows, e))?;
        Ok(CellRows {
            dims,
            start: [0; 3],
            files: Arc::new(Files {
                dims,
                first_z: 0,
                pieces,
                rows: file,
                dir: rows.to_path_buf(),
            }),
            largest,
            none: 0,
        })
    }

    /// Size of the volume, or of the crop.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// The largest number of a cell in the whole volume; 0 if there is none.
    pub fn largest(&self) -> u64 {
        self.largest
    }

    /// The same with voxels of no cell in a cell of this number.
    pub fn with_none(self, none: u64) -> Self {
        CellRows { none, ..self }
    }

    /// The number of the cell that voxels of none are in; 0 if they are in none.
    pub fn none(&self) -> u64 {
        self.none
    }

    /// The same in a crop of the volume; in all of it without one.
    ///
    /// # Errors
    /// Those of [`Crop::dims_in`].
    pub fn cropped(&self, crop: Option<&Crop>) -> Result<Self> {
        let Some(crop) = crop else {
            return Ok(self.clone());
        };
        let start = crop.start();
        Ok(CellRows {
            dims: crop.dims_in(self.dims)?,
            start: std::array::from_fn(|a| self.start[a] + start[a]),
            ..self.clone()
        })
    }

    /// The voxel of the whole volume that a voxel of the crop is.
    pub fn in_whole(&self, voxel: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| self.start[a] + voxel[a])
    }

    /// Reads the rows of a span of the crop; the memory of `out` is used again.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn load(&self, span: &Span, out: &mut BandCells) -> Result<()> {
        (out.first_x, out.none) = (self.start[0], self.none);
        out.rows.clear();
        out.rows.push(0);
        out.pieces.clear();
        let [_, start_y, start_z] = self.start;
        let mut places = vec![0u64; span.rows()];
        for z in span.z.clone() {
            let z = z + start_z - self.files.first_z;
            let first = row_number(self.files.dims, span.y.start + start_y, z);
            self.files
                .rows
                .read_exact_at(bytemuck::cast_slice_mut(&mut places), 8 * first)
                .map_err(|e| failed(&self.files.dir, e))?;
            self.read_pieces(&places, out)?;
        }
        Ok(())
    }

    /// Reads the pieces of rows in these places, those that lie behind each other at once.
    fn read_pieces(&self, places: &[u64], out: &mut BandCells) -> Result<()> {
        let mut rest = places;
        while let Some(&place) = rest.first() {
            let start = place >> COUNT_BITS;
            let (mut end, mut rows) = (start, 0);
            for place in rest {
                if place >> COUNT_BITS != end {
                    break;
                }
                let count = place & ((1 << COUNT_BITS) - 1);
                end += count;
                rows += 1;
                let before = *out.rows.last().expect("one more than rows");
                out.rows.push(before + count as u32);
            }
            let at = Place::<u64>::new(8 * start, (end - start) as usize);
            out.pieces.extend(self.files.pieces.read(&at)?);
            rest = &rest[rows..];
        }
        Ok(())
    }
}

/// The cells of a band of rows, slices in order.
#[derive(Debug, Clone, Default)]
pub struct BandCells {
    /// First piece of each row, and one more.
    rows: Vec<u32>,
    pieces: Vec<u64>,
    /// Where the crop begins in a row of the volume.
    first_x: u32,
    /// What stands for no cell.
    none: u64,
}

impl BandCells {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        (4 * self.rows.capacity() + 8 * self.pieces.capacity()) as u64
    }

    /// The cell of voxel `x` of row number `row`, or 0.
    pub fn at(&self, row: usize, x: u32) -> u64 {
        let pieces = self.of_row(row);
        let x = x + self.first_x;
        let behind = pieces.partition_point(|&piece| CellPiece(piece).start() <= x);
        self.cell_of(pieces[behind - 1])
    }

    fn cell_of(&self, piece: u64) -> u64 {
        match CellPiece(piece).cell() {
            0 => self.none,
            cell => cell,
        }
    }

    /// Calls `each` with the stretches of the voxels from `start` up to `end` of a row that belong to one cell, or none:
    /// first voxel, end and cell.
    pub fn for_each_in(
        &self,
        row: usize,
        [start, end]: [u32; 2],
        mut each: impl FnMut(u32, u32, u64),
    ) {
        let pieces = self.of_row(row);
        let [first, last] = [start, end].map(|x| x + self.first_x);
        let behind = pieces.partition_point(|&piece| CellPiece(piece).start() <= first);
        let mut at = first;
        for (i, &piece) in (behind..).zip(&pieces[behind - 1..]) {
            let next = pieces
                .get(i)
                .map_or(last, |&next| CellPiece(next).start().min(last));
            each(at - self.first_x, next - self.first_x, self.cell_of(piece));
            at = next;
            if at == last {
                return;
            }
        }
    }

    fn of_row(&self, row: usize) -> &[u64] {
        &self.pieces[self.rows[row] as usize..self.rows[row + 1] as usize]
    }
}

fn row_number(dims: Dims, y: u32, z: u32) -> u64 {
    u64::from(z) * u64::from(dims.0[1]) + u64::from(y)
}

fn failed(dir: &Path, e: std::io::Error) -> Error {
    Error::io(dir, "keep the cells of voxels in a temporary file", e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_part_has_its_cells(
            nx in 1u32..40, ny in 1u32..6, seed in any::<u64>(), cut in (0u32..39, 0u32..5, 0u32..3), order in any::<u64>(),
        ) {
            let dims = Dims([nx, ny, 4]);
            let dir = tempfile::tempdir().unwrap();
            let cell = |x: u32, y: u32, z: u32| {
                let n = u64::from(x / 3 + 7 * y + 31 * z).wrapping_mul(seed | 1);
                n >> 61
            };
            let mut writer = CellRowsWriter::new(dims, dir.path()).unwrap();
            let mut places: Vec<(u32, u32)> = (0..4).flat_map(|z| (0..ny).map(move |y| (y, z))).collect();
            places.sort_by_key(|&(y, z)| u64::from(y + 9 * z).wrapping_mul(order | 1) >> 60);
            for (y, z) in places {
                let mut pieces = vec![CellPiece::new(0, cell(0, y, z))];
                for x in 1..nx {
                    if cell(x, y, z) != cell(x - 1, y, z) {
                        pieces.push(CellPiece::new(x, cell(x, y, z)));
                    }
                }
                writer.push(y, z, &pieces).unwrap();
            }
            let all = writer.finish().unwrap();
            let [x0, y0, z0] = [cut.0.min(nx - 1), cut.1.min(ny - 1), cut.2];
            let part = Crop { x: x0..nx, y: y0..ny, z: z0..4 };
            let cropped = CellRows { start: part.start(), dims: Dims([nx - x0, ny - y0, 4 - z0]), ..all };
            let span = Span { nx: nx - x0, y: 0..ny - y0, z: 0..4 - z0 };
            let mut band = BandCells::default();
            cropped.load(&span, &mut band).unwrap();
            for (s, z) in span.z.clone().enumerate() {
                for (r, y) in span.y.clone().enumerate() {
                    let row = s * span.rows() + r;
                    let mut seen = 0;
                    band.for_each_in(row, [0, span.nx], |start, end, found| {
                        assert!(start == seen && start < end);
                        seen = end;
                        for x in start..end {
                            assert_eq!(found, cell(x + x0, y + y0, z + z0));
                            assert_eq!(found, band.at(row, x));
                        }
                    });
                    prop_assert_eq!(seen, span.nx);
                }
            }
        }
    }
}
