//! The memory of what slabs have in components, surfaces and tiles.

use crate::convert::memory::SLABS;
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

    /// Gives back the memory of a slab that has left it.
    pub fn let_go(&mut self, layer: u32) {
        self.slabs.remove(&layer);
        let left = self.slabs.values().sum();
        self.held.shrink_to(self.planned.max(left));
    }
}
