//! Tiles that are finished together, of a part of a layer or of several layers.

use crate::convert::finalize::batch_size::{fit_together, parts};
use crate::convert::finalize::shards::Part;
use crate::convert::memory::KNOWN_PIECES;
use crate::convert::mesh::MeshOutput;
use crate::convert::mesh::tile_writer::{TileRecord, WrittenPiece};
use crate::error::Result;
use crate::manifest::TileEntry;
use crate::sys::spill_file::SpillFile;
use crate::tile::Body;
use std::collections::VecDeque;

/// A tile to finish.
pub struct Job {
    /// The tile.
    pub tile: TileRecord,
    /// Its pieces.
    pub pieces: Vec<WrittenPiece>,
}

impl Job {
    /// The tile's geometry as it was written.
    pub fn body(&self) -> Body {
        Body {
            pieces: self.pieces.iter().map(|p| p.body).collect(),
            vertices: self.tile.vertices,
            bytes: self.tile.body_bytes,
        }
    }
}

/// Some tiles of a layer.
#[derive(Clone, Copy)]
pub struct LayerTiles<'a> {
    /// The layer.
    pub layer: u32,
    /// The tiles.
    pub tiles: &'a [TileRecord],
    /// They are the last ones of it.
    pub last: bool,
}

/// Some tiles, layer by layer.
#[derive(Default)]
pub struct Batch {
    /// The tiles.
    pub jobs: Vec<Job>,
    /// Layers, how many tiles of each, and whether none is left.
    layers: Vec<(u32, usize, bool)>,
}

impl Batch {
    /// True if these tiles can be added: a batch may have any others if it has none.
    pub fn has_room(&self, tiles: &[TileRecord], memory: u64) -> bool {
        if self.jobs.is_empty() {
            return true;
        }
        let all = || self.jobs.iter().map(|job| &job.tile).chain(tiles);
        let pieces = all().map(|tile| tile.pieces as usize).sum::<usize>();
        pieces <= KNOWN_PIECES && fit_together(all(), memory)
    }

    /// Adds tiles of a layer.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(&mut self, part: LayerTiles, spool: &mut SpillFile) -> Result<()> {
        for &tile in part.tiles {
            let pieces = tile.pieces(spool)?;
            self.jobs.push(Job { tile, pieces });
        }
        self.layers.push((part.layer, part.tiles.len(), part.last));
        Ok(())
    }

    /// What was made of the tiles, in their order, layer by layer.
    pub fn into_parts(self, tiles: Vec<(TileEntry, Vec<u8>)>) -> Vec<Part> {
        let mut tiles = tiles.into_iter();
        let part = |(layer, count, last)| Part {
            layer,
            tiles: tiles.by_ref().take(count).collect(),
            last,
        };
        self.layers.into_iter().map(part).collect()
    }
}

/// Puts the tiles of all layers together to batches.
pub struct Batches<'a> {
    tiles: &'a mut MeshOutput,
    /// The next layer.
    next: u32,
    /// Bytes that tiles may take while they are finished.
    memory: u64,
    /// Parts of the layer before that are in no batch yet, `true` for its last one.
    rest: VecDeque<(Vec<TileRecord>, bool)>,
}

impl<'a> Batches<'a> {
    /// Of the layers from `next` on.
    pub fn new(tiles: &'a mut MeshOutput, next: u32, memory: u64) -> Self {
        Batches {
            tiles,
            next,
            memory,
            rest: VecDeque::new(),
        }
    }

    /// The next tiles; `None` after all of them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn next(&mut self) -> Result<Option<Batch>> {
        let mut batch = Batch::default();
        loop {
            if !self.add_rest(&mut batch)? {
                return Ok(Some(batch));
            }
            if !self.take_layer()? {
                return Ok(Some(batch).filter(|batch| !batch.layers.is_empty()));
            }
        }
    }

    /// Adds what is left of the layer at hand; false if that does not fit.
    fn add_rest(&mut self, batch: &mut Batch) -> Result<bool> {
        while let Some((tiles, last)) = self.rest.front() {
            if !batch.has_room(tiles, self.memory) {
                return Ok(false);
            }
            let part = LayerTiles {
                layer: self.next - 1,
                tiles,
                last: *last,
            };
            batch.add(part, &mut self.tiles.spool)?;
            self.rest.pop_front();
        }
        Ok(true)
    }

    /// Takes the next layer in hand; false if there is none.
    fn take_layer(&mut self) -> Result<bool> {
        if self.next == self.tiles.layers().end {
            return Ok(false);
        }
        let tiles = self.tiles.tiles(self.next)?;
        let parts = parts(&tiles, self.memory);
        self.rest = parts.into_iter().map(|p| (p.to_vec(), false)).collect();
        match self.rest.back_mut() {
            Some((_, last)) => *last = true,
            // a layer without tiles ends, too
            None => self.rest.push_back((Vec::new(), true)),
        }
        self.next += 1;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::Bounds;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn tiles(count: u32, pieces: u32) -> Vec<TileRecord> {
        let tile = |x| {
            let mut tile = TileRecord::zeroed();
            (tile.grid[0], tile.pieces) = (x, pieces);
            tile
        };
        (0..count).map(tile).collect()
    }

    fn batch(parts: &[(u32, bool, &[TileRecord])]) -> Batch {
        let dir = tempfile::tempdir().unwrap();
        let mut spool = SpillFile::new(dir.path()).unwrap();
        spool.push(&[WrittenPiece::zeroed(); 64]).unwrap();
        let mut batch = Batch::default();
        for &(layer, last, tiles) in parts {
            let part = LayerTiles { layer, tiles, last };
            batch.add(part, &mut spool).unwrap();
        }
        batch
    }

    #[test]
    fn layers_get_back_what_was_made_of_their_tiles() {
        let (some, others) = (tiles(3, 2), tiles(2, 1));
        let all: [(u32, bool, &[TileRecord]); 4] = [
            (4, true, &some[2..]),
            (5, true, &[]),
            (6, false, &others),
            (6, true, &some[..1]),
        ];
        let batch = batch(&all);
        let jobs = || batch.jobs.iter();
        assert!(jobs().all(|job| job.pieces.len() == job.tile.pieces as usize));
        let made = batch.jobs.iter().enumerate().map(|(i, job)| {
            let entry = TileEntry {
                path: String::new(),
                grid: job.tile.grid,
                bounds: Bounds {
                    min: [0.0; 3],
                    max: [0.0; 3],
                },
                vertices: 0,
                triangles: 0,
                strips: 0,
                indices: 0,
                bytes: 0,
                checksum: String::new(),
                groups: Vec::new(),
            };
            (entry, vec![i as u8])
        });
        let parts = made.collect();
        let parts = batch.into_parts(parts);
        assert_eq!(parts.len(), all.len());
        let mut next = 0;
        for (part, (layer, last, tiles)) in parts.iter().zip(all) {
            assert_eq!((part.layer, part.last), (layer, last));
            assert_eq!(part.tiles.len(), tiles.len());
            for ((entry, text), tile) in part.tiles.iter().zip(tiles) {
                assert_eq!((entry.grid, text), (tile.grid, &vec![next]));
                next += 1;
            }
        }
    }

    proptest! {
        #[test]
        fn batches_are_all_tiles_layer_by_layer(
            tiles in prop::collection::vec(0..200u32, 0..8), skip in 0..4u32, memory in 0..100_000u64,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let mut output = MeshOutput::with_tiles(&tiles, dir.path());
            let skip = skip.min(output.layers().end);
            let mut batches = Batches::new(&mut output, skip, memory);
            let (mut jobs, mut layers) = (Vec::new(), vec![(0, false); tiles.len()]);
            while let Some(batch) = batches.next().unwrap() {
                let records = batch.jobs.iter().map(|job| &job.tile);
                prop_assert!(batch.jobs.len() <= 1 || fit_together(records, memory));
                for &(layer, count, last) in &batch.layers {
                    let (tiles, over) = &mut layers[layer as usize];
                    prop_assert!(!*over);
                    (*tiles, *over) = (*tiles + count, last);
                }
                jobs.extend(batch.jobs);
            }
            let skip = skip as usize;
            for (layer, &count) in tiles.iter().enumerate().skip(skip) {
                prop_assert_eq!(layers[layer], (count as usize, true));
            }
            let expected = (0u32..).zip(&tiles).skip(skip);
            let expected = expected.flat_map(|(z, &count)| (0..count).map(move |x| [x, 0, z]));
            prop_assert!(jobs.iter().map(|job| job.tile.grid).eq(expected));
            let own = |job: &Job| job.pieces[0].ids.object == u64::from(job.tile.grid[2]);
            prop_assert!(jobs.iter().all(own));
        }
    }

    #[test]
    fn a_batch_takes_what_fits_and_whatever_comes_first() {
        let large = tiles(1, KNOWN_PIECES as u32 + 1);
        let small = tiles(100, 1);
        let empty = batch(&[(0, true, &[])]);
        assert!(empty.has_room(&large, 0));
        let begun = batch(&[(0, true, &small[..1])]);
        assert!(begun.has_room(&small, 1 << 30));
        assert!(!begun.has_room(&small, 1 << 10));
        assert!(!begun.has_room(&large, 1 << 30));
        assert!(!begun.has_room(&tiles(128, 1), 1 << 30));
    }
}
