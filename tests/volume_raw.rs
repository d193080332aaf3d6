//! Headerless raw files: round trips, wrong sizes, offsets.

use alvis::Error;
use alvis::volume::{Dtype, Endian, Io, OpenOptions, open};

fn options(dims: [u64; 3], dtype: Dtype) -> OpenOptions {
    OpenOptions {
        dims: Some(dims),
        dtype: Some(dtype),
        ..OpenOptions::default()
    }
}

#[test]
fn raw_needs_exact_bytes_unless_an_offset_is_given() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    let bytes: Vec<u8> = (0..30).collect();
    std::fs::write(&path, &bytes).unwrap();

    let error = open(&path, &options([3, 3, 3], Dtype::U8))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("30 bytes, 3 more") && error.contains("--offset 3"),
        "{error}"
    );
    let error = open(&path, &options([4, 3, 3], Dtype::U8))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("30 bytes") && error.contains("36 bytes"),
        "{error}"
    );

    for io in [Io::Mmap, Io::Read] {
        for offset in [0, 1, 3] {
            let opened = open(
                &path,
                &OpenOptions {
                    offset: Some(offset),
                    io,
                    ..options([3, 3, 3], Dtype::U8)
                },
            )
            .unwrap();
            let mut out = vec![0; 27];
            opened.volume.read_box(0..3, 0..3, 0..3, &mut out).unwrap();
            assert_eq!(out, bytes[offset as usize..][..27]);
            assert_eq!(opened.offset, offset);
            assert_eq!(opened.name, "v.raw");
        }
    }
    let far = OpenOptions {
        offset: Some(u64::MAX),
        ..options([3, 3, 3], Dtype::U8)
    };
    assert!(matches!(open(&path, &far), Err(Error::Format { .. })));
}

#[test]
fn raw_says_which_option_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    std::fs::write(&path, [0; 8]).unwrap();
    let error = open(&path, &OpenOptions::default()).unwrap_err();
    assert!(
        matches!(&error, Error::Usage { option, .. } if option == "--dims and --dtype"),
        "{error}"
    );
    let error = open(
        &path,
        &OpenOptions {
            dims: Some([2, 2, 2]),
            ..OpenOptions::default()
        },
    )
    .unwrap_err();
    assert!(
        matches!(&error, Error::Usage { option, .. } if option == "--dtype"),
        "{error}"
    );
    let huge = options([u64::MAX, u64::MAX, 2], Dtype::F64);
    assert!(matches!(open(&path, &huge), Err(Error::Usage { .. })));
    assert!(open(dir.path(), &huge).is_err());
}

#[test]
fn samples_come_in_the_machines_order() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    let values: Vec<u16> = (0..8).map(|v| v * 259).collect();
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
    std::fs::write(&path, bytes).unwrap();
    let opened = open(
        &path,
        &OpenOptions {
            endian: Some(Endian::Big),
            ..options([2, 2, 2], Dtype::U16)
        },
    )
    .unwrap();
    let mut out = [0; 4];
    opened.volume.read_box(1..2, 0..2, 1..2, &mut out).unwrap();
    let expected: Vec<u8> = [values[5], values[7]]
        .iter()
        .flat_map(|v| v.to_ne_bytes())
        .collect();
    assert_eq!(&out[..], &expected);
    assert!(
        opened
            .volume
            .read_box(0..3, 0..1, 0..1, &mut [0; 6])
            .is_err()
    );
    assert!(
        opened
            .volume
            .read_box(0..1, 0..1, 0..1, &mut [0; 4])
            .is_err()
    );
}

#[test]
fn a_file_that_shrinks_is_an_error_for_positioned_reads() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    std::fs::write(&path, [1; 27]).unwrap();
    let opened = open(
        &path,
        &OpenOptions {
            io: Io::Read,
            ..options([3, 3, 3], Dtype::U8)
        },
    )
    .unwrap();
    std::fs::write(&path, [1; 20]).unwrap();
    let read = |z| opened.volume.read_box(0..3, 0..3, z, &mut [0; 9]);
    assert!(read(0..1).is_ok());
    assert!(matches!(read(2..3), Err(Error::Format { .. })));
}
