//! Which band is meshed next, and which tile: bands in any order, tiles of those in memory first.

use crate::convert::band_order::BandOrder;
use crate::convert::one_by_one::OneByOne;
use crate::convert::shared_queue::{Next, Queue};
use crate::error::{Error, Result};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// How much there is to do, and in how much memory.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Bands of a slab.
    pub bands: u32,
    /// Layers of the volume.
    pub layers: u32,
    /// Bands in memory at most.
    pub at_once: u32,
}

/// Layers of which bands may be made before the first of them is kept.
const OPEN_LAYERS: u32 = 2;

/// A tile of a band that is in memory.
pub struct TileTask<B> {
    /// The band.
    pub band: Arc<B>,
    /// Its macrocube.
    pub grid: [u32; 3],
}

/// What a thread does next.
pub enum MeshTask<B> {
    /// Load the band (y, layer), in this memory if there is some.
    Load([u32; 2], Option<B>),
    /// Make a tile.
    Tile(TileTask<B>),
    /// End a layer whose tiles are made.
    End(u32),
}

/// Bands in turn: each is loaded by whichever thread finds no tile to make, so that there are no more in memory than
/// threads are busy with. Layers end one after the other.
pub struct MeshQueue<B> {
    order: BandOrder,
    /// See [`Limits::at_once`].
    at_once: u32,
    /// The next band that nobody has had, by layer, then y.
    next: u64,
    /// Bands to be loaded once more, as there was no memory for them or for a tile, and their tiles that are left; all
    /// of them for `None`.
    again: Vec<(u64, Option<Vec<u32>>)>,
    /// Those of them that are being loaded.
    reloading: BTreeMap<u64, Option<Vec<u32>>>,
    tiles: VecDeque<TileTask<B>>,
    /// Tiles left of each band that has been loaded, and of those bands of a layer that have not ended.
    left: BTreeMap<u64, u32>,
    ended_bands: BTreeMap<u32, u32>,
    /// Layers that are kept, so that they are not made again after an interruption.
    kept: u32,
    ending: bool,
    /// Bands being loaded, and tiles being made.
    in_hand: u32,
    /// Bands in memory, with those being loaded and those to be used again.
    exist: u32,
    spare: Vec<B>,
    /// There was no memory for several tiles of a band at once.
    one_by_one: OneByOne,
}

impl<B> MeshQueue<B> {
    /// Begins with `layer`.
    pub fn new(limits: Limits, layer: u32) -> Self {
        let order = BandOrder::new([limits.bands, limits.layers], layer);
        MeshQueue {
            next: order.first_of(layer),
            order,
            at_once: limits.at_once,
            again: Vec::new(),
            reloading: BTreeMap::new(),
            tiles: VecDeque::new(),
            left: BTreeMap::new(),
            ended_bands: BTreeMap::new(),
            kept: layer,
            ending: false,
            in_hand: 0,
            exist: 0,
            spare: Vec::new(),
            one_by_one: OneByOne::default(),
        }
    }

    fn take_band(&mut self) -> Option<u64> {
        if self.spare.is_empty() && self.exist >= self.at_once {
            return None;
        }
        if let Some((number, tiles)) = self.again.pop() {
            self.reloading.insert(number, tiles);
            return Some(number);
        }
        let order = &self.order;
        let end = order.last.map_or(order.layers, |last| last + 1);
        // no more than two layers are lost, however long the disk takes
        let end = end.min(self.kept + OPEN_LAYERS);
        (self.next < order.first_of(end)).then(|| {
            self.next += 1;
            self.next - 1
        })
    }

    /// A band is loaded and has these tiles to be made, or there was no memory for it or another failure.
    pub fn loaded(&mut self, place: [u32; 2], band: Result<(B, Vec<u32>)>) {
        self.in_hand -= 1;
        let alone = self.one_by_one.ended_alone();
        let number = self.order.number(place);
        let left = self.reloading.remove(&number).flatten();
        let (band, tiles) = match band {
            Ok(loaded) => loaded,
            Err(error) => {
                self.exist -= 1;
                if self.takes_less(error, alone) {
                    self.again.push((number, left));
                }
                return;
            }
        };
        let tiles = match left {
            Some(left) => left,
            None => {
                self.left.insert(number, tiles.len() as u32);
                tiles
            }
        };
        if tiles.is_empty() {
            self.end_band(number);
            return self.spare.push(band);
        }
        let [ty, layer] = place;
        let band = Arc::new(band);
        let tasks = tiles.into_iter().map(|tx| TileTask {
            band: band.clone(),
            grid: [tx, ty, layer],
        });
        self.tiles.extend(tasks);
    }

    /// A tile is made, or there was no memory for it or another failure.
    pub fn made(&mut self, task: TileTask<B>, made: Result<()>) {
        self.in_hand -= 1;
        let alone = self.one_by_one.ended_alone();
        let TileTask {
            band,
            grid: [tx, ty, layer],
        } = task;
        let number = self.order.number([ty, layer]);
        match made {
            Ok(()) => {
                let left = self.left.get_mut(&number).expect("its band was loaded");
                *left -= 1;
                if *left == 0 {
                    self.end_band(number);
                }
                match Arc::into_inner(band) {
                    Some(band) if self.exist <= self.at_once => self.spare.push(band),
                    Some(_) => self.exist -= 1,
                    None => {}
                }
            }
            Err(error) => {
                self.close([ty, layer], tx, band);
                if self.takes_less(error, alone) {
                    self.close_all();
                }
            }
        }
    }

    /// Puts a tile off until its band is loaded once more.
    fn close(&mut self, place: [u32; 2], tx: u32, band: Arc<B>) {
        let number = self.order.number(place);
        match self.again.iter_mut().find(|(again, _)| *again == number) {
            Some((_, tiles)) => tiles.get_or_insert_default().push(tx),
            None => self.again.push((number, Some(vec![tx]))),
        }
        if Arc::into_inner(band).is_some() {
            self.exist -= 1;
        }
    }

    fn close_all(&mut self) {
        for TileTask {
            band,
            grid: [tx, ty, layer],
        } in std::mem::take(&mut self.tiles)
        {
            self.close([ty, layer], tx, band);
        }
    }

    fn end_band(&mut self, number: u64) {
        self.left.remove(&number);
        let [_, layer] = self.order.place(number);
        *self.ended_bands.entry(layer).or_default() += 1;
    }

    /// The next layer has ended and so many are kept, or that has failed.
    pub fn ended(&mut self, ended: Result<u32>) {
        self.ending = false;
        self.ended_bands.remove(&self.order.layer);
        match ended {
            Ok(kept) => {
                self.order.layer += 1;
                self.keep(kept);
            }
            Err(error) => self.fail(error),
        }
    }

    /// So many layers are kept.
    pub fn keep(&mut self, layers: u32) {
        self.kept = self.kept.max(layers);
    }

    /// Goes on with less memory, if `error` says that there is not enough, and less is possible.
    fn takes_less(&mut self, error: Error, alone: bool) -> bool {
        let others = !self.spare.is_empty() || self.exist > 1;
        let can = matches!(error, Error::TooDense { .. }) && (!alone || others);
        self.exist -= self.spare.len() as u32;
        self.spare.clear();
        if self.at_once == 1 {
            self.one_by_one.begin(self.in_hand);
        }
        self.at_once = (self.at_once / 2).max(1);
        if !can {
            self.fail(error);
        }
        can
    }

    /// How it came out, when no thread has anything in hand.
    ///
    /// # Errors
    /// What has failed.
    pub fn outcome(self) -> Result<()> {
        self.order.outcome()
    }
}

impl<B> Queue for MeshQueue<B> {
    type Task = MeshTask<B>;

    fn next(&mut self, interrupted: bool) -> Next<Self::Task> {
        if self.order.is_over(interrupted) {
            return Next::Finished;
        }
        let layer = self.order.layer;
        if !self.ending && self.ended_bands.get(&layer) == Some(&self.order.bands) {
            self.ending = true;
            return Next::Do(MeshTask::End(layer));
        }
        if self.one_by_one.is_on() && self.in_hand > 0 {
            return Next::Wait;
        }
        if let Some(tile) = self.tiles.pop_front() {
            self.in_hand += 1;
            return Next::Do(MeshTask::Tile(tile));
        }
        if let Some(number) = self.take_band() {
            self.in_hand += 1;
            let memory = self.spare.pop();
            self.exist += u32::from(memory.is_none());
            return Next::Do(MeshTask::Load(self.order.place(number), memory));
        }
        let all = self.order.first_of(self.order.layers);
        let all_taken = self.next == all && self.again.is_empty();
        match all_taken && self.in_hand > 0 && !self.one_by_one.is_on() {
            // whoever makes the last tile ends the last layer, too
            true => Next::Finished,
            false => Next::Wait,
        }
    }

    fn fail(&mut self, error: Error) {
        self.order.fail(error);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::one_by_one::too_dense;

    /// A band with three tiles that are all being made.
    fn with_three_tiles() -> (MeshQueue<()>, Vec<TileTask<()>>) {
        let limits = Limits {
            bands: 1,
            layers: 1,
            at_once: 1,
        };
        let mut queue = MeshQueue::new(limits, 0);
        load(&mut queue);
        let tiles = (0..3).map(|_| tile(&mut queue)).collect();
        (queue, tiles)
    }

    fn load(queue: &mut MeshQueue<()>) {
        match queue.next(false) {
            Next::Do(MeshTask::Load(place, _)) => queue.loaded(place, Ok(((), vec![0, 1, 2]))),
            _ => panic!("there is a band to be loaded"),
        }
    }

    fn tile(queue: &mut MeshQueue<()>) -> TileTask<()> {
        match queue.next(false) {
            Next::Do(MeshTask::Tile(tile)) => tile,
            _ => panic!("there is a tile to be made"),
        }
    }

    #[test]
    fn tiles_that_had_no_room_beside_others_are_made_once_more() {
        let (mut queue, tiles) = with_three_tiles();
        for task in tiles {
            assert!(!queue.order.is_over(false));
            queue.made(task, Err(too_dense()));
        }
        load(&mut queue);
        for _ in 0..3 {
            let task = tile(&mut queue);
            assert!(matches!(queue.next(false), Next::Wait));
            queue.made(task, Ok(()));
        }
        assert!(matches!(queue.next(false), Next::Do(MeshTask::End(0))));
        queue.ended(Ok(1));
        queue.outcome().unwrap();
    }

    #[test]
    fn a_tile_that_has_no_room_alone_is_refused() {
        let (mut queue, tiles) = with_three_tiles();
        for task in tiles {
            queue.made(task, Err(too_dense()));
        }
        load(&mut queue);
        let task = tile(&mut queue);
        queue.made(task, Err(too_dense()));
        assert!(queue.outcome().is_err());
    }
}
