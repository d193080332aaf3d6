//! From sums to the measures that users read.

use crate::grid::{LATTICE, Placement};
use crate::measure::eigen::eigen_symmetric;
use crate::measure::{AreaScale, MeshSums, VoxelSums};
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// All sums of one cell or object.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct ComponentRecord {
    /// Over its voxels.
    pub voxels: VoxelSums,
    /// Over the triangles of all its surfaces, oriented from object to cell.
    pub mesh: MeshSums,
    /// Number of its surfaces.
    pub surfaces: u64,
    /// Number of tiles that have triangles of it.
    pub tiles: u64,
    /// Number of other cells of its component that it touches: its surface is open there. 0 where each component is a
    /// cell.
    pub necks: u64,
    reserved: u64,
}

impl ComponentRecord {
    /// Adds voxels of a part of it.
    pub fn add_voxels(&mut self, sums: &VoxelSums) {
        // a record of which nothing is known is zero, which the bounds of no voxels are not
        match self.voxels == VoxelSums::zeroed() {
            true => self.voxels = *sums,
            false if *sums == VoxelSums::zeroed() => {}
            false => self.voxels.merge(sums),
        }
    }

    /// Adds what is known of it elsewhere.
    pub fn merge(&mut self, other: &ComponentRecord) {
        self.add_voxels(&other.voxels);
        self.mesh.merge(&other.mesh);
        self.surfaces += other.surfaces;
        self.tiles += other.tiles;
        self.necks += other.necks;
    }
}

impl SurfaceRecord {
    /// Adds what is known of it elsewhere.
    pub fn merge(&mut self, other: &SurfaceRecord) {
        self.mesh.merge(&other.mesh);
        if self.object == 0 {
            (self.object, self.cell) = (other.object, other.cell);
        }
        self.tiles += other.tiles;
        self.touches_border |= other.touches_border;
    }
}

/// All sums of one surface.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SurfaceRecord {
    /// Over its triangles.
    pub mesh: MeshSums,
    /// Id of its object.
    pub object: u64,
    /// Id of its cell.
    pub cell: u64,
    /// Number of tiles that have triangles of it.
    pub tiles: u64,
    /// 1 if the surface is open: it has an edge on the volume's faces.
    pub touches_border: u64,
}

/// Euler characteristic of a cell or object: a solid's is half that of its boundary, which is its
/// surfaces and its patch of the grid's outer faces; the curves where these meet count 0.
fn euler_of(record: &ComponentRecord) -> i64 {
    (record.mesh.euler_characteristic() + record.voxels.border_euler) / 2
}

/// What is known of a cell, an object or a surface, in physical units (the placement's unit and its
/// powers). `None` where a quantity has no meaning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Number of voxels.
    pub voxels: u64,
    /// Voxels times the size of a voxel.
    pub volume: f64,
    /// Volume inside the triangles; only where these are closed: not at the border, nor where other cells touch it.
    pub mesh_volume: Option<f64>,
    /// Area of the triangles.
    pub area: f64,
    /// Diameter of the ball with this `volume`.
    pub equivalent_diameter: f64,
    /// Area of the ball with this mesh volume over `area` (Wadell 1935): 1 for a ball.
    pub sphericity: Option<f64>,
    /// 36 pi V^2 / A^3, the isoperimetric quotient: the cube of `sphericity`.
    pub form_factor: Option<f64>,
    /// Mean position of the voxels, in world coordinates.
    pub centroid: [f64; 3],
    /// Smallest world coordinates of the voxels' centres.
    pub min: [f64; 3],
    /// Largest ones.
    pub max: [f64; 3],
    /// Semi-axes of the ellipsoid with the same second moments, longest first.
    pub axes: [f64; 3],
    /// Second axis over the first: 1 is round, small is long.
    pub elongation: f64,
    /// Third axis over the second: 1 is round, small is flat.
    pub flatness: f64,
    /// Direction of the longest axis, in world coordinates.
    pub orientation: [f64; 3],
    /// 1 for a ball, 0 for a ring, 2 for a hollow ball; not of a cell that other cells of its component touch.
    pub euler_characteristic: Option<i64>,
    /// True if a voxel lies on the grid's outer faces: the component may go on outside.
    pub touches_border: bool,
    /// Tiles that have triangles of it.
    pub tiles: u64,
}

impl Measures {
    /// Derives the measures of a cell (`sign` -1) or object (`sign` +1).
    pub fn of(record: &ComponentRecord, place: &Placement, above: bool) -> Self {
        let scale = AreaScale::new(place.spacing);
        let voxel_size: f64 = place.spacing.iter().product();
        let sums = &record.voxels;
        let touches_border = sums.touches_border != 0;
        let volume = sums.voxels as f64 * voxel_size;
        let area = scale.area(record.mesh.area);
        let signed = if above {
            record.mesh.volume6
        } else {
            -record.mesh.volume6
        };
        let lattice_cube = (f64::from(LATTICE) * f64::from(LATTICE)) * f64::from(LATTICE);
        let open = touches_border || record.necks > 0;
        let mesh_volume = (!open && record.mesh.triangles > 0)
            .then(|| signed as f64 / 6.0 / lattice_cube * voxel_size);
        let form_factor = mesh_volume.map(|v| 36.0 * PI * v * v / (area * area * area));
        let shape = Shape::of(sums, place);
        let [min, max] = sums.world_box(place);
        Measures {
            voxels: sums.voxels,
            volume,
            mesh_volume,
            area,
            equivalent_diameter: libm::cbrt(6.0 * volume / PI),
            sphericity: form_factor.map(libm::cbrt),
            form_factor,
            centroid: place.world(shape.mean),
            min,
            max,
            axes: shape.axes,
            elongation: shape.axes[1] / shape.axes[0],
            flatness: shape.axes[2] / shape.axes[1],
            orientation: shape.orientation,
            euler_characteristic: (record.necks == 0).then(|| euler_of(record)),
            touches_border,
            tiles: record.tiles,
        }
    }
}

/// What follows from the moments.
struct Shape {
    /// Centroid in voxel coordinates.
    mean: [f64; 3],
    axes: [f64; 3],
    orientation: [f64; 3],
}

impl Shape {
    fn of(sums: &VoxelSums, place: &Placement) -> Self {
        let n = sums.voxels as f64;
        let mean = sums.first.map(|s| s as f64 / n);
        let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        let mut covariance = [[0.0; 3]; 3];
        for (&second, (a, b)) in sums.second.iter().zip(pairs) {
            let value = centred(sums.voxels, second, sums.first[a], sums.first[b]);
            // a voxel is a box, not a point: its own second moment is 1/12
            let own = if a == b { 1.0 / 12.0 } else { 0.0 };
            covariance[a][b] = value + own;
            covariance[b][a] = value + own;
        }
        let to_world = DMat3::from_cols_array_2d(&place.directions)
            * DMat3::from_diagonal(DVec3::from(place.spacing));
        let physical = (to_world * DMat3::from_cols_array_2d(&covariance) * to_world.transpose())
            .to_cols_array_2d();
        let pairs = eigen_symmetric(physical);
        let mut orientation = pairs[0].1;
        // an axis has no sign: let its largest component be positive
        let largest = orientation
            .iter()
            .copied()
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        if largest < 0.0 {
            orientation = orientation.map(|v| -v);
        }
        Shape {
            mean,
            axes: pairs.map(|(l, _)| (5.0 * l.max(0.0)).sqrt()),
            orientation,
        }
    }
}

/// second / n - (a / n)(b / n), exactly while the products fit 128 bits.
fn centred(n: u64, second: u128, a: u64, b: u64) -> f64 {
    let n_f = n as f64;
    let left = u128::from(n)
        .checked_mul(second)
        .and_then(|v| i128::try_from(v).ok());
    let right = u128::from(a)
        .checked_mul(u128::from(b))
        .and_then(|v| i128::try_from(v).ok());
    match (left, right) {
        (Some(l), Some(r)) => (l - r) as f64 / n_f / n_f,
        _ => second as f64 / n_f - (a as f64 / n_f) * (b as f64 / n_f),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Unit};
    use crate::measure::Row;

    #[test]
    fn cube_roots_are_rounded_exactly() {
        // which that of a C library need not be: glibc's has another last bit for each of these
        for (voxels, diameter) in [
            (1, 1.2407009817988),
            (2, 1.563185283593544),
            (3, 1.789400457879299),
            (4, 1.969490043685393),
        ] {
            let mut sums = VoxelSums::default();
            let run = [voxels, voxels * (voxels - 1) / 2, 0];
            sums.add_run(0..voxels as u32, run, &Row::new(0, 0));
            let record = ComponentRecord {
                voxels: sums,
                ..ComponentRecord::default()
            };
            let m = Measures::of(&record, &Placement::default(), true);
            assert_eq!(m.equivalent_diameter, diameter, "{voxels}");
        }
    }

    #[test]
    fn a_box_has_the_moments_of_a_box() {
        let dims = Dims([100, 100, 100]);
        let mut sums = VoxelSums::default();
        for z in 50..58 {
            for y in 20..24 {
                let run = [20, 390, 8270];
                sums.add_run(10..30, run, &Row::new(y, z));
            }
        }
        sums.note_border(dims);
        let place = Placement {
            spacing: [1.0, 2.0, 0.5],
            unit: Unit::Millimetre,
            ..Placement::default()
        };
        let record = ComponentRecord {
            voxels: sums,
            ..ComponentRecord::default()
        };
        let m = Measures::of(&record, &place, true);
        assert_eq!(m.voxels, 640);
        assert_eq!(m.volume, 640.0);
        assert_eq!(m.centroid, [19.5, 43.0, 26.75]);
        assert_eq!((m.min, m.max), ([10.0, 40.0, 25.0], [29.0, 46.0, 28.5]));
        // a box of sides l has variance l^2 / 12, so semi-axis sqrt(5 / 12) l
        for (axis, side) in m.axes.iter().zip([20.0f64, 8.0, 4.0]) {
            assert!(
                (axis - (5.0 / 12.0f64).sqrt() * side).abs() < 1e-9,
                "{:?}",
                m.axes
            );
        }
        assert!((m.orientation[0] - 1.0).abs() < 1e-12);
        assert!(!m.touches_border && m.mesh_volume.is_none());
    }
}
