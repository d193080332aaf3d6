//! Small files by other writers (the scripts in tests/fixtures: tifffile, nibabel, numpy, VTK, Pillow,
//! pydicom, imagecodecs, zarr, h5py, mrcfile), whole and damaged.

mod volume_common;

use alvis::grid::{Origin, Unit};
use alvis::volume::{Dtype, Io, OpenOptions, Opened, open};
use alvis::{Error, Result};
use std::path::{Path, PathBuf};
use volume_common::all;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn read(name: &str) -> Result<Opened> {
    open(&fixture(name), &OpenOptions::default())
}

/// The samples that make.py writes, in the machine's byte order.
fn expected(dtype: Dtype) -> Vec<u8> {
    let mut out = Vec::new();
    for z in 0..3i32 {
        for y in 0..17 {
            for x in 0..19 {
                let v = x * 7 + y * 13 + z * 29;
                match dtype {
                    Dtype::U8 => out.push(v as u8),
                    Dtype::I8 => out.push((v - 100) as u8),
                    Dtype::U16 => out.extend((v as u16).to_ne_bytes()),
                    Dtype::I16 => out.extend(((v - 100) as i16).to_ne_bytes()),
                    Dtype::U32 => out.extend((v as u32).to_ne_bytes()),
                    Dtype::I32 => out.extend((v - 100).to_ne_bytes()),
                    Dtype::F32 => out.extend((v as f32 + 0.5).to_ne_bytes()),
                    Dtype::F64 => out.extend((f64::from(v) + 0.5).to_ne_bytes()),
                }
            }
        }
    }
    out
}

const WHOLE: &[(&str, Dtype)] = &[
    ("u8.tif", Dtype::U8),
    ("i8_packbits.tif", Dtype::I8),
    ("u16_be_strips.tif", Dtype::U16),
    ("i16_lzw_pred_be.tif", Dtype::I16),
    ("u16_lzw.tif", Dtype::U16),
    ("u32_deflate_pred.tif", Dtype::U32),
    ("i32_big_tiles.tif", Dtype::I32),
    ("f32_pred3_be_tiles.tif", Dtype::F32),
    ("f32_pred3.tif", Dtype::F32),
    ("f64_deflate_big_be.tif", Dtype::F64),
    ("f64_pred3.tif", Dtype::F64),
    ("u8_white_is_zero.tif", Dtype::U8),
    ("u16_cm.tif", Dtype::U16),
    ("imagej.tif", Dtype::U16),
    ("imagej_one_ifd.tif", Dtype::F32),
    ("u16.npy", Dtype::U16),
    ("i16_be.npy", Dtype::I16),
    ("f64.npy", Dtype::F64),
    ("fortran.npy", Dtype::U16),
    ("f16_be.npy", Dtype::F32),
    ("stored.npz", Dtype::I32),
    ("packed.npz", Dtype::F32),
    ("i16.nii", Dtype::I16),
    ("u16_be.nii.gz", Dtype::U16),
    ("f64_2.nii", Dtype::F64),
    ("f32_2.nii.gz", Dtype::F32),
    ("u8_pair.hdr", Dtype::U8),
    ("png8", Dtype::U8),
    ("png16", Dtype::U16),
    ("png16.zip", Dtype::U16),
    ("tiff.zip", Dtype::U16),
    ("u16.vti", Dtype::U16),
    ("f32_zlib.vti", Dtype::F32),
    ("i8_zlib64.vti", Dtype::I8),
    ("u8_base64.vti", Dtype::U8),
    ("i16_base64_zlib.vti", Dtype::I16),
    ("f32_inline.vti", Dtype::F32),
    ("u16_inline_lz4.vti", Dtype::U16),
    ("u8_ascii.vti", Dtype::U8),
    ("f64_ascii.vti", Dtype::F64),
    ("u8_lz4.vti", Dtype::U8),
    ("u8_zstd.tif", Dtype::U8),
    ("u16_zstd_pred.tif", Dtype::U16),
    ("f16.tif", Dtype::F32),
    ("f16_pred3.tif", Dtype::F32),
    ("dicom/i16_explicit.dcm", Dtype::I16),
    ("dicom/i16_implicit.dcm", Dtype::I16),
    ("dicom/i16_deflated.dcm", Dtype::I16),
    ("dicom/i16_big.dcm", Dtype::I16),
    ("dicom/i16_rle.dcm", Dtype::I16),
    ("dicom/u8_rle.dcm", Dtype::U8),
    ("dicom/i16_jpeg.dcm", Dtype::I16),
    ("dicom/u16_jpegls.dcm", Dtype::U16),
    ("dicom/u8_jpegls.dcm", Dtype::U8),
    ("dicom/i16_jpeg2000.dcm", Dtype::I16),
    ("dicom/i16_jpeg2000_signed.dcm", Dtype::I16),
    ("dicom/u16", Dtype::U16),
    ("zarr/u16_blosclz", Dtype::U16),
    ("zarr/i16_be_blosc_lz4", Dtype::I16),
    ("zarr/f32_blosc_zstd_bits", Dtype::F32),
    ("zarr/f64_blosc_zlib", Dtype::F64),
    ("zarr/u8_blosc_blocks", Dtype::U8),
    ("zarr/u32_zlib", Dtype::U32),
    ("zarr/i32_zstd_be", Dtype::I32),
    ("zarr/i8_lz4", Dtype::I8),
    ("zarr/u16_plain", Dtype::U16),
    ("zarr/u16_gzip_shuffle", Dtype::U16),
    ("zarr/u16_shuffle_zstd", Dtype::U16),
    ("zarr/u16_delta_zstd", Dtype::U16),
    ("zarr/i16_be_delta", Dtype::I16),
    ("zarr/f32_scaled", Dtype::F32),
    ("zarr/f64_as_f32", Dtype::F64),
    ("zarr/f32_rounded", Dtype::F32),
    ("zarr/f32_3_scaled", Dtype::F32),
    ("zarr/u16_3_delta", Dtype::U16),
    ("zarr/u16_3_gzip", Dtype::U16),
    ("zarr/f32_3_blosc", Dtype::F32),
    ("zarr/i16_3_transposed_be", Dtype::I16),
    ("zarr/u8_3_shards", Dtype::U8),
    ("zarr/f64_3_shards_start", Dtype::F64),
    ("zarr/f16_3", Dtype::F32),
    ("zarr/u16_ome", Dtype::U16),
    ("zarr/f32_ome5", Dtype::F32),
    ("u16.h5", Dtype::U16),
    ("f32_gzip.h5", Dtype::F32),
    ("i16_be.h5", Dtype::I16),
    ("u8_lzf.h5", Dtype::U8),
    ("u16_blosc.h5", Dtype::U16),
    ("f32_bitshuffle.h5", Dtype::F32),
    ("i16_bitshuffle.h5", Dtype::I16),
    ("u32_bitshuffle.h5", Dtype::U32),
    ("i32_zstd.h5", Dtype::I32),
    ("f64_lz4.h5", Dtype::F64),
    ("scanners/bmp", Dtype::U8),
    ("scanners/vg.vgi", Dtype::U16),
    ("scanners/nikon.xtekct", Dtype::F32),
    ("scanners/esrf.vol.info", Dtype::F32),
    ("scanners/ge.pcr", Dtype::U16),
    ("scanners/i16.isq", Dtype::I16),
    ("scanners/u16.mrc", Dtype::U16),
    ("scanners/i8.mrc", Dtype::I8),
    ("scanners/f16.mrc", Dtype::F32),
    ("scanners/i16_zyx_be.mrc", Dtype::I16),
    ("scanners/i16.hdr", Dtype::I16),
    ("scanners/u16.am", Dtype::U16),
    ("scanners/u8_rle.am", Dtype::U8),
    ("scanners/f32_zip_be.am", Dtype::F32),
    ("scanners/i8.aim", Dtype::I8),
    ("scanners/u16_v030.aim", Dtype::U16),
];

/// Files beside fixtures that hold their samples.
const SAMPLES: &[(&str, &str)] = &[
    ("u8_pair.hdr", "u8_pair.img"),
    ("scanners/vg.vgi", "scanners/vg.vol"),
    ("scanners/nikon.xtekct", "scanners/nikon.vol"),
    ("scanners/esrf.vol.info", "scanners/esrf.vol"),
    ("scanners/ge.pcr", "scanners/ge.vol"),
    ("scanners/i16.hdr", "scanners/i16.img"),
];

/// Copies the samples of a fixture to where the copy of the fixture looks for them.
fn copy_samples(name: &str, file: &Path) {
    let Some((_, samples)) = SAMPLES.iter().find(|(header, _)| *header == name) else {
        return;
    };
    let to = match name.ends_with(".vgi") {
        true => file.with_file_name("vg.vol"),
        false if name.ends_with(".info") => file.with_extension(""),
        false => file.with_extension(Path::new(samples).extension().unwrap()),
    };
    std::fs::copy(fixture(samples), to).unwrap();
}

#[test]
fn samples_are_those_that_were_written() {
    for &(name, dtype) in WHOLE {
        for io in [Io::Mmap, Io::Read] {
            let options = OpenOptions {
                io,
                ..OpenOptions::default()
            };
            let opened = open(&fixture(name), &options).unwrap_or_else(|e| panic!("{name}: {e}"));
            let header = opened.volume.header();
            assert_eq!(
                (header.dims.0, header.dtype),
                ([19, 17, 3], dtype),
                "{name}"
            );
            let whole = expected(dtype);
            assert!(all(&*opened.volume).unwrap() == whole, "{name}");
            let n = dtype.bytes();
            let mut out = vec![0; 11 * 9 * 2 * n];
            opened
                .volume
                .read_box(6..17, 5..14, 1..3, &mut out)
                .unwrap();
            for (i, row) in out.chunks(11 * n).enumerate() {
                let at = ((i / 9 + 1) * 17 * 19 + (i % 9 + 5) * 19 + 6) * n;
                assert!(row == &whole[at..at + 11 * n], "{name} row {i}");
            }
        }
    }
}

#[test]
fn places_are_those_that_were_written() {
    for name in ["imagej.tif", "imagej_one_ifd.tif"] {
        let opened = read(name).unwrap();
        let place = opened.volume.header().placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.5, 0.25, 2.5], Unit::Micrometre)
        );
        assert_eq!(opened.provenance.spacing, [Origin::File; 3]);
    }
    let place = read("u16_cm.tif").unwrap().volume.header().placement;
    assert_eq!((place.spacing, place.unit), ([0.0025; 3], Unit::Millimetre));
    let opened = read("u16.vti").unwrap();
    let place = opened.volume.header().placement;
    assert_eq!((place.spacing, place.unit), ([0.5, 0.25, 2.0], Unit::Voxel));
    assert_eq!(place.origin, [10.0, 20.0, -30.0]);
    assert_eq!(opened.provenance.unit, Origin::Default);
    for name in ["i16.nii", "f64_2.nii", "u16_be.nii.gz", "u8_pair.hdr"] {
        let opened = read(name).unwrap();
        let place = opened.volume.header().placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.5, 0.25, 2.0], Unit::Millimetre),
            "{name}"
        );
        assert_eq!(place.origin, [10.0, 20.0, -30.0]);
        assert_eq!(place.world([2.0, 4.0, 1.0]), [9.0, 21.0, -28.0], "{name}");
        assert_eq!(opened.provenance.unit, Origin::File);
    }
}

#[test]
fn slope_and_intercept_give_values() {
    let opened = read("i16_slope.nii").unwrap();
    assert_eq!(opened.volume.header().dtype, Dtype::F32);
    let values = all(&*opened.volume).unwrap();
    let stored = expected(Dtype::I16);
    for (value, stored) in values.chunks(4).zip(stored.chunks(2)) {
        let value = f32::from_ne_bytes(value.try_into().unwrap());
        let stored = i16::from_ne_bytes(stored.try_into().unwrap());
        assert_eq!(value, f32::from(stored) * 0.5 - 3.0);
    }
}

#[test]
fn what_is_not_read_is_named() {
    for (name, says) in [
        ("no_rgb.tif", "RGB"),
        ("no_fortran.npz", "Fortran"),
        ("no_two.npz", "2 arrays"),
        ("no_shear.nii", "sheared"),
        ("no_lzma.vti", "LZMA"),
        ("dicom/no_ht.dcm", "High-Throughput JPEG 2000"),
        ("dicom/uneven", "2.500 mm"),
        ("dicom/tilted", "11.3 degrees"),
        ("zarr/no_bz2", "bz2"),
        ("zarr/no_i64", "int64"),
        ("no_zfp.h5", "ZFP"),
        ("no_virtual.h5", "virtual"),
        ("png8/s8.png", "PNG"),
    ] {
        let error = read(name).unwrap_err();
        assert!(
            matches!(error, Error::Unsupported { .. }),
            "{name}: {error}"
        );
        assert!(error.to_string().contains(says), "{name}: {error}");
    }
}

#[test]
fn channels_are_asked_for() {
    let error = read("no_channels.tif").unwrap_err();
    assert!(matches!(error, Error::Usage { .. }), "{error}");
    assert!(error.to_string().contains("2 channels"), "{error}");
    for (channel, fits) in [(0, true), (1, true), (2, false)] {
        let options = OpenOptions {
            channel: Some(channel),
            ..OpenOptions::default()
        };
        let opened = open(&fixture("no_channels.tif"), &options);
        assert_eq!(opened.is_ok(), fits, "{channel}");
    }
}

#[test]
fn folders_without_a_slice_or_with_a_damaged_one_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let copy = |from: &str, to: &str| {
        std::fs::copy(fixture(from), dir.path().join(to)).unwrap();
    };
    let try_open = || open(dir.path(), &OpenOptions::default());
    assert!(try_open().is_err());
    for (from, to) in [("s8", "a9"), ("s9", "a10"), ("s10", "a11")] {
        copy(&format!("png16/{from}.png"), &format!("{to}.png"));
    }
    std::fs::write(dir.path().join("notes.txt"), "of the scan").unwrap();
    assert!(all(&*try_open().unwrap().volume).unwrap() == expected(Dtype::U16));
    std::fs::remove_file(dir.path().join("a10.png")).unwrap();
    copy("png16/s10.png", "a12.png");
    let error = try_open().unwrap_err().to_string();
    assert!(
        error.contains("a12.png after a11.png") || error.contains("a11.png after"),
        "{error}"
    );
    std::fs::write(dir.path().join("a10.png"), "").unwrap();
    assert!(try_open().unwrap_err().to_string().contains("a10.png"));
    copy("png8/s8.png", "a10.png");
    assert!(
        try_open()
            .unwrap_err()
            .to_string()
            .contains("as the first slice")
    );
}

#[test]
fn raw_slices_in_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let samples = expected(Dtype::U16);
    for (k, slice) in samples.chunks(19 * 17 * 2).enumerate() {
        std::fs::write(dir.path().join(format!("s.{}", k + 9)), slice).unwrap();
    }
    std::fs::write(dir.path().join("read.me"), "x").unwrap();
    let options = |nz| OpenOptions {
        dims: Some([19, 17, nz]),
        dtype: Some(Dtype::U16),
        ..OpenOptions::default()
    };
    let volume = open(dir.path(), &options(3)).unwrap().volume;
    if cfg!(target_endian = "little") {
        assert!(all(&*volume).unwrap() == samples);
    }
    assert!(open(dir.path(), &options(4)).is_err());
}

/// Damages of every fixture: no panic, no giant allocation, and an error or some samples.
#[test]
fn damaged_files_do_no_harm() {
    let mut seed = 0x2545_f491_4f6c_dd1du64;
    let mut random = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed as usize
    };
    let dir = tempfile::tempdir().unwrap();
    let names = WHOLE.iter().map(|(name, _)| *name);
    for name in names.chain(["i16_slope.nii"]) {
        if fixture(name).is_dir() {
            continue;
        }
        let bytes = std::fs::read(fixture(name)).unwrap();
        let file = dir.path().join(name.replace('/', "_"));
        copy_samples(name, &file);
        let try_read = |bytes: &[u8]| -> Result<()> {
            std::fs::write(&file, bytes).unwrap();
            let volume = open(&file, &OpenOptions::default())?.volume;
            let voxels = volume.header().dims.voxels();
            assert!(
                voxels <= 1 << 36,
                "{name}: {voxels} voxels of {} bytes",
                bytes.len()
            );
            if voxels <= 1 << 20 {
                all(&*volume)?;
            }
            Ok(())
        };
        try_read(&bytes).unwrap();
        for _ in 0..15 {
            let _ = try_read(&bytes[..random() % bytes.len()]);
        }
        assert!(try_read(&bytes[..bytes.len() / 2]).is_err(), "{name}");
        for round in 0..60 {
            let mut bytes = bytes.clone();
            // headers are at the front, and of TIFF also between the pages
            let reach = if round % 2 == 0 {
                bytes.len()
            } else {
                bytes.len().min(400)
            };
            for _ in 0..1 + round % 3 {
                let at = random() % reach;
                bytes[at] ^= 1 << (random() % 8);
            }
            let _ = try_read(&bytes);
        }
        let noise: Vec<u8> = (0..300).map(|_| random() as u8).collect();
        for keep in [2, 4, 8, 16] {
            let head = &bytes[..keep];
            let _ = try_read(&[head, &noise[..]].concat());
        }
    }
}
