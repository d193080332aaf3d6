//! Comparison of a tile with the samples it was made from.
//!
//! A lattice edge has a vertex iff its two voxels differ, so the vertices of a macrocube are known
//! from its bits, and so is the number of triangles in each cube: a cube's surface is made of discs,
//! one fewer than its corners' connected components, and a disc with n corners has n - 2 triangles.
//! The components are counted as the rule for ambiguous faces joins them.

use super::code::Code;
use super::dust::Filled;
use super::gradient::{crossed, normals};
use super::piece::{DOWN, Flaw, Piece, Region, UP, position};
use super::spill::Merge;
use super::walls::{Crossing, Slant, WallScale, by_samples};
use crate::error::{Error, Result};
use crate::grid::Ambiguous;
use crate::volume::{Volume, Voxel, with_voxel_type};
use std::ops::Range;

/// Triangles per case of 8 bits; bit c is corner (c & 1, c >> 1 & 1, c >> 2 & 1).
pub(super) struct CubeTriangles([u8; 256]);

impl CubeTriangles {
    pub fn new(rule: Ambiguous) -> Self {
        let (above, below) = match rule {
            Ambiguous::Separate => (1, 2),
            Ambiguous::Join => (2, 1),
        };
        CubeTriangles(std::array::from_fn(|case| {
            let case = case as u8;
            let loops = components(case, above) + components(!case, below) - 1;
            let edge = |c: usize, bit: usize| (case >> c ^ case >> (c | bit)) & 1;
            let crossed: u8 = (0..8).flat_map(|c| [1, 2, 4].map(|bit| edge(c, bit))).sum();
            // the loop count of an empty or full cube is 0
            crossed - 2 * loops
        }))
    }
}

/// Connected components of the set corners of a cube; corners that differ in up to `reach` of their
/// three coordinates are neighbours: 1 is 6-connected, 2 is 18-connected.
fn components(set: u8, reach: u32) -> u8 {
    let mut left = set;
    let mut count = 0;
    while left != 0 {
        let mut part = left & left.wrapping_neg();
        loop {
            let near = |c: u32| (0..8).any(|d| part >> d & 1 == 1 && (c ^ d).count_ones() <= reach);
            let grown: u8 = (0..8)
                .filter(|&c| left >> c & 1 == 1 && near(c))
                .map(|c| 1 << c)
                .sum();
            if grown == part {
                break;
            }
            part = grown;
        }
        left &= !part;
        count += 1;
    }
    count
}

/// A macrocube's voxels, with a layer of outside ones where caps lie.
#[derive(Default, Clone, Copy)]
pub(super) struct Block {
    lo: [i32; 3],
    /// Voxels per axis.
    size: [usize; 3],
}

impl Block {
    fn new(region: &Region, cap: bool) -> Self {
        let pad = |face| i32::from(cap && region.outer(face));
        let lo = std::array::from_fn(|a| region.lo[a] / 256 - pad(2 * a));
        let end = |a: usize| region.hi[a] / 256 + pad(2 * a + 1);
        Block {
            lo,
            size: std::array::from_fn(|a| (end(a) - lo[a] + 1) as usize),
        }
    }

    fn strides(&self) -> [usize; 3] {
        [1, self.size[0], self.size[0] * self.size[1]]
    }

    fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// The voxel at or below a point of the block, in lattice units.
    pub fn index(&self, p: [i32; 3]) -> usize {
        let at = |a: usize| ((p[a] >> 8) - self.lo[a]) as usize;
        at(0) + self.size[0] * (at(1) + self.size[1] * at(2))
    }

    /// The lattice point of a voxel.
    fn point(&self, i: usize) -> [i32; 3] {
        let [x, y, _] = self.size;
        let at = [i % x, i / x % y, i / x / y];
        std::array::from_fn(|a| (self.lo[a] + at[a] as i32) * 256)
    }
}

/// The vertices and triangles of all pieces of a tile.
#[derive(Default)]
pub(super) struct Mesh {
    pub block: Block,
    pub points: Vec<[i32; 3]>,
    pub state: Vec<u8>,
    pub normals: Vec<[f32; 3]>,
    /// Triangles per cube, at the cube's first voxel.
    triangles: Vec<u8>,
    pub bits: Vec<u8>,
    seen: Vec<u8>,
}

impl Mesh {
    /// Forgets the last tile.
    pub fn begin(&mut self, region: &Region, cap: bool) {
        self.block = Block::new(region, cap);
        self.points.clear();
        self.state.clear();
        self.normals.clear();
        self.triangles.clear();
        self.triangles.resize(self.block.len(), 0);
    }

    /// Adds a piece whose vertices and triangles have been found sound.
    pub fn add(&mut self, piece: &Piece) {
        self.points
            .extend(piece.points.iter().map(|p| position(*p)));
        self.state.extend_from_slice(&piece.state);
        self.normals.extend_from_slice(&piece.normals);
        for t in &piece.triangles {
            let corners = t.map(|i| piece.points[i as usize]);
            let low = |a: usize| corners[0][a].min(corners[1][a]).min(corners[2][a]);
            let count = &mut self.triangles[self.block.index([low(0), low(1), low(2)])];
            *count = count.saturating_add(1);
        }
    }
}

/// The samples of a row of macrocubes along x.
pub(super) struct Band<'a> {
    volume: &'a dyn Volume,
    /// Those of the macrocubes and one on either side, as far as the volume has them, for gradients.
    rows: Range<u32>,
    slices: Range<u32>,
    /// Eight-byte words, so that the bytes are aligned for every sample type.
    words: Vec<u64>,
    /// The voxels that were filled as dust.
    filled: Option<Filled>,
}

/// Voxels of a macrocube; those shared with the next one are counted there.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Voxels {
    pub above: u64,
    pub nan: u64,
}

/// The rules that all tiles are compared by.
pub(super) struct Rule {
    pub threshold: f64,
    pub cap: bool,
    pub triangles: CubeTriangles,
}

impl<'a> Band<'a> {
    pub fn new(volume: &'a dyn Volume, filled: Option<Filled>) -> Self {
        Band {
            volume,
            rows: 0..0,
            slices: 0..0,
            words: Vec::new(),
            filled,
        }
    }

    /// The volume, and what was filled of it as dust, once.
    pub fn take_source(&mut self) -> (&'a dyn Volume, Option<Merge<1>>) {
        let filled = self.filled.as_mut().and_then(Filled::take_slices);
        (self.volume, filled)
    }

    /// Reads the rows and slices of the row of macrocubes (y, z), all along x.
    ///
    /// # Errors
    /// The volume's.
    pub fn load(&mut self, row: [u32; 2], region: &Region) -> Result<()> {
        if let Some(filled) = &mut self.filled {
            filled.load(row)?;
        }
        let [lo, hi, end] = [region.lo, region.hi, region.end].map(|p| p.map(|c| c as u32 / 256));
        let range = |a: usize| lo[a].saturating_sub(1)..(hi[a] + 1).min(end[a]) + 1;
        (self.rows, self.slices) = (range(1), range(2));
        let header = self.volume.header();
        let samples = header.dims.0[0] as usize * self.rows.len() * self.slices.len();
        let bytes = samples * header.dtype.bytes();
        self.words.clear();
        if self.words.try_reserve_exact(bytes.div_ceil(8)).is_err() {
            return Err(Error::usage(
                "--against",
                format!("macrocubes whose row along x takes {bytes} bytes"),
                "a row of macrocubes that fits into memory",
            ));
        }
        self.words.resize(bytes.div_ceil(8), 0);
        let out = &mut bytemuck::cast_slice_mut(&mut self.words)[..bytes];
        let x = 0..header.dims.0[0];
        self.volume
            .read_box(x, self.rows.clone(), self.slices.clone(), out)
    }

    /// Says that no later layer of macrocubes needs the slices before its own first one.
    pub fn release(&self) {
        let z = &self.slices;
        // the last three slices are those of the next layer, or its neighbours
        self.volume
            .release(z.start..z.end.saturating_sub(3).max(z.start));
    }

    /// Compares a tile with the samples; without `mesh` there must be no sign change.
    pub fn compare(
        &self,
        region: &Region,
        rule: &Rule,
        mesh: &mut Mesh,
        flaws: &mut Vec<Flaw>,
    ) -> Voxels {
        with_voxel_type!(self.volume.header().dtype, T => {
            let view = self.view::<T>();
            let voxels = view.bits(region, rule, self.filled.as_ref(), mesh);
            if view.vertices(rule, mesh, flaws) {
                triangles(rule, mesh, flaws);
                if flaws.is_empty() {
                    normals(&view, mesh, rule, flaws);
                }
            }
            voxels
        })
    }

    /// How the surface lies to the lines that cross it there.
    pub fn slants(&self, crossings: &[Crossing], scale: &WallScale) -> Vec<Slant> {
        with_voxel_type!(self.volume.header().dtype, T => {
            let view = self.view::<T>();
            let slant = |at: &Crossing| by_samples(&crossed(&view, at), at.axis(), scale);
            crossings.iter().map(slant).collect()
        })
    }

    fn view<T: Voxel>(&self) -> View<'_, T> {
        let nx = self.volume.header().dims.0[0] as usize;
        let samples: &[T] = bytemuck::cast_slice(&self.words);
        // the last word may reach beyond the last sample
        let len = nx * self.rows.len() * self.slices.len();
        View {
            samples: &samples[..len],
            nx,
            ny: self.rows.len(),
            first: [0, self.rows.start as i32, self.slices.start as i32],
        }
    }
}

/// The band's samples as their type.
pub(super) struct View<'a, T> {
    samples: &'a [T],
    nx: usize,
    ny: usize,
    first: [i32; 3],
}

impl<T: Voxel> View<'_, T> {
    fn row(&self, [x, y, z]: [i32; 3], len: usize) -> &[T] {
        let [x, y, z] = [x, y - self.first[1], z - self.first[2]].map(|c| c as usize);
        let start = x + self.nx * (y + self.ny * z);
        &self.samples[start..start + len]
    }

    /// Fills the block's bits and counts the macrocube's own voxels.
    fn bits(
        &self,
        region: &Region,
        rule: &Rule,
        filled: Option<&Filled>,
        mesh: &mut Mesh,
    ) -> Voxels {
        let block = mesh.block;
        mesh.bits.clear();
        mesh.bits.resize(block.len(), 0);
        let [lo, hi, end] = [region.lo, region.hi, region.end].map(|p| p.map(|c| c / 256));
        let own = |a: usize, v: i32| v < hi[a] || hi[a] == end[a];
        let mut voxels = Voxels::default();
        let len = (hi[0] - lo[0] + 1) as usize;
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                let start = block.index([lo[0] * 256, y * 256, z * 256]);
                let row = self.row([lo[0], y, z], len);
                let bits = &mut mesh.bits[start..start + len];
                for (bit, v) in bits.iter_mut().zip(row) {
                    *bit = u8::from(v.to_f64() >= rule.threshold);
                }
                if let Some(filled) = filled {
                    filled.apply([y, z].map(|c| c as u32), lo[0] as usize, bits);
                }
                if own(1, y) && own(2, z) {
                    let n = if own(0, hi[0]) { len } else { len - 1 };
                    voxels.above += bits[..n].iter().map(|&b| u64::from(b)).sum::<u64>();
                    if T::DTYPE.is_float() {
                        let nan = row[..n].iter().filter(|v| v.to_f64().is_nan()).count();
                        voxels.nan += nan as u64;
                    }
                }
            }
        }
        voxels
    }

    /// Compares vertices with sign changes; true if there is one for each and no other.
    fn vertices(&self, rule: &Rule, mesh: &mut Mesh, flaws: &mut Vec<Flaw>) -> bool {
        let block = mesh.block;
        let strides = block.strides();
        let mut tally =
            [Code::ExtraVertex, Code::VertexMisplaced, Code::BitsDiffer].map(Count::new);
        mesh.seen.clear();
        mesh.seen.resize(block.len(), 0);
        for (&p, &state) in mesh.points.iter().zip(&mesh.state) {
            let axis = usize::from(state & 3);
            let i = block.index(p);
            let (below, above) = (mesh.bits[i], mesh.bits[i + strides[axis]]);
            mesh.seen[i] |= 1 << axis;
            if below == above {
                tally[0].add(p);
                continue;
            }
            if p[axis] & 255 != self.step(p, axis, rule) {
                tally[1].add(p);
            }
            // the surface faces from above to below
            let wrong = if below == 1 { DOWN } else { UP };
            if state & wrong != 0 {
                tally[2].add(p);
            }
        }
        let mut missing = Count::new(Code::MissingVertex);
        for (axis, stride) in strides.into_iter().enumerate() {
            for i in 0..block.len() - stride {
                let change = mesh.bits[i] != mesh.bits[i + stride];
                if change && mesh.seen[i] >> axis & 1 == 0 {
                    let mut p = block.point(i);
                    p[axis] += 128;
                    // the last voxel of a row has no edge
                    if (p[axis] >> 8) - block.lo[axis] + 1 < block.size[axis] as i32 {
                        missing.add(p);
                    }
                }
            }
        }
        let whole = tally[0].0.count == 0 && missing.0.count == 0;
        flaws.extend(
            [missing]
                .iter()
                .chain(&tally)
                .map(|t| t.0)
                .filter(|f| f.count > 0),
        );
        whole
    }

    /// Where the vertex on a lattice edge belongs: 256 (T - v0) / (v1 - v0), rounded half away from
    /// zero, 1 to 255; 128 if that is not finite or an end lies outside the volume.
    pub fn step(&self, p: [i32; 3], axis: usize, rule: &Rule) -> i32 {
        let Some((v, w)) = self.ends(p, axis) else {
            return 128;
        };
        let t = 256.0 * (rule.threshold - v) / (w - v);
        if t.is_finite() {
            t.round().clamp(1.0, 255.0) as i32
        } else {
            128
        }
    }

    /// The samples at the ends of the lattice edge of a vertex; `None` if one lies outside the
    /// volume.
    fn ends(&self, p: [i32; 3], axis: usize) -> Option<(f64, f64)> {
        let low = p.map(|c| c >> 8);
        let mut high = low;
        high[axis] += 1;
        self.sample(low).zip(self.sample(high))
    }

    /// The sample of a voxel; `None` if it lies outside the volume, or the band.
    pub fn sample(&self, v: [i32; 3]) -> Option<f64> {
        let z = v[2] - self.first[2];
        let y = v[1] - self.first[1];
        let rows = 0 <= y && (y as usize) < self.ny && z >= 0;
        let start = self.nx * (y.max(0) as usize + self.ny * z.max(0) as usize);
        let fits = rows && start + self.nx <= self.samples.len();
        (fits && 0 <= v[0] && (v[0] as usize) < self.nx).then(|| self.row(v, 1)[0].to_f64())
    }
}

/// Compares the number of triangles in each cube with what its bits ask for.
fn triangles(rule: &Rule, mesh: &Mesh, flaws: &mut Vec<Flaw>) {
    let block = mesh.block;
    let [sx, sy, sz] = block.strides();
    let corners = [0, sx, sy, sx + sy, sz, sz + sx, sz + sy, sz + sx + sy];
    let mut wrong = Count::new(Code::TriangleCount);
    for z in 0..block.size[2] - 1 {
        for y in 0..block.size[1] - 1 {
            let row = y * sy + z * sz;
            for i in row..row + block.size[0] - 1 {
                let bit = |(c, d): (usize, &usize)| mesh.bits[i + d] << c;
                let case: u8 = corners.iter().enumerate().map(bit).sum();
                if mesh.triangles[i] != rule.triangles.0[usize::from(case)] {
                    wrong.add(block.point(i).map(|c| c + 128));
                }
            }
        }
    }
    if wrong.0.count > 0 {
        flaws.push(wrong.0);
    }
}

pub(super) struct Count(pub Flaw);

impl Count {
    pub fn new(code: Code) -> Self {
        Count(Flaw {
            code,
            count: 0,
            first: [0; 3],
        })
    }

    pub fn add(&mut self, place: [i32; 3]) {
        if self.0.count == 0 {
            self.0.first = place;
        }
        self.0.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complements_swap_the_rules() {
        let [separate, join] = [Ambiguous::Separate, Ambiguous::Join].map(CubeTriangles::new);
        for case in 0..256 {
            assert_eq!(separate.0[case], join.0[255 - case]);
            assert!(separate.0[case] <= 5);
        }
        // the paper's table has 820 triangles in all
        assert_eq!(separate.0.iter().map(|&n| u32::from(n)).sum::<u32>(), 820);
    }

    #[test]
    fn corners_are_joined_as_far_as_the_rule_reaches() {
        // two corners across a face, and two across the cube
        assert_eq!([1, 2].map(|r| components(0b1001, r)), [2, 1]);
        assert_eq!([1, 2].map(|r| components(0b1000_0001, r)), [2, 2]);
        assert_eq!([0, 0xFF].map(|set| components(set, 1)), [0, 1]);
    }
}
