//! Damaged files: an error or equal samples, never a panic, a hang or a giant allocation.

mod volume_common;

use alvis::grid::Dims;
use alvis::volume::{Dtype, Endian, OpenOptions, open};
use alvis::{Error, Result};
use proptest::prelude::*;
use std::path::Path;
use volume_common::{FORMS, Form, Sample, all, gzip, zlib};

fn small() -> Sample {
    Sample {
        dims: [3, 4, 2],
        dtype: Dtype::U16,
        endian: Endian::Big,
        little: (0..48).collect(),
    }
}

/// Reads a file that may be damaged, if it still claims a size that is fit for a test.
fn try_read(path: &Path, options: &OpenOptions) -> Result<Vec<u8>> {
    let volume = open(path, options)?.volume;
    assert!(
        volume.header().dims.voxels() <= 1 << 20,
        "no file here can hold that"
    );
    all(&*volume)
}

#[test]
fn truncation_at_every_byte() {
    let sample = small();
    for &form in FORMS {
        let dir = tempfile::tempdir().unwrap();
        let path = sample.write(dir.path(), form);
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        for len in (0..file.metadata().unwrap().len()).rev() {
            file.set_len(len).unwrap();
            match try_read(&path, &sample.options(form)) {
                // the cut took a line end or the padding of gzip, or the detached header's tail
                Ok(samples) => assert_eq!(samples, sample.native(), "{form:?} {len}"),
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
    }
}

#[test]
fn truncated_data_files() {
    let sample = small();
    for &form in FORMS {
        let dir = tempfile::tempdir().unwrap();
        let head = sample.write(dir.path(), form);
        for file in std::fs::read_dir(dir.path()).unwrap() {
            let path = file.unwrap().path();
            let bytes = std::fs::read(&path).unwrap();
            // a byte skip of -2 counts from the end, which a cut moves
            if path == head || matches!(form, Form::MhdEnd | Form::NhdrEnd | Form::MhdSkip) {
                continue;
            }
            let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            for len in (0..bytes.len()).rev() {
                file.set_len(len as u64).unwrap();
                assert!(
                    try_read(&head, &sample.options(form)).is_err(),
                    "{form:?} {len}"
                );
            }
            std::fs::write(&path, &bytes).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn flipped_bytes(form in 0..FORMS.len(), flips in prop::collection::vec((any::<usize>(), any::<u8>()), 1..4)) {
        let (sample, form) = (small(), FORMS[form]);
        let dir = tempfile::tempdir().unwrap();
        let path = sample.write(dir.path(), form);
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in flips {
            let at = at % bytes.len();
            bytes[at] ^= value;
        }
        std::fs::write(&path, &bytes).unwrap();
        // no claim on the samples: headers and raw samples have no checksum
        let _ = try_read(&path, &sample.options(form));
    }

    #[test]
    fn headers_of_noise(text in "(NRRD000[1-6]|NDims = 3)\n([ -~]{0,40}\n){0,8}") {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("v");
        std::fs::write(&path, text).unwrap();
        prop_assert!(try_read(&path, &OpenOptions::default()).is_err());
    }
}

#[test]
fn claims_beyond_the_file_are_refused_before_memory_is_taken() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v");
    for encoding in ["raw", "gzip"] {
        let head = format!(
            "NRRD0004\ntype: double\ndimension: 3\nsizes: 65536 65536 65536\nendian: little\nencoding: {encoding}\n\n"
        );
        std::fs::write(&path, [head.as_bytes(), &gzip(&[0; 100])].concat()).unwrap();
        let error = open(&path, &OpenOptions::default()).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{error}");
    }
    let head =
        "NDims = 3\nDimSize = 65536 65536 65536\nElementType = MET_DOUBLE\nElementDataFile = s%d\n";
    std::fs::write(&path, head).unwrap();
    assert!(open(&path, &OpenOptions::default()).is_err());
    let head = "NRRD0004\ntype: double\ndimension: 3\nsizes: 65536 65536 65536\nendian: little\n\
                encoding: raw\ndata file: s.%d 1 4294967296 1 1\n";
    std::fs::write(&path, head).unwrap();
    let error = open(&path, &OpenOptions::default()).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
    let long = vec![b'#'; 20 << 20];
    std::fs::write(&path, [b"NRRD0004\n", &long[..]].concat()).unwrap();
    let error = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("header of more than"), "{error}");
}

#[test]
fn streams_of_a_wrong_length_say_both_lengths() {
    let sample = small();
    let data = sample.stored();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw.gz");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        try_read(&path, &sample.options(Form::RawGz))
    };
    let error = read(&gzip(&data[..40])).unwrap_err().to_string();
    assert!(
        error.contains("after 40 bytes") && error.contains("48 bytes"),
        "{error}"
    );
    let error = read(&gzip(&[&data[..], &[1]].concat()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("more than 48 bytes"), "{error}");
    let mut checksum = gzip(&data);
    let at = checksum.len() - 6;
    checksum[at] ^= 1;
    assert!(read(&checksum).is_err(), "the checksum is compared");
    assert!(read(&[gzip(&data), b"garbage".to_vec()].concat()).is_err());
    assert_eq!(
        read(&[gzip(&data), vec![0; 9]].concat()).unwrap(),
        sample.native()
    );

    let path = dir.path().join("v.mha");
    let head = "NDims = 3\nDimSize = 3 4 2\nElementType = MET_USHORT\nBinaryDataByteOrderMSB = True\nCompressedData = True\nElementDataFile = LOCAL\n";
    let mut packed = zlib(&data);
    let at = packed.len() - 1;
    packed[at] ^= 1;
    std::fs::write(&path, [head.as_bytes(), &packed].concat()).unwrap();
    assert!(
        try_read(&path, &OpenOptions::default()).is_err(),
        "the checksum is compared"
    );
}

/// The file is removed once its stream is open: every restart would fail.
#[test]
#[cfg(target_os = "linux")]
fn a_sweep_that_steps_back_does_not_restart() {
    let sample = Sample {
        dims: [512, 512, 100],
        dtype: Dtype::U8,
        endian: Endian::Little,
        little: (0..512 * 512 * 100u32).map(|i| (i >> 12) as u8).collect(),
    };
    let dir = tempfile::tempdir().unwrap();
    let path = sample.write(dir.path(), Form::NrrdGz);
    let volume = open(&path, &OpenOptions::default()).unwrap().volume;
    assert_eq!(volume.header().dims, Dims([512, 512, 100]));
    assert!(volume.held_bytes() <= 17 << 20);
    let read = |y: std::ops::Range<u32>, z: std::ops::Range<u32>| {
        let expected = sample.cut([0..512, y.clone(), z.clone()]);
        let mut out = vec![0; expected.len()];
        volume.read_box(0..512, y, z, &mut out)?;
        assert!(out == expected);
        Ok::<(), Error>(())
    };
    read(0..1, 0..1).unwrap();
    std::fs::remove_file(&path).unwrap();
    for slab in (0..100u32).step_by(10) {
        for band in [0..200, 200..512] {
            read(band, slab.saturating_sub(3)..slab + 10).unwrap();
        }
    }
    assert!(
        read(0..512, 0..1).is_err(),
        "the window has long left slice 0"
    );
    assert!(read(0..512, 99..100).is_err(), "what broke stays broken");
}
