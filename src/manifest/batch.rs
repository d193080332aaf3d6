//! Tiles that are read together, a few of them from a shard of any length.

use super::{ShardTiles, TileEntry};
use crate::error::Result;
use rayon::prelude::*;
use std::iter::Peekable;

/// Bytes of memory for tiles that are made anew at once, for each thread.
const ROOM: u64 = 32 << 20;
/// Bytes that a tile takes while it is made anew, for each vertex, triangle and piece: as read, as floats, and as it
/// is written; of a piece its numbers by name.
const VERTEX: u64 = 100;
const TRIANGLE: u64 = 40;
const PIECE: u64 = 4 << 10;

/// The next tiles that fit in `room` bytes together, `most` of them at most; at least one, if there is one. A tile
/// takes `cost` bytes.
///
/// # Errors
/// Those of reading the shard.
pub(crate) fn batch<I: Iterator<Item = Result<TileEntry>>>(
    tiles: &mut Peekable<I>,
    most: usize,
    cost: impl Fn(&TileEntry) -> u64,
    room: u64,
) -> Result<Vec<TileEntry>> {
    let mut batch = Vec::new();
    let mut used = 0u64;
    while batch.len() < most
        && let Some(next) = tiles.peek()
    {
        if let Ok(entry) = next {
            used = used.saturating_add(cost(entry));
            if used > room && !batch.is_empty() {
                break;
            }
        }
        batch.extend(tiles.next().transpose()?);
    }
    Ok(batch)
}

/// Bytes that a tile takes while it is made anew.
fn cost(tile: &TileEntry) -> u64 {
    let parts = [
        tile.bytes.saturating_mul(2),
        tile.vertices.saturating_mul(VERTEX),
        tile.triangles.saturating_mul(TRIANGLE),
        (tile.groups.len() as u64).saturating_mul(PIECE),
    ];
    parts.into_iter().fold(0, u64::saturating_add)
}

impl ShardTiles {
    /// Calls `make` with all tiles, in as many threads as there are, as far as memory allows, and `take` with what
    /// it returns, in the order of the tiles.
    ///
    /// # Errors
    /// Those of reading the shard, of `make` and of `take`.
    pub(crate) fn make_all<R: Send>(
        self,
        make: impl Fn(TileEntry) -> Result<R> + Sync,
        mut take: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let threads = rayon::current_num_threads();
        // so that threads seldom wait for each other
        let (most, room) = (16 * threads, ROOM * threads as u64);
        let mut tiles = self.peekable();
        loop {
            let some = batch(&mut tiles, most, cost, room)?;
            if some.is_empty() {
                return Ok(());
            }
            let made: Result<Vec<R>> = some.into_par_iter().with_max_len(1).map(&make).collect();
            made?.into_iter().try_for_each(&mut take)?;
        }
    }
}
