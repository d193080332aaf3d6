//! Walls between cells: whole trees of files, of many volumes. Lines go from part to part, through several where layers are
//! lower than walls are thick.

use super::bytes::{
    cropped_cylinders, of_seed, random_dims, same_in_parts, same_in_parts_of, shapes, sparse,
};
use super::in_parts;
use super::labels::{self, blocks, scattered};
use super::split::leaky;
use crate::common::volumes::{Random, foam, late_joins, placed, samples, volume};
use crate::common::{assert_same_files, converted, files, options};
use alvis::convert::{ConvertOptions, NeckRule};
use alvis::grid::{Ambiguous, Dims, Placement};
use alvis::volume::{MemoryVolume, Volume};

/// Of cells that are components, and of those that are split.
fn with_walls(of: &ConvertOptions) -> [ConvertOptions; 2] {
    [None, Some(NeckRule::default())].map(|split| ConvertOptions {
        walls: true,
        split,
        ..of.clone()
    })
}

/// How many walls there are.
fn walls(volume: &dyn Volume, options: &ConvertOptions) -> u64 {
    converted(volume, options).1.totals.walls
}

#[test]
fn two_parts_of_a_foam_with_walls_are_the_single_run() {
    let dims = [30, 26, 40];
    let volume = placed(dims, leaky(dims, 3));
    for options in with_walls(&options([16, 9, 7])) {
        assert!(walls(&volume, &options) > 10);
        same_in_parts_of(&volume, &options, 2, "two parts");
    }
}

#[test]
fn parts_of_foams_with_walls_are_the_single_run() {
    let dims = [30, 27, 42];
    for (values, ambiguous) in [
        (foam(dims, 3), Ambiguous::Separate),
        (leaky(dims, 4), Ambiguous::Join),
    ] {
        let volume = placed(dims, values);
        for options in with_walls(&options([16, 9, 7])) {
            let options = ConvertOptions {
                ambiguous,
                ..options
            };
            let found = walls(&volume, &options);
            assert!(found > 5, "{found}");
            same_in_parts(&volume, &options, "walls of a foam");
        }
    }
}

/// Cells in layers, with walls between them of all thicknesses up to more than that of several parts.
fn stack(dims: [u32; 3]) -> Vec<u8> {
    let is_wall = |z: u32| {
        let mut start = 2;
        (1..12).any(|thickness| {
            let wall = start..start + thickness;
            start = wall.end + 1 + thickness % 3;
            wall.contains(&z)
        })
    };
    samples(dims, |[x, y, z]| {
        let across = x.min(dims[0] - 1 - x).min(y).min(dims[1] - 1 - y);
        if across == 0 || is_wall(z) { 200 } else { 50 }
    })
}

#[test]
fn walls_that_lie_in_several_parts_are_those_of_the_single_run() {
    let dims = [9, 8, 80];
    let values = stack(dims);
    let volume = volume(dims, values);
    for height in [1, 4] {
        for options in with_walls(&options([4, 5, height])) {
            let found = walls(&volume, &options);
            assert!(found > 6, "{found}");
            let what = format!("layers of {height}");
            same_in_parts(&volume, &options, &what);
        }
    }
}

#[test]
fn parts_of_uneven_voxels_and_noise_with_walls_are_the_single_run() {
    let dims = [23, 19, 36];
    for (share, seed) in [(0.1, 1), (0.5, 2), (0.9, 3)] {
        let values = sparse(dims, share, seed);
        for spacing in [[0.7, 1.3, 0.2], [0.4, 0.4, 1.1]] {
            let place = Placement {
                spacing,
                ..Placement::default()
            };
            let volume = MemoryVolume::new(Dims(dims), place, values.clone()).unwrap();
            for options in with_walls(&options([7, 7, 5])) {
                same_in_parts(&volume, &options, &format!("walls in noise of {share}"));
            }
        }
    }
}

#[test]
fn parts_of_shapes_with_walls_are_the_single_run() {
    let dims = [24, 24, 40];
    for (values, what) in shapes(dims) {
        for options in with_walls(&options([8, 8, 8])) {
            same_in_parts(&volume(dims, values.clone()), &options, what);
        }
    }
    let (dims, values) = late_joins();
    for options in with_walls(&options([16, 16, 5])) {
        same_in_parts(&volume(dims, values.clone()), &options, "late joins");
    }
}

#[test]
fn parts_with_walls_and_all_options_are_the_single_run() {
    let dims = [30, 28, 40];
    let volume = placed(dims, leaky(dims, 6));
    for regions in cropped_cylinders(dims) {
        for options in with_walls(&regions) {
            let options = ConvertOptions {
                min_voxels: 4,
                cap: true,
                parquet: true,
                keep_samples: true,
                ..options
            };
            same_in_parts_of(&volume, &options, 6, "walls in a region");
        }
    }
}

#[test]
fn parts_of_labels_with_walls_are_the_single_run() {
    let dims = [30, 27, 44];
    let volume = placed(dims, foam(dims, 4));
    let options = ConvertOptions {
        walls: true,
        ..options([16, 9, 6])
    };
    for (of, what) in [
        (blocks(dims, 5, 2), "blocks"),
        (scattered(dims, 4), "scattered"),
        (samples(dims, |[_, _, z]| 60 - z), "slices, from above"),
        (samples(dims, |[x, ..]| x / 9), "columns"),
    ] {
        labels::same_in_parts(&volume, of, &options, what);
    }
    let regions = cropped_cylinders([30, 28, 40]).map(|regions| ConvertOptions {
        walls: true,
        parquet: true,
        ..regions
    });
    let dims = [30, 28, 40];
    let volume = placed(dims, foam(dims, 6));
    for options in regions {
        labels::same_in_parts(&volume, blocks(dims, 6, 1), &options, "region");
    }
}

#[test]
fn parts_of_random_volumes_with_walls_are_the_single_run() {
    let mut found = 0;
    for seed in 0..20u64 {
        let mut random = Random(seed);
        let dims = random_dims(&mut random);
        let values = match seed % 3 {
            0 => sparse(dims, random.unit(), seed),
            1 => leaky(dims, seed),
            _ => foam(dims, seed),
        };
        let volume = of_seed(seed, dims, values);
        let options = ConvertOptions {
            min_voxels: seed % 4 * 3,
            walls: true,
            ..options([0; 3].map(|_| 1 + (random.bits() % 9) as u32))
        };
        let what = format!("walls of seed {seed}");
        if seed % 2 == 0 {
            let labels = match seed % 4 {
                0 => blocks(dims, 1 + (random.bits() % 6) as u32, seed),
                _ => scattered(dims, seed),
            };
            labels::same_in_parts(&volume, labels, &options, &what);
            continue;
        }
        for options in with_walls(&options) {
            same_in_parts(&volume, &options, &what);
            found += walls(&volume, &options);
        }
    }
    assert!(found > 100, "{found}");
}

#[test]
fn walls_of_parts_that_have_other_memory_and_threads_are_those_of_the_single_run() {
    let dims = [40, 60, 50];
    let volume = placed(dims, leaky(dims, 8));
    for single in with_walls(&options([16, 16, 10])) {
        let (whole, report) = converted(&volume, &single);
        assert!(report.totals.walls > 20, "{:?}", report.totals);
        for (threads, memory) in [(1, 64 << 20), (2, 1 << 30)] {
            let options = ConvertOptions {
                threads,
                memory,
                ..single.clone()
            };
            let made = in_parts(&volume, &options, 3);
            let what = format!("{threads} threads, {memory} bytes");
            assert_same_files(&files(whole.path()), &made, &what);
        }
    }
}
