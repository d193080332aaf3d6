//! What is to be done next where all bands of a slab are in memory.

use crate::convert::scan::band::Band;
use crate::convert::scan::state::SlabLabels;
use crate::convert::scan::tiles::{TileJob, Turn};
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
    /// Bands beyond those of a slab for which there is memory; with 0, none is prepared before the slab in hand has
    /// ended.
    pub ahead: u32,
    /// There is memory for the bands of one more slab: where components often turn out to be one, tiles wait until
    /// the next slab has begun, which tells which of them do.
    pub next_slab: bool,
    /// Bands are prepared one by one, as a stream is read.
    pub in_order: bool,
}

/// What a thread does next.
pub enum Task<T> {
    /// Prepare a band (y, layer), in this memory if there is some.
    Prepare([u32; 2], Option<Band<T>>),
    /// Begin a layer with all its bands; true if the one before has ended.
    Begin(u32, Vec<Band<T>>, bool),
    /// Turn the labels of a band (y, layer) to classes, and list its tiles.
    Label([u32; 2], Band<T>, Arc<SlabLabels>),
    /// Make a tile. What is known of the next layer, if the tile has waited for that.
    Tile(
        TileJob<Arc<Band<T>>>,
        Arc<SlabLabels>,
        Option<Arc<SlabLabels>>,
    ),
    /// End a layer whose tiles are made. What is known of the next one, if that has begun.
    End(u32, Arc<SlabLabels>, Option<Arc<SlabLabels>>),
    /// Wait until something changes.
    Wait,
    /// Nothing is left, or something failed.
    Finished,
}

/// Why the queue came to an end before the last layer.
pub struct Stop {
    /// The first layer that has not ended.
    pub layer: u32,
    /// What is known of it and of the next one, as far as they had begun.
    pub known: Vec<Arc<SlabLabels>>,
    /// [`Error::TooDense`].
    pub error: Error,
}

/// A slab that has begun and not ended.
struct Open<T> {
    layer: u32,
    known: Arc<SlabLabels>,
    /// Its bands whose labels are no classes yet.
    unlabelled: VecDeque<(u32, Band<T>)>,
    tiles: BTreeMap<Turn, TileJob<Arc<Band<T>>>>,
    /// Bands of it that threads list the tiles of.
    labelling: u32,
    /// Tiles of it that threads make.
    making: u32,
    /// Its tiles wait for the next slab.
    waits: bool,
    /// What is known of that, once it has begun, if they have waited for it.
    next: Option<Arc<SlabLabels>>,
}

impl<T> Open<T> {
    /// True if threads have all of its tiles in hand, or have made them.
    fn is_taken(&self) -> bool {
        self.unlabelled.is_empty() && self.labelling == 0 && self.tiles.is_empty()
    }

    fn label(&mut self) -> Option<Task<T>> {
        let (ty, band) = self.unlabelled.pop_front()?;
        self.labelling += 1;
        Some(Task::Label([ty, self.layer], band, self.known.clone()))
    }

    fn tile(&mut self) -> Option<Task<T>> {
        if self.waits {
            return None;
        }
        let (_, job) = self.tiles.pop_first()?;
        self.making += 1;
        Some(Task::Tile(job, self.known.clone(), self.next.clone()))
    }
}

/// Slabs in turn: the bands of one are prepared, then it begins, its tiles are made, and it ends. A slab may begin
/// while the last tiles of the one before are made, so that no thread waits for these; then two are open. Bands are
/// prepared each in the memory of a band whose tiles are all made: so there is room for one slab and a few bands
/// instead of two slabs, and no memory is touched first that need not be. They come before tiles: when the last tile
/// of a slab is in hand, the next one should be there.
///
/// If tiles of the second open slab wait for a third one, that begins as soon as all tiles of the first are in hand.
pub struct SlabScheduler<T> {
    limits: Limits,
    /// Two slabs at most, by rising layer, or three if tiles wait.
    open: VecDeque<Open<T>>,
    /// The next layer to begin.
    layer: u32,
    /// Slabs begin only when the one before has ended: there is no memory for more.
    one_by_one: bool,
    /// True while a thread begins or ends a slab.
    turning: bool,
    /// The next band (layer, y) to prepare.
    next: (u32, u32),
    preparing: u32,
    /// By (layer, y).
    prepared: BTreeMap<(u32, u32), Band<T>>,
    /// Memory for others.
    spare: Vec<Band<T>>,
    /// Bands that there are: of open slabs, prepared, being prepared, spare.
    exist: u32,
    /// There was no memory to prepare a band, or to join those of a slab.
    full: Option<Error>,
    failed: Option<Error>,
    /// The layer in hand when the sweep was interrupted.
    last: Option<u32>,
}

impl<T> SlabScheduler<T> {
    /// Begins with `layer`.
    pub fn new(limits: Limits, layer: u32) -> Self {
        SlabScheduler {
            limits,
            open: VecDeque::new(),
            layer,
            one_by_one: false,
            turning: false,
            next: (layer, 0),
            preparing: 0,
            prepared: BTreeMap::new(),
            spare: Vec::new(),
            exist: 0,
            full: None,
            failed: None,
            last: None,
        }
    }

    /// What the thread that asks is to do. If that is anything but to wait or to end, it tells so when it has
    /// done it, and wakes those that wait.
    pub fn next(&mut self, interrupted: bool) -> Task<T> {
        if interrupted {
            self.interrupt();
        }
        if self.failed.is_some() || self.has_ended() {
            return Task::Finished;
        }
        if !self.turning {
            if let Some(step) = self.advance() {
                return step;
            }
            if self.open.is_empty() && self.full.is_some() && self.preparing == 0 {
                return Task::Finished;
            }
        }
        // tiles that come before their slab are gathered of one slab, the second
        let (open, gathered) = match self.last {
            Some(_) => (1, 1),
            None => (self.open.len(), 2),
        };
        let mut slabs = self.open.iter_mut().take(open);
        if let Some(step) = slabs.find_map(Open::label) {
            return step;
        }
        if self.may_prepare() {
            return self.prepare();
        }
        let mut slabs = self.open.iter_mut().take(gathered);
        if let Some(step) = slabs.find_map(Open::tile) {
            return step;
        }
        let all_begun = self.layer == self.limits.layers && !self.open.is_empty();
        if all_begun && self.open.iter().all(Open::is_taken) {
            // whoever makes the last tile ends the last layer, too
            return Task::Finished;
        }
        Task::Wait
    }

    /// Nothing new is begun. The slab in hand is brought to its end: that takes less time than to come back to it.
    fn interrupt(&mut self) {
        match self.open.front() {
            Some(slab) => {
                self.last.get_or_insert(slab.layer);
                self.stop_waiting();
            }
            None if !self.turning && !self.has_ended() => self.fail(Error::Interrupted),
            None => {}
        }
    }

    /// Ends a slab or begins the next one, if it is time.
    fn advance(&mut self) -> Option<Task<T>> {
        if let Some(slab) = self.open.front()
            && slab.is_taken()
            && slab.making == 0
        {
            let next = self.open.get(1).map(|slab| slab.known.clone());
            self.turning = true;
            return Some(Task::End(slab.layer, slab.known.clone(), next));
        }
        if !self.may_begin() {
            return None;
        }
        self.turning = true;
        let after = self.prepared.split_off(&(self.layer + 1, 0));
        let slab = std::mem::replace(&mut self.prepared, after);
        let bands = slab.into_values().collect();
        Some(Task::Begin(self.layer, bands, self.open.is_empty()))
    }

    /// True if all bands of the next slab are prepared, and it may be open beside those that are.
    fn may_begin(&self) -> bool {
        let most = match (self.open.front(), self.open.get(1)) {
            _ if self.one_by_one => 1,
            (Some(first), Some(second)) if second.waits && first.is_taken() => 3,
            _ => 2,
        };
        let slab = self.prepared.range(..(self.layer + 1, 0));
        self.open.len() < most && self.last.is_none() && slab.count() == self.limits.bands as usize
    }

    /// No next slab will begin in time for tiles that wait for it.
    fn stop_waiting(&mut self) {
        self.open.iter_mut().for_each(|slab| slab.waits = false);
    }

    fn may_prepare(&self) -> bool {
        let Limits {
            bands,
            layers,
            ahead,
            in_order,
            ..
        } = self.limits;
        let (layer, _) = self.next;
        let in_turn = match ahead {
            1.. => layer < layers,
            0 => layer == self.layer && self.open.is_empty(),
        };
        let slabs = if self.open.iter().any(|slab| slab.waits) {
            2
        } else {
            1
        };
        let most = (slabs * bands).saturating_add(ahead);
        let room = !self.spare.is_empty() || self.exist < most;
        let goes_on = self.full.is_none() && self.last.is_none();
        in_turn && room && goes_on && !(in_order && self.preparing > 0)
    }

    fn prepare(&mut self) -> Task<T> {
        let (layer, ty) = self.next;
        self.next = match ty + 1 {
            next if next < self.limits.bands => (layer, next),
            _ => (layer + 1, 0),
        };
        self.preparing += 1;
        let memory = self.spare.pop();
        self.exist += u32::from(memory.is_none());
        Task::Prepare([ty, layer], memory)
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
                self.stop_waiting();
            }
            Err(error) => self.fail(error),
        }
    }

    /// The next layer has begun with these bands, or that has failed.
    pub fn begun(&mut self, slab: Result<(Vec<Band<T>>, SlabLabels)>) {
        self.turning = false;
        match slab {
            Ok((bands, known)) => self.open(bands, Arc::new(known)),
            // the slab that is open may come to its end
            Err(error @ Error::TooDense { .. }) if !self.open.is_empty() => {
                self.full.get_or_insert(error);
                self.stop_waiting();
            }
            Err(error) => self.fail(error),
        }
    }

    /// The next layer is open; tiles that have waited for it no longer do.
    fn open(&mut self, bands: Vec<Band<T>>, known: Arc<SlabLabels>) {
        if let Some(before) = self.open.back_mut().filter(|slab| slab.waits) {
            before.waits = false;
            before.next = Some(known.clone());
        }
        let Limits {
            layers, next_slab, ..
        } = self.limits;
        let may_wait = next_slab && self.layer + 1 < layers && !self.one_by_one;
        let goes_on = self.full.is_none() && self.last.is_none();
        self.open.push_back(Open {
            layer: self.layer,
            waits: may_wait && goes_on && known.classes.merge_often,
            next: None,
            known,
            unlabelled: (0..).zip(bands).collect(),
            tiles: BTreeMap::new(),
            labelling: 0,
            making: 0,
        });
        self.layer += 1;
    }

    /// The next layer was not begun with these bands, as there is no memory for two at once.
    pub fn postpone(&mut self, bands: Vec<Band<T>>) {
        self.turning = false;
        self.one_by_one = true;
        self.stop_waiting();
        let places = (0..).map(|ty| (self.layer, ty));
        self.prepared.extend(places.zip(bands));
    }

    fn slab(&mut self, layer: u32) -> &mut Open<T> {
        let slab = self.open.iter_mut().find(|slab| slab.layer == layer);
        slab.expect("it is open until its tiles are made")
    }

    /// A band of a layer has classes and these tiles.
    pub fn labelled(&mut self, layer: u32, tiles: Vec<TileJob<Arc<Band<T>>>>) {
        let slab = self.slab(layer);
        slab.labelling -= 1;
        let tiles = tiles.into_iter();
        slab.tiles.extend(tiles.map(|job| (job.turn(), job)));
    }

    /// A tile of a layer is made, or has failed. When its band is done with, that comes back: it is returned if
    /// nothing needs its memory.
    pub fn made(&mut self, layer: u32, tile: Result<()>, band: Option<Band<T>>) -> Option<Band<T>> {
        self.slab(layer).making -= 1;
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

    /// The first layer that was open has ended, or that has failed.
    pub fn ended(&mut self, slab: Result<()>) {
        self.turning = false;
        if let Err(error) = slab {
            return self.fail(error);
        }
        let ended = self.open.pop_front().map(|slab| slab.layer);
        if self.last.is_some() && self.last == ended && !self.has_ended() {
            self.fail(Error::Interrupted);
        }
    }

    /// Something has failed; nothing new is begun.
    pub fn fail(&mut self, error: Error) {
        self.failed.get_or_insert(error);
    }

    /// True if all layers have ended.
    pub fn has_ended(&self) -> bool {
        self.open.is_empty() && self.layer == self.limits.layers
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
        let layer = self.open.front().map_or(self.layer, |slab| slab.layer);
        Ok((layer < self.limits.layers).then(|| Stop {
            layer,
            known: self.open.into_iter().map(|slab| slab.known).collect(),
            error,
        }))
    }
}

#[cfg(test)]
mod tests;
