//! Volumes for tests.

use alvis::grid::{Dims, Placement, Unit};
use alvis::volume::{MemoryVolume, Voxel};

/// A volume of unit voxels.
pub fn volume<T: Voxel>(dims: [u32; 3], samples: Vec<T>) -> MemoryVolume<T> {
    MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap()
}

/// A volume whose voxels have three sizes, and which lies somewhere.
pub fn placed<T: Voxel>(dims: [u32; 3], samples: Vec<T>) -> MemoryVolume<T> {
    let placement = Placement {
        spacing: [0.5, 0.75, 1.25],
        unit: Unit::Millimetre,
        origin: [-3.0, 10.5, 0.25],
        ..Placement::default()
    };
    MemoryVolume::new(Dims(dims), placement, samples).unwrap()
}

/// Samples by position.
pub fn samples<T>(dims: [u32; 3], mut value: impl FnMut([u32; 3]) -> T) -> Vec<T> {
    let [nx, ny, nz] = dims;
    let mut out = Vec::with_capacity((nx * ny * nz) as usize);
    for z in 0..nz {
        for y in 0..ny {
            out.extend((0..nx).map(|x| value([x, y, z])));
        }
    }
    out
}

/// The volume in a border of `value`, one voxel wide.
pub fn padded<T: Copy>(dims: [u32; 3], inner: &[T], value: T) -> ([u32; 3], Vec<T>) {
    let [nx, ny, _] = dims;
    let outer = dims.map(|n| n + 2);
    let samples = samples(outer, |p| {
        if (0..3).all(|a| p[a] > 0 && p[a] <= dims[a]) {
            inner[((p[0] - 1) + nx * ((p[1] - 1) + ny * (p[2] - 1))) as usize]
        } else {
            value
        }
    });
    (outer, samples)
}

/// A generator of test numbers: splitmix64, <https://prng.di.unimi.it/splitmix64.c>.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// From 0 up to 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// White noise of all values.
pub fn noise(dims: [u32; 3], seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    samples(dims, |_| random.bits() as u8)
}

/// A wavy, noisy foam: many cells, ragged walls, objects inside cells; about half is above 128.
pub fn foam(dims: [u32; 3], seed: u64) -> Vec<u8> {
    let mut random = Random(seed);
    samples(dims, |[x, y, z]| {
        let wave = |v: u32, k: f64| (f64::from(v) * k).sin();
        let field = wave(x, 0.7) + wave(y, 0.55) + wave(z, 0.62) + wave(x + y + z, 0.31);
        (128.0 + 26.0 * field + 60.0 * (random.unit() - 0.5)) as u8
    })
}

/// Shapes whose parts meet only slabs away: serpentines along z, U shapes open to both ends, a comb,
/// and the same as holes in a block. Above is 200, below 50; the threshold is 128.
pub fn late_joins() -> ([u32; 3], Vec<u8>) {
    let dims = [41, 23, 40];
    let [nx, ny, nz] = dims;
    let solid = |x: u32, y: u32, z: u32| {
        // up and down columns, joined at alternate ends: one serpentine
        let column = x % 4 == 1 && z > 1 && z + 2 < nz;
        let bridge = match x.saturating_sub(1) / 4 % 2 {
            0 => z + 3 == nz,
            _ => z == 2,
        };
        let serpentine = y == 3 && (column || bridge && x % 4 != 1 && x > 1 && x + 4 < nx);
        // a comb: teeth that meet in the last slices only
        let comb = y == 8 && z > 1 && (x % 3 == 1 || z + 3 == nz) && z + 2 < nz && x + 1 < nx;
        // U shapes: open towards low z
        let u = y == 12
            && z > 4
            && z < 35
            && (x % 8 == 2 || x % 8 == 5 || (x % 8 > 1 && x % 8 < 6 && z > 31));
        serpentine || comb || u
    };
    let values = samples(dims, |[x, y, z]| {
        let block = y >= 14;
        // the block has the same shapes as hollows
        let above = if block {
            !solid(x, y - 12, z) && y + 1 < ny
        } else {
            solid(x, y, z)
        };
        if above { 200 } else { 50 }
    });
    (dims, values)
}
