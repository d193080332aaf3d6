//! Fins: flat quadrilaterals in the planes of a node, and what lies under them.

use super::borders::{Edge, Planes, Point};
use super::read::{Part, surface_key};
use crate::grid::LATTICE;
use crate::manifest::NodeEntry;
use crate::verify::code::Code;
use crate::verify::report::{Issue, Issues};
use std::collections::{BTreeSet, HashMap};

/// A fin: a convex quadrilateral across an axis.
#[derive(Debug, Clone, Copy)]
struct Fin {
    axis: usize,
    /// Where it lies along that axis.
    at: i32,
    /// Corners in order around it, along the other two axes.
    corners: [[f64; 2]; 4],
    low: [f64; 2],
    high: [f64; 2],
}

/// The fins of a node by their surfaces.
#[derive(Default)]
pub(super) struct Fins(HashMap<u64, Vec<Fin>>);

/// The axes along a plane.
fn along(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

impl Fin {
    /// Of two triangles that share an edge; `None` if they are no convex quadrilateral across an axis.
    fn of(first: [Point; 3], second: [Point; 3]) -> Option<Self> {
        let all = || first.iter().chain(&second);
        let axis = (0..3).find(|&a| all().all(|p| p[a] == first[0][a]))?;
        // the two corners that one triangle alone has, and between them those of both
        let own = first.iter().find(|p| !second.contains(p))?;
        let other = second.iter().find(|p| !first.contains(p))?;
        let mut shared = first.iter().filter(|p| second.contains(p));
        let (left, right) = (shared.next()?, shared.next()?);
        let flat = |p: &Point| along(axis).map(|a| f64::from(p[a]));
        let mut corners = [own, left, other, right].map(flat);
        let turn = |i: usize| {
            let [p, q, r] = [0, 1, 2].map(|k| corners[(i + k) % 4]);
            (q[0] - p[0]) * (r[1] - q[1]) - (q[1] - p[1]) * (r[0] - q[0])
        };
        let turns: [f64; 4] = std::array::from_fn(turn);
        if turns.iter().all(|t| *t < 0.0) {
            corners.reverse();
        } else if !turns.iter().all(|t| *t > 0.0) {
            return None;
        }
        let end = |pick: fn(f64, f64) -> f64, start: f64| {
            corners.iter().fold([start; 2], |end, c| {
                [pick(end[0], c[0]), pick(end[1], c[1])]
            })
        };
        Some(Fin {
            axis,
            at: first[0][axis],
            corners,
            low: end(f64::min, f64::INFINITY),
            high: end(f64::max, f64::NEG_INFINITY),
        })
    }

    /// True for a point that lies so far inside of all sides.
    fn covers(&self, p: [f64; 2], margin: f64) -> bool {
        if (0..2).any(|i| p[i] < self.low[i] || p[i] > self.high[i]) {
            return false;
        }
        (0..4).all(|i| {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % 4]);
            let side = [to[0] - from[0], to[1] - from[1]];
            let cross = side[0] * (p[1] - from[1]) - side[1] * (p[0] - from[0]);
            cross >= margin * (side[0] * side[0] + side[1] * side[1]).sqrt()
        })
    }
}

impl Fins {
    /// Adds the triangles of the fins of a surface; false if they are not quadrilaterals one after another.
    pub fn add(&mut self, surface: u64, triangles: &[[Point; 3]]) -> bool {
        let (pairs, rest) = triangles.as_chunks::<2>();
        for [first, second] in pairs {
            match Fin::of(*first, *second) {
                Some(fin) => self.0.entry(surface).or_default().push(fin),
                None => return false,
            }
        }
        rest.is_empty()
    }

    /// True for an edge of a surface in the plane across an axis, both ends of which lie so far inside of one fin.
    pub fn cover(&self, surface: u64, ends: &[Point; 2], axis: usize, margin: f64) -> bool {
        let flat = ends.map(|p| along(axis).map(|a| f64::from(p[a])));
        let fins = self.0.get(&surface);
        fins.into_iter().flatten().any(|fin| {
            fin.axis == axis
                && fin.at == ends[0][axis]
                && flat.iter().all(|p| fin.covers(*p, margin))
        })
    }

    /// The shorter side of the widest fin.
    pub fn widest(&self) -> f64 {
        let side = |fin: &Fin, i: usize| {
            let (p, q) = (fin.corners[i], fin.corners[(i + 1) % 4]);
            let [x, y] = [p[0] - q[0], p[1] - q[1]];
            (x * x + y * y).sqrt()
        };
        let shorter = |fin: &Fin| (0..4).map(|i| side(fin, i)).fold(f64::INFINITY, f64::min);
        self.0.values().flatten().map(shorter).fold(0.0, f64::max)
    }

    /// True if a fin does not lie in one of these planes, given by axis and place.
    pub fn any_outside(&self, is_plane: impl Fn(usize, i32) -> bool) -> bool {
        self.0
            .values()
            .flatten()
            .any(|fin| !is_plane(fin.axis, fin.at))
    }
}

/// What of the borders of a node and of those below it lies under its fins.
pub(super) struct Covered<'a> {
    pub entry: &'a NodeEntry,
    pub planes: &'a Planes,
    /// Vertices lie on multiples of so many lattice steps.
    pub step: i32,
    pub capped: bool,
}

impl Covered<'_> {
    /// Checks the rows of fins of a node by its open edges and those of the nodes below, `before`.
    pub fn check(
        &self,
        rows: &[Part],
        open: &[(Edge, i32)],
        before: Vec<Edge>,
        issues: &mut Issues,
    ) {
        let mut fins = Fins::default();
        for part in rows {
            let surface = surface_key(part.ids[2], self.capped);
            if !fins.add(surface, &part.triangles) {
                let message = "found fins that are not flat quadrilaterals one after another";
                return issues.add(Code::LodFins, &self.entry.path, message);
            }
        }
        let planes = self.planes;
        let edges = open.iter().filter(|(edge, _)| planes.share(&edge.ends));
        let (least, most) = (edges.count() as u64, self.entry.fin_triangles / 2);
        let stated = self.entry.border_edges;
        // edges that have become points have fins, too, and some edges no triangle any more
        if stated < least || stated > most && self.entry.fin_width > 0.0 {
            let message = format!(
                "found {stated} edges of the border, expected {least} that triangles have to {most} that have a fin"
            );
            issues.add(Code::LodValue, &self.entry.path, message);
        }
        let inner = |a: usize, v: i32| {
            (v == planes.low[a] && v > 0) || (v == planes.high[a] && v < planes.end[a])
        };
        if fins.any_outside(inner) {
            let message = "found a fin in no plane between two nodes";
            issues.add(Code::LodFins, &self.entry.path, message);
        }
        let steps = |voxels: f64| voxels * f64::from(LATTICE);
        let width = steps(self.entry.fin_width);
        // corners are rounded to steps, outwards
        if fins.widest() > 2.0 * width + 6.0 * f64::from(self.step) {
            let message = format!(
                "found a fin wider than {} voxels",
                2.0 * self.entry.fin_width
            );
            issues.add(Code::LodFins, &self.entry.path, message);
        }
        let before = before.into_iter();
        if width == 0.0 {
            // it has not moved, and has no fins
            let own: BTreeSet<Edge> = open.iter().map(|(edge, _)| *edge).collect();
            let moved = before.filter(|edge| !own.contains(edge));
            return self.covered(&fins, moved, 0.0, Code::LodCurve, issues);
        }
        let shared = |edge: &Edge| planes.share(&edge.ends);
        let own = open.iter().map(|(edge, _)| *edge).filter(shared);
        self.covered(&fins, own, width, Code::LodFins, issues);
        let margin = width - steps(self.entry.curve_gap);
        self.covered(&fins, before, margin, Code::LodCurve, issues);
    }

    /// Reports edges in planes between nodes that do not lie so far inside of a fin.
    fn covered(
        &self,
        fins: &Fins,
        edges: impl Iterator<Item = Edge>,
        margin: f64,
        code: Code,
        issues: &mut Issues,
    ) {
        let margin = (margin - 1e-6).max(0.0);
        for edge in edges {
            let mut planes = self.planes.holding(&edge.ends, false);
            let mut any = false;
            let covered = planes.any(|axis| {
                any = true;
                fins.cover(edge.surface, &edge.ends, axis, margin)
            });
            if any && !covered {
                let [p, q] = edge.ends;
                let what = match code {
                    Code::LodCurve => "the border of a node below",
                    _ => "the border",
                };
                let message = format!(
                    "{what} runs from {p:?} to {q:?} (in 1/{LATTICE} voxel), and no fin covers {margin} on both sides \
                     of it"
                );
                issues.push(Issue::new(code, &self.entry.path, message).at(p));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadrilateral_covers_what_is_inside_by_the_margin() {
        let [a, b, c, d] = [[7, 0, 0], [7, 0, 100], [7, 200, 0], [7, 200, 100]];
        let mut fins = Fins::default();
        assert!(fins.add(3, &[[a, b, c], [b, d, c]]));
        let edge = [[7, 40, 50], [7, 160, 60]];
        assert!(fins.cover(3, &edge, 0, 40.0) && !fins.cover(3, &edge, 0, 41.0));
        assert!(!fins.cover(2, &edge, 0, 0.0) && !fins.cover(3, &edge, 1, 0.0));
        assert!(!fins.any_outside(|axis, at| (axis, at) == (0, 7)));
        // a triangle alone, and two that are no convex quadrilateral
        assert!(!fins.add(3, &[[a, b, c]]));
        assert!(!fins.add(3, &[[a, b, c], [a, b, [7, 10, 20]]]));
    }
}
