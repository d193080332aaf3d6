//! How the surface is oriented, and how long lines run in a phase, from the triangles' area vectors.

use crate::grid::{LATTICE, Placement};
use crate::measure::eigen_symmetric;
use glam::DVec3;
use serde::Serialize;

/// The directions in which lines are laid: the 31 axes of symmetry of an icosahedron. The first three are those of the
/// world.
pub const DIRECTIONS: usize = 31;

/// The orientation of the surface.
///
/// Source: the interface (area) tensor of E. D. Wetzel and C. L. Tucker, International Journal of Multiphase Flow 25,
/// 1999; but for a factor the Minkowski tensor W1 (0, 2) of G. E. Schröder-Turk and others, New Journal of Physics 15,
/// 083028, 2013, whose measure of isotropy is the ratio of eigenvalues.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fabric {
    /// Area of the surface that counts, in the square of the unit of the tables.
    pub area: f64,
    /// The sum over triangles of area times n n^T by that of areas, with the unit normals n, along x, y and z of the world.
    /// Its trace is 1; of a surface that faces all directions alike it is a third of the unit matrix.
    pub tensor: [[f64; 3]; 3],
    /// Its eigenvalues, the greatest first: the share of area that faces each of the three directions.
    pub eigenvalues: [f64; 3],
    /// Its unit eigenvectors in the same order. Bodies are short along the first and long along the last.
    pub eigenvectors: [[f64; 3]; 3],
    /// The least eigenvalue by the greatest: 1 if no direction is preferred, 0 if one is never faced.
    pub isotropy: f64,
}

/// The mean length of the parts of lines that lie in a phase.
///
/// Source: Cauchy's formula, 2 V by the sum of projected areas, A |n . d| (E. E. Underwood, Quantitative Stereology,
/// Addison-Wesley, 1970); the ellipsoid of W. J. Whitehouse, Journal of Microscopy 101, 1974, and
/// T. P. Harrigan and R. W. Mann, Journal of Materials Science 19, 1984.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeanIntercept {
    /// The phase: `cells`.
    pub of: &'static str,
    /// Unit of lengths.
    pub unit: &'static str,
    /// Over lines of all directions: 4 V / A.
    pub mean: f64,
    /// Along lines parallel to x, y and z of the world; absent where no surface faces that direction.
    pub x: Option<f64>,
    #[allow(missing_docs)]
    pub y: Option<f64>,
    #[allow(missing_docs)]
    pub z: Option<f64>,
    /// Semi-axes of the ellipsoid that fits the lengths in 31 directions best, the longest first; absent if none does.
    pub axes: Option<[f64; 3]>,
    /// Their directions, unit vectors in the same order; absent with them.
    pub directions: Option<[[f64; 3]; 3]>,
    /// The longest semi-axis by the shortest: 1 if no direction is preferred; absent with them.
    pub degree_of_anisotropy: Option<f64>,
}

/// Sums over the triangles of a surface.
#[derive(Debug, Clone)]
pub struct FabricSums {
    /// Twice the area.
    area: f64,
    /// Twice the sum of A n n^T: xx, yy, zz, xy, xz, yz.
    tensor: [f64; 6],
    /// Twice the projected areas.
    projected: [f64; DIRECTIONS],
}

impl Default for FabricSums {
    fn default() -> Self {
        FabricSums {
            area: 0.0,
            tensor: [0.0; 6],
            projected: [0.0; DIRECTIONS],
        }
    }
}

/// What turns a triangle on the lattice into its area vector in the world.
#[derive(Debug, Clone, Copy)]
pub struct Space {
    /// The area vectors of the lattice's squares across x, y and z.
    squares: [DVec3; 3],
    directions: [DVec3; DIRECTIONS],
}

impl Space {
    /// For a grid at a place, in its unit.
    pub fn new(place: &Placement) -> Self {
        let axis = |a: usize| DVec3::from(place.directions[a]) * place.spacing[a];
        let [x, y, z] = [0, 1, 2].map(|a| axis(a) / f64::from(LATTICE));
        Space {
            squares: [y.cross(z), z.cross(x), x.cross(y)],
            directions: directions(),
        }
    }
}

/// The axes through the corners, the middles of sides and the middles of edges of an icosahedron, as unit vectors.
fn directions() -> [DVec3; DIRECTIONS] {
    // the golden ratio, its inverse and half of both
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut all = vec![DVec3::X, DVec3::Y, DVec3::Z];
    let turned = |[x, y, z]: [f64; 3]| [[x, y, z], [y, z, x], [z, x, y]];
    for s in [1.0, -1.0] {
        all.extend(turned([0.0, 1.0, s * g]).map(DVec3::from));
        all.extend(turned([0.0, g, s / g]).map(DVec3::from));
        for t in [1.0, -1.0] {
            all.extend(turned([1.0, s / g, t * g]).map(DVec3::from));
            all.push(DVec3::new(1.0, s, t));
        }
    }
    std::array::from_fn(|i| all[i].normalize())
}

impl FabricSums {
    /// Adds a triangle, given by its corners in steps of the lattice.
    #[inline]
    pub fn add(&mut self, corners: [[i32; 3]; 3], space: &Space) {
        let side = |to: usize| -> [i32; 3] {
            std::array::from_fn(|a| corners[to][a].wrapping_sub(corners[0][a]))
        };
        let [u, v] = [side(1), side(2)].map(|s| s.map(f64::from));
        let cross = |a: usize, b: usize| u[a] * v[b] - u[b] * v[a];
        let [x, y, z] = space.squares;
        let n = cross(1, 2) * x + cross(2, 0) * y + cross(0, 1) * z;
        let area = n.length();
        if area == 0.0 {
            return;
        }
        self.area += area;
        let w = n / area;
        let products = [
            n.x * w.x,
            n.y * w.y,
            n.z * w.z,
            n.x * w.y,
            n.x * w.z,
            n.y * w.z,
        ];
        for (sum, product) in self.tensor.iter_mut().zip(products) {
            *sum += product;
        }
        for (sum, d) in self.projected.iter_mut().zip(&space.directions) {
            *sum += n.dot(*d).abs();
        }
    }

    /// Adds the sums over other triangles.
    pub fn merge(&mut self, other: &Self) {
        self.area += other.area;
        for (sum, more) in self.tensor.iter_mut().zip(other.tensor) {
            *sum += more;
        }
        for (sum, more) in self.projected.iter_mut().zip(other.projected) {
            *sum += more;
        }
    }

    /// The orientation; `None` without a surface.
    pub fn fabric(&self) -> Option<Fabric> {
        if self.area.is_nan() || self.area <= 0.0 {
            return None;
        }
        let [xx, yy, zz, xy, xz, yz] = self.tensor.map(|v| v / self.area);
        let tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let eigen = eigen_symmetric(tensor);
        let eigenvalues = eigen.map(|e| e.0.max(0.0));
        Some(Fabric {
            area: self.area / 2.0,
            tensor,
            eigenvalues,
            eigenvectors: eigen.map(|e| one_sign(e.1)),
            isotropy: eigenvalues[2] / eigenvalues[0],
        })
    }

    /// Mean lengths in cells of a volume in all; `None` without a surface or a volume.
    pub fn intercepts(&self, volume: f64, unit: &'static str) -> Option<MeanIntercept> {
        if !(self.area > 0.0 && volume > 0.0) {
            return None;
        }
        let along = |i: usize| {
            let projected = self.projected[i];
            // what faces a direction by rounding alone does not face it
            (projected > 1e-9 * self.area).then(|| 4.0 * volume / projected)
        };
        let ellipsoid = self.ellipsoid(volume);
        let axes = ellipsoid.map(|e| e.map(|(length, _)| length));
        Some(MeanIntercept {
            of: "cells",
            unit,
            mean: 8.0 * volume / self.area,
            x: along(0),
            y: along(1),
            z: along(2),
            axes,
            directions: ellipsoid.map(|e| e.map(|(_, direction)| direction)),
            degree_of_anisotropy: axes.map(|[a, _, c]| a / c),
        })
    }

    /// The ellipsoid d^T M d = 1 / L(d)^2 with the least sum of squares over the directions: its semi-axes and their
    /// directions, the longest first. `None` if it is none.
    fn ellipsoid(&self, volume: f64) -> Option<[(f64, [f64; 3]); 3]> {
        let mut normal = [[0.0; 7]; 6];
        for (d, projected) in directions().iter().zip(self.projected) {
            let inverse = projected / (4.0 * volume);
            let value = inverse * inverse;
            let row = [
                d.x * d.x,
                d.y * d.y,
                d.z * d.z,
                2.0 * d.x * d.y,
                2.0 * d.x * d.z,
                2.0 * d.y * d.z,
            ];
            for i in 0..6 {
                for j in 0..6 {
                    normal[i][j] += row[i] * row[j];
                }
                normal[i][6] += row[i] * value;
            }
        }
        let [xx, yy, zz, xy, xz, yz] = solved(normal)?;
        let eigen = eigen_symmetric([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
        let least = 1e-9 * eigen[0].0;
        if eigen.iter().any(|e| e.0.is_nan() || e.0 <= least) {
            return None;
        }
        // the smallest eigenvalue is of the longest axis
        Some([2, 1, 0].map(|i| (1.0 / eigen[i].0.sqrt(), one_sign(eigen[i].1))))
    }
}

/// A direction of the two opposite ones: the component of largest size is above 0.
fn one_sign(v: [f64; 3]) -> [f64; 3] {
    let largest = v
        .into_iter()
        .fold(0.0, |l: f64, c| if c.abs() > l.abs() { c } else { l });
    // adding 0 turns -0 into 0
    v.map(|c| if largest < 0.0 { -c } else { c } + 0.0)
}

/// Solves six equations by elimination with pivots; `None` if they do not determine six numbers.
fn solved(mut m: [[f64; 7]; 6]) -> Option<[f64; 6]> {
    for i in 0..6 {
        let pivot = (i..6).max_by(|&a, &b| m[a][i].abs().total_cmp(&m[b][i].abs()))?;
        m.swap(i, pivot);
        if m[i][i].is_nan() || m[i][i].abs() < 1e-12 {
            return None;
        }
        for row in 0..6 {
            if row != i {
                let factor = m[row][i] / m[i][i];
                for column in i..7 {
                    m[row][column] -= factor * m[i][column];
                }
            }
        }
    }
    Some(std::array::from_fn(|i| m[i][6] / m[i][i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball_volume(radius: f64) -> f64 {
        4.0 / 3.0 * std::f64::consts::PI * radius * radius * radius
    }

    /// Sums over a surface of triangles between these points on a ball of radius 1, stretched.
    fn ball(stretch: [f64; 3]) -> FabricSums {
        let space = Space::new(&Placement::default());
        let mut sums = FabricSums::default();
        let (rings, steps) = (120, 240);
        let point = |ring: i32, step: i32| -> [i32; 3] {
            let (a, b) = (
                std::f64::consts::PI * f64::from(ring) / f64::from(rings),
                std::f64::consts::TAU * f64::from(step) / f64::from(steps),
            );
            let (sin, cos) = (libm::sin(a), libm::cos(a));
            let p = [sin * libm::cos(b), sin * libm::sin(b), cos];
            std::array::from_fn(|r| (p[r] * stretch[r] * 1e6).round() as i32)
        };
        for ring in 0..rings {
            for step in 0..steps {
                let [a, b] = [point(ring, step), point(ring, step + 1)];
                let [c, d] = [point(ring + 1, step), point(ring + 1, step + 1)];
                sums.add([a, c, d], &space);
                sums.add([a, d, b], &space);
            }
        }
        sums
    }

    #[test]
    fn directions_are_those_of_an_icosahedron() {
        let all = directions();
        for (i, a) in all.iter().enumerate() {
            assert!((a.length() - 1.0).abs() < 1e-12);
            for b in &all[..i] {
                assert!(a.dot(*b).abs() < 0.96, "{a} {b}");
            }
        }
        // none of them is preferred: the sum of d d^T is a multiple of the unit matrix
        let mut sum = [[0.0; 3]; 3];
        for d in all.map(|d| d.to_array()) {
            for i in 0..3 {
                for j in 0..3 {
                    sum[i][j] += d[i] * d[j] * 3.0 / DIRECTIONS as f64;
                }
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((sum[i][j] - expected).abs() < 1e-12, "{sum:?}");
            }
        }
    }

    #[test]
    fn a_ball_has_no_direction() {
        let sums = ball([1.0; 3]);
        let fabric = sums.fabric().unwrap();
        assert!(
            fabric
                .eigenvalues
                .iter()
                .all(|v| (v - 1.0 / 3.0).abs() < 1e-3)
        );
        assert!(fabric.isotropy > 0.998);
        let radius = 1e6 / f64::from(LATTICE);
        let volume = ball_volume(radius);
        let lines = sums.intercepts(volume, "mm").unwrap();
        // 4/3 of the radius, Cauchy
        for length in [Some(lines.mean), lines.x, lines.y, lines.z] {
            let ratio = length.unwrap() / (4.0 / 3.0 * radius);
            assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
        }
        assert!((lines.degree_of_anisotropy.unwrap() - 1.0).abs() < 1e-3);
    }

    #[test]
    fn lines_in_an_ellipsoid_have_its_ratios() {
        let stretch = [1.0, 1.5, 2.5];
        let sums = ball(stretch);
        let radius = 1e6 / f64::from(LATTICE);
        let volume = ball_volume(radius) * 3.75;
        let lines = sums.intercepts(volume, "mm").unwrap();
        let axes = lines.axes.unwrap();
        for (axis, ratio) in axes.into_iter().zip([2.5, 1.5, 1.0]) {
            let found = axis / (4.0 / 3.0 * radius);
            assert!((found / ratio - 1.0).abs() < 2e-3, "{axes:?}");
        }
        assert!((lines.degree_of_anisotropy.unwrap() - 2.5).abs() < 5e-3);
        let longest = lines.directions.unwrap()[0];
        assert!(longest[2] > 0.9999, "{longest:?}");
        // surfaces face the short axis most
        let fabric = sums.fabric().unwrap();
        assert!(fabric.eigenvectors[0][0] > 0.999 && fabric.eigenvectors[2][2] > 0.999);
        let trace: f64 = fabric.eigenvalues.iter().sum();
        assert!((trace - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_plane_gives_no_ellipsoid() {
        let mut sums = FabricSums::default();
        let space = Space::new(&Placement::default());
        sums.add([[0, 0, 0], [256, 0, 0], [0, 256, 0]], &space);
        let fabric = sums.fabric().unwrap();
        assert_eq!(fabric.eigenvalues, [1.0, 0.0, 0.0]);
        assert_eq!(fabric.isotropy, 0.0);
        let lines = sums.intercepts(1.0, "mm").unwrap();
        assert_eq!((lines.x, lines.y), (None, None));
        assert_eq!(lines.z, Some(4.0));
        assert_eq!(lines.axes, None);
        assert_eq!(FabricSums::default().fabric(), None);
    }
}
