//! What a cylinder that was found holds besides the sample: air at its rim, in its middle, a tube around it, slices of
//! something else.

use super::image::median;
use super::rings::{Profile, Rings, SECTORS};
use super::{SMALLEST, rounded};
use crate::grid::Cylinder;
use std::f64::consts::TAU;
use std::ops::Range;

/// Of the brightness of the sample above the air, what the rim of a slice has at least.
const FULL: f64 = 0.5;
/// Of how rough most slices are, by how much one without pores is smoother.
const SMOOTH: f64 = 0.4;
/// Of the brightness of the sample above the air, what is in the middle of it at least.
const EMPTY: f64 = 0.15;
/// Of the radius, an empty middle that is told.
const HOLLOW: f64 = 0.08;
/// Of the brightness of the sample above the air, a change that is told.
const CHANGE: f64 = 0.15;
/// The share of the sectors in which it is seen.
const ALL_AROUND: f64 = 0.9;
/// How far a change exceeds what it scatters by from sector to sector.
const CLEAR: f64 = 5.0;
/// Of the cylinder, air at one side that is told.
const WORTH: f64 = 0.008;
/// In how many of the places that are looked at it is at least: single pores are in fewer.
const PLACES: usize = 3;
/// Stacks of slices that are looked at for air at one side.
const STACKS: usize = 8;
/// Sectors of each.
const SIDES: usize = SECTORS / 2;

/// A cylinder and what is seen around its axis.
pub(super) struct Doubts {
    pub cylinder: Cylinder,
    /// Voxels from the cylinder to the rim of the sample.
    pub to_rim: f64,
    /// Around the axis of the cylinder.
    pub rings: Rings,
    /// The brightness of the air.
    pub air: f64,
}

/// Where there is air at the rim.
struct Rim {
    /// The slices, by their place in the list.
    slices: Vec<usize>,
    /// The middle of the side where it is; all around without.
    side: Option<f64>,
    /// How deep it reaches, in voxels.
    depth: f64,
}

/// A part of what was looked at whose rim is empty.
struct Empty {
    /// Its place in the list.
    place: usize,
    /// Rings that are empty.
    rings: usize,
}

impl Doubts {
    /// What the user should know of air at the rim and slices of something else; and the radius from which on nothing else
    /// can be told.
    pub fn along(&self) -> (Vec<String>, f64) {
        let Some(level) = self.level() else {
            return (Vec::new(), f64::INFINITY);
        };
        let rim = self.rim(level);
        let clear = rim.as_ref().map_or(f64::INFINITY, |rim| {
            self.cylinder.radius - rim.depth - 2.0 * self.rings.width
        });
        let told = rim.map(|rim| self.warning_of_rim(&rim)).into_iter();
        let odd = self.odd(level);
        let odd = (!odd.is_empty()).then(|| self.warning_of_odd(&odd));
        (told.chain(odd).collect(), clear)
    }

    /// The radius, in voxels, up to which there is air around the axis, and that of a circle at which the brightness or the
    /// share of pores changes, below a limit.
    pub fn across(&self, limit: f64) -> [Option<f64>; 2] {
        let Some(level) = self.level() else {
            return [None; 2];
        };
        let all = self.all();
        // also where nothing is seen
        let is_empty = |r: &usize| {
            let share = self.share(&all, *r..r + 1, level);
            share.is_nan() || share < EMPTY
        };
        let hollow = (0..self.rings.inside).take_while(is_empty).count();
        let width = self.rings.width;
        let is_told = hollow as f64 * width >= (HOLLOW * self.cylinder.radius).max(3.0);
        let change = self.change(hollow, level).map(|ring| ring as f64 * width);
        [
            is_told.then_some(hollow as f64 * width),
            change.filter(|radius| *radius < limit),
        ]
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
        let rings = 0..self.rings.inside;
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

    /// Air at the rim, all around in some slices or at one side.
    fn rim(&self, level: f64) -> Option<Rim> {
        let slices = (0..self.rings.slices.len()).map(|s| self.rings.profile(s..s + 1, 0..SECTORS));
        let empty = self.empty(&slices.collect::<Vec<_>>(), 3.5, level);
        let slices: Vec<usize> = empty.iter().map(|e| e.place).collect();
        match empty.is_empty() {
            true => self.side(level),
            false => Some(Rim {
                depth: deepest(&empty).max(self.depth(&slices, level)) as f64 * self.rings.width,
                slices,
                side: None,
            }),
        }
    }

    /// Air at one side of the rim.
    fn side(&self, level: f64) -> Option<Rim> {
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
        let share = 2.0 * rings as f64 / (self.rings.inside * parts.len()) as f64;
        let depth = deepest(&empty) as f64 * self.rings.width;
        if share < WORTH || empty.len() < PLACES || depth < 3.0 {
            return None;
        }
        let angle = |e: &Empty| ((e.place % SIDES) as f64 + 0.5) / SIDES as f64 * TAU;
        let sum = |of: fn(f64) -> f64| empty.iter().map(|e| of(angle(e))).sum::<f64>();
        let mut slices: Vec<usize> = empty.iter().flat_map(|e| stack(e.place)).collect();
        slices.sort_unstable();
        slices.dedup();
        Some(Rim {
            side: Some(libm::atan2(sum(libm::sin), sum(libm::cos))),
            depth: depth.max(self.depth(&slices, level) as f64 * self.rings.width),
            slices,
        })
    }

    /// How many rings are empty in the sector where most are, of some slices together.
    fn depth(&self, slices: &[usize], level: f64) -> usize {
        let sectors = (0..SECTORS).map(|s| self.rings.profile(slices.iter().copied(), s..s + 1));
        let depths = sectors.map(|profile| self.empty_rings(&profile, level));
        depths.max().unwrap_or(0)
    }

    /// How many of the outermost rings are empty.
    fn empty_rings(&self, profile: &Profile, level: f64) -> usize {
        let rings = (0..self.rings.inside).rev();
        let full = |r: &usize| self.share(profile, *r..r + 1, level) >= FULL;
        rings.take_while(|r| !full(r)).count()
    }

    /// Profiles whose outermost rings are empty, and how many are: emptier by some standard deviations than rings as wide
    /// inside of them, which have pores, too.
    fn empty(&self, profiles: &[Profile], sigmas: f64, level: f64) -> Vec<Empty> {
        let inside = self.rings.inside;
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

    /// Slices that are of another brightness inside than most are, or without the pores that those have.
    fn odd(&self, level: f64) -> Vec<usize> {
        let inner = 0..17 * self.rings.inside / 20;
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
            bright[*s].abs() > (0.2 * of_bright).max(CLEAR * scatter)
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
            wide: self.rings.count(HOLLOW * self.cylinder.radius).max(4),
        };
        let places = (steps.first + 3).max(self.rings.inside / 5)..steps.end.saturating_sub(1);
        let largest = |kind: Kind| {
            let sizes = places
                .clone()
                .filter_map(|r| Some((r, steps.size(r, kind)?.abs())));
            let told = sizes.filter(|(_, size)| *size > CHANGE * level);
            told.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(r, _)| r)
        };
        largest(Kind::Brightness).or_else(|| largest(Kind::Roughness))
    }

    fn warning_of_rim(&self, rim: &Rim) -> String {
        let Cylinder {
            centre: [x, y],
            radius,
        } = self.cylinder;
        let side = match rim.side {
            None => "all around".to_owned(),
            Some(angle) => {
                let (sin, cos) = libm::sincos(angle);
                let [x, y] = [x + radius * cos, y + radius * sin].map(f64::round);
                format!("at the side of x {x}, y {y}")
            }
        };
        let inside = Cylinder {
            centre: [x, y],
            radius: rounded(radius - rim.depth - self.rings.width),
        };
        let advice = match inside.radius >= (FULL * radius).max(SMALLEST) {
            true => format!("--roi {inside} ends inside of the sample in all slices"),
            false => "--roi mask:FILE of the sample, or --crop, leaves it out".to_owned(),
        };
        format!(
            "the cylinder that was taken holds air beside the sample, which counts as a pore: in slices {} its outermost {} \
             voxels are empty {side}; {advice}",
            self.names(&rim.slices),
            rim.depth.round()
        )
    }

    fn warning_of_odd(&self, odd: &[usize]) -> String {
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
            "about slices {} the brightness inside, or how much of it is pores, is not that of the others, as of a holder, a \
             lid or another body{advice}",
            self.names(odd)
        )
    }

    /// The numbers of some slices, those that follow each other as a range.
    fn names(&self, slices: &[usize]) -> String {
        let runs = slices.chunk_by(|a, b| a + 1 == *b);
        let run = |run: &[usize]| match [run[0], run[run.len() - 1]].map(|s| self.rings.slices[s]) {
            [a, b] if a == b => a.to_string(),
            [a, b] => format!("{a} to {b}"),
        };
        runs.map(run).collect::<Vec<_>>().join(" and ")
    }
}

/// How many rings are empty at most.
fn deepest(empty: &[Empty]) -> usize {
    empty.iter().map(|e| e.rings).max().unwrap_or(0)
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
    /// Rings on either side that are compared.
    wide: usize,
}

impl Steps {
    /// What changes at a ring from inside to outside of it; `None` unless nearly all sectors show it.
    fn size(&self, ring: usize, kind: Kind) -> Option<f64> {
        let is_rough = usize::from(kind == Kind::Roughness);
        let inner = ring.saturating_sub(1 + self.wide).max(self.first)..ring - 1;
        // at the rim itself it is rough in any case
        let end = self.end.saturating_sub(1 + is_rough);
        let outer = ring + 1..(ring + 1 + self.wide).min(end);
        if inner.len() < 3 || outer.len() < 1 + is_rough {
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
