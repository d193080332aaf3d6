//! The curves of a surface on the volume's own faces, where runs of voxels end without a vertex.
//!
//! The voxels of the far face across x are runs along y, which end at vertices on that face; those of its
//! far edge are runs along z; and the far corner is one voxel. So what vertices do not say of a body comes
//! down to which of the volume's corners it holds. Along an edge of the volume, vertices say by how much
//! the two corners differ; the rest is one bit, which the number of voxels decides, see [`super::bodies`].
//!
//! The curves in which a surface meets the faces turn by quarters where they cut a corner off a square of
//! four voxels. The part of the faces that a body covers has the Euler characteristic of its quarters and
//! corners together, over four: a square with one of its voxels has a quarter, one with three has minus a
//! quarter, one with two that touch has none, and a corner of the volume lies in three squares, not four.

use super::inside::power_sums;
use super::marks::axis;
use super::piece::{DOWN, Region, UP, Vertex, position};

/// Sums over vertices on the volume's faces, those at which the cell ends counted up and those at which
/// the object ends counted down. They wrap; what they come to for a body fits.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Rim {
    /// Ends of runs along y on the far face across x, before voxel b: of each of [1, z, zz] times b, of
    /// [1, z] times the sum of y, of the sum of yy. In the order of [`Rim::face_sums`].
    face: [i64; 6],
    /// Ends of runs along z on the edge that is far across x and y: of b, of the sums of z and zz.
    line: [i64; 3],
    /// Vertices on edges of the volume: four along z, at the near and far end of x and y, x first; two
    /// along y where z is far; and one along x where y and z are.
    along: [i64; 7],
    /// Quarters that the cell's side of the border curves turns.
    pub turns: i64,
}

/// Words of a [`Rim`].
pub(super) const WORDS: usize = 17;

/// True if the cell is at the lower end of the vertex's lattice edge.
#[inline(always)]
pub(super) fn cell_is_low(state: u8) -> bool {
    state & (UP | DOWN) == DOWN
}

impl Rim {
    /// From the vertices of a piece that are the tile's own.
    pub fn of(points: &[Vertex], state: &[u8], region: &Region) -> Self {
        let mut out = Rim::default();
        let outer = |f| region.outer(f);
        let sides = outer(0) || outer(1);
        let edges = (sides && (outer(2) || outer(3) || outer(5))) || (outer(3) && outer(5));
        if outer(1) || edges {
            let end = region.end;
            for (point, state) in points.iter().zip(state) {
                let [x, y, z, _] = *point;
                // few of them, so this is asked first
                if (x == 0) | (x == end[0]) | ((y == end[1]) & (z == end[2])) {
                    out.add_vertex(*point, *state, region);
                }
            }
        }
        out
    }

    fn add_vertex(&mut self, point: Vertex, state: u8, region: &Region) {
        let p = position(point);
        let end = region.end;
        let [near, far] =
            [0, 1].map(|far| [0, 1, 2].map(|a| p[a] == if far == 1 { end[a] } else { 0 }));
        let sign = if cell_is_low(state) { 1 } else { -1 };
        let [x, y] = [0, 1].map(|a| usize::from(far[a]));
        match axis(point[3]) {
            0 if far[1] && far[2] && region.owns(p) => self.along[6] += sign,
            1 if (near[0] || far[0]) && region.owns(p) => {
                if far[2] {
                    self.along[4 + x] += sign;
                }
                if far[0] {
                    self.end_on_face([p[1], p[2]].map(|c| i64::from(c >> 8)), sign);
                }
            }
            2 if (near[0] || far[0]) && (near[1] || far[1]) && region.owns(p) => {
                self.along[x + 2 * y] += sign;
                if far[0] && far[1] {
                    self.end_on_line(i64::from(p[2] >> 8) + 1, sign);
                }
            }
            _ => {}
        }
    }

    /// Adds the end of a run whose last voxel is (y, z).
    fn end_on_face(&mut self, [y, z]: [i64; 2], sign: i64) {
        for (sum, value) in self
            .face
            .iter_mut()
            .zip(Self::face_sums([1, z, z * z], y + 1))
        {
            *sum = sum.wrapping_add(sign * value);
        }
    }

    /// Sums over `n` voxels from y = 0 of [1, y, z, yy, zz, yz], given [1, z, zz] of them.
    fn face_sums([one, z, zz]: [i64; 3], n: i64) -> [i64; 6] {
        let [y, yy] = power_sums(n);
        [
            n.wrapping_mul(one),
            y.wrapping_mul(one),
            n.wrapping_mul(z),
            yy.wrapping_mul(one),
            n.wrapping_mul(zz),
            y.wrapping_mul(z),
        ]
    }

    fn end_on_line(&mut self, b: i64, sign: i64) {
        let [z, zz] = power_sums(b);
        for (sum, value) in self.line.iter_mut().zip([b, z, zz]) {
            *sum = sum.wrapping_add(sign * value);
        }
    }

    /// Adds an edge of a border curve, given its ends and the state of the first: where they lie on lattice
    /// edges along different axes, it cuts a voxel off a square.
    pub fn add_border_edge(&mut self, [a, b]: [Vertex; 2], state: u8) {
        let along = axis(a[3]);
        if along == axis(b[3]) {
            return;
        }
        let along = usize::from(along);
        let voxel_is_low = b[along] >> 8 == a[along] >> 8;
        self.turns += if voxel_is_low == cell_is_low(state) {
            1
        } else {
            -1
        };
    }

    pub fn add(&mut self, other: &Rim) {
        for (sum, value) in self.words_mut().into_iter().zip(other.words()) {
            *sum = sum.wrapping_add(value);
        }
    }

    /// As seen by the cell, or by the object.
    pub fn seen_by(&self, cell: bool) -> Self {
        let mut out = *self;
        if !cell {
            out.words_mut()
                .into_iter()
                .for_each(|w| *w = w.wrapping_neg());
        }
        out
    }

    fn words_mut(&mut self) -> [&mut i64; WORDS] {
        let [a, b, c, d, e, f] = &mut self.face;
        let [g, h, i] = &mut self.line;
        let [j, k, l, m, n, o, p] = &mut self.along;
        [
            a,
            b,
            c,
            d,
            e,
            f,
            g,
            h,
            i,
            j,
            k,
            l,
            m,
            n,
            o,
            p,
            &mut self.turns,
        ]
    }

    pub fn words(&self) -> [i64; WORDS] {
        let mut own = *self;
        own.words_mut().map(|w| *w)
    }

    /// The reverse of [`Rim::words`].
    pub fn from_words(words: [i64; WORDS]) -> Self {
        let mut out = Rim::default();
        for (to, word) in out.words_mut().into_iter().zip(words) {
            *to = word;
        }
        out
    }

    /// Sums over the voxels on the far face across x of [1, y, z, yy, zz, yz], of a body that holds the far
    /// corner or not, in a volume of this size.
    pub fn far_face(&self, corner: bool, dims: [u32; 3]) -> [i64; 6] {
        let [_, ny, nz] = dims.map(i64::from);
        let [z, zz] = power_sums(nz);
        let corner = i64::from(corner);
        let line = [nz, z, zz].map(|v| corner * v);
        let line: [i64; 3] = std::array::from_fn(|i| self.line[i].wrapping_add(line[i]));
        let missing = Self::face_sums(line, ny);
        std::array::from_fn(|i| self.face[i].wrapping_add(missing[i]))
    }

    /// The corners of the volume that a body holds, given whether it holds the far one: bit 0 of a corner's
    /// number is x, bit 1 y, bit 2 z. `None` if there is no such body.
    pub fn corners(&self, far: bool) -> Option<u8> {
        let mut held = [0i64; 8];
        held[7] = i64::from(far);
        held[6] = held[7] + self.along[6];
        for x in 0..2 {
            held[4 + x] = held[6 + x] + self.along[4 + x];
        }
        for i in 0..4 {
            held[i] = held[4 + i] + self.along[i];
        }
        let bit = |(i, h): (usize, &i64)| match h {
            0 => Some(0),
            1 => Some(1u8 << i),
            _ => None,
        };
        held.iter().enumerate().map(bit).sum()
    }
}
