//! What a cylinder that was found holds besides the sample: air at its rim, in its middle, a tube around it, slices of
//! something else.

use super::image::median;
use super::rim::{AirAtRim, Fall, names};
use super::rings::{Profile, Rings, SECTORS};
use crate::grid::Cylinder;
use std::f64::consts::TAU;
use std::ops::Range;

/// Of the brightness of the sample above the air, what the rim of a slice has at least.
const FULL: f64 = 0.5;
/// Of how bright most slices are, by how much one of something else is brighter or darker.
const BRIGHT: f64 = 0.35;
/// Of how rough most slices are, by how much one without pores is smoother.
const SMOOTH: f64 = 0.4;
/// Of the brightness of the sample above the air, what is in the middle of it at least.
const EMPTY: f64 = 0.15;
/// Of how rough the air is, how rough it is in a middle that is empty at most.
const ROUGH: f64 = 1.5;
/// Rings of air between a sample and a tube that is not told apart from it, at most.
const GAP: usize = 8;
/// Of the radius, an empty middle that is told.
const HOLLOW: f64 = 0.08;
/// Of the brightness of the sample above the air, a change that is told.
const CHANGE: f64 = 0.15;
/// Of what the rim spreads by, how widely a change spreads that is sharp.
const AS_RIM: f64 = 1.25;
/// By how many rings more, and one that is not quite as sharp.
const SHARP: [f64; 2] = [0.3, 0.6];
/// How widely a rim spreads that is not blurred, in rings.
const NOT_BLURRED: f64 = 1.0;
/// Rings around a circle in which pores get rarer as well, if these stay inside of the sample.
const NARROW: usize = 4;
/// Of what a blurred rim spreads by, how wide what is around a circle is at least.
const WIDE: f64 = 2.5;
/// Of how rough what is inside of it is, how rough that is at most.
const EVEN: f64 = 0.5;
/// The share of the sectors in which it is seen.
const ALL_AROUND: f64 = 0.9;
/// How far a change exceeds what it scatters by from sector to sector.
const CLEAR: f64 = 5.0;
/// Of the cylinder, air at one side that is told.
const WORTH: f64 = 0.008;
/// In how many of the stacks that are looked at it is at one side at least: pores are in fewer.
const PLACES: usize = 3;
/// Stacks of slices that are looked at for air at one side.
const STACKS: usize = 8;
/// Sectors of each.
const SIDES: usize = SECTORS / 2;

/// A sample and what is seen around its axis.
pub(super) struct Doubts {
    /// The cylinder as it is in the middle of the slices.
    pub cylinder: Cylinder,
    /// Voxels from the cylinder to the rim of the sample.
    pub to_rim: f64,
    /// How widely the rim spreads, in rings.
    pub spread: f64,
    /// Around the axis of the sample.
    pub rings: Rings,
    /// The brightness of the air.
    pub air: f64,
}

/// A part of what was looked at whose rim is empty.
struct Empty {
    /// Its place in the list.
    place: usize,
    /// Rings that are empty.
    rings: usize,
}

impl Doubts {
    /// The radius, in voxels, up to which there is air around the axis, and that of a circle at which the brightness or the
    /// share of pores changes, below a limit.
    pub fn across(&self, limit: f64) -> [Option<f64>; 2] {
        let Some(level) = self.level() else {
            return [None; 2];
        };
        let all = self.all();
        let noise = all
            .of(self.rings.all.saturating_sub(2)..self.rings.all)
            .deviation();
        // also where nothing is seen; a few walls are darker than a tube, too, but no air
        let is_empty = |r: &usize| {
            let share = self.share(&all, *r..r + 1, level);
            let is_rough = all.of(*r..r + 1).deviation() > ROUGH * noise;
            share.is_nan() || share < EMPTY && !is_rough
        };
        let hollow = (0..self.inside()).take_while(is_empty).count();
        let width = self.rings.width;
        let is_told = hollow as f64 * width >= (HOLLOW * self.cylinder.radius).max(3.0);
        let change = self.change(hollow, level);
        let change = change.map(|ring| self.before_gap(&all, ring) as f64 * width);
        [
            is_told.then_some(hollow as f64 * width),
            change.filter(|radius| *radius < limit),
        ]
    }

    /// The ring at which a sample ends within a gap of air before a ring at which something else begins; that one without a gap.
    fn before_gap(&self, all: &Profile, ring: usize) -> usize {
        let above = |r: usize| all.of(r..r + 1).mean() - self.air;
        let near = ring.saturating_sub(GAP);
        let inside = all.of(near.saturating_sub(2 * GAP)..near).mean() - self.air;
        let is_air = |r: &usize| above(*r) < FULL * inside;
        let darkest = (near..=ring).min_by(|a, b| above(*a).total_cmp(&above(*b)));
        let Some(darkest) = darkest.filter(is_air) else {
            return ring;
        };
        (near..darkest)
            .rfind(|r| !is_air(r))
            .map_or(ring, |r| r + 1)
    }

    fn all(&self) -> Profile {
        self.rings.profile(0..self.rings.slices.len(), 0..SECTORS)
    }

    /// How bright rings are, of what the sample is; NaN if nothing is seen.
    fn share(&self, profile: &Profile, rings: Range<usize>, level: f64) -> f64 {
        (profile.of(rings).mean() - self.air) / level
    }

    /// How much brighter than the air the sample is: the median of its rings, of the larger ones more; `None` if nothing
    /// is.
    fn level(&self) -> Option<f64> {
        let all = self.all();
        let above = |rings: Range<usize>| all.of(rings).mean() - self.air;
        let rings = 0..self.inside();
        let near = rings.clone().map(|r| above(r.saturating_sub(1)..r + 2));
        let top = near.filter(|v| v.is_finite()).fold(0.0, f64::max);
        let mut body: Vec<(f64, usize)> = rings
            .map(|r| (above(r..r + 1), 2 * r + 1))
            .filter(|(v, _)| *v >= 0.25 * top)
            .collect();
        body.sort_by(|a, b| a.0.total_cmp(&b.0));
        let area: usize = body.iter().map(|(_, area)| area).sum();
        let mut sum = 0;
        let middle = body.iter().find(|(_, area_of)| {
            sum += area_of;
            2 * sum >= area
        });
        middle
            .map(|(v, _)| *v)
            .filter(|v| *v > 0.0 && v.is_finite())
    }

    /// Air at one side of the rim, also where it is a notch.
    pub fn side(&self) -> Option<AirAtRim> {
        let level = self.level()?;
        let n = self.rings.slices.len();
        let stacks = STACKS.min(n);
        let stack = |place: usize| {
            let s = place / SIDES;
            s * n / stacks..(s + 1) * n / stacks
        };
        let part = |place: usize| {
            let sector = place % SIDES * SECTORS / SIDES;
            self.rings
                .profile(stack(place), sector..sector + SECTORS / SIDES)
        };
        let parts: Vec<Profile> = (0..stacks * SIDES).map(part).collect();
        let empty = self.empty(&parts, 4.5, level);
        let rings: usize = empty.iter().map(|e| e.rings).sum();
        let share = 2.0 * rings as f64 / (self.inside() * parts.len()) as f64;
        let deepest = empty.iter().map(|e| e.rings).max().unwrap_or(0);
        let depth = deepest as f64 * self.rings.width;
        let near = |side: usize| [side + SIDES - 1, side, side + 1].map(|s| s % SIDES);
        let stacks_at = |side: usize| {
            let here = empty
                .iter()
                .filter(|e| near(side).contains(&(e.place % SIDES)));
            let mut stacks: Vec<usize> = here.map(|e| e.place / SIDES).collect();
            stacks.dedup();
            stacks.len()
        };
        let most = (0..SIDES).map(stacks_at).max().unwrap_or(0);
        if share < WORTH || most < PLACES.min(stacks) || depth < 3.0 {
            return None;
        }
        let angle = |e: &Empty| ((e.place % SIDES) as f64 + 0.5) / SIDES as f64 * TAU;
        let sum = |of: fn(f64) -> f64| empty.iter().map(|e| of(angle(e))).sum::<f64>();
        let mut slices: Vec<usize> = empty.iter().flat_map(|e| stack(e.place)).collect();
        slices.sort_unstable();
        slices.dedup();
        let deepest = depth.max(self.depth(&slices, level) as f64 * self.rings.width);
        Some(AirAtRim {
            side: Some(libm::atan2(sum(libm::sin), sum(libm::cos))),
            depth,
            deepest,
            slices: self.names(&slices),
        })
    }

    /// Rings that lie inside of the cylinder.
    fn inside(&self) -> usize {
        (self.cylinder.radius / self.rings.width) as usize
    }

    /// How many rings are empty in the sector where most are, of some slices together.
    fn depth(&self, slices: &[usize], level: f64) -> usize {
        let sectors = (0..SECTORS).map(|s| self.rings.profile(slices.iter().copied(), s..s + 1));
        let depths = sectors.map(|profile| self.empty_rings(&profile, level));
        depths.max().unwrap_or(0)
    }

    /// How many of the outermost rings are empty.
    fn empty_rings(&self, profile: &Profile, level: f64) -> usize {
        let rings = (0..self.inside()).rev();
        let full = |r: &usize| self.share(profile, *r..r + 1, level) >= FULL;
        rings.take_while(|r| !full(r)).count()
    }

    /// Profiles whose outermost rings are empty, and how many are: emptier by some standard deviations than rings as wide
    /// inside of them, which have pores, too.
    fn empty(&self, profiles: &[Profile], sigmas: f64, level: f64) -> Vec<Empty> {
        let inside = self.inside();
        let wide = self.rings.count(0.02 * self.cylinder.radius).max(2);
        let share = |p: &Profile, from: usize| self.share(p, from..from + wide, level);
        let from = (inside / 2..(9 * inside / 10).saturating_sub(wide)).collect::<Vec<_>>();
        let usual = profiles
            .iter()
            .flat_map(|p| from.iter().map(move |&r| share(p, r)));
        let mut usual: Vec<f64> = usual.filter(|v| v.is_finite()).collect();
        let middle = median(&mut usual);
        let mut off: Vec<f64> = usual.iter().map(|v| (v - middle).abs()).collect();
        let least = (middle - sigmas * 1.4826 * median(&mut off)).min(FULL);
        let is_empty = |p: &Profile| share(p, inside.saturating_sub(wide)) < least;
        let found = profiles.iter().enumerate().filter(|(_, p)| is_empty(p));
        let empty = found.map(|(place, p)| Empty {
            place,
            rings: self.empty_rings(p, level),
        });
        empty.collect()
    }

    /// What the user should know of slices of something else.
    pub fn warning_of_odd(&self) -> Option<String> {
        let odd = self.odd(self.level()?);
        (!odd.is_empty()).then(|| self.text_of_odd(&odd))
    }

    /// Slices that are of another brightness inside than most are, or without the pores that those have.
    fn odd(&self, level: f64) -> Vec<usize> {
        let inner = 0..17 * self.inside() / 20;
        let of = |s: usize| self.rings.profile(s..s + 1, 0..SECTORS).of(inner.clone());
        let sums = (0..self.rings.slices.len()).map(of).collect::<Vec<_>>();
        let off = |values: Vec<f64>| {
            let middle = median(&mut values.clone());
            let away: Vec<f64> = values.iter().map(|v| v - middle).collect();
            let scatter = 1.4826 * median(&mut away.iter().map(|v| v.abs()).collect::<Vec<_>>());
            (away, middle, scatter)
        };
        let (bright, of_bright, scatter) = off(sums.iter().map(|s| s.mean() - self.air).collect());
        let (rough, of_rough, around) = off(sums.iter().map(|s| s.deviation()).collect());
        let is_odd = |s: &usize| {
            bright[*s].abs() > (BRIGHT * of_bright).max(CLEAR * scatter)
                || -rough[*s] > (SMOOTH * of_rough).max(CLEAR * around).max(0.1 * level)
        };
        let odd: Vec<usize> = (0..sums.len()).filter(is_odd).collect();
        match 2 * odd.len() < sums.len() {
            true => odd,
            false => Vec::new(),
        }
    }

    /// The ring at whose inner side the brightness changes all around, or else how rough it is: where that is largest.
    fn change(&self, hollow: usize, level: f64) -> Option<usize> {
        let slices = || 0..self.rings.slices.len();
        let sectors = (0..SECTORS).map(|s| self.rings.profile(slices(), s..s + 1));
        let steps = Steps {
            sectors: sectors.collect(),
            first: if hollow > 0 { hollow + 3 } else { 2 },
            end: ((self.cylinder.radius + self.to_rim) / self.rings.width) as usize,
            spread: self.spread,
            all: self.rings.all,
            wide: self.rings.count(HOLLOW * self.cylinder.radius).max(4),
        };
        let places = (steps.first + 3).max(self.inside() / 5)..steps.end.saturating_sub(1);
        let largest = |kind: Kind| {
            let sizes = places
                .clone()
                .filter_map(|r| Some((r, steps.size(r, kind)?)));
            let told = sizes.filter(|(r, size)| {
                let is_told = size.abs() > CHANGE * level;
                is_told && steps.is_sharp(*r, *size, kind)
            });
            told.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
                .map(|(r, _)| r)
        };
        largest(Kind::Brightness).or_else(|| largest(Kind::Roughness))
    }

    fn text_of_odd(&self, odd: &[usize]) -> String {
        let slices = &self.rings.slices;
        let n = slices.len();
        // the part without them, if they are at the ends
        let first = (0..n).find(|s| !odd.contains(s)).unwrap_or(0);
        let last = (0..n).rfind(|s| !odd.contains(s)).unwrap_or(n - 1);
        let advice = match odd.iter().all(|s| *s < first || *s > last) {
            true => format!(
                ": --crop :,:,{}:{} leaves them out",
                slices[first],
                slices[last] + 1
            ),
            false => String::new(),
        };
        format!(
            "about {} the brightness inside, or how much of it is pores, is not that of the others, as of a holder, a \
             lid or another body{advice}",
            self.names(odd)
        )
    }

    /// Some slices, by their place in the list, as people read them.
    fn names(&self, slices: &[usize]) -> String {
        let slices: Vec<u32> = slices.iter().map(|s| self.rings.slices[*s]).collect();
        names(&slices, &self.rings.slices)
    }
}

/// What changes from ring to ring.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Brightness,
    /// Its standard deviation, which pores make large.
    Roughness,
}

/// What is seen in each sector, where a change is looked for.
struct Steps {
    sectors: Vec<Profile>,
    /// The first ring that counts.
    first: usize,
    /// The ring at the rim.
    end: usize,
    /// How widely the rim spreads, in rings.
    spread: f64,
    /// All rings.
    all: usize,
    /// Rings on either side that are compared.
    wide: usize,
}

impl Steps {
    /// True if it changes as sharply as the brightness does at the rim, and not slowly as where pores get rarer. If it is not
    /// quite as sharp, or the rim is blurred, which makes these look alike, there have to be no pores around it, in a part that
    /// is wide enough to tell.
    fn is_sharp(&self, ring: usize, size: f64, kind: Kind) -> bool {
        let of = |p: &Profile, r: usize| match kind {
            Kind::Brightness => p.of(r..r + 1).mean(),
            Kind::Roughness => p.of(r..r + 1).deviation(),
        };
        // where it rises, it falls the other way round
        let sum = |r: usize| self.sectors.iter().map(|p| of(p, r)).sum::<f64>();
        let mean = |r: usize| -size.signum() * sum(r) / SECTORS as f64;
        let means: Vec<f64> = (0..self.all).map(mean).collect();
        let Some(fall) = Fall::near(&means, ring as f64, 3) else {
            return false;
        };
        let [sharp, nearly] = SHARP.map(|more| fall.spread <= AS_RIM * self.spread + more);
        let wide = self.end - ring;
        match self.spread <= NOT_BLURRED {
            true => sharp || nearly && wide > NARROW && self.is_even(ring),
            false => sharp && wide as f64 > WIDE * self.spread && self.is_even(ring),
        }
    }

    /// True if what is outside of a ring is seen to be without pores, as a tube, a can or resin is.
    fn is_even(&self, ring: usize) -> bool {
        let rough = |rings: Range<usize>| {
            let of = self.sectors.iter().map(|p| p.of(rings.clone()).deviation());
            of.sum::<f64>() / SECTORS as f64
        };
        let (inner, outer) = self.sides(ring, true);
        rough(outer) < EVEN * rough(inner)
    }

    /// The rings on either side of one that are compared.
    fn sides(&self, ring: usize, is_rough: bool) -> (Range<usize>, Range<usize>) {
        let inner = ring.saturating_sub(1 + self.wide).max(self.first)..ring - 1;
        // at the rim itself it is rough in any case
        let end = self.end.saturating_sub(1 + usize::from(is_rough));
        (inner, ring + 1..(ring + 1 + self.wide).min(end))
    }

    /// What changes at a ring from inside to outside of it; `None` unless nearly all sectors show it.
    fn size(&self, ring: usize, kind: Kind) -> Option<f64> {
        let is_rough = kind == Kind::Roughness;
        let (inner, outer) = self.sides(ring, is_rough);
        if inner.len() < 3 || outer.len() < 1 + usize::from(is_rough) {
            return None;
        }
        let of = |p: &Profile, rings: &Range<usize>| match kind {
            Kind::Brightness => p.of(rings.clone()).mean(),
            Kind::Roughness => p.of(rings.clone()).deviation(),
        };
        let mean = |rings: &Range<usize>| {
            let sum: f64 = self.sectors.iter().map(|p| of(p, rings)).sum();
            sum / SECTORS as f64
        };
        let middle = |r: &Range<usize>| (r.start + r.end) as f64 / 2.0;
        let before = inner.start.saturating_sub(2 * self.wide).max(self.first)..inner.start;
        // what changes slowly, as by hardening of the beam, goes on
        let expected = match before.len() >= 3 && kind == Kind::Brightness {
            true => {
                let slope = (mean(&inner) - mean(&before)) / (middle(&inner) - middle(&before));
                slope * (middle(&outer) - middle(&inner))
            }
            false => 0.0,
        };
        let step = |p: &Profile| of(p, &outer) - of(p, &inner);
        all_around(&self.sectors.iter().map(step).collect::<Vec<_>>(), expected)
    }
}

/// The mean of what changes in each sector, less what was expected, if nearly all show it and it is clear.
fn all_around(steps: &[f64], expected: f64) -> Option<f64> {
    let n = steps.len() as f64;
    let mean = steps.iter().sum::<f64>() / n;
    let size = mean - expected;
    let scatter = (steps.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt();
    let seen = steps
        .iter()
        .filter(|v| **v * size.signum() > 0.4 * size.abs());
    let is_seen = seen.count() as f64 >= ALL_AROUND * n;
    (is_seen && size.abs() > CLEAR * scatter / n.sqrt()).then_some(size)
}
