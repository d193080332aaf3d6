//! Which band is labelled next: bands in any order, and slabs joined one after the other.

use crate::convert::band_order::BandOrder;
use crate::convert::one_by_one::OneByOne;
use crate::convert::shared_queue::{Next, Queue};
use crate::error::{Error, Result};
use std::collections::BTreeMap;

/// How much there is to do.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Bands of a slab.
    pub bands: u32,
    /// Layers of the volume.
    pub layers: u32,
    /// Bands that may be labelled before the slab in hand is joined, besides its own.
    pub ahead: u32,
}

/// What a thread does next.
pub enum LabelTask<B, S> {
    /// Label the band (y, layer), in this memory if there is some.
    Label([u32; 2], Option<B>),
    /// Join the bands of a layer.
    Join(u32, Vec<S>),
}

/// Bands in turn: each is labelled by itself, by whichever thread asks; when all of a slab are, it is joined.
pub struct LabelQueue<B, S> {
    order: BandOrder,
    /// See [`Limits::ahead`].
    ahead: u32,
    /// The next band that nobody has had, by layer, then y.
    next: u64,
    /// Bands that had no room in memory.
    again: Vec<u64>,
    sealed: BTreeMap<u64, S>,
    joining: bool,
    labelling: u32,
    /// Memory for others.
    spare: Vec<B>,
    /// There was no memory for several bands at once.
    one_by_one: OneByOne,
}

impl<B, S> LabelQueue<B, S> {
    /// Begins with `layer`.
    pub fn new(limits: Limits, layer: u32) -> Self {
        let order = BandOrder::new([limits.bands, limits.layers], layer);
        LabelQueue {
            next: order.first_of(layer),
            order,
            ahead: limits.ahead,
            again: Vec::new(),
            sealed: BTreeMap::new(),
            joining: false,
            labelling: 0,
            spare: Vec::new(),
            one_by_one: OneByOne::default(),
        }
    }

    fn is_sealed(&self) -> bool {
        let own = self
            .sealed
            .range(..self.order.first_of(self.order.layer + 1));
        own.count() == self.order.bands as usize
    }

    fn take_band(&mut self) -> Option<u64> {
        if let Some(number) = self.again.pop() {
            return Some(number);
        }
        let order = &self.order;
        let ahead = if self.one_by_one.is_on() {
            0
        } else {
            self.ahead
        };
        let end = match order.last {
            Some(last) => order.first_of(last + 1),
            None => order.first_of(order.layer + 1) + u64::from(ahead),
        };
        let end = end.min(order.first_of(order.layers));
        (self.next < end).then(|| {
            self.next += 1;
            self.next - 1
        })
    }

    /// A band is labelled, or there was no memory for it or another failure.
    pub fn labelled(&mut self, place: [u32; 2], sealed: Result<S>, memory: B) {
        self.labelling -= 1;
        let alone = self.one_by_one.ended_alone();
        match sealed {
            Ok(sealed) => {
                self.sealed.insert(self.order.number(place), sealed);
                if !self.one_by_one.is_on() {
                    self.spare.push(memory);
                }
            }
            Err(error) => {
                drop(memory);
                if self.takes_less(error, alone) {
                    self.again.push(self.order.number(place));
                }
            }
        }
    }

    /// The bands of the next layer are joined, or that has failed; for want of memory if they come back.
    pub fn joined(&mut self, joined: std::result::Result<(), Box<(Error, Vec<S>)>>) {
        self.joining = false;
        let alone = self.one_by_one.ended_alone();
        match joined {
            Ok(()) => self.order.layer += 1,
            Err(failed) => {
                let (error, bands) = *failed;
                if self.takes_less(error, alone) {
                    let first = self.order.first_of(self.order.layer);
                    self.sealed.extend((first..).zip(bands));
                }
            }
        }
    }

    /// Goes on with less memory, if `error` says that there is not enough, and less is possible.
    fn takes_less(&mut self, error: Error, alone: bool) -> bool {
        let can = matches!(error, Error::TooDense { .. }) && (!alone || !self.spare.is_empty());
        self.spare.clear();
        self.one_by_one
            .begin(self.labelling + u32::from(self.joining));
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

impl<B, S> Queue for LabelQueue<B, S> {
    type Task = LabelTask<B, S>;

    fn next(&mut self, interrupted: bool) -> Next<Self::Task> {
        if self.order.is_over(interrupted) {
            return Next::Finished;
        }
        let alone = self.labelling == 0 && !self.joining;
        if self.one_by_one.is_on() && !alone {
            return Next::Wait;
        }
        if !self.joining && self.is_sealed() {
            self.joining = true;
            let layer = self.order.layer;
            let after = self.sealed.split_off(&self.order.first_of(layer + 1));
            let bands = std::mem::replace(&mut self.sealed, after);
            return Next::Do(LabelTask::Join(layer, bands.into_values().collect()));
        }
        match self.take_band() {
            Some(number) => {
                self.labelling += 1;
                let place = self.order.place(number);
                Next::Do(LabelTask::Label(place, self.spare.pop()))
            }
            None => Next::Wait,
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

    fn label(queue: &mut LabelQueue<(), u32>) -> [u32; 2] {
        match queue.next(false) {
            Next::Do(LabelTask::Label(place, _)) => place,
            _ => panic!("there is a band to be labelled"),
        }
    }

    #[test]
    fn bands_that_had_no_room_beside_others_are_labelled_once_more() {
        let limits = Limits {
            bands: 4,
            layers: 1,
            ahead: 0,
        };
        let mut queue = LabelQueue::<(), u32>::new(limits, 0);
        let all: Vec<_> = (0..4).map(|_| label(&mut queue)).collect();
        for &place in &all {
            assert!(!queue.order.is_over(false));
            queue.labelled(place, Err(too_dense()), ());
        }
        // one after the other now
        for _ in 0..4 {
            let place = label(&mut queue);
            assert!(matches!(queue.next(false), Next::Wait));
            queue.labelled(place, Ok(0), ());
        }
        let Next::Do(LabelTask::Join(0, bands)) = queue.next(false) else {
            panic!("all bands are labelled");
        };
        assert_eq!(bands.len(), 4);
        queue.joined(Ok(()));
        queue.outcome().unwrap();
    }

    #[test]
    fn a_band_that_has_no_room_alone_is_refused() {
        let limits = Limits {
            bands: 2,
            layers: 1,
            ahead: 0,
        };
        let mut queue = LabelQueue::<(), u32>::new(limits, 0);
        for _ in 0..2 {
            let place = label(&mut queue);
            queue.labelled(place, Err(too_dense()), ());
        }
        assert!(queue.outcome().is_err());
    }
}
