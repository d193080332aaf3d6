//! Walls between cells, measured by chords: a line of voxels along an axis that leaves a cell, goes through what is above,
//! and enters another cell.
//!
//! A chord ends at the vertices of the surface on the two edges that it crosses, so it is measured in lattice steps. The
//! wall is the chord's length times the cosine of its slant thick there. A wall is crossed along all axes that its normal
//! leans to, so a chord stands for a share of a face of a voxel over that cosine: the shares of the axes are 1 together,
//! and change with the normal without a jump, so that neither noise nor a wall across a diagonal loses chords. All is
//! summed in whole numbers, so no order of bands shows.

use crate::grid::{Dims, LATTICE};
use crate::labels::{Bits, RowRuns, Voxels};
use crate::surface::vertex::{Stencil, step_on_edge};
use crate::sys::rounding::{integer, round};
use crate::sys::sorted_spill::Keyed;
use crate::volume::{Slope, Voxel};
use bytemuck::{Pod, Zeroable};

/// The greatest thickness of a wall, in voxels of the finest axis.
pub const WIDEST_WALL: u32 = 32;
/// Bins of a voxel of the finest axis that thickness is counted in.
pub const WALL_BINS: u32 = 64;
/// What a cosine of 1 is written as.
const ONE: u32 = 1 << 16;
/// Areas are sums of this part of the smallest face of a voxel.
pub const WALL_AREA_STEPS: f64 = ONE as f64;
/// Bits of a line's place; its axis is above them.
const PLACE_BITS: u32 = 32;
/// An axis has no share of a wall if the square of the normal's component along it is not above this.
const LEAST_SQUARE: f64 = 0.1;
/// A little less than the root of that.
const LEAST_COSINE: f64 = 0.316;
/// The greatest part of a difference along a normal that central differences miss.
const MOST_MISSED: f64 = 0.5;
/// Walls that measure less, in voxels along the axis that they face, are thinner than a scan resolves.
const RESOLVED: u64 = 2;

/// Where a line of voxels crosses the surface.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct ChordEnd {
    /// The line: its axis, and its place among those along this.
    pub line: u64,
    /// Where on the line, in lattice steps.
    pub position: u32,
    /// The normal's component along the line, without its sign, in 1/65,536.
    pub cosine: u32,
    /// The cell at its end below.
    pub cell: u64,
    /// The axis's share of the wall, in 1/65,536; 0 if it has none.
    pub share: u32,
    /// 1 where the line leaves what is above, 0 where it enters it.
    pub leaves: u32,
}

impl ChordEnd {
    /// True if the line is one along z.
    pub fn is_along_z(&self) -> bool {
        self.line >> PLACE_BITS == 2
    }
}

/// Chords of the wall between two cells whose thickness lies in one bin.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Chords {
    /// The cells, the smaller number first.
    pub cells: [u64; 2],
    /// Thickness in [`WALL_BINS`] of a voxel of the finest axis, rounded down.
    pub bin: u32,
    /// How many chords.
    pub count: u32,
    /// The area that they stand for, see [`WALL_AREA_STEPS`].
    pub area: u64,
    /// That of those which are thinner than a scan resolves.
    pub thin: u64,
}

impl Chords {
    /// What chords with the same key add up to.
    pub fn merge(&mut self, other: &Chords) {
        self.count += other.count;
        self.thin += other.thin;
        self.area += other.area;
    }
}

impl Keyed for Chords {
    /// Cells, then bin: numbers of cells have 48 bits.
    fn key(&self) -> [u64; 2] {
        [self.cells[0], self.cells[1] << 16 | u64::from(self.bin)]
    }
}

impl Keyed for ChordEnd {
    fn key(&self) -> [u64; 2] {
        [self.line, self.position.into()]
    }
}

/// How chords are measured in a grid with voxels of some size.
#[derive(Debug, Clone, Copy)]
pub struct ChordScale {
    /// The finest spacing over that of each axis.
    finest_over: [f64; 3],
    /// Bins of a chord of one lattice step, per unit of the sum of its two cosines.
    bins: [f64; 3],
    /// Face of a voxel across each axis over the smallest one.
    faces: [f64; 3],
    /// Lattice steps of the longest chord along each axis that may count.
    longest: [u32; 3],
}

impl ChordScale {
    /// Of voxels of this size.
    pub fn new(spacing: [f64; 3]) -> Self {
        let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let across = |axis: usize| spacing[(axis + 1) % 3] * spacing[(axis + 2) % 3];
        let smallest = (0..3).map(across).fold(f64::INFINITY, f64::min);
        let widest = f64::from(WIDEST_WALL * LATTICE);
        let longest = spacing.map(|s| (widest * finest / s / LEAST_COSINE) as u32);
        let of_step = f64::from(WALL_BINS) / f64::from(LATTICE) / f64::from(2 * ONE);
        ChordScale {
            finest_over: spacing.map(|s| finest / s),
            bins: spacing.map(|s| s / finest * of_step),
            faces: [0, 1, 2].map(|axis| across(axis) / smallest),
            longest,
        }
    }

    /// How a line along an axis crosses the surface: the cosine and the share of an end, see [`ChordEnd`].
    fn crossing(&self, slopes: &Slopes, axis: usize) -> [u32; 2] {
        let squares = |slopes: [f64; 3]| -> [f64; 3] {
            let parts: [f64; 3] = std::array::from_fn(|a| slopes[a] * self.finest_over[a]);
            parts.map(|part| part * part)
        };
        let measured = squares(slopes.gradient);
        let sum = measured[0] + measured[1] + measured[2];
        if !(sum > 0.0 && sum.is_finite()) {
            // as the mesh has it where there is no gradient: along the edge
            return [ONE; 2];
        }
        // what is far from having a share has no slopes over the axis that say anything
        if measured[axis] < LEAST_SQUARE / 2.0 * sum {
            return [0; 2];
        }
        let parts = squares(slopes.over_axis(axis, measured[axis] / sum));
        let sum = parts[0] + parts[1] + parts[2];
        let above = parts.map(|part| (part / sum - LEAST_SQUARE).max(0.0));
        let share = above[axis] / (above[0] + above[1] + above[2]);
        let whole = |v: f64| -> u32 { integer(round(v * f64::from(ONE))) };
        [whole((parts[axis] / sum).sqrt()), whole(share)]
    }

    /// The chord from where a line enters what is above to where it next leaves it; `None` if it does not count.
    pub fn chord(&self, enters: &ChordEnd, leaves: &ChordEnd) -> Option<Chords> {
        let axis = (enters.line >> PLACE_BITS) as usize;
        let length = leaves.position - enters.position;
        let cells = [enters.cell, leaves.cell];
        let has_share = enters.share > 0 && leaves.share > 0;
        if !has_share || cells[0] == cells[1] || length > self.longest[axis] {
            return None;
        }
        // twice the mean cosine
        let cosines = enters.cosine + leaves.cosine;
        let product = u64::from(length) * u64::from(cosines);
        let bin = (product as f64 * self.bins[axis]) as u32;
        let shares = enters.share + leaves.share;
        let area = f64::from(ONE) * self.faces[axis] * f64::from(shares) / f64::from(cosines);
        let area = ((area + 0.5) as u64).max(1);
        let is_thin = product < RESOLVED * u64::from(LATTICE) * u64::from(2 * ONE);
        (bin < WIDEST_WALL * WALL_BINS).then(|| Chords {
            cells: [cells[0].min(cells[1]), cells[0].max(cells[1])],
            bin,
            count: 1,
            area,
            thin: if is_thin { area } else { 0 },
        })
    }
}

/// Slopes of the samples where the surface crosses an edge.
struct Slopes {
    /// The gradient from central differences at both ends, there.
    gradient: [f64; 3],
    /// The mean of its components along the edge at both ends.
    wide: f64,
    /// The difference of the samples at both ends.
    narrow: f64,
}

impl Slopes {
    /// The components of the gradient over the one along `axis`, without what central differences miss of it.
    ///
    /// Where samples depend on the distance d from a plane alone, as f(d), a central difference along an axis with the
    /// component m of the plane's normal is m (F + m^2 f'''/6), with the same F for all axes. Across a wall little wider than
    /// the blur f''' is large, and the wall would come out up to 6 % too thin. Along the edge, `wide` is that and `narrow`
    /// is m (F - m^2 f'''/12); both tell r = m^2 f'''/6F there, and so the same for the other axes. `square` is m^2 as it
    /// is measured.
    fn over_axis(&self, axis: usize, square: f64) -> [f64; 3] {
        let r = 2.0 * (self.wide - self.narrow) / (self.wide + 2.0 * self.narrow);
        let most = MOST_MISSED * square;
        let r = if r.is_finite() {
            r.clamp(-most, most)
        } else {
            0.0
        };
        self.gradient.map(|component| {
            let measured = component / self.gradient[axis];
            let mut ratio = measured;
            for _ in 0..3 {
                ratio = measured * (1.0 + r) / (1.0 + r * ratio * ratio).max(0.5);
            }
            ratio
        })
    }
}

/// What a band tells of the edges that its lines cross.
pub trait CrossedEdges {
    /// The end of a chord on the crossed edge from a voxel along an axis.
    fn end(&self, axis: usize, lower: [u32; 3], leaves: bool) -> ChordEnd;

    /// The cell of a voxel below.
    fn cell(&self, voxel: [u32; 3]) -> u64;
}

/// The edges of a band of samples.
pub struct BandEdges<'a, T, C> {
    /// Samples with the neighbours that gradients need.
    pub voxels: &'a Voxels<T>,
    /// Size of the grid.
    pub dims: Dims,
    /// The iso value.
    pub threshold: f64,
    /// How chords are measured.
    pub scale: &'a ChordScale,
    /// The cell of a voxel below.
    pub cell: C,
}

impl<T: Voxel, C: Fn([u32; 3]) -> u64> CrossedEdges for BandEdges<'_, T, C> {
    fn end(&self, axis: usize, lower: [u32; 3], leaves: bool) -> ChordEnd {
        let [nx, ny, nz] = self.dims.0;
        let (samples, span) = (self.voxels.samples(), &self.voxels.span);
        let strides = [1, span.nx as usize, span.nx as usize * span.rows()];
        let mut upper = lower;
        upper[axis] += 1;
        let first = self.voxels.row_start(lower[1], lower[2]) + lower[0] as usize;
        let places = [(lower, first), (upper, first + strides[axis])];
        let [v0, v1] = places.map(|(_, p)| samples[p].to_f64());
        let step = step_on_edge(v0, v1, self.threshold);
        let [g0, g1] = places.map(|([x, y, z], p)| {
            let stencil = Stencil::new([y, z], [ny, nz], [strides[1], strides[2]]);
            let slopes = stencil.gradient(samples, p, x, nx);
            slopes.map(|slope| f64::from(slope.to_f32()))
        });
        let t = f64::from(step) / f64::from(LATTICE);
        let slopes = Slopes {
            gradient: std::array::from_fn(|a| g0[a] + (g1[a] - g0[a]) * t),
            wide: (g0[axis] + g1[axis]) / 2.0,
            narrow: v1 - v0,
        };
        let [cosine, share] = self.scale.crossing(&slopes, axis);
        ChordEnd {
            line: line(axis, lower, self.dims),
            position: lower[axis] * LATTICE + step,
            cosine,
            cell: 0,
            share,
            leaves: leaves.into(),
        }
    }

    fn cell(&self, voxel: [u32; 3]) -> u64 {
        (self.cell)(voxel)
    }
}

/// The line along an axis through a voxel.
fn line(axis: usize, voxel: [u32; 3], dims: Dims) -> u64 {
    let [x, y, z] = voxel.map(u64::from);
    let [nx, ny, _] = dims.0.map(u64::from);
    let place = match axis {
        0 => z * ny + y,
        1 => z * nx + x,
        _ => y * nx + x,
    };
    (axis as u64) << PLACE_BITS | place
}

/// What is found in a band.
#[derive(Debug, Default)]
pub struct FoundChords {
    /// Chords that lie in it.
    pub chords: Vec<Chords>,
    /// Ends of chords that go on in other bands.
    pub ends: Vec<ChordEnd>,
}

impl FoundChords {
    /// Bytes that they take.
    pub fn bytes(&self) -> u64 {
        let chords = self.chords.capacity() * size_of::<Chords>();
        (chords + self.ends.capacity() * size_of::<ChordEnd>()) as u64
    }
}

/// Finds the chords of a band, slice by slice.
pub struct ChordFinder<'a> {
    bits: &'a Bits,
    dims: Dims,
    scale: &'a ChordScale,
    edges: &'a dyn CrossedEdges,
    /// For each voxel of a row, and of a slice: one more than the voxel before what is above of the line along y, and
    /// along z; 0 if the line has been above from its first voxel in the band on.
    entered: [Vec<u32>; 2],
}

impl<'a> ChordFinder<'a> {
    /// Of a band.
    pub fn new(
        bits: &'a Bits,
        dims: Dims,
        scale: &'a ChordScale,
        edges: &'a dyn CrossedEdges,
    ) -> Self {
        let nx = bits.span.nx as usize;
        ChordFinder {
            bits,
            dims,
            scale,
            edges,
            entered: [vec![0; nx], vec![0; nx * bits.span.rows()]],
        }
    }

    /// Bytes that the finder of a band over `bits` takes.
    pub fn bytes(bits: &Bits) -> u64 {
        4 * u64::from(bits.span.nx) * (bits.span.rows() as u64 + 1)
    }

    /// Finds what chords there are along x and y in slice `s` of the band, which come first, and those along z that end
    /// between it and the next one.
    pub fn slice(&mut self, s: usize, out: &mut FoundChords) {
        let span = &self.bits.span;
        let z = span.z.start + s as u32;
        // what bands share belongs to the first of them
        if s > 0 || z == 0 {
            for (r, y) in span.y.clone().enumerate() {
                if r > 0 || y == 0 {
                    self.along_x([s, r], out);
                }
            }
            let mut entered = std::mem::take(&mut self.entered[0]);
            entered.fill(0);
            for r in 0..span.rows() {
                self.step(1, [s, r], &mut entered, out);
            }
            self.entered[0] = entered;
        }
        let mut entered = std::mem::take(&mut self.entered[1]);
        let nx = span.nx as usize;
        for (r, y) in span.y.clone().enumerate() {
            if r > 0 || y == 0 {
                self.step(2, [s, r], &mut entered[r * nx..][..nx], out);
            }
        }
        self.entered[1] = entered;
    }

    /// Chords of a row.
    fn along_x(&self, [s, r]: [usize; 2], out: &mut FoundChords) {
        let nx = self.bits.span.nx;
        for run in RowRuns::new(self.bits.row(s, r), nx) {
            if run.above && run.start > 0 && run.end < nx {
                let enters = self.voxel([s, r], run.start - 1);
                self.between(0, enters, run.end - 1, out);
            }
        }
    }

    /// Goes from a row to the next one along an axis: chords end where that is below, or begin where it is above.
    fn step(&self, axis: usize, [s, r]: [usize; 2], entered: &mut [u32], out: &mut FoundChords) {
        let span = &self.bits.span;
        let here = self.bits.row(s, r);
        let next = match axis {
            1 if r + 1 < span.rows() => self.bits.row(s, r + 1),
            2 if s + 1 < span.slices() => self.bits.row(s + 1, r),
            _ => return self.end_of_band(axis, [s, r], entered, out),
        };
        for (w, (&here, &next)) in here.iter().zip(next).enumerate() {
            let mut crossed = here ^ next;
            while crossed != 0 {
                let bit = crossed.trailing_zeros();
                crossed &= crossed - 1;
                let x = 64 * w as u32 + bit;
                let voxel = self.voxel([s, r], x);
                let entered = &mut entered[x as usize];
                if next >> bit & 1 == 1 {
                    *entered = voxel[axis] + 1;
                    continue;
                }
                match std::mem::take(entered) {
                    0 => self.leaves_first(axis, voxel, out),
                    before => {
                        let mut enters = voxel;
                        enters[axis] = before - 1;
                        self.between(axis, enters, voxel[axis], out);
                    }
                }
            }
        }
    }

    /// The voxel `x` of a row, in the grid.
    fn voxel(&self, [s, r]: [usize; 2], x: u32) -> [u32; 3] {
        let span = &self.bits.span;
        [x, span.y.start + r as u32, span.z.start + s as u32]
    }

    /// The chord that leaves the cell of voxel `enters` and ends behind voxel `last`.
    fn between(&self, axis: usize, enters: [u32; 3], last: u32, out: &mut FoundChords) {
        // it is longer than from voxel to voxel
        if (last - enters[axis] - 1) * LATTICE >= self.scale.longest[axis] {
            return;
        }
        let mut leaves = enters;
        leaves[axis] = last;
        let mut first = self.edges.end(axis, enters, false);
        if first.share == 0 {
            return;
        }
        let mut second = self.edges.end(axis, leaves, true);
        if second.share == 0 {
            return;
        }
        leaves[axis] += 1;
        first.cell = self.edges.cell(enters);
        second.cell = self.edges.cell(leaves);
        out.chords.extend(self.scale.chord(&first, &second));
    }

    /// A line leaves what is above behind a voxel, and entered it before the band.
    fn leaves_first(&self, axis: usize, last: [u32; 3], out: &mut FoundChords) {
        let start = [0, self.bits.span.y.start, self.bits.span.z.start][axis];
        // before the grid there is no cell, and what is too long on this side of the band's end does not count
        if start == 0 || (last[axis] - start) * LATTICE >= self.scale.longest[axis] {
            return;
        }
        let mut below = last;
        below[axis] += 1;
        let end = self.edges.end(axis, last, true);
        let cell = self.edges.cell(below);
        out.ends.push(ChordEnd { cell, ..end });
    }

    /// Lines that are above in the last row of a band, and may leave that in another one.
    fn end_of_band(&self, axis: usize, place: [usize; 2], entered: &[u32], out: &mut FoundChords) {
        let last = self.voxel(place, 0);
        if last[axis] + 1 == self.dims.0[axis] {
            return;
        }
        for (w, &word) in self.bits.row(place[0], place[1]).iter().enumerate() {
            let mut above = word;
            while above != 0 {
                let x = 64 * w as u32 + above.trailing_zeros();
                above &= above - 1;
                let Some(before) = entered[x as usize].checked_sub(1) else {
                    continue;
                };
                let mut enters = last;
                (enters[0], enters[axis]) = (x, before);
                if (last[axis] - before - 1) * LATTICE >= self.scale.longest[axis] {
                    continue;
                }
                let end = self.edges.end(axis, enters, false);
                let cell = self.edges.cell(enters);
                out.ends.push(ChordEnd { cell, ..end });
            }
        }
    }
}
