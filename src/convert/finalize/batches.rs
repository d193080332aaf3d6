//! Tiles that are finished together, of a part of a layer or of several layers.

use crate::convert::finalize::batch_size::{fit_together, parts};
use crate::convert::finalize::shards::Part;
use crate::convert::memory::KNOWN_PIECES;
use crate::convert::resolve::SpooledIds;
use crate::convert::scan::surfaces::WHOLE;
use crate::convert::scan::tile_writer::{TileRecord, WrittenPiece};
use crate::convert::slab_records::{SlabRecord, Slabs};
use crate::error::Result;
use crate::labels::{CarryOver, Successor};
use crate::manifest::TileEntry;
use crate::sys::group_by::{firsts, groups};
use crate::sys::spill_file::SpillFile;
use crate::tile::Body;
use std::collections::VecDeque;

/// The ids of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Ids {
    /// The object.
    pub object: u64,
    /// The cell; 0 for a cap.
    pub cell: u64,
    /// The surface; 0 for a cap.
    pub surface: u64,
}

/// Final ids in terms of a slab.
pub struct IdsOfSlab {
    /// Object or cell id of each class.
    pub classes: Vec<u64>,
    /// Id of each surface that is not whole in a tile.
    pub surfaces: Vec<u64>,
    /// Id of each surface that is.
    pub whole: Vec<u64>,
}

impl IdsOfSlab {
    /// Of a piece.
    pub fn of(&self, p: &WrittenPiece) -> Ids {
        let object = self.classes[p.object as usize];
        if p.is_cap() {
            return Ids {
                object,
                cell: 0,
                surface: 0,
            };
        }
        let surface = match p.surface & WHOLE {
            0 => self.surfaces[p.surface as usize],
            _ => self.whole[(p.surface & !WHOLE) as usize],
        };
        Ids {
            object,
            cell: self.classes[p.cell as usize],
            surface,
        }
    }
}

/// A tile to finish.
pub struct Job {
    /// The tile.
    pub tile: TileRecord,
    /// Its pieces.
    pub pieces: Vec<WrittenPiece>,
    /// The ids of each.
    pub ids: Vec<Ids>,
    /// What becomes of the object and the cell of each in the next slab.
    pub carry_over: Vec<[Successor; 2]>,
}

impl Job {
    /// The tile's geometry as the sweep wrote it.
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

    /// Adds tiles of a layer with these ids.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(
        &mut self,
        part: LayerTiles,
        ids: &IdsOfSlab,
        carry_over: &CarryOver,
        spool: &mut SpillFile,
    ) -> Result<()> {
        for &tile in part.tiles {
            let pieces = tile.pieces(spool)?;
            let ids = pieces.iter().map(|p| ids.of(p)).collect();
            let carry_over = pieces
                .iter()
                .map(|p| carry_over.of_pair([p.object, p.cell]));
            let carry_over = carry_over.collect();
            self.jobs.push(Job {
                tile,
                pieces,
                ids,
                carry_over,
            });
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

/// Where the tiles of all layers are.
pub struct TileSource<'a> {
    /// A record of each slab.
    pub slabs: &'a mut Slabs,
    /// Their tiles and pieces.
    pub pieces: &'a mut SpillFile,
    /// The ids of these.
    pub ids: &'a mut SpooledIds,
}

/// Puts the tiles of all layers together to batches.
pub struct Batches<'a> {
    source: TileSource<'a>,
    /// The next slab.
    next: usize,
    /// Bytes that tiles may take while they are finished.
    memory: u64,
    /// Parts of a layer that are in no batch yet, `true` for its last one.
    rest: VecDeque<(Vec<TileRecord>, bool)>,
    at_hand: Option<AtHand>,
}

/// What is to be known of the layer that they are of.
struct AtHand {
    layer: u32,
    ids: IdsOfSlab,
    /// See [`CarryOver`].
    live: Vec<u32>,
    /// What these are in the next one.
    there: Vec<u32>,
}

impl AtHand {
    /// Of a slab, its ids, and the slab behind it, if there is one.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    fn of(
        slab: &SlabRecord,
        ids: IdsOfSlab,
        next: Option<&SlabRecord>,
        spool: &mut SpillFile,
    ) -> Result<Self> {
        let (mut live, mut there) = (Vec::new(), Vec::new());
        if let Some(next) = next {
            live = spool.get(&slab.live)?;
            there = spool.get(&next.carried_in)?;
        }
        Ok(AtHand {
            layer: slab.layer,
            ids,
            live,
            there,
        })
    }
}

impl<'a> Batches<'a> {
    /// Of all layers but the first ones.
    pub fn new(source: TileSource<'a>, skip: usize, memory: u64) -> Self {
        Batches {
            source,
            next: skip,
            memory,
            rest: VecDeque::new(),
            at_hand: None,
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
            if !self.take_slab()? {
                return Ok(Some(batch).filter(|batch| !batch.layers.is_empty()));
            }
        }
    }

    /// Adds what is left of the layer at hand; false if that does not fit.
    fn add_rest(&mut self, batch: &mut Batch) -> Result<bool> {
        let Some(slab) = &self.at_hand else {
            return Ok(true);
        };
        let carry_over = CarryOver::new(&slab.live, &slab.there);
        while let Some((tiles, last)) = self.rest.front() {
            if !batch.has_room(tiles, self.memory) {
                return Ok(false);
            }
            let part = LayerTiles {
                layer: slab.layer,
                tiles,
                last: *last,
            };
            batch.add(part, &slab.ids, &carry_over, self.source.pieces)?;
            self.rest.pop_front();
        }
        Ok(true)
    }

    /// Takes the next layer in hand; false if there is none.
    fn take_slab(&mut self) -> Result<bool> {
        let TileSource { slabs, pieces, ids } = &mut self.source;
        let Some(slab) = slabs.get(self.next)? else {
            return Ok(false);
        };
        let tiles = pieces.get(&slab.tiles)?;
        let parts = parts(&tiles, self.memory);
        self.rest = parts.into_iter().map(|p| (p.to_vec(), false)).collect();
        match self.rest.back_mut() {
            Some((_, last)) => *last = true,
            // a layer without tiles ends, too
            None => self.rest.push_back((Vec::new(), true)),
        }
        let ids = ids.of(self.next)?;
        self.next += 1;
        let behind = slabs.get(self.next)?;
        self.at_hand = Some(AtHand::of(&slab, ids, behind.as_ref(), pieces)?);
        Ok(true)
    }
}

/// How many groups [`group`] would make.
pub fn count_distinct(ids: &[Ids]) -> usize {
    let mut ids = ids.to_vec();
    ids.sort_unstable();
    ids.dedup();
    ids.len()
}

/// Pieces with the same ids, in the order of their first piece, and these ids. Of a group, pieces that are one in the
/// next slab come one behind the other: so those that were written as one are where they are if they were not.
pub fn group(ids: &[Ids], carry_over: &[[Successor; 2]]) -> (Vec<Vec<usize>>, Vec<Ids>) {
    let one_next = firsts(carry_over);
    let mut groups = groups(ids);
    let group_ids = groups.iter().map(|group| ids[group[0]]).collect();
    for group in &mut groups {
        group.sort_by_key(|&piece| one_next[piece]);
    }
    (groups, group_ids)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::Bounds;
    use bytemuck::Zeroable;
    use proptest::prelude::*;
    use std::path::Path;

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
        let ids = IdsOfSlab {
            classes: vec![3],
            surfaces: vec![5],
            whole: Vec::new(),
        };
        let mut batch = Batch::default();
        for &(layer, last, tiles) in parts {
            let carry_over = CarryOver::new(&[], &[]);
            let part = LayerTiles { layer, tiles, last };
            batch.add(part, &ids, &carry_over, &mut spool).unwrap();
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
        let ids = Ids {
            object: 3,
            cell: 3,
            surface: 5,
        };
        assert!(batch.jobs.iter().all(|job| {
            job.pieces.len() == job.tile.pieces as usize && job.ids == vec![ids; job.pieces.len()]
        }));
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
        fn groups_are_the_pieces_with_the_same_ids(cells in prop::collection::vec(0..20u64, 0..40)) {
            let id = |&cell: &u64| Ids { object: 1 + cell % 2, cell, surface: cell };
            let ids: Vec<Ids> = cells.iter().map(id).collect();
            let ended: Vec<_> = (0..ids.len() as u32).map(|class| [Successor::Ended(class); 2]).collect();
            let (groups, group_ids) = group(&ids, &ended);
            prop_assert_eq!(count_distinct(&ids), groups.len());
            prop_assert_eq!(groups.concat().len(), ids.len());
            for (group, id) in groups.iter().zip(&group_ids) {
                prop_assert!(group.is_sorted() && group.iter().all(|&piece| ids[piece] == *id));
            }
            prop_assert!(groups.is_sorted_by_key(|group| group[0]));
        }

        /// Pieces come in the same order, whether those that are one in the next slab were joined before or not.
        #[test]
        fn what_was_one_before_is_where_it_is_anyway(classes in prop::collection::vec(0..12u32, 0..40)) {
            let carry_over: Vec<_> = classes.iter().map(|&class| [Successor::Next(class); 2]).collect();
            let id = |class: u32| u64::from(class % 4);
            let id = |&class: &u32| Ids { object: id(class), cell: id(class), surface: id(class) };
            let ids: Vec<Ids> = classes.iter().map(id).collect();
            let (max_concurrent_tiles, of_all) = group(&ids, &carry_over);
            // as they are written: those of a class together, by its first piece
            let joined = super::groups(&carry_over);
            let of_joined: Vec<Ids> = joined.iter().map(|pieces| ids[pieces[0]]).collect();
            let carry_over: Vec<_> = joined.iter().map(|pieces| carry_over[pieces[0]]).collect();
            let (groups, same) = group(&of_joined, &carry_over);
            let flat = |group: &Vec<usize>| group.iter().flat_map(|&at| joined[at].clone()).collect();
            let later: Vec<Vec<usize>> = groups.iter().map(flat).collect();
            prop_assert_eq!((later, same), (max_concurrent_tiles, of_all));
        }
    }

    /// Slabs with these tiles, one piece each, and their ids.
    fn slabs(tiles: &[usize], dir: &Path) -> (Slabs, SpillFile, SpooledIds) {
        let (mut spool, mut ids) = (SpillFile::new(dir).unwrap(), SpooledIds::new(dir).unwrap());
        let mut slabs = Slabs::new(SpillFile::new(dir).unwrap());
        let slab = |(layer, &count): (u32, &usize)| {
            let pieces_at = spool.push(&[WrittenPiece::zeroed()]).unwrap().offset();
            let tile = |x| {
                let mut tile = TileRecord::zeroed();
                (tile.grid, tile.pieces, tile.pieces_at) = ([x, 0, layer], 1, pieces_at);
                tile
            };
            let tiles: Vec<TileRecord> = (0..count as u32).map(tile).collect();
            slabs
                .push(&SlabRecord::with_tiles(layer, spool.push(&tiles).unwrap()))
                .unwrap();
        };
        (0..).zip(tiles).for_each(slab);
        for layer in (0..tiles.len()).rev() {
            let class = layer as u64;
            let of_slab = IdsOfSlab {
                classes: vec![class],
                surfaces: vec![class],
                whole: Vec::new(),
            };
            ids.push(&of_slab).unwrap();
        }
        (slabs, spool, ids)
    }

    proptest! {
        #[test]
        fn batches_are_all_tiles_layer_by_layer(
            tiles in prop::collection::vec(0..200usize, 0..8), skip in 0..4usize, memory in 0..100_000u64,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let (mut slabs, mut spool, mut ids) = slabs(&tiles, dir.path());
            let skip = skip.min(slabs.len());
            let source = TileSource { slabs: &mut slabs, pieces: &mut spool, ids: &mut ids };
            let mut batches = Batches::new(source, skip, memory);
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
            for (layer, &count) in tiles.iter().enumerate().skip(skip) {
                prop_assert_eq!(layers[layer], (count, true));
            }
            let expected = (0u32..).zip(&tiles).skip(skip);
            let expected = expected.flat_map(|(z, &count)| (0..count as u32).map(move |x| [x, 0, z]));
            prop_assert!(jobs.iter().map(|job| job.tile.grid).eq(expected));
            prop_assert!(jobs.iter().all(|job| job.ids[0].object == u64::from(job.tile.grid[2])));
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
