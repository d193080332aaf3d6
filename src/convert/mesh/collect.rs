//! The tiles of layers, gathered in any order from many threads.

use crate::checkpoint::{Marks, Scratch};
use crate::convert::layers::Layers;
use crate::convert::memory::SLABS;
use crate::convert::mesh::tile_writer::TileRecord;
use crate::convert::mesh::tiles::WrittenTile;
use crate::error::Result;
use crate::measure::MeshSums;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::spill_file::{Place, SpillFile};
use crate::sys::state_codec::{Decoder, Encoder};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Names of the files.
const PIECES: &str = "pieces";
const LAYERS: &str = "layers";

/// What meshing leaves.
#[derive(Debug)]
pub struct MeshOutput {
    /// Tiles and their pieces.
    pub spool: SpillFile,
    /// Where the tiles of each layer lie.
    places: SpillFile,
    layers: Layers,
    /// Sums over all caps.
    pub caps: MeshSums,
}

impl MeshOutput {
    /// The layers that have ended.
    pub fn layers(&self) -> Layers {
        self.layers
    }

    /// What meshing of these layers has left in files; `None` if they hold something else.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn open(
        files: &Scratch,
        marks: &Marks,
        layers: Layers,
        caps: MeshSums,
    ) -> Result<Option<Self>> {
        let open = |what| marks.open(files, what);
        Self::opened(open(PIECES)?.zip(open(LAYERS)?), layers, caps)
    }

    fn opened(
        files: Option<(SpillFile, SpillFile)>,
        layers: Layers,
        caps: MeshSums,
    ) -> Result<Option<Self>> {
        let (spool, places) = match files {
            Some(files) => files,
            None => return Ok(None),
        };
        let sound = places.here::<u8>().offset() == 16 * u64::from(layers.count());
        Ok(sound.then_some(MeshOutput {
            spool,
            places,
            layers,
            caps,
        }))
    }

    /// The tiles of a layer, by y, then x.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn tiles(&mut self, layer: u32) -> Result<Vec<TileRecord>> {
        let number = u64::from(layer - self.layers.first);
        let place = Place::<[u64; 2]>::new(16 * number, 1);
        let [offset, count] = self.places.get(&place)?[0];
        self.spool.get(&Place::new(offset, count as usize))
    }

    /// So many tiles of each layer, of one piece each, whose object has the number of its layer.
    #[cfg(test)]
    pub fn with_tiles(counts: &[u32], dir: &std::path::Path) -> Self {
        use crate::convert::mesh::tile_writer::WrittenPiece;
        use bytemuck::Zeroable;
        let new = || SpillFile::new(dir).unwrap();
        let mut output = MeshOutput {
            spool: new(),
            places: new(),
            layers: Layers {
                first: 0,
                end: counts.len() as u32,
            },
            caps: MeshSums::default(),
        };
        for (layer, &count) in (0..).zip(counts) {
            let mut piece = WrittenPiece::zeroed();
            piece.ids.object = u64::from(layer);
            let pieces_at = output.spool.push(&[piece]).unwrap().offset();
            let tile = |x| {
                let mut tile = TileRecord::zeroed();
                (tile.grid, tile.pieces, tile.pieces_at) = ([x, 0, layer], 1, pieces_at);
                tile
            };
            let tiles: Vec<TileRecord> = (0..count).map(tile).collect();
            let place = output.spool.push(&tiles).unwrap();
            output.places.push(&[place.numbers()]).unwrap();
        }
        output
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        marks.add(files, PIECES, self.spool.mark()?);
        marks.add(files, LAYERS, self.places.mark()?);
        Ok(())
    }
}

/// Gathers tiles.
pub struct TileCollector {
    /// What has been gathered of layers that have ended.
    pub output: MeshOutput,
    /// Tiles of those that have not, and sums over their caps.
    open: BTreeMap<u32, (Vec<TileRecord>, MeshSums)>,
    held: MemoryReservation,
}

impl TileCollector {
    /// Has none yet, and takes those of `first` and the layers behind it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn new(files: &Scratch, first: u32, memory: &Arc<MemoryPool>) -> Result<Self> {
        let output = MeshOutput {
            spool: SpillFile::create(&files.path(PIECES))?,
            places: SpillFile::create(&files.path(LAYERS))?,
            layers: Layers { first, end: first },
            caps: MeshSums::default(),
        };
        Ok(Self::on(output, memory))
    }

    fn on(output: MeshOutput, memory: &Arc<MemoryPool>) -> Self {
        TileCollector {
            output,
            open: BTreeMap::new(),
            held: MemoryReservation::new(memory, SLABS),
        }
    }

    /// Goes on with what was kept of `layers`; `None` if it is something else.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(
        files: &Scratch,
        marks: &Marks,
        input: &mut Decoder,
        layers: Layers,
        memory: &Arc<MemoryPool>,
    ) -> Result<Option<Self>> {
        let caps = input.array::<MeshSums>();
        let reopen = |what| marks.reopen(files, what);
        let files = reopen(PIECES)?.zip(reopen(LAYERS)?);
        let (Some([caps]), true) = (caps.as_deref(), input.is_empty()) else {
            return Ok(None);
        };
        let output = MeshOutput::opened(files, layers, *caps)?;
        Ok(output.map(|output| Self::on(output, memory)))
    }

    /// Takes memory for one tile more.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`].
    pub fn reserve(&mut self) -> Result<()> {
        let count: usize = self.open.values().map(|(tiles, _)| tiles.capacity()).sum();
        self.held
            .grow_to(((count + 1) * size_of::<TileRecord>()) as u64)
    }

    /// Adds a tile; its pieces leave memory.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::TooDense`].
    pub fn add(&mut self, tile: WrittenTile) -> Result<()> {
        self.reserve()?;
        let mut record = tile.record;
        record.pieces_at = self.output.spool.push(&tile.pieces)?.offset();
        let (tiles, caps) = self.open.entry(record.grid[2]).or_default();
        tiles.push(record);
        caps.merge(&tile.caps);
        Ok(())
    }

    /// Ends the next layer.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn end_layer(&mut self) -> Result<()> {
        let output = &mut self.output;
        let (mut tiles, caps) = self.open.remove(&output.layers.end).unwrap_or_default();
        tiles.sort_unstable_by_key(|t| (t.grid[1], t.grid[0]));
        let place = output.spool.push(&tiles)?;
        output.places.push(&[place.numbers()])?;
        output.caps.merge(&caps);
        output.layers.end += 1;
        Ok(())
    }

    /// Writes out what is in memory of the files, and adds how much they hold to `marks`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn mark(&mut self, files: &Scratch, marks: &mut Marks) -> Result<()> {
        self.output.mark(files, marks)
    }

    /// Writes the rest of the state.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        out.array(&[self.output.caps])
    }
}
