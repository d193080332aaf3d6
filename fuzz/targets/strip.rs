//! What lies in a tile's BIN chunk: positions, normals, indices, compressed streams and tables. The
//! first byte says of which set the tile is; the rest replaces the end of the chunk, where the indices
//! are, as far as it goes.
#![no_main]
use alvis_fuzz::{Set, forms, read_tile};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SETS: LazyLock<Vec<(Set, Vec<u8>, usize)>> = LazyLock::new(|| {
    let bin = |set: Set| {
        let glb = set.tile_bytes();
        let json = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        (set, glb, 12 + 8 + json + 8)
    };
    forms().map(bin).into()
});

fuzz_target!(|data: &[u8]| {
    let Some((first, tail)) = data.split_first() else { return };
    let (set, glb, bin) = &SETS[usize::from(first % 4)];
    let mut glb = glb.clone();
    let from = glb.len().saturating_sub(tail.len()).max(*bin);
    let len = glb.len() - from;
    glb[from..].copy_from_slice(&tail[..len]);
    read_tile(&glb, set);
});
