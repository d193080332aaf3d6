//! The queue under any order of threads.

use crate::convert::scan::scheduler::*;
use crate::grid::{Dims, Tiling};
use crate::surface::TileBox;
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
        has_surface: true,
    };
    (0..TILES).map(tile).collect()
}

fn too_dense() -> Error {
    Error::TooDense {
        limit: 1,
        needed: 2,
        uses: Vec::new(),
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
    queue: SlabScheduler<u8>,
    /// What each has in hand.
    hands: Vec<Option<Task<u8>>>,
    did: Vec<Did>,
    /// The step that fails for want of memory.
    fails: Option<Did>,
    /// There is memory for one open slab only.
    one_by_one: bool,
    /// Whether components of each layer often turn out to be one, a bit each.
    often: u8,
}

impl Threads {
    fn new(limits: Limits, threads: usize, fails: Option<Did>) -> Self {
        Threads {
            queue: SlabScheduler::new(limits, 0),
            hands: (0..threads).map(|_| None).collect(),
            did: Vec::new(),
            fails,
            one_by_one: false,
            often: 0,
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
                    Task::Wait | Task::Finished => idle[thread] = true,
                    step => self.hands[thread] = Some(step),
                }
                let Limits {
                    bands,
                    ahead,
                    next_slab,
                    ..
                } = self.queue.limits;
                let slabs = 1 + u32::from(next_slab && self.often > 0);
                assert!(self.queue.exist <= slabs * bands + ahead);
            }
            self.check_hands();
        }
        assert!(matches!(self.queue.next(false), Task::Finished), "all wait");
    }

    /// One thread takes step after step until it has done `last`.
    fn run_until(&mut self, last: Did) {
        while self.did.last() != Some(&last) {
            let step = self.queue.next(false);
            self.end(step);
        }
    }

    fn is_often(&self, layer: u32) -> bool {
        self.often >> layer & 1 == 1
    }

    /// True if tiles of a layer wait for the next one, while there is memory.
    fn waits(&self, layer: u32) -> bool {
        let Limits {
            layers, next_slab, ..
        } = self.queue.limits;
        next_slab && self.is_often(layer) && layer + 1 < layers && !self.one_by_one
    }

    fn check_hands(&self) {
        let hands = || self.hands.iter().flatten();
        let prepares = hands().filter(|s| matches!(s, Task::Prepare(..))).count();
        let turns = hands().filter(|s| matches!(s, Task::Begin(..) | Task::End(..)));
        assert!(turns.count() <= 1);
        assert!(prepares <= 1 || !self.queue.limits.in_order);
    }

    fn end(&mut self, step: Task<u8>) {
        let did = match &step {
            Task::Prepare(place, _) => Did::Prepare(*place),
            Task::Begin(layer, ..) => Did::Begin(*layer),
            Task::Label(place, ..) => Did::Label(*place),
            Task::Tile(job, ..) => Did::Tile(job.grid),
            Task::End(layer, ..) => Did::End(*layer),
            Task::Wait | Task::Finished => unreachable!("nothing in hand"),
        };
        let fails = self.fails == Some(did);
        match step {
            Task::Prepare(place, band) => {
                let band = unless(fails, band.unwrap_or_default());
                self.queue.prepared(place, band);
            }
            Task::Begin(layer, bands, alone) => {
                assert_eq!(bands.len(), self.queue.limits.bands as usize);
                let ended = layer.checked_sub(1).map(Did::End);
                assert_eq!(alone, ended.is_none_or(|end| self.did.contains(&end)));
                if self.one_by_one && !alone {
                    return self.queue.postpone(bands);
                }
                let mut known = SlabLabels::default();
                known.classes.merge_often = self.is_often(layer);
                self.queue.begun(unless(fails, (bands, known)));
            }
            Task::Label(place, band, _) => {
                let tiles = tiles_of(Arc::new(band), place);
                self.queue.labelled(place[1], tiles);
            }
            Task::Tile(job, _, next) => {
                let layer = job.grid[2];
                assert!(next.is_none() || self.did.contains(&Did::Begin(layer + 1)));
                let waits = self.waits(layer);
                assert!(waits || next.is_none());
                assert!(!waits || next.is_some() || self.queue.full.is_some());
                let made = unless(fails, ());
                self.queue
                    .made(job.grid[2], made, Arc::into_inner(job.band));
            }
            Task::End(layer, _, next) => {
                let begun = self.did.contains(&Did::Begin(layer + 1));
                assert_eq!(next.is_some(), begun);
                self.queue.ended(unless(fails, ()));
            }
            Task::Wait | Task::Finished => unreachable!("nothing in hand"),
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
    let numbers = (1..5u32, 1..6u32, 0..4u32);
    (numbers, any::<[bool; 2]>()).prop_map(|((bands, layers, ahead), [next_slab, in_order])| {
        Limits {
            bands,
            layers,
            ahead,
            next_slab: next_slab && ahead > 0,
            in_order,
        }
    })
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
    fn all_is_done_once_and_in_turn(
        limits in limits(), threads in 1..5usize, one_by_one in any::<bool>(), often in any::<u8>(),
        seed in any::<u64>(),
    ) {
        let mut threads = Threads { one_by_one, often, ..Threads::new(limits, threads, None) };
        threads.run(random(seed));
        let waits: Vec<bool> = (0..limits.layers).map(|layer| threads.waits(layer)).collect();
        let Threads { did, queue, .. } = threads;
        let mut sorted = did.clone();
        sorted.sort_unstable();
        prop_assert_eq!(sorted, all(limits));
        let at = |what| did.iter().position(|&d| d == what).unwrap();
        for layer in 0..limits.layers {
            let (begin, end) = (at(Did::Begin(layer)), at(Did::End(layer)));
            let open = match layer.checked_sub(1) {
                _ if one_by_one || limits.ahead == 0 => 1,
                Some(before) if waits[before as usize] => 3,
                _ => 2,
            };
            if let Some(before) = layer.checked_sub(open) {
                prop_assert!(at(Did::End(before)) < begin);
            }
            prop_assert!(layer == 0 || at(Did::End(layer - 1)) < end);
            for ty in 0..limits.bands {
                prop_assert!(at(Did::Prepare([ty, layer])) < begin);
                let early = layer > 0 && at(Did::Prepare([ty, layer])) < at(Did::End(layer - 1));
                prop_assert!(!early || limits.ahead > 0);
                for tx in 0..TILES {
                    let tile = at(Did::Tile([tx, ty, layer]));
                    prop_assert!(begin < at(Did::Label([ty, layer])));
                    prop_assert!(at(Did::Label([ty, layer])) < tile && tile < end);
                    prop_assert!(!waits[layer as usize] || at(Did::Begin(layer + 1)) < tile);
                    // two slabs are gathered at once
                    prop_assert!(layer < 2 || at(Did::End(layer - 2)) < tile);
                }
            }
        }
        prop_assert!(queue.outcome().unwrap().is_none());
    }

    /// Without memory for one step, all layers before end, and what is known of the one in hand comes back.
    #[test]
    fn it_stops_where_memory_ends(
        limits in limits(), threads in 1..5usize, seed in any::<u64>(), often in any::<u8>(),
        which in any::<prop::sample::Index>(),
    ) {
        let steps: Vec<Did> = all(limits).into_iter().filter(|d| !matches!(d, Did::Label(_))).collect();
        let fails = *which.get(&steps);
        let mut threads = Threads { often, ..Threads::new(limits, threads, Some(fails)) };
        threads.run(random(seed));
        let Threads { did, queue, .. } = threads;
        let stop = queue.outcome().unwrap().expect("it failed");
        let layers = |begun: fn(&Did) -> bool| did.iter().filter(|&d| begun(d)).count() as u32;
        let (begun, ended) = (
            layers(|d| matches!(d, Did::Begin(_))),
            layers(|d| matches!(d, Did::End(_))),
        );
        prop_assert_eq!((stop.layer, stop.known.len() as u32), (ended, begun - ended));
        match fails {
            // nothing that is open is left behind
            Did::Prepare([_, layer]) | Did::Begin(layer) => prop_assert_eq!((ended, begun), (layer, layer)),
            Did::Tile([_, _, layer]) => prop_assert!(ended <= layer && layer < begun),
            Did::End(layer) => prop_assert!(ended == layer && layer < begun),
            Did::Label(_) => unreachable!("never fails"),
        }
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

/// Two bands in each of two layers.
const SMALL: Limits = Limits {
    bands: 2,
    layers: 2,
    ahead: 1,
    next_slab: false,
    in_order: false,
};

#[test]
fn an_interruption_ends_the_slab_in_hand_and_begins_no_other() {
    let mut threads = Threads::new(SMALL, 1, None);
    threads.run_until(Did::Label([1, 0]));
    loop {
        match threads.queue.next(true) {
            Task::Finished => break,
            step => threads.end(step),
        }
    }
    assert_eq!(threads.did.last(), Some(&Did::End(0)));
    assert!(matches!(threads.queue.outcome(), Err(Error::Interrupted)));
}

#[test]
fn threads_go_when_others_make_the_last_tiles() {
    let limits = Limits {
        bands: 1,
        layers: 1,
        ahead: 0,
        next_slab: false,
        in_order: false,
    };
    let mut threads = Threads::new(limits, 1, None);
    threads.run_until(Did::Begin(0));
    let label = threads.queue.next(false);
    // its tiles are to come
    assert!(matches!(threads.queue.next(false), Task::Wait));
    threads.end(label);
    let tiles = [(); TILES as usize].map(|()| threads.queue.next(false));
    assert!(matches!(threads.queue.next(false), Task::Finished));
    for tile in tiles {
        threads.end(tile);
    }
    assert!(matches!(threads.queue.next(false), Task::End(..)));
}

#[test]
fn a_slab_begins_beside_the_last_tile_of_the_one_before() {
    let mut threads = Threads::new(SMALL, 1, None);
    threads.run_until(Did::Prepare([0, 1]));
    let slow = threads.queue.next(false);
    assert!(matches!(slow, Task::Tile(..)));
    // all but the last step of the next slab, the last one of the volume
    let of_next = |did: &Did| match did {
        Did::Prepare([_, layer]) | Did::Begin(layer) | Did::Label([_, layer]) => *layer == 1,
        Did::Tile([_, _, layer]) => *layer == 1,
        Did::End(_) => false,
    };
    let others: Vec<Did> = all(SMALL).into_iter().filter(of_next).collect();
    loop {
        match threads.queue.next(false) {
            Task::Finished => break,
            step => threads.end(step),
        }
    }
    assert!(others.iter().all(|step| threads.did.contains(step)));
    threads.end(slow);
    for layer in [0, 1] {
        let end = threads.queue.next(false);
        threads.end(end);
        assert_eq!(threads.did.last(), Some(&Did::End(layer)));
    }
    assert!(threads.queue.outcome().unwrap().is_none());
}

#[test]
fn an_interruption_leaves_the_second_of_two_open_slabs() {
    let mut threads = Threads::new(SMALL, 1, None);
    threads.run_until(Did::Prepare([0, 1]));
    let slow = threads.queue.next(false);
    threads.run_until(Did::Begin(1));
    loop {
        match threads.queue.next(true) {
            Task::Wait => break,
            step => threads.end(step),
        }
        assert!(matches!(threads.did.last(), Some(Did::Tile([_, _, 0]))));
    }
    threads.end(slow);
    let end = threads.queue.next(true);
    threads.end(end);
    assert_eq!(threads.did.last(), Some(&Did::End(0)));
    assert!(matches!(threads.queue.next(true), Task::Finished));
    assert!(matches!(threads.queue.outcome(), Err(Error::Interrupted)));
}
