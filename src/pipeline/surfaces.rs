//! Surfaces across slabs: a surface is what lies between one object and one cell.

use crate::error::Result;
use crate::measure::MeshSums;
use crate::segment::{Births, SlabClasses};
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;

/// A surface in terms of one slab's classes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct SlabSurface {
    /// Sums so far.
    pub sums: MeshSums,
    /// Its number, see [`Births`].
    pub birth: u64,
    /// Class of its object.
    pub object: u32,
    /// Class of its cell.
    pub cell: u32,
}

/// The surfaces of one slab.
#[derive(Debug, Default)]
pub struct SlabSurfaces {
    /// All: first those that came over, by birth, then new ones by smallest vertex.
    pub all: Vec<SlabSurface>,
    /// For each surface live at the end of the slab before: its number here.
    pub from_previous: Vec<u32>,
    /// Surfaces that can still grow.
    pub live: Vec<u32>,
    by_pair: HashMap<(u32, u32), u32>,
}

impl SlabSurfaces {
    /// The surface between two classes of this slab.
    pub fn find(&self, object: u32, cell: u32) -> u32 {
        self.by_pair[&(object, cell)]
    }
}

/// A piece of a tile, as far as surfaces are concerned.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePart {
    /// Class of its object.
    pub object: u32,
    /// Class of its cell.
    pub cell: u32,
    /// Smallest lattice key of its vertices.
    pub key: u64,
    /// Its sums.
    pub sums: MeshSums,
}

/// The sweep's state between slabs.
#[derive(Debug, Default)]
pub struct Surfaces {
    live: Vec<SlabSurface>,
}

impl Surfaces {
    /// Joins one slab's pieces to surfaces and moves on to the next slab.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the births' file fails.
    pub fn join(
        &mut self,
        classes: &SlabClasses,
        parts: impl Iterator<Item = SurfacePart>,
        births: &mut Births,
    ) -> Result<SlabSurfaces> {
        let mut slab = SlabSurfaces::default();
        for surface in self.live.drain(..) {
            let class = |live: u32| classes.from_previous[live as usize];
            let pair = (class(surface.object), class(surface.cell));
            let next = slab.all.len() as u32;
            let at = *slab.by_pair.entry(pair).or_insert(next);
            slab.from_previous.push(at);
            if at == next {
                slab.all.push(SlabSurface {
                    object: pair.0,
                    cell: pair.1,
                    ..surface
                });
            } else {
                // live surfaces are sorted by birth: the younger one dies
                births.kill(surface.birth)?;
                slab.all[at as usize].sums.merge(&surface.sums);
            }
        }
        slab.add_parts(parts, births)?;
        let mut live_class = vec![u32::MAX; classes.records.len()];
        for (i, &class) in classes.live.iter().enumerate() {
            live_class[class as usize] = i as u32;
        }
        for (i, surface) in slab.all.iter().enumerate() {
            let (object, cell) = (
                live_class[surface.object as usize],
                live_class[surface.cell as usize],
            );
            // to go on, a surface needs voxels of both in the last slice
            if object != u32::MAX && cell != u32::MAX {
                slab.live.push(i as u32);
                self.live.push(SlabSurface {
                    object,
                    cell,
                    ..*surface
                });
            }
        }
        Ok(slab)
    }
}

impl SlabSurfaces {
    fn add_parts(
        &mut self,
        parts: impl Iterator<Item = SurfacePart>,
        births: &mut Births,
    ) -> Result<()> {
        let carried = self.all.len();
        let mut keys: Vec<u64> = Vec::new();
        for part in parts {
            let next = self.all.len() as u32;
            let at = *self.by_pair.entry((part.object, part.cell)).or_insert(next) as usize;
            if at == self.all.len() {
                let sums = MeshSums::default();
                self.all.push(SlabSurface {
                    sums,
                    birth: 0,
                    object: part.object,
                    cell: part.cell,
                });
                keys.push(u64::MAX);
            }
            self.all[at].sums.merge(&part.sums);
            if at >= carried {
                keys[at - carried] = keys[at - carried].min(part.key);
            }
        }
        let mut order: Vec<usize> = (0..keys.len()).collect();
        order.sort_unstable_by_key(|&i| keys[i]);
        let fresh: Vec<SlabSurface> = order.iter().map(|&i| self.all[carried + i]).collect();
        let first = births.give(fresh.len())?;
        for (i, surface) in fresh.into_iter().enumerate() {
            self.by_pair
                .insert((surface.object, surface.cell), (carried + i) as u32);
            self.all[carried + i] = SlabSurface {
                birth: first + i as u64,
                ..surface
            };
        }
        Ok(())
    }
}
