//! Measures of a body of voxels, added up voxel by voxel, as tables and tiles state them.

use crate::writer::SPACING;
use std::collections::HashSet;
use std::f64::consts::PI;

/// The columns of `cells.csv` and `objects.csv`, in millimetres.
pub const HEADER: &str = "id,voxels,volume [mm^3],mesh_volume [mm^3],area [mm^2],equivalent_diameter [mm],sphericity,form_factor,centroid_x [mm],centroid_y [mm],centroid_z [mm],min_x [mm],min_y [mm],min_z [mm],max_x [mm],max_y [mm],max_z [mm],axis_a [mm],axis_b [mm],axis_c [mm],elongation,flatness,orientation_x,orientation_y,orientation_z,euler_characteristic,touches_border,tiles";

/// A body: its voxels, what its triangles add up to, and how its voxels hang together.
pub struct Body {
    pub voxels: Vec<[i64; 3]>,
    pub dims: [usize; 3],
    pub mesh_volume: f64,
    pub area: f64,
    pub tiles: usize,
    /// True if voxels that share an edge are joined (18), false if they must share a face (6).
    pub by_edges: bool,
}

impl Body {
    pub fn touches(&self) -> bool {
        let on = |v: &[i64; 3]| (0..3).any(|a| v[a] == 0 || v[a] + 1 == self.dims[a] as i64);
        self.voxels.iter().any(on)
    }

    /// A row of the table.
    pub fn row(&self, id: u64) -> Vec<String> {
        let n = self.voxels.len() as f64;
        let volume = n * SPACING.iter().product::<f64>();
        let place =
            |v: &[i64; 3]| -> [f64; 3] { std::array::from_fn(|a| v[a] as f64 * SPACING[a]) };
        let mean: [f64; 3] =
            std::array::from_fn(|a| self.voxels.iter().map(|v| place(v)[a]).sum::<f64>() / n);
        let bound = |pick: fn(f64, f64) -> f64, start: f64| -> [f64; 3] {
            std::array::from_fn(|a| self.voxels.iter().map(|v| place(v)[a]).fold(start, pick))
        };
        let mut m = [[0.0; 3]; 3];
        for v in &self.voxels {
            let p = place(v);
            for i in 0..3 {
                for j in 0..3 {
                    m[i][j] += (p[i] - mean[i]) * (p[j] - mean[j]) / n;
                }
            }
        }
        for a in 0..3 {
            m[a][a] += SPACING[a] * SPACING[a] / 12.0;
        }
        let (values, way) = eigen(m);
        let axes = values.map(|v| (5.0 * v).sqrt());
        let mesh = (!self.touches()).then_some(self.mesh_volume);
        let form = mesh.map(|v| 36.0 * PI * v * v / self.area.powi(3));
        let text = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
        let mut row = vec![
            id.to_string(),
            self.voxels.len().to_string(),
            volume.to_string(),
        ];
        row.extend([text(mesh), self.area.to_string()]);
        row.push((6.0 * volume / PI).cbrt().to_string());
        row.extend([text(form.map(f64::cbrt)), text(form)]);
        for triple in [
            mean,
            bound(f64::min, f64::MAX),
            bound(f64::max, f64::MIN),
            axes,
        ] {
            row.extend(triple.map(|v| v.to_string()));
        }
        row.extend([axes[1] / axes[0], axes[2] / axes[1]].map(|v| v.to_string()));
        row.extend(way.map(|v| v.to_string()));
        row.push(self.euler().to_string());
        row.push(u8::from(self.touches()).to_string());
        row.push(self.tiles.to_string());
        row
    }

    /// Euler characteristic of the union of voxels: as closed boxes in which corners join nothing, or
    /// as points with edges, squares and cubes between those that share a face.
    fn euler(&self) -> i64 {
        let set: HashSet<[i64; 3]> = self.voxels.iter().copied().collect();
        let at = |p: [i64; 3], d: [i64; 3]| [p[0] + d[0], p[1] + d[1], p[2] + d[2]];
        let block = |d: [i64; 3], back: i64| {
            let mut out = Vec::new();
            for z in 0..=d[2] {
                for y in 0..=d[1] {
                    out.extend((0..=d[0]).map(|x| [x, y, z].map(|c| c * back)));
                }
            }
            out
        };
        let shapes: Vec<[i64; 3]> = block([1, 1, 1], 1);
        if !self.by_edges {
            let full = |d: &[i64; 3]| {
                let inside =
                    |p: &&[i64; 3]| block(*d, 1).iter().all(|o| set.contains(&at(**p, *o)));
                set.iter().filter(inside).count() as i64
            };
            let sign = |d: &[i64; 3]| 1 - d.iter().sum::<i64>() % 2 * 2;
            let plain: i64 = shapes.iter().map(|d| sign(d) * full(d)).sum();
            // six voxels around a point that lack two opposite ones are a ring, which is filled: what
            // shares a corner only is apart
            let around = |p: [i64; 3]| block([1; 3], 1).into_iter().map(move |o| at(p, o));
            let lacking = |p: [i64; 3]| around(p).filter(|v| !set.contains(v)).collect::<Vec<_>>();
            let ring = |p: &[i64; 3]| match lacking(*p)[..] {
                [a, b] => (0..3).all(|i| a[i] != b[i]),
                _ => false,
            };
            let corners: HashSet<[i64; 3]> = set
                .iter()
                .flat_map(|v| block([1; 3], -1).into_iter().map(|o| at(*v, o)))
                .collect();
            return plain + corners.iter().filter(|p| ring(p)).count() as i64;
        }
        // a lattice point, edge, square or cube of the closed boxes, named by its lowest voxel corner and
        // the axes along which it has no extent
        let mut total = 0;
        for flat in &shapes {
            let sign = if (3 - flat.iter().sum::<i64>()) % 2 == 0 {
                1
            } else {
                -1
            };
            let mut seen = HashSet::new();
            for v in &set {
                seen.extend(block(*flat, 1).into_iter().map(|o| at(*v, o)));
            }
            for p in seen {
                let around: Vec<[i64; 3]> = block(*flat, -1)
                    .into_iter()
                    .map(|o| at(p, o))
                    .filter(|v| set.contains(v))
                    .collect();
                total += sign * if *flat == [1; 3] { parts(&around) } else { 1 };
            }
        }
        total
    }
}

/// Parts of the voxels around a point, of which two that share an edge or a face are one.
fn parts(voxels: &[[i64; 3]]) -> i64 {
    let near = |a: &[i64; 3], b: &[i64; 3]| (0..3).map(|i| (a[i] - b[i]).abs()).sum::<i64>() <= 2;
    let mut left: Vec<[i64; 3]> = voxels.to_vec();
    let mut count = 0;
    while let Some(first) = left.pop() {
        let mut part = vec![first];
        while let Some(v) = part.pop() {
            let (joined, rest) = left.into_iter().partition(|w| near(&v, w));
            part.extend::<Vec<[i64; 3]>>(joined);
            left = rest;
        }
        count += 1;
    }
    count
}

/// Eigenvalues by falling size, and the first one's vector with its largest component positive.
fn eigen(mut m: [[f64; 3]; 3]) -> ([f64; 3], [f64; 3]) {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..60 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let angle: f64 = 0.5 * (2.0 * m[p][q]).atan2(m[q][q] - m[p][p]);
            let (s, c) = angle.sin_cos();
            for k in 0..3 {
                let (a, b) = (m[k][p], m[k][q]);
                (m[k][p], m[k][q]) = (c * a - s * b, s * a + c * b);
                let (a, b) = (v[k][p], v[k][q]);
                (v[k][p], v[k][q]) = (c * a - s * b, s * a + c * b);
            }
            for k in 0..3 {
                let (a, b) = (m[p][k], m[q][k]);
                (m[p][k], m[q][k]) = (c * a - s * b, s * a + c * b);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| m[b][b].total_cmp(&m[a][a]));
    let first = order[0];
    let mut way: [f64; 3] = std::array::from_fn(|k| v[k][first]);
    let largest = way
        .iter()
        .copied()
        .fold(0.0, |l: f64, c| if c.abs() > l.abs() { c } else { l });
    if largest < 0.0 {
        way = way.map(|c| -c);
    }
    (order.map(|i| m[i][i]), way)
}
