use crate::error::Result;
use crate::grid::{Origin, Unit};
use crate::volume::{Dtype, Endian, OpenOptions, Opened, open};

/// What a header has, and its bytes.
#[derive(Clone)]
struct Made {
    big: bool,
    words: Vec<(usize, [u8; 4])>,
    stamp: [u8; 8],
}

/// Words of a header that are whole numbers, by their places.
fn whole(at: usize, values: &[i32]) -> Vec<(usize, [u8; 4])> {
    let words = values.iter().enumerate();
    words.map(|(i, v)| (at + 4 * i, v.to_le_bytes())).collect()
}

fn reals(at: usize, values: &[f32]) -> Vec<(usize, [u8; 4])> {
    let words = values.iter().enumerate();
    words.map(|(i, v)| (at + 4 * i, v.to_le_bytes())).collect()
}

impl Made {
    /// 4 columns, 3 rows and 2 sections of a mode, with voxels of 1 x 1 x 5 angstrom.
    fn new(mode: i32) -> Made {
        let words = [
            whole(0, &[4, 3, 2, mode, 0, 0, 0, 4, 3, 2]),
            reals(40, &[4.0, 3.0, 10.0, 90.0, 90.0, 90.0]),
            whole(64, &[1, 2, 3]),
            whole(88, &[1, 0]),
            whole(108, &[20140]),
        ];
        Made {
            big: false,
            words: words.concat(),
            stamp: *b"MAP \x44\x44\0\0",
        }
    }

    fn with(mut self, words: Vec<(usize, [u8; 4])>) -> Made {
        self.words.extend(words);
        self
    }

    fn bytes(&self, extended: usize, samples: &[u8]) -> Vec<u8> {
        let mut out = vec![0; 1024 + extended];
        for (at, word) in &self.words {
            let mut word = *word;
            if self.big {
                word.reverse();
            }
            out[*at..at + 4].copy_from_slice(&word);
        }
        out[208..216].copy_from_slice(&self.stamp);
        [&out[..], samples].concat()
    }

    fn opened(&self, samples: &[u8]) -> Result<Opened> {
        opened("v.mrc", &self.bytes(0, samples), false)
    }
}

fn opened(name: &str, bytes: &[u8], resample: bool) -> Result<Opened> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let options = OpenOptions {
        resample,
        ..OpenOptions::default()
    };
    open(&path, &options)
}

fn all(opened: &Opened) -> Vec<u8> {
    let header = opened.volume.header();
    let [nx, ny, nz] = header.dims.0;
    let mut out = vec![0; header.dims.voxels() as usize * header.dtype.bytes()];
    opened
        .volume
        .read_box(0..nx, 0..ny, 0..nz, &mut out)
        .unwrap();
    out
}

fn counts(big: bool) -> Vec<u8> {
    let order = |v: i16| {
        if big {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    (0..24).flat_map(|v| order(v * 300 - 7)).collect()
}

#[test]
fn both_byte_orders_and_extended_headers() {
    let expected: Vec<u8> = (0..24i16)
        .flat_map(|v| (v * 300 - 7).to_ne_bytes())
        .collect();
    let big = Made {
        big: true,
        stamp: *b"MAP \x11\x11\0\0",
        ..Made::new(1)
    };
    let none = |made: Made| Made {
        stamp: *b"MAP \0\0\0\0",
        ..made
    };
    for (made, endian) in [
        (Made::new(1), Endian::Little),
        (big.clone(), Endian::Big),
        (none(Made::new(1)), Endian::Little),
        (none(big), Endian::Big),
    ] {
        let long = made.clone().with(whole(92, &[160]));
        let bytes = long.bytes(160, &counts(endian == Endian::Big));
        let opened = opened("any.name", &bytes, false).unwrap();
        let header = opened.volume.header();
        assert_eq!(
            (header.dims.0, header.dtype, header.endian),
            ([4, 3, 2], Dtype::I16, endian)
        );
        let place = header.placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([0.1, 0.1, 0.5], Unit::Nanometre)
        );
        assert_eq!(all(&opened), expected);
    }
}

#[test]
fn old_headers_have_no_mark() {
    let old = Made {
        stamp: [0; 8],
        ..Made::new(1)
            .with(whole(64, &[0, 0, 0]))
            .with(whole(108, &[0]))
    };
    let bytes = old.bytes(0, &counts(false));
    for name in ["v.mrc", "v.REC", "v.map"] {
        assert_eq!(
            opened(name, &bytes, false).unwrap().volume.header().format,
            "mrc"
        );
    }
    // with another length, or under another name, it may be anything
    let long = [&bytes[..], &[0]].concat();
    assert!(opened("v.rec", &long, false).is_err() && opened("v.raw", &bytes, false).is_err());
}

#[test]
fn axes_are_sorted() {
    // columns are z, rows x, sections y
    let turned = Made::new(1)
        .with(whole(64, &[3, 1, 2]))
        .with(whole(16, &[7, 8, 9]))
        .with(whole(28, &[3, 2, 4]))
        .with(reals(40, &[3.0, 4.0, 20.0]));
    let opened = turned.opened(&counts(false)).unwrap();
    let header = opened.volume.header();
    assert_eq!(header.dims.0, [3, 2, 4]);
    assert_eq!(header.placement.spacing, [0.1, 0.2, 0.5]);
    assert_eq!(header.placement.origin, [0.8, 1.8, 3.5]);
    let values: Vec<i16> = bytemuck::pod_collect_to_vec(&all(&opened));
    let stored = |[x, y, z]: [i16; 3]| (z + 4 * (x + 3 * y)) * 300 - 7;
    let expected = (0..24).map(|i| stored([i % 3, i / 3 % 2, i / 6]));
    assert!(expected.eq(values), "{header:?}");
}

#[test]
fn bytes_are_signed_where_the_file_says_so() {
    let old = |range: [f32; 2]| Made::new(0).with(whole(108, &[0])).with(reals(76, &range));
    let imod = |flags: i32| {
        let stamp = i32::from_le_bytes(*b"IMOD");
        Made::new(0)
            .with(whole(152, &[stamp, flags]))
            .with(reals(76, &[0.0, 255.0]))
    };
    for (made, dtype, told) in [
        (Made::new(0), Dtype::I8, false),
        (old([0.0, 255.0]), Dtype::U8, true),
        (old([-3.0, 90.0]), Dtype::I8, true),
        (old([0.0, 0.0]), Dtype::I8, true),
        (imod(0), Dtype::U8, false),
        (imod(1), Dtype::I8, false),
    ] {
        let opened = made.opened(&[200; 24]).unwrap();
        assert_eq!(opened.volume.header().dtype, dtype);
        assert_eq!(
            opened.notes.iter().any(|n| n.contains("bytes are read as")),
            told
        );
    }
    for range in [[0.0, 255.0], [-5.0, 255.0]] {
        let made = Made::new(0).with(reals(76, &range));
        let said = made.opened(&[200; 24]).unwrap_err().to_string();
        assert!(
            said.contains("--dims 4,3,2 --dtype u8 --offset 1024"),
            "{said}"
        );
    }
}

#[test]
fn the_other_modes() {
    let halves: Vec<u8> = (0..24)
        .flat_map(|v| half::f16::from_f32(v as f32 / 4.0).to_le_bytes())
        .collect();
    let opened = Made::new(12).opened(&halves).unwrap();
    let values: Vec<f32> = bytemuck::pod_collect_to_vec(&all(&opened));
    assert!(values.into_iter().eq((0..24).map(|v| v as f32 / 4.0)));
    for (mode, bytes, dtype) in [(2, 96, Dtype::F32), (6, 48, Dtype::U16)] {
        let opened = Made::new(mode).opened(&vec![0; bytes]).unwrap();
        assert_eq!(opened.volume.header().dtype, dtype);
    }
    for (mode, says) in [(4, "complex"), (16, "colours"), (101, "4-bit")] {
        let said = Made::new(mode).opened(&[0; 400]).unwrap_err().to_string();
        assert!(
            said.contains(says) && said.contains("not supported"),
            "{said}"
        );
    }
}

#[test]
fn what_contradicts_itself_is_refused() {
    let made = |words| Made::new(1).with(words);
    let stamped = Made {
        stamp: *b"MAP \x11\x11\0\0",
        ..Made::new(1)
    };
    for (made, says) in [
        (made(whole(92, &[-4])), "extended header of -4 bytes"),
        (
            made(whole(88, &[401, 0])).with(whole(36, &[1])),
            "a stack of volumes",
        ),
        (
            made(reals(52, &[10.0, 90.0, 170.0])),
            "angles 10, 90 and 170",
        ),
        (stamped, "little-endian, in which sizes and mode make sense"),
        (Made::new(2), "48 bytes"),
        (made(whole(0, &[1, 3, 2])), "1 x 3 x 2"),
    ] {
        let found = made.opened(&counts(false));
        let said = found.unwrap_err().to_string();
        let says = if says == "48 bytes" {
            "1072 bytes"
        } else {
            says
        };
        assert!(said.contains(says), "{says}: {said}");
    }
}

#[test]
fn cells_origins_and_stacks() {
    let at = |words| Made::new(1).with(words).opened(&counts(false)).unwrap();
    let place = |opened: Opened| opened.volume.header().placement;
    assert_eq!(
        place(at(reals(196, &[10.0, -20.0, 30.0]))).origin,
        [1.0, -2.0, 3.0]
    );
    assert_eq!(place(at(whole(16, &[2, 0, -1]))).origin, [0.2, 0.0, -0.5]);
    let imod = |flags: i32| {
        let stamp = i32::from_le_bytes(*b"IMOD");
        place(at([
            whole(152, &[stamp, flags]),
            reals(196, &[10.0, -20.0, 30.0]),
        ]
        .concat()))
        .origin
    };
    assert_eq!((imod(0), imod(4)), ([-1.0, 2.0, -3.0], [1.0, -2.0, 3.0]));
    // a tilt series
    let series = at([whole(88, &[0]), whole(36, &[1])].concat());
    assert_eq!(series.provenance.spacing[2], Origin::Assumed);
    assert!(
        series.warnings[0].contains("stack of pictures"),
        "{:?}",
        series.warnings
    );
    let none = at(reals(40, &[0.0, 0.0, 0.0]));
    assert_eq!(none.provenance.spacing, [Origin::Default; 3]);
    // axes that are not at right angles
    let leaning = Made::new(1)
        .with(reals(52, &[90.0, 90.0, 60.0]))
        .bytes(0, &counts(false));
    let said = opened("v.mrc", &leaning, false).unwrap_err().to_string();
    assert!(
        said.contains("--resample") && said.contains("0.5"),
        "{said}"
    );
    assert!(opened("v.mrc", &leaning, true).is_ok());
}
