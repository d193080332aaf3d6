//! Which band is labelled next: bands in any order, and slabs joined one after the other.

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
    /// Wait until something changes.
    Wait,
    /// Nothing is left, or something failed.
    Finished,
}

/// Bands in turn: each is labelled by itself, by whichever thread asks; when all of a slab are, it is joined.
pub struct LabelQueue<B, S> {
    limits: Limits,
    /// The next band that nobody has had, by layer, then y.
    next: u64,
    /// Bands that had no room in memory.
    again: Vec<u64>,
    sealed: BTreeMap<u64, S>,
    /// The next layer to join.
    layer: u32,
    joining: bool,
    labelling: u32,
    /// Memory for others.
    spare: Vec<B>,
    /// There was no memory for several bands at once.
    one_by_one: bool,
    /// The layer in hand when it was interrupted.
    last: Option<u32>,
    failed: Option<Error>,
}

impl<B, S> LabelQueue<B, S> {
    /// Begins with `layer`.
    pub fn new(limits: Limits, layer: u32) -> Self {
        LabelQueue {
            limits,
            next: u64::from(layer) * u64::from(limits.bands),
            again: Vec::new(),
            sealed: BTreeMap::new(),
            layer,
            joining: false,
            labelling: 0,
            spare: Vec::new(),
            one_by_one: false,
            last: None,
            failed: None,
        }
    }

    /// What the thread that asks is to do. If that is anything but to wait or to end, it tells so when it has done it,
    /// and wakes those that wait.
    pub fn next(&mut self, interrupted: bool) -> LabelTask<B, S> {
        if interrupted && self.layer < self.limits.layers {
            // to end the slab in hand takes less time than to come back to it
            self.last.get_or_insert(self.layer);
        }
        if self.last.is_some_and(|last| self.layer > last) && self.layer < self.limits.layers {
            self.failed.get_or_insert(Error::Interrupted);
        }
        if self.failed.is_some() || self.layer == self.limits.layers {
            return LabelTask::Finished;
        }
        let alone = self.labelling == 0 && !self.joining;
        if self.one_by_one && !alone {
            return LabelTask::Wait;
        }
        if !self.joining && self.is_sealed() {
            self.joining = true;
            let after = self.sealed.split_off(&self.first_of(self.layer + 1));
            let bands = std::mem::replace(&mut self.sealed, after);
            return LabelTask::Join(self.layer, bands.into_values().collect());
        }
        match self.take_band() {
            Some(number) => {
                self.labelling += 1;
                LabelTask::Label(self.place(number), self.spare.pop())
            }
            None => LabelTask::Wait,
        }
    }

    fn first_of(&self, layer: u32) -> u64 {
        u64::from(layer) * u64::from(self.limits.bands)
    }

    fn place(&self, number: u64) -> [u32; 2] {
        let bands = u64::from(self.limits.bands);
        [(number % bands) as u32, (number / bands) as u32]
    }

    fn number(&self, [ty, layer]: [u32; 2]) -> u64 {
        self.first_of(layer) + u64::from(ty)
    }

    fn is_sealed(&self) -> bool {
        let own = self.sealed.range(..self.first_of(self.layer + 1));
        own.count() == self.limits.bands as usize
    }

    fn take_band(&mut self) -> Option<u64> {
        if let Some(number) = self.again.pop() {
            return Some(number);
        }
        let ahead = if self.one_by_one {
            0
        } else {
            self.limits.ahead
        };
        let end = match self.last {
            Some(last) => self.first_of(last + 1),
            None => self.first_of(self.layer + 1) + u64::from(ahead),
        };
        let end = end.min(self.first_of(self.limits.layers));
        (self.next < end).then(|| {
            self.next += 1;
            self.next - 1
        })
    }

    /// A band is labelled, or there was no memory for it or another failure.
    pub fn labelled(&mut self, place: [u32; 2], sealed: Result<S>, memory: B) {
        self.labelling -= 1;
        match sealed {
            Ok(sealed) => {
                self.sealed.insert(self.number(place), sealed);
                if !self.one_by_one {
                    self.spare.push(memory);
                }
            }
            Err(error) => {
                drop(memory);
                if self.takes_less(error) {
                    self.again.push(self.number(place));
                }
            }
        }
    }

    /// The bands of the next layer are joined, or that has failed; for want of memory if they come back.
    pub fn joined(&mut self, joined: std::result::Result<(), Box<(Error, Vec<S>)>>) {
        self.joining = false;
        match joined {
            Ok(()) => self.layer += 1,
            Err(failed) => {
                let (error, bands) = *failed;
                if self.takes_less(error) {
                    self.sealed.extend((self.first_of(self.layer)..).zip(bands));
                }
            }
        }
    }

    /// Goes on with less memory, if `error` says that there is not enough, and less is possible.
    fn takes_less(&mut self, error: Error) -> bool {
        let can =
            matches!(error, Error::TooDense { .. }) && (!self.one_by_one || !self.spare.is_empty());
        self.spare.clear();
        self.one_by_one = true;
        if !can {
            self.fail(error);
        }
        can
    }

    /// Something has failed; nothing new is begun.
    pub fn fail(&mut self, error: Error) {
        self.failed.get_or_insert(error);
    }

    /// How it came out, when no thread has anything in hand.
    ///
    /// # Errors
    /// What has failed.
    pub fn outcome(self) -> Result<()> {
        self.failed.map_or(Ok(()), Err)
    }
}
