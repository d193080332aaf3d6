//! The edge of a region of interest: the surface there is none of the sample's, so the cells and objects that meet at it
//! touch the border.

use super::code::Code;
use super::marks::axis;
use super::piece::{Region, Vertex};
use super::report::Issues;
use crate::error::Result;
use crate::grid::{Cylinder, Fill, Shape};
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

    /// True if it is not known which voxels are inside.
    pub fn is_unknown(&self) -> bool {
        matches!(self, RegionEdge::Unknown)
    }

    /// The part of it in a tile.
    ///
    /// # Errors
    /// Those of [`RegionVoxels::rows`].
    pub fn in_tile(&self, tile: &Region) -> Result<TileEdge<'a>> {
        Ok(match *self {
            RegionEdge::None | RegionEdge::Unknown => TileEdge::None,
            RegionEdge::Cylinder(cylinder, start) => TileEdge::Cylinder(cylinder, start),
            RegionEdge::Mask(voxels) => {
                let [lo, hi] = [tile.lo, tile.hi].map(|p| p.map(|c| (c >> 8) as u32));
                let (mut bits, mut rows) = (Vec::new(), Vec::new());
                for z in lo[2]..=hi[2] {
                    voxels.rows(lo[1]..hi[1] + 1, z, &mut rows)?;
                    bits.extend_from_slice(&rows);
                }
                TileEdge::Bits {
                    bits,
                    row_words: row_words(voxels.dims().0[0]),
                    first: [lo[1], lo[2]],
                    rows: (hi[1] - lo[1] + 1) as usize,
                }
            }
        })
    }
}

/// The voxels of a tile that are inside.
#[derive(Default)]
pub(super) enum TileEdge<'a> {
    /// All, or it is not known.
    #[default]
    None,
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

impl TileEdge<'_> {
    /// True if the lattice edge of one of the vertices has an end outside of the region.
    pub fn cuts(&self, points: &[Vertex]) -> bool {
        if matches!(self, TileEdge::None) {
            return false;
        }
        points.iter().any(|&[x, y, z, code]| {
            let low = [x, y, z].map(|c| (c >> 8) as u32);
            let mut high = low;
            high[usize::from(axis(code))] += 1;
            !(self.holds(low) && self.holds(high))
        })
    }

    fn holds(&self, [x, y, z]: [u32; 3]) -> bool {
        match self {
            TileEdge::None => true,
            TileEdge::Cylinder(cylinder, start) => cylinder.holds(x + start[0], y + start[1]),
            TileEdge::Bits {
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
