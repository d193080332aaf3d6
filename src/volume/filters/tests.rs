//! Filters beside slow ones that follow the definition, on random volumes of every type.

use super::median::Medianed;
use super::ordered::Ordered;
use super::smooth::Smoothed;
use crate::error::{Error, Result};
use crate::grid::{Dims, Placement};
use crate::volume::{Dtype, Header, MemoryVolume, Volume, with_voxel_type};
use proptest::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

/// Numbers that look random.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// A sample of 8 random bytes, of which floats are often missing or infinite.
trait Made: Ordered {
    fn made(bits: u64, gaps: u64) -> Self;
}

macro_rules! made {
    ($($t:ty: |$bits:ident, $gaps:ident| $value:expr;)*) => {$(
        impl Made for $t {
            fn made($bits: u64, $gaps: u64) -> Self {
                $value
            }
        }
    )*};
}

made! {
    u8: |bits, _gaps| bits as u8;
    i8: |bits, _gaps| bits as i8;
    u16: |bits, _gaps| bits as u16;
    i16: |bits, _gaps| bits as i16;
    u32: |bits, _gaps| bits as u32;
    i32: |bits, _gaps| bits as i32;
    f32: |bits, gaps| f64::made(bits, gaps) as f32;
    f64: |bits, gaps| match bits >> 8 & 127 {
        n if n < gaps => f64::NAN,
        n if n < gaps + gaps / 8 => f64::INFINITY,
        n if n < gaps + gaps / 4 => f64::NEG_INFINITY,
        127 => -0.0,
        126 => 0.0,
        _ => (bits >> 20) as f64 * 1e-10 - 700.0,
    };
}

fn volume<T: Made>(dims: [u32; 3], seed: u64, gaps: u64) -> MemoryVolume<T> {
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let dims = Dims(dims);
    let sample = |_| T::made(random.next(), gaps);
    let samples = (0..dims.voxels()).map(sample).collect();
    MemoryVolume::new(dims, Placement::default(), samples).unwrap()
}

fn whole(volume: &dyn Volume) -> Vec<u8> {
    let header = volume.header();
    let [x, y, z] = header.dims.0.map(|n| 0..n);
    let mut out = vec![0; header.dims.voxels() as usize * header.dtype.bytes()];
    volume.read_box(x, y, z, &mut out).unwrap();
    out
}

/// Samples of a cube around a voxel, with how far they lie away; those beyond the edges are copies.
fn cube<T: Copy>(
    samples: &[T],
    dims: [u32; 3],
    at: [u32; 3],
    radius: [u32; 3],
) -> impl Iterator<Item = ([i32; 3], T)> {
    let around = move |a: usize| -(radius[a] as i32)..=radius[a] as i32;
    let away =
        around(2).flat_map(move |z| around(1).flat_map(move |y| around(0).map(move |x| [x, y, z])));
    away.map(move |away| {
        let at = [0, 1, 2].map(|a| (at[a] as i32 + away[a]).clamp(0, dims[a] as i32 - 1) as u32);
        (away, samples[Dims(dims).linear(at) as usize])
    })
}

fn voxels([nx, ny, nz]: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
    (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / (nx * ny)])
}

/// Compares a smoothed volume with weighted means over cubes.
fn check_smooth<T: Made>(dims: [u32; 3], seed: u64, gaps: u64, sigma: [f64; 3]) {
    let inner = volume::<T>(dims, seed, gaps);
    let smoothed = Smoothed::along_axes(Box::new(&inner), sigma).unwrap();
    let header = smoothed.header();
    let (wanted, tolerance) = match T::DTYPE {
        Dtype::F64 => (Dtype::F64, 1e-13),
        _ => (Dtype::F32, 2e-6),
    };
    assert_eq!((header.dtype, header.dims.0), (wanted, dims));
    let bytes = whole(&smoothed);
    let found: Vec<f64> = match wanted {
        Dtype::F64 => bytemuck::pod_collect_to_vec(&bytes),
        _ => bytes
            .as_chunks::<4>()
            .0
            .iter()
            .map(|b| f32::from_ne_bytes(*b).into())
            .collect(),
    };
    let radius = sigma.map(|s| (4.0 * s + 0.5) as u32);
    for (at, found) in voxels(dims).zip(found) {
        let own = inner.samples()[Dims(dims).linear(at) as usize].to_f64();
        if !own.is_finite() {
            let same = own == found || own.is_nan() && found.is_nan();
            assert!(same, "{at:?}: {found} in place of {own}");
            continue;
        }
        // weighted values, their magnitudes and weights
        let mut sums = [0.0; 3];
        for (away, sample) in cube(inner.samples(), dims, at, radius) {
            let value = sample.to_f64();
            let along = |a: usize| match away[a] {
                0 => 1.0,
                d => {
                    let d = f64::from(d) / sigma[a];
                    libm::exp(-0.5 * d * d)
                }
            };
            let weight: f64 = (0..3).map(along).product();
            if value.is_finite() {
                sums = [
                    sums[0] + weight * value,
                    sums[1] + weight * value.abs(),
                    sums[2] + weight,
                ];
            }
        }
        let (expected, scale) = (sums[0] / sums[2], sums[1] / sums[2]);
        let apart = (found - expected).abs();
        assert!(
            apart <= tolerance * scale,
            "{at:?}: {found}, not {expected}"
        );
    }
}

/// Compares a median filter with sorting, to the last bit.
fn check_median<T: Made>(dims: [u32; 3], seed: u64, gaps: u64, radius: u32) {
    let inner = volume::<T>(dims, seed, gaps);
    let filtered = Medianed::new(Box::new(&inner), radius).unwrap();
    assert_eq!(filtered.header(), inner.header());
    let of_voxel = |at| {
        let own = inner.samples()[Dims(dims).linear(at) as usize];
        let cube = cube(inner.samples(), dims, at, [radius; 3]).map(|(_, sample)| sample.key());
        let mut numbers: Vec<T::Key> = cube.filter(|key| T::is_number(*key)).collect();
        numbers.sort_unstable();
        match T::is_number(own.key()) {
            true => T::of_key(numbers[(numbers.len() - 1) / 2]),
            false => own,
        }
    };
    let expected: Vec<T> = voxels(dims).map(of_voxel).collect();
    assert!(whole(&filtered) == bytemuck::cast_slice::<T, u8>(&expected));
}

fn sizes(most: u32) -> [Range<u32>; 3] {
    [2..most, 2..most, 2..most]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn smoothed_values_are_weighted_means(
        dims in sizes(9), seed in any::<u64>(), gaps in prop::sample::select(vec![0u64, 3, 60, 90]),
        sigma in prop::array::uniform3(prop::sample::select(vec![0.0, 0.3, 0.5, 1.0])),
    ) {
        prop_assume!(sigma != [0.0; 3]);
        for dtype in Dtype::ALL {
            with_voxel_type!(dtype, T => check_smooth::<T>(dims, seed, gaps, sigma));
        }
    }

    #[test]
    fn so_they_are_where_the_reach_is_larger_than_the_volume(
        dims in sizes(5), seed in any::<u64>(), gaps in prop::sample::select(vec![0u64, 20]), sigma in 1.0..3.0,
    ) {
        for dtype in [Dtype::U16, Dtype::I32, Dtype::F32, Dtype::F64] {
            with_voxel_type!(dtype, T => check_smooth::<T>(dims, seed, gaps, [sigma; 3]));
        }
    }

    #[test]
    fn medians_are_those_of_cubes(
        dims in sizes(12), seed in any::<u64>(), gaps in prop::sample::select(vec![0u64, 3, 60, 90]), radius in 1u32..3,
    ) {
        for dtype in Dtype::ALL {
            with_voxel_type!(dtype, T => check_median::<T>(dims, seed, gaps, radius));
        }
    }

    /// What is far from missing samples has the same bits as if none were.
    #[test]
    fn missing_samples_reach_no_further_than_the_filter(seed in any::<u64>(), hole in 0..24u32) {
        let dims = [24, 5, 6];
        let plain = volume::<f32>(dims, seed, 0);
        let mut samples = plain.samples().to_vec();
        samples[Dims(dims).linear([hole, 2, 3]) as usize] = f32::NAN;
        let torn = MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap();
        let both = [&plain, &torn];
        let smoothed = both.map(|v| whole(&Smoothed::new(Box::new(v), 1.0).unwrap()));
        let medians = both.map(|v| whole(&Medianed::new(Box::new(v), 2).unwrap()));
        for ([plain, torn], reach) in [(smoothed, 4), (medians, 2)] {
            let [plain, torn] = [&plain, &torn].map(|b| b.as_chunks::<4>().0);
            for (at, (a, b)) in voxels(dims).zip(plain.iter().zip(torn)) {
                if at[0].abs_diff(hole) > reach {
                    prop_assert_eq!(a, b);
                }
                prop_assert_eq!(f32::from_ne_bytes(*b).is_nan(), at == [hole, 2, 3]);
            }
        }
    }
}

/// Samples of which every sum is infinite, or as small as numbers get, are filtered without a panic.
#[test]
fn numbers_at_the_ends_of_their_type_are_filtered() {
    for value in [
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-45,
        f32::INFINITY,
        f32::NAN,
    ] {
        let dims = Dims([4, 3, 3]);
        let inner = MemoryVolume::new(dims, Placement::default(), vec![value; 36]).unwrap();
        let medians = whole(&Medianed::new(Box::new(&inner), 1).unwrap());
        assert!(medians == bytemuck::cast_slice::<f32, u8>(inner.samples()));
        let smoothed = whole(&Smoothed::new(Box::new(&inner), 0.7).unwrap());
        assert_eq!(smoothed.len(), 144);
    }
}

#[test]
fn what_no_filter_does_is_refused() {
    let inner = volume::<u8>([3, 3, 3], 1, 0);
    let refused = |made: Result<String>| match made.unwrap_err() {
        Error::Usage { option, found, .. } => format!("{option} {found}"),
        other => panic!("{other}"),
    };
    for sigma in [0.0, -1.0, 32.5, f64::NAN, f64::INFINITY] {
        let made = Smoothed::new(Box::new(&inner), sigma);
        let expected = format!("--smooth {sigma}");
        assert_eq!(refused(made.map(|_| String::new())), expected);
    }
    let made = Smoothed::along_axes(Box::new(&inner), [1.0, 2.0, -3.0]);
    let found = refused(made.map(|_| String::new()));
    assert_eq!(found, "--smooth 1, 2 and -3 along x, y and z");
    for radius in [0, 3, u32::MAX] {
        let made = Medianed::new(Box::new(&inner), radius);
        assert_eq!(
            refused(made.map(|_| String::new())),
            format!("--median {radius}")
        );
    }
}

/// Boxes so wide that they are made in strips are those of their rows.
#[test]
fn strips_of_a_box_join() {
    let dims = [3000, 40, 3];
    let inner = volume::<f32>(dims, 5, 1);
    let smoothed = Smoothed::new(Box::new(&inner), 1.0).unwrap();
    let medians = Medianed::new(Box::new(&inner), 1).unwrap();
    for filtered in [&smoothed as &dyn Volume, &medians] {
        let known = whole(filtered);
        for (j, known) in (0..40).zip(known.chunks_exact(12_000)).step_by(3) {
            let mut row = vec![0; 12_000];
            filtered
                .read_box(0..3000, j..j + 1, 0..1, &mut row)
                .unwrap();
            assert!(row == known, "{j}");
        }
    }
}

/// A volume that is read forward: how often it begins again.
struct Forward {
    inner: MemoryVolume<u16>,
    next: AtomicU32,
    begun: AtomicU32,
}

impl Forward {
    fn new(dims: [u32; 3]) -> Self {
        Forward::around(volume(dims, 7, 0))
    }

    fn around(inner: MemoryVolume<u16>) -> Self {
        Forward {
            inner,
            next: AtomicU32::new(0),
            begun: AtomicU32::new(1),
        }
    }
}

impl Volume for Forward {
    fn header(&self) -> &Header {
        self.inner.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        if z.start < self.next.swap(z.end, Ordering::Relaxed) {
            self.begun.fetch_add(1, Ordering::Relaxed);
        }
        self.inner.fill_box(x, y, z, out)
    }

    fn random_access(&self) -> bool {
        false
    }
}

/// Boxes that go on forward, and back by the slices that slabs share, read a stream once, as do parts of single slices;
/// values are those of a volume that is read in any order.
#[test]
fn streams_are_read_once() {
    let slabs = (0..40u32).step_by(8);
    let slabs = slabs.map(|start| (0..7, start.saturating_sub(2)..(start + 9).min(40)));
    let parts = (0..40).flat_map(|k| [0..4, 3..7].map(|y| (y, k..(k + 2).min(40))));
    for boxes in [Vec::from_iter(slabs), Vec::from_iter(parts)] {
        let [smoothed, medians] = [0; 2].map(|_| Forward::new([5, 7, 40]));
        let expected = whole(&Smoothed::new(Box::new(&smoothed.inner), 1.0).unwrap());
        reads_once(
            &Smoothed::new(Box::new(&smoothed), 1.0).unwrap(),
            &boxes,
            &expected,
        );
        let expected = whole(&Medianed::new(Box::new(&medians.inner), 1).unwrap());
        reads_once(
            &Medianed::new(Box::new(&medians), 1).unwrap(),
            &boxes,
            &expected,
        );
        for stream in [smoothed, medians] {
            assert_eq!(stream.begun.into_inner(), 1);
        }
    }
}

/// Reads boxes of 5 x 7 x 40 voxels, with all x.
fn reads_once(filtered: &dyn Volume, boxes: &[(Range<u32>, Range<u32>)], expected: &[u8]) {
    assert!(!filtered.random_access());
    let row = 5 * filtered.header().dtype.bytes();
    for (y, z) in boxes {
        let mut out = vec![0; row * y.len() * z.len()];
        filtered
            .read_box(0..5, y.clone(), z.clone(), &mut out)
            .unwrap();
        for (k, part) in z.clone().zip(out.chunks_exact(row * y.len())) {
            let known = &expected[(7 * k + y.start) as usize * row..];
            assert!(*part == known[..part.len()], "{k}");
        }
        filtered.release(z.start..z.end.saturating_sub(3).max(z.start));
    }
}

/// What a filter says that it holds grows with rows and slices of the volume as little as it should.
#[test]
fn memory_is_that_of_strips_or_of_few_slices() {
    let held = |dims, forward| {
        let inner = volume::<u16>(dims, 1, 0);
        let inner: Box<dyn Volume> = match forward {
            true => Box::new(Forward::around(inner)),
            false => Box::new(inner),
        };
        let sigma = [2.0, 1.0, 0.5];
        Smoothed::along_axes(inner, sigma).unwrap().held_bytes()
    };
    assert_eq!(held([90, 300, 9], false), held([90, 300, 90], false));
    let threads = rayon::current_num_threads() as u64;
    assert!(held([90, 3000, 9], false) < threads * (2 << 20));
    // 2 * 2 + 1 + 3 slices of sums and one of samples, and little else
    let slices = 90 * 300 * (8 * 4 + 2);
    assert!((slices..slices * 11 / 10).contains(&held([90, 300, 9], true)));
    assert_eq!(held([90, 300, 9], true), held([90, 300, 90], true));
}
