//! The memory of what slabs have in components, surfaces and tiles.

use crate::convert::memory::{FOR_NEXT_SLAB, SLAB_GROWTH, SLABS};
use crate::error::Result;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bytes of the slabs that have not ended.
#[derive(Debug)]
pub struct SlabMemory {
    /// Planned for a slab, and never given back.
    planned: u64,
    /// Of each slab that has not ended.
    slabs: BTreeMap<u32, u64>,
    /// The most that a slab has taken so far.
    most: u64,
    held: MemoryReservation,
}

impl SlabMemory {
    /// No slab yet, and room for `planned` bytes of one.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`] if there is less.
    pub fn new(pool: &Arc<MemoryPool>, planned: u64) -> Result<Self> {
        let mut held = MemoryReservation::new(pool, SLABS);
        held.grow_to(planned)?;
        Ok(SlabMemory {
            planned,
            slabs: BTreeMap::new(),
            most: 0,
            held,
        })
    }

    /// Notes how many bytes of memory a slab takes.
    ///
    /// # Errors
    /// [`crate::Error::TooDense`]; it is the old number then.
    pub fn hold(&mut self, layer: u32, bytes: u64) -> Result<()> {
        let before = self.slabs.insert(layer, bytes);
        let held = self.held.grow_to(self.slabs.values().sum());
        if held.is_err() {
            self.slabs.insert(layer, before.unwrap_or(0));
        }
        held
    }

    /// Bytes of memory that a slab takes.
    pub fn held(&self, layer: u32) -> u64 {
        self.slabs.get(&layer).copied().unwrap_or(0)
    }

    /// Gives back the memory of a slab that has left it.
    pub fn let_go(&mut self, layer: u32) {
        let bytes = self.slabs.remove(&layer).unwrap_or(0);
        self.most = self.most.max(bytes);
        let left = self.slabs.values().sum();
        self.held.shrink_to(self.planned.max(left));
    }

    /// True if the next slab is likely to have room beside those that have not ended, which may grow.
    pub fn has_room_for_another(&self) -> bool {
        let grown = |&bytes: &u64| bytes + SLAB_GROWTH.of(bytes);
        let most = self.slabs.values().map(grown).max();
        let most = self.most.max(most.unwrap_or(0));
        most * (self.slabs.len() as u64 + 1) <= self.held.at_hand(FOR_NEXT_SLAB)
    }
}
