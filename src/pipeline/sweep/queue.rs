//! What is to be done next where all bands of a slab are in memory.

use super::{Known, TileJob, Turn};
use crate::error::{Error, Result};
use crate::pipeline::band::Band;
use std::collections::BTreeMap;
use std::sync::Arc;

/// How much there is to do, and in how much memory.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Bands of a slab.
    pub bands: u32,
    /// Layers of the volume.
    pub layers: u32,
    /// Bands beyond those of a slab for which there is memory; `None` if no band may be prepared before the slab
    /// in hand has ended.
    pub ahead: Option<u32>,
    /// Bands are prepared one by one, as a stream is read.
    pub in_order: bool,
}

/// What a thread does next.
pub enum Step<T> {
    /// Prepare a band (y, layer), in this memory if there is some.
    Prepare([u32; 2], Option<Band<T>>),
    /// Begin a layer with all its bands.
    Begin(u32, Vec<Band<T>>),
    /// Turn the labels of band y to classes, and list its tiles.
    Label([u32; 2], Band<T>, Arc<Known>),
    /// Make a tile.
    Tile(TileJob<Arc<Band<T>>>, Arc<Known>),
    /// End a layer whose tiles are made.
    End(u32, Arc<Known>),
    /// Wait until something changes.
    Wait,
    /// Nothing is left, or something failed.
    Over,
}

/// Why the queue came to an end before the last layer.
pub struct Stop {
    /// The first layer that has not ended.
    pub layer: u32,
    /// What is known of it, if it had begun.
    pub known: Option<Arc<Known>>,
    /// [`Error::TooDense`].
    pub error: Error,
}

/// Slabs in turn: the bands of one are prepared, then it begins, its tiles are made, and it ends. Beside its last
/// tiles, its end and the next one's beginning, which only one thread can do, bands of the next slabs are
/// prepared, each in the memory of a band whose tiles are all made: so there is room for one slab and a few bands
/// instead of two slabs, and no memory is touched first that need not be.
///
/// Tiles come before bands. When bands were prepared as soon as there was memory, threads waited for the last
/// tiles of each slab, half a tile each on average, and two of them took 3 % longer for a foam of
/// 313 x 313 x 380 voxels.
pub struct Queue<T> {
    limits: Limits,
    /// The layer in hand, or the next one to begin.
    layer: u32,
    /// What is known of it, from its beginning to its end.
    open: Option<Arc<Known>>,
    /// Its bands whose labels are no classes yet, the first one last.
    unlabelled: Vec<(u32, Band<T>)>,
    tiles: BTreeMap<Turn, TileJob<Arc<Band<T>>>>,
    /// Tiles and bands of it that threads have in hand.
    in_hand: u32,
    /// True while a thread begins or ends a slab.
    turning: bool,
    /// The next band (layer, y) to prepare.
    next: (u32, u32),
    preparing: u32,
    /// By (layer, y).
    prepared: BTreeMap<(u32, u32), Band<T>>,
    /// Memory for others.
    spare: Vec<Band<T>>,
    /// Bands that there are: of the slab in hand, prepared, being prepared, spare.
    exist: u32,
    /// There was no memory to prepare a band.
    full: Option<Error>,
    failed: Option<Error>,
}

impl<T> Queue<T> {
    /// Begins with `layer`.
    pub fn new(limits: Limits, layer: u32) -> Self {
        Queue {
            limits,
            layer,
            open: None,
            unlabelled: Vec::new(),
            tiles: BTreeMap::new(),
            in_hand: 0,
            turning: false,
            next: (layer, 0),
            preparing: 0,
            prepared: BTreeMap::new(),
            spare: Vec::new(),
            exist: 0,
            full: None,
            failed: None,
        }
    }

    /// What the thread that asks is to do. If that is anything but to wait or to end, it tells so when it has
    /// done it, and wakes those that wait.
    pub fn next(&mut self, interrupted: bool) -> Step<T> {
        if self.failed.is_some() {
            return Step::Over;
        }
        if let Some(open) = &self.open {
            let known = open.clone();
            if let Some((ty, band)) = self.unlabelled.pop() {
                self.in_hand += 1;
                return Step::Label([ty, self.layer], band, known);
            }
            if let Some((_, job)) = self.tiles.pop_first() {
                self.in_hand += 1;
                return Step::Tile(job, known);
            }
            if self.in_hand == 0 && !self.turning {
                self.turning = true;
                return Step::End(self.layer, known);
            }
        } else if !self.turning {
            if self.layer == self.limits.layers {
                return Step::Over;
            }
            if interrupted {
                self.failed = Some(Error::Interrupted);
                return Step::Over;
            }
            if self.is_prepared() {
                self.turning = true;
                let after = self.prepared.split_off(&(self.layer + 1, 0));
                let slab = std::mem::replace(&mut self.prepared, after);
                return Step::Begin(self.layer, slab.into_values().collect());
            }
            if self.full.is_some() && self.preparing == 0 {
                return Step::Over;
            }
        }
        if self.may_prepare() && !interrupted {
            return self.prepare();
        }
        Step::Wait
    }

    /// True if all bands of the next slab are prepared.
    fn is_prepared(&self) -> bool {
        let slab = self.prepared.range(..(self.layer + 1, 0));
        slab.count() == self.limits.bands as usize
    }

    fn may_prepare(&self) -> bool {
        let Limits {
            bands,
            layers,
            ahead,
            in_order,
        } = self.limits;
        let (layer, _) = self.next;
        let in_turn = match ahead {
            Some(_) => layer < layers,
            None => layer == self.layer && self.open.is_none(),
        };
        let room = !self.spare.is_empty() || self.exist < bands + ahead.unwrap_or(0);
        in_turn && room && self.full.is_none() && !(in_order && self.preparing > 0)
    }

    fn prepare(&mut self) -> Step<T> {
        let (layer, ty) = self.next;
        self.next = match ty + 1 {
            next if next < self.limits.bands => (layer, next),
            _ => (layer + 1, 0),
        };
        self.preparing += 1;
        let memory = self.spare.pop();
        self.exist += u32::from(memory.is_none());
        Step::Prepare([ty, layer], memory)
    }

    /// A band is prepared, or there is no memory for it or another failure.
    pub fn prepared(&mut self, [ty, layer]: [u32; 2], band: Result<Band<T>>) {
        self.preparing -= 1;
        match band {
            Ok(band) => {
                self.prepared.insert((layer, ty), band);
            }
            Err(error @ Error::TooDense { .. }) => {
                self.exist -= 1;
                self.full.get_or_insert(error);
            }
            Err(error) => self.fail(error),
        }
    }

    /// The layer has begun with these bands.
    pub fn begun(&mut self, bands: Vec<Band<T>>, known: Known) {
        self.turning = false;
        self.open = Some(Arc::new(known));
        self.unlabelled = (0..).zip(bands).collect();
        self.unlabelled.reverse();
    }

    /// A band has classes and these tiles.
    pub fn labelled(&mut self, tiles: Vec<TileJob<Arc<Band<T>>>>) {
        self.in_hand -= 1;
        let tiles = tiles.into_iter();
        self.tiles.extend(tiles.map(|job| (job.turn(), job)));
    }

    /// A tile is made, or has failed. When its band is done with, that comes back: it is returned if nothing needs
    /// its memory.
    pub fn made(&mut self, tile: Result<()>, band: Option<Band<T>>) -> Option<Band<T>> {
        self.in_hand -= 1;
        if let Err(error) = tile {
            self.fail(error);
        }
        let band = band?;
        let (layer, ty) = (u64::from(self.next.0), u64::from(self.next.1));
        let Limits { bands, layers, .. } = self.limits;
        let left = (u64::from(layers) - layer) * u64::from(bands) - ty;
        if left > self.spare.len() as u64 {
            self.spare.push(band);
            return None;
        }
        self.exist -= 1;
        Some(band)
    }

    /// The layer has ended.
    pub fn ended(&mut self) {
        self.turning = false;
        self.open = None;
        self.layer += 1;
    }

    /// Something has failed; nothing new is begun.
    pub fn fail(&mut self, error: Error) {
        self.failed.get_or_insert(error);
    }

    /// How it came out, when no thread has anything in hand; `None` if all layers have ended.
    ///
    /// # Errors
    /// What has failed, but for want of memory.
    pub fn outcome(self) -> Result<Option<Stop>> {
        let error = match self.failed.or(self.full) {
            Some(error @ Error::TooDense { .. }) => error,
            Some(error) => return Err(error),
            None => return Ok(None),
        };
        Ok((self.layer < self.limits.layers).then_some(Stop {
            layer: self.layer,
            known: self.open,
            error,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Tiling};
    use crate::mesh::TileBox;
    use proptest::prelude::*;

    const TILES: u32 = 3;

    fn tiles_of(band: Arc<Band<u8>>, [ty, layer]: [u32; 2]) -> Vec<TileJob<Arc<Band<u8>>>> {
        let tiling = Tiling {
            dims: Dims([100; 3]),
            macrocube: [8; 3],
        };
        let tile = |tx| TileJob {
            bytes: u64::from(tx * ty),
            band: band.clone(),
            grid: [tx, ty, layer],
            tile: TileBox::of(tiling, [0; 3]),
        };
        (0..TILES).map(tile).collect()
    }

    fn too_dense() -> Error {
        Error::TooDense {
            limit: 1,
            needed: 2,
        }
    }

    /// What a step does at last.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    enum Did {
        Prepare([u32; 2]),
        Begin(u32),
        Label([u32; 2]),
        Tile([u32; 3]),
        End(u32),
    }

    /// Threads that take steps from a queue, one of them at a time, in an order that is given.
    struct Threads {
        queue: Queue<u8>,
        /// What each has in hand.
        hands: Vec<Option<Step<u8>>>,
        did: Vec<Did>,
        /// The step that fails for want of memory.
        fails: Option<Did>,
    }

    impl Threads {
        fn new(limits: Limits, threads: usize, fails: Option<Did>) -> Self {
            Threads {
                queue: Queue::new(limits, 0),
                hands: (0..threads).map(|_| None).collect(),
                did: Vec::new(),
                fails,
            }
        }

        /// Runs to the end; `choices` say who goes on.
        fn run(&mut self, mut choices: impl Iterator<Item = usize>) {
            let mut idle = vec![false; self.hands.len()];
            while !(idle.iter().all(|&i| i) && self.hands.iter().all(Option::is_none)) {
                let thread = choices.next().expect("endless") % self.hands.len();
                if let Some(step) = self.hands[thread].take() {
                    self.end(step);
                    idle.fill(false);
                } else if !idle[thread] {
                    match self.queue.next(false) {
                        Step::Wait | Step::Over => idle[thread] = true,
                        step => self.hands[thread] = Some(step),
                    }
                    let Limits { bands, ahead, .. } = self.queue.limits;
                    assert!(self.queue.exist <= bands + ahead.unwrap_or(0));
                }
                self.check_hands();
            }
            assert!(matches!(self.queue.next(false), Step::Over), "all wait");
        }

        fn check_hands(&self) {
            let hands = || self.hands.iter().flatten();
            let prepares = hands().filter(|s| matches!(s, Step::Prepare(..))).count();
            let of_slab = |s: &&Step<u8>| matches!(s, Step::Label(..) | Step::Tile(..));
            let turns = |s: &&Step<u8>| matches!(s, Step::Begin(..) | Step::End(..));
            let (of_slab, turns) = (
                hands().filter(of_slab).count(),
                hands().filter(turns).count(),
            );
            assert!(turns == 0 || (turns == 1 && of_slab == 0));
            assert!(prepares <= 1 || !self.queue.limits.in_order);
        }

        fn end(&mut self, step: Step<u8>) {
            let did = match &step {
                Step::Prepare(place, _) => Did::Prepare(*place),
                Step::Begin(layer, _) => Did::Begin(*layer),
                Step::Label(place, ..) => Did::Label(*place),
                Step::Tile(job, _) => Did::Tile(job.grid),
                Step::End(layer, _) => Did::End(*layer),
                Step::Wait | Step::Over => unreachable!("nothing in hand"),
            };
            let fails = self.fails == Some(did);
            match step {
                Step::Prepare(place, band) => {
                    let band = unless(fails, band.unwrap_or_default());
                    self.queue.prepared(place, band);
                }
                Step::Begin(..) | Step::End(..) if fails => self.queue.fail(too_dense()),
                Step::Begin(_, bands) => {
                    assert_eq!(bands.len(), self.queue.limits.bands as usize);
                    let known = Known {
                        settled: Vec::new(),
                        classes: Default::default(),
                    };
                    self.queue.begun(bands, known);
                }
                Step::Label(place, band, _) => {
                    let tiles = tiles_of(Arc::new(band), place);
                    self.queue.labelled(tiles);
                }
                Step::Tile(job, _) => {
                    let made = unless(fails, ());
                    self.queue.made(made, Arc::into_inner(job.band));
                }
                _ => self.queue.ended(),
            }
            if !fails {
                self.did.push(did);
            }
        }
    }

    fn unless<T>(fails: bool, value: T) -> Result<T> {
        if fails { Err(too_dense()) } else { Ok(value) }
    }

    fn limits() -> impl Strategy<Value = Limits> {
        (1..5u32, 1..5u32, prop::option::of(1..4u32), any::<bool>()).prop_map(
            |(bands, layers, ahead, in_order)| Limits {
                bands,
                layers,
                ahead,
                in_order,
            },
        )
    }

    fn all(limits: Limits) -> Vec<Did> {
        let mut all = Vec::new();
        for layer in 0..limits.layers {
            all.extend([Did::Begin(layer), Did::End(layer)]);
            for ty in 0..limits.bands {
                all.extend([Did::Prepare([ty, layer]), Did::Label([ty, layer])]);
                all.extend((0..TILES).map(|tx| Did::Tile([tx, ty, layer])));
            }
        }
        all.sort_unstable();
        all
    }

    proptest! {
        /// Whoever is faster, everything is done once and in its turn, in the memory there is, and nobody waits
        /// for ever.
        #[test]
        fn all_is_done_once_and_in_turn(limits in limits(), threads in 1..5usize, seed in any::<u64>()) {
            let mut threads = Threads::new(limits, threads, None);
            threads.run(random(seed));
            let Threads { did, queue, .. } = threads;
            let mut sorted = did.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, all(limits));
            let at = |what| did.iter().position(|&d| d == what).unwrap();
            for layer in 0..limits.layers {
                let (begin, end) = (at(Did::Begin(layer)), at(Did::End(layer)));
                prop_assert!(layer == 0 || at(Did::End(layer - 1)) < begin);
                for ty in 0..limits.bands {
                    prop_assert!(at(Did::Prepare([ty, layer])) < begin);
                    let early = layer > 0 && at(Did::Prepare([ty, layer])) < at(Did::End(layer - 1));
                    prop_assert!(!early || limits.ahead.is_some());
                    for tx in 0..TILES {
                        let tile = at(Did::Tile([tx, ty, layer]));
                        prop_assert!(begin < at(Did::Label([ty, layer])));
                        prop_assert!(at(Did::Label([ty, layer])) < tile && tile < end);
                    }
                }
            }
            prop_assert!(queue.outcome().unwrap().is_none());
        }

        /// Without memory for one step, all layers before end, and what is known of the one in hand comes back.
        #[test]
        fn it_stops_where_memory_ends(
            limits in limits(), threads in 1..5usize, seed in any::<u64>(), which in any::<prop::sample::Index>(),
        ) {
            let steps: Vec<Did> = all(limits).into_iter().filter(|d| !matches!(d, Did::Label(_))).collect();
            let fails = *which.get(&steps);
            let mut threads = Threads::new(limits, threads, Some(fails));
            threads.run(random(seed));
            let Threads { did, queue, .. } = threads;
            let stop = queue.outcome().unwrap().expect("it failed");
            let (layer, known) = match fails {
                Did::Prepare([_, layer]) | Did::Begin(layer) => (layer, false),
                Did::Tile([_, _, layer]) | Did::End(layer) => (layer, true),
                Did::Label(_) => unreachable!("never fails"),
            };
            prop_assert_eq!((stop.layer, stop.known.is_some()), (layer, known));
            let ended = did.iter().filter(|d| matches!(d, Did::End(_))).count();
            prop_assert_eq!(ended, layer as usize);
            prop_assert!(matches!(stop.error, Error::TooDense { .. }), "{}", stop.error);
        }
    }

    /// Who goes on, again and again.
    fn random(seed: u64) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(seed), |x| {
            Some(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1))
        })
        .map(|x| (x >> 33) as usize)
    }

    #[test]
    fn an_interruption_ends_the_slab_in_hand_and_begins_no_other() {
        let limits = Limits {
            bands: 2,
            layers: 2,
            ahead: Some(1),
            in_order: false,
        };
        let mut threads = Threads::new(limits, 1, None);
        while !threads.did.contains(&Did::Label([1, 0])) {
            let step = threads.queue.next(false);
            threads.end(step);
        }
        loop {
            match threads.queue.next(true) {
                Step::Over => break,
                step => threads.end(step),
            }
        }
        assert_eq!(threads.did.last(), Some(&Did::End(0)));
        assert!(matches!(threads.queue.outcome(), Err(Error::Interrupted)));
    }
}
