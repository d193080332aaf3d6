//! Surfaces across slabs: a surface is what lies between one object and one cell.
//!
//! Most surfaces of dense volumes are closed within one tile. They go to a temporary file at once; only
//! a number and a key each stay in memory until the slab is done.

use crate::error::Result;
use crate::labels::{ProvisionalLabels, SlabComponents};
use crate::measure::MeshSums;
use crate::sys::spill_file::{Place, SpillFile};
use crate::sys::state_codec::{Decoder, Encoder};
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;

/// Set in the number of a surface that is whole in one tile.
pub const WHOLE: u32 = 1 << 31;

/// A surface in terms of one slab's classes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct SlabSurface {
    /// Sums so far.
    pub sums: MeshSums,
    /// Its number, see [`ProvisionalLabels`]; of whole ones it is kept apart.
    pub provisional_id: u64,
    /// Class of its object.
    pub object: u32,
    /// Class of its cell.
    pub cell: u32,
}

/// A piece of a tile, as far as surfaces are concerned.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePart {
    /// Class of its object.
    pub object: u32,
    /// Class of its cell.
    pub cell: u32,
    /// True if it meets no side of its tile, and so is a surface of its own.
    pub whole: bool,
    /// Smallest lattice key of its vertices.
    pub key: u64,
    /// Its sums.
    pub sums: MeshSums,
}

/// The surfaces of one slab. Their numbers depend on the order of adding; provisional labels do not.
#[derive(Debug)]
pub struct SlabSurfaces {
    /// Those that came over, by provisional label, then new ones that are not whole in a tile.
    pub all: Vec<SlabSurface>,
    /// For each surface live at the end of the slab before: its number here.
    pub carried_in: Vec<u32>,
    /// Surfaces that can still grow, by provisional label.
    pub live: Vec<u32>,
    /// Where the whole ones lie.
    pub whole: Place<SlabSurface>,
    /// Provisional labels of the whole ones.
    pub whole_labels: Vec<u64>,
    /// Smallest keys of the new ones in `all`.
    keys: Vec<u64>,
    /// Keys of the whole ones.
    whole_keys: Vec<u64>,
    by_pair: HashMap<(u32, u32), u32>,
}

/// The sweep's state between slabs.
#[derive(Debug, Default)]
pub struct Surfaces {
    live: Vec<SlabSurface>,
}

impl Surfaces {
    /// Writes the state.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut Encoder) -> Result<()> {
        out.array(&self.live)
    }

    /// The state that was written, of surfaces between so many components; `None` if this is none.
    pub fn load(input: &mut Decoder, components: usize) -> Option<Self> {
        let live: Vec<SlabSurface> = input.array()?;
        let known = |class: u32| (class as usize) < components;
        let sound = live.iter().all(|s| known(s.object) && known(s.cell));
        sound.then_some(Surfaces { live })
    }

    /// Begins a slab with the surfaces that come over. May be called again to begin anew.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the provisional labels' file fails.
    pub fn begin(
        &self,
        classes: &SlabComponents,
        whole: &SpillFile,
        provisional: &mut ProvisionalLabels,
    ) -> Result<SlabSurfaces> {
        let mut slab = SlabSurfaces {
            all: Vec::new(),
            carried_in: Vec::with_capacity(self.live.len()),
            live: Vec::new(),
            whole: whole.here(),
            whole_labels: Vec::new(),
            keys: Vec::new(),
            whole_keys: Vec::new(),
            by_pair: HashMap::new(),
        };
        for surface in &self.live {
            let class = |live: u32| classes.carried_in[live as usize];
            let pair = (class(surface.object), class(surface.cell));
            let next = slab.all.len() as u32;
            let at = *slab.by_pair.entry(pair).or_insert(next);
            slab.carried_in.push(at);
            if at == next {
                slab.all.push(SlabSurface {
                    object: pair.0,
                    cell: pair.1,
                    ..*surface
                });
            } else {
                // live surfaces are sorted by provisional label: the younger one dies
                provisional.retire(surface.provisional_id)?;
                slab.all[at as usize].sums.merge(&surface.sums);
            }
        }
        Ok(slab)
    }

    /// Ends a slab: allocates provisional labels to its new surfaces and keeps those that go on.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the provisional labels' file fails.
    pub fn end(
        &mut self,
        slab: &mut SlabSurfaces,
        classes: &SlabComponents,
        provisional: &mut ProvisionalLabels,
    ) -> Result<()> {
        slab.allocate_labels(provisional)?;
        let mut live_class = vec![u32::MAX; classes.provisional.len()];
        for (i, &class) in classes.live.iter().enumerate() {
            live_class[class as usize] = i as u32;
        }
        let live_pair = |s: &SlabSurface| {
            let of = |class: u32| live_class[class as usize];
            (of(s.object), of(s.cell))
        };
        // to go on, a surface needs voxels of both in the last slice
        slab.live = (0..slab.all.len() as u32)
            .filter(|&i| {
                let (object, cell) = live_pair(&slab.all[i as usize]);
                object != u32::MAX && cell != u32::MAX
            })
            .collect();
        slab.live
            .sort_unstable_by_key(|&i| slab.all[i as usize].provisional_id);
        let live = slab.live.iter().map(|&i| {
            let surface = slab.all[i as usize];
            let (object, cell) = live_pair(&surface);
            SlabSurface {
                object,
                cell,
                ..surface
            }
        });
        self.live = live.collect();
        Ok(())
    }
}

impl SlabSurfaces {
    /// Adds a piece; returns the number of its surface. Whole ones go to the spool `whole`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn add(&mut self, part: &SurfacePart, whole: &mut SpillFile) -> Result<u32> {
        let new = SlabSurface {
            sums: part.sums,
            provisional_id: 0,
            object: part.object,
            cell: part.cell,
        };
        if part.whole {
            whole.extend(&mut self.whole, &[new])?;
            self.whole_keys.push(part.key);
            return Ok(WHOLE | (self.whole_keys.len() - 1) as u32);
        }
        let next = self.all.len() as u32;
        let at = *self.by_pair.entry((part.object, part.cell)).or_insert(next);
        if at == next {
            self.all.push(new);
            self.keys.push(part.key);
            return Ok(at);
        }
        self.all[at as usize].sums.merge(&part.sums);
        let carried = self.all.len() - self.keys.len();
        if let Some(new) = (at as usize).checked_sub(carried) {
            self.keys[new] = self.keys[new].min(part.key);
        }
        Ok(at)
    }

    /// Numbers the new surfaces by their smallest keys.
    fn allocate_labels(&mut self, provisional: &mut ProvisionalLabels) -> Result<()> {
        let carried = self.all.len() - self.keys.len();
        let keys = self.keys.iter().chain(&self.whole_keys);
        let mut order: Vec<(u64, u32)> = keys.copied().zip(0..).collect();
        order.sort_unstable();
        self.whole_labels = vec![0; self.whole_keys.len()];
        let first = provisional.allocate(order.len())?;
        for (provisional_id, (_, i)) in (first..).zip(order) {
            match (i as usize).checked_sub(self.keys.len()) {
                None => self.all[carried + i as usize].provisional_id = provisional_id,
                Some(whole) => self.whole_labels[whole] = provisional_id,
            }
        }
        Ok(())
    }

    /// Bytes of memory until the slab has ended.
    pub fn bytes(&self) -> u64 {
        /// A pair, its number, a byte of the table's own, and a load of 7/16 at worst.
        const BY_PAIR: usize = 13 * 16 / 7;
        const LIVE: usize = size_of::<SlabSurface>() + 4 + 4;
        let all = self.all.capacity() * (size_of::<SlabSurface>() + LIVE + BY_PAIR);
        // key, order, provisional label
        let numbers = (self.keys.capacity() + self.whole_keys.capacity()) * (8 + 16 + 8);
        (all + numbers) as u64
    }
}
