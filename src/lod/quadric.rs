//! Sums of squared distances to planes, and to lines in a plane, and where they are smallest.
//!
//! Michael Garland and Paul Heckbert: Surface Simplification Using Quadric Error Metrics, 1997; for clusters of
//! vertices Peter Lindstrom: Out-of-Core Simplification of Large Polygonal Models, 2000.

/// How strongly the mean of a cluster's vertices pulls, where planes leave its place open: a part of the trace.
const PULL: f32 = 3e-3;

/// Sum of squared distances to the planes of triangles, weighed by the squares of their areas, as a function of a
/// place relative to `centre`. In voxels.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub struct Quadric {
    /// xx, xy, xz, yy, yz, zz.
    a: [f32; 6],
    b: [f32; 3],
    pub centre: [f32; 3],
    /// Whether triangles are to be added at all.
    pub wanted: bool,
}

/// The plane of a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// Its length is the weight.
    normal: [f32; 3],
    /// A place on it.
    place: [f32; 3],
    /// Of the normal's components: xx, xy, xz, yy, yz, zz.
    products: [f32; 6],
}

impl Plane {
    /// Through a place with a normal whose length is the weight.
    #[inline(always)]
    pub fn new(normal: [f32; 3], place: [f32; 3]) -> Self {
        let [x, y, z] = normal;
        Plane {
            normal,
            place,
            products: [x * x, x * y, x * z, y * y, y * z, z * z],
        }
    }
}

impl Quadric {
    /// That of no triangle, around a place.
    pub fn around(centre: [f32; 3], wanted: bool) -> Self {
        Quadric {
            centre,
            wanted,
            ..Quadric::default()
        }
    }

    /// Adds a plane.
    #[inline(always)]
    pub fn add(&mut self, plane: &Plane) {
        let (n, p, centre) = (plane.normal, plane.place, self.centre);
        let d = n[0] * (p[0] - centre[0]) + n[1] * (p[1] - centre[1]) + n[2] * (p[2] - centre[2]);
        for i in 0..6 {
            self.a[i] += plane.products[i];
        }
        for i in 0..3 {
            self.b[i] += n[i] * d;
        }
    }

    /// The place where the sum is smallest, relative to the centre, pulled to `mean`; the mean if there is no plane.
    pub fn smallest(&self, mean: [f32; 3]) -> [f32; 3] {
        let trace = self.a[0] + self.a[3] + self.a[5];
        if trace <= 1e-12 {
            return mean;
        }
        let pull = PULL * trace;
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let (a, b, c) = (xx + pull, xy, xz);
        let (d, e, f) = (yy + pull, yz, zz + pull);
        let at_mean = self.apply(mean);
        let r: [f32; 3] = std::array::from_fn(|i| self.b[i] - at_mean[i]);
        let (aa, ab, ac) = (d * f - e * e, c * e - b * f, b * e - c * d);
        let (bb, bc, cc) = (a * f - c * c, b * c - a * e, a * d - b * b);
        let determinant = a * aa + b * ab + c * ac;
        // nan as well
        if !(determinant > 0.0 && determinant.is_finite()) {
            return mean;
        }
        [
            mean[0] + (aa * r[0] + ab * r[1] + ac * r[2]) / determinant,
            mean[1] + (ab * r[0] + bb * r[1] + bc * r[2]) / determinant,
            mean[2] + (ac * r[0] + bc * r[1] + cc * r[2]) / determinant,
        ]
    }

    fn apply(&self, x: [f32; 3]) -> [f32; 3] {
        let a = &self.a;
        [
            a[0] * x[0] + a[1] * x[1] + a[2] * x[2],
            a[1] * x[0] + a[3] * x[1] + a[4] * x[2],
            a[2] * x[0] + a[4] * x[1] + a[5] * x[2],
        ]
    }
}

/// Sum of squared distances to lines in a plane, weighed by the squares of their lengths, relative to some place. Whole
/// numbers, since nodes on both sides of a plane add the same lines in other orders.
#[derive(Debug, Clone, Copy, Default)]
pub struct LineQuadric {
    a: [i64; 3],
    b: [i128; 2],
}

impl LineQuadric {
    /// Adds `times` the line through `p` and `q`.
    pub fn add(&mut self, p: [i64; 2], q: [i64; 2], times: i64) {
        let n = [q[1] - p[1], p[0] - q[0]];
        let d = i128::from(n[0]) * i128::from(p[0]) + i128::from(n[1]) * i128::from(p[1]);
        for (sum, product) in self
            .a
            .iter_mut()
            .zip([n[0] * n[0], n[0] * n[1], n[1] * n[1]])
        {
            *sum += times * product;
        }
        for i in 0..2 {
            self.b[i] += i128::from(times) * i128::from(n[i]) * d;
        }
    }

    /// The place where the sum is smallest, pulled to `mean`; the mean if there is no line.
    pub fn smallest(&self, mean: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.a.map(|v| v as f64);
        let b = self.b.map(|v| v as f64);
        let pull = f64::from(PULL) * (xx + yy);
        let (a, d) = (xx + pull, yy + pull);
        let determinant = a * d - xy * xy;
        if determinant <= 0.0 {
            return mean;
        }
        let r = [
            b[0] - xx * mean[0] - xy * mean[1],
            b[1] - xy * mean[0] - yy * mean[1],
        ];
        [
            mean[0] + (d * r[0] - xy * r[1]) / determinant,
            mean[1] + (a * r[1] - xy * r[0]) / determinant,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_the_place() {
        let corner = [0.75, -0.5, 0.25];
        let mut quadric = Quadric::around([1.0, 1.0, 1.0], true);
        for n in [[2.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, -1.0]] {
            quadric.add(&Plane::new(n, corner));
        }
        let mean = [-0.2, -1.4, -0.7];
        let found = quadric.smallest(mean);
        for i in 0..3 {
            assert!((found[i] + 1.0 - corner[i]).abs() < 0.01, "{found:?}");
        }
        // a plane leaves two ways open
        let mut flat = Quadric::around([0.0; 3], true);
        flat.add(&Plane::new([0.0, 0.0, 1.0], [5.0, 5.0, 0.5]));
        let [x, y, z] = flat.smallest([0.3, 0.4, 0.0]);
        assert!((x - 0.3).abs() < 1e-6 && (y - 0.4).abs() < 1e-6 && (z - 0.5).abs() < 0.01);
        assert_eq!(Quadric::default().smallest([1.0; 3]), [1.0; 3]);
    }

    #[test]
    fn two_lines_meet_in_the_place_in_any_order() {
        let lines = [([0, 10], [20, 10]), ([7, -3], [7, 40]), ([0, 0], [0, 0])];
        let sum = |order: &[usize]| {
            let mut quadric = LineQuadric::default();
            for &i in order {
                let (p, q) = lines[i];
                quadric.add(p, q, 1);
            }
            quadric.smallest([5.0, 5.0])
        };
        let found = sum(&[0, 1, 2]);
        // the mean pulls a little, the line of length 20 more than that of 43
        let pull = f64::from(PULL) * (43.0 * 43.0 + 20.0 * 20.0);
        let expected = [(43.0, 7.0), (20.0, 10.0)]
            .map(|(length, at)| at - (at - 5.0) * pull / (length * length + pull));
        assert!(
            (0..2).all(|i| (found[i] - expected[i]).abs() < 1e-9),
            "{found:?}"
        );
        assert_eq!(found, sum(&[2, 1, 0]));
        assert_eq!(sum(&[2]), [5.0, 5.0]);
    }
}
