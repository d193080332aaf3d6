//! What a band tells of itself to be joined with its neighbours.

use crate::grid::Dims;
use crate::labels::Bits;
use crate::labels::label_band::{Labels, LocalComponent};
use crate::labels::runs::Runs;
use crate::measure::VoxelSums;

/// What the joining of bands needs to know of one band.
#[derive(Debug, Clone, Default)]
pub struct BandFaces {
    /// Local components of the runs of the band's first row, all slices.
    pub(crate) first_row: Vec<u32>,
    /// The same of its last row, which is the next band's first.
    pub(crate) last_row: Vec<u32>,
    /// Local components of the runs of the first slice, all rows.
    pub(crate) first_slice: Vec<u32>,
    /// The same of the last slice, which is the next slab's first.
    pub(crate) last_slice: Vec<u32>,
    /// Runs of the first row in the first slice.
    pub(crate) head_runs_first: usize,
    /// Runs of the first row in the last slice.
    pub(crate) head_runs_last: usize,
}

impl BandFaces {
    /// Takes the outer rows' and slices' labels of a band. Rows and slices at the grid's ends are
    /// shared with no band or slab, so theirs are left out.
    pub fn of(bits: &Bits, runs: &Runs, labels: &Labels, dims: Dims) -> Self {
        let shared_first = bits.span.z.start > 0;
        let shared_last = bits.span.z.end < dims.0[2];
        let (shared_low, shared_high) = (bits.span.y.start > 0, bits.span.y.end < dims.0[1]);
        let (rows, slices) = (bits.span.rows(), bits.span.slices());
        let run_of_row = |row: usize| -> usize {
            runs.word_run
                .get(row * bits.row_words)
                .map_or(runs.count, |&r| r as usize)
        };
        let row_labels = |s: usize, r: usize| {
            let row = s * rows + r;
            &labels.of_run[run_of_row(row)..run_of_row(row + 1)]
        };
        let slice_labels =
            |s: usize| &labels.of_run[run_of_row(s * rows)..run_of_row((s + 1) * rows)];
        let column = |r: usize| {
            (0..slices)
                .flat_map(|s| row_labels(s, r))
                .copied()
                .collect()
        };
        BandFaces {
            first_row: if shared_low { column(0) } else { Vec::new() },
            last_row: if shared_high {
                column(rows - 1)
            } else {
                Vec::new()
            },
            first_slice: if shared_first {
                slice_labels(0).to_vec()
            } else {
                Vec::new()
            },
            last_slice: if shared_last {
                slice_labels(slices - 1).to_vec()
            } else {
                Vec::new()
            },
            head_runs_first: row_labels(0, 0).len(),
            head_runs_last: if shared_last {
                row_labels(slices - 1, 0).len()
            } else {
                0
            },
        }
    }
}

impl BandFaces {
    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let labels = [
            &self.first_row,
            &self.last_row,
            &self.first_slice,
            &self.last_slice,
        ];
        labels.iter().map(|l| 4 * l.len() as u64).sum()
    }
}

/// The local components of one band, as far as joining needs them.
#[derive(Debug, Clone, Default)]
pub struct BandComponents {
    /// Smallest linear voxel index of each component, with [`ABOVE`].
    keys: Vec<u64>,
    /// Those that lie in a row or slice that is shared with a neighbour, by rising number. All others
    /// are whole.
    open: Vec<(u32, VoxelSums)>,
    /// Smallest lattice keys of the edges that leave components of the grid's first slice, by rising number.
    keys_on_top: Vec<(u32, u64)>,
    /// Voxels of a slice.
    slice: u64,
}

/// Set in the key of an object.
const ABOVE: u64 = 1 << 63;

impl BandComponents {
    /// Splits a band's components; calls `whole` for each that no other band can add to, by rising
    /// number.
    ///
    /// # Errors
    /// What `whole` returns.
    pub fn split<E>(
        components: &[LocalComponent],
        edges: &BandFaces,
        keys_on_top: Vec<(u32, u64)>,
        dims: Dims,
        mut whole: impl FnMut(&VoxelSums) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut shared = vec![false; components.len()];
        let labels = [
            &edges.first_row,
            &edges.last_row,
            &edges.first_slice,
            &edges.last_slice,
        ];
        for &label in labels.into_iter().flatten() {
            shared[label as usize] = true;
        }
        let mut out = BandComponents {
            keys: Vec::with_capacity(components.len()),
            open: Vec::with_capacity(shared.iter().filter(|&&s| s).count()),
            keys_on_top,
            slice: u64::from(dims.0[0]) * u64::from(dims.0[1]),
        };
        for (i, (component, shared)) in components.iter().zip(shared).enumerate() {
            let phase = if component.above { ABOVE } else { 0 };
            out.keys.push(component.first | phase);
            if shared {
                out.open.push((i as u32, component.sums));
            } else {
                whole(&component.sums)?;
            }
        }
        Ok(out)
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Those that other bands can add to, by rising number, with their sums.
    pub fn open(&self) -> &[(u32, VoxelSums)] {
        &self.open
    }

    /// Numbers of the whole ones, rising.
    pub fn whole(&self) -> impl Iterator<Item = u32> + '_ {
        let mut open = self.open.iter().map(|&(i, _)| i).peekable();
        (0..self.keys.len() as u32).filter(move |&i| open.next_if_eq(&i).is_none())
    }

    /// Smallest linear voxel index of each component in the band, and the smallest lattice key of the edges that leave
    /// it: behind the first slice that of the edge that leads to this voxel from the slice before. The component of the
    /// grid's first voxel comes before all others.
    pub fn firsts(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        let mut on_top = self.keys_on_top.iter().peekable();
        self.keys.iter().zip(0..).map(move |(key, i)| {
            let first = key & !ABOVE;
            // the one that nothing begins before
            if first == 0 {
                on_top.next();
                return (0, 0);
            }
            let key = match on_top.next_if(|&&(component, _)| component == i) {
                Some(&(_, key)) => key,
                None => 3 * (first - self.slice) + 2,
            };
            (first, key)
        })
    }

    /// True if component `i` is one of above voxels.
    pub fn is_above(&self, i: usize) -> bool {
        self.keys[i] & ABOVE != 0
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let open = self.open.len() * size_of::<(u32, VoxelSums)>();
        let on_top = self.keys_on_top.len() * size_of::<(u32, u64)>();
        (self.keys.len() * 8 + open + on_top) as u64
    }
}
