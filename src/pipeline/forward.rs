//! What the forward sweep gathers: components, surfaces and tiles in terms of each slab's classes.

use crate::error::Result;
use crate::measure::{MeshSums, VoxelSums};
use crate::pipeline::band::Band;
use crate::pipeline::spool::{Place, Spool};
use crate::pipeline::surfaces::{SlabSurface, SlabSurfaces, SurfacePart, Surfaces};
use crate::pipeline::tilefile::{TileRecord, WrittenPiece};
use crate::segment::{Births, Classes, LocalComponent, PhaseBirths, SlabClasses};
use bytemuck::{Pod, Zeroable};
use std::path::Path;

/// A component that will not grow any more.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct FinishedComponent {
    /// Sums of its voxels.
    pub sums: VoxelSums,
    /// Its number.
    pub birth: u64,
    reserved: u64,
}

/// What the sweep leaves of one slab.
#[derive(Debug)]
pub struct SlabRecord {
    /// z index of its macrocubes.
    pub layer: u32,
    /// Number of each class.
    pub births: Place<u64>,
    /// 1 for objects, 0 for cells, per class.
    pub above: Place<u8>,
    /// See [`SlabClasses`].
    pub live: Place<u32>,
    /// See [`SlabClasses`].
    pub from_previous: Place<u32>,
    /// All surfaces.
    pub surfaces: Place<SlabSurface>,
    /// See [`SlabSurfaces`].
    pub surfaces_live: Place<u32>,
    /// See [`SlabSurfaces`].
    pub surfaces_from_previous: Place<u32>,
    /// The tiles, by y, then x.
    pub tiles: Place<TileRecord>,
    /// Their pieces, tile after tile.
    pub pieces: Place<WrittenPiece>,
}

/// What the whole sweep leaves.
pub struct Forward {
    /// The arrays of all slabs.
    pub spool: Spool,
    /// By rising z.
    pub slabs: Vec<SlabRecord>,
    /// Finished objects and cells, in the order of finishing.
    pub objects: Spool,
    /// Finished cells.
    pub cells: Spool,
    /// Numbers of objects and cells.
    pub births: PhaseBirths,
    /// Numbers of surfaces.
    pub surface_births: Births,
    /// NaN samples.
    pub nan: u64,
    /// Sums over all caps.
    pub caps: MeshSums,
    /// Objects and cells that were left out: how many, and their voxels.
    pub dust: [(u64, u64); 2],
}

/// The result of one tile.
pub struct TileResult {
    /// The tile.
    pub record: TileRecord,
    /// Its pieces.
    pub pieces: Vec<WrittenPiece>,
    /// What its pieces add to surfaces.
    pub parts: Vec<SurfacePart>,
    /// Sums over its caps.
    pub caps: MeshSums,
}

/// The sweep's state between slabs.
pub struct State {
    /// What has been gathered.
    pub forward: Forward,
    classes: Classes,
    surfaces: Surfaces,
}

impl State {
    /// Nothing gathered; temporary files are made in `work`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(work: &Path) -> Result<Self> {
        let spool = || Spool::new(work);
        let births = || Births::new(work);
        let forward = Forward {
            spool: spool()?,
            slabs: Vec::new(),
            objects: spool()?,
            cells: spool()?,
            births: PhaseBirths {
                objects: births()?,
                cells: births()?,
            },
            surface_births: births()?,
            nan: 0,
            caps: MeshSums::default(),
            dust: [(0, 0); 2],
        };
        Ok(State {
            forward,
            classes: Classes::default(),
            surfaces: Surfaces::default(),
        })
    }

    /// Joins a slab's bands, by rising y, to classes.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn join<T>(&mut self, bands: &[Band<T>], last_layer: bool) -> Result<SlabClasses> {
        self.forward.nan += bands.iter().map(|b| b.nan).sum::<u64>();
        let edges: Vec<_> = bands.iter().map(|b| &b.edges).collect();
        let components: Vec<&[LocalComponent]> =
            bands.iter().map(|b| &b.labels.components[..]).collect();
        let mut classes = self
            .classes
            .join(&edges, &components, &mut self.forward.births)?;
        if last_layer {
            classes.live.clear(); // nothing grows beyond the last slice
        }
        Ok(classes)
    }

    /// Joins the slab's surfaces, writes off what has finished and spools the rest.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn finish_slab(
        &mut self,
        layer: u32,
        classes: &SlabClasses,
        tiles: Vec<TileResult>,
    ) -> Result<()> {
        let forward = &mut self.forward;
        tiles.iter().for_each(|t| forward.caps.merge(&t.caps));
        let parts = tiles.iter().flat_map(|t| &t.parts).copied();
        let surfaces = self
            .surfaces
            .join(classes, parts, &mut forward.surface_births)?;
        let mut live = classes.live.iter().peekable();
        for (class, record) in classes.records.iter().enumerate() {
            if live.peek() == Some(&&(class as u32)) {
                live.next();
                continue;
            }
            let finished = FinishedComponent {
                sums: record.sums,
                birth: record.birth,
                reserved: 0,
            };
            let spool = if record.above {
                &mut forward.objects
            } else {
                &mut forward.cells
            };
            spool.push(&[finished])?;
        }
        let slab = spool_slab(layer, classes, &surfaces, tiles, &mut forward.spool)?;
        forward.slabs.push(slab);
        Ok(())
    }
}

/// Spools a slab; its pieces learn their surfaces.
fn spool_slab(
    layer: u32,
    classes: &SlabClasses,
    surfaces: &SlabSurfaces,
    tiles: Vec<TileResult>,
    spool: &mut Spool,
) -> Result<SlabRecord> {
    let births: Vec<u64> = classes.records.iter().map(|r| r.birth).collect();
    let above: Vec<u8> = classes.records.iter().map(|r| u8::from(r.above)).collect();
    let mut records = Vec::with_capacity(tiles.len());
    let mut all_pieces = Vec::new();
    for TileResult {
        record, mut pieces, ..
    } in tiles
    {
        records.push(record);
        for piece in pieces.iter_mut().filter(|p| !p.is_cap()) {
            piece.surface = surfaces.find(piece.object, piece.cell);
        }
        all_pieces.extend(pieces);
    }
    Ok(SlabRecord {
        layer,
        births: spool.push(&births)?,
        above: spool.push(&above)?,
        live: spool.push(&classes.live)?,
        from_previous: spool.push(&classes.from_previous)?,
        surfaces: spool.push(&surfaces.all)?,
        surfaces_live: spool.push(&surfaces.live)?,
        surfaces_from_previous: spool.push(&surfaces.from_previous)?,
        tiles: spool.push(&records)?,
        pieces: spool.push(&all_pieces)?,
    })
}
