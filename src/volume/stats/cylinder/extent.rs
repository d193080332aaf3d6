//! The slices that show a sample, and what the others show.

use super::axis::{Axis, Seen, Slice};
use super::circle::{DIRECTIONS, direction};
use super::image::median;
use crate::error::Result;
use crate::grid::Voxel;
use crate::progress::Progress;
use crate::volume::Volume;
use std::ops::Range;

/// How far beyond the rim is still the rim, as a share of the radius.
pub(super) const RIM: f64 = 0.05;
/// Up to where it is looked at what is around the sample, as a share of the radius.
const AROUND: f64 = 1.15;
/// Of what is around the sample, the share that is bright at least, above what usually is, where something is wider.
const WIDER: f64 = 0.4;
/// Of the radius of the sample, that of something that is narrower.
const NARROW: f64 = 0.5;
/// Of what is usually bright inside, what is in slices of the sample at least.
const FULL: f64 = 0.2;

/// What a slice shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shows {
    Sample,
    Air,
    /// Air in its place, and something else somewhere.
    Elsewhere,
    Narrower,
    Wider,
    /// Something far brighter than the sample.
    Brighter,
    /// One value.
    Blank,
}

/// Where a sample is looked for along z.
pub(super) struct Extent<'a> {
    pub volume: &'a dyn Volume,
    pub range: &'a Range<u32>,
    pub seen: &'a Seen,
    pub axis: &'a Axis,
    pub threshold: f64,
    /// The radius up to which there is nothing else.
    pub reach: f64,
    pub progress: &'a dyn Progress,
}

/// The slices that show a sample, and what those show that were seen before and after them.
#[derive(Debug, Clone)]
pub(super) struct Shown {
    pub slices: Range<u32>,
    pub before: Vec<Shows>,
    pub after: Vec<Shows>,
}

/// The shares that are bright of two parts of a slice, 0 to 1; NaN of none.
#[derive(Debug, Clone, Copy)]
struct Shares {
    inside: f64,
    around: f64,
}

impl Extent<'_> {
    /// The slices that show the sample: the longest stretch of those that were seen, and up to where it ends if single
    /// slices can be read.
    ///
    /// # Errors
    /// The volume's; [`crate::Error::Interrupted`].
    pub fn find<T: Voxel>(&self) -> Result<Shown> {
        let slices = &self.seen.slices;
        let shares: Vec<Shares> = self.seen.alike().map(|s| self.shares(s)).collect();
        let inside = shares.iter().map(|s| s.inside).filter(|v| *v > 0.05);
        let around = shares.iter().map(|s| s.around).filter(|v| v.is_finite());
        let usual = Shares {
            inside: median(&mut inside.collect::<Vec<_>>()),
            // none is seen in slices that the sample fills
            around: median(&mut around.collect::<Vec<_>>()).max(0.0),
        };
        let shows: Vec<Shows> = slices.iter().map(|s| self.shows(s, usual)).collect();
        let Some(longest) = longest(&shows) else {
            return Ok(Shown {
                slices: self.range.clone(),
                before: Vec::new(),
                after: Vec::new(),
            });
        };
        let (first, last) = (slices[longest.start].z, slices[longest.end - 1].z);
        let of = |z: u32| {
            let slice = self.seen.one_more::<T>(self.volume, z, self.progress)?;
            Ok(slice.map_or(Shows::Blank, |slice| self.shows(&slice, usual)))
        };
        let before = longest.start.checked_sub(1);
        let before = before.map(|i| (slices[i].z, shows[i]));
        let after = slices.get(longest.end);
        let after = after.map(|slice| (slice.z, shows[longest.end]));
        let (start, before) = self.end(first, before, self.range.start, &of)?;
        let (end, after) = self.end(last, after, self.range.end - 1, &of)?;
        let also = |shown: Shows, others: &[Shows]| [&[shown], others].concat();
        Ok(Shown {
            slices: start..end + 1,
            before: also(before, &shows[..longest.start]),
            after: also(after, &shows[longest.end..]),
        })
    }

    /// The last slice with the sample from one that has it towards one that is known not to, or else to the end of the
    /// range: by halves. And what the next one shows.
    fn end(
        &self,
        mut with: u32,
        without: Option<(u32, Shows)>,
        end: u32,
        of: &impl Fn(u32) -> Result<Shows>,
    ) -> Result<(u32, Shows)> {
        let can_read = self.volume.random_access();
        let (mut without, mut shows) = match without {
            Some(without) => without,
            None if with == end || !can_read => return Ok((end, Shows::Air)),
            None => match of(end)? {
                Shows::Sample => return Ok((end, Shows::Air)),
                other => (end, other),
            },
        };
        while with.abs_diff(without) > 1 && can_read {
            let half = with.midpoint(without);
            match of(half)? {
                Shows::Sample => with = half,
                other => (without, shows) = (half, other),
            }
        }
        Ok((with, shows))
    }

    /// The radius up to which a slice shows the sample alone.
    fn rim(&self, radius: f64) -> f64 {
        let pixel = f64::from(self.seen.raster.pixel);
        (radius + (RIM * radius).max(pixel)).min(self.reach)
    }

    fn shares(&self, slice: &Slice) -> Shares {
        let circle = self.axis.at(slice.z.into());
        let pixel = f64::from(self.seen.raster.pixel);
        let around = self.rim(circle.radius)..self.reach.min(AROUND * circle.radius + 2.0 * pixel);
        let inner = (0.85 * circle.radius).max(pixel);
        let (mut of_inside, mut of_around) = ((0.0, 0.0), (0.0, 0.0));
        for (i, v) in slice.image.pixels.iter().enumerate() {
            let way = circle.off(slice.image.place(i)) + circle.radius;
            let sum = match way {
                _ if way <= inner => &mut of_inside,
                _ if around.contains(&way) => &mut of_around,
                _ => continue,
            };
            let is_bright = f64::from(u8::from(f64::from(*v) >= self.threshold));
            *sum = (sum.0 + is_bright, sum.1 + 1.0);
        }
        Shares {
            inside: of_inside.0 / of_inside.1,
            around: of_around.0 / of_around.1,
        }
    }

    fn shows(&self, slice: &Slice, usual: Shares) -> Shows {
        let shares = self.shares(slice);
        if shares.around > WIDER + usual.around.min(1.0 - WIDER) {
            return Shows::Wider;
        }
        if self.seen.is_far_brighter(slice) {
            return Shows::Brighter;
        }
        let circle = self.axis.at(slice.z.into());
        let rim = self.rim(circle.radius) - circle.radius;
        let empty = || match slice.outline(self.threshold, |_| true) {
            Some(_) => Shows::Elsewhere,
            None => Shows::Air,
        };
        let Some(outline) = slice.outline(self.threshold, |at| circle.off(at) <= rim) else {
            return empty();
        };
        let reach = |i: usize| outline.reach[i] - circle.reach(direction(i)) + circle.radius;
        let reach = median(&mut (0..DIRECTIONS).map(reach).collect::<Vec<_>>());
        match shares.inside {
            inside if inside < FULL * usual.inside => empty(),
            _ if reach < NARROW * circle.radius => Shows::Narrower,
            _ => Shows::Sample,
        }
    }
}

/// The longest stretch of those that show the sample.
fn longest(shows: &[Shows]) -> Option<Range<usize>> {
    let mut best: Option<Range<usize>> = None;
    let mut start = 0;
    for stretch in shows.chunk_by(|a, b| (*a == Shows::Sample) == (*b == Shows::Sample)) {
        let range = start..start + stretch.len();
        start = range.end;
        let is_longer = best.as_ref().is_none_or(|best| range.len() > best.len());
        if stretch[0] == Shows::Sample && is_longer {
            best = Some(range);
        }
    }
    best
}
