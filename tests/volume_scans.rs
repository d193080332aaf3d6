//! DICOM, Zarr and HDF5: which part of a file is read, where it lies, what is refused. The files are
//! those of tests/fixtures (make_dicom.py, make_chunked.py).

mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, OpenOptions, Opened, open};
use alvis::{Error, Result};
use std::path::{Path, PathBuf};
use volume_common::{all, tiff_page};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn read(name: &str, options: &OpenOptions) -> Result<Opened> {
    open(&fixture(name), options)
}

fn plain(name: &str) -> Opened {
    read(name, &OpenOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Sample (x, y, z) of the fixtures.
fn sample(x: usize, y: usize, z: usize) -> u16 {
    (x * 7 + y * 13 + z * 29) as u16
}

fn values(opened: &Opened) -> Vec<u16> {
    assert_eq!(opened.volume.header().dtype, Dtype::U16);
    let bytes = all(&*opened.volume).unwrap();
    let words = bytes.as_chunks::<2>().0.iter();
    words.map(|w| u16::from_ne_bytes(*w)).collect()
}

fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
}

#[test]
fn dicom_lies_where_it_says() {
    for name in ["dicom/u16", "dicom/i16_explicit.dcm", "dicom/i16_big.dcm"] {
        let opened = plain(name);
        let header = opened.volume.header();
        let place = header.placement;
        assert_eq!(header.format, "dicom");
        assert!(close(place.spacing, [0.5, 0.25, 2.5]), "{name}: {place:?}");
        assert_eq!(place.unit, Unit::Millimetre);
        // x of the grid is the patient's y, y is z, and the normal is x: not mirrored
        assert!(
            close(place.world([2.0, 4.0, 1.0]), [12.5, 21.0, -29.0]),
            "{name}"
        );
        let [x, y, z] = place.directions.map(glam::DVec3::from);
        assert!((x.cross(y) - z).length() < 1e-9, "{name}");
        assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
        assert!(opened.notes[0].contains("series 7"), "{:?}", opened.notes);
    }
}

#[test]
fn rescaled_values_are_floats_where_they_must() {
    let opened = plain("dicom/slope");
    assert_eq!(opened.volume.header().dtype, Dtype::F32);
    let bytes = all(&*opened.volume).unwrap();
    for (i, bytes) in bytes.as_chunks::<4>().0.iter().enumerate() {
        let stored = f32::from(sample(i % 19, i / 19 % 17, i / 323));
        assert_eq!(f32::from_ne_bytes(*bytes), stored * 0.5 - 3.0);
    }
}

#[test]
fn jpeg_ls_is_what_charls_decodes() {
    for (name, raw) in [("flat_jpegls", "flat_u16"), ("near_jpegls", "near_u16")] {
        let opened = plain(&format!("dicom/{name}.dcm"));
        let expected = std::fs::read(fixture(&format!("dicom/{raw}.raw"))).unwrap();
        let expected = expected.as_chunks::<2>().0.iter();
        let expected: Vec<u16> = expected.map(|w| u16::from_le_bytes(*w)).collect();
        assert_eq!(values(&opened), expected, "{name}");
    }
}

#[test]
fn one_of_several_series_is_chosen() {
    let with = |name: &str| OpenOptions {
        series: Some(name.into()),
        ..OpenOptions::default()
    };
    let error = read("dicom/two", &OpenOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Usage { .. }), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("7: 19 x 17 x 3") && text.contains("8: 19 x 17 x 2"),
        "{text}"
    );
    for (name, dims, first) in [("7", 3, 0), ("8", 2, 1), ("1.2.3.8", 2, 1)] {
        let opened = read("dicom/two", &with(name)).unwrap();
        assert_eq!(opened.volume.header().dims.0, [19, 17, dims]);
        assert_eq!(values(&opened)[0], first);
    }
    for name in ["9", "foam"] {
        assert!(read("dicom/two", &with(name)).is_err(), "{name}");
    }
    let error = read("u16.npy", &with("7")).unwrap_err().to_string();
    assert!(
        error.contains("--series") && error.contains("dicom"),
        "{error}"
    );
}

#[test]
fn uneven_slices_are_interpolated_on_demand() {
    let resample = OpenOptions {
        resample: true,
        ..OpenOptions::default()
    };
    // places 0, 2.5 and 10 mm: a grid of 2.5 mm with two slices between the last ones
    let opened = read("dicom/uneven", &resample).unwrap();
    let header = opened.volume.header();
    assert_eq!(header.dims.0, [19, 17, 5]);
    assert!(close(header.placement.spacing, [0.5, 0.25, 2.5]));
    assert!(opened.notes.iter().any(|n| n.contains("interpolated")));
    let slices = [0.0, 1.0, 4.0 / 3.0, 5.0 / 3.0, 2.0];
    for (i, found) in values(&opened).into_iter().enumerate() {
        let z = slices[i / 323] * 29.0;
        let expected = f64::from(sample(i % 19, i / 19 % 17, 0)) + z;
        assert_eq!(f64::from(found), expected.round(), "{i}");
    }
    // what is regular stays as it is
    let same = read("dicom/u16", &resample).unwrap();
    assert_eq!(values(&same), values(&plain("dicom/u16")));
}

#[test]
fn a_tilt_is_undone() {
    let resample = OpenOptions {
        resample: true,
        ..OpenOptions::default()
    };
    // each slice lies 0.5 mm, 2 pixels, further along y than the one before
    let opened = read("dicom/tilted", &resample).unwrap();
    assert_eq!(opened.volume.header().dims.0, [19, 21, 3]);
    let found = values(&opened);
    for z in 0..3 {
        for y in 0..21usize {
            for x in 0..19 {
                let inside = y.checked_sub(2 * z).filter(|&y| y < 17);
                let expected = inside.map_or(0, |y| sample(x, y, z));
                assert_eq!(found[x + 19 * (y + 21 * z)], expected, "{x} {y} {z}");
            }
        }
    }
}

#[test]
fn dicom_in_folders_of_folders_and_slices_twice() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("DICOM/S1");
    std::fs::create_dir_all(&deep).unwrap();
    for (from, to) in [("I9", "a"), ("I8", "b"), ("I7", "c"), ("I7", "again")] {
        std::fs::copy(fixture(&format!("dicom/u16/{from}")), deep.join(to)).unwrap();
    }
    std::fs::write(dir.path().join("README.TXT"), "of the disc").unwrap();
    let opened = open(dir.path(), &OpenOptions::default()).unwrap();
    assert_eq!(values(&opened), values(&plain("dicom/u16")));
    assert!(
        opened.notes.iter().any(|n| n.contains("twice")),
        "{:?}",
        opened.notes
    );
    // a damaged slice is not passed by
    let bytes = std::fs::read(deep.join("b")).unwrap();
    std::fs::write(deep.join("b"), &bytes[..bytes.len() - 100]).unwrap();
    let error = open(dir.path(), &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("cut short"), "{error}");
    // nor are two at one place
    std::fs::remove_file(deep.join("b")).unwrap();
    let mut other = std::fs::read(fixture("dicom/tilted/I7")).unwrap();
    *other.last_mut().unwrap() ^= 1;
    std::fs::write(deep.join("d"), other).unwrap();
    let error = open(dir.path(), &OpenOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
}

#[test]
fn levels_of_a_pyramid() {
    let level = |n| OpenOptions {
        level: Some(n),
        ..OpenOptions::default()
    };
    let opened = plain("zarr/u16_ome");
    let place = opened.volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([0.5, 0.25, 2.0], Unit::Micrometre)
    );
    assert_eq!(place.origin, [7.0, 6.0, 5.0]);
    assert_eq!(opened.provenance.unit, Origin::File);
    let opened = read("zarr/u16_ome", &level(1)).unwrap();
    let header = opened.volume.header();
    assert_eq!(
        (header.dims.0, header.placement.spacing),
        ([10, 9, 3], [1.0, 0.5, 2.0])
    );
    for (i, v) in values(&opened).into_iter().enumerate() {
        assert_eq!(v, sample(i % 10 * 2, i / 10 % 9 * 2, i / 90));
    }
    for name in ["zarr/u16_ome", "zarr/f32_ome5"] {
        let error = read(name, &level(2)).unwrap_err().to_string();
        assert!(error.contains("--level"), "{error}");
    }
    assert!(read("zarr/u16_plain", &level(0)).is_err());
    let place = plain("zarr/f32_ome5").volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([0.5, 0.25, 2.0], Unit::Micrometre)
    );
}

#[test]
fn one_of_several_arrays_is_chosen() {
    let dataset = |name: &str| OpenOptions {
        dataset: Some(name.into()),
        ..OpenOptions::default()
    };
    for (file, good, says) in [
        ("zarr/no_two", "deep/b", "a, deep/b"),
        ("u8_two.h5", "/a/data", "/b/data: 3 x 17 x 19 of f64"),
        ("u8_two.h5", "b/data", "/a/data"),
    ] {
        let error = read(file, &OpenOptions::default()).unwrap_err();
        assert!(matches!(error, Error::Usage { .. }), "{file}: {error}");
        assert!(error.to_string().contains(says), "{file}: {error}");
        let opened = read(file, &dataset(good)).unwrap();
        assert_eq!(opened.volume.header().dims.0, [19, 17, 3]);
        let error = read(file, &dataset("nothing")).unwrap_err();
        assert!(matches!(error, Error::Usage { .. }), "{file}: {error}");
    }
    assert!(read("zarr/no_two", &dataset("../u16_plain")).is_err());
    let place = plain("u16.h5").volume.header().placement;
    assert_eq!(
        (place.spacing, place.unit),
        ([0.5, 0.25, 2.0], Unit::Micrometre)
    );
}

#[test]
fn chunks_that_are_not_there_have_the_fill_value() {
    let dir = tempfile::tempdir().unwrap();
    let array = dir.path().join("v.zarr");
    std::fs::create_dir(&array).unwrap();
    for name in [".zarray", "0.0.0", "1.1.1"] {
        let from = fixture("zarr/u16_plain").join(name);
        let mut bytes = std::fs::read(from).unwrap();
        if name == ".zarray" {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains("\"fill_value\": 0"));
            bytes = text
                .replace("\"fill_value\": 0", "\"fill_value\": 77")
                .into_bytes();
        }
        std::fs::write(array.join(name), bytes).unwrap();
    }
    let opened = open(&array, &OpenOptions::default()).unwrap();
    for (i, v) in values(&opened).into_iter().enumerate() {
        let (x, y, z) = (i % 19, i / 19 % 17, i / 323);
        let there = [x / 10, y / 9, z / 2].iter().sum::<usize>() % 3 == 0;
        assert_eq!(v, if there { sample(x, y, z) } else { 77 }, "{x} {y} {z}");
    }
}

/// Damages of metadata and chunks: an error or samples, never a panic or a giant allocation.
#[test]
fn damaged_zarrs_do_no_harm() {
    let mut seed = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = move || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed as usize
    };
    for name in [
        "u16_blosclz",
        "f32_blosc_zstd_bits",
        "i8_lz4",
        "u8_3_shards",
        "i16_3_transposed_be",
        "u16_delta_zstd",
        "f32_3_scaled",
        "u16_ome",
        "xarray_2",
    ] {
        let mut files = Vec::new();
        let mut folders = vec![fixture("zarr").join(name)];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false => files.push((path.clone(), std::fs::read(path).unwrap())),
                }
            }
        }
        let dir = tempfile::tempdir().unwrap();
        let root = fixture("zarr").join(name);
        let place = |path: &Path| dir.path().join(path.strip_prefix(&root).unwrap());
        for (path, bytes) in &files {
            std::fs::create_dir_all(place(path).parent().unwrap()).unwrap();
            std::fs::write(place(path), bytes).unwrap();
        }
        let attempt = || -> Result<()> {
            let volume = open(dir.path(), &OpenOptions::default())?.volume;
            if volume.header().dims.voxels() <= 1 << 20 {
                all(&*volume)?;
            }
            Ok(())
        };
        attempt().unwrap();
        for (path, bytes) in &files {
            for round in 0..25 {
                let mut bytes = bytes.clone();
                if round % 4 == 0 {
                    bytes.truncate(random() % bytes.len());
                } else {
                    let at = random() % bytes.len();
                    bytes[at] ^= 1 << (random() % 8);
                }
                std::fs::write(place(path), bytes).unwrap();
                let _ = attempt();
            }
            std::fs::write(place(path), bytes).unwrap();
        }
        attempt().unwrap();
    }
}

#[test]
fn a_name_with_a_number_stands_for_slices() {
    let opened = plain("png16/s%d.png");
    assert_eq!(values(&opened), values(&plain("png16")));
    assert!(read("png16/s%04d.png", &OpenOptions::default()).is_err());
    let dir = tempfile::tempdir().unwrap();
    for (name, byte) in [("a_00.raw", 1), ("a_01.raw", 2), ("b_00.raw", 3)] {
        std::fs::write(dir.path().join(name), [byte; 6]).unwrap();
    }
    let options = OpenOptions {
        dims: Some([3, 2, 2]),
        dtype: Some(Dtype::U8),
        ..OpenOptions::default()
    };
    let opened = open(&dir.path().join("a_%02d.raw"), &options).unwrap();
    assert_eq!(
        all(&*opened.volume).unwrap(),
        [1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2]
    );
}

/// A stack of pages of TIFF of which the last is something else.
#[cfg(unix)]
fn stack_with(last: impl FnOnce(&Path)) -> Result<Opened> {
    let dir = tempfile::tempdir().unwrap();
    for k in 0..3 {
        std::fs::write(dir.path().join(format!("s{k}.tif")), tiff_page([k; 6])).unwrap();
    }
    last(&dir.path().join("s3.tif"));
    open(dir.path(), &OpenOptions::default())
}

#[cfg(unix)]
#[test]
fn a_slice_of_a_stack_that_is_no_file_is_named() {
    assert_eq!(
        stack_with(|_| {}).unwrap().volume.header().dims.0,
        [3, 2, 3]
    );
    let pipe = |path: &Path| {
        let made = std::process::Command::new("mkfifo").arg(path).status();
        assert!(made.unwrap().success());
    };
    type Damage<'a> = (&'a str, &'a dyn Fn(&Path));
    let cases: [Damage; 4] = [
        ("leads nowhere", &|path| {
            std::os::unix::fs::symlink("nowhere", path).unwrap();
        }),
        ("a folder", &|path| std::fs::create_dir(path).unwrap()),
        ("a pipe", &pipe),
        ("an empty file", &|path| std::fs::write(path, b"").unwrap()),
    ];
    for (what, last) in cases {
        let error = stack_with(last).unwrap_err().to_string();
        assert!(error.contains("s3.tif") && error.contains(what), "{error}");
    }
}
