//! Necks: where cells touch that are parts of one component.

use super::metric::Metric;
use super::touches::Touch;
use crate::error::Result;
use crate::sys::sorted_spill::{Keyed, Sorter};
use std::path::Path;

/// Records that are sorted in memory.
const ROOM: usize = 1 << 16;

/// The greatest saddle between two cells that touch.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Neck {
    /// The ids of the cells, the smaller one first.
    pub cells: [u64; 2],
    /// The narrowest place: linear index of the lower voxel of the saddle.
    pub voxel: u64,
    /// Its level.
    pub level: u32,
    /// The level of the lower one of the peaks that met there, if the cells were cut from each other there; 0 if they were
    /// apart already, cut at wider necks to others between them.
    pub peak: u32,
    /// Faces of voxels from the first cell to the second one, by axis: those along it less those against it.
    pub faces: [i64; 3],
}

impl Neck {
    /// Its radius, in steps along the finest axis.
    pub fn radius(&self, metric: &Metric) -> f64 {
        metric.radius(self.level)
    }

    /// Its radius over that of the cell whose peak is the lower one, at most 1, if the cells were cut from each other there.
    pub fn ratio(&self) -> Option<f64> {
        (self.peak > 0).then(|| (f64::from(self.level) / f64::from(self.peak)).sqrt())
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

impl Neck {
    /// Adds what is known of the same two cells elsewhere.
    pub fn merge(&mut self, other: &Neck) {
        for (sum, faces) in self.faces.iter_mut().zip(other.faces) {
            *sum += faces;
        }
        // of equal levels the smaller index is the greater
        if (other.level, self.voxel) > (self.level, other.voxel) {
            (self.voxel, self.level) = (other.voxel, other.level);
        }
        self.peak = self.peak.max(other.peak);
    }
}

impl Keyed for Neck {
    fn key(&self) -> [u64; 2] {
        self.cells
    }
}

/// Gathers necks and faces by pairs of cells.
#[derive(Debug)]
pub struct NeckSorter {
    sorter: Sorter<Neck>,
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

    /// Takes what is known of two basins, which are of these cells. Nothing if these are one.
    pub fn push(&mut self, [a, b]: [u64; 2], mut neck: Neck) -> Result<()> {
        if a == b {
            return Ok(());
        }
        if a > b {
            neck.faces = neck.faces.map(|faces| -faces);
        }
        neck.cells = [a.min(b), a.max(b)];
        self.sorter.push(neck)
    }

    /// Hands on all necks, by rising cells.
    pub fn finish(self, each: impl FnMut(Neck) -> Result<()>) -> Result<()> {
        self.sorter.finish_merged(Neck::merge, each)
    }
}

/// Two basins that touch, in a block.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct BasinTouch {
    /// The basins, the smaller number first.
    pub basins: [u64; 2],
    /// As in [`Neck::faces`].
    pub faces: [i64; 3],
    /// Linear index of the lower voxel of the greatest saddle.
    pub voxel: u64,
    /// Its level.
    pub level: u32,
    reserved: u32,
}

impl BasinTouch {
    /// As a neck, of which the cells are not known.
    pub fn neck(&self) -> Neck {
        Neck {
            cells: [0; 2],
            voxel: self.voxel,
            level: self.level,
            peak: 0,
            faces: self.faces,
        }
    }

    /// What was found in a block.
    pub fn of(touch: &Touch<u64>) -> Self {
        BasinTouch {
            basins: touch.basins,
            faces: touch.faces,
            voxel: touch.saddle.low.voxel,
            level: touch.saddle.low.level,
            reserved: 0,
        }
    }
}
