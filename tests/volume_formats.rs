//! Every format, encoding, type and byte order: what is written is what is read.

mod volume_common;
mod volume_tiff;

use alvis::grid::{Crop, Unit};
use alvis::volume::spool;
use alvis::volume::{Cropped, Dtype, Endian, Io, OpenOptions, Volume, open};
use proptest::prelude::*;
use std::ops::Range;
use volume_common::{FORMS, Sample, all};

fn sample() -> impl Strategy<Value = Sample> {
    let dims = [2u64..8, 2u64..8, 2u64..8];
    (dims, 0usize..8, any::<bool>(), any::<u64>()).prop_map(|(dims, dtype, big, seed)| {
        let dtype = Dtype::ALL[dtype];
        let bytes = dims.iter().product::<u64>() as usize * dtype.bytes();
        let mut state = seed | 1;
        let little = (0..bytes).map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state as u8
        });
        Sample {
            dims,
            dtype,
            endian: if big { Endian::Big } else { Endian::Little },
            little: little.collect(),
        }
    })
}

/// A half-open range inside `n` that may be empty.
fn range(n: u64, [a, b]: [u32; 2]) -> Range<u32> {
    let n = n as u32 + 1;
    (a % n).min(b % n)..(a % n).max(b % n)
}

fn check_boxes(volume: &dyn Volume, sample: &Sample, boxes: &[[[u32; 2]; 3]]) {
    assert_eq!(all(volume).unwrap(), sample.native());
    for ends in boxes {
        let ranges: [Range<u32>; 3] = std::array::from_fn(|a| range(sample.dims[a], ends[a]));
        let expected = sample.cut(ranges.clone());
        let mut out = vec![0xAA; expected.len()];
        let [x, y, z] = ranges;
        volume.prefetch(z.clone());
        volume.read_box(x, y, z.clone(), &mut out).unwrap();
        volume.release(z);
        assert_eq!(out, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn round_trip(sample in sample(), boxes in prop::collection::vec(any::<[[u32; 2]; 3]>(), 6)) {
        for &form in FORMS {
            let dir = tempfile::tempdir().unwrap();
            let path = sample.write(dir.path(), form);
            for io in [Io::Mmap, Io::Read] {
                let options = OpenOptions { io, ..sample.options(form) };
                let opened = open(&path, &options).unwrap_or_else(|e| panic!("{form:?}: {e}"));
                let volume = opened.volume;
                prop_assert_eq!(volume.header().dims.0.map(u64::from), sample.dims);
                prop_assert_eq!(volume.header().dtype, sample.dtype);
                prop_assert_eq!(volume.random_access(), !form.compressed(), "{:?}", form);
                check_boxes(&*volume, &sample, &boxes);
                let header = volume.header().clone();
                let spooled = spool(&*volume, dir.path()).unwrap();
                prop_assert!(spooled.random_access());
                prop_assert_eq!(spooled.header(), &header);
                check_boxes(&*spooled, &sample, &boxes);
            }
        }
    }

    #[test]
    fn crops_are_volumes(sample in sample(), ends in any::<[[u32; 2]; 3]>()) {
        let dir = tempfile::tempdir().unwrap();
        let form = volume_common::Form::Mha;
        let path = sample.write(dir.path(), form);
        let options = OpenOptions { spacing: Some([1.0, 2.0, 3.0]), unit: Some(Unit::Voxel), ..OpenOptions::default() };
        let volume = open(&path, &options).unwrap().volume;
        let [x, y, z] = std::array::from_fn(|a| range(sample.dims[a], ends[a]));
        let fits = [&x, &y, &z].iter().all(|r| r.len() >= 2);
        let expected = sample.cut([x.clone(), y.clone(), z.clone()]);
        let start = [x.start, y.start, z.start].map(f64::from);
        match Cropped::new(volume, &Crop { x, y, z }) {
            Ok(cropped) => {
                prop_assert!(fits);
                prop_assert_eq!(all(&cropped).unwrap(), expected);
                let origin = cropped.header().placement.origin;
                prop_assert_eq!(origin, [start[0], 2.0 * start[1], 3.0 * start[2]]);
                let [nx, _, _] = cropped.header().dims.0;
                prop_assert!(cropped.read_box(0..nx + 1, 0..1, 0..1, &mut [0; 100]).is_err());
            }
            Err(_) => prop_assert!(!fits),
        }
    }
}

#[test]
fn options_must_agree_with_the_header() {
    let sample = Sample {
        dims: [2, 3, 4],
        dtype: Dtype::U16,
        endian: Endian::Big,
        little: vec![7; 48],
    };
    for form in [volume_common::Form::Mha, volume_common::Form::Nrrd] {
        let dir = tempfile::tempdir().unwrap();
        let path = sample.write(dir.path(), form);
        let same = OpenOptions {
            dims: Some([2, 3, 4]),
            dtype: Some(Dtype::U16),
            endian: Some(Endian::Big),
            offset: Some(0),
            ..OpenOptions::default()
        };
        assert_eq!(open(&path, &same).unwrap().offset, 0);
        let others = [
            (
                "--dims",
                OpenOptions {
                    dims: Some([2, 3, 5]),
                    ..same.clone()
                },
                "2 x 3 x 4",
            ),
            (
                "--dtype",
                OpenOptions {
                    dtype: Some(Dtype::I16),
                    ..same.clone()
                },
                "u16",
            ),
            (
                "--endian",
                OpenOptions {
                    endian: Some(Endian::Little),
                    ..same.clone()
                },
                "big",
            ),
            (
                "--offset",
                OpenOptions {
                    offset: Some(4),
                    ..same.clone()
                },
                "header",
            ),
            (
                "--spacing",
                OpenOptions {
                    spacing: Some([0.0, 1.0, 1.0]),
                    ..same.clone()
                },
                "above 0",
            ),
        ];
        for (option, options, stated) in others {
            let error = open(&path, &options).unwrap_err().to_string();
            assert!(error.contains(option) && error.contains(stated), "{error}");
        }
    }
}

#[test]
fn the_size_of_pixels_of_png_is_told_and_not_taken() {
    let dir = tempfile::tempdir().unwrap();
    for k in 0..2 {
        let file = std::fs::File::create(dir.path().join(format!("s{k}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, 2, 2);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_pixel_dims(Some(png::PixelDimensions {
            xppu: 10_000,
            yppu: 5_000,
            unit: png::Unit::Meter,
        }));
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[k; 4]).unwrap();
    }
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(opened.volume.header().placement.spacing, [1.0; 3]);
    assert!(opened.notes[0].contains("0.1000 x 0.2000 mm"), "{opened:?}");
    let options = OpenOptions {
        spacing: Some([0.1, 0.2, 0.3]),
        unit: Some(Unit::Millimetre),
        ..OpenOptions::default()
    };
    assert!(open(dir.path(), &options).unwrap().notes.is_empty());
}
