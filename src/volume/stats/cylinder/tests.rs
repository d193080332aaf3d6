//! Scans that are simulated, with what makes it hard to find the sample in them.

mod foams;
mod sparse;
mod uneven;

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
    let small = message(tiny);
    assert!(
        small.contains("too small") && small.contains("and 8 is the least"),
        "{small}"
    );
}

/// Whatever the samples are, also a few of them and such as are not finite: an answer or a message, and no panic.
#[test]
fn no_volume_makes_it_fail() {
    let mut random = 7u32;
    let mut next = |n: u32| {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) % n
    };
    for case in 0..300 {
        let dims = [2 + next(40), 2 + next(40), 2 + next(12)];
        let [cx, cy, r] = [next(40), next(40), next(25)].map(f64::from);
        let lean = f64::from(next(5)) - 2.0;
        let mut samples = Vec::new();
        for i in 0..dims[0] * dims[1] * dims[2] {
            let [x, y, z] =
                [i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]].map(f64::from);
            let inside = libm::hypot(x - cx - lean * z, y - cy) < r - (lean - 1.0) * z;
            samples.push(match next(60) {
                0 if case % 3 == 0 => f32::NAN,
                1 if case % 4 == 0 => f32::INFINITY,
                2 if case % 5 == 0 => -3e38,
                noise => (noise as f32) * (case % 7) as f32 + if inside { 300.0 } else { 0.0 },
            });
        }
        let volume = MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap();
        if let Ok(found) = find(&volume) {
            assert!(found.cylinder.radius >= SMALLEST, "{case}: {found:?}");
        }
    }
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
    assert_eq!(found.warnings.len(), 1, "{found:?}");
    assert!(found.warnings[0].contains("is empty"), "{found:?}");
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

/// Pores of a few voxels, so many that about this share of the whole is solid.
fn is_solid([x, y, z]: [f64; 3], share: f64) -> bool {
    // a value per block of three voxels, from its place
    let block = [x, y, z].map(|v| (v / 3.0) as u32);
    let mixed = block.iter().fold(17u32, |sum, v| {
        let sum = (sum ^ v).wrapping_mul(2_654_435_761);
        sum ^ sum >> 15
    });
    f64::from(mixed % 1000) < 1000.0 * share
}

const SMALL: [u32; 3] = [70, 68, 40];
const AXIS: [f64; 2] = [34.4, 33.7];

/// The distance from the axis.
fn off([x, y, _]: [f64; 3]) -> f64 {
    libm::hypot(x - AXIS[0], y - AXIS[1])
}

/// Air, or as much brighter as is said.
fn in_air(is: impl Fn([f64; 3]) -> f64) -> MemoryVolume<u16> {
    scan(SMALL, |p| 1000.0 + is(p))
}

fn told<'a>(found: &'a FoundCylinder, part: &str) -> Vec<&'a String> {
    let warnings = found.warnings.iter();
    warnings.filter(|w| w.contains(part)).collect()
}

/// A tube, a can or resin that touches the sample is told, with what is inside of it.
#[test]
fn what_lies_close_around_the_sample_is_told() {
    let solid = |p: [f64; 3], share: f64| if is_solid(p, share) { 2000.0 } else { 0.0 };
    let around = |inner: f64, outer: f64, bright: f64, share: f64| {
        in_air(move |p| match off(p) {
            r if r <= inner => solid(p, share),
            r if r <= outer => bright,
            _ => 0.0,
        })
    };
    // as bright as the sample, brighter, of the sample's mean, and a thin can
    for (inner, outer, bright, share) in [
        (24.0, 29.0, 2000.0, 0.6),
        (24.0, 29.0, 3500.0, 0.8),
        (20.0, 30.0, 1000.0, 0.5),
        (27.0, 29.0, 3500.0, 0.5),
    ] {
        let found = find(&around(inner, outer, bright, share)).unwrap();
        let case = format!("{inner} {outer} {bright} {share}: {found:?}");
        assert_eq!(
            told(&found, "the brightness, or how much of it is pores").len(),
            1,
            "{case}"
        );
        let off = found.others[0].radius + 1.0 - inner;
        assert!((-2.0..=1.0).contains(&off), "{case}");
    }
    let plain = find(&around(28.0, 28.0, 0.0, 0.7)).unwrap();
    assert!(plain.warnings.is_empty(), "{plain:?}");
    // a faint one, in a bright tube with a little air between, is found
    let faint = in_air(|p| match off(p) {
        r if r <= 23.0 => solid(p, 0.4),
        r if (27.0..31.0).contains(&r) => 4000.0,
        _ => 0.0,
    });
    let found = find(&faint).unwrap();
    assert!((found.cylinder.radius - 22.0).abs() < 0.9, "{found:?}");
    assert_eq!(told(&found, "a tube around it").len(), 1, "{found:?}");
}

#[test]
fn an_empty_middle_is_told() {
    for bore in [5.0, 12.0, 21.0, 26.0] {
        let volume = in_air(|p| 2000.0 * edge(28.0 - off(p)) * edge(off(p) - bore));
        let found = find(&volume).unwrap();
        let warnings = told(&found, "is empty, up to a radius of");
        assert_eq!(warnings.len(), 1, "{bore}: {found:?}");
    }
}

/// A sample that is thinner in some slices, or flat at a side, leaves air in an upright cylinder.
#[test]
fn air_at_the_rim_is_told_with_a_cylinder_that_has_none() {
    let narrow = |p: [f64; 3]| if p[2] >= 26.0 { 22.0 } else { 28.0 };
    let neck = |p: [f64; 3]| {
        if (16.0..21.0).contains(&p[2]) {
            20.0
        } else {
            28.0
        }
    };
    let flat = |p: [f64; 3]| if p[0] > 55.0 { 0.0 } else { 28.0 };
    type Radius<'a> = &'a dyn Fn([f64; 3]) -> f64;
    let radii: [(Radius, f64, &str); 3] = [
        (&narrow, 22.0, "to 39 its outermost"),
        (&neck, 20.0, "in slices 1"),
        (&flat, 21.1, "empty at the side of x 6"),
    ];
    for share in [1.0, 0.8] {
        for (radius, least, part) in radii {
            let is_in = |p: [f64; 3]| off(p) <= radius(p) && is_solid(p, share);
            let found = find(&in_air(|p| if is_in(p) { 2000.0 } else { 0.0 })).unwrap();
            let warnings = told(&found, "holds air beside the sample");
            assert_eq!(warnings.len(), 1, "{least} {share}: {found:?}");
            assert!(warnings[0].contains(part), "{share}: {found:?}");
            let text = warnings[0].split("--roi cylinder:").nth(1).unwrap();
            let text = text.split(' ').next().unwrap();
            let inside: f64 = text.split(',').nth(2).unwrap().parse().unwrap();
            assert!(
                inside <= least + 0.3 && inside > least - 5.0,
                "{least}: {found:?}"
            );
        }
    }
}

/// In a cone the cylinder ends inside of the narrow end.
#[test]
fn a_taper_is_told() {
    for [from, to] in [[30.0, 23.0], [26.0, 30.0]] {
        let cone = |p: [f64; 3]| off(p) <= from + (to - from) * p[2] / 39.0;
        let found = find(&in_air(|p| if cone(p) { 2000.0 } else { 0.0 })).unwrap();
        let less = from.min(to) - found.cylinder.radius;
        assert!((0.5..1.6).contains(&less), "{found:?}");
        assert_eq!(found.warnings.len(), 1, "{found:?}");
        assert!(found.warnings[0].contains("is tapered"), "{found:?}");
    }
}

/// A holder as wide as the sample, and as bright as that is on average, has no pores.
#[test]
fn slices_of_something_else_are_told() {
    let volume = in_air(|p| match off(p) > 28.0 {
        true => 0.0,
        false if p[2] < 8.0 => 1200.0,
        false if is_solid(p, 0.6) => 2000.0,
        false => 0.0,
    });
    let found = find(&volume).unwrap();
    let warnings = told(&found, "about slices 0 to");
    assert_eq!(warnings.len(), 1, "{found:?}");
    assert!(
        warnings[0].contains("--crop :,:,8:40") || warnings[0].contains("--crop :,:,9:40"),
        "{found:?}"
    );
}

#[test]
fn a_short_sample_in_a_long_scan_is_found() {
    let dims = [48, 46, 400];
    let volume = |from: f64, to: f64| {
        scan(dims, move |[x, y, z]| {
            let is_in = (from..to).contains(&z) && is_solid([x, y, z], 0.8);
            if is_in {
                round(x, y, [23.0, 22.5, 17.0])
            } else {
                1000.0
            }
        })
    };
    let found = find(&volume(150.0, 172.0)).unwrap();
    assert_near(&found, [23.0, 22.5, 17.0], 0.0);
    assert_eq!(found.slices, 150..172);
    // in none of the slices that are looked at
    let message = find(&volume(150.0, 152.0)).unwrap_err().to_string();
    assert!(
        message.contains("nothing that is brighter") && message.contains("--crop"),
        "{message}"
    );
    // and a dark one
    let dark = scan([64, 60, 12], |[x, y, _]| {
        5000.0 - round(x, y, [30.0, 31.0, 20.0])
    });
    let message = find(&dark).unwrap_err().to_string();
    assert!(message.contains("--invert"), "{message}");
}

#[test]
fn a_foam_whose_rim_is_mostly_open_is_found() {
    let volume = scan([100, 96, 64], |p| {
        let r = libm::hypot(p[0] - 51.0, p[1] - 46.5);
        let pore = libm::sin(p[0] / 2.1 + p[2] / 3.0) * libm::cos(p[1] / 2.3 - p[2] / 4.0)
            + libm::sin(p[2] / 2.0)
            > -0.2;
        if r <= 40.0 && !pore { 3000.0 } else { 1000.0 }
    });
    let found = find(&volume).unwrap();
    assert_near(&found, [51.0, 46.5, 40.5], 0.0);
}
