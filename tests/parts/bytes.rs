//! Whole trees of files, of many volumes and forms.

use super::{Files, in_parts, layers};
use crate::common::volumes::{Random, foam, late_joins, noise, placed, samples, volume};
use crate::common::{assert_same_files, converted, data, files, options};
use alvis::convert::{ConvertOptions, RegionOfInterest};
use alvis::grid::{Ambiguous, Crop, Cylinder, Dims, Dtype, Fill, Shape};
use alvis::manifest::{Encoding, Layout, Primitives};
use alvis::progress::Quiet;
use alvis::volume::{MemoryVolume, OpenOptions, RegionVoxels, Volume, open, statistics};

/// In 1, 2, 3, 7 parts and one for each layer, as far as there are as many layers.
pub fn same_in_parts(volume: &dyn Volume, options: &ConvertOptions, what: &str) -> Files {
    same_in_parts_of(volume, options, layers(volume, options), what)
}

/// The same of so many layers.
pub fn same_in_parts_of(
    volume: &dyn Volume,
    options: &ConvertOptions,
    layers: u32,
    what: &str,
) -> Files {
    let (whole, report) = converted(volume, options);
    let whole = files(whole.path());
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

/// Some small size for a test of random volumes.
pub fn random_dims(random: &mut Random) -> [u32; 3] {
    [0; 3].map(|_| 4 + (random.bits() % 18) as u32)
}

/// A volume that lies somewhere for each fifth seed.
pub fn of_seed(seed: u64, dims: [u32; 3], values: Vec<u8>) -> MemoryVolume<u8> {
    match seed % 5 {
        0 => placed(dims, values),
        _ => volume(dims, values),
    }
}

/// Noise of which a voxel is above with a chance of `share`.
pub fn sparse(dims: [u32; 3], share: f64, seed: u64) -> Vec<u8> {
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
pub fn helix(dims: [u32; 3]) -> Vec<u8> {
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

/// Bodies that wind through all parts or leave such a hollow, nothing, and everything, of a size, with their names.
pub fn shapes(dims: [u32; 3]) -> [(Vec<u8>, &'static str); 4] {
    let winding = helix(dims);
    let hollow = winding.iter().map(|value| 255 - value).collect();
    let all = |value: u8| vec![value; dims.iter().product::<u32>() as usize];
    [
        (winding, "helix"),
        (hollow, "hollow helix"),
        (all(0), "empty"),
        (all(255), "full"),
    ]
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

/// A crop and a cylinder in it, filled in both ways, of a volume of this size.
pub fn cropped_cylinders(dims: [u32; 3]) -> [ConvertOptions; 2] {
    let crop = Crop {
        x: 2..29,
        y: 0..28,
        z: 3..38,
    };
    let cylinder = Cylinder {
        centre: [15.0, 14.0],
        radius: 11.0,
    };
    let voxels = RegionVoxels::cylinder(&cylinder, Dims(dims)).unwrap();
    [(Fill::Material, 255.0), (Fill::Air, 0.0)].map(|(fill, value)| {
        let (shape, voxels) = (Shape::Cylinder(cylinder), voxels.clone());
        let region = RegionOfInterest::new(shape, voxels, Some(&crop), fill, value).unwrap();
        ConvertOptions {
            crop: Some(crop.clone()),
            region: Some(region),
            ..options([9, 9, 6])
        }
    })
}

#[test]
fn parts_of_a_crop_and_a_region_are_the_single_run() {
    let dims = [30, 28, 40];
    let volume = placed(dims, foam(dims, 6));
    for regions in cropped_cylinders(dims) {
        let options = ConvertOptions {
            min_voxels: 4,
            ..regions
        };
        same_in_parts_of(&volume, &options, 6, "region");
    }
}

/// Noise whose values differ from seed to seed, in macrocubes of all sizes.
#[test]
fn parts_of_random_volumes_are_the_single_run() {
    for seed in 0..12u64 {
        let mut random = Random(seed);
        let dims = random_dims(&mut random);
        let share = random.unit();
        let volume = volume(dims, sparse(dims, share, seed));
        let options = ConvertOptions {
            cap: seed % 3 == 0,
            min_voxels: seed % 4 * 3,
            ..options([0; 3].map(|_| 1 + (random.bits() % 9) as u32))
        };
        same_in_parts(&volume, &options, &format!("seed {seed}"));
    }
}

#[test]
fn parts_of_scans_are_the_single_run() {
    let Some(data) = data("parts_of_scans_are_the_single_run") else {
        return;
    };
    for name in ["npy/berea_100_to_300.npz", "tiff/electrode.tiff"] {
        let path = data.join(name);
        if !path.exists() {
            eprintln!("SKIPPED {name}: it is not there");
            continue;
        }
        let opened = open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(opened.volume.header().dtype, Dtype::U8);
        let dims = [96, 90, 100];
        let mut samples = vec![0; 96 * 90 * 100];
        let read = opened
            .volume
            .read_box(10..106, 20..110, 30..130, &mut samples);
        read.unwrap();
        let volume = placed(dims, samples);
        let found = statistics(&volume, None, &Quiet).unwrap();
        let options = ConvertOptions {
            threshold: found.otsu.unwrap(),
            ..options([32, 32, 14])
        };
        same_in_parts(&volume, &options, name);
    }
}
