//! Finds the round sample in a scan: a cylinder along z that is brighter than what is around it.
//!
//! Slices from all over the volume are taken together in up to eight means, which hide pores and noise; the median of
//! these, pixel by pixel, hides what only a few slices show, as a holder or empty ones. Otsu's threshold parts the sample in
//! it from the air; its rim is where rays towards its middle first meet it, and a circle is laid through the rim by least
//! squares, without what is far off. What else is round there is told, or, where it may as well be the sample, refused. The
//! circle is then looked for in each of the means: the line through the middles shows a tilt, and slices whose brightness is
//! another show that they are not of the sample. At last the cylinder is looked at from its axis, in rings and sectors of some
//! slices: air at its rim or in its middle, a circle at which the brightness changes and slices of something else are told.

mod axis;
mod bodies;
mod circle;
mod doubts;
mod image;
mod rings;
mod slices;
#[cfg(test)]
mod tests;

use crate::error::{Error, Result};
use crate::grid::{Cylinder, Voxel, with_voxel_type};
use crate::progress::Progress;
use crate::volume::Volume;
use axis::{Axis, Extent};
use bodies::{Bodies, Other};
use circle::{Circle, NoCircle};
use doubts::Doubts;
use image::{Image, median, middle, split, upper};
use rings::Rings;
use slices::{Raster, Seen};
use std::ops::Range;

/// Voxels of the smallest radius.
const SMALLEST: f64 = 8.0;
/// Pixels, as a share of what most means have, that a mean with a sample is brighter in at least.
const LEAST_SHARE: f64 = 0.25;

/// The share of the variance between two classes that noise alone has, 0.64, and no more.
const ONE_LEVEL: f64 = 0.7;

/// The round sample of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCylinder {
    /// It lies inside of the sample: its radius is a voxel less than that of the rim, or a pixel where means of slices are
    /// coarser, and less by what a tilt takes.
    pub cylinder: Cylinder,
    /// Other cylinders that might be meant.
    pub others: Vec<Cylinder>,
    /// The slices that show it, of those that were searched.
    pub slices: Range<u32>,
    /// Of its axis to z, in degrees; 0 below what can be told.
    pub tilt: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// The cylinder that a scan of a round sample in air shows in a range of its slices.
///
/// Memory: 60 bytes for a pixel of the mean of slices, which are 1024 along the longer side at most, 5 MiB for what is seen
/// around the axis, and 2 MiB of samples, or a row if that is more.
///
/// # Errors
/// The volume's; [`Error::Usage`] that says why there is none, or which may be meant; [`Error::Interrupted`].
pub fn find_cylinder(
    volume: &dyn Volume,
    z: Range<u32>,
    progress: &dyn Progress,
) -> Result<FoundCylinder> {
    with_voxel_type!(volume.header().dtype, T => find::<T>(volume, &z, progress))
}

fn find<T: Voxel>(
    volume: &dyn Volume,
    z: &Range<u32>,
    progress: &dyn Progress,
) -> Result<FoundCylinder> {
    let look = |range: &Range<u32>| Seen::read::<T>(volume, range, progress);
    let seen = look(z)?;
    let few = seen.few(z);
    let found = match (Found::of(seen), few) {
        // means of few slices with the sample and many without show neither
        (Err(why), Some(few)) => Found::of(look(&few)?).map_err(|_| why),
        (found, _) => found,
    };
    let found = found.map_err(not_found)?;
    let shown = found.extent::<T>(volume, z, progress)?;
    let circle = found.inside(&shown);
    let Found {
        raster,
        ref bodies,
        ref axis,
        ..
    } = found;
    let lost = axis.radius() - circle.radius;
    if lost > axis::MOST_TILTED * axis.radius() {
        let moved = 2.0 * lost * f64::from(raster.pixel);
        let why = format!(
            "one that is not upright: its axis moves by {moved:.1} voxels from the lowest to the highest slice"
        );
        return Err(not_found(why));
    }
    let cylinder = cylinder(raster, &circle);
    if cylinder.radius < SMALLEST {
        let why = format!("one of a radius of {} voxels", cylinder.radius);
        return Err(not_found(why));
    }
    let tilt = axis.degrees(volume.header().placement.spacing);
    let mut warnings: Vec<String> = bodies.others.iter().map(|o| o.warning(raster)).collect();
    let others = bodies.others.iter();
    let mut others: Vec<Cylinder> = others.map(|o| self::cylinder(raster, &o.circle)).collect();
    let inside = 2.0 * lost * f64::from(raster.pixel);
    warnings.extend(warning_of_tilt(tilt, inside));
    warnings.extend(warning_of_slices(&shown, z));
    let more = found.doubts::<T>(volume, &cylinder, [z, &shown], progress)?;
    warnings.extend(more.warnings);
    others.extend(more.other);
    Ok(FoundCylinder {
        cylinder,
        others,
        slices: shown,
        tilt,
        warnings,
    })
}

/// The sample as means of slices show it.
struct Found {
    raster: Raster,
    bodies: Bodies,
    /// Pores open its rim so far that it is not round in most slices.
    is_open: bool,
    axis: Axis,
    /// The brightness of the air around it; NaN if none is seen.
    air: f64,
    /// The slices that were read.
    slices: Vec<slices::Coarse>,
}

/// What else is to be known of it.
struct More {
    warnings: Vec<String>,
    other: Option<Cylinder>,
}

impl Found {
    /// Else says what was found instead.
    fn of(mut seen: Seen) -> Result<Self, String> {
        let (raster, slices) = (seen.raster, std::mem::take(&mut seen.slices));
        let means = Means::of(seen)?;
        let (bodies, is_open) = means.bodies()?;
        let axis = Axis::of(&means, &bodies)?;
        Ok(Found {
            raster,
            air: bodies.air(&means.all),
            bodies,
            is_open,
            axis,
            slices,
        })
    }

    /// The slices of a range that show it.
    fn extent<T: Voxel>(
        &self,
        volume: &dyn Volume,
        range: &Range<u32>,
        progress: &dyn Progress,
    ) -> Result<Range<u32>> {
        let extent = Extent {
            volume,
            range,
            axis: &self.axis,
            progress,
        };
        extent.find::<T>(&self.slices)
    }

    /// The upright circle that is inside of it in some slices.
    fn inside(&self, shown: &Range<u32>) -> Circle {
        let half = shown.len().saturating_sub(1) as f64 / 2.0;
        self.axis.inside(f64::from(shown.start) + half, half)
    }

    /// What the cylinder holds besides the sample, in the slices that show it, of those that were searched.
    fn doubts<T: Voxel>(
        &self,
        volume: &dyn Volume,
        cylinder: &Cylinder,
        [all, shown]: [&Range<u32>; 2],
        progress: &dyn Progress,
    ) -> Result<More> {
        // the last slices before a holder show some of it
        let start = shown.start + 2 * u32::from(shown.start > all.start);
        let end = shown.end - 2 * u32::from(shown.end < all.end);
        let range = if start < end {
            start..end
        } else {
            shown.clone()
        };
        let pixel = f64::from(self.raster.pixel);
        let rings = |radius: f64, middle: &dyn Fn(u32) -> [f64; 2]| {
            Rings::read::<T>(volume, &range, radius, middle, progress)
        };
        let doubts = |rings, cylinder: &Cylinder| Doubts {
            cylinder: *cylinder,
            to_rim: pixel,
            rings,
            air: self.air,
        };
        let upright = rings(cylinder.radius, &|_| cylinder.centre)?;
        let upright = doubts(upright, cylinder);
        let (mut warnings, clear) = upright.along();
        if self.is_open && clear.is_finite() {
            return Err(not_found(why_not(NoCircle::NotRound).to_owned()));
        }
        let [hollow, inner] = match self.axis.is_tilted() {
            false => upright.across(clear),
            true => {
                let radius = (self.axis.radius() - 1.0) * pixel;
                let middle = |z: u32| self.axis.at(f64::from(z)).map(|v| self.raster.voxel(v));
                let along = rings(radius, &middle)?;
                let turned = Cylinder {
                    radius,
                    ..*cylinder
                };
                doubts(along, &turned).across(clear)
            }
        };
        warnings.extend(hollow.map(warning_of_hollow));
        let known = self.bodies.others.iter();
        let inside = known.filter(|other| other.kind == bodies::Kind::Inside);
        let is_known = inside.count() > 0;
        let other = inner
            .filter(|_| !is_known && hollow.is_none())
            .map(|radius| Cylinder {
                centre: cylinder.centre,
                radius: rounded(radius - pixel),
            });
        warnings.extend(other.as_ref().map(warning_of_inside));
        Ok(More { warnings, other })
    }
}

/// That there is air in the middle of it, up to this radius.
fn warning_of_hollow(radius: f64) -> String {
    format!(
        "around its axis the cylinder that was taken is empty, up to a radius of {radius} voxels, as an empty tube or a sample \
         with a bore is: that air counts as a pore; --roi mask:FILE of what is to count leaves it out"
    )
}

/// That something in it ends at a circle.
fn warning_of_inside(inside: &Cylinder) -> String {
    format!(
        "there are two round things: inside of the one that was taken the brightness, or how much of it is pores, changes at a \
         circle, as where a tube, a can, resin or a skin around a sample begins; give --roi {inside} for what is inside of it"
    )
}

/// That the sample is not upright, by so many degrees and voxels, if it is not.
fn warning_of_tilt(tilt: f64, inside: f64) -> Option<String> {
    (tilt > 0.0).then(|| {
        format!(
            "the sample is tilted by {tilt:.1} degrees: the cylinder of --roi, which is upright, ends up to {inside:.1} voxels \
             inside of its rim"
        )
    })
}

/// That not all slices show the sample, if they do not.
fn warning_of_slices(shown: &Range<u32>, all: &Range<u32>) -> Option<String> {
    (shown != all).then(|| {
        let (first, last) = (shown.start, shown.end - 1);
        format!(
            "only slices {first} to {last} of {} to {} show the round sample, the others air, a holder or something else; the \
             cylinder of --roi goes through all of them: --crop :,:,{first}:{} leaves them out",
            all.start,
            all.end - 1,
            shown.end
        )
    })
}

fn not_found(found: String) -> Error {
    let expected = "a round sample along z, brighter than the air around it";
    Error::usage("--roi cylinder", found, expected)
        .with_hint("give it as --roi cylinder:CX,CY,R in voxels, or as --roi mask:FILE")
}

/// A circle whose rim is that of a sample, as the cylinder that ends inside of it.
fn cylinder(raster: Raster, circle: &Circle) -> Cylinder {
    Cylinder {
        centre: circle.centre.map(|v| rounded(raster.voxel(v))),
        radius: rounded((circle.radius - 1.0) * f64::from(raster.pixel)),
    }
}

/// A hundredth of a voxel is more than can be seen.
fn rounded(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

/// Means of slices as pictures.
struct Means {
    /// Those that show something, with the number of their middle slice.
    groups: Vec<(f64, Image)>,
    /// What most of these show.
    all: Image,
}

impl Means {
    /// Leaves out means that show far less than most of them.
    fn of(seen: Seen) -> Result<Self, String> {
        let groups = image::of_groups(seen.groups, seen.raster);
        let pixels = groups.iter().flat_map(|(_, image)| &image.pixels);
        let (threshold, _) = split(pixels.map(|v| f64::from(*v))).ok_or("slices of one value")?;
        let bright = |image: &Image| {
            let bright = image.pixels.iter().filter(|v| f64::from(**v) >= threshold);
            bright.count() as f64
        };
        let shares: Vec<f64> = groups.iter().map(|(_, image)| bright(image)).collect();
        let mut some: Vec<f64> = shares.iter().copied().filter(|n| *n > 0.0).collect();
        let least = LEAST_SHARE * median(&mut some);
        let shown = groups.into_iter().zip(shares).filter(|(_, n)| *n >= least);
        let groups: Vec<(f64, Image)> = shown.map(|(group, _)| group).collect();
        let images: Vec<&Image> = groups.iter().map(|(_, image)| image).collect();
        let all = middle(&images);
        Ok(Means { groups, all })
    }

    /// What is round in them, and whether it is so only where pores do not open its rim.
    fn bodies(&self) -> Result<(Bodies, bool), String> {
        let why = match Bodies::of(&self.all) {
            Ok(bodies) => return Ok((bodies, false)),
            Err(why) => why,
        };
        if self.is_tilted() {
            return Err("one that is not upright: its axis moves from slice to slice".to_owned());
        }
        let images: Vec<&Image> = self.groups.iter().map(|(_, image)| image).collect();
        let closed = Bodies::of(&upper(&images));
        closed
            .map(|bodies| (bodies, true))
            .map_err(|_| self.nothing().unwrap_or(why))
    }

    /// What at least a quarter of the lower means show, and of the upper ones, with the number of their middle slice.
    fn halves(&self) -> Vec<(f64, Image)> {
        let half = self.groups.len().div_ceil(2);
        let of = |groups: &[(f64, Image)]| {
            let images: Vec<&Image> = groups.iter().map(|(_, image)| image).collect();
            let sum: f64 = groups.iter().map(|(z, _)| z).sum();
            (sum / groups.len() as f64, upper(&images))
        };
        self.groups.chunks(half).map(of).collect()
    }

    /// Why there can be no sample: nothing stands out, or what does is darker than its surroundings.
    fn nothing(&self) -> Option<String> {
        let values = self.all.pixels.iter().map(|v| f64::from(*v));
        if split(values).is_some_and(|(_, share)| share < ONE_LEVEL) {
            let none = "nothing that is brighter than the rest in those slices that were looked at (of a sample in few slices: \
                        give them, as --crop :,:,Z0:Z1)";
            return Some(none.to_owned());
        }
        let pixels = self.all.pixels.iter().map(|v| -v).collect();
        let raster = self.all.raster;
        let dark = Bodies::of(&Image { raster, pixels }).ok()?;
        let found = cylinder(raster, &dark.sample);
        Some(format!(
            "something round that is darker than what is around it, {found}: if that is the sample, --invert makes it bright"
        ))
    }

    /// True if most means show a circle each, but not at one place.
    fn is_tilted(&self) -> bool {
        let circles = self.groups.iter();
        let circles = circles.filter_map(|(_, image)| Bodies::of(image).ok());
        let circles: Vec<Circle> = circles.map(|bodies| bodies.sample).collect();
        let far = |a: &Circle, b: &Circle| circle::distance(a.centre, b.centre) > a.slack();
        2 * circles.len() > self.groups.len()
            && circles.iter().any(|a| circles.iter().any(|b| far(a, b)))
    }
}

/// What a part is that is no circle.
fn why_not(no: NoCircle) -> &'static str {
    match no {
        NoCircle::CutOff => "a sample that fills the slices, or is cut off by their edges",
        NoCircle::NotRound => "a sample that is not round",
    }
}

impl Other {
    /// What the user should know of it.
    fn warning(&self, raster: Raster) -> String {
        let cylinder = cylinder(raster, &self.circle);
        match self.kind {
            bodies::Kind::Tube => format!(
                "there are two round things: the sample, and a tube around it, {cylinder}; the tube and what is between are not \
                 in the region: give --roi {cylinder} for all of it"
            ),
            bodies::Kind::Beside => format!(
                "there are two round things: the larger one was taken; give --roi {cylinder} for the other"
            ),
            bodies::Kind::Inside => warning_of_inside(&cylinder),
        }
    }
}
