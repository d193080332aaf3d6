//! A conversion in parts gives the bytes of a conversion in one process: whatever the parts, in whatever order and how often
//! they work, whoever is stopped or killed meanwhile.

#[path = "../command/mod.rs"]
mod command;
#[path = "../common/mod.rs"]
mod common;

mod bytes;
mod labels;
mod life;
mod refused;
mod split;
mod walls;
mod wrapped;

use alvis::convert::ConvertOptions;
use alvis::convert::parts::{Asked, Merged, merge_parts, plan_parts, work_on_part};
use alvis::progress::Quiet;
use alvis::volume::Volume;
use common::files;
use std::collections::BTreeMap;
use std::path::Path;

type Files = BTreeMap<String, Vec<u8>>;

/// Layers of macrocubes.
fn layers(volume: &dyn Volume, options: &ConvertOptions) -> u32 {
    let [_, _, nz] = volume.header().dims.0;
    (nz - 1).div_ceil(options.macrocube[2])
}

fn plan(volume: &dyn Volume, options: &ConvertOptions, out: &Path, parts: u32) {
    plan_parts(volume, options, out, parts, Asked::default())
        .unwrap_or_else(|e| panic!("{}: {e}", volume.header().dims));
}

/// Works and merges until the tile set is in place; parts work as `work` makes them, of those that are to run.
fn finish_with(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    mut work: impl FnMut(Vec<u32>),
) {
    for _ in 0..100 {
        match merge_parts(volume, options, out, &Quiet).unwrap() {
            Merged::InPlace(_) => return,
            Merged::ToRun(_, parts) => work(parts),
        }
    }
    panic!("it does not end");
}

fn finish(volume: &dyn Volume, options: &ConvertOptions, out: &Path) {
    finish_with(volume, options, out, |parts| {
        for part in parts {
            work_on_part(volume, options, out, part, &Quiet).unwrap();
        }
    });
}

fn in_parts(volume: &dyn Volume, options: &ConvertOptions, parts: u32) -> Files {
    let dir = tempfile::tempdir().unwrap();
    plan(volume, options, dir.path(), parts);
    finish(volume, options, dir.path());
    files(dir.path())
}
