//! A slow marching cubes for tests, straight from the face rule, and a flood fill.

use alvis::grid::Ambiguous;
use std::collections::BTreeMap;

/// A vertex in lattice units.
pub type Key = [i32; 3];

/// The 12 edges of a cube as pairs of corners; corner c is at (c & 1, c >> 1 & 1, c >> 2).
fn edges() -> Vec<[usize; 2]> {
    (0..8usize)
        .flat_map(|c| [1, 2, 4].map(|bit| [c, c | bit]))
        .filter(|[a, b]| a != b)
        .collect()
}

/// The corners of each face, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// For each of the 256 cases, triangles of edge numbers.
pub struct Table {
    edges: Vec<[usize; 2]>,
    cases: Vec<Vec<[usize; 3]>>,
}

impl Table {
    pub fn new(rule: Ambiguous) -> Self {
        let edges = edges();
        let cases = (0..256)
            .map(|c| triangulate_case(c, rule, &edges))
            .collect();
        Table { edges, cases }
    }
}

fn triangulate_case(case: usize, rule: Ambiguous, edges: &[[usize; 2]]) -> Vec<[usize; 3]> {
    let above = |c: usize| case >> c & 1 == 1;
    let number = |a: usize, b: usize| {
        edges
            .iter()
            .position(|e| *e == [a.min(b), a.max(b)])
            .unwrap()
    };
    let mut next = BTreeMap::new();
    for face in FACES {
        // crossings in the order of the walk: (edge, does the walk enter the above part)
        let crossings: Vec<(usize, bool)> = (0..4)
            .map(|i| (face[i], face[(i + 1) % 4]))
            .filter(|&(a, b)| above(a) != above(b))
            .map(|(a, b)| (number(a, b), above(b)))
            .collect();
        let n = crossings.len();
        for (i, &(edge, enters)) in crossings.iter().enumerate() {
            if enters {
                let step = if rule == Ambiguous::Separate {
                    1
                } else {
                    n - 1
                };
                next.insert(edge, crossings[(i + step) % n].0);
            }
        }
    }
    let mut out = Vec::new();
    while let Some((&start, _)) = next.iter().next() {
        let mut ring = vec![start];
        let mut at = next.remove(&start).unwrap();
        while at != start {
            ring.push(at);
            at = next.remove(&at).unwrap();
        }
        let faces_below = |t: [usize; 3]| faces_below(t.map(|e| edges[e]), case);
        out.extend(triangulate(&ring, edges, &faces_below).expect("each loop can be triangulated"));
    }
    out
}

fn on_one_face(a: [usize; 2], b: [usize; 2]) -> bool {
    FACES
        .iter()
        .any(|f| a.iter().chain(&b).all(|c| f.contains(c)))
}

/// True if the triangle's area vector never points from below to above along one of its edges,
/// wherever on them its corners lie. Its components are linear in each corner's place on its edge,
/// so the ends of the edges decide.
fn faces_below(t: [[usize; 2]; 3], case: usize) -> bool {
    (0..8).all(|ends| {
        let corner = |i: usize| {
            let c = t[i][ends >> i & 1];
            [0, 1, 2].map(|a| (c >> a & 1) as i32)
        };
        let n = cross(&[corner(0), corner(1), corner(2)]);
        t.iter().all(|[a, b]| {
            let axis = (a ^ b).trailing_zeros() as usize;
            let up = if case >> a & 1 == 1 { 1 } else { -1 };
            n[axis] * up >= 0
        })
    })
}

/// Twice the area of a triangle along its normal.
pub fn cross(t: &[Key; 3]) -> [i64; 3] {
    let [e, f] = [1, 2].map(|i| [0, 1, 2].map(|a| i64::from(t[i][a] - t[0][a])));
    [
        e[1] * f[2] - e[2] * f[1],
        e[2] * f[0] - e[0] * f[2],
        e[0] * f[1] - e[1] * f[0],
    ]
}

/// Cuts ears until three corners are left, never along a chord in a face of the cube.
fn triangulate(
    ring: &[usize],
    edges: &[[usize; 2]],
    fits: &dyn Fn([usize; 3]) -> bool,
) -> Option<Vec<[usize; 3]>> {
    if let [a, b, c] = *ring {
        return fits([a, b, c]).then(|| vec![[a, b, c]]);
    }
    let n = ring.len();
    for i in 0..n {
        let (before, after) = (ring[(i + n - 1) % n], ring[(i + 1) % n]);
        let ear = [before, ring[i], after];
        if on_one_face(edges[before], edges[after]) || !fits(ear) {
            continue;
        }
        let mut rest = ring.to_vec();
        rest.remove(i);
        if let Some(mut out) = triangulate(&rest, edges, fits) {
            out.push(ear);
            return Some(out);
        }
    }
    None
}

/// A sampled box for tests, x fastest.
#[derive(Clone, Debug)]
pub struct Field {
    pub dims: [usize; 3],
    pub values: Vec<f32>,
    pub threshold: f64,
}

impl Field {
    fn index(&self, [x, y, z]: [i64; 3]) -> Option<usize> {
        let inside = [x, y, z]
            .iter()
            .zip(self.dims)
            .all(|(&v, n)| v >= 0 && v < n as i64);
        inside.then(|| x as usize + self.dims[0] * (y as usize + self.dims[1] * z as usize))
    }

    /// Outside counts as below.
    pub fn above(&self, p: [i64; 3]) -> bool {
        self.index(p)
            .is_some_and(|i| f64::from(self.values[i]) >= self.threshold)
    }

    /// The vertex on the edge from `p` along `axis`.
    fn vertex(&self, p: [i64; 3], axis: usize) -> Key {
        let mut q = p;
        q[axis] += 1;
        let step = match (self.index(p), self.index(q)) {
            (Some(i), Some(j)) => {
                let (v, w) = (f64::from(self.values[i]), f64::from(self.values[j]));
                let t = 256.0 * (self.threshold - v) / (w - v);
                if t.is_finite() {
                    t.round().clamp(1.0, 255.0) as i32
                } else {
                    128
                }
            }
            _ => 128,
        };
        let mut key = p.map(|c| c as i32 * 256);
        key[axis] += step;
        key
    }

    /// Against the gradient at a vertex, of unit length; along its edge where the gradient vanishes or there is none.
    pub fn normal(&self, key: Key) -> [f32; 3] {
        let axis = (0..3).find(|&a| key[a] & 255 != 0).unwrap();
        let low = key.map(|c| i64::from(c >> 8));
        let mut high = low;
        high[axis] += 1;
        let t = f64::from(key[axis] & 255) / 256.0;
        let n = self.gradient(low).zip(self.gradient(high)).map(|(g, h)| {
            let n: [f64; 3] = std::array::from_fn(|a| -(g[a] + (h[a] - g[a]) * t));
            (n, n.iter().map(|c| c * c).sum::<f64>().sqrt())
        });
        match n {
            Some((n, length)) if length > 0.0 => n.map(|c| (c / length) as f32),
            _ => {
                let down = if self.above(low) { 1.0 } else { -1.0 };
                std::array::from_fn(|a| if a == axis { down } else { 0.0 })
            }
        }
    }

    fn gradient(&self, p: [i64; 3]) -> Option<[f64; 3]> {
        let value = |p| self.index(p).map(|i| f64::from(self.values[i]));
        let own = value(p)?;
        Some(std::array::from_fn(|a| {
            let beside = |step| {
                let mut q = p;
                q[a] += step;
                value(q)
            };
            match (beside(-1), beside(1)) {
                (Some(v), Some(w)) => (w - v) / 2.0,
                (v, w) => w.unwrap_or(own) - v.unwrap_or(own),
            }
        }))
    }

    /// Labels 1..n by the smallest linear index of the voxels of one phase; 0 elsewhere.
    pub fn label(&self, phase: bool, eighteen: bool) -> Vec<u64> {
        let mut labels = vec![0; self.values.len()];
        let mut next = 0;
        let place = |i: usize| {
            let [nx, ny, _] = self.dims;
            [i % nx, i / nx % ny, i / nx / ny].map(|c| c as i64)
        };
        for seed in 0..labels.len() {
            if labels[seed] != 0 || self.above(place(seed)) != phase {
                continue;
            }
            next += 1;
            labels[seed] = next;
            let mut stack = vec![seed];
            while let Some(i) = stack.pop() {
                for d in 0..27 {
                    let step = [d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1];
                    let far = step.iter().map(|s: &i64| s.abs()).sum::<i64>();
                    if far == 0 || far > if eighteen { 2 } else { 1 } {
                        continue;
                    }
                    let p = place(i);
                    let q = std::array::from_fn(|a| p[a] + step[a]);
                    if let Some(j) = self.index(q)
                        && labels[j] == 0
                        && self.above(q) == phase
                    {
                        labels[j] = next;
                        stack.push(j);
                    }
                }
            }
        }
        labels
    }
}

/// A triangle with the labels of the phases it separates.
pub struct Triangle {
    pub keys: [Key; 3],
    /// 0 for a cap.
    pub cell: u64,
    pub object: u64,
}

/// The triangles of one cube.
pub fn cube(field: &Field, table: &Table, labels: &[Vec<u64>; 2], at: [i64; 3]) -> Vec<Triangle> {
    let corner = |c: usize| [0, 1, 2].map(|a| at[a] + (c >> a & 1) as i64);
    let case = (0..8)
        .filter(|&c| field.above(corner(c)))
        .map(|c| 1 << c)
        .sum::<usize>();
    let cap = (0..8).any(|c| field.index(corner(c)).is_none());
    let end = |e: usize, above: bool| {
        let [a, b] = table.edges[e].map(corner);
        if field.above(a) == above { a } else { b }
    };
    let key = |e: usize| {
        let [a, b] = table.edges[e];
        field.vertex(corner(a), (a ^ b).trailing_zeros() as usize)
    };
    let label = |phase: usize, e: usize| labels[phase][field.index(end(e, phase == 1)).unwrap()];
    table.cases[case]
        .iter()
        .map(|t| Triangle {
            keys: t.map(key),
            cell: if cap { 0 } else { label(0, t[0]) },
            object: label(1, t[0]),
        })
        .collect()
}
