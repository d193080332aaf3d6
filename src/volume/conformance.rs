//! What every volume does, whatever its format and whatever wraps it: one suite for all of them.

mod files;

use super::adapters::mirror::Mirrored;
use super::adapters::permute::{Permuted, stored_dims};
use super::adapters::resample::{Grid, Resampled};
use super::adapters::values::Valued;
use super::adapters::values::Values;
use super::io::decoded_once::Unpacked;
use super::io::paged::tests::counting;
use super::registry::FORMATS;
use super::{
    Cropped, Dtype, Io, Medianed, MemoryVolume, OpenOptions, Smoothed, Volume, Watch, Watched,
    open, spool,
};
use crate::error::Error;
use crate::grid::{Crop, Dims, Filter, Placement, filtered_dims, filtered_dtype};
use files::{FIXTURES, made};
use proptest::prelude::*;
use std::ops::Range;
use std::path::Path;

type Box3 = [Range<u32>; 3];

/// Boxes in an order that looks random; some are empty.
struct Boxes {
    dims: [u32; 3],
    state: u64,
}

impl Boxes {
    fn new(dims: [u32; 3], seed: u64) -> Self {
        let state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        Boxes { dims, state }
    }

    fn number(&mut self, below: u32) -> u32 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        ((self.state >> 32) % u64::from(below)) as u32
    }
}

impl Iterator for Boxes {
    type Item = Box3;

    fn next(&mut self) -> Option<Box3> {
        Some(self.dims.map(|n| {
            let [a, b] = [self.number(n + 1), self.number(n + 1)];
            // whole axes are read in other ways than parts of them
            match self.number(4) {
                0 => 0..n,
                _ => a.min(b)..a.max(b),
            }
        }))
    }
}

fn read(volume: &dyn Volume, [x, y, z]: &Box3, bytes: usize) -> crate::error::Result<Vec<u8>> {
    let mut out = vec![0xAA; bytes];
    volume.read_box(x.clone(), y.clone(), z.clone(), &mut out)?;
    Ok(out)
}

fn voxels(asked: &Box3) -> usize {
    asked.iter().map(|r| r.len()).product()
}

/// A box out of all samples.
fn cut(known: &[u8], dims: [u32; 3], sample: usize, [x, y, z]: &Box3) -> Vec<u8> {
    let mut out = Vec::new();
    for k in z.clone() {
        for j in y.clone() {
            let row = (k as usize * dims[1] as usize + j as usize) * dims[0] as usize;
            let [from, to] = [x.start, x.end].map(|i| (row + i as usize) * sample);
            out.extend_from_slice(&known[from..to]);
        }
    }
    out
}

/// Checks that any box of a volume, read by whomever in whatever order, is that of its samples, and that no other is
/// handed out.
fn conforms_to(volume: &dyn Volume, known: &[u8], name: &str) {
    let header = volume.header().clone();
    let (dims, sample) = (header.dims.0, header.dtype.bytes());
    let whole = dims.map(|n| 0..n);
    assert_eq!(known.len(), voxels(&whole) * sample, "{name}");
    assert_eq!(read(volume, &whole, known.len()).unwrap(), known, "{name}");
    let check = |asked: &Box3| {
        let expected = cut(known, dims, sample, asked);
        let found = read(volume, asked, expected.len());
        let found = found.unwrap_or_else(|e| panic!("{name}, {asked:?}: {e}"));
        assert!(found == expected, "{name}, {asked:?}");
    };
    check(&dims.map(|n| n - 1..n));
    check(&dims.map(|_| 0..0));
    for asked in Boxes::new(dims, 1).take(32) {
        let [_, _, z] = asked.clone();
        volume.prefetch(z.clone());
        check(&asked);
        volume.release(z);
    }
    std::thread::scope(|scope| {
        for seed in 2..5 {
            scope.spawn(move || {
                Boxes::new(dims, seed)
                    .take(12)
                    .for_each(|asked| check(&asked))
            });
        }
    });
    refuses(volume, name);
    assert!(volume.grain().iter().all(|&n| n > 0), "{name}");
    assert_eq!(*volume.header(), header, "{name}");
}

/// Checks that boxes outside, boxes that end before they begin and buffers of another size are refused.
fn refuses(volume: &dyn Volume, name: &str) {
    let dims = volume.header().dims.0;
    let sample = volume.header().dtype.bytes();
    let whole = dims.map(|n| 0..n);
    let mut wrong = vec![
        (whole.clone(), voxels(&whole) * sample - 1),
        (whole.clone(), voxels(&whole) * sample + sample),
        (whole.clone(), 0),
        ([0..0, 0..0, 0..0], 1),
    ];
    for axis in 0..3 {
        let end = dims[axis];
        for range in [
            0..end + 1,
            end..end + 1,
            end + 1..end + 1,
            Range { start: 1, end: 0 },
            0..u32::MAX,
        ] {
            let mut asked = [0..1, 0..1, 0..1];
            asked[axis] = range;
            let bytes = voxels(&asked).min(1 << 16) * sample;
            wrong.push((asked, bytes));
        }
    }
    for (asked, bytes) in wrong {
        let error = read(volume, &asked, bytes).unwrap_err();
        assert!(
            matches!(error, Error::Usage { .. }),
            "{name}, {asked:?}, {bytes} bytes: {error}"
        );
    }
}

/// The suite for a volume whose samples nothing else tells: boxes are compared with all of it.
fn conforms(volume: &dyn Volume, name: &str) {
    let header = volume.header();
    let whole = header.dims.0.map(|n| 0..n);
    let known = read(volume, &whole, voxels(&whole) * header.dtype.bytes()).unwrap();
    conforms_to(volume, &known, name);
}

/// The suite for a volume, and for what is made of it for a sweep.
fn conforms_in_sweeps(volume: &dyn Volume, name: &str) {
    conforms(volume, name);
    let whole = volume.header().dims.0.map(|n| 0..n);
    let bytes = voxels(&whole) * volume.header().dtype.bytes();
    let known = read(volume, &whole, bytes).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let copy = spool(volume, dir.path()).unwrap();
    assert!(copy.random_access(), "{name}");
    assert_eq!(copy.header(), volume.header(), "{name}");
    conforms_to(&*copy, &known, name);
    if let Some(once) = volume.decoded_once(dir.path()).unwrap() {
        conforms_to(&*once, &known, name);
    }
}

#[test]
fn every_format_hands_out_any_box() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for format in FORMATS {
        let dir = tempfile::tempdir().unwrap();
        let own = FIXTURES.iter().find(|(name, _)| *name == format.name);
        let paths = match own {
            Some((_, names)) if !names.is_empty() => {
                names.iter().map(|name| fixtures.join(name)).collect()
            }
            _ => made(format.name, dir.path()),
        };
        for path in paths {
            let name = path.display().to_string();
            for io in [Io::Read, Io::Mmap] {
                let resample = name.contains("tilted") || name.contains("uneven");
                let options = OpenOptions {
                    io,
                    resample,
                    ..OpenOptions::default()
                };
                let opened = match open(&path, &options) {
                    Err(e) if e.to_string().contains("in this build") => continue,
                    opened => opened.unwrap_or_else(|e| panic!("{name}: {e}")),
                };
                let found = opened.volume.header().format;
                assert!(
                    found == format.name || format.name == "zip",
                    "{name}: {found}"
                );
                conforms_in_sweeps(&*opened.volume, &name);
            }
        }
    }
}

#[test]
fn raw_samples_hand_out_any_box() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw");
    let samples: Vec<u8> = (0..60u16).flat_map(u16::to_ne_bytes).collect();
    std::fs::write(&path, &samples).unwrap();
    for io in [Io::Read, Io::Mmap] {
        let options = OpenOptions {
            dims: Some([5, 4, 3]),
            dtype: Some(Dtype::U16),
            io,
            ..OpenOptions::default()
        };
        let options = match cfg!(target_endian = "big") {
            true => OpenOptions {
                endian: Some(super::Endian::Big),
                ..options
            },
            false => options,
        };
        let volume = open(&path, &options).unwrap().volume;
        conforms_to(&*volume, &samples, "raw");
        conforms_in_sweeps(&*volume, "raw");
    }
}

const DIMS: [u32; 3] = [7, 6, 5];

/// A volume of which voxel (x, y, z) has the value x + 10 y + 100 z, perhaps on other axes.
fn memory(placement: Placement) -> MemoryVolume<i16> {
    let samples = values(DIMS, |[x, y, z]| (x + 10 * y + 100 * z) as i16);
    MemoryVolume::new(Dims(DIMS), placement, samples).unwrap()
}

fn values<T>(dims: [u32; 3], value: impl Fn([u32; 3]) -> T) -> Vec<T> {
    let [nx, ny, nz] = dims;
    let voxels = (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / (nx * ny)]);
    voxels.map(value).collect()
}

fn bytes<T: super::Voxel>(values: &[T]) -> &[u8] {
    bytemuck::cast_slice(values)
}

#[test]
fn every_wrapper_hands_out_any_box() {
    let plain = memory(Placement::default());
    let known = bytes(plain.samples());
    conforms_to(&plain, known, "in memory");
    conforms_to(&&plain, known, "by reference");
    conforms_in_sweeps(&plain, "in memory");
    let [x, y, z] = [1..6, 0..4, 2..5];
    let part = cut(known, DIMS, 2, &[x.clone(), y.clone(), z.clone()]);
    let cropped = Cropped::new(Box::new(&plain), &Crop { x, y, z }).unwrap();
    conforms_to(&cropped, &part, "cropped");
    for turned in [[false; 2], [true, false], [false, true], [true; 2]] {
        let expected = values(DIMS, |[x, y, z]| {
            let x = if turned[0] { DIMS[0] - 1 - x } else { x };
            let y = if turned[1] { DIMS[1] - 1 - y } else { y };
            (x + 10 * y + 100 * z) as i16
        });
        let mirrored = Mirrored::new(Box::new(&plain), turned);
        conforms_to(&mirrored, bytes(&expected), "mirrored");
    }
    for axes in [
        [0, 1, 2],
        [2, 1, 0],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [1, 0, 2],
    ] {
        let dims = stored_dims(axes, Dims(DIMS)).0;
        // the voxel that lies at a place of the volume whose axes are in another order
        let value = |stored: [u32; 3]| {
            let place = |a: usize| stored[axes.iter().position(|axis| *axis == a).unwrap()];
            (place(0) + 10 * place(1) + 100 * place(2)) as i16
        };
        let stored = values(dims, value);
        let stored = MemoryVolume::new(Dims(dims), Placement::default(), stored).unwrap();
        conforms_to(&Permuted::new(Box::new(&stored), axes), known, "permuted");
    }
    let scale = Values::linear(0.5, -3.0, "a test").unwrap();
    let expected: Vec<f32> = plain
        .samples()
        .iter()
        .map(|&v| f32::from(v) * 0.5 - 3.0)
        .collect();
    let valued = Valued::new(Box::new(&plain), scale);
    conforms_to(&valued, bytes(&expected), "scaled");
    let watch = Watch::new(plain.header(), false);
    conforms_to(&Watched::new(Box::new(&plain), &watch), known, "watched");
    let dir = tempfile::tempdir().unwrap();
    let beside = super::spool_beside(&plain, dir.path(), |volume| {
        let whole = DIMS.map(|n| 0..n);
        assert_eq!(read(volume, &whole, known.len())?, known);
        refuses(volume, "copied while it is read");
        Ok(())
    });
    beside.unwrap();
}

#[test]
fn resampled_volumes_hand_out_any_box() {
    let placement = Placement {
        directions: [[1.0, 0.0, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]],
        ..Placement::default()
    };
    let leaning = memory(placement);
    let grid = Grid::upright(Path::new("v"), placement, Dims(DIMS), -1.0).unwrap();
    let upright = grid.placement;
    let resampled = Resampled::new(Box::new(&leaning), grid, upright).unwrap();
    conforms_in_sweeps(&resampled, "resampled");
}

#[test]
fn filtered_volumes_hand_out_any_box() {
    let plain = memory(Placement::default());
    let gaps = values(DIMS, |[x, y, z]| match x * y + z {
        6 | 7 => f32::NAN,
        9 => f32::INFINITY,
        n => 0.1 * n as f32 - 1.0,
    });
    let gaps = MemoryVolume::new(Dims(DIMS), Placement::default(), gaps).unwrap();
    let dir = tempfile::tempdir().unwrap();
    // what is packed is read forward
    let packed = &made("nrrd", dir.path())[1];
    let open_packed = || open(packed, &OpenOptions::default()).unwrap().volume;
    assert!(!open_packed().random_access());
    let inner =
        || -> [Box<dyn Volume + '_>; 3] { [Box::new(&plain), Box::new(&gaps), open_packed()] };
    for (i, sigma) in [[0.6; 3], [0.0, 1.2, 0.3], [0.4, 0.0, 2.0]]
        .iter()
        .enumerate()
    {
        for (inner, name) in inner().into_iter().zip(["plain", "with gaps", "packed"]) {
            let smoothed = Smoothed::along_axes(inner, *sigma).unwrap();
            conforms_in_sweeps(&smoothed, &format!("{name}, smoothed {i}"));
        }
    }
    for radius in [1, 2] {
        for (inner, name) in inner().into_iter().zip(["plain", "with gaps", "packed"]) {
            let medians = Medianed::new(inner, radius).unwrap();
            conforms_in_sweeps(&medians, &format!("{name}, medians {radius}"));
            let both = Smoothed::new(Box::new(medians), 0.5).unwrap();
            conforms_in_sweeps(&both, &format!("{name}, medians {radius} smoothed"));
        }
    }
}

/// A compressed stream of samples of i16 as a volume, with the directory that it lies in.
fn packed(samples: &[u8], dims: [u32; 3]) -> (tempfile::TempDir, Box<dyn Volume>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.raw.gz");
    let file = std::fs::File::create(&path).unwrap();
    let mut encoder = flate2::write::GzEncoder::new(file, Default::default());
    std::io::Write::write_all(&mut encoder, samples).unwrap();
    encoder.finish().unwrap();
    let options = OpenOptions {
        dims: Some(dims.map(u64::from)),
        dtype: Some(Dtype::I16),
        endian: Some(super::Endian::NATIVE),
        ..OpenOptions::default()
    };
    (dir, open(&path, &options).unwrap().volume)
}

/// Filters that are put around volumes, one for each that there is at least.
const FILTERS: [&str; 8] = [
    "invert",
    "clamp 20,300",
    "downsample 2",
    "downsample 3",
    "smooth 0.7",
    "smooth 2,0.5,0",
    "median 1",
    "clamp -1e9,1e9",
];

/// Puts filters around a volume and checks that the header is as they say.
fn filtered<'a>(volume: &'a dyn Volume, list: &[Filter]) -> Box<dyn Volume + 'a> {
    let inner: Box<dyn Volume + 'a> = Box::new(volume);
    let put = |inner, f: &Filter| super::filtered(f, inner).unwrap();
    let made = list.iter().fold(inner, put);
    let (before, after) = (volume.header(), made.header());
    assert_eq!(after.dims, filtered_dims(before.dims, list).unwrap());
    assert_eq!(after.dtype, filtered_dtype(before.dtype, list));
    let place = list.iter().fold(before.placement, |p, f| f.placement(p));
    assert_eq!(after.placement, place);
    made
}

#[test]
fn every_filter_hands_out_any_box() {
    let all: Vec<Filter> = FILTERS.iter().map(|text| text.parse().unwrap()).collect();
    let twice = [all[2], all[4], all[6]];
    let lists = all.iter().map(std::slice::from_ref).chain([&twice[..]]);
    let dims = [9, 8, 7];
    let whole = values(dims, |[x, y, z]| (x + 10 * y + 100 * z) as i16);
    let whole = MemoryVolume::new(Dims(dims), Placement::default(), whole).unwrap();
    let of_floats = values(dims, |[x, y, z]| match (x + y + z) % 5 {
        0 => f32::NAN,
        _ => (x * y) as f32 - 0.7 * z as f32,
    });
    let floats = MemoryVolume::new(Dims(dims), Placement::default(), of_floats).unwrap();
    let (pages, _) = counting(dims, &[(4, 3, true), (2, 5, false)]);
    let stream = packed(bytes(whole.samples()), dims);
    assert!(!stream.1.random_access());
    for list in lists {
        for volume in [&whole as &dyn Volume, &floats, &pages, &*stream.1] {
            let name = format!("{list:?} of {}", volume.header().dtype);
            conforms_in_sweeps(&*filtered(volume, list), &name);
        }
    }
}

/// The values of volumes of pages and chunks that count.
fn counted_known(dims: [u32; 3]) -> Vec<u32> {
    values(dims, |[x, y, z]| x + 10 * y + 100 * z)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn pages_hand_out_any_box(
        dims in [2u32..9, 2u32..9, 2u32..9],
        cuts in prop::collection::vec((1u32..11, 1u32..11, any::<bool>()), 1..4),
    ) {
        let (volume, _) = counting(dims, &cuts);
        let known = counted_known(dims);
        let dir = tempfile::tempdir().unwrap();
        let once = Unpacked::new(&volume, dir.path()).unwrap();
        conforms_to(&volume, bytes(&known), "pages");
        conforms_to(&once, bytes(&known), "pages that are decoded once");
    }

    #[cfg(any(feature = "hdf5", feature = "zarr"))]
    #[test]
    fn chunks_hand_out_any_box(
        dims in [2u32..9, 2u32..9, 2u32..9],
        shape in [1u32..11, 1u32..11, 1u32..11],
    ) {
        let volume = super::io::chunked::tests::counted(dims, shape);
        let known = counted_known(dims);
        let dir = tempfile::tempdir().unwrap();
        let once = Unpacked::new(&volume, dir.path()).unwrap();
        conforms_to(&volume, bytes(&known), "chunks");
        conforms_to(&once, bytes(&known), "chunks that are decoded once");
    }
}
