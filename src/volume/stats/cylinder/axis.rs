//! The line through the middles of a sample in all slices, and the slices that show it.

use super::Means;
use super::bodies::Bodies;
use super::circle::{Circle, distance, near};
use super::image::{Image, median};
use super::slices::{Coarse, Raster, one_more};
use crate::error::Result;
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::ops::Range;

/// How far from the circle that most means show that of a mean is looked for, as a share of its radius.
const NEAR: f64 = 0.2;
/// What a tilt may take of the radius.
pub(super) const MOST_TILTED: f64 = 0.15;
/// Pixels by which an axis moves between the lowest and the highest slice without being tilted.
const UPRIGHT: f64 = 1.0;

/// A sample as a circle that moves from slice to slice.
#[derive(Debug)]
pub(super) struct Axis {
    raster: Raster,
    /// At slice 0 if `slope` is not 0, in pixels.
    circle: Circle,
    /// How far it moves from slice to slice.
    slope: [f64; 2],
    /// The brightness between that of the sample and that of the air.
    threshold: f64,
}

impl Axis {
    /// Lays a line through the middles of the circles of all means: medians of the slopes between any two of them (H.
    /// Theil, A rank-invariant method of linear and polynomial regression analysis, 1950).
    ///
    /// Else says what was found instead.
    pub fn of(means: &Means, bodies: &Bodies) -> Result<Self, String> {
        let sample = bodies.sample;
        let reach = (NEAR * sample.radius).max(3.0);
        let radii = (sample.radius - reach).max(1.0)..(sample.radius + reach).min(bodies.reach);
        let circle = |(z, image): &(f64, Image)| {
            near(image, &sample, &radii, bodies.threshold).map(|circle| (*z, circle))
        };
        let mut found: Vec<(f64, Circle)> = means.groups.iter().filter_map(circle).collect();
        if 2 * found.len() < means.groups.len() {
            // pores open the rim in each of them, but not at one place in all
            let halves = means.halves();
            found = halves.iter().filter_map(circle).collect();
            if found.len() < halves.len() {
                return Err("one that is round in few slices only".to_owned());
            }
        }
        let of_axis = |a: usize| {
            let places: Vec<[f64; 2]> = found.iter().map(|(z, c)| [*z, c.centre[a]]).collect();
            line(&places)
        };
        let lines = [of_axis(0), of_axis(1)];
        let mut axis = Axis {
            raster: means.all.raster,
            circle: sample,
            slope: lines.map(|line| line[1]),
            threshold: bodies.threshold,
        };
        let ends = [found.first(), found.last()].map(|end| end.map_or(0.0, |(z, _)| *z));
        let moved = libm::hypot(axis.slope[0], axis.slope[1]) * (ends[1] - ends[0]);
        if moved <= UPRIGHT {
            axis.slope = [0.0; 2];
            return Ok(axis);
        }
        axis.circle = Circle {
            centre: lines.map(|line| line[0]),
            radius: median(&mut found.iter().map(|(_, c)| c.radius).collect::<Vec<_>>()),
        };
        let off = |(z, c): &&(f64, Circle)| distance(c.centre, axis.at(*z)) <= 2.0 * c.slack();
        match 2 * found.iter().filter(off).count() >= found.len() {
            true => Ok(axis),
            false => Err("one that is not upright: its axis moves from slice to slice".to_owned()),
        }
    }

    /// Its middle in a slice.
    pub fn at(&self, z: f64) -> [f64; 2] {
        [0, 1].map(|a| self.circle.centre[a] + self.slope[a] * z)
    }

    /// The radius of its rim.
    pub fn radius(&self) -> f64 {
        self.circle.radius
    }

    /// The upright circle that lies inside of it in all slices that are at most `half` from slice `z`.
    pub fn inside(&self, z: f64, half: f64) -> Circle {
        let moved = libm::hypot(self.slope[0], self.slope[1]) * half;
        Circle {
            centre: self.at(z),
            radius: self.radius() - moved,
        }
    }

    /// True if it is not upright.
    pub fn is_tilted(&self) -> bool {
        self.slope != [0.0; 2]
    }

    /// The angle to z where voxels have this size, in degrees.
    pub fn degrees(&self, spacing: [f64; 3]) -> f64 {
        let pixel = f64::from(self.raster.pixel);
        let [x, y] = [0, 1].map(|a| self.slope[a] * pixel * spacing[a]);
        libm::atan2(libm::hypot(x, y), spacing[2]).to_degrees()
    }
}

/// The value at 0 and the slope of the line through points.
fn line(points: &[[f64; 2]]) -> [f64; 2] {
    let pairs = points.iter().enumerate();
    let pairs = pairs.flat_map(|(i, p)| points[i + 1..].iter().map(move |q| (p, q)));
    let mut slopes: Vec<f64> = pairs.map(|(p, q)| (q[1] - p[1]) / (q[0] - p[0])).collect();
    let slope = match slopes.is_empty() {
        true => 0.0,
        false => median(&mut slopes),
    };
    let mut starts: Vec<f64> = points.iter().map(|p| p[1] - slope * p[0]).collect();
    [median(&mut starts), slope]
}

/// The brightness of a slice.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// In the sample.
    inside: f64,
    /// Around it; NaN if nothing is seen there.
    around: f64,
}

/// Where a sample is looked for along z.
pub(super) struct Extent<'a> {
    pub volume: &'a dyn Volume,
    pub range: &'a Range<u32>,
    pub axis: &'a Axis,
    pub progress: &'a dyn Progress,
}

/// What slices with the sample are like.
#[derive(Debug, Clone, Copy)]
struct Usual {
    /// Half-way between the brightness of the sample and that of the air around it.
    half: f64,
    /// There is air around it, and not a tube, or what programs fill with beyond the circle of a reconstruction.
    in_air: bool,
}

impl Usual {
    fn of(levels: &[Level], threshold: f64) -> Usual {
        let inside = levels.iter().map(|l| l.inside).filter(|v| *v >= threshold);
        let inside = median(&mut inside.collect::<Vec<_>>());
        let around = levels.iter().map(|l| l.around).filter(|v| v.is_finite());
        let around = median(&mut around.collect::<Vec<_>>());
        let in_air = around < threshold && inside.is_finite();
        let half = if in_air {
            (inside + around) / 2.0
        } else {
            threshold
        };
        Usual { half, in_air }
    }

    /// True if it is bright inside and dark around.
    fn holds(&self, level: Level) -> bool {
        level.inside >= self.half && !(self.in_air && level.around >= self.half)
    }
}

impl Extent<'_> {
    /// The slices that show the sample: the longest stretch of those that were seen, and up to where it ends if single
    /// slices can be read.
    ///
    /// # Errors
    /// The volume's; [`crate::Error::Interrupted`].
    pub fn find<T: Voxel>(&self, slices: &[Coarse]) -> Result<Range<u32>> {
        let [nx, ny, _] = self.volume.header().dims.0;
        let raster = super::slices::coarse([nx, ny]);
        let levels: Vec<Level> = slices.iter().map(|s| self.level(raster, s)).collect();
        let usual = Usual::of(&levels, self.axis.threshold);
        let holds: Vec<bool> = levels.iter().map(|level| usual.holds(*level)).collect();
        let Some(longest) = longest(&holds) else {
            return Ok(self.range.clone());
        };
        let (first, last) = (slices[longest.start].z, slices[longest.end - 1].z);
        let before = longest.start.checked_sub(1).map(|i| slices[i].z);
        let after = slices.get(longest.end).map(|slice| slice.z);
        let shows = |z: u32| {
            let slice = one_more::<T>(self.volume, z, raster, self.progress)?;
            Ok(usual.holds(self.level(raster, &slice)))
        };
        let start = self.end(first, before, self.range.start, &shows)?;
        let end = self.end(last, after, self.range.end - 1, &shows)?;
        Ok(start..end + 1)
    }

    /// The last slice with the sample from one that has it towards one that is known not to, or else to the end of the
    /// range: by halves.
    fn end(
        &self,
        mut with: u32,
        without: Option<u32>,
        end: u32,
        shows: &impl Fn(u32) -> Result<bool>,
    ) -> Result<u32> {
        let mut without = match without {
            None if with == end || !self.volume.random_access() || shows(end)? => return Ok(end),
            None => end,
            Some(without) => without,
        };
        while with.abs_diff(without) > 1 && self.volume.random_access() {
            let half = with.midpoint(without);
            match shows(half)? {
                true => with = half,
                false => without = half,
            }
        }
        Ok(with)
    }

    /// The brightness of a slice in the inner part of the sample and around it.
    fn level(&self, raster: Raster, slice: &Coarse) -> Level {
        let fine = self.axis.raster;
        let centre = self.axis.at(f64::from(slice.z)).map(|v| fine.voxel(v));
        let radius = self.axis.radius() * f64::from(fine.pixel);
        let cell = f64::from(raster.pixel);
        let (mut inside, mut around) = ((0.0, 0.0), (0.0, 0.0));
        for (i, v) in slice
            .pixels
            .iter()
            .enumerate()
            .filter(|(_, v)| v.is_finite())
        {
            let place = [i % raster.width, i / raster.width].map(|p| raster.voxel(p as f64));
            let way = distance(place, centre);
            let sum = if way <= (0.85 * radius).max(cell) {
                &mut inside
            } else if way > 1.05 * radius + cell && way < 1.3 * radius + 2.0 * cell {
                &mut around
            } else {
                continue;
            };
            *sum = (sum.0 + f64::from(*v), sum.1 + 1.0);
        }
        Level {
            inside: inside.0 / inside.1,
            around: around.0 / around.1,
        }
    }
}

/// The longest stretch of those that hold.
fn longest(holds: &[bool]) -> Option<Range<usize>> {
    let mut best: Option<Range<usize>> = None;
    let mut start = 0;
    for stretch in holds.chunk_by(|a, b| a == b) {
        let range = start..start + stretch.len();
        start = range.end;
        if stretch[0] && best.as_ref().is_none_or(|best| range.len() > best.len()) {
            best = Some(range);
        }
    }
    best
}
