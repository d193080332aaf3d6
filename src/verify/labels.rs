//! The cells of all voxels, held against tiles and tables: of a volume of labels, or of cells that were split again.
//!
//! 1. Labels are read once, in order: they have the checksum that the index states, and the largest one tells the id of the
//!    cell of voxels without a label.
//! 2. With the bits of the scan, macrocube by macrocube, voxels below are summed up by their cells, and triangles begin at
//!    voxels of their cell.
//! 3. The sums are those of the table of cells: voxels, centroid, box and axes. It has a row for each cell with voxels
//!    below and for no other.
//!
//! In memory is a row of macrocubes along x; sums are sorted on disk ([`super::voxels`]).

use super::against::Mesh;
use super::code::Code;
use super::contacts::{self, ContactLedger, Contacts};
use super::piece::Region;
use super::report::{Issue, Issues, Severity};
use super::split::CellVolume;
use super::voxels::{CellVoxels, VoxelLedger};
use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Placement};
use crate::manifest::{Manifest, PartsBy};
use crate::progress::Progress;
use crate::volume::{Cropped, Volume, Voxel, with_voxel_type};
use std::collections::BTreeMap;
use std::ops::Range;

/// Bytes of labels that are read at once, but a row at least.
const AT_ONCE: usize = 4 << 20;

/// The volume of labels that cells were made by.
#[derive(Clone, Copy)]
pub struct LabelVolume<'a> {
    /// The file's name without its directory.
    pub name: &'a str,
    /// The labels of all voxels, of the size that the scan has before it is cropped.
    pub volume: &'a dyn Volume,
}

/// The cells of the row of macrocubes at hand, as labels.
pub(super) struct CellLabels<'a> {
    /// Cropped as the scan is.
    volume: Box<dyn Volume + 'a>,
    /// The id of the cell of voxels without a label.
    none: u64,
    /// What says so, for messages.
    by: &'static str,
    rows: Range<u32>,
    slices: Range<u32>,
    /// Eight-byte words, so that the bytes are aligned for every type.
    words: Vec<u64>,
    voxels: VoxelLedger,
    /// Where cells touch, and by which rule, if it is not known otherwise.
    contacts: Option<(Ambiguous, ContactLedger)>,
}

/// Triangles that begin at voxels of other cells than their own.
pub(super) struct Misplaced {
    count: u64,
    /// The first one's voxel, its cell and that of the voxel.
    first: [i32; 3],
    cells: [u64; 2],
    by: &'static str,
}

impl Misplaced {
    /// As a finding in a tile.
    pub fn issue(&self, path: &str) -> Issue {
        let [own, label] = self.cells;
        let message = format!(
            "triangles of cell {own} begin at a voxel of cell {} by the {}, as do triangles of other cells at {} more voxels",
            as_label(label),
            self.by,
            self.count - 1
        );
        Issue::new(Code::CellMixed, path, message).at(self.first.map(|v| 256 * v))
    }
}

/// What the labels say of a macrocube.
#[derive(Default)]
pub(super) struct CellsOfCube {
    /// Cells with their voxels below that are not the next macrocube's.
    pub voxels: Vec<(u64, CellVoxels)>,
    /// Where they touch, if that is looked for.
    pub contacts: Contacts,
    pub misplaced: Option<Misplaced>,
}

/// A cell as its label: cells of labels below 0, which no table has, come behind all others.
pub(super) fn as_label(cell: u64) -> i64 {
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
        let none = read.largest.unsigned_abs() + 1;
        let contacts = (manifest.ambiguous, ContactLedger::new());
        Ok(Some(CellLabels {
            contacts: Some(contacts),
            ..Self::new(volume, none, "labels")
        }))
    }

    /// Cells that were split again.
    pub fn of_split(cells: CellVolume) -> Self {
        // no voxel below is of none
        Self::new(Box::new(cells), u64::MAX, "rule of necks")
    }

    fn new(volume: Box<dyn Volume + 'a>, none: u64, by: &'static str) -> Self {
        CellLabels {
            volume,
            none,
            by,
            rows: 0..0,
            slices: 0..0,
            words: Vec::new(),
            voxels: VoxelLedger::new(none, by),
            contacts: None,
        }
    }

    /// The cell of a voxel of the row of macrocubes at hand, which is below.
    pub fn cell_at(&self, voxel: [i32; 3]) -> u64 {
        with_voxel_type!(self.volume.header().dtype, T => self.cell(self.row::<T>(voxel, 1)[0]))
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

    /// Sums up the voxels below of a macrocube, whose bits are those of `mesh`, and looks at where triangles begin: voxels
    /// with the cells of these. `rotated` is where the grid lies, if its axes are not those of the world.
    pub fn compare(
        &self,
        region: &Region,
        mesh: &Mesh,
        rotated: Option<&Placement>,
        begins: impl Iterator<Item = ([i32; 3], u64)>,
    ) -> CellsOfCube {
        with_voxel_type!(self.volume.header().dtype, T => {
            let mut found = CellsOfCube::default();
            self.sum::<T>(region, mesh, rotated, &mut found.voxels);
            if let Some((rule, _)) = self.contacts {
                let [lo, hi, end] = [region.lo, region.hi, region.end].map(|p| p.map(|c| c / 256));
                let slice = |z: i32, out: &mut Vec<u64>| self.slice::<T>([lo, hi], z, mesh, out);
                found.contacts = contacts::of_cube([lo, hi, end], rule, slice);
            }
            for (voxel, cell) in begins {
                let label = self.cell(self.row::<T>(voxel, 1)[0]);
                if label != cell {
                    let known = found.misplaced.get_or_insert(Misplaced {
                        count: 0,
                        first: voxel,
                        cells: [cell, label],
                        by: self.by,
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

    fn sum<T: Voxel>(
        &self,
        region: &Region,
        mesh: &Mesh,
        rotated: Option<&Placement>,
        out: &mut Vec<(u64, CellVoxels)>,
    ) {
        let [lo, hi, end] = [region.lo, region.hi, region.end].map(|p| p.map(|c| c / 256));
        // those that are shared with the next macrocube are counted there
        let own = |a: usize| lo[a]..hi[a] + i32::from(hi[a] == end[a]);
        let mut found: BTreeMap<u64, CellVoxels> = BTreeMap::new();
        let (len, mut runs) = (own(0).len(), Vec::new());
        for z in own(2) {
            for y in own(1) {
                let start = mesh.block.index([lo[0], y, z].map(|c| c * 256));
                let bits = &mesh.bits[start..start + len];
                let labels = self.row::<T>([lo[0], y, z], len);
                let mut at = 0;
                runs.clear();
                runs.extend(bits.iter().zip(labels));
                for same in runs.chunk_by(|a, b| a == b) {
                    let (first, (bit, label)) = (at, same[0]);
                    at += same.len();
                    if *bit == 0 {
                        let sums = found.entry(self.cell(*label)).or_default();
                        let x = [first, at].map(|x| lo[0] + x as i32);
                        sums.add_run(x, [y, z], rotated);
                    }
                }
            }
        }
        out.extend(found);
    }

    /// The cells of a slice of a macrocube, 0 for voxels above.
    fn slice<T: Voxel>(&self, [lo, hi]: [[i32; 3]; 2], z: i32, mesh: &Mesh, out: &mut Vec<u64>) {
        out.clear();
        let len = (hi[0] - lo[0] + 1) as usize;
        for y in lo[1]..=hi[1] {
            let start = mesh.block.index([lo[0], y, z].map(|c| c * 256));
            let bits = &mesh.bits[start..start + len];
            let labels = self.row::<T>([lo[0], y, z], len);
            let cell = |(bit, label): (&u8, &T)| if *bit == 0 { self.cell(*label) } else { 0 };
            out.extend(bits.iter().zip(labels).map(cell));
        }
    }

    /// Adds what a macrocube has.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn add(&mut self, voxels: &[(u64, CellVoxels)], contacts: &Contacts) -> Result<()> {
        self.voxels.add(voxels)?;
        match &mut self.contacts {
            Some((_, ledger)) => ledger.add(contacts),
            None => Ok(()),
        }
    }

    /// The voxels of all macrocubes, and where cells touch.
    pub fn into_ledgers(self) -> (VoxelLedger, Option<ContactLedger>) {
        (self.voxels, self.contacts.map(|contacts| contacts.1))
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
