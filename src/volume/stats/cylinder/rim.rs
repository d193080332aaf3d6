//! Where a sample ends: the radius of its rim, and slices in which air reaches into a cylinder.

use super::axis::{Axis, Seen, Slice};
use super::circle::{DIRECTIONS, Outline, direction, distance};
use super::extent::RIM;
use super::image::median;
use super::rings::{Rings, SECTORS};
use super::{SMALLEST, rounded};
use crate::grid::Cylinder;
use std::f64::consts::TAU;

/// Of the steepest fall of the brightness, what still is a part of it.
const FALLS: f64 = 0.05;
/// How widely a rim spreads that is not blurred, in voxels, or in rings that are wider.
const SHARP: f64 = 0.8;
/// Of what it spreads by more, how much further inside the cylinder ends.
const BLURRED: f64 = 0.8;
/// Of the radius, air at the rim that is told; or so many pixels.
const WORTH: [f64; 2] = [0.03, 1.0];
/// Of the directions, those in which it is seen where it is all around.
const ALL_AROUND: f64 = 0.75;
/// Of the radius, what is left at least of a cylinder without the air.
const LEFT: f64 = 0.5;
/// Directions in which half of that is seen at a side at least: an open pore is in fewer.
const SIDE: usize = 3;

/// The rim of a sample around its axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rim {
    /// How much further out it is than the axis says, in voxels.
    pub further: f64,
    /// How far its middle is from the axis.
    pub aside: [f64; 2],
    /// How far inside of it there is only the sample.
    pub blur: f64,
    /// How widely it spreads, in rings.
    pub spread: f64,
}

/// Where the brightness falls from ring to ring.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fall {
    /// The middle of it, in rings.
    at: f64,
    /// Its standard deviation.
    pub spread: f64,
}

impl Rim {
    /// Where the brightness around the axis falls the steepest, of all slices together: the middle of the fall, which a
    /// blur that is the same on both sides does not move. Pores that get rarer towards the rim do, the more the wider the
    /// blur, so a wide fall is taken to end further inside.
    pub fn of(rings: &Rings, radius: f64) -> Self {
        let all = |sectors| rings.profile(0..rings.slices.len(), sectors).means();
        let near = rings.count((RIM * radius).max(3.0)) + 1;
        let Some(fall) = Fall::near(&all(0..SECTORS), radius / rings.width, near) else {
            return Rim {
                further: 0.0,
                aside: [0.0; 2],
                blur: 0.0,
                spread: 0.0,
            };
        };
        // the mean of a cosine over a quarter of a turn
        const QUARTER: f64 = 0.9;
        let mut aside = [0.0; 2];
        for (quarter, sectors) in (0..SECTORS).step_by(SECTORS / 4).enumerate() {
            let here = Fall::near(&all(sectors..sectors + SECTORS / 4), fall.at, near.min(3));
            // what is further off is flat there
            let off = here.map_or(0.0, |here| here.at - fall.at);
            let off = if off.abs() > 1.5 { 0.0 } else { off };
            let (sin, cos) = libm::sincos((quarter as f64 + 0.5) / 4.0 * TAU);
            let by = off * rings.width / (2.0 * QUARTER);
            aside = [aside[0] + by * cos, aside[1] + by * sin];
        }
        Rim {
            further: fall.at * rings.width - radius,
            aside,
            blur: BLURRED * (fall.spread - SHARP).max(0.0) * rings.width,
            spread: fall.spread,
        }
    }
}

impl Fall {
    /// The steepest one, by so many rings about some ring, of what each ring has.
    pub fn near(of: &[f64], ring: f64, by: usize) -> Option<Self> {
        let fall = |ring: usize| of[ring - 1] - of[ring];
        let at = ring.round() as usize;
        let places = at.saturating_sub(by).max(1)..(at + by).min(of.len());
        let known = places.filter(|ring| !fall(*ring).is_nan());
        let steepest = known.max_by(|a, b| fall(*a).total_cmp(&fall(*b)))?;
        let most = fall(steepest);
        if most <= 0.0 {
            return None;
        }
        let is_part = |ring: &usize| fall(*ring) > FALLS * most;
        let first = (1..steepest).rev().take_while(is_part).last();
        let last = (steepest + 1..of.len()).take_while(is_part).last();
        let part = first.unwrap_or(steepest)..last.unwrap_or(steepest) + 1;
        let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
            part.clone().map(|ring| fall(ring) * of(ring as f64)).sum()
        };
        let n = sum(&|_| 1.0);
        let at = sum(&|ring| ring) / n;
        let spread = (sum(&|ring| (ring - at) * (ring - at)) / n).sqrt();
        Some(Fall { at, spread })
    }
}

/// A cylinder and what slices show of the rim of the sample.
pub(super) struct AtRim<'a> {
    pub cylinder: Cylinder,
    pub seen: &'a Seen,
    pub axis: &'a Axis,
    pub threshold: f64,
    /// The radius up to which there is nothing else.
    pub reach: f64,
    /// How much further out the rim is than outlines are.
    pub further: f64,
}

/// Air that reaches into the cylinder.
pub(super) struct AirAtRim {
    /// The slices, as people read them.
    pub slices: String,
    /// The middle of the side where it is, as an angle; all around without.
    pub side: Option<f64>,
    /// How deep it reaches, in voxels.
    pub depth: f64,
    /// How deep it reaches in the direction where that is most.
    pub deepest: f64,
}

impl AirAtRim {
    /// What the user should know of it.
    pub fn warning(&self, cylinder: &Cylinder) -> String {
        let Cylinder {
            centre: [x, y],
            radius,
        } = *cylinder;
        let side = match self.side {
            None => "all around".to_owned(),
            Some(angle) => {
                let (sin, cos) = libm::sincos(angle);
                let [x, y] = [x + radius * cos, y + radius * sin].map(f64::round);
                format!("at the side of x {x}, y {y}")
            }
        };
        let inside = Cylinder {
            radius: rounded(radius - self.deepest - 1.0),
            ..*cylinder
        };
        let advice = match inside.radius >= (LEFT * radius).max(SMALLEST) {
            true => format!("--roi {inside} ends inside of the sample in all slices"),
            false => "--roi mask:FILE of the sample, or --crop, leaves it out".to_owned(),
        };
        let voxels = match self.depth.round() {
            1.0 => "voxel is".to_owned(),
            n => format!("{n} voxels are"),
        };
        format!(
            "the cylinder that was taken holds air beside the sample, which counts as a pore: in {} its outermost {voxels} \
             empty {side}; {advice}",
            self.slices
        )
    }
}

/// Some of the slices that are looked at, as people read them: those that follow each other there as a range.
pub(super) fn names(some: &[u32], all: &[u32]) -> String {
    let place = |z: u32| all.iter().position(|other| *other == z);
    let follows = |a: &u32, b: &u32| place(*a).map(|i| i + 1) == place(*b);
    let run = |run: &[u32]| match [run[0], run[run.len() - 1]] {
        [a, b] if a == b => a.to_string(),
        [a, b] => format!("{a} to {b}"),
    };
    let runs = some.chunk_by(follows).map(run).collect::<Vec<_>>();
    let word = if some.len() == 1 { "slice" } else { "slices" };
    format!("{word} {}", runs.join(" and "))
}

impl AtRim<'_> {
    /// The slices, of some, in which the sample ends inside of the cylinder: all around, or else at one side.
    pub fn air(&self, slices: &[&Slice]) -> Option<AirAtRim> {
        let outlines: Vec<Option<Outline>> = slices.iter().map(|s| self.outline(s)).collect();
        let depths: Vec<Option<Depths>> = self.depths(&outlines, 1);
        let told = self.told();
        let is_told = |of: &Depths, n: f64| of.iter().filter(|v| **v > told).count() as f64 >= n;
        let all = slices.iter().zip(&depths);
        let around = all.filter_map(|(slice, of)| Some((slice.z, of.as_ref()?)));
        let all_around = ALL_AROUND * DIRECTIONS as f64;
        let around: Vec<_> = around.filter(|(_, of)| is_told(of, all_around)).collect();
        if around.is_empty() {
            return self.side(slices, &outlines);
        }
        let of_each = around.iter().map(|(_, of)| median(&mut of.to_vec()));
        let deepest = around.iter().flat_map(|(_, of)| of.iter());
        let found: Vec<u32> = around.iter().map(|(z, _)| *z).collect();
        Some(AirAtRim {
            depth: of_each.fold(0.0, f64::max),
            deepest: deepest.copied().fold(0.0, f64::max),
            slices: names(&found, &numbers(slices)),
            side: None,
        })
    }

    /// What is told, in voxels.
    fn told(&self) -> f64 {
        let pixel = f64::from(self.seen.raster.pixel);
        (WORTH[0] * self.cylinder.radius).max(WORTH[1] * pixel)
    }

    /// The same at one side of slices that follow each other, half of them together, whose pores are elsewhere.
    fn side(&self, slices: &[&Slice], outlines: &[Option<Outline>]) -> Option<AirAtRim> {
        let told = self.told();
        let mut seen = Vec::new();
        let mut counts = [0; DIRECTIONS];
        let mut depth = 0.0f64;
        let all = slices.iter().zip(self.depths(outlines, slices.len() / 4));
        for (slice, depths) in all.filter_map(|(slice, depths)| Some((slice, depths?))) {
            let is_deep = |d: &usize| depths[*d] > told / 2.0;
            let deep: Vec<usize> = (0..DIRECTIONS).filter(is_deep).collect();
            let deepest = depths.iter().copied().fold(0.0, f64::max);
            if deep.len() >= SIDE && deepest > told {
                seen.push(slice.z);
                deep.iter().for_each(|d| counts[*d] += 1);
                depth = depth.max(deepest);
            }
        }
        let sum = |a: usize| -> f64 {
            let each = counts.iter().enumerate();
            each.map(|(d, n)| f64::from(*n) * direction(d)[a]).sum()
        };
        (!seen.is_empty()).then(|| AirAtRim {
            slices: names(&seen, &numbers(slices)),
            side: Some(libm::atan2(sum(1), sum(0))),
            depth,
            deepest: depth,
        })
    }

    fn outline(&self, slice: &Slice) -> Option<Outline> {
        let circle = self.axis.at(slice.z.into());
        let pixel = f64::from(self.seen.raster.pixel);
        let reach = (circle.radius + (RIM * circle.radius).max(pixel)).min(self.reach);
        slice.outline(self.threshold, |at| distance(at, circle.centre) <= reach)
    }

    /// How far outlines end inside of the cylinder, each with some of its neighbours on either side.
    fn depths(&self, outlines: &[Option<Outline>], neighbours: usize) -> Vec<Option<Depths>> {
        let of = |i: usize| {
            let last = outlines.len().saturating_sub(2 * neighbours + 1);
            let first = i.saturating_sub(neighbours).min(last);
            let near = first..(first + 2 * neighbours + 1).min(outlines.len());
            let near = outlines[near].iter().flatten().cloned();
            Some(self.below(&near.reduce(|a, b| a.with(&b))?))
        };
        (0..outlines.len()).map(of).collect()
    }

    /// How far an outline ends inside of the cylinder, in each direction.
    fn below(&self, outline: &Outline) -> Depths {
        let Cylinder {
            centre: [x, y],
            radius,
        } = self.cylinder;
        std::array::from_fn(|i| {
            let [cos, sin] = direction(i);
            x * cos + y * sin + radius - outline.reach[i] - self.further
        })
    }
}

fn numbers(slices: &[&Slice]) -> Vec<u32> {
    slices.iter().map(|slice| slice.z).collect()
}

/// Voxels in each direction.
type Depths = [f64; DIRECTIONS];
