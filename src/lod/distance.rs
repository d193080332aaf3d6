//! How far a surface has moved: from places on the finer mesh to the nearest triangle of the same surface in the
//! coarser one.
//!
//! What is wanted is the distance that one place of a thousand exceeds. So the furthest thousandth is held, and a place is
//! done with once a triangle lies no further than all of those: few have to be looked at closely.

use super::mesh::Mesh;
use crate::grid::LATTICE;
use crate::sys::simd::dispatch;
use glam::{IVec3, Vec3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// About so many places are looked at: of more of them one of a few, in their order.
const PLACES: usize = 1 << 14;
/// One place of so many may lie further away.
const BEYOND: usize = 1000;
/// Cells of the grid, and entries in them, for each triangle at most.
const CELLS: usize = 8;
const ENTRIES: usize = 32;
/// No triangle.
const NONE: u32 = u32::MAX;

/// The coarser mesh.
pub struct Coarser<'a> {
    /// In lattice steps.
    pub points: &'a [[i32; 3]],
    pub triangles: &'a [[u32; 3]],
    /// The surface of a vertex.
    pub surface_of: &'a dyn Fn(u32) -> u32,
    /// About the width of triangles in lattice steps.
    pub width: i32,
    /// Where places count from.
    pub low: [i32; 3],
}

/// How far 99.9 % of the vertices of `finer`, with `centres` and of the middles of its triangles, lie at most from their
/// surfaces in the coarser mesh, in voxels; of many of them a sample is looked at, see [`PLACES`]. Those of a surface that is
/// gone, half of its diagonal, as if all of it had fallen together in its middle.
pub fn nearly_furthest(finer: &Mesh, coarser: &Coarser, centres: bool) -> f32 {
    dispatch!(measured(finer, coarser, centres))
}

#[inline(always)]
fn measured(finer: &Mesh, coarser: &Coarser, centres: bool) -> f32 {
    let place = |p: &[i32; 3]| -> Vec3 {
        Vec3::from_array(std::array::from_fn(|a| {
            (p[a] - coarser.low[a]) as f32 / LATTICE as f32
        }))
    };
    let grid = Grid::of(coarser, place);
    let mut is_there = vec![false; finer.surfaces.len()];
    let surfaces = grid.surfaces.iter();
    surfaces.for_each(|&s| is_there[s as usize] = true);
    let middles = if centres { finer.triangles.len() } else { 0 };
    let step = ((finer.points.len() + middles) / PLACES).max(1);
    let mut search = Search {
        grid: &grid,
        gone: gone(finer, &is_there, place),
        last: vec![NONE; is_there.len()],
        held: (finer.points.len() + middles) / step / BEYOND + 1,
        furthest: BinaryHeap::new(),
    };
    let points = finer.points.iter().zip(&finer.surface_of);
    for (point, &surface) in points.step_by(step) {
        search.look(place(point), surface);
    }
    for t in finer.triangles[..middles].iter().step_by(step) {
        let corners = t.map(|v| place(&finer.points[v as usize]));
        let middle = corners.into_iter().sum::<Vec3>() / 3.0;
        search.look(middle, finer.surface_of[t[0] as usize]);
    }
    let least = search.furthest.pop();
    least.map_or(0.0, |Reverse(bits)| f32::from_bits(bits).sqrt())
}

/// The squares of half of the diagonals of the surfaces that are not there.
fn gone(mesh: &Mesh, is_there: &[bool], place: impl Fn(&[i32; 3]) -> Vec3) -> Vec<Option<f32>> {
    let mut boxes = vec![(Vec3::MAX, Vec3::MIN); is_there.len()];
    for (point, &surface) in mesh.points.iter().zip(&mesh.surface_of) {
        if !is_there[surface as usize] {
            let (low, high) = &mut boxes[surface as usize];
            (*low, *high) = (low.min(place(point)), high.max(place(point)));
        }
    }
    let half = |(low, high): (Vec3, Vec3)| (high - low).length_squared() / 4.0;
    let all = boxes.into_iter().zip(is_there);
    all.map(|(own, there)| (!there).then(|| half(own)))
        .collect()
}

/// The largest distances so far.
struct Search<'a> {
    grid: &'a Grid,
    /// The squared distance to surfaces that are gone.
    gone: Vec<Option<f32>>,
    /// The triangle that was found last, by surfaces: it is near to the next place, too.
    last: Vec<u32>,
    /// How many are held.
    held: usize,
    /// Their squares, whose bits rise with them.
    furthest: BinaryHeap<Reverse<u32>>,
}

impl Search<'_> {
    #[inline(always)]
    fn look(&mut self, p: Vec3, surface: u32) {
        let is_full = self.furthest.len() == self.held;
        let within = match self.furthest.peek() {
            Some(Reverse(bits)) if is_full => f32::from_bits(*bits),
            _ => -1.0,
        };
        let squared = match self.gone[surface as usize] {
            Some(squared) => squared,
            None => {
                let last = &mut self.last[surface as usize];
                if *last != NONE && self.grid.squared(p, *last) <= within {
                    return;
                }
                let (squared, triangle) = self.grid.nearest(p, surface, within);
                *last = triangle;
                squared
            }
        };
        if squared > within {
            if is_full {
                self.furthest.pop();
            }
            self.furthest.push(Reverse(squared.to_bits()));
        }
    }
}

/// Triangles by the cells of a grid that their boxes meet.
struct Grid {
    corners: Vec<[Vec3; 3]>,
    /// Of each triangle.
    surfaces: Vec<u32>,
    low: Vec3,
    width: f32,
    counts: IVec3,
    /// Where the entries of each cell begin, and after the last where they end.
    starts: Vec<u32>,
    entries: Vec<u32>,
}

impl Grid {
    #[inline(always)]
    fn of(mesh: &Coarser, place: impl Fn(&[i32; 3]) -> Vec3) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| place(&mesh.points[v as usize]));
        let surface = |t: &[u32; 3]| (mesh.surface_of)(t[0]);
        let mut grid = Grid {
            corners: mesh.triangles.iter().map(corners).collect(),
            surfaces: mesh.triangles.iter().map(surface).collect(),
            low: Vec3::ZERO,
            width: mesh.width as f32 / LATTICE as f32,
            counts: IVec3::ONE,
            starts: Vec::new(),
            entries: Vec::new(),
        };
        let all = || grid.corners.as_flattened().iter().copied();
        let (low, high) = (
            all().reduce(Vec3::min).unwrap_or_default(),
            all().reduce(Vec3::max).unwrap_or_default(),
        );
        grid.low = low;
        loop {
            grid.counts = grid.cell(high) + IVec3::ONE;
            let cells = grid.counts.as_i64vec3().element_product();
            if cells <= (CELLS * grid.corners.len()).max(64) as i64 && grid.fill() {
                return grid;
            }
            grid.width *= 2.0;
        }
    }

    #[inline(always)]
    fn cell(&self, p: Vec3) -> IVec3 {
        ((p - self.low) / self.width).floor().as_ivec3()
    }

    #[inline(always)]
    fn number(&self, cell: IVec3) -> usize {
        ((cell.z * self.counts.y + cell.y) * self.counts.x + cell.x) as usize
    }

    /// The cells that the box of a triangle meets.
    #[inline(always)]
    fn cells(&self, [p, q, r]: [Vec3; 3]) -> [IVec3; 2] {
        [self.cell(p.min(q).min(r)), self.cell(p.max(q).max(r))]
    }

    /// Puts the triangles into the cells; false if that would be too many entries.
    #[inline(always)]
    fn fill(&mut self) -> bool {
        let sizes = self.corners.iter().map(|t| {
            let [low, high] = self.cells(*t);
            (high - low + IVec3::ONE).as_i64vec3().element_product()
        });
        let cells = self.counts.element_product() as usize;
        if sizes.sum::<i64>() > (ENTRIES * self.corners.len()) as i64 && cells > 1 {
            return false;
        }
        let mut ends = vec![0u32; cells + 1];
        self.each_entry(|cell, _| ends[cell] += 1);
        let mut sum = 0;
        for end in &mut ends {
            sum += std::mem::replace(end, sum);
        }
        let mut entries = vec![0; sum as usize];
        self.starts = ends.clone();
        self.each_entry(|cell, triangle| {
            entries[ends[cell] as usize] = triangle;
            ends[cell] += 1;
        });
        self.entries = entries;
        true
    }

    #[inline(always)]
    fn each_entry(&self, mut each: impl FnMut(usize, u32)) {
        for (i, t) in self.corners.iter().enumerate() {
            let [low, high] = self.cells(*t);
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    for x in low.x..=high.x {
                        each(self.number(IVec3::new(x, y, z)), i as u32);
                    }
                }
            }
        }
    }

    /// The squared distance to the nearest triangle of a surface, and that triangle; any one that is near enough will
    /// do.
    #[inline(always)]
    fn nearest(&self, p: Vec3, surface: u32, enough: f32) -> (f32, u32) {
        let own = self.cell(p);
        let last = self.counts - IVec3::ONE;
        let first = (own - own.clamp(IVec3::ZERO, last)).abs().max_element();
        let end = own.max(last - own).max_element();
        let mut best = (f32::INFINITY, NONE);
        for ring in first..=end {
            self.ring(own, ring, |entries| {
                for &t in entries {
                    if self.surfaces[t as usize] == surface {
                        let squared = self.squared(p, t);
                        if squared < best.0 {
                            best = (squared, t);
                        }
                    }
                }
                best.0 <= enough
            });
            // all that lies further out is as far away at least
            let reach = ring as f32 * self.width;
            if best.0 <= enough || best.0 <= reach * reach {
                break;
            }
        }
        best
    }

    /// Looks at the cells so many cells away, until `look` says that it is enough.
    #[inline(always)]
    fn ring(&self, own: IVec3, ring: i32, mut look: impl FnMut(&[u32]) -> bool) {
        let last = self.counts - IVec3::ONE;
        let low = (own - ring).max(IVec3::ZERO);
        let high = (own + ring).min(last);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                let is_side = (z - own.z).abs() == ring || (y - own.y).abs() == ring;
                let step = if is_side { 1 } else { (2 * ring).max(1) };
                let mut x = if is_side { low.x } else { own.x - ring };
                while x <= high.x {
                    if x >= 0 {
                        let cell = self.number(IVec3::new(x, y, z));
                        let range = self.starts[cell] as usize..self.starts[cell + 1] as usize;
                        if look(&self.entries[range]) {
                            return;
                        }
                    }
                    x += step;
                }
            }
        }
    }

    /// The squared distance of a place to a triangle. Christer Ericson: Real-Time Collision Detection, 2005, 5.1.5.
    #[inline(always)]
    fn squared(&self, p: Vec3, triangle: u32) -> f32 {
        let [a, b, c] = self.corners[triangle as usize];
        let (ab, ac, ap) = (b - a, c - a, p - a);
        let (d1, d2) = (ab.dot(ap), ac.dot(ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return ap.length_squared();
        }
        let bp = p - b;
        let (d3, d4) = (ab.dot(bp), ac.dot(bp));
        if d3 >= 0.0 && d4 <= d3 {
            return bp.length_squared();
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return (ap - ab * (d1 / (d1 - d3))).length_squared();
        }
        let cp = p - c;
        let (d5, d6) = (ab.dot(cp), ac.dot(cp));
        if d6 >= 0.0 && d5 <= d6 {
            return cp.length_squared();
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return (ap - ac * (d2 / (d2 - d6))).length_squared();
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 >= d3 && d5 >= d6 {
            let along = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            return (bp - (c - b) * along).length_squared();
        }
        let sum = va + vb + vc;
        (ap - ab * (vb / sum) - ac * (vc / sum)).length_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lod::mesh::{Surface, SurfaceKey};
    use crate::tile::Extras;
    use proptest::prelude::*;

    /// A mesh of some surfaces whose vertices nothing joins.
    fn mesh(points: &[([i32; 3], u32)], surfaces: u32) -> Mesh {
        let surface = |i: u32| {
            let extras = Extras::ids(1, 1, u64::from(i), 1);
            Surface {
                key: SurfaceKey::of(&extras),
                extras,
                triangles: 1,
            }
        };
        Mesh {
            points: points.iter().map(|p| p.0).collect(),
            normals: vec![[0, 0, 32_767]; points.len()],
            surface_of: points.iter().map(|p| p.1).collect(),
            triangles: Vec::new(),
            surfaces: (0..surfaces).map(surface).collect(),
        }
    }

    /// The largest of the distances to dense samples of the triangles of the same surface.
    fn sampled(finer: &Mesh, points: &[[i32; 3]], triangles: &[[u32; 3]]) -> f64 {
        const N: i64 = 24;
        let distance = |p: &[i32; 3], surface: u32| -> f64 {
            let mut least = f64::INFINITY;
            let own = triangles.iter().enumerate();
            for (_, t) in own.filter(|(i, _)| *i as u32 % 2 == surface) {
                let corners = t.map(|v| points[v as usize].map(f64::from));
                for i in 0..=N {
                    for j in 0..=N - i {
                        let w = [i, j, N - i - j].map(|v| v as f64 / N as f64);
                        let at = |a: usize| (0..3).map(|k| w[k] * corners[k][a]).sum::<f64>();
                        let d = (0..3).map(|a| at(a) - f64::from(p[a])).map(|d| d * d).sum();
                        least = f64::min(least, d);
                    }
                }
            }
            least.sqrt() / f64::from(LATTICE)
        };
        let all = finer.points.iter().zip(&finer.surface_of);
        all.map(|(p, s)| distance(p, *s)).fold(0.0, f64::max)
    }

    fn place() -> impl Strategy<Value = [i32; 3]> {
        [0..8000, 0..8000, 0..8000i32]
    }

    proptest! {
        /// Of few places it is the largest distance, whatever the width of cells.
        #[test]
        fn the_furthest_is_that_of_dense_samples(
            finer in prop::collection::vec((place(), 0..2u32), 1..12),
            corners in prop::collection::vec([place(), place(), place()], 2..9),
            width in 100..9000i32,
        ) {
            let points = corners.as_flattened();
            let triangles: Vec<[u32; 3]> =
                (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let finer = mesh(&finer, 2);
            let coarser = Coarser {
                points,
                triangles: &triangles,
                surface_of: &|v| v / 3 % 2,
                width,
                low: [-300, 0, 77],
            };
            let found = f64::from(nearly_furthest(&finer, &coarser, false));
            let expected = sampled(&finer, points, &triangles);
            // samples are up to a 24th of a side apart
            prop_assert!(found >= expected - 1.2 && found <= expected + 1e-2, "{found} {expected}");
        }
    }

    #[test]
    fn what_is_gone_counts_by_its_size() {
        let finer = mesh(
            &[([0; 3], 0), ([256, 0, 0], 1), ([256, 3 * 256, 4 * 256], 1)],
            2,
        );
        let points = [[0, 0, 0], [256, 0, 0], [0, 256, 0]];
        let coarser = Coarser {
            points: &points,
            triangles: &[[0, 1, 2]],
            surface_of: &|_| 0,
            width: 300,
            low: [0; 3],
        };
        assert_eq!(nearly_furthest(&finer, &coarser, true), 2.5);
    }

    #[test]
    fn one_place_of_a_thousand_may_lie_further() {
        // at distances of 1 to 3000 steps, in no order
        let points: Vec<_> = (0..3000)
            .map(|i| ([0, 0, 1 + i * 1009 % 3000], 0))
            .collect();
        let coarser = Coarser {
            points: &[[0, 0, 0], [256, 0, 0], [0, 256, 0]],
            triangles: &[[0, 1, 2]],
            surface_of: &|_| 0,
            width: 300,
            low: [0; 3],
        };
        let found = nearly_furthest(&mesh(&points, 1), &coarser, false);
        assert_eq!(found, 2997.0 / 256.0);
    }

    #[test]
    fn centres_of_triangles_are_looked_at_if_asked_for() {
        let mut finer = mesh(&[([0; 3], 0), ([2560, 0, 0], 0), ([0, 2560, 0], 0)], 1);
        finer.triangles = vec![[0, 1, 2]];
        // three needles at the corners
        let points: Vec<[i32; 3]> = finer.points.iter().flat_map(|p| [*p; 3]).collect();
        let coarser = Coarser {
            points: &points,
            triangles: &[[0, 1, 2], [3, 4, 5], [6, 7, 8]],
            surface_of: &|_| 0,
            width: 256,
            low: [0; 3],
        };
        assert_eq!(nearly_furthest(&finer, &coarser, false), 0.0);
        let expected = (2.0 * (10.0 / 3.0f32) * (10.0 / 3.0)).sqrt();
        assert!((nearly_furthest(&finer, &coarser, true) - expected).abs() < 1e-4);
    }
}
