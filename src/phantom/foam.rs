//! Closed-cell foam: spheres around scattered centres, cut flat where they come near each other.
//!
//! The centres are a body-centred cubic lattice of one site per `pitch`^3, each moved at random
//! within a ball of [`JITTER`] pitches, so that two are never closer than 0.53 pitches and a part
//! of the foam needs only the centres around it. Cell i is the set of points with
//!
//! - |p - c_i| <= r_i, its sphere, and
//! - for every other centre j, at least wall/2 on its own side of the radical plane of the spheres
//!   i and j (a Laguerre tessellation, the usual model of foams: Redenbach, "Microstructure models
//!   for cellular materials", Computational Materials Science 44, 2009).
//!
//! So two cells are never closer than `wall`, whatever the random numbers are, and every cell is
//! convex: along a row of voxels it is one interval.

use super::Foam;
use super::Rows;
use super::random::{hash3, mix};
use std::ops::Range;

/// Largest move of a centre from its lattice site, in pitches. Sites are 1.09 pitches apart.
const JITTER: f64 = 0.28;
/// Radii are 1 - SPREAD to 1 + SPREAD times the mean.
const SPREAD: f64 = 0.2;
/// Mean radius, in pitches, of the spheres whose radical planes part the cells. It is fixed, so that
/// a larger `bubble` changes the spheres and not the planes.
const WEIGHT_RADIUS: f64 = 0.42;
/// Half the width of the grey ramp across a surface, in voxels: a ramp of one voxel is what a
/// detector's averaging over the voxel gives.
const HALF_RAMP: f32 = 0.5;

/// A foam, ready to be evaluated.
#[derive(Debug, Clone)]
pub struct FoamField {
    foam: Foam,
    seed: u64,
    /// Half the edge of the lattice's cube, in voxels: sites are at `half * (i, j, k)` for
    /// integers that are all even or all odd.
    half: f64,
    /// Offsets to the lattice sites whose planes can cut a cell.
    neighbours: Vec<[i64; 3]>,
}

/// A cell's centre and sphere.
#[derive(Debug, Clone, Copy)]
struct Site {
    centre: [f64; 3],
    /// Radius of its sphere over the mean radius.
    scale: f64,
}

/// A cell with everything to evaluate it, in coordinates relative to `origin`, so that `f32` is
/// exact enough anywhere in the largest volume.
#[derive(Debug, Clone)]
struct Cell {
    /// The voxel nearest to the centre.
    origin: [i64; 3],
    centre: [f32; 3],
    radius: f32,
    /// Unit normal and distance of each plane: inside iff normal . p <= distance. The nearest plane
    /// comes first, since it is the most likely to rule a row out.
    planes: Vec<[f32; 4]>,
}

impl FoamField {
    /// The parameters must have been checked.
    pub fn new(foam: Foam, seed: u64) -> Self {
        let half = foam.pitch * libm::cbrt(2.0) / 2.0;
        let mut field = FoamField {
            foam,
            seed,
            half,
            neighbours: Vec::new(),
        };
        let reach = field.plane_reach() + 2.0 * JITTER * foam.pitch;
        let n = (reach / half).ceil() as i64;
        for k in -n..=n {
            for j in -n..=n {
                for i in -n..=n {
                    let same_parity = (i ^ j) & 1 == 0 && (j ^ k) & 1 == 0;
                    let distance = half * ((i * i + j * j + k * k) as f64).sqrt();
                    if same_parity && distance > 0.0 && distance <= reach {
                        field.neighbours.push([i, j, k]);
                    }
                }
            }
        }
        field
    }

    fn largest_radius(&self) -> f64 {
        self.foam.pitch * self.foam.bubble * (1.0 + SPREAD)
    }

    /// The distance d of two centres from which on their plane cannot touch either's sphere. The
    /// plane is at d/2 - gap/d from the smaller one's centre, which rises with d.
    fn plane_reach(&self) -> f64 {
        let radius = self.foam.pitch * WEIGHT_RADIUS;
        let gap = 2.0 * SPREAD * (radius * radius);
        let height = self.largest_radius() + self.foam.wall / 2.0 + 2.0 * f64::from(HALF_RAMP);
        height + (height * height + 2.0 * gap).sqrt()
    }

    fn site(&self, index: [i64; 3]) -> Site {
        let h = hash3(self.seed, index);
        const BITS: u64 = (1 << 21) - 1;
        let signed = |bits: u64| (bits & BITS) as f64 * (2.0 / BITS as f64) - 1.0;
        let cube = [signed(h), signed(h >> 21), signed(h >> 42)];
        let length = cube.iter().map(|v| v * v).sum::<f64>().sqrt();
        let largest = cube.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        // a cube shrunk along each ray until it is a ball
        let into_ball = if length > 0.0 { largest / length } else { 0.0 };
        let shift = JITTER * self.foam.pitch * into_ball;
        Site {
            centre: std::array::from_fn(|a| index[a] as f64 * self.half + cube[a] * shift),
            scale: 1.0 + SPREAD * signed(mix(h)),
        }
    }

    fn cell(&self, index: [i64; 3]) -> Cell {
        let Site { centre, scale } = self.site(index);
        let radius = self.foam.pitch * self.foam.bubble * scale;
        let origin = centre.map(|c| c.round() as i64);
        let local: [f64; 3] = std::array::from_fn(|a| centre[a] - origin[a] as f64);
        let weight = |scale: f64| {
            let radius = self.foam.pitch * WEIGHT_RADIUS * scale;
            radius * radius
        };
        let mut planes = Vec::with_capacity(16);
        for offset in &self.neighbours {
            let other = self.site(std::array::from_fn(|a| index[a] + offset[a]));
            let to: [f64; 3] = std::array::from_fn(|a| other.centre[a] - centre[a]);
            let distance = to.iter().map(|v| v * v).sum::<f64>().sqrt();
            let height = distance / 2.0 + (weight(scale) - weight(other.scale)) / (2.0 * distance)
                - self.foam.wall / 2.0;
            if height < radius + 2.0 * f64::from(HALF_RAMP) {
                let normal = to.map(|v| v / distance);
                let shift: f64 = (0..3).map(|a| normal[a] * local[a]).sum();
                let [x, y, z] = normal.map(|v| v as f32);
                planes.push([x, y, z, (height + shift) as f32]);
            }
        }
        planes.sort_by(|a, b| a[3].total_cmp(&b[3]));
        Cell {
            origin,
            centre: local.map(|v| v as f32),
            radius: radius as f32,
            planes,
        }
    }

    /// Everything needed to make the rows of a box.
    pub fn rows(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>) -> FoamRows {
        let margin = self.largest_radius() + f64::from(HALF_RAMP) + 1.0;
        let reach = margin + JITTER * self.foam.pitch;
        let axis = |r: &Range<u32>| {
            let first = ((f64::from(r.start) - reach) / self.half).floor() as i64;
            let last = ((f64::from(r.end) + reach) / self.half).ceil() as i64;
            first..=last
        };
        let near = |c: f64, r: &Range<u32>| {
            f64::from(r.start) - margin <= c && c <= f64::from(r.end) + margin
        };
        let mut cells = Vec::new();
        for k in axis(&z) {
            for j in axis(&y).filter(|j| (j ^ k) & 1 == 0) {
                for i in axis(&x).filter(|i| (i ^ k) & 1 == 0) {
                    let c = self.site([i, j, k]).centre;
                    if near(c[0], &x) && near(c[1], &y) && near(c[2], &z) {
                        cells.push(self.cell([i, j, k]));
                    }
                }
            }
        }
        FoamRows {
            cells,
            x,
            active_z: None,
            active: Vec::new(),
            depth: Vec::new(),
        }
    }
}

/// The cells near a box, and the scratch memory to draw its rows.
pub struct FoamRows {
    cells: Vec<Cell>,
    x: Range<u32>,
    /// The slice that `active` belongs to.
    active_z: Option<u32>,
    /// Indices of the cells that reach the slice.
    active: Vec<u32>,
    depth: Vec<f32>,
}

impl Rows for FoamRows {
    fn row(&mut self, y: u32, z: u32, grey: &mut [f32]) {
        if self.active_z != Some(z) {
            let reaches = |c: &Cell| (i64::from(z) - c.origin[2]).abs() as f32 <= c.radius + 2.0;
            self.active.clear();
            self.active.extend(
                (0u32..)
                    .zip(&self.cells)
                    .filter(|(_, c)| reaches(c))
                    .map(|(i, _)| i),
            );
            self.active_z = Some(z);
        }
        grey.fill(1.0);
        for &i in &self.active {
            let cell = &self.cells[i as usize];
            let dy = (i64::from(y) - cell.origin[1]) as f32;
            let dz = (i64::from(z) - cell.origin[2]) as f32;
            cell.draw([dy, dz], &self.x, grey, &mut self.depth);
        }
    }
}

impl Cell {
    /// Darkens the voxels of one row that lie in this cell. `grey` holds the voxels `x`; `dy` and
    /// `dz` are the row's coordinates relative to the cell's origin. Cells may be drawn in any
    /// order: each voxel keeps the darkest value.
    fn draw(&self, [dy, dz]: [f32; 2], x: &Range<u32>, grey: &mut [f32], depth: &mut Vec<f32>) {
        let r = self.radius;
        let [y, z] = [dy - self.centre[1], dz - self.centre[2]];
        let q = y * y + z * z;
        let chord = r * r + 2.0 * HALF_RAMP * r - q;
        if chord <= 0.0 {
            return;
        }
        let half = chord.sqrt();
        let (mut low, mut high) = (self.centre[0] - half, self.centre[0] + half);
        for &[nx, ny, nz, d] in &self.planes {
            let room = d - ny * dy - nz * dz + HALF_RAMP;
            if nx > 1e-6 {
                high = high.min(room / nx);
            } else if nx < -1e-6 {
                low = low.max(room / nx);
            } else if room < -1e-2 {
                return;
            }
            if low > high + 1e-2 {
                return;
            }
        }
        // one voxel more on either side than needed: rounding then never loses one
        let origin = self.origin[0] - i64::from(x.start);
        let first = (origin + low.floor() as i64 - 1).max(0);
        let last = (origin + high.ceil() as i64 + 2).min(grey.len() as i64);
        if first >= last {
            return;
        }
        let grey = &mut grey[first as usize..last as usize];
        depth.clear();
        depth.resize(grey.len(), 0.0);
        let start = (first - origin) as f32;
        let scale = 0.5 / r;
        for (i, e) in depth.iter_mut().enumerate() {
            let dx = start + i as f32 - self.centre[0];
            // equals r - |p - c| on the sphere, with the same slope there
            *e = (r * r - q - dx * dx) * scale;
        }
        let end = (grey.len() - 1) as f32;
        for &[nx, ny, nz, d] in &self.planes {
            let at_start = d - ny * dy - nz * dz - nx * start;
            if at_start.min(at_start - nx * end) > HALF_RAMP {
                continue;
            }
            for (i, e) in depth.iter_mut().enumerate() {
                *e = e.min(d - ny * dy - nz * dz - nx * (start + i as f32));
            }
        }
        for (g, &e) in grey.iter_mut().zip(depth.iter()) {
            *g = g.min((HALF_RAMP - e) * (0.5 / HALF_RAMP)).max(0.0);
        }
    }
}
