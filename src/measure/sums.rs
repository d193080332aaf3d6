//! Exact sums over voxels and triangles. They are integers, so the order of adding, and with it
//! threads, tiles and bands, cannot change a result.

use crate::grid::{Dims, LATTICE};
use crate::rounding::round;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// Sums over the voxels of a component, in voxel coordinates.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct VoxelSums {
    /// Sums of xx, yy, zz, xy, xz, yz.
    pub second: [u128; 6],
    /// Sums of x, y, z.
    pub first: [u64; 3],
    /// Number of voxels.
    pub voxels: u64,
    /// Euler characteristic of the component's part of the grid's outer faces.
    pub border_euler: i64,
    min: Corner,
    max: Corner,
    /// 1 if a voxel lies on the grid's outer faces.
    pub touches_border: u64,
}

/// Three coordinates, the last one twice. Four are loaded and stored at once: of three, compilers did so with
/// two and took the third alone, and to load again what was stored in parts took half the time of
/// [`VoxelSums::add_run`].
type Corner = [u16; 4];

impl Default for VoxelSums {
    fn default() -> Self {
        VoxelSums {
            min: [u16::MAX; 4],
            ..VoxelSums::zeroed()
        }
    }
}

/// Sum of k for k in 0..n, and of k^2.
fn power_sums(n: u64) -> (u64, u64) {
    if n == 0 {
        return (0, 0);
    }
    (n * (n - 1) / 2, (n - 1) * n * (2 * n - 1) / 6)
}

impl VoxelSums {
    /// Adds the voxels `x` of row (y, z).
    #[inline]
    pub fn add_run(&mut self, x: Range<u32>, y: u32, z: u32, dims: Dims) {
        let n = u64::from(x.end - x.start);
        let (end, start) = (power_sums(u64::from(x.end)), power_sums(u64::from(x.start)));
        let (sx, sxx) = (end.0 - start.0, end.1 - start.1);
        let (y64, z64) = (u64::from(y), u64::from(z));
        self.voxels += n;
        self.first[0] += sx;
        self.first[1] += n * y64;
        self.first[2] += n * z64;
        let second = [
            sxx,
            n * y64 * y64,
            n * z64 * z64,
            sx * y64,
            sx * z64,
            n * y64 * z64,
        ];
        for (sum, add) in self.second.iter_mut().zip(second) {
            *sum += u128::from(add);
        }
        let low = [x.start, y, z, z].map(|v| v as u16);
        let high = [x.end - 1, y, z, z].map(|v| v as u16);
        self.widen(low, high);
        let [nx, ny, nz] = dims.0;
        let border = x.start == 0 || x.end == nx || y == 0 || y + 1 == ny || z == 0 || z + 1 == nz;
        self.touches_border |= u64::from(border);
    }

    #[inline(always)]
    fn widen(&mut self, low: Corner, high: Corner) {
        for a in 0..4 {
            self.min[a] = self.min[a].min(low[a]);
            self.max[a] = self.max[a].max(high[a]);
        }
    }

    /// Smallest and largest coordinates; the latter are below the former if there is no voxel.
    pub fn bounds(&self) -> [[u16; 3]; 2] {
        [self.min, self.max].map(|[x, y, z, _]| [x, y, z])
    }

    /// Adds the sums of another part of the same component.
    pub fn merge(&mut self, other: &VoxelSums) {
        for (a, b) in self.second.iter_mut().zip(other.second) {
            *a += b;
        }
        for (a, b) in self.first.iter_mut().zip(other.first) {
            *a += b;
        }
        self.widen(other.min, other.max);
        self.voxels += other.voxels;
        self.border_euler += other.border_euler;
        self.touches_border |= other.touches_border;
    }
}

/// Fixed-point steps of [`MeshSums::area`] per squared lattice step.
pub const AREA_STEPS: f64 = 65_536.0;

/// Sums over triangles.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct MeshSums {
    /// 6 times the signed volume between the triangles and the origin, in cubed lattice steps.
    pub volume6: i128,
    /// Twice the area in [`AREA_STEPS`] per squared lattice step, rounded for each triangle; with
    /// anisotropic spacing in the scaled units of [`AreaScale`].
    pub area: u128,
    /// Triangles.
    pub triangles: u64,
    /// Lattice vertices, counted in one tile only.
    pub vertices: u64,
    /// Triangle edges on the volume's faces.
    pub border_edges: u64,
    reserved: u64,
}

impl MeshSums {
    /// Adds the sums of another part.
    pub fn merge(&mut self, other: &MeshSums) {
        self.volume6 += other.volume6;
        self.area += other.area;
        self.triangles += other.triangles;
        self.vertices += other.vertices;
        self.border_edges += other.border_edges;
    }

    /// Vertices - edges + triangles: every edge has two triangles but those on the border.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - (self.triangles as i64 + self.border_edges as i64) / 2
    }
}

/// Turns area vectors in lattice steps into fixed-point areas under anisotropic spacing.
///
/// An area vector's x component lies in the y-z plane and scales with sy * sz, and so on. The
/// factors are divided by their largest, so that fixed point never overflows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AreaScale {
    /// Factors of the components, at most 1.
    pub factors: [f64; 3],
    /// Squared units of length per fixed-point step of twice the area.
    pub unit_area: f64,
}

impl AreaScale {
    /// For spacing in any unit; areas come out in that unit squared.
    pub fn new(spacing: [f64; 3]) -> Self {
        let [x, y, z] = spacing;
        let products = [y * z, z * x, x * y];
        let largest = products.iter().fold(0.0, |a: f64, &b| a.max(b));
        let step = f64::from(LATTICE) * f64::from(LATTICE) * AREA_STEPS * 2.0;
        AreaScale {
            factors: products.map(|p| p / largest),
            unit_area: largest / step,
        }
    }

    /// Twice the area of a triangle with area vector `n` (in squared lattice steps, whole numbers), in
    /// steps: a whole number, rounded half up.
    #[inline(always)]
    pub fn twice_area(&self, n: [f32; 3]) -> f64 {
        let along = |a: usize| f64::from(n[a]) * self.factors[a];
        let v = [along(0), along(1), along(2)];
        round((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt() * AREA_STEPS)
    }

    /// The area in squared units of length.
    pub fn area(&self, steps: u128) -> f64 {
        steps as f64 * self.unit_area
    }
}
