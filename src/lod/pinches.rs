//! Edges along which a surface touches itself, as where it has been led to a line around a thin neck: more than two
//! triangles meet there, which programs that walk from triangle to triangle cannot follow. Two of the triangles keep such an
//! edge, the others get a new vertex beside its middle, two by two, so that what is closed stays closed.

use super::planes::{OnPlanes, Planes};
use glam::DVec3;
use std::collections::HashSet;

/// How often edges are looked at: those of triangles that have been changed wait for the next time.
const ROUNDS: u32 = 4;
/// How far new vertices lie from the edge in steps, so that rounding leaves them off it; further where a corner lies.
const AWAY: [f64; 4] = [1.5, 2.5, 4.0, 0.75];

/// Triangles whose edges are to be taken apart.
pub struct Pinched<'a> {
    /// In lattice steps; new vertices come behind.
    pub points: &'a mut Vec<[i32; 3]>,
    pub triangles: &'a mut Vec<[u32; 3]>,
    pub planes: &'a Planes,
    /// New vertices lie on multiples of so many lattice steps.
    pub step: i32,
}

/// A new vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Added {
    /// A vertex of its surface.
    pub beside: u32,
    /// Of its two triangles.
    pub normal: DVec3,
}

/// An edge of a triangle, at the smaller of its ends.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// The larger end.
    other: u32,
    /// True if it runs to the larger end.
    rises: bool,
    triangle: u32,
}

/// An edge of more than two triangles.
#[derive(Debug)]
struct Crowded {
    ends: [u32; 2],
    /// The triangles along which it runs from the first to the second end, and the others.
    sides: [Vec<u32>; 2],
}

impl Pinched<'_> {
    /// Takes edges of more than two triangles apart; returns the new vertices in their order.
    pub fn part(&mut self) -> Vec<Added> {
        let mut added = Vec::new();
        let mut wanted = self.suspects();
        for _ in 0..ROUNDS {
            let mut changed: HashSet<u32> = HashSet::new();
            let mut later = Vec::new();
            for edge in crowded(self.triangles, &wanted) {
                let all = || edge.sides.iter().flatten().copied();
                if self.is_of_cap(edge.ends) {
                    continue;
                }
                if all().any(|t| changed.contains(&t)) {
                    later.push(edge.ends[0]);
                } else {
                    changed.extend(all());
                    self.part_edge(edge, &mut added);
                }
            }
            if later.is_empty() {
                break;
            }
            wanted = vec![false; self.points.len()];
            later.into_iter().for_each(|v| wanted[v as usize] = true);
        }
        added
    }

    /// The smaller ends of edges that may have more than two triangles. Inside, as many run along an edge as against it,
    /// so to look at one way is enough.
    fn suspects(&self) -> Vec<bool> {
        let on: Vec<OnPlanes> = self.points.iter().map(|p| self.planes.bits(*p)).collect();
        let mut ends = vec![0u32; on.len()];
        let mut in_planes: Vec<[u32; 2]> = Vec::new();
        let each = |f: &mut dyn FnMut(u32, u32)| {
            for &[a, b, c] in self.triangles.iter() {
                f(a, b);
                f(b, c);
                f(c, a);
            }
        };
        each(&mut |a, b| {
            ends[a as usize] += u32::from(a < b);
            if on[a as usize] & on[b as usize] != 0 {
                in_planes.push([a.min(b), a.max(b)]);
            }
        });
        let mut others = vec![0u32; starts(&mut ends)];
        each(&mut |a, b| {
            if a < b {
                let end = &mut ends[a as usize];
                others[*end as usize] = b;
                *end += 1;
            }
        });
        let mut found = vec![false; on.len()];
        let mut start = 0;
        for (v, end) in ends.into_iter().enumerate() {
            let own = &mut others[start..end as usize];
            start = end as usize;
            own.sort_unstable();
            found[v] = own.windows(2).any(|w| w[0] == w[1]);
        }
        in_planes.sort_unstable();
        for same in in_planes.chunk_by(|a, b| a == b) {
            found[same[0][0] as usize] |= same.len() > 2;
        }
        found
    }

    /// True for an edge of a cap, which lies outside of the volume, where new vertices must not lie.
    fn is_of_cap(&self, ends: [u32; 2]) -> bool {
        let Planes { low, high, .. } = self.planes;
        let is_outside = |v: u32| {
            let p = self.points[v as usize];
            (0..3).any(|a| p[a] < low[a] || p[a] > high[a])
        };
        ends.into_iter().any(is_outside)
    }

    /// Pairs the triangles of an edge, those that are nearest to each other first, and gives all pairs but one a vertex
    /// of their own; all of them if the edge is one of the border, which has a triangle more on one side.
    fn part_edge(&mut self, edge: Crowded, added: &mut Vec<Added>) {
        let [mut along, mut against] = edge.sides;
        let is_open = along.len() != against.len();
        let mut keeps_edge = !is_open;
        while let Some(pair) = self.nearest(edge.ends, &along, &against) {
            along.retain(|t| *t != pair[0]);
            against.retain(|t| *t != pair[1]);
            if !(keeps_edge && along.is_empty()) {
                self.split(edge.ends, pair, added);
            }
            keeps_edge &= !along.is_empty();
        }
    }

    /// The pair of triangles with the smallest angle between them; the first of equal ones.
    fn nearest(&self, ends: [u32; 2], along: &[u32], against: &[u32]) -> Option<[u32; 2]> {
        let mut best: Option<(f64, [u32; 2])> = None;
        for &t in along {
            for &u in against {
                let cosine = self.away(ends, t).dot(self.away(ends, u));
                if best.is_none_or(|(most, _)| cosine > most) {
                    best = Some((cosine, [t, u]));
                }
            }
        }
        Some(best?.1)
    }

    /// The direction from an edge to the third corner of a triangle, across the edge.
    fn away(&self, ends: [u32; 2], triangle: u32) -> DVec3 {
        let [a, b] = ends.map(|v| self.place(v));
        let along = (b - a).normalize_or_zero();
        let off = self.place(self.third(ends, triangle)) - a;
        (off - along * along.dot(off)).normalize_or_zero()
    }

    fn third(&self, ends: [u32; 2], triangle: u32) -> u32 {
        let corners = self.triangles[triangle as usize];
        let third = corners.into_iter().find(|v| !ends.contains(v));
        third.unwrap_or(corners[0])
    }

    fn place(&self, v: u32) -> DVec3 {
        self.points[v as usize].map(f64::from).into()
    }

    /// Where a vertex of its own lies for a pair of triangles: beside the middle of their edge, on the side of the two.
    /// Where planes leave it no room but at one of their corners there is none.
    fn beside(&self, ends: [u32; 2], pair: [u32; 2]) -> Option<[i32; 3]> {
        let [a, b] = ends.map(|v| self.place(v));
        let out = pair.map(|t| self.away(ends, t));
        let out = (out[0] + out[1]).normalize_or(out[0]) * f64::from(self.step);
        let corners = pair.map(|t| self.triangles[t as usize]);
        let is_corner = |p: &[i32; 3]| {
            let mut all = corners.as_flattened().iter();
            all.any(|&v| self.points[v as usize] == *p)
        };
        let mut places = AWAY.into_iter().map(|away| {
            let wanted = ((a + b) / 2.0 + out * away).to_array();
            std::array::from_fn(|axis| self.planes.between(axis, wanted[axis], self.step))
        });
        places.find(|p| !is_corner(p))
    }

    /// Gives a pair of triangles a vertex of their own, if there is a place for it.
    fn split(&mut self, ends: [u32; 2], pair: [u32; 2], added: &mut Vec<Added>) {
        let Some(place) = self.beside(ends, pair) else {
            return;
        };
        let new = self.points.len() as u32;
        self.points.push(place);
        let normals = pair.map(|t| {
            let [p, q, r] = self.triangles[t as usize].map(|v| self.place(v));
            (q - p).cross(r - p)
        });
        added.push(Added {
            beside: ends[0],
            normal: normals[0] + normals[1],
        });
        for t in pair {
            // one half has the new vertex for the second end, the other one for the first
            let old = self.triangles[t as usize];
            let halves = [ends[1], ends[0]].map(|end| old.map(|v| if v == end { new } else { v }));
            self.triangles[t as usize] = halves[0];
            self.triangles.push(halves[1]);
        }
    }
}

/// Turns counts into where those of each vertex begin, which is where they end once they are filled in; returns the sum.
fn starts(counts: &mut [u32]) -> usize {
    let mut sum = 0;
    for count in counts {
        sum += std::mem::replace(count, sum);
    }
    sum as usize
}

/// The edges of more than two triangles whose smaller ends are `wanted`, by rising ends.
fn crowded(triangles: &[[u32; 3]], wanted: &[bool]) -> Vec<Crowded> {
    let mut ends = vec![0u32; wanted.len()];
    for [a, b, c] in triangles {
        for v in [a.min(b), b.min(c), c.min(a)] {
            ends[*v as usize] += u32::from(wanted[*v as usize]);
        }
    }
    let mut edges = vec![HalfEdge::default(); starts(&mut ends)];
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let smaller = a.min(b) as usize;
            if !wanted[smaller] {
                continue;
            }
            let end = &mut ends[smaller];
            edges[*end as usize] = HalfEdge {
                other: a.max(b),
                rises: a < b,
                triangle: t as u32,
            };
            *end += 1;
        }
    }
    let (mut found, mut start) = (Vec::new(), 0);
    for (v, end) in ends.into_iter().enumerate() {
        let of_vertex = &mut edges[start..end as usize];
        start = end as usize;
        of_vertex.sort_unstable();
        for same in of_vertex.chunk_by(|a, b| a.other == b.other) {
            if same.len() > 2 {
                let side = |rises: bool| -> Vec<u32> {
                    let own = same.iter().filter(|e| e.rises == rises);
                    own.map(|e| e.triangle).collect()
                };
                found.push(Crowded {
                    ends: [v as u32, same[0].other],
                    sides: [side(true), side(false)],
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Tiling};
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// Directed edges by their triangles, one way and the other.
    fn edges(triangles: &[[u32; 3]]) -> BTreeMap<[u32; 2], [u32; 2]> {
        let mut all: BTreeMap<[u32; 2], [u32; 2]> = BTreeMap::new();
        for t in triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                all.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
            }
        }
        all
    }

    fn parted(points: &[[i32; 3]], triangles: &[[u32; 3]]) -> (Vec<[i32; 3]>, Vec<[u32; 3]>) {
        let tiling = Tiling {
            dims: Dims([41; 3]),
            macrocube: [20; 3],
        };
        let (mut points, mut triangles) = (points.to_vec(), triangles.to_vec());
        let before = points.len();
        let mut pinched = Pinched {
            points: &mut points,
            triangles: &mut triangles,
            planes: &Planes::of(tiling, 1, [0; 3]),
            step: 4,
        };
        let added = pinched.part();
        assert_eq!(points.len(), before + added.len());
        (points, triangles)
    }

    #[test]
    fn two_tetrahedra_at_an_edge_come_apart() {
        let corners = [
            [0, 0, 0],
            [0, 0, 8],
            [8, 0, 4],
            [8, 8, 4],
            [-8, 0, 4],
            [-8, -8, 4],
        ];
        let points = corners.map(|p| p.map(|v| (v + 20) * 256));
        let solid = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [a, d, b], [b, d, c]];
        let both = [solid([0, 1, 2, 3]), solid([0, 1, 4, 5])].concat();
        assert!(edges(&both).values().any(|n| *n == [2, 2]));
        let (points, parted) = parted(&points, &both);
        assert!(edges(&parted).values().all(|n| *n == [1, 1]), "{parted:?}");
        // a vertex, and each of two triangles is two
        assert_eq!((points.len(), parted.len()), (7, 10));
        // it lies on the side of the tetrahedron whose triangles it is of
        let new = parted.iter().find(|t| t.contains(&6)).unwrap();
        let side = points[6][0] - points[0][0];
        assert!(
            side.abs() < 8
                && new
                    .iter()
                    .all(|&v| (points[v as usize][0] - points[0][0]) * side >= 0)
        );
    }

    proptest! {
        /// Where vertices lie close together and at planes, too, new ones lie at no corner of their triangles.
        #[test]
        fn no_triangle_loses_a_corner(
            triangles in prop::collection::vec((0..9u32, 0..9u32, 0..9u32), 0..40),
            points in prop::collection::btree_set([0..4, 0..4, 0..4i32], 9),
        ) {
            let proper = triangles.iter().map(|&(a, b, c)| [a, b, c]);
            let proper: Vec<_> = proper.filter(|[a, b, c]| a != b && b != c && a != c).collect();
            let points: Vec<_> = points.into_iter().map(|p| p.map(|v| 4 * v)).collect();
            let (points, parted) = parted(&points, &proper);
            for [a, b, c] in parted.into_iter().map(|t| t.map(|v| points[v as usize])) {
                prop_assert!(a != b && b != c && a != c, "{:?} {:?} {:?}", a, b, c);
            }
        }

        /// What is open stays as open as it is, and of edges few are left with more than one mate.
        #[test]
        fn open_edges_stay(triangles in prop::collection::vec((0..9u32, 0..9u32, 0..9u32), 0..40)) {
            let proper = triangles.iter().map(|&(a, b, c)| [a, b, c]);
            let proper: Vec<_> = proper.filter(|[a, b, c]| a != b && b != c && a != c).collect();
            let points: Vec<_> = (0..9).map(|i| [i * 900, i * i * 100, (i % 3) * 3000].map(|v| v + 300)).collect();
            let open = |triangles: &[[u32; 3]]| {
                let all = edges(triangles).into_iter();
                let sums = all.map(|(edge, [up, down])| (edge, i64::from(up) - i64::from(down)));
                sums.filter(|s| s.1 != 0).collect::<BTreeMap<_, _>>()
            };
            let (_, parted) = parted(&points, &proper);
            prop_assert_eq!(open(&parted), open(&proper));
        }
    }
}
