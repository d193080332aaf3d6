//! The 256 cases of marching cubes, derived from one rule.
//!
//! Corner `c = x + 2y + 4z` of a cube is bit `c` of its case, set iff the voxel is above.
//!
//! ```text
//!        6--------7        z        edges 0..3  along x from corners 0 2 4 6
//!       /|       /|        | y      edges 4..7  along y from corners 0 1 4 5
//!      4--------5 |        |/       edges 8..11 along z from corners 0 1 2 3
//!      | 2------|-3        +---x
//!      |/       |/                  faces 0 1: x = 0, 1   2 3: y = 0, 1
//!      0--------1                         4 5: z = 0, 1
//! ```
//!
//! Rule: on every face the surface leaves one directed segment per run of above corners (on an
//! ambiguous face, one around each above corner for [`Ambiguous::Separate`], one around each below
//! corner for [`Ambiguous::Join`]). The six faces' segments chain to loops of 3 to 7 edges, and each
//! loop is triangulated without a chord that lies in a face. Two cubes see the same four corners of
//! their shared face, hence the same segments: no hole. A chord inside a face could be drawn by both
//! cubes and give an edge four triangles, so it is ruled out. Worked example: case 1 (only corner 0
//! above) crosses edges 0, 4 and 8; the triangle 0-4-8 winds counter-clockwise seen from corner 7,
//! which is below.
//!
//! The classes of this table are the 15 of Lorensen and Cline (1987) and the 8 complements that
//! Shoeb (1998) added.

use crate::grid::Ambiguous;

/// Most triangles in one cube.
pub const MAX_TRIANGLES: usize = 5;

/// The lower corner of each of the 12 edges; the upper one is `lower + (1 << axis)`.
pub const EDGE_LOWER: [u8; 12] = [0, 2, 4, 6, 0, 1, 4, 5, 0, 1, 2, 3];

/// Corners of each face, counter-clockwise seen from outside the cube.
const FACE_CORNERS: [[u8; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// Cases that take the last of equally short triangulations, not the first. A quadrilateral's two
/// diagonals are always equally short, and which of them neighbouring cubes draw decides how often strips
/// must turn. Found one case at a time, as long as any change saved index entries, on foams without and
/// with noise and a scan of a lobster at two thresholds: 1.313 entries per triangle fell to 1.306 on
/// average, and from 1.303 to 1.295 on the foam without noise.
const LAST_OF_TIES: [u8; 42] = [
    15, 23, 28, 38, 51, 52, 53, 67, 71, 74, 77, 78, 85, 90, 100, 102, 109, 113, 114, 121, 125, 131,
    133, 137, 141, 142, 145, 158, 163, 178, 183, 190, 195, 197, 204, 214, 216, 228, 233, 235, 240,
    246,
];

/// What lies across one edge of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Across {
    /// Half-edge `3 * triangle + edge` of the same cube.
    Inside(u8),
    /// Segment `slot` (0 or 1) on `face`: a triangle of the neighbour cube there. Both cubes give a
    /// segment the same slot.
    Face {
        /// 0 to 5.
        face: u8,
        /// 0, or 1 for the second segment of an ambiguous face.
        slot: u8,
    },
}

/// One case: its triangles and what lies across their edges.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Number of triangles, 0 to [`MAX_TRIANGLES`].
    pub triangles: u8,
    /// Cube edges (0 to 11) of the triangles' corners, counter-clockwise seen from below voxels.
    pub edges: [[u8; 3]; MAX_TRIANGLES],
    /// `across[t][e]`: beyond the edge from corner e to corner e+1 of triangle t.
    pub across: [[Across; 3]; MAX_TRIANGLES],
}

/// The axis (0, 1, 2) that cube edge `e` runs along.
pub const fn edge_axis(e: u8) -> usize {
    (e / 4) as usize
}

/// The cube edge between two adjacent corners.
fn edge_between(a: u8, b: u8) -> u8 {
    let axis = (a ^ b).trailing_zeros() as usize;
    let lower = a & b;
    let slot = EDGE_LOWER[4 * axis..4 * axis + 4]
        .iter()
        .position(|&l| l == lower);
    (4 * axis + slot.expect("adjacent corners share an edge")) as u8
}

/// A directed segment on a face, from edge to edge.
#[derive(Debug, Clone, Copy)]
struct Segment {
    from: u8,
    to: u8,
    face: u8,
    slot: u8,
    /// The corner that it goes round, on an ambiguous face.
    corner: u8,
}

/// The segments of one case on all faces.
fn segments_of(case: u8, rule: Ambiguous) -> Vec<Segment> {
    let mut all = Vec::with_capacity(12);
    (0..6).for_each(|face| add_segments(case, face, rule, &mut all));
    all
}

/// Adds the segments of one case on one face. Going round counter-clockwise seen from outside, a segment
/// starts where the walk enters above corners and ends where it leaves them.
fn add_segments(case: u8, face: u8, rule: Ambiguous, all: &mut Vec<Segment>) {
    let corners = FACE_CORNERS[face as usize];
    let above = |i: usize| case >> corners[i % 4] & 1 == 1;
    let crossing = |i: usize| edge_between(corners[i % 4], corners[(i + 1) % 4]);
    let first = all.len();
    for enter in (0..4).filter(|&i| !above(i) && above(i + 1)) {
        // the run of above corners entered here, or for Join the run of below corners left here
        let leave = (1..4)
            .map(|s| match rule {
                Ambiguous::Separate => enter + s,
                Ambiguous::Join => enter + 4 - s,
            })
            .find(|&i| above(i) && !above(i + 1));
        all.push(Segment {
            from: crossing(enter),
            to: crossing(leave.expect("a walk that enters also leaves")),
            face,
            slot: 0,
            corner: match rule {
                Ambiguous::Separate => corners[(enter + 1) % 4],
                Ambiguous::Join => corners[enter % 4],
            },
        });
    }
    // corner numbers of opposite faces differ by a constant, so both cubes sort alike
    let found = &mut all[first..];
    found.sort_by_key(|s| s.corner);
    found
        .iter_mut()
        .zip(0..)
        .for_each(|(s, slot)| s.slot = slot);
}

/// True if both cube edges lie on one face of the cube.
fn share_face(a: u8, b: u8) -> bool {
    FACE_CORNERS.iter().any(|corners| {
        let on = |e: u8| {
            let low = EDGE_LOWER[e as usize];
            let high = low + (1 << edge_axis(e));
            corners.contains(&low) && corners.contains(&high)
        };
        on(a) && on(b)
    })
}

/// Twice the middle of cube edge `e`, to compare chords by length.
fn middle(e: u8) -> [i32; 3] {
    let low = EDGE_LOWER[e as usize];
    let mut p = [low & 1, low >> 1 & 1, low >> 2 & 1].map(|v| 2 * i32::from(v));
    p[edge_axis(e)] += 1;
    p
}

/// All triangulations of the polygon `loop_[i..=j]`, as index triples.
fn triangulations(i: usize, j: usize) -> Vec<Vec<[usize; 3]>> {
    if j < i + 2 {
        return vec![Vec::new()];
    }
    let mut all = Vec::new();
    for k in i + 1..j {
        for left in triangulations(i, k) {
            for right in triangulations(k, j) {
                let mut t = left.clone();
                t.push([i, k, j]);
                t.extend(&right);
                all.push(t);
            }
        }
    }
    all
}

/// True if the triangle on three cube edges never faces the wrong way: wherever its corners lie on
/// their edges, its area vector does not point from below to above along any of them.
///
/// The vector's components are linear in each corner's place, so the edges' ends decide.
fn faces_below(case: u8, triangle: [u8; 3]) -> bool {
    (0..8).all(|ends| {
        let [a, b, c]: [[i32; 3]; 3] = std::array::from_fn(|i| {
            let e = triangle[i];
            let low = EDGE_LOWER[e as usize];
            let mut p = [low & 1, low >> 1 & 1, low >> 2 & 1].map(i32::from);
            p[edge_axis(e)] = ends >> i & 1;
            p
        });
        let u: [i32; 3] = std::array::from_fn(|k| b[k] - a[k]);
        let v: [i32; 3] = std::array::from_fn(|k| c[k] - a[k]);
        let n = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        triangle.iter().all(|&e| {
            let lower_above = case >> EDGE_LOWER[e as usize] & 1 == 1;
            let along = n[edge_axis(e)];
            if lower_above { along >= 0 } else { along <= 0 }
        })
    })
}

/// What building a table needs again and again.
struct Builder {
    /// [`triangulations`] of polygons by their corners.
    polygons: [Vec<Vec<[usize; 3]>>; 8],
    /// Four times the squared length of the chord between two cube edges' middles; `None` if it lies in a face.
    chords: [[Option<i32>; 12]; 12],
}

impl Builder {
    fn new() -> Self {
        let chord = |a: u8, b: u8| {
            let (m, k) = (middle(a), middle(b));
            (!share_face(a, b)).then(|| (0..3).map(|i| (m[i] - k[i]).pow(2)).sum())
        };
        let polygon = |corners: usize| match corners {
            3.. => triangulations(0, corners - 1),
            _ => Vec::new(),
        };
        Builder {
            polygons: std::array::from_fn(polygon),
            chords: std::array::from_fn(|a| std::array::from_fn(|b| chord(a as u8, b as u8))),
        }
    }

    /// The lengths of a triangulation's chords together; `None` if one lies in a face.
    fn cost(&self, edges: &[u8], triangles: &[[usize; 3]]) -> Option<i32> {
        let is_side = |p: usize, q: usize| q - p == 1 || (p == 0 && q == edges.len() - 1);
        let mut cost = 0;
        for &[a, b, c] in triangles {
            for (p, q) in [(a, b), (b, c), (a, c)] {
                if !is_side(p, q) {
                    cost += self.chords[edges[p] as usize][edges[q] as usize]?;
                }
            }
        }
        Some(cost)
    }

    /// The triangulation of a loop of cube edges with no chord inside a face and no triangle that could
    /// face the wrong way, and of those the one whose chords are shortest: the first or the last, where
    /// several are ([`LAST_OF_TIES`]).
    fn triangulate(&self, case: u8, edges: &[u8]) -> Vec<[u8; 3]> {
        let all = &self.polygons[edges.len()];
        let last_first = LAST_OF_TIES.contains(&case);
        let rank = |i: usize| if last_first { all.len() - i } else { i };
        let ranked = all.iter().enumerate().filter_map(|(i, triangles)| {
            let cost = self.cost(edges, triangles)?;
            Some((cost, rank(i), triangles))
        });
        let mut ranked: Vec<_> = ranked.collect();
        ranked.sort_unstable();
        ranked
            .iter()
            .map(|(.., triangles)| triangles.iter().map(|t| t.map(|i| edges[i])))
            .find(|triangles| triangles.clone().all(|t| faces_below(case, t)))
            .expect("every loop has such a triangulation")
            .collect()
    }

    /// The triangles of a case from its segments for [`Ambiguous::Separate`].
    fn triangles(&self, case: u8, segments: &[Segment]) -> Vec<[u8; 3]> {
        let mut triangles: Vec<[u8; 3]> = Vec::with_capacity(MAX_TRIANGLES);
        let mut used = vec![false; segments.len()];
        while let Some(first) = used.iter().position(|u| !u) {
            let mut edges = Vec::with_capacity(segments.len());
            let mut at = first;
            while !used[at] {
                used[at] = true;
                edges.push(segments[at].from);
                let next = segments.iter().position(|s| s.from == segments[at].to);
                at = next.expect("every crossed edge starts one segment and ends one");
            }
            triangles.extend(self.triangulate(case, &edges));
        }
        triangles
    }

    fn case(&self, case: u8, rule: Ambiguous) -> Case {
        let segments = segments_of(case, rule);
        // joining is separating the complement and turning each triangle round: so a volume and its negative
        // have the same surface, down to where quadrilaterals are cut
        let triangles: Vec<[u8; 3]> = match rule {
            Ambiguous::Separate => self.triangles(case, &segments),
            Ambiguous::Join => self
                .triangles(!case, &segments_of(!case, Ambiguous::Separate))
                .into_iter()
                .map(|[a, b, c]| [a, c, b])
                .collect(),
        };
        let mut out = Case {
            triangles: triangles.len() as u8,
            edges: [[0; 3]; MAX_TRIANGLES],
            across: [[Across::Inside(0); 3]; MAX_TRIANGLES],
        };
        for (t, &corners) in triangles.iter().enumerate() {
            out.edges[t] = corners;
            for e in 0..3 {
                out.across[t][e] = across(&triangles, &segments, corners[e], corners[(e + 1) % 3]);
            }
        }
        out
    }

    fn table(rule: Ambiguous) -> Box<[Case; 256]> {
        let builder = Builder::new();
        Box::new(std::array::from_fn(|c| builder.case(c as u8, rule)))
    }
}

fn across(triangles: &[[u8; 3]], segments: &[Segment], from: u8, to: u8) -> Across {
    if let Some(s) = segments.iter().find(|s| s.from == from && s.to == to) {
        return Across::Face {
            face: s.face,
            slot: s.slot,
        };
    }
    let half_edge = triangles.iter().enumerate().find_map(|(t, c)| {
        (0..3)
            .find(|&e| c[e] == to && c[(e + 1) % 3] == from)
            .map(|e| 3 * t + e)
    });
    Across::Inside(half_edge.expect("a chord has two triangles") as u8)
}

/// The table of a rule, built from it on first use.
pub fn cases(rule: Ambiguous) -> &'static [Case; 256] {
    use std::sync::LazyLock;
    static SEPARATE: LazyLock<Box<[Case; 256]>> =
        LazyLock::new(|| Builder::table(Ambiguous::Separate));
    static JOIN: LazyLock<Box<[Case; 256]>> = LazyLock::new(|| Builder::table(Ambiguous::Join));
    match rule {
        Ambiguous::Separate => &SEPARATE,
        Ambiguous::Join => &JOIN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    const RULES: [Ambiguous; 2] = [Ambiguous::Separate, Ambiguous::Join];

    fn triangles(case: &Case) -> &[[u8; 3]] {
        &case.edges[..case.triangles as usize]
    }

    /// Directed edges that have no reverse inside the case.
    fn boundary(triangles: &[[u8; 3]]) -> BTreeSet<(u8, u8)> {
        let all: BTreeSet<_> = triangles
            .iter()
            .flat_map(|t| (0..3).map(|e| (t[e], t[(e + 1) % 3])))
            .collect();
        all.iter()
            .copied()
            .filter(|&(a, b)| !all.contains(&(b, a)))
            .collect()
    }

    #[test]
    fn counts_are_those_of_the_23_classes() {
        for rule in RULES {
            let table = cases(rule);
            assert_eq!(
                table.iter().map(|c| c.triangles as usize).sum::<usize>(),
                820
            );
            assert_eq!(table.iter().map(|c| c.triangles).max(), Some(5));
            assert_eq!((table[0].triangles, table[255].triangles), (0, 0));
        }
        assert_eq!(
            boundary(triangles(&cases(Ambiguous::Separate)[1])),
            [(0, 4), (4, 8), (8, 0)].into()
        );
    }

    #[test]
    fn join_is_the_reversed_complement_of_separate() {
        for c in 0..256 {
            let join = boundary(triangles(&cases(Ambiguous::Join)[c]));
            let separate = boundary(triangles(&cases(Ambiguous::Separate)[255 - c]));
            assert_eq!(
                join,
                separate.into_iter().map(|(a, b)| (b, a)).collect(),
                "{c}"
            );
        }
    }

    #[test]
    fn no_chord_lies_in_a_face_and_every_edge_has_its_mate() {
        for rule in RULES {
            for (c, case) in cases(rule).iter().enumerate() {
                let mut faces = BTreeSet::new();
                for (t, corners) in triangles(case).iter().enumerate() {
                    for e in 0..3 {
                        let (a, b) = (corners[e], corners[(e + 1) % 3]);
                        match case.across[t][e] {
                            Across::Inside(h) => {
                                assert!(!share_face(a, b), "case {c}");
                                let back = case.across[h as usize / 3][h as usize % 3];
                                assert_eq!(back, Across::Inside((3 * t + e) as u8));
                            }
                            Across::Face { face, slot } => {
                                assert!(faces.insert((face, slot)), "case {c}");
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn no_triangle_can_face_the_wrong_way() {
        for rule in RULES {
            for (c, case) in cases(rule).iter().enumerate() {
                for &t in triangles(case) {
                    assert!(faces_below(c as u8, t), "{rule:?} case {c}");
                    // the check itself sees a reversed triangle
                    assert!(!faces_below(c as u8, [t[0], t[2], t[1]]));
                }
            }
        }
    }

    /// Every pair of cubes that share a face leaves there the same segments, opposite ways, in the
    /// same slots.
    #[test]
    fn neighbours_agree_on_their_shared_face() {
        let on_face = |case: &Case, wanted: u8, axis: usize| -> BTreeMap<u8, (u8, u8)> {
            // edges of the upper face carry their upper bit: drop it so both cubes name them alike
            let flat = |e: u8| {
                let low = EDGE_LOWER[e as usize] & !(1 << axis);
                (edge_axis(e) as u8) << 4 | low
            };
            let mut out = BTreeMap::new();
            for t in 0..case.triangles as usize {
                for e in 0..3 {
                    if let Across::Face { face, slot } = case.across[t][e]
                        && face == wanted
                    {
                        out.insert(
                            slot,
                            (flat(case.edges[t][e]), flat(case.edges[t][(e + 1) % 3])),
                        );
                    }
                }
            }
            out
        };
        for rule in RULES {
            let table = cases(rule);
            for axis in 0..3 {
                for low in 0..256usize {
                    for high in 0..256usize {
                        let matches = (0..8)
                            .filter(|c| c >> axis & 1 == 1)
                            .all(|c| low >> c & 1 == high >> (c - (1 << axis)) & 1);
                        if !matches {
                            continue;
                        }
                        let upper = on_face(&table[low], 2 * axis as u8 + 1, axis);
                        let lower = on_face(&table[high], 2 * axis as u8, axis);
                        let reversed: BTreeMap<_, _> =
                            lower.into_iter().map(|(s, (a, b))| (s, (b, a))).collect();
                        assert_eq!(upper, reversed, "{rule:?} axis {axis} {low} {high}");
                    }
                }
            }
        }
    }
}
