//! From the voxel grid to physical space, in the unit of the tile set.

use super::sheet::Sheet;
use crate::grid::{Dims, LATTICE, Placement};
use glam::{DMat3, DVec3};

/// Takes lattice points and normals to physical space.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    origin: DVec3,
    /// One lattice step along each axis.
    step: DMat3,
    /// Of normals: the inverse transpose.
    normal: DMat3,
    /// True if the grid is mirrored, which turns triangles inside out.
    pub mirrored: bool,
    /// True if `f32` tells neighbouring lattice points apart everywhere in the grid.
    pub single: bool,
}

impl Space {
    /// The space of a grid.
    pub fn new(placement: &Placement, dims: Dims) -> Self {
        let Placement {
            spacing,
            origin,
            directions,
            ..
        } = *placement;
        let axes =
            DMat3::from_cols_array_2d(&directions) * DMat3::from_diagonal(DVec3::from(spacing));
        let origin = DVec3::from(origin);
        let mut farthest = 0.0f64;
        for corner in 0..8 {
            let end = |a: usize| match corner >> a & 1 {
                0 => -0.5,
                _ => f64::from(dims.0[a]) - 0.5,
            };
            let at = origin + axes * DVec3::new(end(0), end(1), end(2));
            farthest = farthest.max(at.abs().max_element());
        }
        let least = spacing.into_iter().fold(f64::INFINITY, f64::min) / f64::from(LATTICE);
        // distance of neighbouring floats there
        let coarse = farthest * f64::from(f32::EPSILON);
        Space {
            origin,
            step: axes * (1.0 / f64::from(LATTICE)),
            normal: axes.inverse().transpose(),
            mirrored: axes.determinant() < 0.0,
            single: 2.0 * coarse <= least,
        }
    }

    /// The position of a vertex.
    pub fn position(&self, point: [i32; 3]) -> DVec3 {
        self.origin + self.step * DVec3::from(point.map(f64::from))
    }

    /// The unit normal of a vertex, from above to below.
    pub fn normal(&self, normal: [f32; 3]) -> [f32; 3] {
        let turned = self.normal * DVec3::from(normal.map(f64::from));
        turned.normalize_or_zero().as_vec3().into()
    }

    /// The triangle with its corners counter-clockwise seen from the below side.
    pub fn turned(&self, [a, b, c]: [u32; 3]) -> [u32; 3] {
        if self.mirrored { [a, c, b] } else { [a, b, c] }
    }

    /// The corners of a triangle of a sheet, counter-clockwise seen from the below side.
    pub fn corners(&self, sheet: &Sheet, triangle: [u32; 3]) -> [DVec3; 3] {
        self.turned(triangle)
            .map(|i| self.position(sheet.points[i as usize]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;

    #[test]
    fn points_and_normals_go_where_the_placement_says() {
        let placement = Placement {
            spacing: [0.5, 1.0, 2.0],
            unit: Unit::Millimetre,
            origin: [10.0, -20.0, 30.0],
            directions: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let space = Space::new(&placement, Dims([4; 3]));
        assert!(space.single && !space.mirrored);
        let point = [256, 128, 64];
        let world = placement.world([1.0, 0.5, 0.25]);
        assert!(space.position(point).abs_diff_eq(world.into(), 1e-12));
        // the plane x + z = 0 in voxels is 2 x' + z' / 2 = 0 before it is turned
        let n = DVec3::from(
            space
                .normal([0.5f32.sqrt(), 0.0, 0.5f32.sqrt()])
                .map(f64::from),
        );
        assert!(
            n.abs_diff_eq(DVec3::new(0.0, 2.0, 0.5).normalize(), 1e-6),
            "{n}"
        );
        assert_eq!(space.turned([1, 2, 3]), [1, 2, 3]);
    }

    #[test]
    fn mirrored_grids_and_far_origins_are_seen() {
        let flip = Placement {
            directions: [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            ..Placement::default()
        };
        let space = Space::new(&flip, Dims([4; 3]));
        assert!(space.mirrored);
        assert_eq!(space.turned([1, 2, 3]), [1, 3, 2]);
        let far = Placement {
            origin: [0.0, 1e6, 0.0],
            ..Placement::default()
        };
        assert!(!Space::new(&far, Dims([4; 3])).single);
    }
}
