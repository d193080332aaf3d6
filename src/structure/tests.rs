//! The structure that tiles tell, against the voxels themselves.

use super::*;
use crate::convert::{ConvertOptions, RegionOfInterest, convert};
use crate::grid::{Ambiguous, Cylinder, Dims, Fill, Placement, Region, Shape, Unit};
use crate::manifest::{Layout, Primitives};
use crate::phantom::{Phantom, render};
use crate::progress::Quiet;
use crate::split::NeckRule;
use crate::volume::{Dtype, MemoryVolume, RegionVoxels};
use proptest::prelude::*;

const EVERYTHING: Wanted = Wanted {
    outside: Outside::None,
    porosity: true,
    slice: Some(1),
};

/// Converts a volume and measures its structure.
fn measured(
    volume: &MemoryVolume<u8>,
    options: &ConvertOptions,
    wanted: &Wanted,
) -> (Structure, TileSet, tempfile::TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("set");
    convert(volume, options, &out, &Quiet).unwrap();
    let set = TileSet::open(&out).unwrap();
    let found = structure(&set, wanted, &Quiet).unwrap();
    (found, set, dir)
}

/// Pores of slices across an axis, from the samples.
fn by_slice(volume: &MemoryVolume<u8>, dims: [u32; 3], axis: usize, threshold: u8) -> Vec<u64> {
    let mut counts = vec![0; dims[axis] as usize];
    for (i, &v) in volume.samples().iter().enumerate() {
        let [x, y] = [dims[0] as usize, dims[1] as usize];
        let at = [i % x, i / x % y, i / (x * y)];
        counts[at[axis]] += u64::from(v < threshold);
    }
    counts
}

fn check_slices(found: &Structure, volume: &MemoryVolume<u8>, dims: [u32; 3]) {
    let profile = found.profile.as_ref().unwrap();
    for (axis, of_axis) in [&profile.x, &profile.y, &profile.z].into_iter().enumerate() {
        assert_eq!(of_axis.pores, by_slice(volume, dims, axis, 128), "{axis}");
        let in_slice = Dims(dims).voxels() / u64::from(dims[axis]);
        assert!(of_axis.voxels.iter().all(|&n| n == in_slice));
    }
    let slice = found.slice.as_ref().unwrap();
    for y in 0..dims[1] {
        for x in 0..dims[0] {
            let sample = volume.samples()[Dims(dims).linear([x, y, 1]) as usize];
            assert_eq!(slice.above([x, y]), sample >= 128, "{x} {y}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    /// Random voxels, of any share of air, whatever the rule, the tiles and their form: slices, boxes and the bits of a
    /// slice are those of the volume.
    #[test]
    fn slices_are_those_of_the_volume(
        dims in prop::array::uniform3(2u32..7),
        samples in prop::collection::vec(0u8..=255, 216),
        share in 0u8..=255,
        macrocube in 1u32..5,
        form in 0usize..8,
        mirrored in any::<bool>(),
    ) {
        let dims_of = Dims(dims);
        let samples: Vec<u8> = samples[..dims_of.voxels() as usize]
            .iter()
            .map(|&v| if v < share { v / 2 } else { 128 + v / 2 })
            .collect();
        let mut place = Placement::default();
        if mirrored {
            place.directions[1] = [0.0, -1.0, 0.0];
        }
        let volume = MemoryVolume::new(dims_of, place, samples).unwrap();
        let mut options = ConvertOptions {
            threshold: 128.0,
            macrocube: [macrocube, 5 - macrocube, macrocube],
            ..ConvertOptions::default()
        };
        if form & 1 == 1 {
            options.ambiguous = Ambiguous::Join;
        }
        if form & 2 == 2 {
            options.primitives = Primitives::Triangles;
            options.layout = Layout::Merged;
        }
        options.cap = form & 4 == 4;
        let (found, _, _dir) = measured(&volume, &options, &EVERYTHING);
        check_slices(&found, &volume, dims);
        let pores = volume.samples().iter().filter(|v| **v < 128).count() as f64;
        let largest = found.boxes.last().unwrap();
        if dims[0] == dims[1] && dims[1] == dims[2] {
            prop_assert_eq!(largest.boxes, 1);
            prop_assert!((largest.centred - pores / dims_of.voxels() as f64).abs() < 1e-12);
        }
        let single = &found.boxes[0];
        prop_assert_eq!((single.boxes, single.voxels), (dims_of.voxels(), 1.0));
        prop_assert!((single.mean - pores / dims_of.voxels() as f64).abs() < 1e-12);
    }
}

/// A foam of unequal sides, with its samples.
fn foam(dims: [u32; 3]) -> MemoryVolume<u8> {
    let phantom = Phantom::default();
    let made = render(&phantom, Dims(dims), Dtype::U8).unwrap();
    let mut samples = vec![0u8; Dims(dims).voxels() as usize];
    let [x, y, z] = dims.map(|n| 0..n);
    crate::volume::Volume::read_box(&made, x, y, z, &mut samples).unwrap();
    let place = Placement {
        spacing: [0.5, 0.5, 0.25],
        unit: Unit::Millimetre,
        ..Placement::default()
    };
    MemoryVolume::new(Dims(dims), place, samples).unwrap()
}

/// Boxes of every width, by counting voxels.
#[test]
fn boxes_are_those_of_the_volume() {
    let dims = [70, 50, 90];
    let volume = foam(dims);
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [32; 3],
        ..ConvertOptions::default()
    };
    let (found, _, _dir) = measured(&volume, &options, &EVERYTHING);
    check_slices(&found, &volume, dims);
    // the shortest side is z, 22.5 mm long: blocks of 0.703 mm
    let blocks = blocks::Blocks::new(dims, [0.5, 0.5, 0.25]);
    assert_eq!(blocks.counts(), [50, 36, 32]);
    let slow = |start: [usize; 3], width: usize| {
        let ends: [[u32; 2]; 3] =
            std::array::from_fn(|a| [blocks.start(a, start[a]), blocks.start(a, start[a] + width)]);
        let (mut pores, mut all) = (0u64, 0u64);
        for z in ends[2][0]..ends[2][1] {
            for y in ends[1][0]..ends[1][1] {
                for x in ends[0][0]..ends[0][1] {
                    all += 1;
                    pores +=
                        u64::from(volume.samples()[Dims(dims).linear([x, y, z]) as usize] < 128);
                }
            }
        }
        pores as f64 / all as f64
    };
    let widths: Vec<usize> = vec![1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
    assert_eq!(found.boxes.len(), widths.len());
    for (of_width, &width) in found.boxes.iter().zip(&widths) {
        let counts = blocks.counts();
        let middle = counts.map(|n| (n - width) / 2);
        assert!((of_width.centred - slow(middle, width)).abs() < 1e-12);
        if width < 6 {
            continue;
        }
        let fit = counts.map(|n| n / width);
        let mut shares = Vec::new();
        for z in 0..fit[2] {
            for y in 0..fit[1] {
                for x in 0..fit[0] {
                    let at = [x, y, z];
                    let start =
                        std::array::from_fn(|a| (counts[a] - fit[a] * width) / 2 + at[a] * width);
                    shares.push(slow(start, width));
                }
            }
        }
        let n = shares.len() as f64;
        let mean = shares.iter().sum::<f64>() / n;
        assert_eq!(of_width.boxes, shares.len() as u64);
        assert!((of_width.mean - mean).abs() < 1e-12);
        let square: f64 = shares.iter().map(|p| (p - mean) * (p - mean)).sum();
        let sd = (n > 1.0).then(|| (square / (n - 1.0)).sqrt());
        match (of_width.sd, sd) {
            (Some(a), Some(b)) => assert!((a - b).abs() < 1e-12),
            (a, b) => assert_eq!(a, b),
        }
    }
}

/// In a cylinder, air outside of it does not count, whatever it is filled with, and boxes lie in it.
#[test]
fn a_cylinder_counts_what_is_inside() {
    let dims = [40, 44, 20];
    let volume = foam(dims);
    let cylinder = Cylinder {
        centre: [19.0, 22.5],
        radius: 15.5,
    };
    let inside = |i: usize| cylinder.holds((i % 40) as u32, (i / 40 % 44) as u32);
    for (fill, value) in [(Fill::Material, 255u8), (Fill::Air, 0)] {
        let mut samples = volume.samples().to_vec();
        for (i, v) in samples.iter_mut().enumerate() {
            *v = if inside(i) { *v } else { value };
        }
        let place = crate::volume::Volume::header(&volume).placement;
        let filled = MemoryVolume::new(Dims(dims), place, samples).unwrap();
        let region = Region {
            shape: Shape::Cylinder(cylinder),
            fill,
            fill_value: f64::from(value),
            voxels: (0..filled.samples().len()).filter(|&i| inside(i)).count() as u64,
        };
        let options = ConvertOptions {
            threshold: 128.0,
            region: Some(RegionOfInterest {
                stated: region,
                voxels: RegionVoxels::cylinder(&cylinder, Dims(dims)).unwrap(),
            }),
            ..ConvertOptions::default()
        };
        let (found, _, _dir) = measured(&filled, &options, &EVERYTHING);
        let profile = found.profile.unwrap();
        let mut pores = vec![0; 20];
        for (i, &v) in volume.samples().iter().enumerate() {
            pores[i / (40 * 44)] += u64::from(inside(i) && v < 128);
        }
        assert_eq!(profile.z.pores, pores);
        let in_slice = (0..40 * 44).filter(|&i| inside(i)).count() as u64;
        assert!(profile.z.voxels.iter().all(|&n| n == in_slice));
        assert_eq!(
            profile.x.pores.iter().sum::<u64>(),
            pores.iter().sum::<u64>()
        );
        assert_eq!(profile.y.voxels.iter().sum::<u64>(), in_slice * 20);
        assert!(found.boxes.last().unwrap().voxels < 22.0 * 22.0 * 20.0);
        assert!(!found.boxes.is_empty());
        assert_eq!(found.surface_of, SurfaceOf::WholeCells);
    }
}

/// The square of the distance from the middle of 30 voxels.
fn square(v: u32) -> f64 {
    let away = f64::from(v) - 14.5;
    away * away
}

/// A ball in air that fills the corners: what is left out of the profile is the outer air.
#[test]
fn air_around_a_sample_is_left_out_of_slices() {
    let dims = [30, 30, 30];
    let samples = |[x, y, z]: [u32; 3]| {
        let r = [x, y, z].map(square).iter().sum::<f64>().sqrt();
        if (5.5..13.0).contains(&r) { 255u8 } else { 0 }
    };
    let all = (0..27_000u32).map(|i| samples([i % 30, i / 30 % 30, i / 900]));
    let volume = MemoryVolume::new(Dims(dims), Placement::default(), all.collect()).unwrap();
    let options = ConvertOptions {
        threshold: 128.0,
        macrocube: [9; 3],
        ..ConvertOptions::default()
    };
    let wanted = Wanted {
        outside: Outside::BorderCell,
        ..EVERYTHING
    };
    let (found, _, _dir) = measured(&volume, &options, &wanted);
    let profile = found.profile.unwrap();
    for z in 0..30u32 {
        let (mut pores, mut all) = (0, 0);
        for i in 0..900 {
            let at = [i % 30, i / 30, z].map(square);
            let r = at.iter().sum::<f64>().sqrt();
            all += u64::from(r < 13.0);
            pores += u64::from(r < 5.5);
        }
        assert_eq!(profile.z.voxels[z as usize], all, "{z}");
        assert_eq!(profile.z.pores[z as usize], pores, "{z}");
        assert_eq!(profile.z.porosity[z as usize].is_none(), all == 0);
    }
    assert!(found.boxes.is_empty() && !found.notes.is_empty());
    assert_eq!(found.surface_of, SurfaceOf::CellsWithoutOutside);
    // the inner ball alone, though on voxels of two values
    let lines = found.mean_intercept_length.unwrap();
    assert!(
        (lines.degree_of_anisotropy.unwrap() - 1.0).abs() < 0.02,
        "{lines:?}"
    );
}

/// The air around a sample may be open to a cell that was cut from it: no tile tells where it ends, so slices have no
/// porosity, and the voxels of one are told all the same. One that is open to nothing is left out as ever.
#[test]
fn air_that_is_open_to_a_cell_is_told() {
    for leaks in [true, false] {
        let samples = (0..27_000u32).map(|i| {
            let at = [i % 30, i / 30 % 30, i / 900];
            let away = at.map(|v| square(v).sqrt());
            let farthest = away.into_iter().fold(0.0, f64::max);
            let in_hole = leaks && at[0] > 14 && away[1] < 1.0 && away[2] < 1.0;
            match (4.0..6.5).contains(&farthest) && !in_hole {
                true => 255u8,
                false => 0,
            }
        });
        let volume = MemoryVolume::new(Dims([30; 3]), Placement::default(), samples.collect());
        let options = ConvertOptions {
            threshold: 128.0,
            macrocube: [9; 3],
            split: Some(NeckRule {
                ratio_permille: 700,
                ..NeckRule::default()
            }),
            ..ConvertOptions::default()
        };
        let wanted = Wanted {
            outside: Outside::BorderCell,
            ..EVERYTHING
        };
        let volume = volume.unwrap();
        let (found, set, _dir) = measured(&volume, &options, &wanted);
        assert_eq!(set.manifest().totals.cells, 2);
        assert_eq!(found.profile.is_none(), leaks);
        let told = found.notes.iter().any(|n| n.contains("is open to cell 2"));
        assert_eq!(told, leaks, "{:?}", found.notes);
        assert!(found.fabric.is_some() && found.slice.is_some());
        let (all, ..) = measured(&volume, &options, &EVERYTHING);
        check_slices(&all, &volume, [30; 3]);
    }
}

/// What is left out as dust is filled in the tiles as well.
#[test]
fn dust_is_filled() {
    let samples = (0..8000u64).map(|i| {
        let h = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (h >> 56) as u8
    });
    let volume = MemoryVolume::new(Dims([20; 3]), Placement::default(), samples.collect()).unwrap();
    let options = ConvertOptions {
        threshold: 210.0,
        macrocube: [7; 3],
        min_voxels: 4,
        ..ConvertOptions::default()
    };
    let (found, set, _dir) = measured(&volume, &options, &EVERYTHING);
    let totals = set.manifest().totals;
    assert!(set.manifest().dust.unwrap().objects > 10);
    let profile = found.profile.unwrap();
    for axis in [&profile.x, &profile.y, &profile.z] {
        assert_eq!(axis.pores.iter().sum::<u64>(), 8000 - totals.voxels_above);
    }
}

/// A part of a set has no porosity, and says so.
#[test]
fn a_part_tells_no_porosity() {
    let volume = foam([40, 40, 40]);
    let options = ConvertOptions {
        threshold: 128.0,
        ..ConvertOptions::default()
    };
    let (_, set, dir) = measured(&volume, &options, &Wanted::default());
    let part = dir.path().join("part");
    let choice = crate::transform::select::SelectOptions {
        chosen: crate::table::Chosen {
            condition: Some("not touches_border".into()),
            ..Default::default()
        },
        ..Default::default()
    };
    crate::transform::select::select(set.dir(), &part, &choice, &Quiet).unwrap();
    let found = structure(&TileSet::open(&part).unwrap(), &EVERYTHING, &Quiet).unwrap();
    assert_eq!(found.profile, None);
    assert!(found.notes[0].contains("part"), "{:?}", found.notes);
    assert!(found.fabric.is_some());
}
