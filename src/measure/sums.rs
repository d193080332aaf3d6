//! Exact sums over voxels and triangles. They are integers, so the order of adding, and with it
//! threads, tiles and bands, cannot change a result.

use crate::grid::{Dims, Extent, LATTICE, Placement};
use crate::sys::rounding::round;
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
    /// Ends along the axes of the world, of a rotated grid only; see [`VoxelSums::widen_in_world`].
    extent: Extent,
    /// 1 if a voxel lies on the grid's outer faces.
    pub touches_border: u64,
}

/// Three coordinates, the last one twice. Four are loaded and stored at once, of three
/// compilers make two steps.
type Corner = [u16; 4];

impl Default for VoxelSums {
    fn default() -> Self {
        VoxelSums {
            min: [u16::MAX; 4],
            extent: Extent::default(),
            ..VoxelSums::zeroed()
        }
    }
}

/// Sums of 1, k and k^2 for k in 0..n, with n up to 65,536.
#[inline(always)]
pub fn power_sums(n: u32) -> [u64; 3] {
    let n = u64::from(n);
    // 0 is multiplied by 0, whatever the other factor is
    let product = n * n.wrapping_sub(1);
    let squares = product.wrapping_mul((2 * n).wrapping_sub(1)) / 6;
    [n, product / 2, squares]
}

/// What the sums of runs in a row of voxels have in common.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    y: u64,
    z: u64,
    /// yy, zz and yz.
    second: [u64; 3],
}

impl Row {
    /// Row (y, z).
    #[inline(always)]
    pub fn new(y: u32, z: u32) -> Self {
        let (y, z) = (u64::from(y), u64::from(z));
        let second = [y * y, z * z, y * z];
        Row { y, z, second }
    }
}

impl VoxelSums {
    /// Adds the voxels `x`, at least one, of a row. [`power_sums`] tells the sums of what lies before its end
    /// and before its start, `run` is their difference: where one run of a row starts, another has ended.
    ///
    /// Whether the border is touched is left to [`VoxelSums::note_border`].
    #[inline(always)]
    pub fn add_run(&mut self, x: Range<u32>, run: [u64; 3], row: &Row) {
        let [n, sx, sxx] = run;
        self.voxels += n;
        self.first[0] += sx;
        self.first[1] += n * row.y;
        self.first[2] += n * row.z;
        let [yy, zz, yz] = row.second;
        let second = [sxx, n * yy, n * zz, sx * row.y, sx * row.z, n * yz];
        for (sum, add) in self.second.iter_mut().zip(second) {
            *sum += u128::from(add);
        }
        let corner = |x: u32| [x as u16, row.y as u16, row.z as u16, row.z as u16];
        self.widen(corner(x.start), corner(x.end - 1));
    }

    /// Notes whether a voxel lies on the outer faces of a grid of `dims` voxels, which the bounds tell.
    pub fn note_border(&mut self, dims: Dims) {
        let last = |a: usize| u32::from(self.max[a]) + 1 == dims.0[a];
        let border = (0..3).any(|a| self.min[a] == 0 || last(a));
        self.touches_border = u64::from(self.voxels > 0 && border);
    }

    #[inline(always)]
    fn widen(&mut self, low: Corner, high: Corner) {
        for a in 0..4 {
            self.min[a] = self.min[a].min(low[a]);
            self.max[a] = self.max[a].max(high[a]);
        }
    }

    /// Adds the voxels `x`, at least one, of row (y, z) to the ends along the axes of the world.
    pub fn widen_in_world(&mut self, x: Range<u32>, [y, z]: [u32; 2], place: &Placement) {
        for x in [x.start, x.end - 1] {
            self.extent.add(place.step([x, y, z].map(f64::from)));
        }
    }

    /// The box around the voxels' centres in world coordinates, lower and upper ends.
    pub fn world_box(&self, place: &Placement) -> [[f64; 3]; 2] {
        match place.is_rotated() {
            true => self.extent.world(place),
            false => place.box_around(self.bounds().map(|v| v.map(f64::from))),
        }
    }

    /// Smallest and largest coordinates; the latter are below the former if there is no voxel.
    fn bounds(&self) -> [[u16; 3]; 2] {
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
        self.extent.merge(&other.extent);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Voxel by voxel.
    fn slow(runs: &[(Range<u32>, u32, u32)], dims: Dims) -> VoxelSums {
        let mut sums = VoxelSums::default();
        for (x, y, z) in runs {
            for x in x.clone() {
                let v = [x, *y, *z];
                let [x, y, z] = v.map(u128::from);
                for (sum, add) in
                    sums.second
                        .iter_mut()
                        .zip([x * x, y * y, z * z, x * y, x * z, y * z])
                {
                    *sum += add;
                }
                for a in 0..3 {
                    sums.first[a] += u64::from(v[a]);
                    if v[a] == 0 || v[a] + 1 == dims.0[a] {
                        sums.touches_border = 1;
                    }
                }
                sums.voxels += 1;
                let corner = [v[0], v[1], v[2], v[2]].map(|c| c as u16);
                sums.widen(corner, corner);
            }
        }
        sums
    }

    fn fast(runs: &[(Range<u32>, u32, u32)], dims: Dims) -> VoxelSums {
        let mut sums = VoxelSums::default();
        for (x, y, z) in runs {
            let [before, upto] = [x.start, x.end].map(power_sums);
            let run = [0, 1, 2].map(|k| upto[k] - before[k]);
            sums.add_run(x.clone(), run, &Row::new(*y, *z));
        }
        sums.note_border(dims);
        sums
    }

    proptest! {
        #[test]
        fn sums_of_runs_are_those_of_their_voxels(
            runs in prop::collection::vec(([0u32..40, 0u32..9, 0u32..9], 1u32..30), 0..12),
            from in prop::sample::select(vec![0u32, 1, 65_460]), beyond in 0u32..3,
        ) {
            let place = |&([x, y, z], n): &([u32; 3], u32)| (from + x..from + x + n, from + y, from + z);
            let runs: Vec<_> = runs.iter().map(place).collect();
            let dims = Dims([from + 69 + beyond, from + 9 + beyond, from + 9]);
            prop_assert_eq!(fast(&runs, dims), slow(&runs, dims));
        }
    }

    #[test]
    fn the_longest_row_is_summed() {
        let runs = [(0..65_536, 65_535, 65_535)];
        let dims = Dims([65_536; 3]);
        assert_eq!(fast(&runs, dims), slow(&runs, dims));
    }
}
