//! One pass over a volume in pieces of bounded size, in parallel where the volume allows it.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::progress::Progress;
use crate::volume::adapters::temp_copy::multiple;
use crate::volume::{Volume, Voxel};
use rayon::prelude::*;
use std::ops::Range;

/// Bytes of samples that a thread holds, unless two rows of two slices have more.
const PIECE: u64 = 2 << 20;

/// How a volume is cut into slabs of slices, and these into bands of rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    dims: Dims,
    /// Rows of a band.
    rows: u32,
    /// Slices of a slab.
    slices: u32,
    /// Number of slabs.
    slabs: u64,
    /// Rows and slices that a piece reads beyond its own.
    overlap: u32,
    /// Slabs are one slice thick, spread evenly, with gaps between them.
    sampled: bool,
    /// Pieces are so large, by the volume's grain, that only one is held at a time.
    alone: bool,
}

/// A part of the volume: rows and slices, with all x.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Piece {
    /// Own rows; together the pieces own every row of their slices once.
    pub(crate) y: Range<u32>,
    /// Own slices.
    pub(crate) z: Range<u32>,
    /// Rows read: the own ones and the overlap.
    pub(crate) read_y: Range<u32>,
    /// Slices read.
    pub(crate) read_z: Range<u32>,
}

impl Walk {
    /// All slices, in pieces that are decoded together.
    pub(crate) fn whole(volume: &dyn Volume, overlap: u32) -> Self {
        let header = volume.header();
        Walk::cut(header.dims, header.dtype.bytes(), volume.grain(), overlap)
    }

    fn cut(dims: Dims, sample_bytes: usize, [_, gy, gz]: [u32; 3], overlap: u32) -> Self {
        let [nx, ny, nz] = dims.0;
        let row = u64::from(nx) * sample_bytes as u64;
        let slices = multiple(PIECE / (row * u64::from(ny)), gz, nz);
        let thick = u64::from(slices) + u64::from(overlap);
        let rows = multiple(PIECE / (row * thick), gy, ny);
        Walk {
            dims,
            rows,
            slices,
            slabs: nz.div_ceil(slices).into(),
            overlap,
            sampled: false,
            // two rows of two slices are always held
            alone: gy * gz > 4 && row * thick * u64::from(rows) > 2 * PIECE,
        }
    }

    /// `slabs` single slices (at least 1, less than the volume has), evenly spaced, each read with
    /// the next slice.
    pub(crate) fn sampled(dims: Dims, sample_bytes: usize, slabs: u32) -> Self {
        let [nx, ny, nz] = dims.0;
        let row = u64::from(nx) * sample_bytes as u64;
        Walk {
            dims,
            rows: (PIECE / (row * 2)).clamp(1, u64::from(ny)) as u32,
            slices: 1,
            slabs: u64::from(slabs.clamp(1, nz - 1)),
            overlap: 1,
            sampled: true,
            alone: false,
        }
    }

    /// Number of slabs.
    pub(crate) fn slabs(&self) -> u64 {
        self.slabs
    }

    fn bands(&self) -> u64 {
        u64::from(self.dims.0[1].div_ceil(self.rows))
    }

    fn piece(&self, index: u64) -> Piece {
        let [_, ny, nz] = self.dims.0;
        let (slab, band) = (index / self.bands(), index % self.bands());
        let start_z = if self.sampled {
            (2 * slab + 1) * u64::from(nz - 1) / (2 * self.slabs)
        } else {
            slab * u64::from(self.slices)
        } as u32;
        let start_y = band as u32 * self.rows;
        let end = |start: u32, n: u32, most: u32| start.saturating_add(n).min(most);
        let y = start_y..end(start_y, self.rows, ny);
        let z = start_z..end(start_z, self.slices, nz);
        Piece {
            read_y: y.start..end(y.end, self.overlap, ny),
            read_z: z.start..end(z.end, self.overlap, nz),
            y,
            z,
        }
    }

    /// Reads every piece and folds it: `add(sum, piece, samples)` with the samples of the piece's
    /// read ranges. Sums of several threads are joined by `merge`, in no fixed order.
    pub(crate) fn fold<T: Voxel, A: Send>(
        &self,
        volume: &dyn Volume,
        progress: &dyn Progress,
        new: impl Fn() -> A + Send + Sync,
        add: impl Fn(&mut A, &Piece, &[T]) -> Result<()> + Send + Sync,
        merge: impl Fn(A, A) -> A + Send + Sync,
    ) -> Result<A> {
        let nx = self.dims.0[0];
        let step = |(mut sum, mut samples): (A, Vec<T>), index: u64| {
            if progress.interrupted() {
                return Err(Error::Interrupted);
            }
            let piece = self.piece(index);
            let (y, z) = (piece.read_y.clone(), piece.read_z.clone());
            samples.resize(nx as usize * y.len() * z.len(), T::zeroed());
            volume.read_box(0..nx, y, z.clone(), bytemuck::cast_slice_mut(&mut samples))?;
            volume.release(z);
            add(&mut sum, &piece, &samples)?;
            progress.advance(1);
            Ok((sum, samples))
        };
        let start = || (new(), Vec::new());
        let pieces = 0..self.slabs * self.bands();
        if self.alone || !volume.random_access() {
            let sum = { pieces }.try_fold(start(), step)?;
            return Ok(sum.0);
        }
        pieces
            .into_par_iter()
            .try_fold(start, step)
            .map(|sum| sum.map(|(sum, _)| sum))
            .try_reduce(&new, |a, b| Ok(merge(a, b)))
    }

    /// Number of pieces, for progress.
    pub(crate) fn pieces(&self) -> u64 {
        self.slabs * self.bands()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_own_every_row_once() {
        for dims in [[2, 2, 2], [1000, 900, 7], [65_536, 40, 3], [3, 3, 1000]] {
            let dims = Dims(dims);
            let [_, ny, nz] = dims.0;
            for (overlap, grain) in [(0, [1; 3]), (1, [1; 3]), (1, [64, 3, 5])] {
                let walk = Walk::cut(dims, 4, grain, overlap);
                let mut owned = vec![0; (ny * nz) as usize];
                for index in 0..walk.pieces() {
                    let piece = walk.piece(index);
                    assert_eq!(piece.read_y.end, (piece.y.end + overlap).min(ny));
                    assert_eq!(piece.read_z.end, (piece.z.end + overlap).min(nz));
                    for k in piece.z {
                        for j in piece.y.clone() {
                            owned[(j + ny * k) as usize] += 1;
                        }
                    }
                }
                assert!(owned.iter().all(|&n| n == 1), "{dims}");
            }
        }
    }

    #[test]
    fn sampled_slabs_are_distinct_and_have_a_next_slice() {
        for (nz, slabs) in [(2, 1), (10, 9), (10, 3), (65_536, 64)] {
            let walk = Walk::sampled(Dims([4, 4, nz]), 1, slabs);
            let starts: Vec<u32> = (0..walk.pieces()).map(|i| walk.piece(i).z.start).collect();
            assert!(starts.windows(2).all(|w| w[0] < w[1]), "{starts:?}");
            assert!(starts.iter().all(|&z| z + 1 < nz));
        }
    }
}
