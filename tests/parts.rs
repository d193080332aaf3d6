//! A conversion in parts gives the bytes of a conversion in one process, whatever the parts, in whatever order they work.

mod common;

use alvis::convert::ConvertOptions;
use alvis::convert::parts::{
    Asked, Merged, NextMerge, NextWork, merge_parts, next_merge, next_work, plan_parts,
    work_on_part,
};
use alvis::grid::Ambiguous;
use alvis::manifest::{Encoding, Layout, Primitives};
use alvis::progress::Quiet;
use alvis::volume::Volume;
use common::volumes::{Random, foam, late_joins, noise, placed, samples, volume};
use common::{assert_same_files, converted, files, options};
use std::collections::BTreeMap;
use std::path::Path;

type Files = BTreeMap<String, Vec<u8>>;

/// Layers of macrocubes.
fn layers(volume: &dyn Volume, options: &ConvertOptions) -> u32 {
    let [_, _, nz] = volume.header().dims.0;
    (nz - 1).div_ceil(options.macrocube[2]).max(1)
}

fn plan(volume: &dyn Volume, options: &ConvertOptions, out: &Path, parts: u32) {
    plan_parts(volume, options, out, parts, Asked::default())
        .unwrap_or_else(|e| panic!("{}: {e}", volume.header().dims));
}

/// Works and merges until the tile set is in place; parts work in the order that `order` gives them.
fn finish(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    mut order: impl FnMut(&mut Vec<u32>),
) {
    for _ in 0..20 {
        match merge_parts(volume, options, out, &Quiet).unwrap() {
            Merged::InPlace(_) => return,
            Merged::ToRun(_, mut parts) => {
                order(&mut parts);
                for part in parts {
                    work_on_part(volume, options, out, part, &Quiet).unwrap();
                }
            }
        }
    }
    panic!("it does not end");
}

fn in_parts(volume: &dyn Volume, options: &ConvertOptions, parts: u32) -> Files {
    let dir = tempfile::tempdir().unwrap();
    plan(volume, options, dir.path(), parts);
    finish(volume, options, dir.path(), |_| {});
    files(dir.path())
}

/// In 1, 2, 3, 7 parts and one for each layer, as far as there are as many layers.
fn same_in_parts(volume: &dyn Volume, options: &ConvertOptions, what: &str) -> Files {
    let (whole, report) = converted(volume, options);
    let whole = files(whole.path());
    let layers = layers(volume, options);
    let mut counts = vec![1, 2, 3, 7, layers];
    counts.retain(|&parts| parts <= layers);
    counts.dedup();
    for parts in counts {
        let made = in_parts(volume, options, parts);
        let what = format!("{what} in {parts} of {layers}, {:?}", report.totals);
        assert_same_files(&whole, &made, &what);
    }
    whole
}

/// Noise of which a voxel is above with a chance of `share`.
fn sparse(dims: [u32; 3], share: f64, seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    samples(dims, |_| if random.unit() < share { 200 } else { 50 })
}

#[test]
fn parts_of_a_foam_are_the_single_run() {
    let volume = placed([40, 37, 60], foam([40, 37, 60], 3));
    for ambiguous in [Ambiguous::Separate, Ambiguous::Join] {
        let options = ConvertOptions {
            ambiguous,
            ..options([16, 9, 7])
        };
        same_in_parts(&volume, &options, "foam");
    }
}

#[test]
fn parts_of_noise_are_the_single_run() {
    for (share, seed) in [(0.1, 1), (0.5, 2), (0.9, 3)] {
        let dims = [23, 19, 36];
        let volume = volume(dims, sparse(dims, share, seed));
        for ambiguous in [Ambiguous::Separate, Ambiguous::Join] {
            let options = ConvertOptions {
                ambiguous,
                ..options([7, 7, 7])
            };
            same_in_parts(&volume, &options, &format!("noise of {share}"));
        }
    }
}

#[test]
fn parts_of_shapes_that_join_late_are_the_single_run() {
    let (dims, values) = late_joins();
    let upside_down = samples(dims, |[x, y, z]| {
        let [nx, ny, nz] = dims;
        values[(x + nx * (y + ny * (nz - 1 - z))) as usize]
    });
    for (values, what) in [(values, "late joins"), (upside_down, "upside down")] {
        let volume = volume(dims, values);
        same_in_parts(&volume, &options([16, 16, 5]), what);
        let cap = ConvertOptions {
            cap: true,
            ..options([16, 16, 5])
        };
        same_in_parts(&volume, &cap, what);
    }
}

/// A tube that winds upwards around the axis, and one of the other phase around which it winds.
fn helix(dims: [u32; 3]) -> Vec<u8> {
    let [nx, ny, nz] = dims.map(f64::from);
    samples(dims, |[x, y, z]| {
        let turn = f64::from(z) / nz * 40.0;
        let [cx, cy] = [
            nx / 2.0 + nx / 3.0 * turn.cos(),
            ny / 2.0 + ny / 3.0 * turn.sin(),
        ];
        let (dx, dy) = (f64::from(x) - cx, f64::from(y) - cy);
        if dx * dx + dy * dy < 12.0 { 200 } else { 50 }
    })
}

#[test]
fn parts_of_a_helix_of_nothing_and_of_everything_are_the_single_run() {
    let dims = [24, 24, 40];
    same_in_parts(&volume(dims, helix(dims)), &options([8, 8, 8]), "helix");
    for (value, what) in [(0u8, "empty"), (255, "full")] {
        let all = vec![value; 24 * 24 * 40];
        same_in_parts(&volume(dims, all), &options([8, 8, 8]), what);
    }
    let flat = [24, 24, 2];
    same_in_parts(
        &volume(flat, noise(flat, 5)),
        &options([8, 8, 8]),
        "one layer",
    );
}

#[test]
fn all_forms_of_parts_are_the_single_run() {
    let dims = [30, 21, 33];
    let volume = placed(dims, foam(dims, 8));
    for encoding in [Encoding::default(), Encoding::Quantized, Encoding::Meshopt] {
        for (layout, primitives, parquet) in [
            (Layout::Merged, Primitives::Strips, false),
            (Layout::Auto, Primitives::Triangles, true),
        ] {
            let options = ConvertOptions {
                encoding,
                layout,
                primitives,
                parquet,
                cap: parquet,
                keep_samples: parquet,
                ..options([8, 8, 8])
            };
            let what = format!("{encoding:?} {layout:?} {primitives:?}");
            same_in_parts(&volume, &options, &what);
        }
    }
}

#[test]
fn what_is_small_is_left_out_of_parts_as_of_the_whole() {
    for share in [0.1, 0.3, 0.7] {
        let dims = [21, 18, 30];
        let volume = volume(dims, sparse(dims, share, 11));
        for min_voxels in [2, 9, 200] {
            let options = ConvertOptions {
                min_voxels,
                ..options([7, 7, 5])
            };
            same_in_parts(&volume, &options, &format!("{share} with {min_voxels}"));
        }
    }
}
