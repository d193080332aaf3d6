//! Scans that are simulated, with what makes it hard to find the sample in them.

use super::*;
use crate::grid::{Dims, Placement};
use crate::progress::Quiet;
use crate::volume::MemoryVolume;

/// A scan whose samples are what `of` says, with noise.
fn scan(dims: [u32; 3], of: impl Fn([f64; 3]) -> f64) -> MemoryVolume<u16> {
    let [nx, ny, nz] = dims;
    let mut samples = Vec::new();
    let mut noise = 1u32;
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let sample = of([x, y, z].map(f64::from)) + f64::from(noise >> 24) * 8.0;
                samples.push(sample as u16);
            }
        }
    }
    MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap()
}

fn all_slices(volume: &dyn Volume) -> Range<u32> {
    0..volume.header().dims.0[2]
}

fn find(volume: &dyn Volume) -> Result<FoundCylinder> {
    find_cylinder(volume, all_slices(volume), &Quiet)
}

fn round(x: f64, y: f64, [cx, cy, r]: [f64; 3]) -> f64 {
    1000.0 + 2000.0 * (r + 0.5 - libm::hypot(x - cx, y - cy)).clamp(0.0, 1.0)
}

#[test]
fn a_round_sample_is_found_in_spite_of_pores_and_noise() {
    for [cx, cy, r] in [[60.3, 55.8, 40.2], [64.0, 64.0, 60.0], [30.0, 90.5, 20.0]] {
        let volume = scan([130, 128, 40], |[x, y, z]| {
            let pore = libm::sin(x / 7.0) + libm::cos(y / 5.0) + libm::sin(z / 3.0) > 0.9;
            round(x, y, [cx, cy, r]) - if pore { 900.0 } else { 0.0 }
        });
        let found = find(&volume).unwrap().cylinder;
        let [x, y] = found.centre;
        assert!(libm::hypot(x - cx, y - cy) < 0.4, "{found}");
        assert!((found.radius + 1.0 - r).abs() < 0.7, "{found}");
    }
}

#[test]
fn what_lies_beyond_a_reconstruction_is_not_the_air() {
    let dims = [110, 110, 12];
    let sample = [55.0, 54.0, 35.0];
    let beyond = |x: f64, y: f64| libm::hypot(x - 54.5, y - 54.5) > 54.0;
    let mut volume = scan(dims, |[x, y, _]| round(x, y, sample));
    let plain = find(&volume).unwrap().cylinder;
    for fill in [0u16, 65_535] {
        let mut samples = Vec::new();
        let mut row = vec![0u16; 110];
        for z in 0..12 {
            for y in 0..110 {
                let out = bytemuck::cast_slice_mut(&mut row);
                volume.read_box(0..110, y..y + 1, z..z + 1, out).unwrap();
                for (x, v) in row.iter_mut().enumerate() {
                    if beyond(x as f64, f64::from(y)) {
                        *v = fill;
                    }
                }
                samples.extend_from_slice(&row);
            }
        }
        volume = MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap();
        let found = find(&volume).unwrap().cylinder;
        assert!(
            (found.radius - plain.radius).abs() < 0.6,
            "{fill}: {found}, {plain}"
        );
    }
    // a pixel and a half of air on each side
    let close = scan([100, 100, 10], |[x, y, _]| round(x, y, [49.5, 49.5, 48.0]));
    let found = find(&close).unwrap().cylinder;
    assert!((found.radius + 1.0 - 48.0).abs() < 0.7, "{found}");
}

#[test]
fn large_slices_are_seen_coarser() {
    let [cx, cy, r] = [1100.0, 1003.5, 700.0];
    let volume = scan([2100, 2060, 2], |[x, y, _]| round(x, y, [cx, cy, r]));
    let found = find(&volume).unwrap().cylinder;
    let [x, y] = found.centre;
    assert!(libm::hypot(x - cx, y - cy) < 1.0, "{found}");
    assert!((found.radius + 3.0 - r).abs() < 1.5, "{found}");
}

#[test]
fn what_is_no_upright_round_sample_is_told() {
    let dims = [100, 100, 20];
    let square = |x: f64, y: f64| f64::max((x - 50.0).abs(), (y - 50.0).abs()) < 30.0;
    let message = |volume: MemoryVolume<u16>| find(&volume).unwrap_err().to_string();
    let of_square = scan(dims, |[x, y, _]| if square(x, y) { 3000.0 } else { 500.0 });
    assert!(message(of_square).contains("not round"));
    let tilted = scan(dims, |[x, y, z]| round(x, y, [40.0 + z, 50.0, 25.0]));
    assert!(message(tilted).contains("not upright"));
    let cut_off = scan(dims, |[x, y, _]| round(x, y, [50.0, 50.0, 65.0]));
    assert!(message(cut_off).contains("fills the slices"));
    let same = MemoryVolume::new(Dims([20; 3]), Placement::default(), vec![7u8; 8000]);
    let of_one = find(&same.unwrap()).unwrap_err().to_string();
    assert!(of_one.contains("of one value") && of_one.contains("cylinder:CX,CY,R"));
    let tiny = scan(dims, |[x, y, _]| round(x, y, [50.0, 50.0, 5.0]));
    assert!(message(tiny).contains("a radius of"));
}

/// Of a rim at 0 and a slope of a voxel.
fn edge(inside: f64) -> f64 {
    (inside + 0.5).clamp(0.0, 1.0)
}

/// A ring of this brightness.
fn ring([x, y]: [f64; 2], [cx, cy]: [f64; 2], [inner, outer]: [f64; 2]) -> f64 {
    let r = libm::hypot(x - cx, y - cy);
    edge(outer - r) * edge(r - inner)
}

/// The cylinder is the one that is there, which ends `less` voxels further inside than where the rim is.
fn assert_near(found: &FoundCylinder, [cx, cy, r]: [f64; 3], less: f64) {
    let [x, y] = found.cylinder.centre;
    assert!(libm::hypot(x - cx, y - cy) < 0.6, "{found:?}");
    assert!(
        (found.cylinder.radius + 1.0 + less - r).abs() < 0.8,
        "{found:?}"
    );
}

const DIMS: [u32; 3] = [130, 126, 64];
const SAMPLE: [f64; 3] = [62.0, 64.5, 30.0];

fn sample(x: f64, y: f64) -> f64 {
    round(x, y, SAMPLE)
}

#[test]
fn the_sample_in_a_tube_is_found_and_the_tube_told() {
    let around = |x: f64, y: f64| ring([x, y], [63.0, 63.0], [40.0, 50.0]);
    // as bright as the sample, darker, and far brighter
    for bright in [2000.0, 700.0, 12_000.0] {
        let volume = scan(DIMS, |[x, y, _]| sample(x, y) + bright * around(x, y));
        let found = find(&volume).unwrap();
        assert_near(&found, SAMPLE, 0.0);
        if bright > 1000.0 {
            assert_eq!(found.others.len(), 1, "{found:?}");
            assert!((found.others[0].radius - 49.0).abs() < 0.8, "{found:?}");
            assert!(
                found.warnings[0].contains("a tube around it, cylinder:6"),
                "{found:?}"
            );
        }
    }
    // an empty one is what is round
    let empty = scan(DIMS, |[x, y, _]| 1000.0 + 2000.0 * around(x, y));
    let found = find(&empty).unwrap();
    assert_near(&found, [63.0, 63.0, 50.0], 0.0);
    assert!(found.warnings.is_empty(), "{found:?}");
    // without air between
    for (tube, core) in [(900.0, 2000.0), (2400.0, 1200.0)] {
        let full = scan(DIMS, |[x, y, _]| {
            let [outer, inner] = [[62.0, 64.5, 50.0], SAMPLE].map(|c| round(x, y, c) - 1000.0);
            1000.0 + outer * tube / 2000.0 + inner * (core - tube) / 2000.0
        });
        let found = find(&full).unwrap();
        let told = found.others.first().map_or(found.cylinder, |other| *other);
        assert!((told.radius - 29.0).abs() < 0.9, "{found:?}");
    }
    // and one with a block in it is not sure
    let block = scan(DIMS, |[x, y, _]| {
        let block = f64::max((x - 63.0).abs(), (y - 63.0).abs() * 1.6) < 25.0;
        let block = if block { 2000.0 } else { 0.0 };
        1000.0 + block + 2000.0 * around(x, y)
    });
    let message = find(&block).unwrap_err().to_string();
    assert!(
        message.contains("a tube, cylinder:63") && message.contains("not round"),
        "{message}"
    );
}

#[test]
fn of_two_samples_none_is_taken_without_a_word() {
    let two = |r: f64| {
        scan(DIMS, move |[x, y, _]| {
            round(x, y, [38.0, 64.0, 30.0]) + round(x, y, [100.0, 60.0, r]) - 1000.0
        })
    };
    let message = find(&two(24.0)).unwrap_err().to_string();
    assert!(message.contains("two of them, cylinder:3"), "{message}");
    assert!(message.contains(" and cylinder:100"), "{message}");
    // a rod beside it
    let found = find(&two(9.0)).unwrap();
    assert_near(&found, [38.0, 64.0, 30.0], 0.0);
    assert!((found.others[0].centre[0] - 100.0).abs() < 0.5, "{found:?}");
    assert!(
        found.warnings[0].contains("the larger one was taken"),
        "{found:?}"
    );
}

#[test]
fn slices_without_the_sample_are_told() {
    let [nx, ny, nz] = [DIMS[0], DIMS[1], 200];
    let dims = [nx, ny, nz];
    for (from, to) in [(0, 200), (23, 171), (0, 140), (90, 200), (120, 150)] {
        let is_in = |z: f64| (f64::from(from)..f64::from(to)).contains(&z);
        let volume = scan(
            dims,
            |[x, y, z]| if is_in(z) { sample(x, y) } else { 1000.0 },
        );
        let found = find(&volume).unwrap();
        assert_near(&found, SAMPLE, 0.0);
        assert_eq!(found.slices, from..to);
        let told = found
            .warnings
            .iter()
            .any(|w| w.contains(&format!("--crop :,:,{from}:{to}")));
        assert_eq!(told, to - from < 200, "{found:?}");
        // asked for these alone there is nothing to say
        let found = find_cylinder(&volume, from..to, &Quiet).unwrap();
        assert!(found.warnings.is_empty(), "{found:?}");
    }
}

#[test]
fn few_slices_are_enough() {
    for slices in [1, 2, 3, 5, 9] {
        let volume = scan(DIMS, |[x, y, _]| sample(x, y));
        let found = find_cylinder(&volume, 7..7 + slices, &Quiet).unwrap();
        assert_near(&found, SAMPLE, 0.0);
        assert!(found.warnings.is_empty(), "{found:?}");
    }
}

#[test]
fn a_holder_is_left_out() {
    let plate = |_: f64, _: f64| 3000.0;
    let pin = |x: f64, y: f64| round(x, y, [60.0, 60.0, 12.0]);
    let cup = |x: f64, y: f64| round(x, y, [62.0, 62.0, 48.0]);
    let holders: [&dyn Fn(f64, f64) -> f64; 3] = [&plate, &pin, &cup];
    for holder in holders {
        let volume = scan(
            DIMS,
            |[x, y, z]| if z < 14.0 { holder(x, y) } else { sample(x, y) },
        );
        let found = find(&volume).unwrap();
        assert_near(&found, SAMPLE, 0.0);
        assert_eq!(found.slices, 14..64);
        assert!(found.warnings[0].contains("--crop :,:,14:64"), "{found:?}");
    }
}

#[test]
fn a_slight_tilt_is_taken_in_and_told() {
    let dims = [130, 126, 120];
    for degrees in [0.0, 1.0, 2.0] {
        let slope = libm::tan(f64::to_radians(degrees));
        let volume = scan(dims, |[x, y, z]| {
            round(x, y, [SAMPLE[0] + slope * (z - 60.0), SAMPLE[1], SAMPLE[2]])
        });
        let found = find(&volume).unwrap();
        // no air is in any slice
        assert_near(&found, SAMPLE, slope * 60.0);
        assert!((found.tilt - degrees).abs() < 0.2, "{found:?}");
        assert_eq!(
            found.warnings.len(),
            usize::from(degrees > 0.0),
            "{found:?}"
        );
    }
}

#[test]
fn hot_voxels_and_lines_of_them_are_not_seen() {
    for hot in [0u8, 1, 2] {
        let volume = scan(DIMS, |[x, y, _]| match hot {
            // through all slices, in the air and in the sample, or a line in all slices
            0 if (x, y) == (8.0, 9.0) => 60_000.0,
            1 if (x, y) == (70.0, 60.0) => 60_000.0,
            2 if x == 20.0 => 60_000.0,
            _ => sample(x, y),
        });
        let found = find(&volume).unwrap();
        assert_near(&found, SAMPLE, 0.0);
        assert!(found.warnings.is_empty(), "{hot}: {found:?}");
    }
}
