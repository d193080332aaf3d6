//! Place and normal of a vertex on a crossed lattice edge.

use crate::grid::LATTICE;
use crate::sys::rounding::{integer, round};
use crate::volume::Voxel;

/// Lattice steps from the edge's lower voxel `v0` to the surface: 256 (T - v0) / (v1 - v0) rounded
/// half away from zero, 128 if that is not finite, clamped to 1..=255.
///
/// All sample types fit `f64` exactly, and IEEE division rounds alike everywhere, so two tiles
/// compute the same step.
#[inline]
pub fn step_on_edge(v0: f64, v1: f64, threshold: f64) -> u32 {
    let t = f64::from(LATTICE) * (threshold - v0) / (v1 - v0);
    // half up is away from zero: it is positive by then
    let step = round(t.clamp(1.0, f64::from(LATTICE - 1)));
    if t.is_finite() {
        integer(step)
    } else {
        LATTICE / 2
    }
}

/// How to take differences around the voxels of one row.
#[derive(Debug, Clone, Copy)]
pub struct Stencil {
    /// Sample offsets back and forth along y and z; 0 at the volume's faces.
    offsets: [[usize; 2]; 2],
    /// Whether differences along y and z are central or one-sided.
    central: [bool; 2],
}

impl Stencil {
    /// For row (y, z) of a volume of `n` rows and slices whose samples step by `strides` along y
    /// and z.
    pub fn new([y, z]: [u32; 2], n: [u32; 2], strides: [usize; 2]) -> Self {
        let one = |v: u32, n: u32, stride: usize| {
            let back = if v > 0 { stride } else { 0 };
            let forth = if v + 1 < n { stride } else { 0 };
            ([back, forth], back > 0 && forth > 0)
        };
        let (y, central_y) = one(y, n[0], strides[0]);
        let (z, central_z) = one(z, n[1], strides[1]);
        Stencil {
            offsets: [y, z],
            central: [central_y, central_z],
        }
    }

    /// The gradient at sample `p`, which is voxel `x` of `nx` of its row.
    #[inline]
    pub fn gradient<T: Voxel>(&self, samples: &[T], p: usize, x: u32, nx: u32) -> [T::Slope; 3] {
        let slope = |[back, forth]: [usize; 2], central: bool| {
            let (before, after) = (samples[p - back], samples[p + forth]);
            if central {
                after.central_slope(before)
            } else {
                after.one_sided_slope(before)
            }
        };
        let [y, z] = self.offsets;
        let x = [usize::from(x > 0), usize::from(x + 1 < nx)];
        [
            slope(x, x == [1, 1]),
            slope(y, self.central[0]),
            slope(z, self.central[1]),
        ]
    }
}

/// Squared lengths of gradients that `f32` divides well.
pub const NORMAL_RANGE: std::ops::Range<f32> = 1e-30..1e30;

/// The unit normal from above to below: against the gradient, which is interpolated linearly between
/// the edge's ends. Where the gradient vanishes or is not finite, along the edge from above to below.
///
/// It is a normal in voxel coordinates: glTF transforms normals with the inverse transpose of the
/// node's matrix, which makes of it the physical gradient's direction, anisotropic spacing included.
#[inline]
pub fn normal(g0: [f32; 3], g1: [f32; 3], step: u32, axis: usize, lower_above: bool) -> [f32; 3] {
    let t = step as f32 / LATTICE as f32;
    let n: [f32; 3] = std::array::from_fn(|a| -(g0[a] + (g1[a] - g0[a]) * t));
    let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    if NORMAL_RANGE.contains(&square) {
        let length = square.sqrt();
        return n.map(|v| v / length);
    }
    extreme_normal(n, axis, lower_above)
}

/// The same for gradients whose square leaves the range of `f32`, zero and NaN among them.
#[cold]
fn extreme_normal(n: [f32; 3], axis: usize, lower_above: bool) -> [f32; 3] {
    let wide = n.map(f64::from);
    let length = wide.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() {
        return wide.map(|v| (v / length) as f32);
    }
    let mut along = [0.0; 3];
    along[axis] = if lower_above { 1.0 } else { -1.0 };
    along
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_follow_the_convention() {
        assert_eq!(step_on_edge(0.0, 10.0, 5.0), 128);
        assert_eq!(step_on_edge(0.0, 10.0, 10.0), 255); // a tie stays inside the edge
        assert_eq!(step_on_edge(10.0, 0.0, 10.0), 1);
        assert_eq!(step_on_edge(f64::NAN, 3.0, 1.0), 128);
        assert_eq!(step_on_edge(f64::NEG_INFINITY, 3.0, 1.0), 128);
        assert_eq!(step_on_edge(0.0, f64::INFINITY, 1.0), 1);
        assert_eq!(step_on_edge(0.0, 512.0, 3.0), 2); // 1.5 goes away from zero
        assert_eq!(step_on_edge(0.0, 512.0, 5.0), 3); // 2.5 as well
        assert_eq!(step_on_edge(0.0, 1.0, 1e-30), 1);
    }

    #[test]
    fn normals_are_unit_and_point_to_below() {
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
        assert!(close(
            normal([3.0, 0.0, 4.0], [3.0, 0.0, 4.0], 77, 0, false),
            [-0.6, 0.0, -0.8]
        ));
        assert!(close(
            normal([3e-30, 0.0, 4e-30], [3e-30, 0.0, 4e-30], 9, 0, true),
            [-0.6, 0.0, -0.8]
        ));
        assert!(close(
            normal([3e25, 0.0, 4e25], [3e25, 0.0, 4e25], 9, 0, true),
            [-0.6, 0.0, -0.8]
        ));
        assert_eq!(normal([0.0; 3], [0.0; 3], 9, 1, true), [0.0, 1.0, 0.0]);
        assert_eq!(
            normal([f32::NAN; 3], [0.0; 3], 9, 2, false),
            [0.0, 0.0, -1.0]
        );
        assert_eq!(
            normal([f32::INFINITY; 3], [0.0; 3], 9, 2, false),
            [0.0, 0.0, -1.0]
        );
    }
}
