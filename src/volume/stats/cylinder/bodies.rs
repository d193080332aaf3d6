//! What is round in a picture, and which of it is the sample.

use super::circle::{Circle, NoCircle, around, distance};
use super::image::{Image, median, split};
use super::{SMALLEST, cylinder, why_not};
use std::f64::consts::PI;

/// A body that fills less of its circle is a ring.
const HOLLOW: f64 = 0.5;
/// The share of a hole that what lies in it fills at least.
const IN_HOLE: f64 = 0.05;
/// The share of the sample's area from which on another body may as well be the sample.
const ALIKE: f64 = 0.2;
/// The share of the sample's area from which on another body is worth a word.
const WORTH: f64 = 0.02;
/// The share of the variance between two classes that noise or a slow change do not reach: these have 0.64 and 0.75.
const TWO_LEVELS: f64 = 0.85;
/// Of the brightness that parts a tube from air, by how much what is in it is brighter than the air at least.
const FAINT: f64 = 0.1;
/// Pixels of air between a faint sample and a tube at least.
const GAP: f64 = 1.5;
/// Parts that are looked at, the largest.
const PARTS: usize = 8;

/// What another body is to the sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// It is around it.
    Tube,
    /// It lies beside it.
    Beside,
    /// It is the part of it in the middle, of another brightness.
    Inside,
}

/// A body that may be meant as well.
#[derive(Debug, Clone, Copy)]
pub(super) struct Other {
    pub circle: Circle,
    pub kind: Kind,
}

/// The round bodies of a picture.
#[derive(Debug)]
pub(super) struct Bodies {
    /// The rim of the sample.
    pub sample: Circle,
    /// The brightness at its rim.
    pub threshold: f64,
    /// The radius up to which there is nothing else.
    pub reach: f64,
    pub others: Vec<Other>,
    /// The middle of the largest body beside the sample that is not round, if it is nearly as large.
    pub not_round: Option<[f64; 2]>,
}

/// A connected part of what is bright.
struct Part {
    pixels: Vec<usize>,
    circle: Result<Circle, NoCircle>,
}

impl Part {
    /// Its middle if it is not round, lies beside the sample and is of a size like it.
    fn beside(&self, image: &Image, sample: &Circle) -> Option<[f64; 2]> {
        let n = self.pixels.len() as f64;
        let sum = |a: usize| self.pixels.iter().map(|&i| image.place(i)[a]).sum::<f64>();
        let middle = [sum(0) / n, sum(1) / n];
        let pixel = f64::from(image.raster.pixel);
        let area = n * pixel * pixel;
        let is_beside = sample.off(middle) > 0.0 && area >= ALIKE * sample.area();
        (self.circle.is_err() && is_beside).then_some(middle)
    }
}

impl Bodies {
    /// Finds them; else says what was found instead.
    pub fn of(image: &Image) -> Result<Self, String> {
        let values = image.pixels.iter().map(|v| f64::from(*v));
        let (threshold, _) = split(values).ok_or("slices of one value")?;
        let least = PI * libm::pow(SMALLEST / f64::from(image.raster.pixel), 2.0) / 4.0;
        let bright = image.parts(|i| f64::from(image.pixels[i]) >= threshold);
        let large = |part: &Vec<usize>| part.len() as f64 >= least;
        let parts = bright.into_iter().filter(large).take(PARTS);
        let part = |pixels: Vec<usize>| Part {
            circle: around(image, &pixels, threshold),
            pixels,
        };
        let parts: Vec<Part> = parts.map(part).collect();
        let Some((first, rest)) = parts.split_first() else {
            return Err("no part of the slices that is bright".to_owned());
        };
        let main = first.circle.map_err(|no| {
            let round = rest.iter().find_map(|part| part.circle.ok());
            let beside = round.map_or(String::new(), |circle| {
                let cylinder = cylinder(&circle, image.raster.pixel);
                format!(", and beside or in it a smaller one that is, {cylinder}")
            });
            why_not(no).to_owned() + &beside
        })?;
        let bodies = Bodies {
            sample: main,
            threshold,
            reach: f64::INFINITY,
            others: Vec::new(),
            not_round: None,
        };
        let pixel = f64::from(image.raster.pixel);
        match (first.pixels.len() as f64) * pixel * pixel < HOLLOW * main.area() {
            true => bodies.in_hole(image, &first.pixels, rest),
            false => bodies.solid(image, rest),
        }
    }

    /// The sample in a ring: what lies in its hole, if anything does.
    fn in_hole(self, image: &Image, ring: &[usize], rest: &[Part]) -> Result<Self, String> {
        let main = self.sample;
        let from_axis = |i: &usize| distance(image.place(*i), main.centre);
        let mut ways: Vec<f64> = ring.iter().map(from_axis).collect();
        ways.sort_unstable_by(f64::total_cmp);
        // but for single pixels in it
        let hole = ways[ways.len() / 50];
        let pixel = f64::from(image.raster.pixel);
        let least = IN_HOLE * PI * libm::pow(hole / pixel, 2.0);
        let is_in = |part: &&Part| {
            let inside = part.pixels.iter().filter(|i| from_axis(i) < hole).count();
            2 * inside > part.pixels.len() && inside as f64 >= least
        };
        let found = match rest.iter().find(is_in) {
            Some(part) => Some((part.circle, self.threshold)),
            None => dim_in(image, &main, 0.9 * hole, least)
                .or_else(|| self.behind_gap(image, hole, least)),
        };
        let tube = Other {
            circle: main,
            kind: Kind::Tube,
        };
        match found {
            None => Ok(self),
            Some((Ok(sample), threshold)) => Ok(Bodies {
                sample,
                threshold,
                reach: (sample.radius + hole) / 2.0,
                others: vec![tube],
                not_round: None,
            }),
            Some((Err(_), _)) => {
                let tube = cylinder(&main, image.raster.pixel);
                Err(format!(
                    "a tube, {tube}, and in it something that is not round"
                ))
            }
        }
    }

    /// A sample in the hole of a tube, fainter than the tube and nearly as wide as the hole, and the brightness at its
    /// rim.
    fn behind_gap(
        &self,
        image: &Image,
        hole: f64,
        least: f64,
    ) -> Option<(Result<Circle, NoCircle>, f64)> {
        let tube = &self.sample;
        let inner = disc(image, tube.centre, 0.7 * hole).map(|i| f64::from(image.pixels[i]));
        let (inner, air) = (median(&mut inner.collect::<Vec<_>>()), self.air(image));
        if inner - air <= FAINT * (self.threshold - air) {
            return None;
        }
        let pixel = f64::from(image.raster.pixel);
        let threshold = (inner + air) / 2.0;
        let is_in = |i: usize| {
            f64::from(image.pixels[i]) >= threshold
                && distance(image.place(i), tube.centre) < hole - pixel
        };
        let part = image.parts(is_in).into_iter().next()?;
        let circle = around(image, &part, threshold).ok()?;
        let apart = distance(circle.centre, tube.centre) + circle.radius + GAP * pixel < hole;
        (part.len() as f64 >= least && apart).then_some((Ok(circle), threshold))
    }

    /// The brightness of what is dark around the sample.
    pub fn air(&self, image: &Image) -> f64 {
        let Circle { centre, radius } = self.sample;
        let outside = |i: &usize| {
            distance(image.place(*i), centre) > 1.04 * radius + 2.0 * f64::from(image.raster.pixel)
        };
        let values = (0..image.pixels.len()).filter(outside);
        let values = values.map(|i| f64::from(image.pixels[i]));
        let dark = values.filter(|v| *v < self.threshold);
        median(&mut dark.collect::<Vec<_>>())
    }

    /// What else there is besides a solid sample.
    fn solid(mut self, image: &Image, rest: &[Part]) -> Result<Self, String> {
        let main = self.sample;
        for part in rest {
            let around = |c: &Circle| distance(c.centre, main.centre) + main.radius < c.radius;
            if let Some(circle) = part.circle.ok().filter(around) {
                let ways = part
                    .pixels
                    .iter()
                    .map(|&i| distance(image.place(i), main.centre));
                let hole = ways.fold(f64::INFINITY, f64::min);
                self.reach = self.reach.min((main.radius + hole) / 2.0);
                let kind = Kind::Tube;
                self.others.push(Other { circle, kind });
            }
        }
        let beside = rest.iter().filter_map(|part| part.circle.ok());
        let beside = beside.filter(|c| main.off(c.centre) > 0.0);
        let beside: Vec<Circle> = beside.filter(|c| c.area() >= WORTH * main.area()).collect();
        let alike = beside.iter().filter(|c| c.area() >= ALIKE * main.area());
        let alike: Vec<String> = std::iter::once(&main)
            .chain(alike)
            .map(|c| cylinder(c, image.raster.pixel).to_string())
            .collect();
        if alike.len() > 1 {
            let n = if alike.len() == 2 { "two" } else { "several" };
            return Err(format!("{n} of them, {}", alike.join(" and ")));
        }
        for circle in beside {
            let gap = distance(circle.centre, main.centre) - circle.radius;
            self.reach = self.reach.min((main.radius + gap) / 2.0);
            let kind = Kind::Beside;
            self.others.push(Other { circle, kind });
        }
        self.not_round = rest.iter().find_map(|part| part.beside(image, &main));
        let inside = core(image, &main).map(|circle| Other {
            circle,
            kind: Kind::Inside,
        });
        self.others.extend(inside);
        Ok(self)
    }
}

/// The pixels near a point.
fn disc<'a>(
    image: &'a Image,
    centre: [f64; 2],
    radius: f64,
) -> impl Iterator<Item = usize> + Clone + 'a {
    (0..image.pixels.len()).filter(move |&i| distance(image.place(i), centre) < radius)
}

/// A sample in the hole of a far brighter tube, and the brightness at its rim.
fn dim_in(
    image: &Image,
    tube: &Circle,
    hole: f64,
    least: f64,
) -> Option<(Result<Circle, NoCircle>, f64)> {
    let values = disc(image, tube.centre, hole).map(|i| f64::from(image.pixels[i]));
    let (threshold, _) = split(values).filter(|(_, share)| *share >= TWO_LEVELS)?;
    let is_in = |i: usize| {
        f64::from(image.pixels[i]) >= threshold && distance(image.place(i), tube.centre) < hole
    };
    let part = image.parts(is_in).into_iter().next()?;
    (part.len() as f64 >= least).then(|| (around(image, &part, threshold), threshold))
}

/// The round part in the middle of a sample, if there are two levels of brightness in it.
fn core(image: &Image, main: &Circle) -> Option<Circle> {
    let inner = main.radius - 2.0 * f64::from(image.raster.pixel);
    let values = disc(image, main.centre, inner).map(|i| f64::from(image.pixels[i]));
    let (threshold, _) = split(values).filter(|(_, share)| *share >= TWO_LEVELS)?;
    let middle = disc(image, main.centre, 0.3 * main.radius);
    let bright = middle
        .clone()
        .filter(|&i| f64::from(image.pixels[i]) >= threshold);
    let sign = if 2 * bright.count() > middle.count() {
        1.0
    } else {
        -1.0
    };
    let seen = Image {
        raster: image.raster,
        pixels: image.pixels.iter().map(|v| sign * v).collect(),
    };
    let threshold = f64::from(sign) * threshold;
    let is_in = |i: usize| {
        f64::from(seen.pixels[i]) >= threshold && distance(seen.place(i), main.centre) < inner
    };
    let part = seen.parts(is_in).into_iter().next()?;
    let circle = around(&seen, &part, threshold).ok()?;
    let pixel = f64::from(image.raster.pixel);
    let share = circle.radius / main.radius;
    let apart = distance(circle.centre, main.centre);
    // else it is all that was looked at
    let is_smaller = circle.radius < inner - 1.5 * pixel;
    (share >= 0.4 && is_smaller && apart < 0.2 * main.radius).then_some(circle)
}
