//! The front of the sweep: the numbers of vertices on planes whose tiles beyond have yet to come.
//!
//! Tiles come by rising z, then y, then x. A vertex lies strictly inside an edge of the voxel grid, so
//! each of the up to four macrocubes around that edge has cubes at it, hence triangles at the vertex,
//! and hands its number on through each of its upper planes: every tile finds the numbers it needs with
//! its three neighbours before. Those along x and y wait in memory, a row of tiles at most; those along
//! z wait in a file, which is read tile by tile in the order in which it was written.

use super::sheet::{PlaneVertex, Sheet};
use crate::error::Result;
use crate::sys::spill_file::{Place, SpillFile};
use bytemuck::{Pod, Zeroable};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A vertex that waits on a plane: its place there, and its number.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Waiting {
    key: u64,
    number: u64,
}

/// What waits on the upper z planes of a layer.
#[derive(Debug)]
struct Floor {
    z: u32,
    spool: SpillFile,
    places: BTreeMap<[u32; 2], Place<Waiting>>,
}

/// The front.
#[derive(Debug)]
pub(super) struct Front {
    dir: PathBuf,
    /// Vertices that have a number; the next one gets this.
    vertices: u64,
    /// On the upper x plane of the tile that came last.
    along_x: Option<([u32; 3], Vec<Waiting>)>,
    /// On upper y planes of this layer, by y and x.
    along_y: BTreeMap<[u32; 2], Vec<Waiting>>,
    /// The layer below and this one.
    floors: [Option<Floor>; 2],
}

/// The numbers of a sheet's vertices.
#[derive(Debug)]
pub(super) struct Numbers {
    /// One for each vertex.
    pub all: Vec<u64>,
    /// The first number that is new with this sheet: smaller ones came with tiles before, larger ones
    /// rise in the order of the vertices.
    pub first: u64,
}

impl Front {
    /// An empty front, whose files are made in `dir`.
    pub fn new(dir: &Path) -> Self {
        Front {
            dir: dir.to_path_buf(),
            vertices: 0,
            along_x: None,
            along_y: BTreeMap::new(),
            floors: [None, None],
        }
    }

    /// Vertices so far.
    pub fn vertices(&self) -> u64 {
        self.vertices
    }

    /// Numbers the vertices of the next tile.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if a temporary file fails.
    pub fn add(&mut self, sheet: &Sheet) -> Result<Numbers> {
        const NONE: u64 = u64::MAX;
        let [x, y, z] = sheet.grid;
        self.enter_layer(z)?;
        let mut all = vec![NONE; sheet.points.len()];
        let before = |v: u32| v.wrapping_sub(1);
        if let Some((grid, waiting)) = self.along_x.take()
            && grid == [before(x), y, z]
        {
            meet(&sheet.lower[0], &waiting, &mut all);
        }
        if let Some(waiting) = self.along_y.remove(&[before(y), x]) {
            meet(&sheet.lower[1], &waiting, &mut all);
        }
        if let Some(floor) = &mut self.floors[0]
            && let Some(place) = floor.places.remove(&[y, x])
        {
            meet(&sheet.lower[2], &floor.spool.get(&place)?, &mut all);
        }
        let first = self.vertices;
        for number in all.iter_mut().filter(|n| **n == NONE) {
            *number = self.vertices;
            self.vertices += 1;
        }
        let waiting = |plane: &[PlaneVertex]| -> Vec<Waiting> {
            let one = |v: &PlaneVertex| Waiting {
                key: v.key,
                number: all[v.vertex as usize],
            };
            plane.iter().map(one).collect()
        };
        let [along_x, along_y, along_z] = [0, 1, 2].map(|a| waiting(&sheet.upper[a]));
        self.along_x = Some((sheet.grid, along_x));
        // nothing that comes now lies beyond an earlier row
        self.along_y = self.along_y.split_off(&[before(y).min(y), 0]);
        self.along_y.insert([y, x], along_y);
        if let Some(floor) = &mut self.floors[1]
            && !along_z.is_empty()
        {
            let place = floor.spool.push(&along_z)?;
            floor.places.insert([y, x], place);
        }
        Ok(Numbers { all, first })
    }

    /// Makes what waits above the last layer what waits below this one.
    fn enter_layer(&mut self, z: u32) -> Result<()> {
        if self.floors[1].as_ref().is_some_and(|f| f.z == z) {
            return Ok(());
        }
        self.along_x = None;
        self.along_y.clear();
        let below = self.floors[1].take();
        let next = Floor {
            z,
            spool: SpillFile::new(&self.dir)?,
            places: BTreeMap::new(),
        };
        self.floors = [below.filter(|f| f.z + 1 == z), Some(next)];
        Ok(())
    }
}

/// Hands numbers on to the vertices with the same keys. Both lists rise.
fn meet(plane: &[PlaneVertex], waiting: &[Waiting], all: &mut [u64]) {
    let mut waiting = waiting.iter().peekable();
    for v in plane {
        while waiting.next_if(|w| w.key < v.key).is_some() {}
        if let Some(w) = waiting.peek().filter(|w| w.key == v.key) {
            // the same number comes through several planes
            let number = &mut all[v.vertex as usize];
            *number = w.number.min(*number);
        }
    }
}
