//! The voxels on both sides of a surface, as its vertices tell them.
//!
//! A vertex on a lattice edge along x is where a run of voxels of a cell ends and one of an object
//! begins, or the other way round. So the number of a cell's voxels, and every moment of them, is a sum
//! over such vertices: what lies before the run's end less what lies before its start. Only runs that
//! end at the volume's own faces across x have no vertex there; where a cell reaches one of the two
//! faces, sums are taken from that face, and where it reaches both they are not known by themselves.

use super::first::First;
use super::marks::{BITS, axis};
use super::piece::{DOWN, Piece, Region, UP, Vertex};
use super::rim::{self, Rim};
use crate::grid::{Extent, Placement};
use crate::sys::simd::dispatch;

/// Sums over the ends of runs along x, those of the cell counted up and those of the object down: of
/// each of [1, y, z, yy, zz, yz] times the number of voxels before the end at b, of [1, y, z] times the
/// sum of their x, of the sum of their xx.
const SUMS: usize = 10;

/// Vertices whose boxes are found side by side.
const LANES: usize = 8;

/// A box of voxels; empty at first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    pub lo: [u16; 3],
    pub hi: [u16; 3],
}

impl Default for Span {
    fn default() -> Self {
        Span {
            lo: [u16::MAX; 3],
            hi: [0; 3],
        }
    }
}

impl Span {
    pub fn add(&mut self, other: &Span) {
        for a in 0..3 {
            self.lo[a] = self.lo[a].min(other.lo[a]);
            self.hi[a] = self.hi[a].max(other.hi[a]);
        }
    }

    /// Of a box that may reach beyond the volume.
    fn clamped([lo, hi]: [[i32; 3]; 2]) -> Self {
        let clamp = |v: [i32; 3]| v.map(|c| c.clamp(0, i32::from(u16::MAX)) as u16);
        let (lo, hi) = (clamp(lo), clamp(hi));
        Span { lo, hi }
    }

    fn words(&self) -> [u16; 6] {
        let ([a, b, c], [d, e, f]) = (self.lo, self.hi);
        [a, b, c, d, e, f]
    }
}

/// The voxels on both sides of a surface, or of several.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Inside {
    /// Around the voxels of the cell that the surface touches.
    pub below: Span,
    /// The same of the object.
    pub above: Span,
    /// Where the surface comes first.
    pub first: First,
    /// The curves on the volume's faces.
    pub rim: Rim,
    /// How far the voxels of the cell and of the object at the ends of vertices' lattice edges reach along the axes
    /// of the world, if these are not the grid's.
    pub far: [Extent; 2],
    sums: [i128; SUMS],
}

/// Words that [`Inside::pack`] takes.
pub(super) const WORDS: usize = FAR + 12;

/// Words before those of [`Inside::far`].
const FAR: usize = 3 + 3 + rim::WORDS + 2 * SUMS;

impl Inside {
    /// From the vertices that are the tile's own, of a piece whose triangles have been summed. `rotated` is where the
    /// grid lies, if its axes are not those of the world.
    pub fn of(piece: &Piece, region: &Region, rotated: Option<&Placement>) -> Self {
        Self::of_some(&piece.points, &piece.state, region, rotated)
    }

    /// The same from some of a piece's vertices.
    pub fn of_some(
        points: &[Vertex],
        state: &[u8],
        region: &Region,
        rotated: Option<&Placement>,
    ) -> Self {
        let mut out = dispatch!(Self::of_vertices(points, state, region));
        if let Some(place) = rotated {
            out.far = far(points, state, place);
        }
        out
    }

    #[inline(always)]
    pub(super) fn of_vertices(points: &[Vertex], state: &[u8], region: &Region) -> Self {
        let mut out = Inside::default();
        for (points, state) in points.chunks(CHUNK).zip(state.chunks(CHUNK)) {
            let mut sums = [0; SUMS];
            let mut ends = [0; CHUNK];
            for &i in run_ends(points, region, &mut ends) {
                let (at, sign) = run_end(points[usize::from(i)], state[usize::from(i)]);
                end_run(&mut sums, at, sign);
            }
            for (sum, part) in out.sums.iter_mut().zip(divided(sums)) {
                *sum += i128::from(part);
            }
        }
        [out.below, out.above] = spans(points, state);
        out.first = First::of(points, state, [out.below.lo[2], out.above.lo[2]]);
        out.rim = Rim::of(points, state, region);
        out
    }

    pub fn add(&mut self, other: &Inside) {
        self.below.add(&other.below);
        self.above.add(&other.above);
        self.first.add(&other.first);
        self.rim.add(&other.rim);
        for (a, b) in self.far.iter_mut().zip(&other.far) {
            a.merge(b);
        }
        for (a, b) in self.sums.iter_mut().zip(other.sums) {
            *a = a.wrapping_add(b);
        }
    }

    /// As words of a record.
    pub fn pack(&self) -> [u64; WORDS] {
        let mut out = [0; WORDS];
        let boxes = self.below.words().into_iter().chain(self.above.words());
        for (i, v) in boxes.enumerate() {
            out[i / 4] |= u64::from(v) << (16 * (i % 4));
        }
        let First {
            vertex,
            below,
            above,
        } = self.first;
        out[3..6].copy_from_slice(&[vertex, below, above]);
        let sums = self.sums.iter().map(|s| *s as u128);
        let sums = sums.flat_map(|s| [(s >> 64) as u64, s as u64]);
        let rest = self.rim.words().into_iter().map(|w| w as u64).chain(sums);
        out[6..].iter_mut().zip(rest).for_each(|(to, w)| *to = w);
        let far = self.far.iter().flat_map(Extent::words);
        out[FAR..].iter_mut().zip(far).for_each(|(o, w)| *o = w);
        out
    }

    /// The reverse of [`Inside::pack`]; `words` has [`WORDS`] of them.
    pub fn unpack(words: &[u64]) -> Self {
        let v = |i: usize| (words[i / 4] >> (16 * (i % 4))) as u16;
        let span = |i: usize| Span {
            lo: std::array::from_fn(|a| v(i + a)),
            hi: std::array::from_fn(|a| v(i + 3 + a)),
        };
        let sums = &words[6 + rim::WORDS..FAR];
        let sum = |i: usize| u128::from(sums[2 * i]) << 64 | u128::from(sums[2 * i + 1]);
        Inside {
            below: span(0),
            above: span(6),
            first: First {
                vertex: words[3],
                below: words[4],
                above: words[5],
            },
            rim: Rim::from_words(std::array::from_fn(|i| words[6 + i] as i64)),
            far: [0, 6].map(|i| Extent::from_words(std::array::from_fn(|w| words[FAR + i + w]))),
            sums: std::array::from_fn(|i| sum(i) as i128),
        }
    }

    /// The moments of the cell's voxels, or of the object's, given the sums of [1, y, z, yy, zz, yz] over
    /// those on the far face of a volume that is `nx` voxels long.
    pub fn moments(&self, cell: bool, far: [i64; 6], nx: u32) -> Moments {
        let sign = if cell { 1 } else { -1 };
        let n = i64::from(nx);
        let [x, xx] = power_sums(n).map(i128::from);
        // runs up to the far face end without a vertex
        let s = |i: usize, before: i128, weight: usize| {
            let missing = before.wrapping_mul(i128::from(far[weight]));
            self.sums[i].wrapping_mul(sign).wrapping_add(missing)
        };
        let n = i128::from(n);
        Moments {
            voxels: s(0, n, 0),
            first: [s(6, x, 0), s(1, n, 1), s(2, n, 2)],
            second: [
                s(9, xx, 0),
                s(3, n, 3),
                s(4, n, 4),
                s(7, x, 1),
                s(8, x, 2),
                s(5, n, 5),
            ],
        }
    }
}

/// How far the voxels of the cell, and of the object, at the ends of the vertices' lattice edges reach along the axes of
/// the world.
fn far(points: &[Vertex], state: &[u8], place: &Placement) -> [Extent; 2] {
    let mut far = [Extent::default(); 2];
    for (&[x, y, z, code], &state) in points.iter().zip(state) {
        let low = [x, y, z].map(|c| c >> 8);
        let mut high = low;
        high[usize::from(axis(code))] += 1;
        let cell_is_low = state & (UP | DOWN) == DOWN;
        let ends = if cell_is_low {
            [low, high]
        } else {
            [high, low]
        };
        for (far, end) in far.iter_mut().zip(ends) {
            far.add(place.step(end.map(f64::from)));
        }
    }
    far
}

/// The boxes of the voxels of the cell, and of the object, at the ends of the vertices' lattice edges.
#[inline(always)]
fn spans(points: &[Vertex], state: &[u8]) -> [Span; 2] {
    let mut boxes = ([[[i32::MAX; LANES]; 3]; 2], [[[i32::MIN; LANES]; 3]; 2]);
    let (batches, rest) = points.as_chunks();
    let (states, rest_of_states) = state.as_chunks();
    for (points, state) in batches.iter().zip(states) {
        widen(&mut boxes, points, state);
    }
    for (&p, &s) in rest.iter().zip(rest_of_states) {
        widen(&mut boxes, &[p; LANES], &[s; LANES]);
    }
    let (lo, hi) = boxes;
    let min = |lanes: [i32; LANES]| lanes.iter().fold(i32::MAX, |l, &c| l.min(c));
    let max = |lanes: [i32; LANES]| lanes.iter().fold(i32::MIN, |h, &c| h.max(c));
    std::array::from_fn(|side| Span::clamped([lo[side].map(min), hi[side].map(max)]))
}

/// Lowest and highest voxels, per side, axis and lane.
type Boxes = ([[[i32; LANES]; 3]; 2], [[[i32; LANES]; 3]; 2]);

/// Adds the voxels at the ends of vertices' lattice edges, the cell's and the object's.
#[inline(always)]
fn widen((lo, hi): &mut Boxes, points: &[Vertex; LANES], state: &[u8; LANES]) {
    for a in 0..3 {
        for i in 0..LANES {
            let along = i32::from(points[i][3] >> BITS == a as i32);
            let cell_is_low = i32::from(state[i] & (UP | DOWN) == DOWN);
            let low = points[i][a] >> 8;
            let object = low + (along & cell_is_low);
            let cell = low + (along & !cell_is_low);
            lo[0][a][i] = lo[0][a][i].min(cell);
            hi[0][a][i] = hi[0][a][i].max(cell);
            lo[1][a][i] = lo[1][a][i].min(object);
            hi[1][a][i] = hi[1][a][i].max(object);
        }
    }
}

/// Vertices whose run ends are added up in 64 bits: each adds less than 2^50 to a sum.
const CHUNK: usize = 256;

/// Which of at most [`CHUNK`] vertices are ends of runs that the tile owns.
#[inline(always)]
fn run_ends<'a>(points: &[Vertex], region: &Region, ends: &'a mut [u8; CHUNK]) -> &'a [u8] {
    let first = region.first_owned();
    let mut count = 0;
    for (i, &[x, y, z, code]) in points.iter().enumerate() {
        // written without asking whether it is one: else the next one takes its place
        ends[count % CHUNK] = i as u8;
        let owned = (x >= first[0]) & (y >= first[1]) & (z >= first[2]);
        count += usize::from(owned & (code >> BITS == 0));
    }
    &ends[..count]
}

/// The first voxel behind the run that ends at a vertex, and 1 if the cell ends there, else -1.
#[inline(always)]
fn run_end([x, y, z, _]: Vertex, state: u8) -> ([i64; 3], i64) {
    let sign = i64::from(state & (UP | DOWN) == DOWN) * 2 - 1;
    ([(x >> 8) + 1, y >> 8, z >> 8].map(i64::from), sign)
}

/// Adds the end of a run of voxels before x = b: to sums of k and of k^2 for k in 0..b their doubles and their
/// sixfold, see [`divided`].
#[inline(always)]
fn end_run(sums: &mut [i64; SUMS], [b, y, z]: [i64; 3], sign: i64) {
    let voxels = sign * b;
    let x = voxels * (b - 1);
    let (by, bz) = (voxels * y, voxels * z);
    let all = [
        voxels,
        by,
        bz,
        by * y,
        bz * z,
        by * z,
        x,
        x * y,
        x * z,
        x * (2 * b - 1),
    ];
    sums.iter_mut().zip(all).for_each(|(sum, v)| *sum += v);
}

/// What was added up by [`end_run`].
#[inline(always)]
fn divided(mut sums: [i64; SUMS]) -> [i64; SUMS] {
    sums[6..9].iter_mut().for_each(|sum| *sum /= 2);
    sums[9] /= 6;
    sums
}

/// The sums of k and of k^2 for k in 0..n.
pub(super) fn power_sums(n: i64) -> [i64; 2] {
    [n * (n - 1) / 2, (n - 1) * n * (2 * n - 1) / 6]
}

/// Number of voxels, sums of x, y, z, and of xx, yy, zz, xy, xz, yz.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Moments {
    pub voxels: i128,
    pub first: [i128; 3],
    pub second: [i128; 6],
}

impl Moments {
    /// Mean voxel coordinates.
    pub fn mean(&self) -> [f64; 3] {
        self.first.map(|s| s as f64 / self.voxels as f64)
    }

    /// Covariance in voxel coordinates; a voxel is a box with a second moment of 1/12 of its own.
    pub fn covariance(&self) -> [[f64; 3]; 3] {
        let n = self.voxels;
        let mut out = [[0.0; 3]; 3];
        let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        for (&second, (a, b)) in self.second.iter().zip(pairs) {
            let product = self.first[a].checked_mul(self.first[b]);
            let exact = n
                .checked_mul(second)
                .zip(product)
                .and_then(|(l, r)| l.checked_sub(r));
            let n = n as f64;
            let value = match exact {
                Some(v) => v as f64 / n / n,
                None => second as f64 / n - self.first[a] as f64 / n * (self.first[b] as f64 / n),
            };
            out[a][b] = value + if a == b { 1.0 / 12.0 } else { 0.0 };
            out[b][a] = out[a][b];
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::first::voxel_key;
    use crate::verify::marks;
    use proptest::prelude::*;

    /// The result of [`Inside::of_vertices`], vertex by vertex.
    fn slow_of(points: &[Vertex], state: &[u8], region: &Region) -> Inside {
        let mut out = Inside::default();
        for (&[x, y, z, code], &state) in points.iter().zip(state) {
            let (p, axis) = ([x, y, z], usize::from(axis(code)));
            let low = p.map(|c| c >> 8);
            let mut high = low;
            high[axis] += 1;
            let cell_is_low = state & (UP | DOWN) == DOWN;
            let (cell, object) = if cell_is_low {
                (low, high)
            } else {
                (high, low)
            };
            out.below.add(&Span::clamped([cell; 2]));
            out.above.add(&Span::clamped([object; 2]));
            let vertex = voxel_key(low) << 2 | axis as u64;
            let (below, above) = (voxel_key(cell), voxel_key(object));
            out.first.add(&First {
                vertex,
                below,
                above,
            });
            if axis == 0 && region.owns(p) {
                let at = high.map(i64::from);
                add_run_end(&mut out, at, if cell_is_low { 1 } else { -1 });
            }
        }
        out
    }

    proptest! {
        #[test]
        fn vertices_say_the_same_all_at_once(
            vertices in prop::collection::vec(
                ([0..500i32, 0..500, 0..500], 0..3u8, prop::sample::select(vec![0, UP, DOWN, UP | DOWN])),
                0..600,
            ),
            corner in prop::array::uniform3(prop_oneof![Just(0), Just(64), 0..65_000]),
            size in prop_oneof![Just(4), Just(500)],
        ) {
            let region = Region {
                lo: corner.map(|c| c * 256),
                hi: corner.map(|c| (c + size) * 256),
                end: [65_535 * 256; 3],
            };
            let place = |(voxel, axis, _): &([i32; 3], u8, u8)| -> Vertex {
                let along: [i32; 3] = std::array::from_fn(|a| i32::from(a == usize::from(*axis)));
                let voxel = std::array::from_fn(|a| corner[a] + voxel[a].min(size - along[a]));
                let [x, y, z] = std::array::from_fn(|a| voxel[a] * 256 + 77 * along[a]);
                [x, y, z, marks::code(voxel, along)]
            };
            let points: Vec<_> = vertices.iter().map(place).collect();
            let state: Vec<_> = vertices.iter().map(|v| v.1 | v.2 | 4).collect();
            let mut slow = slow_of(&points, &state, &region);
            slow.rim = Rim::of(&points, &state, &region);
            prop_assert_eq!(Inside::of_vertices(&points, &state, &region), slow);
            prop_assert_eq!(dispatch!(Inside::of_vertices(&points, &state, &region)), slow);
        }
    }

    fn add_run_end(inside: &mut Inside, at: [i64; 3], sign: i64) {
        let mut sums = [0; SUMS];
        end_run(&mut sums, at, sign);
        for (sum, part) in inside.sums.iter_mut().zip(divided(sums)) {
            *sum += i128::from(part);
        }
    }

    /// The moments of a set of voxels of a row along x, added up one by one.
    fn plain(voxels: &[[i128; 3]]) -> Moments {
        let mut m = Moments::default();
        for &[x, y, z] in voxels {
            m.voxels += 1;
            for (s, v) in m.first.iter_mut().zip([x, y, z]) {
                *s += v;
            }
            for (s, v) in m
                .second
                .iter_mut()
                .zip([x * x, y * y, z * z, x * y, x * z, y * z])
            {
                *s += v;
            }
        }
        m
    }

    #[test]
    fn ends_of_runs_give_the_moments_of_what_lies_between() {
        let mut inside = Inside::default();
        let mut voxels = Vec::new();
        for (start, end, y, z) in [(2, 7, 3, 5), (9, 10, 3, 5), (1, 4, 6, 0)] {
            add_run_end(&mut inside, [start, y, z], -1);
            add_run_end(&mut inside, [end, y, z], 1);
            voxels.extend((start..end).map(|x| [x, y, z].map(i128::from)));
        }
        assert_eq!(inside.moments(true, [0; 6], 12), plain(&voxels));
        inside.first.above = 77;
        assert_eq!(Inside::unpack(&inside.pack()), inside);
    }

    #[test]
    fn runs_that_reach_the_far_face_end_there() {
        let mut inside = Inside::default();
        add_run_end(&mut inside, [4, 2, 9], -1);
        let voxels: Vec<_> = (4..11).map(|x| [x, 2, 9]).collect();
        let far = [1, 2, 9, 4, 81, 18];
        assert_eq!(inside.moments(true, far, 11), plain(&voxels));
        let voxels: Vec<_> = (0..4).map(|x| [x, 2, 9]).collect();
        assert_eq!(inside.moments(false, [0; 6], 11), plain(&voxels));
        assert!((plain(&voxels).covariance()[0][0] - (1.25 + 1.0 / 12.0)).abs() < 1e-12);
    }
}
