//! A file as the input of a conversion: its header, and the first and last slice. The first byte gives
//! options, as a user may.
#![no_main]
use alvis::volume::{Dtype, OpenOptions, open};
use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use std::sync::LazyLock;

/// Slices that are larger are not read.
const MAX_SLICE: usize = 1 << 22;

static PLACE: LazyLock<(tempfile::TempDir, PathBuf)> = LazyLock::new(|| {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let file = dir.path().join("input");
    (dir, file)
});

fuzz_target!(|data: &[u8]| {
    let Some((first, file)) = data.split_first() else { return };
    let path = &PLACE.1;
    std::fs::write(path, file).unwrap();
    let raw = first & 1 == 1;
    let options = OpenOptions {
        dims: raw.then_some([4, 3, 2]),
        dtype: raw.then_some(Dtype::U16),
        offset: (first & 3 == 3).then_some(u64::from(first >> 2)),
        resample: first & 4 == 4 && !raw,
        ..OpenOptions::default()
    };
    let Ok(opened) = open(path, &options) else { return };
    let header = opened.volume.header();
    let [nx, ny, nz] = header.dims.0;
    let slice = u64::from(nx) * u64::from(ny) * header.dtype.bytes() as u64;
    if slice > MAX_SLICE as u64 {
        return;
    }
    let mut out = vec![0; slice as usize];
    for z in [0, nz - 1] {
        let _ = opened.volume.read_box(0..nx, 0..ny, z..z + 1, &mut out);
    }
});
