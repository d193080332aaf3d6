//! The edge of a region of interest: the surface there is none of the sample's, so the cells and objects that meet at it
//! touch the border.

use super::code::Code;
use super::marks::axis;
use super::piece::{Region, Vertex};
use super::report::Issues;
use super::rim::cell_is_low;
use crate::error::Result;
use crate::grid::{Ambiguous, Cylinder, Dims, Fill, Shape};
use crate::manifest::Manifest;
use crate::volume::{RegionVoxels, row_words};

/// What is known of the region of a tile set.
#[derive(Clone, Copy)]
pub(super) enum RegionEdge<'a> {
    /// All of the grid counts.
    None,
    /// A cylinder, and the x and y of the voxel that the grid begins with.
    Cylinder(&'a Cylinder, [u32; 2]),
    /// The voxels of the grid that a mask holds.
    Mask(&'a RegionVoxels),
    /// A mask that is not at hand.
    Unknown,
}

impl<'a> RegionEdge<'a> {
    /// `mask` are the voxels of the grid that are inside, if they are known.
    pub fn of(manifest: &'a Manifest, mask: Option<&'a RegionVoxels>) -> Self {
        let start = manifest.source.crop.as_ref().map_or([0; 3], |c| c.start());
        match (manifest.region.as_ref().map(|region| &region.shape), mask) {
            (None, _) => RegionEdge::None,
            (Some(Shape::Cylinder(cylinder)), _) => {
                RegionEdge::Cylinder(cylinder, [start[0], start[1]])
            }
            (Some(Shape::Mask { .. }), Some(voxels)) => RegionEdge::Mask(voxels),
            // one that holds all of the grid has no edge in it
            (Some(Shape::Mask { .. }), None) if holds_all(manifest) => RegionEdge::None,
            (Some(Shape::Mask { .. }), None) => RegionEdge::Unknown,
        }
    }

    /// Compares what the manifest states of the region with what it is.
    ///
    /// # Errors
    /// Those of [`RegionVoxels::count`].
    pub fn check(&self, manifest: &Manifest, issues: &mut Issues) -> Result<()> {
        let Some(stated) = &manifest.region else {
            return Ok(());
        };
        let dims = manifest.grid.dims;
        let mut wrong = |name: &str, message: String| {
            let path = format!("index.json#/region/{name}");
            issues.add(Code::ManifestValue, path, message);
        };
        let count = match self {
            RegionEdge::Cylinder(cylinder, [x, y]) => {
                let finite = cylinder.centre.iter().all(|c| c.is_finite());
                if !(finite && cylinder.radius > 0.0 && cylinder.radius.is_finite()) {
                    wrong("radius", format!("found {cylinder}, expected a cylinder"));
                }
                let [nx, ny, nz] = dims.0;
                let row = |v: u32| (*x..x + nx).filter(|&u| cylinder.holds(u, v)).count();
                let slice: u64 = (*y..y + ny).map(|v| row(v) as u64).sum();
                Some(slice * u64::from(nz))
            }
            RegionEdge::Mask(voxels) => Some(voxels.count()?),
            RegionEdge::None | RegionEdge::Unknown => None,
        };
        let found = stated.voxels;
        if let Some(count) = count.filter(|count| *count != found) {
            let message = format!("found {found}, {count} voxels are inside");
            wrong("voxels", message);
        } else if !(1..=dims.voxels()).contains(&found) {
            let message = format!("found {found}, expected 1 to {}", dims.voxels());
            wrong("voxels", message);
        } else if let Some(least) = least(manifest).filter(|least| found < *least) {
            let fill = stated.fill;
            let message = format!(
                "found {found}, of which {least} at least are inside: all that is outside is {fill}"
            );
            wrong("voxels", message);
        }
        if let Shape::Mask { checksum, .. } = &stated.shape
            && manifest.source.crop.is_none()
            && holds_all(manifest) != (*checksum == checksum_of_all(dims))
        {
            let message = "voxels and checksum contradict each other: of a mask that holds all of the grid each tells so";
            wrong("checksum", message.to_owned());
        }
        let above = stated.fill_value >= manifest.threshold;
        if above != (stated.fill == Fill::Material) || !stated.fill_value.is_finite() {
            let message = format!(
                "found {}, which is not on the side of {} of the threshold {}",
                stated.fill_value, stated.fill, manifest.threshold
            );
            wrong("fill_value", message);
        }
        Ok(())
    }

    /// The voxels of a slice of `nx` x `ny` that are inside, in words of 64 along x for each row, the lowest bit first; all
    /// that are not known to be outside.
    ///
    /// # Errors
    /// Those of [`RegionVoxels::rows`].
    pub fn slice(&self, [nx, ny]: [u32; 2], z: u32, out: &mut Vec<u64>) -> Result<()> {
        let words = row_words(nx);
        out.clear();
        match self {
            RegionEdge::None | RegionEdge::Unknown => out.resize(words * ny as usize, !0),
            RegionEdge::Mask(voxels) => voxels.rows(0..ny, z, out)?,
            RegionEdge::Cylinder(cylinder, start) => {
                out.resize(words * ny as usize, 0);
                for (y, row) in (start[1]..).zip(out.chunks_exact_mut(words)) {
                    for x in (0..nx).filter(|x| cylinder.holds(x + start[0], y)) {
                        row[x as usize / 64] |= 1 << (x % 64);
                    }
                }
            }
        }
        Ok(())
    }

    /// True if it is not known which voxels are inside.
    pub fn is_unknown(&self) -> bool {
        matches!(self, RegionEdge::Unknown)
    }

    /// The part of it in a tile of a set.
    ///
    /// # Errors
    /// Those of [`RegionVoxels::rows`].
    pub fn in_tile(&self, tile: &Region, manifest: &Manifest) -> Result<TileEdge<'a>> {
        let [lo, hi] = [tile.lo, tile.hi].map(|p| p.map(|c| (c >> 8) as u32));
        let inside = match *self {
            RegionEdge::None | RegionEdge::Unknown => TileVoxels::All,
            RegionEdge::Cylinder(cylinder, start) => TileVoxels::Cylinder(cylinder, start),
            RegionEdge::Mask(voxels) => {
                let (mut bits, mut rows) = (Vec::new(), Vec::new());
                for z in lo[2]..=hi[2] {
                    voxels.rows(lo[1]..hi[1] + 1, z, &mut rows)?;
                    bits.extend_from_slice(&rows);
                }
                TileVoxels::Bits {
                    bits,
                    row_words: row_words(voxels.dims().0[0]),
                    first: [lo[1], lo[2]],
                    rows: (hi[1] - lo[1] + 1) as usize,
                }
            }
        };
        let fill = manifest.region.as_ref().map(|region| region.fill);
        let joined = match (manifest.ambiguous, fill) {
            (Ambiguous::Separate, Some(Fill::Material)) => Joined::Cells,
            (Ambiguous::Join, Some(Fill::Air)) => Joined::Objects,
            _ => Joined::None,
        };
        Ok(TileEdge {
            inside,
            range: [lo, hi],
            joined,
        })
    }
}

/// True if the manifest states that no voxel of the grid is outside.
fn holds_all(manifest: &Manifest) -> bool {
    let outside = |region: &crate::grid::Region| region.outside(manifest.grid.dims);
    manifest.region.as_ref().is_some_and(|r| outside(r) == 0)
}

/// The voxels of the phase that no voxel outside is of, which are all inside.
fn least(manifest: &Manifest) -> Option<u64> {
    let above = match &manifest.selection {
        Some(part) => part.of.voxels_above,
        None => manifest.totals.voxels_above,
    };
    match manifest.region.as_ref()?.fill {
        Fill::Material => Some(manifest.grid.dims.voxels().saturating_sub(above)),
        Fill::Air => Some(above),
    }
}

/// The checksum of a mask that holds all voxels, see [`Shape::Mask`].
fn checksum_of_all(dims: Dims) -> String {
    let [nx, ny, nz] = dims.0;
    let mut row = crc32fast::Hasher::new();
    for first in (0..nx).step_by(64) {
        let left = (nx - first).min(64);
        row.update(&(!0u64 >> (64 - left)).to_le_bytes());
    }
    let mut slice = crc32fast::Hasher::new();
    (0..ny).for_each(|_| slice.combine(&row));
    let mut all = crc32fast::Hasher::new();
    (0..nz).for_each(|_| all.combine(&slice));
    format!("crc32:{:08x}", all.finalize())
}

/// What would go on outside of the region across the edges of voxels, if that was not filled.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Joined {
    /// What is joined so is what fills the outside.
    None,
    Cells,
    Objects,
}

/// The voxels of a tile that are inside.
enum TileVoxels<'a> {
    /// All, or it is not known.
    All,
    /// See [`RegionEdge::Cylinder`].
    Cylinder(&'a Cylinder, [u32; 2]),
    /// A bit for each voxel of some rows.
    Bits {
        bits: Vec<u64>,
        row_words: usize,
        /// The first row and slice.
        first: [u32; 2],
        /// Rows of a slice.
        rows: usize,
    },
}

/// The edge of the region in a tile.
pub(super) struct TileEdge<'a> {
    inside: TileVoxels<'a>,
    /// The first and the last voxel of the tile.
    range: [[u32; 3]; 2],
    joined: Joined,
}

impl TileEdge<'_> {
    /// Without a region.
    pub fn none() -> Self {
        TileEdge {
            inside: TileVoxels::All,
            range: [[0; 3]; 2],
            joined: Joined::None,
        }
    }

    /// True if the lattice edge of one of the vertices has an end outside of the region, or if the component whose end is
    /// joined across the edges of voxels meets a voxel outside so.
    pub fn cuts(&self, points: &[Vertex], state: &[u8]) -> bool {
        if matches!(self.inside, TileVoxels::All) {
            return false;
        }
        points.iter().zip(state).any(|(&[x, y, z, code], state)| {
            let along = usize::from(axis(code));
            let low = [x, y, z].map(|c| (c >> 8) as u32);
            let mut high = low;
            high[along] += 1;
            if !(self.holds(low) && self.holds(high)) {
                return true;
            }
            // beside the end that is of the other phase
            let other = match (self.joined, cell_is_low(*state)) {
                (Joined::None, _) => return false,
                (Joined::Cells, true) | (Joined::Objects, false) => high,
                (Joined::Cells, false) | (Joined::Objects, true) => low,
            };
            let across = (0..3).filter(|a| *a != along);
            let mut beside = across.flat_map(|a| [-1, 1].map(|step| (a, step)));
            beside.any(|(a, step)| {
                let mut at = other;
                at[a] = at[a].wrapping_add_signed(step);
                // what lies beyond the tile is seen from the next one
                let [first, last] = self.range;
                (first[a]..=last[a]).contains(&at[a]) && !self.holds(at)
            })
        })
    }

    fn holds(&self, [x, y, z]: [u32; 3]) -> bool {
        match &self.inside {
            TileVoxels::All => true,
            TileVoxels::Cylinder(cylinder, start) => cylinder.holds(x + start[0], y + start[1]),
            TileVoxels::Bits {
                bits,
                row_words,
                first,
                rows,
            } => {
                let row = (y - first[0]) as usize + rows * (z - first[1]) as usize;
                bits[row * row_words + x as usize / 64] >> (x % 64) & 1 == 1
            }
        }
    }
}
