//! Bodies with a known surface, in the middle of the volume, as grey ramps along the distance to it.

use super::Rows;
use super::random::RowStream;
use crate::grid::Dims;
use std::f64::consts::TAU;
use std::ops::Range;

/// Half the width of the grey ramp across the surface, in voxels. The voxels that a vertex and its
/// normal are computed from are at most 2 voxels from the surface, so all of them lie on the ramp and
/// interpolation finds the surface to second order.
const HALF_RAMP: f64 = 2.0;

/// A body as a function of the voxel's place relative to the volume's middle.
#[derive(Debug, Clone, Copy)]
pub enum Body {
    /// Radius.
    Sphere(f64),
    /// Radius of the circle that the tube follows, in the x-y plane, and of the tube.
    Torus(f64, f64),
    /// Half the edge.
    Cube(f64),
    /// Semi-axes along x, y, z.
    Ellipsoid([f64; 3]),
}

impl Body {
    /// Distance to the surface, above 0 inside; exact but for the ellipsoid, where it is so to
    /// first order near the surface.
    fn depth(self, [x, y, z]: [f64; 3]) -> f64 {
        match self {
            Body::Sphere(r) => r - (x * x + y * y + z * z).sqrt(),
            Body::Torus(r, tube) => {
                let around = (x * x + y * y).sqrt() - r;
                tube - (around * around + z * z).sqrt()
            }
            Body::Cube(half) => {
                let d = [x.abs() - half, y.abs() - half, z.abs() - half];
                let outside = d
                    .map(|v| v.max(0.0))
                    .iter()
                    .map(|v| v * v)
                    .sum::<f64>()
                    .sqrt();
                -(outside + d[0].max(d[1]).max(d[2]).min(0.0))
            }
            Body::Ellipsoid([a, b, c]) => {
                // the function k0 - 1 over the length of its gradient, k1 / k0
                let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
                let k0 = length([x / a, y / b, z / c]);
                let k1 = length([x / a / a, y / b / b, z / c / c]);
                if k0 < 0.5 {
                    0.5 * a.min(b).min(c)
                } else {
                    k0 * (1.0 - k0) / k1
                }
            }
        }
    }
}

/// The rows of a body.
pub struct BodyRows {
    /// The body.
    pub body: Body,
    /// Size of the volume.
    pub dims: Dims,
    /// First voxel of every row.
    pub x: u32,
}

impl Rows for BodyRows {
    fn row(&mut self, y: u32, z: u32, grey: &mut [f32]) {
        let middle = self.dims.0.map(|n| f64::from(n - 1) / 2.0);
        let (py, pz) = (f64::from(y) - middle[1], f64::from(z) - middle[2]);
        for (x, g) in (self.x..).zip(grey.iter_mut()) {
            let depth = self.body.depth([f64::from(x) - middle[0], py, pz]);
            *g = (0.5 + depth * (0.5 / HALF_RAMP)).clamp(0.0, 1.0) as f32;
        }
    }
}

/// The rows of a gyroid: above where sin X cos Y + sin Y cos Z + sin Z cos X > 0, with
/// X = 2 pi x / period (Schoen, NASA TN D-5541, 1970). Both sides are one piece each.
pub struct GyroidRows {
    period: f64,
    /// Sine and cosine along x.
    along_x: Vec<[f32; 2]>,
}

impl GyroidRows {
    /// Rows of the voxels `x`; `period` is in voxels.
    pub fn new(period: f64, x: Range<u32>) -> Self {
        GyroidRows {
            period,
            along_x: x.map(|x| sin_cos(x, period)).collect(),
        }
    }
}

fn sin_cos(i: u32, period: f64) -> [f32; 2] {
    // reduced first, so that the far end of a long volume is as exact as the near one
    let (s, c) = libm::sincos(TAU * (f64::from(i) % period) / period);
    [s as f32, c as f32]
}

impl Rows for GyroidRows {
    fn row(&mut self, y: u32, z: u32, grey: &mut [f32]) {
        let [sy, cy] = sin_cos(y, self.period);
        let [sz, cz] = sin_cos(z, self.period);
        let scale = (self.period / TAU * (0.5 / HALF_RAMP)) as f32;
        for (&[sx, cx], g) in self.along_x.iter().zip(grey.iter_mut()) {
            let value = sx * cy + sy * cz + sz * cx;
            let gradient = [cx * cy - sz * sx, cy * cz - sx * sy, cz * cx - sy * sz];
            let slope = gradient.iter().map(|v| v * v).sum::<f32>().sqrt();
            // the slope vanishes only far from the surface, where the ramp has ended
            *g = (0.5 + scale * value / slope.max(0.5)).clamp(0.0, 1.0);
        }
    }
}

/// The rows of white noise: each voxel is above with probability `density`, on its own.
pub struct NoiseRows {
    /// 0 to 1.
    pub density: f64,
    /// Names the noise.
    pub seed: u64,
    /// First voxel of every row.
    pub x: u32,
}

impl Rows for NoiseRows {
    fn row(&mut self, y: u32, z: u32, grey: &mut [f32]) {
        const BITS: u32 = 53;
        let limit = (self.density * (1u64 << BITS) as f64) as u64;
        let row = RowStream::new(mix_seed(self.seed), y, z);
        for (x, g) in (self.x..).zip(grey.iter_mut()) {
            *g = f32::from(u8::from(row.at(x) >> (64 - BITS) < limit));
        }
    }
}

/// Another stream than the one that detector noise is drawn from.
fn mix_seed(seed: u64) -> u64 {
    super::random::mix(seed.wrapping_add(0xa076_1d64_78bd_642f))
}
