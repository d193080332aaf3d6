//! The tiles of a slab, gathered in any order from many threads.

use crate::convert::scan::state::{ScanOutput, ScanState, SlabLabels};
use crate::convert::scan::surfaces::{SlabSurfaces, SurfacePart};
use crate::convert::scan::tile_writer::{TileRecord, WrittenPiece};
use crate::error::Result;
use crate::measure::MeshSums;
use crate::sys::locks::lock;
use std::sync::{Mutex, MutexGuard};

/// The tiles and surfaces of a slab.
#[derive(Debug)]
pub struct SlabTiles {
    /// Tiles.
    pub records: Vec<TileRecord>,
    /// Surfaces.
    pub surfaces: SlabSurfaces,
    /// Sums over caps.
    pub caps: MeshSums,
    layer: u32,
    /// Bytes of the slab's bands and classes.
    fixed: u64,
}

/// A piece, `None` if it was written as one with the piece before, and what it adds to a surface, `None` for a cap.
pub type Part = (Option<WrittenPiece>, Option<SurfacePart>);

/// A tile that came before its slab had begun, its pieces, and sums over its caps.
type EarlyTile = (TileRecord, Vec<Part>, MeshSums);

/// The state while tiles are gathered.
///
/// Surfaces come over from one slab to the next, so a slab's tiles wait until the one before has ended.
pub struct TileCollector<'a>(Mutex<Collecting<'a>>);

struct Collecting<'a> {
    state: &'a mut ScanState,
    slab: Option<SlabTiles>,
    /// Tiles of the slab after that.
    early: Vec<EarlyTile>,
}

impl<'a> TileCollector<'a> {
    /// Has no tile yet.
    pub fn new(state: &'a mut ScanState) -> Self {
        TileCollector(Mutex::new(Collecting {
            state,
            slab: None,
            early: Vec::new(),
        }))
    }

    fn lock(&self) -> MutexGuard<'_, Collecting<'a>> {
        lock(&self.0)
    }

    /// Does what needs the state.
    pub fn with<R>(&self, work: impl FnOnce(&mut ScanState) -> R) -> R {
        work(self.lock().state)
    }

    /// Begins a slab, or begins it anew: drops what was gathered of it. The slab before has ended.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn begin(&self, layer: u32, known: &SlabLabels) -> Result<()> {
        let gathering = &mut *self.lock();
        let state = &mut *gathering.state;
        let (whole, provisional) = (&state.forward.whole, &mut state.forward.surface_labels);
        gathering.slab = Some(SlabTiles {
            records: Vec::new(),
            surfaces: state.surfaces.begin(&known.classes, whole, provisional)?,
            caps: MeshSums::default(),
            layer,
            fixed: known.bytes(),
        });
        let early = std::mem::take(&mut gathering.early);
        for (record, pieces, caps) in early {
            gathering.add(record, pieces.into_iter(), &caps)?;
        }
        Ok(())
    }

    /// Adds a tile with its pieces and the sums over its caps. As soon as its slab has begun, its pieces learn their
    /// surfaces and leave memory.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn add(
        &self,
        record: TileRecord,
        pieces: impl Iterator<Item = Part>,
        caps: &MeshSums,
    ) -> Result<()> {
        let gathering = &mut *self.lock();
        let layer = record.grid[2];
        if gathering.slab.as_ref().is_some_and(|s| s.layer == layer) {
            return gathering.add(record, pieces, caps);
        }
        let pieces: Vec<Part> = pieces.collect();
        let bytes = size_of::<EarlyTile>() + pieces.len() * size_of::<Part>();
        let held = gathering.state.memory.held(layer);
        gathering.state.memory.hold(layer, held + bytes as u64)?;
        gathering.early.push((record, pieces, *caps));
        Ok(())
    }

    /// All tiles of the slab that has begun.
    pub fn take(&self) -> SlabTiles {
        self.lock().slab.take().expect("a slab has begun")
    }
}

impl Collecting<'_> {
    /// Adds a tile of the slab that has begun.
    fn add(
        &mut self,
        mut record: TileRecord,
        pieces: impl Iterator<Item = Part>,
        caps: &MeshSums,
    ) -> Result<()> {
        let slab = self.slab.as_mut().expect("a slab has begun");
        let state = &mut *self.state;
        let ScanOutput { spool, whole, .. } = &mut state.forward;
        record.pieces_at = spool.here::<WrittenPiece>().offset();
        let mut place = spool.here();
        for (piece, part) in pieces {
            let part = part.map(|part| slab.surfaces.add(&part, whole));
            let surface = part.transpose()?.unwrap_or(u32::MAX);
            if let Some(mut piece) = piece {
                piece.surface = surface;
                spool.extend(&mut place, &[piece])?;
            }
        }
        slab.records.push(record);
        slab.caps.merge(caps);
        let records = slab.records.capacity() * size_of::<TileRecord>();
        let bytes = slab.fixed + slab.surfaces.bytes() + records as u64;
        state.memory.hold(slab.layer, bytes)
    }
}
