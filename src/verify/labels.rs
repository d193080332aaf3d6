//! Cells that a volume of labels gives, held against that volume.
//!
//! 1. The labels are read once, in order: they have the checksum that the index states, and the largest one tells the id
//!    of the cell of voxels without a label.
//! 2. With the bits of the scan, macrocube by macrocube, voxels below are counted by their labels, and triangles begin at
//!    voxels of their cell.
//! 3. The counts are those of the table of cells, which has a row for each label with voxels below and for no other.
//!
//! In memory is a row of macrocubes along x; counts are sorted on disk.

use super::against::Mesh;
use super::code::Code;
use super::laws::Listed;
use super::piece::Region;
use super::report::{Issue, Issues, Severity};
use super::spill::{Merge, Spill};
use crate::error::{Error, Result};
use crate::manifest::{Manifest, PartsBy};
use crate::progress::Progress;
use crate::volume::{Cropped, Volume, Voxel, with_voxel_type};
use std::collections::BTreeMap;
use std::ops::Range;

/// Bytes of labels that are read at once, but a row at least.
const AT_ONCE: usize = 4 << 20;
/// Counts that a sort keeps in memory: 1 MiB.
const IN_MEMORY: usize = 1 << 16;

/// The volume of labels that cells were made by.
#[derive(Clone, Copy)]
pub struct LabelVolume<'a> {
    /// The file's name without its directory.
    pub name: &'a str,
    /// The labels of all voxels, of the size that the scan has before it is cropped.
    pub volume: &'a dyn Volume,
}

/// The labels of the row of macrocubes at hand.
pub(super) struct CellLabels<'a> {
    /// Cropped as the scan is.
    volume: Box<dyn Volume + 'a>,
    /// The id of the cell of voxels without a label.
    none: u64,
    rows: Range<u32>,
    slices: Range<u32>,
    /// Eight-byte words, so that the bytes are aligned for every type.
    words: Vec<u64>,
    /// Voxels below by cells, a record for each cell in a macrocube.
    counts: Spill<2>,
}

/// Triangles that begin at voxels of other cells than their own.
pub(super) struct Misplaced {
    count: u64,
    /// The first one's voxel, its cell and that of the voxel.
    first: [i32; 3],
    cells: [u64; 2],
}

impl Misplaced {
    /// As a finding in a tile.
    pub fn issue(&self, path: &str) -> Issue {
        let [own, label] = self.cells;
        let message = format!(
            "triangles of cell {own} begin at a voxel of cell {} by its label, as do triangles of other cells at {} more \
             voxels",
            as_label(label),
            self.count - 1
        );
        Issue::new(Code::CellMixed, path, message).at(self.first.map(|v| 256 * v))
    }
}

/// What the labels say of a macrocube.
#[derive(Default)]
pub(super) struct CellsOfCube {
    /// Cells with their voxels below that are not the next macrocube's.
    pub counts: Vec<[u64; 2]>,
    pub misplaced: Option<Misplaced>,
}

/// A cell as its label: cells of labels below 0, which no table has, come behind all others.
fn as_label(cell: u64) -> i64 {
    cell as i64
}

impl<'a> CellLabels<'a> {
    /// Reads all labels; `None` if they are of another size, which is an issue.
    ///
    /// # Errors
    /// The volume's; [`Error::Usage`] if cells are not those of labels, or the volume has no whole numbers;
    /// [`Error::Interrupted`].
    pub fn find(
        labels: LabelVolume<'a>,
        manifest: &Manifest,
        progress: &dyn Progress,
        issues: &mut Issues,
    ) -> Result<Option<Self>> {
        let Some(PartsBy::Labels { file, checksum, .. }) = &manifest.cells else {
            let expected = "a tile set made by alvis convert --labels";
            return Err(Error::usage("--labels", "a set without labels", expected));
        };
        let header = labels.volume.header();
        if header.dtype.is_float() {
            let found = format!("samples of type {}", header.dtype);
            return Err(Error::usage("--labels", found, "whole numbers"));
        }
        let crop = manifest.source.crop.as_ref();
        let volume = match Cropped::part(Box::new(labels.volume), crop) {
            Ok(volume) if volume.header().dims == manifest.grid.dims => volume,
            _ => {
                let message = format!(
                    "found labels of {} voxels, expected those of a grid of {}",
                    header.dims, manifest.grid.dims
                );
                issues.add(Code::VolumeMismatch, "index.json#/cells/file", message);
                return Ok(None);
            }
        };
        let read = with_voxel_type!(header.dtype, T => read_all::<T>(labels.volume, progress))?;
        if read.checksum != *checksum {
            let message = format!("stated {checksum}, the labels have {}", read.checksum);
            issues.add(Code::SourceMismatch, "index.json#/cells/checksum", message);
        } else if labels.name != file {
            let message = format!(
                "the labels are named {:?}, those of the set {file:?}",
                labels.name
            );
            issues.push(Issue {
                severity: Severity::Warning,
                ..Issue::new(Code::SourceMismatch, "index.json#/cells/file", message)
            });
        }
        Ok(Some(CellLabels {
            volume,
            none: read.largest.unsigned_abs() + 1,
            rows: 0..0,
            slices: 0..0,
            words: Vec::new(),
            counts: Spill::new(IN_MEMORY),
        }))
    }

    /// Reads the row of macrocubes along x that a macrocube is of.
    ///
    /// # Errors
    /// The volume's.
    pub fn load(&mut self, region: &Region) -> Result<()> {
        let range = |a: usize| region.lo[a] as u32 / 256..region.hi[a] as u32 / 256 + 1;
        (self.rows, self.slices) = (range(1), range(2));
        let header = self.volume.header();
        let x = 0..header.dims.0[0];
        let labels = x.len() * self.rows.len() * self.slices.len();
        let bytes = labels * header.dtype.bytes();
        self.words.clear();
        self.words.resize(bytes.div_ceil(8), 0);
        let out = &mut bytemuck::cast_slice_mut(&mut self.words)[..bytes];
        self.volume
            .read_box(x, self.rows.clone(), self.slices.clone(), out)
    }

    /// Counts the voxels below of a macrocube, whose bits are those of `mesh`, and looks at where triangles begin: voxels
    /// with the cells of these.
    pub fn compare(
        &self,
        region: &Region,
        mesh: &Mesh,
        begins: impl Iterator<Item = ([i32; 3], u64)>,
    ) -> CellsOfCube {
        with_voxel_type!(self.volume.header().dtype, T => {
            let mut found = CellsOfCube::default();
            self.count::<T>(region, mesh, &mut found.counts);
            for (voxel, cell) in begins {
                let label = self.cell(self.row::<T>(voxel, 1)[0]);
                if label != cell {
                    let known = found.misplaced.get_or_insert(Misplaced {
                        count: 0,
                        first: voxel,
                        cells: [cell, label],
                    });
                    known.count += 1;
                }
            }
            found
        })
    }

    fn cell<T: Voxel>(&self, label: T) -> u64 {
        match label.to_f64() as i64 {
            0 => self.none,
            label => label as u64,
        }
    }

    fn row<T: Voxel>(&self, [x, y, z]: [i32; 3], len: usize) -> &[T] {
        let nx = self.volume.header().dims.0[0] as usize;
        let all = nx * self.rows.len() * self.slices.len();
        // the last word may reach beyond the last label
        let labels: &[T] = &bytemuck::cast_slice(&self.words)[..all];
        let [y, z] = [y as u32 - self.rows.start, z as u32 - self.slices.start];
        let start = x as usize + nx * (y as usize + self.rows.len() * z as usize);
        &labels[start..start + len]
    }

    fn count<T: Voxel>(&self, region: &Region, mesh: &Mesh, counts: &mut Vec<[u64; 2]>) {
        let [lo, hi, end] = [region.lo, region.hi, region.end].map(|p| p.map(|c| c / 256));
        // those that are shared with the next macrocube are counted there
        let own = |a: usize| lo[a]..hi[a] + i32::from(hi[a] == end[a]);
        let mut found: BTreeMap<u64, u64> = BTreeMap::new();
        let len = own(0).len();
        for z in own(2) {
            for y in own(1) {
                let start = mesh.block.index([lo[0], y, z].map(|c| c * 256));
                let bits = &mesh.bits[start..start + len];
                let labels = self.row::<T>([lo[0], y, z], len);
                let mut at = 0;
                for same in labels.chunk_by(|a, b| a == b) {
                    let bits = &bits[at..at + same.len()];
                    at += same.len();
                    let below = bits.iter().filter(|&&bit| bit == 0).count();
                    if below > 0 {
                        *found.entry(self.cell(same[0])).or_default() += below as u64;
                    }
                }
            }
        }
        counts.extend(found.into_iter().map(|(cell, count)| [cell, count]));
    }

    /// Adds the counts of a macrocube.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn add(&mut self, counts: &[[u64; 2]]) -> Result<()> {
        counts.iter().try_for_each(|count| self.counts.push(*count))
    }

    /// The counts of all macrocubes.
    pub fn into_counts(self) -> LabelCounts {
        LabelCounts {
            none: self.none,
            counts: self.counts,
        }
    }
}

/// What a pass over all labels tells.
struct Read {
    checksum: String,
    /// 0 if no label is above.
    largest: i64,
}

fn read_all<T: Voxel>(volume: &dyn Volume, progress: &dyn Progress) -> Result<Read> {
    let [nx, ny, nz] = volume.header().dims.0;
    progress.begin("labels", nz.into());
    let mut crc = crc32fast::Hasher::new();
    let rows = (AT_ONCE / (nx as usize * size_of::<T>())).clamp(1, ny as usize);
    let (mut labels, mut largest) = (Vec::new(), 0);
    for z in 0..nz {
        if progress.interrupted() {
            return Err(Error::Interrupted);
        }
        for first in (0..ny).step_by(rows) {
            let end = ny.min(first + rows as u32);
            labels.resize(nx as usize * (end - first) as usize, T::zeroed());
            let bytes = bytemuck::cast_slice_mut(&mut labels);
            volume.read_box(0..nx, first..end, z..z + 1, bytes)?;
            for row in labels.chunks_exact(nx as usize) {
                largest = largest.max(add_row(row, &mut crc));
            }
        }
        progress.advance(1);
    }
    Ok(Read {
        checksum: format!("crc32:{:08x}", crc.finalize()),
        largest,
    })
}

/// Adds the stretches of a row to the checksum: where each begins, and its label; returns the largest of these.
fn add_row<T: Voxel>(row: &[T], crc: &mut crc32fast::Hasher) -> i64 {
    let (mut x, mut largest) = (0u64, i64::MIN);
    for same in row.chunk_by(|a, b| a == b) {
        let label = same[0].to_f64() as i64;
        crc.update(&x.to_le_bytes());
        crc.update(&label.to_le_bytes());
        largest = largest.max(label);
        x += same.len() as u64;
    }
    largest
}

/// Voxels below by cells, before they are sorted.
pub(super) struct LabelCounts {
    none: u64,
    counts: Spill<2>,
}

impl LabelCounts {
    /// # Errors
    /// If a temporary file cannot be read back, here and below.
    pub fn into_sorted(self) -> Result<SortedCounts> {
        let mut merge = self.counts.into_sorted()?;
        Ok(SortedCounts {
            none: self.none,
            of_none: 0,
            next: merge.next()?,
            merge,
        })
    }
}

/// Voxels below by rising cells.
pub(super) struct SortedCounts {
    none: u64,
    /// Voxels of the cell of those without a label.
    of_none: u64,
    next: Option<[u64; 2]>,
    merge: Merge<2>,
}

impl SortedCounts {
    /// The voxels of the next cell.
    fn take(&mut self, cell: u64) -> Result<u64> {
        let mut sum = 0;
        while let Some([_, count]) = self.next.filter(|next| next[0] == cell) {
            sum += count;
            self.next = self.merge.next()?;
        }
        if cell == self.none {
            self.of_none = sum;
        }
        Ok(sum)
    }

    /// Compares the number of voxels that the row of a cell states; rows come by rising cells.
    pub fn compare(
        &mut self,
        cell: u64,
        stated: Option<f64>,
        place: &str,
        listed: &mut Listed,
    ) -> Result<()> {
        self.skip_before(cell, listed)?;
        let found = self.take(cell)?;
        if stated != Some(found as f64) {
            let stated = stated.map_or("nothing".to_owned(), |v| v.to_string());
            let message = format!(
                "cell {cell}: voxels {stated}, by the labels it has {found} below the threshold"
            );
            listed.values.add(Code::TableValue, place, message);
        }
        Ok(())
    }

    fn skip_before(&mut self, cell: u64, listed: &mut Listed) -> Result<()> {
        while let Some([other, _]) = self.next.filter(|next| next[0] < cell) {
            let count = self.take(other)?;
            let message = format!(
                "found no row for cell {}, which has {count} voxels by the labels",
                as_label(other)
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
