//! Finds the round sample in a scan: a cylinder along z that is brighter than what is around it.
//!
//! Slices from all over the volume are taken together in up to eight means, which hide pores and noise; the median of
//! these, pixel by pixel, hides what only a few slices show, as a holder or empty ones. Otsu's threshold parts the sample in
//! it from the air; its rim is where rays towards its middle first meet it, and a circle is laid through the rim by least
//! squares, without what is far off. What else is round there is told, or, where it may as well be the sample, refused. The
//! circle is then looked for in each of the means: the line through the middles shows a tilt, and slices whose brightness is
//! another show that they are not of the sample.

mod axis;
mod bodies;
mod circle;
mod image;
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
use image::{Image, median, middle, split};
use slices::{Raster, Seen};
use std::ops::Range;

/// Voxels of the smallest radius.
const SMALLEST: f64 = 8.0;
/// Pixels, as a share of what most means have, that a mean with a sample is brighter in at least.
const LEAST_SHARE: f64 = 0.25;

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
/// Memory: 60 bytes for a pixel of the mean of slices, which are 1024 along the longer side at most, and 2 MiB of samples, or a
/// row if that is more.
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
    let mut seen = Seen::read::<T>(volume, z, progress)?;
    let (raster, slices) = (seen.raster, std::mem::take(&mut seen.slices));
    let means = Means::of(seen).map_err(not_found)?;
    let bodies = means.bodies().map_err(not_found)?;
    let axis = Axis::of(&means, &bodies).map_err(not_found)?;
    drop(means);
    let extent = Extent {
        volume,
        range: z,
        axis: &axis,
        progress,
    };
    let shown = extent.find::<T>(slices)?;
    let half = shown.len().saturating_sub(1) as f64 / 2.0;
    let circle = axis.inside(f64::from(shown.start) + half, half);
    let lost = axis.radius() - circle.radius;
    if lost > axis::MOST_TILTED * axis.radius() {
        let moved = 2.0 * lost * f64::from(raster.pixel);
        return Err(not_found(format!(
            "one that is not upright: its axis moves by {moved:.1} voxels from the lowest to the highest slice"
        )));
    }
    let cylinder = cylinder(raster, &circle);
    if cylinder.radius < SMALLEST {
        let found = format!("one of a radius of {} voxels", cylinder.radius);
        return Err(not_found(found));
    }
    let tilt = axis.degrees(volume.header().placement.spacing);
    let mut warnings: Vec<String> = bodies.others.iter().map(|o| o.warning(raster)).collect();
    let inside = 2.0 * lost * f64::from(raster.pixel);
    warnings.extend(warning_of_tilt(tilt, inside));
    warnings.extend(warning_of_slices(&shown, z));
    Ok(FoundCylinder {
        cylinder,
        others: bodies
            .others
            .iter()
            .map(|other| self::cylinder(raster, &other.circle))
            .collect(),
        slices: shown,
        tilt,
        warnings,
    })
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

    /// What is round in them.
    fn bodies(&self) -> Result<Bodies, String> {
        Bodies::of(&self.all).map_err(|why| match self.is_tilted() {
            true => "one that is not upright: its axis moves from slice to slice".to_owned(),
            false => why,
        })
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
            bodies::Kind::Inside => format!(
                "there are two round things: inside of the one that was taken the brightness changes at a circle, as where a tube \
                 around a sample ends; give --roi {cylinder} for what is inside of it"
            ),
        }
    }
}
