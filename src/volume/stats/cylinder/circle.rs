//! Circles through the rim of what a picture shows.

use super::image::Image;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Rays towards the middle.
const RAYS: usize = 720;
/// Share of the rays that have to end on one circle.
const ON_CIRCLE: f64 = 0.8;
/// The same in a mean of few slices, where a pore that is open to the air is seen.
const ON_PART: f64 = 0.6;
/// How far from the circle, as a share of its radius, the rim may be.
pub(super) const OFF: f64 = 0.02;
/// Steps to a pixel along a ray.
const STEPS: f64 = 4.0;

/// A circle, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Circle {
    pub centre: [f64; 2],
    pub radius: f64,
}

/// How far two points are apart.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

impl Circle {
    /// How far a point lies outside.
    pub fn off(&self, point: [f64; 2]) -> f64 {
        distance(point, self.centre) - self.radius
    }

    pub fn area(&self) -> f64 {
        PI * self.radius * self.radius
    }

    /// What the rim may be off.
    pub fn slack(&self) -> f64 {
        (OFF * self.radius).max(1.0)
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

/// A point of a ray, its way from outside in steps.
struct Ray {
    from: [f64; 2],
    along: [f64; 2],
}

impl Ray {
    fn of(from: [f64; 2], i: usize) -> Ray {
        let (sin, cos) = libm::sincos(TAU * i as f64 / RAYS as f64);
        Ray {
            from,
            along: [cos, sin],
        }
    }

    fn at(&self, way: f64) -> [f64; 2] {
        [0, 1].map(|a| self.from[a] + self.along[a] * way)
    }

    /// Where the brightness passes the threshold between a bright and a dark place.
    fn crossing(&self, image: &Image, threshold: f64, mut bright: f64, mut dark: f64) -> [f64; 2] {
        for _ in 0..20 {
            let half = (bright + dark) / 2.0;
            match image.at(self.at(half)) >= threshold {
                true => bright = half,
                false => dark = half,
            }
        }
        self.at(bright)
    }
}

/// The circle through the rim of a part of a picture whose pixels are above a threshold: where rays from outside towards
/// its middle first meet it, between pixels where the brightness passes the threshold. A ray that meets it at the edge of the
/// picture is left out.
pub(super) fn around(image: &Image, part: &[usize], threshold: f64) -> Result<Circle, NoCircle> {
    let (width, height) = (image.raster.width, image.raster.height);
    let mut is_part = vec![false; image.pixels.len()];
    part.iter().for_each(|&i| is_part[i] = true);
    let n = part.len() as f64;
    let sum = |a: usize| part.iter().map(|&i| image.place(i)[a]).sum::<f64>();
    let middle = [sum(0) / n, sum(1) / n];
    let longest = (libm::hypot(width as f64, height as f64) * STEPS) as u32;
    let is_met = |[x, y]: [f64; 2]| {
        let inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64;
        inside && is_part[x.round() as usize + width * y.round() as usize]
    };
    let point = |i: usize| {
        let ray = Ray::of(middle, i);
        let steps = (0..longest).rev().map(|step| f64::from(step) / STEPS);
        let met = { steps }.find(|way| is_met(ray.at(*way)))?;
        // a pixel's width on either side of where the pixels change
        let dark = image.at(ray.at(met + 1.0)) < threshold;
        dark.then(|| ray.crossing(image, threshold, met - 1.0, met + 1.0))
    };
    let rim: Vec<[f64; 2]> = (0..RAYS).filter_map(point).collect();
    if rim.len() < (ON_CIRCLE * RAYS as f64) as usize {
        return Err(NoCircle::CutOff);
    }
    through(&rim, ON_CIRCLE).ok_or(NoCircle::NotRound)
}

/// The circle near another one at which a picture becomes dark: the outermost place on each ray from the middle, of those
/// in a range of radii. `None` if too few rays have one that lies on it.
pub(super) fn near(
    image: &Image,
    circle: &Circle,
    radii: &Range<f64>,
    threshold: f64,
) -> Option<Circle> {
    let steps = ((radii.end - radii.start) * STEPS) as usize;
    let point = |i: usize| {
        let ray = Ray::of(circle.centre, i);
        let way = |step: usize| radii.start + step as f64 / STEPS;
        let is_bright = |step: &usize| image.at(ray.at(way(*step))) >= threshold;
        let last = (0..steps).rev().find(is_bright)?;
        (last + 1 < steps).then(|| ray.crossing(image, threshold, way(last), way(last + 1)))
    };
    let rim: Vec<[f64; 2]> = (0..RAYS).filter_map(point).collect();
    match rim.len() < (ON_PART * RAYS as f64) as usize {
        true => None,
        false => through(&rim, ON_PART),
    }
}

/// The circle with the least sum of squares at points, without those that are far off: pores that are open to the air, or
/// a holder. `None` unless a share of all rays ends on it.
fn through(rim: &[[f64; 2]], share: f64) -> Option<Circle> {
    let enough = (share * RAYS as f64) as usize;
    let mut best = fit(rim)?;
    for _ in 0..10 {
        let near = |p: &[f64; 2]| best.off(*p).abs() <= best.slack();
        let points: Vec<[f64; 2]> = rim.iter().copied().filter(near).collect();
        if points.len() < enough / 2 {
            break;
        }
        best = fit(&points)?;
    }
    let on = rim.iter().filter(|p| best.off(**p).abs() <= best.slack());
    (on.count() >= enough).then_some(best)
}

/// The circle x^2 + y^2 + a x + b y + c = 0 with the least sum of squares at some points (I. Kasa, A circle fitting
/// procedure and its error analysis, 1976); `None` if they are on a line.
fn fit(points: &[[f64; 2]]) -> Option<Circle> {
    let n = points.len() as f64;
    let mean = |a: usize| points.iter().map(|p| p[a]).sum::<f64>() / n;
    let [mx, my] = [mean(0), mean(1)];
    let (mut xx, mut yy, mut xy, mut xr, mut yr, mut rr) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for [x, y] in points {
        let (x, y) = (x - mx, y - my);
        let r = x * x + y * y;
        xx += x * x;
        yy += y * y;
        xy += x * y;
        xr += x * r;
        yr += y * r;
        rr += r;
    }
    let determinant = 2.0 * (xx * yy - xy * xy);
    if determinant <= 0.0 || determinant.is_nan() {
        return None;
    }
    let x = (xr * yy - yr * xy) / determinant;
    let y = (yr * xx - xr * xy) / determinant;
    Some(Circle {
        centre: [x + mx, y + my],
        radius: (rr / n + x * x + y * y).sqrt(),
    })
}
