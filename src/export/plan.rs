//! The first pass, over the index alone: how much there is, and how much memory it takes.

use super::choice::Choice;
use super::format::Writer;
use crate::error::{Error, Result};
use crate::manifest::{MANIFEST, TileEntry};
use crate::tileset::TileSet;

/// Bytes of the program itself and of its buffers.
const BASE: u64 = 20 << 20;
/// Bytes that a layer takes in the index.
const LAYER: u64 = 200;
/// Bytes that a thread takes before it does anything.
const THREAD: u64 = 1 << 20;
/// Bytes that a piece of a tile takes beside its geometry: its extras, some 30 columns by name.
const PIECE: u64 = 6 << 10;

/// What will be exported, and what it takes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plan {
    /// Tiles with something to export.
    pub tiles: u64,
    /// Triangles, before simplification.
    pub triangles: u64,
    /// Bytes that tiles may take together.
    pub room: u64,
}

impl Plan {
    /// Reads the index.
    ///
    /// # Errors
    /// [`Error::Memory`] if the limit is too small; [`Error::Format`] if the index is damaged;
    /// [`Error::Io`].
    pub fn new(set: &TileSet, choice: &Choice, cost: &Cost, limit: u64) -> Result<Self> {
        let mut plan = Plan::default();
        let (mut largest, mut row, mut longest_row) = (0, ([0; 2], 0), 0);
        let layers = &set.manifest().layers;
        let index = layers.len() as u64 * LAYER;
        let mut before = None;
        for entry in set.tiles() {
            let entry = entry?;
            check_place(set, &entry, &mut before)?;
            let kept = entry.groups.iter().filter(|&g| choice.keeps(&g.into()));
            let triangles = kept.map(|g| g.triangles).fold(0, u64::saturating_add);
            if !wanted(choice, &entry) {
                continue;
            }
            plan.tiles += 1;
            plan.triangles = plan.triangles.saturating_add(triangles);
            largest = cost.tile(&entry).max(largest);
            let at = [entry.grid[2], entry.grid[1]];
            if row.0 != at {
                row = (at, 0);
            }
            row.1 += entry.vertices;
            longest_row = row.1.max(longest_row);
        }
        // of a row's vertices, those on the planes to the next row and tile wait, 16 bytes each
        let width = set.manifest().grid.macrocube.into_iter().min();
        let waiting = longest_row.saturating_mul(16) / u64::from(width.unwrap_or(1)).clamp(1, 16);
        let choosing = choice.bytes(set.manifest());
        let threads = THREAD.saturating_mul(rayon::current_num_threads() as u64);
        let fixed = [BASE, threads, index, waiting, choosing]
            .into_iter()
            .fold(0, u64::saturating_add);
        let needed = fixed.saturating_add(largest.saturating_mul(3).div_ceil(2));
        if limit < needed {
            return Err(Error::Memory {
                limit,
                needed,
                hint: String::new(),
            });
        }
        // a third for what is freed and not given back to the system, in between what is not freed
        plan.room = (limit - fixed) / 3 * 2;
        Ok(plan)
    }
}

/// True if something of a tile is exported.
pub(super) fn wanted(choice: &Choice, entry: &TileEntry) -> bool {
    entry.groups.iter().any(|g| choice.keeps(&g.into()))
}

/// Tiles must come by rising z, y and x, inside the grid.
fn check_place(set: &TileSet, entry: &TileEntry, before: &mut Option<[u32; 3]>) -> Result<()> {
    let [x, y, z] = entry.grid;
    let tiles = set.manifest().tiling().tiles();
    let order = [z, y, x];
    if before.is_some_and(|b| b >= order) || (0..3).any(|a| entry.grid[a] >= tiles[a]) {
        return Err(Error::format(
            set.dir().join(MANIFEST),
            format!("a tile at {:?} after {before:?} (z, y, x)", entry.grid),
            "tiles inside the grid, by rising z, y and x",
        )
        .with_hint("`alvis verify` says more"));
    }
    *before = Some(order);
    Ok(())
}

/// Bytes of memory by what a tile has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cost {
    vertex: u64,
    triangle: u64,
}

impl Cost {
    /// For a format, and for simplification or not.
    pub fn new(writer: &dyn Writer, simplified: bool) -> Self {
        let [vertex, triangle] = writer.sizes();
        // as read: 24 bytes a vertex, 12 a triangle; on the lattice and joined: 12 and 36; in the
        // sheet: 24 and 12; on planes and numbered: 40; simplification has quadrics and edges
        let more = if simplified { [300, 160] } else { [0, 0] };
        Cost {
            vertex: vertex + 24 + 48 + 24 + 40 + more[0],
            triangle: triangle + 12 + 12 + more[1],
        }
    }

    /// The most that a tile takes at a time.
    pub fn tile(&self, entry: &TileEntry) -> u64 {
        let pieces = (entry.groups.len() as u64).saturating_mul(PIECE);
        let vertices = entry.vertices.saturating_mul(self.vertex);
        let triangles = entry.triangles.saturating_mul(self.triangle);
        [
            entry.bytes,
            pieces,
            vertices,
            triangles,
            entry.indices.saturating_mul(4),
        ]
        .into_iter()
        .fold(0, u64::saturating_add)
    }
}
