//! What each slice shows of a body: its outline. Those on which most slices agree give its axis, its tilt and its taper.

use super::SMALLEST;
use super::circle::{Circle, DIRECTIONS, Outline, distance};
use super::image::{Hidden, Image, median, split};
use super::rim::{Rim, names};
use super::slices::{Picture, Raster, spread};
use crate::error::Result;
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::f64::consts::PI;
use std::ops::Range;

/// What a tilt may take of the radius.
pub(super) const MOST_TILTED: f64 = 0.15;
/// Voxels, or pixels where means of slices have fewer, by which a rim moves between the lowest and the highest slice without
/// being tilted or tapered.
const STRAIGHT: f64 = 1.5;
/// By how many of its standard errors it does so at least.
const CLEAR: f64 = 3.0;
/// Slices that show the same body differ by so many pixels at most, or by this share of its radius.
const ALIKE: [f64; 2] = [1.5, 0.03];
/// In this share of the directions at least.
const AGREE: f64 = 0.6;

/// The shares of the pixels of a slice that are darker than its darkest and its brightest parts, without stray ones.
const DARKEST: f64 = 0.05;
const BRIGHTEST: f64 = 0.99;
/// How much brighter, above what is dark, a slice is than most are, if it shows something else: its brightest parts, and its
/// mean.
const FAR_BRIGHTER: [f64; 2] = [1.5, 2.0];

/// Of the slices, those that are brighter inside of a body than beside it at least.
const ALL_BUT_FEW: f64 = 0.9;

/// Some slices of a range, by rising number, and what they show.
#[derive(Clone)]
pub(super) struct Seen {
    pub raster: Raster,
    pub slices: Vec<Slice>,
    /// Those that are of one value, and show nothing.
    blank: Vec<u32>,
    hidden: Hidden,
    /// The brightness that parts what is bright from what is not.
    threshold: f64,
    /// Slices whose brightest parts, or whose means, are brighter show something else.
    brightest: [f64; 2],
}

/// A slice.
#[derive(Clone)]
pub(super) struct Slice {
    pub z: u32,
    pub image: Image,
}

impl Seen {
    /// Reads some slices of a range; `None` if all that they show is of one value.
    ///
    /// # Errors
    /// The volume's; [`crate::Error::Interrupted`].
    pub fn read<T: Voxel>(
        volume: &dyn Volume,
        range: &Range<u32>,
        progress: &dyn Progress,
    ) -> Result<Option<Self>> {
        let raster = Raster::coarse(volume);
        let slices = spread(range);
        progress.begin("region", slices.len() as u64);
        let read = |z: u32| {
            progress.advance(1);
            Picture::read::<T>(volume, z, raster, progress)
        };
        let pictures = slices.into_iter().map(read).collect::<Result<Vec<_>>>()?;
        let (blank, pictures): (Vec<_>, Vec<_>) = pictures.into_iter().partition(Picture::is_blank);
        if pictures.is_empty() {
            return Ok(None);
        }
        let hidden = Hidden::of(&pictures, raster);
        let slice = |picture: Picture| Slice {
            z: picture.z,
            image: hidden.image(picture.pixels, raster),
        };
        let slices: Vec<Slice> = pictures.into_iter().map(slice).collect();
        let pixels = slices.iter().flat_map(|slice| &slice.image.pixels);
        let split = split(pixels.map(|v| f64::from(*v)));
        Ok(split.map(|(threshold, _)| Seen {
            raster,
            slices,
            blank: blank.into_iter().map(|picture| picture.z).collect(),
            hidden,
            threshold,
            brightest: [f64::INFINITY; 2],
        }))
    }

    /// The same without slices that are far brighter than this share of them is, as of a holder under a sample with few walls.
    /// `None` if all are alike.
    pub fn of_most(&self, share: f64) -> Option<Self> {
        let dark = median(
            &mut self
                .slices
                .iter()
                .map(|s| s.level(DARKEST))
                .collect::<Vec<_>>(),
        );
        let most = |place: usize| {
            let mut all: Vec<f64> = self.slices.iter().map(|s| s.brightness()[place]).collect();
            all.sort_unstable_by(f64::total_cmp);
            let usual = all[((all.len() - 1) as f64 * share) as usize];
            dark + FAR_BRIGHTER[place] * (usual - dark)
        };
        let mut seen = Seen {
            brightest: [most(0), most(1)],
            ..self.clone()
        };
        let alike = || self.slices.iter().filter(|s| !seen.is_far_brighter(s));
        if alike().count() == self.slices.len() {
            return None;
        }
        let pixels = alike().flat_map(|slice| &slice.image.pixels);
        (seen.threshold, _) = split(pixels.map(|v| f64::from(*v)))?;
        Some(seen)
    }

    /// True if a slice shows something else by its brightness.
    pub fn is_far_brighter(&self, slice: &Slice) -> bool {
        let brightness = slice.brightness();
        (0..2).any(|place| brightness[place] > self.brightest[place])
    }

    /// The slices that may show the sample.
    pub fn alike(&self) -> impl Iterator<Item = &Slice> {
        self.slices
            .iter()
            .filter(|slice| !self.is_far_brighter(slice))
    }

    /// True if slices are brighter inside of a body than beside it: most of them, those that show the beside at all.
    pub fn is_bright(&self, axis: &Axis) -> bool {
        let is_bright = |slice: &&Slice| {
            let circle = axis.at(slice.z.into());
            let (mut inside, mut beside) = ((0.0, 0.0), (0.0, 0.0));
            for (i, v) in slice.image.pixels.iter().enumerate() {
                let share = (circle.off(slice.image.place(i)) + circle.radius) / circle.radius;
                let sum = match share {
                    _ if self.hidden.hides(i) => continue,
                    ..0.9 => &mut inside,
                    1.1..1.3 => &mut beside,
                    _ => continue,
                };
                *sum = (sum.0 + f64::from(*v), sum.1 + 1.0);
            }
            inside.0 / inside.1 > beside.0 / beside.1
        };
        let bright = self.alike().filter(is_bright).count();
        bright as f64 >= ALL_BUT_FEW * self.alike().count() as f64
    }

    /// One more slice, as those that were seen; `None` if it is of one value.
    ///
    /// # Errors
    /// The volume's; [`crate::Error::Interrupted`].
    pub fn one_more<T: Voxel>(
        &self,
        volume: &dyn Volume,
        z: u32,
        progress: &dyn Progress,
    ) -> Result<Option<Slice>> {
        let picture = Picture::read::<T>(volume, z, self.raster, progress)?;
        Ok((!picture.is_blank()).then(|| Slice {
            z,
            image: self.hidden.image(picture.pixels, self.raster),
        }))
    }

    /// The slices of a range that are of one value, as people read them; `None` without any.
    pub fn blank_names(&self, range: &Range<u32>) -> Option<String> {
        let blank: Vec<u32> = self
            .blank
            .iter()
            .copied()
            .filter(|z| range.contains(z))
            .collect();
        let mut all: Vec<u32> = self.slices.iter().map(|slice| slice.z).collect();
        all.extend(&self.blank);
        all.sort_unstable();
        (!blank.is_empty()).then(|| names(&blank, &all))
    }

    /// The outlines of all that is bright in the slices, where anything is.
    pub fn outlines(&self) -> Vec<OfSlice> {
        let of = |slice: &Slice| {
            let outline = slice.outline(self.threshold, |_| true)?;
            Some(OfSlice {
                z: slice.z,
                outline,
            })
        };
        self.alike().filter_map(of).collect()
    }

    /// The slices between those that show nothing bright, where few of all do; `None` otherwise.
    pub fn few(&self, range: &Range<u32>) -> Option<Range<u32>> {
        let bright = |slice: &Slice| {
            let pixels = slice.image.pixels.iter();
            let bright = pixels.filter(|v| f64::from(**v) >= self.threshold);
            (slice.z, bright.count())
        };
        let mut bright: Vec<(u32, usize)> = self.slices.iter().map(bright).collect();
        bright.extend(self.blank.iter().map(|z| (*z, 0)));
        bright.sort_unstable();
        let most = bright.iter().map(|(_, n)| *n).max()?;
        let first = bright.iter().position(|(_, n)| 2 * n > most)?;
        let last = bright.iter().rposition(|(_, n)| 2 * n > most)?;
        let before = first.checked_sub(1).map(|i| bright[i].0 + 1);
        let after = bright.get(last + 1).map(|(z, _)| *z);
        let part = before.unwrap_or(range.start)..after.unwrap_or(range.end);
        (2 * part.len() < range.len()).then_some(part)
    }

    /// True if most slices are of one value.
    pub fn is_mostly_blank(&self) -> bool {
        self.blank.len() > self.slices.len()
    }

    /// True if what the slices do not show begins where a circle ends.
    pub fn ends_at(&self, circle: &Circle) -> bool {
        self.hidden.begins_at(self.raster, circle)
    }
}

impl Slice {
    /// Of its brightest parts, and of all.
    fn brightness(&self) -> [f64; 2] {
        let pixels = &self.image.pixels;
        let sum: f64 = pixels.iter().map(|v| f64::from(*v)).sum();
        [self.level(BRIGHTEST), sum / pixels.len() as f64]
    }

    /// The brightness below which this share of its pixels is.
    fn level(&self, share: f64) -> f64 {
        let mut values = self.image.pixels.clone();
        let place = (values.len() - 1) as f64 * share;
        f64::from(
            *values
                .select_nth_unstable_by(place as usize, f32::total_cmp)
                .1,
        )
    }

    /// The outline of what is bright in a part of it, without specks.
    pub fn outline(&self, threshold: f64, within: impl Fn([f64; 2]) -> bool) -> Option<Outline> {
        let image = &self.image;
        let least = PI * libm::pow(SMALLEST / f64::from(image.raster.pixel), 2.0) / 8.0;
        let is_in = |i: usize| f64::from(image.pixels[i]) >= threshold && within(image.place(i));
        let mut bright = vec![false; image.pixels.len()];
        for part in image.parts(is_in) {
            if part.len() as f64 >= least {
                part.into_iter().for_each(|i| bright[i] = true);
            }
        }
        Outline::of(image, &bright, threshold)
    }
}

/// The outline of what a slice shows.
pub(super) struct OfSlice {
    pub z: u32,
    pub outline: Outline,
}

/// The outlines that show one body: those near the lines, from slice to slice, on which most of them lie.
pub(super) fn of_one_body(outlines: Vec<OfSlice>, pixel: u32) -> Vec<OfSlice> {
    let radius = |o: &OfSlice| o.outline.reach.iter().sum::<f64>() / DIRECTIONS as f64;
    let radius = median(&mut outlines.iter().map(radius).collect::<Vec<_>>());
    let alike = (ALIKE[0] * f64::from(pixel)).max(ALIKE[1] * radius);
    let n = outlines.len();
    let apart = (n / 3).max(1);
    let level = (0..n).map(|i| (i, i));
    let pairs = (0..n).flat_map(|i| (i + apart..n).map(move |j| (i, j)));
    let mut best = (0.0, Vec::new());
    for (i, j) in level.chain(pairs) {
        let lines = Lines {
            ends: [&outlines[i], &outlines[j]],
            alike,
        };
        let near: Vec<Near> = outlines.iter().map(|o| lines.near(o)).collect();
        let score = near.iter().map(|near| near.score).sum::<f64>();
        if score > best.0 {
            best = (score, near.iter().map(|near| near.agrees).collect());
        }
    }
    let all = outlines.into_iter().zip(best.1);
    all.filter(|(_, agrees)| *agrees).map(|(o, _)| o).collect()
}

/// Where each direction of an outline lies in other slices, by two of them.
struct Lines<'a> {
    ends: [&'a OfSlice; 2],
    /// What outlines of one body differ by at most.
    alike: f64,
}

/// How near an outline is.
struct Near {
    /// 0 to 1.
    score: f64,
    agrees: bool,
}

impl Lines<'_> {
    fn near(&self, of: &OfSlice) -> Near {
        let [a, b] = self.ends;
        let share = match a.z == b.z {
            true => 0.0,
            false => (f64::from(of.z) - f64::from(a.z)) / (f64::from(b.z) - f64::from(a.z)),
        };
        let (mut score, mut agree) = (0.0, 0);
        for d in (0..DIRECTIONS).step_by(2) {
            let [from, to] = [a, b].map(|o| o.outline.reach[d]);
            let off = (of.outline.reach[d] - from - share * (to - from)) / self.alike;
            score += (1.0 - off * off).max(0.0);
            agree += usize::from(off.abs() <= 1.0);
        }
        let n = (DIRECTIONS / 2) as f64;
        Near {
            score: score / n,
            agrees: agree as f64 >= AGREE * n,
        }
    }
}

/// A circle that moves and changes evenly from slice to slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    /// In slice 0.
    circle: Circle,
    /// What it moves by from slice to slice, in voxels.
    slope: [f64; 2],
    /// What its radius grows by.
    taper: f64,
}

impl Axis {
    /// Lays lines through the circles of outlines: medians of the slopes between any two of them (H. Theil, A rank-invariant
    /// method of linear and polynomial regression analysis, 1950). `None` without a circle. Means of slices have `fine`
    /// voxels along a pixel.
    pub fn through(outlines: &[OfSlice], [pixel, fine]: [u32; 2]) -> Option<Self> {
        let circle = |o: &OfSlice| {
            let (circle, _) = o.outline.circle(pixel)?;
            Some((f64::from(o.z), circle))
        };
        let circles: Vec<(f64, Circle)> = outlines.iter().filter_map(circle).collect();
        let (first, last) = (circles.first()?.0, circles.last()?.0);
        let line = |of: &dyn Fn(&Circle) -> f64| {
            let points: Vec<[f64; 2]> = circles.iter().map(|(z, c)| [*z, of(c)]).collect();
            Line::through(&points)
        };
        let lines = [line(&|c| c.centre[0]), line(&|c| c.centre[1])];
        let radius = line(&|c| c.radius);
        let straight = STRAIGHT * f64::from(fine);
        let is_clear = |lines: &[Line]| {
            let squares = |of: fn(&Line) -> f64| lines.iter().map(|l| of(l) * of(l)).sum::<f64>();
            let moved = squares(|l| l.slope).sqrt() * (last - first);
            moved > straight.max(CLEAR * squares(|l| l.error).sqrt())
        };
        let (tilts, tapers) = (is_clear(&lines), is_clear(&[radius]));
        let start = |line: &Line, moves: bool| if moves { line.start } else { line.middle };
        let slope = |line: &Line, moves: bool| if moves { line.slope } else { 0.0 };
        Some(Axis {
            circle: Circle {
                centre: [0, 1].map(|a| start(&lines[a], tilts)),
                radius: start(&radius, tapers),
            },
            slope: [0, 1].map(|a| slope(&lines[a], tilts)),
            taper: slope(&radius, tapers),
        })
    }

    /// Of outlines without a circle.
    pub const UNKNOWN: Axis = Axis {
        circle: Circle {
            centre: [0.0; 2],
            radius: 0.0,
        },
        slope: [0.0; 2],
        taper: 0.0,
    };

    /// The same without a tilt.
    pub fn upright(mut self) -> Self {
        self.slope = [0.0; 2];
        self
    }

    /// The same that is there at a circle in some slice.
    pub fn moved_to(mut self, circle: &Circle, z: f64) -> Self {
        self.taper = 0.0;
        self.circle = Circle {
            centre: [0, 1].map(|a| circle.centre[a] - self.slope[a] * z),
            radius: circle.radius,
        };
        self
    }

    /// A slice of it.
    pub fn at(&self, z: f64) -> Circle {
        Circle {
            centre: [0, 1].map(|a| self.circle.centre[a] + self.slope[a] * z),
            radius: self.circle.radius + self.taper * z,
        }
    }

    /// The same by where the rim was seen.
    pub fn corrected(mut self, rim: &Rim) -> Self {
        self.circle.radius += rim.further;
        self.circle.centre = [0, 1].map(|a| self.circle.centre[a] + rim.aside[a]);
        self
    }

    /// The upright circle that lies inside of it in all of some slices.
    pub fn inside(&self, slices: &Range<u32>) -> Circle {
        let [first, last] = [slices.start, slices.end - 1].map(|z| self.at(z.into()));
        let moved = distance(first.centre, last.centre) / 2.0;
        let middle = [0, 1].map(|a| (first.centre[a] + last.centre[a]) / 2.0);
        let share = (last.radius - first.radius) / 2.0;
        // a cone that leans is nearer to the middle where it is wide
        Circle {
            centre: middle,
            radius: (first.radius + last.radius) / 2.0 - moved - share.abs(),
        }
    }

    /// The slice in the middle of some.
    pub fn middle(&self, slices: &Range<u32>) -> Circle {
        self.at((f64::from(slices.start) + f64::from(slices.end - 1)) / 2.0)
    }

    /// What its middle moves by through some slices.
    pub fn moves(&self, slices: &Range<u32>) -> f64 {
        let n = slices.len().saturating_sub(1) as f64;
        libm::hypot(self.slope[0], self.slope[1]) * n
    }

    /// The angle to z where voxels have this size, in degrees.
    pub fn degrees(&self, spacing: [f64; 3]) -> f64 {
        let [x, y] = [0, 1].map(|a| self.slope[a] * spacing[a]);
        libm::atan2(libm::hypot(x, y), spacing[2]).to_degrees()
    }
}

/// A line through points.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// At 0.
    start: f64,
    slope: f64,
    /// The middle of all values.
    middle: f64,
    /// The standard error of what it rises by from the first to the last point.
    error: f64,
}

impl Line {
    fn through(points: &[[f64; 2]]) -> Self {
        /// Slices that are near each other show the same pores.
        const ALONE: f64 = 3.0;
        let pairs = points.iter().enumerate();
        let pairs = pairs.flat_map(|(i, p)| points[i + 1..].iter().map(move |q| (p, q)));
        let mut slopes: Vec<f64> = pairs.map(|(p, q)| (q[1] - p[1]) / (q[0] - p[0])).collect();
        let slope = match slopes.is_empty() {
            true => 0.0,
            false => median(&mut slopes),
        };
        let mut starts: Vec<f64> = points.iter().map(|p| p[1] - slope * p[0]).collect();
        let start = median(&mut starts);
        let off = points.iter().map(|p| (p[1] - start - slope * p[0]).abs());
        let scatter = 1.4826 * median(&mut off.collect::<Vec<_>>());
        Line {
            start,
            slope,
            middle: median(&mut points.iter().map(|p| p[1]).collect::<Vec<_>>()),
            error: scatter * (12.0 * ALONE / points.len() as f64).sqrt(),
        }
    }
}
