//! Which tiles a viewer draws: those in its view, nearest first, within a budget of triangles.

use super::frustum::View;
use crate::error::Result;
use crate::manifest::TileEntry;
use crate::tileset::TileSet;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// The tiles of a set, in memory: some 200 bytes each.
#[derive(Debug, Clone)]
pub struct TileIndex {
    tiles: Vec<TileEntry>,
    macrocube: [u32; 3],
}

impl TileIndex {
    /// Reads all shards of a tile set.
    ///
    /// # Errors
    /// Those of [`TileSet::tiles`].
    pub fn read(set: &TileSet) -> Result<Self> {
        let bare = |entry: Result<TileEntry>| {
            entry.map(|entry| TileEntry {
                groups: Vec::new(),
                ..entry
            })
        };
        Ok(TileIndex {
            tiles: set.tiles().map(bare).collect::<Result<_>>()?,
            macrocube: set.manifest().grid.macrocube,
        })
    }

    /// All tiles, by rising z, y and x. Their `groups` are empty; [`TileSet::read_tile`] needs none.
    pub fn tiles(&self) -> &[TileEntry] {
        &self.tiles
    }

    /// What to draw while the camera moves: the tiles in the view that are at most `reach` macrocubes away
    /// from the viewing point's along every axis, nearest first. Ends before the tile with which there
    /// would be more than `triangles`.
    pub fn interactive(&self, view: &View, reach: u32, triangles: u64) -> Picked<'_> {
        self.picked(view, reach, triangles, false)
    }

    /// What to draw when the camera rests: the tiles of [`TileIndex::interactive`], then all others in the
    /// view, nearest first. Ends before the tile with which there would be more than `triangles`.
    pub fn completion(&self, view: &View, reach: u32, triangles: u64) -> Picked<'_> {
        self.picked(view, reach, triangles, true)
    }

    fn picked(&self, view: &View, reach: u32, triangles: u64, all: bool) -> Picked<'_> {
        let mut waiting = Vec::new();
        for (tile, entry) in self.tiles.iter().enumerate() {
            let far = !self.reaches(view, entry, reach);
            if far && !all || !view.sees(&entry.bounds) {
                continue;
            }
            waiting.push(Waiting {
                far,
                distance: view.distance(&entry.bounds),
                tile,
            });
        }
        Picked {
            tiles: &self.tiles,
            waiting: waiting.into(),
            left: triangles,
        }
    }

    /// True if a tile is at most `reach` macrocubes away from the viewing point's along every axis. Without
    /// a viewing point (parallel projection) none is.
    fn reaches(&self, view: &View, entry: &TileEntry, reach: u32) -> bool {
        let Some(eye) = view.eye() else {
            return false;
        };
        (0..3).all(|a| {
            let at = (eye[a] / f64::from(self.macrocube[a])).floor();
            (at - f64::from(entry.grid[a])).abs() <= f64::from(reach)
        })
    }
}

/// A tile in the view.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    far: bool,
    distance: f64,
    tile: usize,
}

/// The next one to draw is the greatest, as a heap has it.
impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        let near = other.far.cmp(&self.far);
        near.then(other.distance.total_cmp(&self.distance))
            .then(other.tile.cmp(&self.tile))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// Tiles to draw, nearest first. The view is tested when the iterator is made; what is not asked for is
/// not sorted.
#[derive(Debug, Clone)]
pub struct Picked<'a> {
    tiles: &'a [TileEntry],
    waiting: BinaryHeap<Waiting>,
    left: u64,
}

impl Picked<'_> {
    /// Tiles in the view that have not been handed out, whether or not there is a budget for them.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }
}

impl<'a> Iterator for Picked<'a> {
    type Item = &'a TileEntry;

    fn next(&mut self) -> Option<&'a TileEntry> {
        let tiles = self.tiles;
        let entry = &tiles[self.waiting.peek()?.tile];
        if entry.triangles > self.left {
            // no smaller tile farther away either
            self.left = 0;
            return None;
        }
        self.left -= entry.triangles;
        self.waiting.pop();
        Some(entry)
    }
}
