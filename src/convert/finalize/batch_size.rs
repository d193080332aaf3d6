//! How many tiles are finished together, so that the limit of memory holds then, too.

use crate::convert::memory::{
    BYTES_PER_ENTRY, BYTES_PER_NODE, BYTES_PER_OWN_NODE, FOR_ENTRIES, FOR_TILES_AT_ONCE,
};
use crate::convert::mesh::tile_writer::TileRecord;

/// Tiles that are finished together, so that their pieces and entries are in memory at once.
const TILES: usize = 128;

/// Bytes that a tile takes that has a node for each piece, while it is finished.
pub fn nodes_bytes(tile: &TileRecord) -> u64 {
    u64::from(tile.pieces) * BYTES_PER_OWN_NODE
}

/// Cuts a layer's tiles to parts whose entries take [`FOR_ENTRIES`] of `memory` bytes at most; a tile that takes more is
/// a part by itself.
pub fn parts(tiles: &[TileRecord], memory: u64) -> Vec<&[TileRecord]> {
    let mut parts = Vec::new();
    let mut rest = tiles;
    while !rest.is_empty() {
        let mut bytes = 0;
        let fitting = rest.iter().take(TILES).take_while(|tile| {
            bytes += u64::from(tile.pieces) * BYTES_PER_ENTRY;
            bytes <= FOR_ENTRIES.of(memory)
        });
        let (part, after) = rest.split_at(fitting.count().max(1));
        parts.push(part);
        rest = after;
    }
    parts
}

/// True if the entries of all these tiles take as much as those of a part may.
pub fn fit_together<'a>(tiles: impl Iterator<Item = &'a TileRecord>, memory: u64) -> bool {
    let (count, pieces) = tiles.fold((0, 0), |(n, p), t| (n + 1, p + u64::from(t.pieces)));
    count <= TILES && pieces * BYTES_PER_ENTRY <= FOR_ENTRIES.of(memory)
}

/// How many of these tiles, 1 to `threads`, can be finished at once in [`FOR_TILES_AT_ONCE`] of `memory` bytes.
pub fn max_concurrent_tiles<'a>(
    tiles: impl Iterator<Item = &'a TileRecord>,
    memory: u64,
    threads: usize,
) -> usize {
    let bytes = |t: &TileRecord| u64::from(t.pieces) * BYTES_PER_NODE;
    let mut all: Vec<u64> = tiles.map(bytes).collect();
    all.sort_unstable_by(|a, b| b.cmp(a));
    let mut sum = 0;
    let fitting = all.iter().take(threads).take_while(|&bytes| {
        sum += bytes;
        sum <= FOR_TILES_AT_ONCE.of(memory)
    });
    let fitting = fitting.count();
    // fewer tiles than threads all fit
    if fitting == all.len() {
        threads
    } else {
        fitting.max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn tile(pieces: u32) -> TileRecord {
        let mut tile = TileRecord::zeroed();
        tile.pieces = pieces;
        tile
    }

    proptest! {
        #[test]
        fn parts_are_all_tiles_in_order_and_small(
            pieces in prop::collection::vec(0..5_000u32, 0..200),
            memory in 0..40_000_000u64,
        ) {
            let tiles: Vec<_> = pieces.iter().map(|&p| tile(p)).collect();
            let parts = parts(&tiles, memory);
            let of = |part: &[TileRecord]| part.iter().map(|t| t.pieces).collect::<Vec<_>>();
            prop_assert_eq!(parts.iter().flat_map(|p| of(p)).collect::<Vec<_>>(), pieces);
            for (i, part) in parts.iter().enumerate() {
                let bytes = |p: &[TileRecord]| of(p).iter().map(|&p| u64::from(p) * BYTES_PER_ENTRY).sum::<u64>();
                prop_assert!((1..=TILES).contains(&part.len()));
                prop_assert!(part.len() == 1 || bytes(part) <= memory / 8);
                prop_assert_eq!(fit_together(part.iter(), memory), bytes(part) <= memory / 8);
                // and none is smaller than it must be
                if let Some(next) = parts.get(i + 1) {
                    prop_assert!(part.len() == TILES || bytes(part) + bytes(&next[..1]) > memory / 8);
                }
            }
        }

        #[test]
        fn no_thread_waits_without_need(
            pieces in prop::collection::vec(0..2_500u32, 0..50),
            memory in 0..400_000_000u64,
            threads in 1usize..40,
        ) {
            let tiles: Vec<_> = pieces.iter().map(|&p| tile(p)).collect();
            let n = max_concurrent_tiles(tiles.iter(), memory, threads);
            prop_assert!((1..=threads).contains(&n));
            let mut sorted = pieces;
            sorted.sort_unstable_by(|a, b| b.cmp(a));
            let needed = |n: usize| sorted.iter().take(n).map(|&p| u64::from(p)).sum::<u64>() * BYTES_PER_NODE;
            prop_assert!(n == 1 || needed(n) <= memory / 4 * 3);
            prop_assert!(n == threads || needed(n + 1) > memory / 4 * 3);
        }
    }
}
