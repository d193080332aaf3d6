//! A whole tile. The first byte says which set it is put into.
#![no_main]
use alvis_fuzz::{Set, forms, read_tile};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

static SETS: LazyLock<[Set; 4]> = LazyLock::new(forms);

fuzz_target!(|data: &[u8]| {
    let Some((first, glb)) = data.split_first() else { return };
    read_tile(glb, &SETS[usize::from(first % 4)]);
});
