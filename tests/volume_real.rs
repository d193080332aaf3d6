//! Real files: the samples are those that SimpleITK 2 (of headsq, lobster and the foam: numpy) reads,
//! the thresholds those of scikit-image 0.26, the placements those of SimpleITK. scikit-image sums
//! in single precision, which moves snow's threshold to 22775; 22779 is that of double precision.

mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::progress::Quiet;
use alvis::volume::{Dtype, Io, OpenOptions, Opened, open};
use alvis::volume::{predict, statistics};
use volume_common::data;

struct Known {
    path: &'static str,
    dims: [u32; 3],
    dtype: Dtype,
    range: [f64; 2],
    crc: u32,
    /// scikit-image's threshold: the upper class is above it.
    otsu: f64,
    above: u64,
}

const fn known(
    path: &'static str,
    (dims, dtype, range): ([u32; 3], Dtype, [f64; 2]),
    crc: u32,
    (otsu, above): (f64, u64),
) -> Known {
    Known {
        path,
        dims,
        dtype,
        range,
        crc,
        otsu,
        above,
    }
}

#[rustfmt::skip]
const FILES: &[Known] = &[
    known("raw/lobster_301x324x56_uint8.raw", ([301, 324, 56], Dtype::U8, [0.0, 255.0]), 0xc72c991e, (60.0, 201_874)),
    known("phantom/foam_closed_200x200x200_uint8.raw.gz", ([200, 200, 200], Dtype::U8, [40.0, 222.0]), 0x61b97556, (129.0, 3_765_933)),
    known("raw_slices/headsq/quarter.nhdr", ([64, 64, 93], Dtype::I16, [0.0, 3926.0]), 0xee2af088, (648.0, 141_707)),
    known("nrrd/tooth.nhdr", ([103, 94, 161], Dtype::U16, [0.0, 1300.0]), 0x9411034e, (654.0, 380_960)),
    known("derived/snow_be.nhdr", ([100, 100, 100], Dtype::U16, [6237.0, 40_103.0]), 0xca083f05, (22_779.0, 591_256)),
    known("metaimage/LIDC2.mha", ([256, 256, 133], Dtype::U8, [0.0, 255.0]), 0xfdf4efd0, (59.0, 335_013)),
    known("metaimage/HeadMRVolume.mhd", ([48, 62, 42], Dtype::U8, [0.0, 255.0]), 0x4502dfca, (41.0, 31_497)),
    known("metaimage/fuel.mha", ([68, 68, 68], Dtype::U8, [0.0, 255.0]), 0x69faa3ed, (61.0, 2_859)),
    known("metaimage/marschnerlobb.mha", ([43, 43, 43], Dtype::U8, [0.0, 255.0]), 0x8d7bc241, (115.0, 36_948)),
    known("metaimage/hydrogenAtom.mha", ([128, 128, 128], Dtype::U8, [0.0, 250.0]), 0x8f5b5595, (15.0, 119_011)),
    known("nrrd/brain1_image.nrrd", ([256, 256, 25], Dtype::I16, [0.0, 3057.0]), 0x2dba4966, (394.0, 797_690)),
    known("nrrd/avf_float_32.nrrd", ([74, 93, 20], Dtype::F32, [0.0, 2_509.887]), 0x817784e5, (740.2206, 6_263)),
];

fn open_known(file: &Known, io: Io) -> Option<Opened> {
    let path = data()?.join(file.path);
    let raw = file.path.starts_with("raw/") || file.path.starts_with("phantom/");
    let options = OpenOptions {
        dims: raw.then_some(file.dims.map(u64::from)),
        dtype: raw.then_some(file.dtype),
        io,
        ..OpenOptions::default()
    };
    Some(open(&path, &options).unwrap_or_else(|e| panic!("{e}")))
}

#[test]
fn samples_are_those_of_other_readers() {
    for file in FILES {
        for io in [Io::Mmap, Io::Read] {
            let Some(opened) = open_known(file, io) else {
                return;
            };
            let header = opened.volume.header();
            assert_eq!(
                (header.dims.0, header.dtype),
                (file.dims, file.dtype),
                "{}",
                file.path
            );
            let bytes = volume_common::all(&*opened.volume).unwrap();
            if cfg!(target_endian = "little") {
                assert_eq!(crc32fast::hash(&bytes), file.crc, "{}", file.path);
            }
        }
    }
}

#[test]
fn thresholds_are_those_of_scikit_image() {
    for file in FILES {
        let Some(opened) = open_known(file, Io::Mmap) else {
            return;
        };
        let stats = statistics(&*opened.volume, None, &Quiet).unwrap();
        let [min, max] = stats.range.unwrap();
        assert!((min - file.range[0]).abs() < 1e-3 && (max - file.range[1]).abs() < 1e-3);
        let otsu = stats.otsu.unwrap();
        let prediction = predict(&*opened.volume, otsu, u32::MAX, &Quiet).unwrap();
        if file.dtype.is_float() {
            // scikit-image has 256 bins, this library 65,536
            let bin = (max - min) / 256.0;
            assert!((otsu - file.otsu).abs() <= bin, "{}: {otsu}", file.path);
        } else {
            // the same two classes
            assert!(otsu > file.otsu, "{}: {otsu}", file.path);
            assert_eq!(stats.voxels_above(otsu), file.above, "{}", file.path);
            assert_eq!(prediction.voxels_above, file.above, "{}", file.path);
        }
        let sampled = predict(&*opened.volume, otsu, 32, &Quiet).unwrap();
        let ratio = sampled.vertices as f64 / prediction.vertices as f64;
        assert!((0.9..1.1).contains(&ratio), "{}: {ratio}", file.path);
    }
}

fn near(a: &[f64], b: &[f64]) {
    assert!(
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9),
        "{a:?} {b:?}"
    );
}

#[test]
fn placements_are_those_of_itk() {
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let spacing_only = |s: [f64; 3]| (s, [0.0; 3], identity);
    let cases = [
        (
            "metaimage/LIDC2.mha",
            (
                [1.40625, 1.40625, 2.5],
                [0.0, 360.0, 332.5],
                [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0],
            ),
            (Unit::Millimetre, Origin::Default),
        ),
        (
            "nrrd/brain1_image.nrrd",
            (
                [0.78125, 0.78125, 6.5],
                [-99.609375, 99.609375, -78.0],
                [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
            ),
            (Unit::Millimetre, Origin::Default),
        ),
        (
            "nrrd/avf_float_32.nrrd",
            (
                [0.722_656_011_581_420_9, 0.722_656_011_581_420_9, 1.0],
                [26.376_944_422_721_863, 33.242_176_532_745_36, -9.5],
                [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0],
            ),
            (Unit::Millimetre, Origin::Default),
        ),
        (
            "raw_slices/headsq/quarter.nhdr",
            spacing_only([3.2, 3.2, 1.5]),
            (Unit::Voxel, Origin::Default),
        ),
        (
            "metaimage/HeadMRVolume.mhd",
            spacing_only([4.0; 3]),
            (Unit::Millimetre, Origin::Default),
        ),
    ];
    for (name, (spacing, origin, directions), (unit, unit_from)) in cases {
        let Some(dir) = data() else {
            return;
        };
        let opened = open(&dir.join(name), &OpenOptions::default()).unwrap();
        let placement = opened.volume.header().placement;
        near(&placement.spacing, &spacing);
        near(&placement.origin, &origin);
        near(placement.directions.as_flattened(), &directions);
        assert_eq!(
            (placement.unit, opened.provenance.unit),
            (unit, unit_from),
            "{name}"
        );
        assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
        let options = OpenOptions {
            spacing: Some([1.0, 2.0, 3.0]),
            unit: Some(Unit::Micrometre),
            ..OpenOptions::default()
        };
        let opened = open(&dir.join(name), &options).unwrap();
        let placement = opened.volume.header().placement;
        assert_eq!(
            (placement.spacing, placement.unit),
            ([1.0, 2.0, 3.0], Unit::Micrometre)
        );
        assert_eq!(opened.provenance.spacing, [Origin::Option; 3]);
        // the origin goes with the unit
        let um = unit.metres() / Unit::Micrometre.metres();
        let moved = origin.map(|v| if unit == Unit::Voxel { v } else { v * um });
        near(&placement.origin, &moved);
    }
}
