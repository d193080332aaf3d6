//! The voxels of cells, where it is known of each voxel which cell it is of: summed up, and compared with rows of cells.

use super::code::Code;
use super::components::ComponentRows;
use super::inside::{Moments, Span, power_sums};
use super::labels::as_label;
use super::laws::Listed;
use super::spill::{Merge, Spill};
use crate::error::Result;
use crate::grid::{Extent, Placement};
use crate::manifest::{Manifest, PartsBy};

/// Records that a sort keeps in memory: 1.5 MiB.
const IN_MEMORY: usize = 1 << 13;
/// Words of a record: the cell, sums of two words each, a box, and how far it reaches.
const WORDS: usize = 1 + 2 * SUMS + 2 + 6;
const SUMS: usize = 10;

/// Sums over some voxels of a cell.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct CellVoxels {
    pub moments: Moments,
    pub span: Span,
    /// How far they reach along the axes of the world, if these are not the grid's.
    pub far: Extent,
}

impl CellVoxels {
    /// Adds the voxels of a row from the first `x` up to the second one.
    pub fn add_run(&mut self, x: [i32; 2], [y, z]: [i32; 2], rotated: Option<&Placement>) {
        let ends = x.map(|x| power_sums(x.into()));
        let n = i64::from(x[1] - x[0]);
        let [first, second] = [0, 1].map(|k| ends[1][k] - ends[0][k]);
        let (j, k) = (i64::from(y), i64::from(z));
        let m = &mut self.moments;
        m.voxels += i128::from(n);
        for (sum, v) in m.first.iter_mut().zip([first, n * j, n * k]) {
            *sum += i128::from(v);
        }
        let products = [
            second,
            n * j * j,
            n * k * k,
            first * j,
            first * k,
            n * j * k,
        ];
        for (sum, v) in m.second.iter_mut().zip(products) {
            *sum += i128::from(v);
        }
        let corners = [x[0], x[1] - 1].map(|x| [x, y, z]);
        let [lo, hi] = corners.map(|corner| corner.map(|c| c as u16));
        self.span.add(&Span { lo, hi });
        if let Some(place) = rotated {
            for corner in corners {
                self.far.add(place.step(corner.map(f64::from)));
            }
        }
    }

    fn add(&mut self, other: &CellVoxels) {
        let (m, o) = (&mut self.moments, &other.moments);
        m.voxels += o.voxels;
        let firsts = m.first.iter_mut().zip(o.first);
        firsts
            .chain(m.second.iter_mut().zip(o.second))
            .for_each(|(sum, v)| *sum += v);
        self.span.add(&other.span);
        self.far.merge(&other.far);
    }

    fn pack(&self, cell: u64) -> [u64; WORDS] {
        let m = &self.moments;
        let mut words = [0; WORDS];
        words[0] = cell;
        let sums = [m.voxels].into_iter().chain(m.first).chain(m.second);
        for (out, sum) in words[1..].chunks_exact_mut(2).zip(sums) {
            out.copy_from_slice(&[(sum >> 64) as u64, sum as u64]);
        }
        let corner = |[x, y, z]: [u16; 3]| u64::from(x) << 32 | u64::from(y) << 16 | u64::from(z);
        let at = 1 + 2 * SUMS;
        words[at] = corner(self.span.lo);
        words[at + 1] = corner(self.span.hi);
        words[at + 2..].copy_from_slice(&self.far.words());
        words
    }

    fn unpack(words: &[u64; WORDS]) -> Self {
        let sum = |i: usize| (i128::from(words[1 + 2 * i]) << 64) | i128::from(words[2 + 2 * i]);
        let corner = |word: u64| [32, 16, 0].map(|shift| (word >> shift) as u16);
        let at = 1 + 2 * SUMS;
        CellVoxels {
            moments: Moments {
                voxels: sum(0),
                first: std::array::from_fn(|i| sum(1 + i)),
                second: std::array::from_fn(|i| sum(4 + i)),
            },
            span: Span {
                lo: corner(words[at]),
                hi: corner(words[at + 1]),
            },
            far: Extent::from_words(std::array::from_fn(|i| words[at + 2 + i])),
        }
    }
}

/// Collects the voxels of cells, macrocube by macrocube.
pub(super) struct VoxelLedger {
    none: u64,
    by: &'static str,
    voxels: Spill<WORDS>,
}

impl VoxelLedger {
    /// `none` is the cell of voxels without a label; `by` names what says which voxels a cell has.
    pub fn new(none: u64, by: &'static str) -> Self {
        VoxelLedger {
            none,
            by,
            voxels: Spill::new(IN_MEMORY),
        }
    }

    /// # Errors
    /// If a temporary file cannot be written, here and below, or read back.
    pub fn add(&mut self, voxels: &[(u64, CellVoxels)]) -> Result<()> {
        voxels
            .iter()
            .try_for_each(|(cell, voxels)| self.voxels.push(voxels.pack(*cell)))
    }

    /// By rising cells.
    pub fn into_sorted(self) -> Result<SortedVoxels> {
        let mut merge = self.voxels.into_sorted()?;
        Ok(SortedVoxels {
            none: self.none,
            by: self.by,
            of_none: 0,
            next: merge.next()?,
            merge,
        })
    }
}

/// The voxels of cells, by rising cells.
pub(super) struct SortedVoxels {
    none: u64,
    by: &'static str,
    /// Voxels of the cell of those without a label.
    of_none: u64,
    next: Option<[u64; WORDS]>,
    merge: Merge<WORDS>,
}

impl SortedVoxels {
    /// The voxels of the next cell; none of another one.
    fn take(&mut self, cell: u64) -> Result<CellVoxels> {
        let mut sum = CellVoxels::default();
        while let Some(words) = self.next.filter(|next| next[0] == cell) {
            sum.add(&CellVoxels::unpack(&words));
            self.next = self.merge.next()?;
        }
        if cell == self.none {
            self.of_none = sum.moments.voxels as u64;
        }
        Ok(sum)
    }

    /// Compares the row of a cell with its voxels; rows come by rising cells.
    pub fn compare(
        &mut self,
        cell: u64,
        row: &[Option<f64>],
        rows: &ComponentRows,
        place: &str,
        listed: &mut Listed,
    ) -> Result<()> {
        self.skip_before(cell, listed)?;
        let found = self.take(cell)?;
        let mut wrong = Vec::new();
        if found.moments.voxels == 0 {
            wrong.push("it has no voxel below the threshold".to_owned());
        } else {
            rows.check_voxels(row, &found, &mut wrong);
        }
        if !wrong.is_empty() {
            let message = format!("cell {cell}, by the {}: {}", self.by, wrong.join("; "));
            listed.values.add(Code::TableValue, place, message);
        }
        Ok(())
    }

    fn skip_before(&mut self, cell: u64, listed: &mut Listed) -> Result<()> {
        while let Some(other) = self.next.map(|next| next[0]).filter(|next| *next < cell) {
            let count = self.take(other)?.moments.voxels;
            let message = format!(
                "found no row for cell {}, which has {count} voxels by the {}",
                as_label(other),
                self.by
            );
            listed.values.add(Code::TableRows, "cells.csv", message);
        }
        Ok(())
    }

    /// All rows have been seen.
    pub fn finish(mut self, manifest: &Manifest, listed: &mut Listed) -> Result<()> {
        self.skip_before(u64::MAX, listed)?;
        let Some(PartsBy::Labels { unlabelled, .. }) = &manifest.cells else {
            return Ok(());
        };
        if unlabelled.unwrap_or(0) != self.of_none {
            let message = format!(
                "found {}, by the labels {} voxels below have none",
                unlabelled.unwrap_or(0),
                self.of_none
            );
            let at = "index.json#/cells/unlabelled";
            listed.values.add(Code::ManifestValue, at, message);
        }
        Ok(())
    }
}
