//! Cells that are split at their necks: whole trees of files, of many volumes.

use super::bytes::{
    cropped_cylinders, of_seed, random_dims, same_in_parts, same_in_parts_of, shapes, sparse,
};
use super::{in_parts, layers};
use crate::common::volumes::{Random, foam, late_joins, noise, placed, samples, volume};
use crate::common::{assert_same_files, converted, data, files, options};
use alvis::convert::{ConvertOptions, NeckRule};
use alvis::grid::Ambiguous;
use alvis::progress::Quiet;
use alvis::volume::{MemoryVolume, OpenOptions, open, statistics};

/// The usual rule.
fn split(macrocube: [u32; 3]) -> ConvertOptions {
    ConvertOptions {
        split: Some(NeckRule::default()),
        ..options(macrocube)
    }
}

/// Holes in the walls of a foam: its cells leak into each other.
pub fn leaky(dims: [u32; 3], seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    let mut values = foam(dims, seed);
    let [nx, ny, _] = dims;
    for _ in 0..dims.iter().product::<u32>() / 300 {
        let [x, y, z] = dims.map(|n| (random.bits() % u64::from(n)) as u32);
        for (dx, dy, dz) in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] {
            let [x, y, z] = [x + dx, y + dy, z + dz];
            if x < nx && y < ny && z < dims[2] {
                values[(x + nx * (y + ny * z)) as usize] = 0;
            }
        }
    }
    values
}

#[test]
fn two_parts_of_a_split_foam_are_the_single_run() {
    let dims = [30, 26, 40];
    let volume = placed(dims, leaky(dims, 3));
    let options = split([16, 9, 7]);
    let (whole, report) = converted(&volume, &options);
    assert!(report.totals.necks > 10, "{:?}", report.totals);
    let made = in_parts(&volume, &options, 2);
    assert_same_files(&files(whole.path()), &made, "two parts");
}

#[test]
fn parts_of_a_split_foam_are_the_single_run() {
    let dims = [40, 37, 60];
    for values in [foam(dims, 3), leaky(dims, 4)] {
        let volume = placed(dims, values);
        for ambiguous in [Ambiguous::Separate, Ambiguous::Join] {
            let options = ConvertOptions {
                ambiguous,
                ..split([16, 9, 7])
            };
            same_in_parts(&volume, &options, "split foam");
        }
    }
}

#[test]
fn parts_of_split_noise_are_the_single_run() {
    for (share, seed) in [(0.1, 1), (0.5, 2), (0.9, 3)] {
        let dims = [23, 19, 36];
        let volume = volume(dims, sparse(dims, share, seed));
        for (ambiguous, ratio_permille, h_256) in
            [(Ambiguous::Separate, 800, 0), (Ambiguous::Join, 950, 128)]
        {
            let rule = NeckRule {
                ratio_permille,
                h_256,
                ..NeckRule::default()
            };
            let options = ConvertOptions {
                ambiguous,
                split: Some(rule),
                ..options([7, 7, 7])
            };
            same_in_parts(&volume, &options, &format!("split noise of {share}"));
        }
    }
}

#[test]
fn parts_of_split_shapes_are_the_single_run() {
    let dims = [24, 24, 40];
    for (values, what) in shapes(dims) {
        same_in_parts(&volume(dims, values), &split([8, 8, 8]), what);
        // odd ones, and parts of a slice or two
    }
    let (dims, values) = late_joins();
    same_in_parts(&volume(dims, values), &split([16, 16, 5]), "late joins");
    for height in [1, 2, 3] {
        let dims = [17, 13, 11];
        let volume = volume(dims, leaky(dims, 9));
        let what = format!("layers of {height}");
        same_in_parts(&volume, &split([5, 7, height]), &what);
    }
    let flat = [24, 24, 2];
    same_in_parts(
        &volume(flat, noise(flat, 5)),
        &split([8, 8, 8]),
        "one layer",
    );
}

/// Balls on a string, which widen and narrow: a component through all parts, with a neck in each.
#[test]
fn parts_of_a_string_of_pores_are_the_single_run() {
    let dims = [20, 20, 120];
    let string = samples(dims, |[x, y, z]| {
        let along = f64::from(z % 15) - 7.0;
        let radius = (49.0 - along * along).max(2.0);
        let (dx, dy) = (f64::from(x) - 9.5, f64::from(y) - 9.5);
        if dx * dx + dy * dy < radius { 0 } else { 200 }
    });
    let volume = volume(dims, string);
    let options = split([8, 8, 8]);
    let (_, report) = converted(&volume, &options);
    assert_eq!((report.totals.cells, report.totals.necks), (8, 7));
    same_in_parts(&volume, &options, "string");
}

#[test]
fn parts_of_split_cells_with_all_options_are_the_single_run() {
    let dims = [30, 28, 40];
    let volume = placed(dims, leaky(dims, 6));
    for regions in cropped_cylinders(dims) {
        let rule = NeckRule {
            ratio_permille: 700,
            h_256: 256,
            min_radius_256: 300,
        };
        let options = ConvertOptions {
            min_voxels: 4,
            cap: true,
            split: Some(rule),
            ..regions
        };
        same_in_parts_of(&volume, &options, 6, "split region");
    }
}

#[test]
fn parts_of_random_split_volumes_are_the_single_run() {
    let mut necks = 0;
    for seed in 0..24u64 {
        let mut random = Random(seed);
        let dims = random_dims(&mut random);
        let share = random.unit() * random.unit();
        let values = match seed % 2 {
            0 => sparse(dims, share, seed),
            _ => leaky(dims, seed),
        };
        let volume = of_seed(seed, dims, values);
        let rule = NeckRule {
            ratio_permille: [600, 800, 1000][(seed % 3) as usize],
            h_256: [0, 128][(seed % 2) as usize],
            ..NeckRule::default()
        };
        let options = ConvertOptions {
            cap: seed % 3 == 0,
            min_voxels: seed % 4 * 3,
            split: Some(rule),
            ..options([0; 3].map(|_| 1 + (random.bits() % 9) as u32))
        };
        same_in_parts(&volume, &options, &format!("split seed {seed}"));
        necks += converted(&volume, &options).1.totals.necks;
    }
    assert!(necks > 200, "{necks}");
}

#[test]
fn parts_that_have_other_memory_and_threads_are_the_single_run() {
    let dims = [40, 90, 60];
    let volume = placed(dims, leaky(dims, 8));
    let single = split([16, 16, 10]);
    let (whole, _) = converted(&volume, &single);
    for (threads, memory) in [(1, 64 << 20), (2, 1 << 30)] {
        let options = ConvertOptions {
            threads,
            memory,
            ..single.clone()
        };
        let what = format!("{threads} threads, {memory} bytes");
        assert_same_files(&files(whole.path()), &in_parts(&volume, &options, 3), &what);
    }
}

#[test]
fn parts_of_a_leaky_foam_are_the_single_run() {
    let Some(data) = data("parts_of_a_leaky_foam_are_the_single_run") else {
        return;
    };
    let path = data.join("phantom/foam_leaky_200_ct.nrrd");
    if !path.exists() {
        eprintln!("SKIPPED: no {}", path.display());
        return;
    }
    let opened = open(&path, &OpenOptions::default()).unwrap();
    let dims = [96, 90, 100];
    let bytes = opened.volume.header().dtype.bytes();
    let mut samples = vec![0; 96 * 90 * 100 * bytes];
    opened
        .volume
        .read_box(10..106, 20..110, 30..130, &mut samples)
        .unwrap();
    // the upper byte of each
    let samples: Vec<u8> = samples
        .chunks(bytes)
        .map(|sample| sample[bytes - 1])
        .collect();
    let volume: MemoryVolume<u8> = placed(dims, samples);
    let found = statistics(&volume, None, &Quiet).unwrap();
    let options = ConvertOptions {
        threshold: found.otsu.unwrap(),
        ..split([32, 32, 14])
    };
    assert_eq!(layers(&volume, &options), 8);
    let (_, report) = converted(&volume, &options);
    assert!(report.totals.necks > 20, "{:?}", report.totals);
    same_in_parts(&volume, &options, "leaky foam");
}
