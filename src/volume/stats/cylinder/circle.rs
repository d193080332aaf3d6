//! Circles through the outlines of what pictures show.

use super::image::Image;
use std::f64::consts::{PI, TAU};

/// Directions in which an outline is known.
pub(super) const DIRECTIONS: usize = 64;
/// Share of the directions in which an outline has to lie on a circle.
const ON_CIRCLE: f64 = 0.75;
/// Share of the directions that the edges of the picture must not cut.
const NOT_CUT: f64 = 0.8;
/// Share of the circle where the body itself ends, and not a pore that is open to the air.
const CLOSED: f64 = 0.4;
/// How far from the circle, as a share of its radius, the rim may be.
const OFF: f64 = 0.02;

/// A circle, in voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Circle {
    pub centre: [f64; 2],
    pub radius: f64,
}

/// How far two points are apart.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// The cosine and the sine of a direction.
pub(super) fn direction(i: usize) -> [f64; 2] {
    let (sin, cos) = libm::sincos(TAU * i as f64 / DIRECTIONS as f64);
    [cos, sin]
}

impl Circle {
    /// How far a point lies outside.
    pub fn off(&self, point: [f64; 2]) -> f64 {
        distance(point, self.centre) - self.radius
    }

    pub fn area(&self) -> f64 {
        PI * self.radius * self.radius
    }

    /// What the rim may be off where pixels have this many voxels along a side.
    fn slack(&self, pixel: u32) -> f64 {
        (OFF * self.radius).max(pixel.into())
    }

    /// How far it reaches beyond the edges of a picture, at most.
    fn beyond(&self, image: &Image) -> f64 {
        let sides = [image.raster.width, image.raster.height];
        let beyond = [0, 1].map(|a| {
            let last = image.raster.voxel(sides[a] as f64 - 0.5);
            (self.radius - self.centre[a]).max(self.centre[a] + self.radius - last)
        });
        beyond[0].max(beyond[1])
    }

    /// How far it reaches from voxel 0 in a direction.
    pub fn reach(&self, [cos, sin]: [f64; 2]) -> f64 {
        self.centre[0] * cos + self.centre[1] * sin + self.radius
    }
}

/// Why a part is no circle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoCircle {
    /// The edges of the picture cut it.
    CutOff,
    /// Its rim lies on no circle.
    NotRound,
}

/// A place where a part of a picture ends, in voxels.
struct End {
    at: [f64; 2],
    /// At an edge of the picture.
    is_cut: bool,
}

/// How far a body reaches from voxel 0 in each direction, in voxels: the support function of its convex hull, which pores
/// that are open to the air hardly change.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    pub reach: [f64; DIRECTIONS],
    /// There it reaches an edge of the picture.
    cut: [bool; DIRECTIONS],
}

impl Outline {
    /// Of some pixels of a picture; `None` without any.
    pub fn of(image: &Image, part: &[bool], threshold: f64) -> Option<Self> {
        let ends = ends(image, part, threshold);
        (!ends.is_empty()).then(|| Outline::around(&ends))
    }

    fn around(ends: &[End]) -> Self {
        let mut outline = Outline {
            reach: [f64::NEG_INFINITY; DIRECTIONS],
            cut: [false; DIRECTIONS],
        };
        for i in 0..DIRECTIONS {
            let [cos, sin] = direction(i);
            for end in ends {
                let reach = end.at[0] * cos + end.at[1] * sin;
                if reach > outline.reach[i] {
                    (outline.reach[i], outline.cut[i]) = (reach, end.is_cut);
                }
            }
        }
        outline
    }

    /// The circle with the least sum of squares of what the outline is off, without directions that are far off or cut,
    /// and the share of all directions that are on it; `None` if too few are left.
    pub fn circle(&self, pixel: u32) -> Option<(Circle, f64)> {
        let open = (0..DIRECTIONS).filter(|i| !self.cut[*i]);
        let mut used: Vec<usize> = open.clone().collect();
        let mut best = self.fit(&used)?;
        // what is far off draws the first ones
        for slacks in [8.0, 4.0, 2.0, 1.5, 1.0, 1.0, 1.0, 1.0] {
            let slack = slacks * best.slack(pixel);
            let is_near = |i: &usize| (self.reach[*i] - best.reach(direction(*i))).abs() <= slack;
            used = open.clone().filter(is_near).collect();
            best = self.fit(&used)?;
        }
        let slack = best.slack(pixel);
        let is_on = |i: &usize| (self.reach[*i] - best.reach(direction(*i))).abs() <= slack;
        let on = (0..DIRECTIONS).filter(is_on).count();
        Some((best, on as f64 / DIRECTIONS as f64))
    }

    /// The same of some directions, which tell the middle and the radius as a linear system.
    fn fit(&self, used: &[usize]) -> Option<Circle> {
        let mut m = [[0.0; 3]; 3];
        let mut b = [0.0; 3];
        for &i in used {
            let [cos, sin] = direction(i);
            let row = [cos, sin, 1.0];
            for (r, factor) in row.into_iter().enumerate() {
                b[r] += factor * self.reach[i];
                (0..3).for_each(|c| m[r][c] += factor * row[c]);
            }
        }
        let of = |m: &[[f64; 3]; 3]| {
            let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
            m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
        };
        let all = of(&m);
        let solved = |c: usize| {
            let mut m = m;
            (0..3).for_each(|r| m[r][c] = b[r]);
            of(&m) / all
        };
        let circle = Circle {
            centre: [solved(0), solved(1)],
            radius: solved(2),
        };
        (used.len() >= DIRECTIONS / 4 && circle.radius > 0.0).then_some(circle)
    }

    /// The larger of two in each direction.
    pub fn with(mut self, other: &Outline) -> Outline {
        for i in 0..DIRECTIONS {
            if other.reach[i] > self.reach[i] {
                (self.reach[i], self.cut[i]) = (other.reach[i], other.cut[i]);
            }
        }
        self
    }
}

/// Where some pixels of a picture end: between them and others, where the brightness passes the threshold.
fn ends(image: &Image, part: &[bool], threshold: f64) -> Vec<End> {
    let (width, height) = (image.raster.width, image.raster.height);
    let mut ends = Vec::new();
    for i in (0..part.len()).filter(|i| part[*i]) {
        let (x, y) = (i % width, i / width);
        let around = [
            ([-1.0, 0.0], (x > 0).then(|| i - 1)),
            ([1.0, 0.0], (x + 1 < width).then_some(i + 1)),
            ([0.0, -1.0], (y > 0).then(|| i - width)),
            ([0.0, 1.0], (y + 1 < height).then_some(i + width)),
        ];
        for (way, other) in around {
            let share = match other {
                Some(j) if part[j] => continue,
                Some(j) => {
                    let [bright, dark] = [i, j].map(|i| f64::from(image.pixels[i]));
                    match dark < threshold {
                        true => (bright - threshold) / (bright - dark),
                        false => 0.5,
                    }
                }
                None => 0.5,
            };
            let at = [x as f64 + share * way[0], y as f64 + share * way[1]];
            ends.push(End {
                at: at.map(|v| image.raster.voxel(v)),
                is_cut: other.is_none(),
            });
        }
    }
    ends
}

/// The circle around a part of a picture whose pixels are above a threshold.
pub(super) fn around(image: &Image, part: &[usize], threshold: f64) -> Result<Circle, NoCircle> {
    let mut is_part = vec![false; image.pixels.len()];
    part.iter().for_each(|&i| is_part[i] = true);
    let ends = ends(image, &is_part, threshold);
    let outline = Outline::around(&ends);
    let pixel = image.raster.pixel;
    let open = outline.cut.iter().filter(|cut| !**cut).count();
    let is_open = open as f64 >= NOT_CUT * DIRECTIONS as f64;
    // a rim that is blurred may just reach the edges
    let fits = |circle: &Circle| is_open || circle.beyond(image) <= circle.slack(pixel);
    let (circle, on) = match outline.circle(pixel) {
        Some(found) if fits(&found.0) => found,
        None if is_open => return Err(NoCircle::NotRound),
        _ => return Err(NoCircle::CutOff),
    };
    let mut closed = [false; DIRECTIONS];
    let slack = circle.slack(pixel);
    for end in ends.iter().filter(|end| circle.off(end.at).abs() <= slack) {
        let [dx, dy] = [0, 1].map(|a| end.at[a] - circle.centre[a]);
        let turn = libm::atan2(dy, dx) / TAU + 1.0;
        closed[(turn * DIRECTIONS as f64) as usize % DIRECTIONS] = true;
    }
    let closed = closed.iter().filter(|c| **c).count() as f64 / DIRECTIONS as f64;
    match on >= ON_CIRCLE && closed >= CLOSED {
        true => Ok(circle),
        false => Err(NoCircle::NotRound),
    }
}
