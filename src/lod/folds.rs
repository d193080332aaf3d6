//! Triangles that face against the normals of all their corners: where surfaces are thinner than blocks, some turn over.
//! A vertex that moves to the middle of its neighbours turns most of them back; where none does, normals follow the
//! triangles.

use super::planes::Planes;
use glam::DVec3;

/// How often vertices are moved.
const ROUNDS: u32 = 3;
/// Of the way to the middle of the neighbours.
const SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// The length of a normal that has followed.
const LENGTH: f64 = super::mesh::NORMAL as f64;

/// A mesh whose folds are to be smoothed.
pub struct Folded<'a> {
    /// In lattice steps.
    pub points: &'a mut [[i32; 3]],
    /// Of any length.
    pub normals: &'a mut [[i64; 3]],
    pub triangles: &'a [[u32; 3]],
    /// Vertices that may move.
    pub is_free: &'a dyn Fn(u32) -> bool,
    pub planes: &'a Planes,
    /// Vertices lie on multiples of so many lattice steps.
    pub step: i32,
    /// How far a vertex may move, in lattice steps.
    pub most: f64,
}

/// A vertex and the triangles around it.
#[derive(Debug)]
struct Star {
    vertex: u32,
    triangles: Vec<[u32; 3]>,
}

impl Folded<'_> {
    /// Smooths what is folded.
    pub fn smooth(&mut self) {
        let mut stars = self.stars();
        for _ in 0..ROUNDS {
            stars.retain(|star| self.against(star) > 0);
            for star in &stars {
                self.move_it(star);
            }
        }
        for star in &stars {
            self.turn_normal(star);
        }
    }

    /// The free corners of folded triangles.
    fn stars(&self) -> Vec<Star> {
        const NONE: u32 = u32::MAX;
        let mut numbers = vec![NONE; self.points.len()];
        let mut stars: Vec<Star> = Vec::new();
        for t in self.triangles.iter().filter(|t| self.is_against(**t)) {
            for &v in t {
                if numbers[v as usize] == NONE && (self.is_free)(v) {
                    numbers[v as usize] = stars.len() as u32;
                    stars.push(Star {
                        vertex: v,
                        triangles: Vec::new(),
                    });
                }
            }
        }
        if !stars.is_empty() {
            for t in self.triangles {
                for &v in t.iter().filter(|v| numbers[**v as usize] != NONE) {
                    stars[numbers[v as usize] as usize].triangles.push(*t);
                }
            }
        }
        stars
    }

    fn place(&self, v: u32) -> DVec3 {
        self.points[v as usize].map(f64::from).into()
    }

    fn face(&self, t: [u32; 3]) -> DVec3 {
        let [p, q, r] = t.map(|v| self.place(v));
        (q - p).cross(r - p)
    }

    fn is_against(&self, t: [u32; 3]) -> bool {
        let face = self.face(t);
        let normal = |v: u32| DVec3::from(self.normals[v as usize].map(|c| c as f64));
        t.iter().all(|&v| face.dot(normal(v)) < 0.0)
    }

    fn against(&self, star: &Star) -> usize {
        let all = star.triangles.iter();
        all.filter(|t| self.is_against(**t)).count()
    }

    /// Moves a vertex towards the middle of its neighbours, no further than it takes that fewer triangles are folded.
    fn move_it(&mut self, star: &Star) {
        let others = || {
            star.triangles
                .iter()
                .flatten()
                .filter(|&&w| w != star.vertex)
        };
        let middle = others().map(|&w| self.place(w)).sum::<DVec3>() / others().count() as f64;
        let old = self.points[star.vertex as usize];
        let before = self.against(star);
        for share in SHARES {
            let wanted = self.place(star.vertex).lerp(middle, share);
            let at = |a: usize| self.planes.between(a, wanted[a], self.step);
            let new: [i32; 3] = std::array::from_fn(at);
            let is_far =
                DVec3::from(new.map(f64::from)).distance(self.place(star.vertex)) > self.most;
            if is_far || others().any(|&w| self.points[w as usize] == new) {
                continue;
            }
            self.points[star.vertex as usize] = new;
            let is_line = |t: &[u32; 3]| self.face(*t) == DVec3::ZERO;
            if self.against(star) < before && !star.triangles.iter().any(is_line) {
                return;
            }
            self.points[star.vertex as usize] = old;
        }
    }

    /// Gives a vertex the mean normal of its triangles, if fewer face against theirs then.
    fn turn_normal(&mut self, star: &Star) {
        let before = self.against(star);
        let sum: DVec3 = star.triangles.iter().map(|t| self.face(*t)).sum();
        if before == 0 || sum == DVec3::ZERO {
            return;
        }
        let new = (sum.normalize() * LENGTH).to_array().map(|c| c as i64);
        let normal = &mut self.normals[star.vertex as usize];
        let old = std::mem::replace(normal, new);
        if self.against(star) >= before {
            self.normals[star.vertex as usize] = old;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Tiling};

    /// A flat fan of six triangles around vertex 0, which has moved beyond an edge of it.
    #[test]
    fn a_vertex_beyond_its_neighbours_comes_back() {
        let around = [[8, 0], [4, 7], [-4, 7], [-8, 0], [-4, -7], [4, -7]];
        let at = |[x, y]: [i32; 2]| [(x + 20) * 256, (y + 20) * 256, 20 * 256];
        let mut points = vec![at([14, 4])];
        points.extend(around.map(at));
        let mut normals = vec![[0, 0, 32_767]; 7];
        let triangles: Vec<[u32; 3]> = (0..6).map(|i| [0, 1 + i, 1 + (i + 1) % 6]).collect();
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let mut smooth = |is_free: &dyn Fn(u32) -> bool, points: &mut [[i32; 3]]| {
            let mut folded = Folded {
                points,
                normals: &mut normals,
                triangles: &triangles,
                is_free,
                planes: &Planes::of(tiling, 1, [0; 3]),
                step: 4,
                most: 20.0 * 256.0,
            };
            folded.smooth();
            triangles.iter().filter(|t| folded.is_against(**t)).count()
        };
        let before = points.clone();
        assert_eq!(smooth(&|_| false, &mut points), 2);
        assert_eq!(points, before);
        assert_eq!(smooth(&|v| v == 0, &mut points), 0);
        assert!(points[0] != before[0] && points[1..] == before[1..]);
    }
}
