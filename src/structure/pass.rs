//! The pass over the tiles.

use super::air::{Counts, Occupied};
use super::blocks::Blocks;
use super::crossings::{Crossing, Finder};
use super::fabric::{FabricSums, Space};
use super::members::Members;
use super::slice::SliceBits;
use crate::error::{Error, Result};
use crate::manifest::{Manifest, TileEntry};
use crate::progress::Progress;
use crate::tile::pieces::pieces;
use crate::tile::read::{ReadError, Tile};
use crate::tileset::TileSet;
use rayon::prelude::*;

/// What is gathered from tiles.
pub struct Gather<'a> {
    manifest: &'a Manifest,
    members: &'a Members,
    space: Space,
    finder: Finder,
    found: Found,
}

/// What was gathered.
pub struct Found {
    /// Of the surface that counts.
    pub fabric: FabricSums,
    /// Voxels by slices and blocks, if they are wanted.
    pub porosity: Option<Porosity>,
    /// The slice that is wanted.
    pub slice: Option<SliceBits>,
}

/// Sums over crossings.
pub struct Porosity {
    blocks: Blocks,
    above: Occupied,
    /// Of air around the sample, if its surface bounds it.
    outside: Option<Occupied>,
}

/// Voxels by slices and blocks.
pub struct Told {
    pub blocks: Blocks,
    pub above: Counts,
    /// Of air around the sample.
    pub outside: Option<Counts>,
}

impl Porosity {
    fn new(manifest: &Manifest, members: &Members) -> Self {
        let dims = manifest.grid.dims.0;
        let blocks = Blocks::new(dims, manifest.placement.spacing);
        let occupied = Occupied::new(dims, &blocks);
        Porosity {
            outside: members.bound_outside().then(|| occupied.clone()),
            above: occupied,
            blocks,
        }
    }

    /// The voxels; `None` if these are not as many as the index and the tables state.
    pub fn tell(self, manifest: &Manifest, members: &Members) -> Option<Told> {
        let outside = match self.outside {
            Some(outside) => Some(outside.finish(members.outside_voxels, &self.blocks)?),
            None => None,
        };
        Some(Told {
            above: self
                .above
                .finish(manifest.totals.voxels_above, &self.blocks)?,
            outside,
            blocks: self.blocks,
        })
    }
}

/// What one tile has.
#[derive(Default)]
struct OfTile {
    fabric: FabricSums,
    /// With whether it bounds air around the sample.
    crossings: Vec<(Crossing, bool)>,
}

impl<'a> Gather<'a> {
    /// For a tile set whose cells count as `members` say.
    pub fn new(
        manifest: &'a Manifest,
        members: &'a Members,
        porosity: bool,
        slice: Option<u32>,
    ) -> Self {
        let dims = manifest.grid.dims.0;
        let slice = slice.filter(|&z| porosity && z < dims[2]);
        Gather {
            manifest,
            members,
            space: Space::new(&manifest.measured()),
            finder: Finder::new(dims),
            found: Found {
                fabric: FabricSums::default(),
                porosity: porosity.then(|| Porosity::new(manifest, members)),
                slice: slice.map(|z| SliceBits::new(z as u16, [dims[0], dims[1]])),
            },
        }
    }

    /// Reads a tile.
    fn tile(&self, bytes: &[u8]) -> std::result::Result<OfTile, ReadError> {
        let kind = self.manifest.primitives;
        let mut of_tile = OfTile::default();
        for piece in pieces(&Tile::read(bytes)?, kind)? {
            // a cap is no surface between phases
            if piece.ids.cell == 0 {
                continue;
            }
            let counts = !self.members.left_out.contains(piece.ids.cell);
            let outside = self.members.outside.contains(piece.ids.cell);
            let points = piece.lattice()?;
            let OfTile { fabric, crossings } = &mut of_tile;
            piece.triangles(kind, |t| {
                let corners = t.map(|i| points[i as usize]);
                if counts {
                    fabric.add(corners, &self.space);
                }
                if self.found.porosity.is_some() {
                    let keep = &mut |crossing| crossings.push((crossing, outside));
                    self.finder.of_triangle(corners, keep);
                }
            });
        }
        Ok(of_tile)
    }

    /// Adds what a tile has.
    fn add(&mut self, of_tile: &OfTile) {
        self.found.fabric.merge(&of_tile.fabric);
        let Some(porosity) = &mut self.found.porosity else {
            return;
        };
        let Porosity {
            blocks,
            above,
            outside: around,
        } = porosity;
        for (crossing, outside) in &of_tile.crossings {
            above.add(crossing, crossing.falls, blocks);
            if let (true, Some(around)) = (outside, &mut *around) {
                around.add(crossing, !crossing.falls, blocks);
            }
            if let Some(slice) = &mut self.found.slice {
                slice.add(crossing);
            }
        }
    }

    /// What was gathered.
    pub fn finish(self) -> Found {
        self.found
    }
}

/// Goes through all tiles, as many at a time as there are threads; what they have is added in their order.
pub fn all_tiles(set: &TileSet, gather: &mut Gather, progress: &dyn Progress) -> Result<()> {
    progress.begin("reading tiles", set.manifest().totals.tiles);
    let at_once = rayon::current_num_threads().max(1);
    let mut entries = set.tiles();
    loop {
        if progress.interrupted() {
            return Err(Error::Interrupted);
        }
        let some: Vec<TileEntry> = entries.by_ref().take(at_once).collect::<Result<_>>()?;
        if some.is_empty() {
            return Ok(());
        }
        let read = |entry: &TileEntry| -> Result<OfTile> {
            let bytes = set.tile_bytes(entry)?;
            gather
                .tile(&bytes)
                .map_err(|e| Error::format(set.dir().join(&entry.path), e.to_string(), "a tile"))
        };
        let found: Vec<OfTile> = some.par_iter().map(read).collect::<Result<_>>()?;
        found.iter().for_each(|of_tile| gather.add(of_tile));
        progress.advance(some.len() as u64);
    }
}
