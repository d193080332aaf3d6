//! One surface piece of a tile: its vertices as integers, its triangles, its edges.
//!
//! All geometry is in lattice units (voxel / 256), in which it is exact: a triangle's area vector
//! fits an `i32` because the triangle lies in one cube, and six times the volume that it spans with
//! the origin is summed in an `i128`.

use super::code::Code;
use super::edges::{Edges, Matched};
use super::facets::{BATCH, facets};
use super::inside::Inside;
use super::marks::{self, code, mark};
use super::places::{Limits, places};
use crate::sys::simd::dispatch;

/// Where a tile lies, in lattice units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region {
    /// Lower corner of the macrocube.
    pub lo: [i32; 3],
    /// Upper corner of the macrocube.
    pub hi: [i32; 3],
    /// The last voxel of the volume.
    pub end: [i32; 3],
}

/// A face of a macrocube: twice the axis, plus 1 for the upper side.
pub(super) type Face = usize;

impl Region {
    /// The coordinate of a face's plane along its axis.
    pub fn plane(&self, face: Face) -> i32 {
        let side = if face.is_multiple_of(2) {
            &self.lo
        } else {
            &self.hi
        };
        side[face / 2]
    }

    /// True if the face lies on the volume's face.
    pub fn outer(&self, face: Face) -> bool {
        let a = face / 2;
        if face.is_multiple_of(2) {
            self.lo[a] == 0
        } else {
            self.hi[a] == self.end[a]
        }
    }

    /// True if this tile is the first of those that share the vertex, in the order of tiles.
    pub fn owns(&self, p: [i32; 3]) -> bool {
        (0..3).all(|a| p[a] != self.lo[a] || self.lo[a] == 0)
    }

    /// True if this tile is the last of those that share the vertex.
    pub fn is_last(&self, p: [i32; 3]) -> bool {
        (0..3).all(|a| p[a] != self.hi[a] || self.hi[a] == self.end[a])
    }

    /// The smallest coordinates of vertices inside the region that [`Region::owns`] holds for.
    pub fn first_owned(&self) -> [i32; 3] {
        self.lo.map(|lo| lo + i32::from(lo != 0))
    }

    /// True if the vertex lies half a voxel outside the volume.
    fn outside_volume(&self, p: [i32; 3]) -> bool {
        (0..3).any(|a| p[a] < 0 || p[a] > self.end[a])
    }

    /// The lattice point of a position, and the axis of its lattice edge; or what is wrong with it.
    #[inline]
    fn locate(&self, p: [f32; 3], cap: bool) -> Result<([i32; 3], u8), Code> {
        let scaled = p.map(|c| c * 256.0);
        // `as` saturates and maps NaN to 0, so equality also rules out what does not fit
        let q = scaled.map(|c| c as i32);
        if (0..3).any(|a| q[a] as f32 != scaled[a]) {
            return Err(if p.iter().all(|c| c.is_finite()) {
                Code::PositionOffLattice
            } else {
                Code::PositionNotFinite
            });
        }
        let off = q.map(|c| u8::from(c & 255 != 0));
        if off[0] + off[1] + off[2] != 1 {
            return Err(Code::PositionOffLattice);
        }
        let inside = (0..3).all(|a| self.lo[a] <= q[a] && q[a] <= self.hi[a]);
        let allowed = if cap {
            self.cap_vertex(q) || (inside && self.on_volume_face(q))
        } else {
            inside
        };
        if allowed {
            Ok((q, off[1] + 2 * off[2]))
        } else {
            Err(Code::PositionOutsideTile)
        }
    }

    fn on_volume_face(&self, q: [i32; 3]) -> bool {
        (0..3).any(|a| q[a] == 0 || q[a] == self.end[a])
    }

    /// True if the point lies half a voxel outside one of this tile's faces on the volume's face.
    fn cap_vertex(&self, q: [i32; 3]) -> bool {
        let beyond = |a: usize| {
            (self.lo[a] == 0 && q[a] == -128)
                || (self.hi[a] == self.end[a] && q[a] == self.end[a] + 128)
        };
        let within = |a: usize| self.lo[a] <= q[a] && q[a] <= self.hi[a];
        (0..3).all(|a| within(a) || beyond(a)) && (0..3).filter(|&a| beyond(a)).count() == 1
    }
}

/// A vertex: its position in lattice units, and the code of its lattice edge, see [`super::marks`].
pub(super) type Vertex = [i32; 4];

/// The position of a vertex.
#[inline(always)]
pub(super) fn position([x, y, z, _]: Vertex) -> [i32; 3] {
    [x, y, z]
}

/// A piece's vertices and triangles; a workspace that is cleared, not rebuilt.
#[derive(Default)]
pub(super) struct Piece {
    /// True for a cap.
    pub cap: bool,
    /// Positions as read, in voxels.
    pub positions: Vec<[f32; 3]>,
    /// Normals as read, if they are to be compared with a volume or with other parts of the surface.
    pub normals: Vec<[f32; 3]>,
    pub points: Vec<Vertex>,
    /// Per vertex: bits 0-1 the axis of its lattice edge, and what triangles say of it, see below.
    pub state: Vec<u8>,
    /// Triangles as indices into `points`, all of them in range.
    pub triangles: Vec<[u32; 3]>,
}

/// A triangle uses the vertex.
pub(super) const USED: u8 = 4;
/// A triangle's area vector points up along the vertex's lattice edge: below is at the upper end.
pub(super) const UP: u8 = 8;
/// A triangle's area vector points down along it.
pub(super) const DOWN: u8 = 128;

/// A finding inside a piece: its kind, how often, and where first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flaw {
    pub code: Code,
    pub count: u64,
    pub first: [i32; 3],
}

/// Counts findings of one kind.
#[derive(Default)]
pub(super) struct Tally {
    pub count: u64,
    first: [i32; 3],
}

impl Tally {
    pub fn add(&mut self, place: [i32; 3]) {
        if self.count == 0 {
            self.first = place;
        }
        self.count += 1;
    }

    pub fn report(&self, code: Code, flaws: &mut Vec<Flaw>) {
        if self.count > 0 {
            flaws.push(Flaw {
                code,
                count: self.count,
                first: self.first,
            });
        }
    }
}

/// Sums over a piece.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    pub triangles: u64,
    /// Vertices that this tile is the first to have.
    pub vertices: u64,
    /// Edges between two triangles of the piece.
    pub edges: u64,
    /// Edges on the volume's faces.
    pub border: u64,
    /// In squares of the placement's unit.
    pub area: f64,
    /// Six times the signed volume spanned with the origin.
    pub volume6: i128,
    /// What the vertices say of the voxels on both sides.
    pub inside: Inside,
}

impl Sums {
    pub fn add(&mut self, other: &Sums) {
        self.triangles += other.triangles;
        self.vertices += other.vertices;
        self.edges += other.edges;
        self.border += other.border;
        self.area += other.area;
        self.volume6 += other.volume6;
        self.inside.add(&other.inside);
    }
}

impl Piece {
    /// Replaces the vertices by those at [`Piece::positions`] and returns how many of them the tile owns.
    ///
    /// Findings: a position that is not finite, off the lattice or outside the tile.
    pub fn read_points(&mut self, region: &Region, flaws: &mut Vec<Flaw>) -> u64 {
        self.points.clear();
        self.state.clear();
        let mut bad = [Tally::default(), Tally::default(), Tally::default()];
        let owned = dispatch!(self.locate_batches(region, &mut bad));
        bad[0].report(Code::PositionNotFinite, flaws);
        bad[1].report(Code::PositionOffLattice, flaws);
        bad[2].report(Code::PositionOutsideTile, flaws);
        owned
    }

    /// Locates positions in batches, caps and those of a batch with a flaw one by one; see
    /// [`Piece::read_points`].
    #[inline(always)]
    fn locate_batches(&mut self, region: &Region, bad: &mut [Tally; 3]) -> u64 {
        let mut owned = 0;
        let all = std::mem::take(&mut self.positions);
        let (batches, rest) = all.as_chunks();
        let limits = Limits::new(region);
        for batch in batches {
            match places(batch, &limits) {
                Some(places) if !self.cap => {
                    self.points.extend_from_slice(&places.points);
                    self.state.extend_from_slice(&places.axes);
                    owned += places.owned;
                }
                _ => owned += self.locate_each(batch, region, bad),
            }
        }
        owned += self.locate_each(rest, region, bad);
        self.positions = all;
        owned
    }

    /// Locates positions one by one and returns how many of them the tile owns.
    #[inline(never)]
    fn locate_each(
        &mut self,
        positions: &[[f32; 3]],
        region: &Region,
        bad: &mut [Tally; 3],
    ) -> u64 {
        let mut owned = 0;
        for &p in positions {
            let (q, axis) = region.locate(p, self.cap).unwrap_or_else(|code| {
                let kind = match code {
                    Code::PositionNotFinite => 0,
                    Code::PositionOffLattice => 1,
                    _ => 2,
                };
                let place = p.map(|c| (c * 256.0) as i32);
                bad[kind].add(place);
                (place, 0)
            });
            let counts = !self.cap || region.outside_volume(q);
            owned += u64::from(counts && region.owns(q));
            let along = std::array::from_fn(|a| i32::from(a == usize::from(axis)));
            let code = code(q.map(|c| c >> 8), along);
            self.points.push([q[0], q[1], q[2], code]);
            self.state.push(axis);
        }
        owned
    }

    fn corners(&self, t: [u32; 3]) -> [Vertex; 3] {
        t.map(|i| self.points[i as usize])
    }

    /// The place of a triangle, for messages.
    fn place(&self, t: [u32; 3]) -> [i32; 3] {
        position(self.points[t[0] as usize])
    }

    /// The area vector (twice the area, along the normal) of a triangle, or `None` if the triangle
    /// does not lie in one cube.
    #[inline]
    fn area_vector(&self, t: [u32; 3]) -> Option<[i32; 3]> {
        let [p, q, r] = self.corners(t);
        let mut spread = 0;
        for a in 0..3 {
            let min = p[a].min(q[a]).min(r[a]);
            let max = p[a].max(q[a]).max(r[a]);
            // how far the largest coordinate lies beyond the cube of the smallest
            spread |= (i64::from(min & !255) + 256 - i64::from(max)) >> 63;
        }
        if spread != 0 {
            return None;
        }
        let e = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
        let f = [r[0] - p[0], r[1] - p[1], r[2] - p[2]];
        Some([
            e[1] * f[2] - e[2] * f[1],
            e[2] * f[0] - e[0] * f[2],
            e[0] * f[1] - e[1] * f[0],
        ])
    }

    /// The area of a triangle in one cube, by a scale as in [`Piece::sum_triangles`], and six times the volume that it spans
    /// with the origin.
    pub fn measure(&self, t: [u32; 3], scale: [f64; 3]) -> (f64, i128) {
        let n = self.area_vector(t).unwrap_or_default();
        let [x, y, z] = [0, 1, 2].map(|a| f64::from(n[a]) * scale[a]);
        let corner = self.points[t[0] as usize];
        let six: i64 = (0..3).map(|a| i64::from(corner[a]) * i64::from(n[a])).sum();
        (0.5 * (x * x + y * y + z * z).sqrt(), six.into())
    }

    /// Sums up triangles, notes in `state` which way they face at each vertex, and enters their edges.
    ///
    /// `scale` turns the components of an area vector into twice the physical area. Findings:
    /// triangles without area or outside a cube, unused vertices.
    pub fn sum_triangles(
        &mut self,
        scale: [f64; 3],
        region: &Region,
        edges: &mut Edges,
        flaws: &mut Vec<Flaw>,
    ) -> Sums {
        let mut sums = Sums {
            triangles: self.triangles.len() as u64,
            ..Sums::default()
        };
        let mut bad = [Tally::default(), Tally::default()];
        edges.begin(self.points.len());
        dispatch!(self.sum_batches(scale, region, edges, &mut sums, &mut bad));
        edges.balance(&mut self.state);
        let [outside, flat] = bad;
        sums.area *= 0.5;
        let mut unused = Tally::default();
        let all_used = self.state.iter().fold(USED, |all, s| all & s) != 0;
        if !all_used && outside.count == 0 {
            for (state, p) in self.state.iter().zip(&self.points) {
                if state & USED == 0 {
                    unused.add(position(*p));
                }
            }
        }
        outside.report(Code::TriangleOutsideCube, flaws);
        flat.report(Code::DegenerateTriangle, flaws);
        unused.report(Code::UnusedVertex, flaws);
        sums
    }

    /// Sums up triangles in batches, those of a batch with a flaw one by one; see
    /// [`Piece::sum_triangles`] and [`Piece::sum_triangle`].
    #[inline(always)]
    fn sum_batches(
        &mut self,
        scale: [f64; 3],
        region: &Region,
        edges: &mut Edges,
        sums: &mut Sums,
        bad: &mut [Tally; 2],
    ) {
        let all = std::mem::take(&mut self.triangles);
        let (batches, rest) = all.as_chunks::<BATCH>();
        for batch in batches {
            let Some(facets) = facets(&self.points, batch, scale, region) else {
                for &t in batch {
                    self.sum_triangle(t, scale, edges, sums, bad);
                }
                continue;
            };
            edges.enter_batch(batch, &facets);
            sums.volume6 += i128::from(facets.volume6);
            // one after the other, as they are rounded
            sums.area = facets.areas.iter().fold(sums.area, |sum, area| sum + area);
        }
        for &t in rest {
            self.sum_triangle(t, scale, edges, sums, bad);
        }
        self.triangles = all;
    }

    /// Adds a triangle to the sums, or to those that are `bad`: outside a cube, or without area.
    #[inline(never)]
    fn sum_triangle(
        &mut self,
        t: [u32; 3],
        scale: [f64; 3],
        edges: &mut Edges,
        sums: &mut Sums,
        [outside, flat]: &mut [Tally; 2],
    ) {
        let Some(n) = self.area_vector(t) else {
            outside.add(self.place(t));
            return;
        };
        if n == [0; 3] {
            flat.add(self.place(t));
        }
        let corners = self.corners(t);
        let codes = corners.map(|p| p[3]);
        let marks = std::array::from_fn(|k| {
            let along = n[usize::from(marks::axis(codes[k]))];
            mark(codes[k], codes[(k + 1) % 3], codes[(k + 2) % 3], along)
        });
        edges.enter(t, marks);
        let six: i64 = (0..3)
            .map(|a| i64::from(corners[0][a]) * i64::from(n[a]))
            .sum();
        sums.volume6 += i128::from(six);
        let [x, y, z] = [0, 1, 2].map(|a| f64::from(n[a]) * scale[a]);
        sums.area += (x * x + y * y + z * z).sqrt();
    }

    /// Names what makes edges or vertex states contradict each other: triangles that occur twice,
    /// else an edge of more than two triangles, else triangles that face the other way than most
    /// at one of their vertices. Slow.
    pub fn diagnose(&self, matched: &Matched, flaws: &mut Vec<Flaw>) {
        let turned = |t: &[u32; 3]| {
            let first = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
            [t[first], t[(first + 1) % 3], t[(first + 2) % 3]]
        };
        let mut all: Vec<[u32; 3]> = self.triangles.iter().map(turned).collect();
        all.sort_unstable();
        let mut twice = Tally::default();
        for pair in all.windows(2).filter(|w| w[0] == w[1]) {
            twice.add(self.place(pair[0]));
        }
        twice.report(Code::DuplicateTriangle, flaws);
        if twice.count > 0 {
            return;
        }
        if let Some([tail, _]) = matched.crowded {
            let mut crowded = Tally::default();
            crowded.add(position(self.points[tail as usize]));
            crowded.report(Code::EdgeRepeated, flaws);
            return;
        }
        let mut flipped = self.flipped();
        if let (0, Some([tail, _])) = (flipped.count, matched.same_way) {
            flipped.add(position(self.points[tail as usize]));
        }
        flipped.report(Code::FlippedTriangle, flaws);
    }

    /// Triangles that face against the majority at one of their vertices.
    fn flipped(&self) -> Tally {
        let mut votes = vec![0i64; self.points.len()];
        let facing = |t: &[u32; 3]| {
            let n = self.area_vector(*t).unwrap_or_default();
            t.map(|i| i64::from(n[usize::from(self.state[i as usize] & 3)].signum()))
        };
        for t in &self.triangles {
            for (i, way) in t.iter().zip(facing(t)) {
                votes[*i as usize] += way;
            }
        }
        let mut tally = Tally::default();
        for t in &self.triangles {
            let against = t
                .iter()
                .zip(facing(t))
                .filter(|&(&i, way)| way * votes[i as usize] < 0)
                .count();
            if against > 0 {
                tally.add(self.place(*t));
            }
        }
        if tally.count == 0 {
            // as many triangles face one way as the other: name the first vertex
            let both = |s: &u8| s & (UP | DOWN) == UP | DOWN;
            for (_, p) in self.state.iter().zip(&self.points).filter(|(s, _)| both(s)) {
                tally.add(position(*p));
            }
        }
        tally
    }

    /// True if triangles contradict each other at a vertex.
    pub fn contradicts(&self) -> bool {
        // UP where both are set
        let both = |any: u8, s: &u8| any | (s & (s >> (DOWN / UP).trailing_zeros()));
        self.state.iter().fold(0, both) & UP != 0
    }
}

#[cfg(test)]
mod tests;
