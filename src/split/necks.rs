//! Necks: where cells were cut from each other.

use super::metric::Metric;
use super::numbers::Numbers;
use crate::error::Result;
use crate::sys::sorted_spill::{Keyed, Sorter};
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 16;

/// A saddle at which two cells were cut from each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neck {
    /// The ids of the cells, the smaller one first.
    pub cells: [u64; 2],
    /// The narrowest place: linear index of the lower voxel of the saddle.
    pub voxel: u64,
    /// Its level.
    pub level: u32,
    /// The level of the lower one of the peaks that met there.
    pub peak: u32,
    /// Faces of voxels from the first cell to the second one, by axis: those along it less those against it.
    pub faces: [i64; 3],
}

impl Neck {
    /// Its radius, in steps along the finest axis.
    pub fn radius(&self, metric: &Metric) -> f64 {
        metric.radius(self.level)
    }

    /// Its radius over that of the cell whose peak is the lower one; at most 1.
    pub fn ratio(&self) -> f64 {
        (f64::from(self.level) / f64::from(self.peak)).sqrt()
    }

    /// The length of the sum of its faces, in the square of the unit of `spacing`: the area of a flat opening that is
    /// not seen from the side.
    pub fn area(&self, spacing: [f64; 3]) -> f64 {
        let [x, y, z] = spacing;
        let size = [y * z, x * z, x * y];
        let sum: f64 = (0..3)
            .map(|a| self.faces[a] as f64 * size[a])
            .map(|v| v * v)
            .sum();
        sum.sqrt()
    }
}

/// What is known of a pair of cells.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct PairRecord {
    cells: [u64; 2],
    voxel: u64,
    /// 0 if there is no neck in this record.
    level: u32,
    peak: u32,
    faces: [i64; 3],
}

impl Keyed for PairRecord {
    fn key(&self) -> [u64; 2] {
        self.cells
    }
}

/// Gathers necks and faces by pairs of cells.
#[derive(Debug)]
pub struct NeckSorter {
    sorter: Sorter<PairRecord>,
}

impl NeckSorter {
    /// Nothing yet; files are made in `dir`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], here and below.
    pub fn new(dir: &Path) -> Result<Self> {
        Ok(NeckSorter {
            sorter: Sorter::new(dir, ROOM)?,
        })
    }

    /// Takes what is known of two basins, of which a neck may be `(voxel, level, peak)`; `parts` has the parts of all
    /// basins. Nothing if these are one cell.
    fn push(
        &mut self,
        basins: [u64; 2],
        mut record: PairRecord,
        parts: &mut Numbers,
    ) -> Result<()> {
        let [a, b] = [parts.get(basins[0])? + 1, parts.get(basins[1])? + 1];
        if a == b {
            return Ok(());
        }
        if a > b {
            record.faces = record.faces.map(|faces| -faces);
        }
        record.cells = [a.min(b), a.max(b)];
        self.sorter.push(record)
    }

    /// A saddle of the tree.
    pub fn saddle(&mut self, saddle: &super::graph::TreeSaddle, parts: &mut Numbers) -> Result<()> {
        let record = PairRecord {
            cells: [0; 2],
            voxel: saddle.low,
            level: saddle.level,
            peak: saddle.peak,
            faces: [0; 3],
        };
        self.push(saddle.basins, record, parts)
    }

    /// Faces between two basins.
    pub fn faces(&mut self, shared: &SharedFaces, parts: &mut Numbers) -> Result<()> {
        let record = PairRecord {
            cells: [0; 2],
            voxel: 0,
            level: 0,
            peak: 0,
            faces: shared.faces,
        };
        self.push(shared.basins, record, parts)
    }

    /// Hands on all necks, by rising cells.
    pub fn finish(self, mut each: impl FnMut(Neck) -> Result<()>) -> Result<()> {
        let mut pair: Option<PairRecord> = None;
        let mut emit = |pair: Option<PairRecord>| match pair {
            Some(pair) if pair.level > 0 => each(Neck {
                cells: pair.cells,
                voxel: pair.voxel,
                level: pair.level,
                peak: pair.peak,
                faces: pair.faces,
            }),
            _ => Ok(()),
        };
        self.sorter.finish(|record| match &mut pair {
            Some(pair) if pair.cells == record.cells => {
                for (sum, faces) in pair.faces.iter_mut().zip(record.faces) {
                    *sum += faces;
                }
                if record.level > 0 {
                    (pair.voxel, pair.level, pair.peak) = (record.voxel, record.level, record.peak);
                }
                Ok(())
            }
            _ => emit(pair.replace(record)),
        })?;
        emit(pair)
    }
}

/// Faces between two basins, in a block.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SharedFaces {
    /// The basins, the smaller number first.
    pub basins: [u64; 2],
    /// As in [`Neck::faces`].
    pub faces: [i64; 3],
}
