//! Finds the round sample in a scan: a cylinder along z that is brighter than what is around it.
//!
//! Up to 32 slices are looked at. Of each, what is bright is taken by its outline: how far it reaches in each of 64
//! directions, which pores that are open to the air hardly change. The outlines lie on lines from slice to slice as the
//! sample does, also where it is tilted or tapered; the lines on which most slices agree are taken, so that a few with a
//! holder or air do not count; slices of one value never do, and those that are far brighter than most are left out first. Slices that agree are moved upon each other, and what a quarter of them show is one picture
//! with closed pores, in which round bodies are told apart: the sample, a tube around it, another sample, where none is
//! taken. The sample's own outlines then give its axis; the middle of the steepest fall of the brightness around that, its
//! radius. Each slice is compared with it: something wider, air, a flat side are told. At last the sample is looked at from
//! its axis, in rings and sectors: air in its middle, a circle at which the brightness changes and slices of something else.

mod axis;
mod bodies;
mod circle;
mod doubts;
mod extent;
mod image;
mod rim;
mod rings;
mod slices;
#[cfg(test)]
mod tests;
mod warnings;

use crate::error::{Error, Result};
use crate::grid::{Cylinder, Voxel, with_voxel_type};
use crate::progress::Progress;
use crate::volume::Volume;
use axis::{Axis, OfSlice, Seen, Slice, of_one_body};
use bodies::{Bodies, Other};
use circle::{Circle, NoCircle};
use doubts::Doubts;
use extent::{Extent, Shown};
use image::{Hidden, Image, middle, split, upper};
use rim::{AtRim, Rim};
use rings::Rings;
use slices::{Moved, Raster, means};
use std::ops::Range;

/// Voxels of the smallest radius.
const SMALLEST: f64 = 8.0;
/// Of the slices that show anything, those that have to show one body.
const MOST: f64 = 0.3;

/// The shares of the slices that are compared with far brighter ones: of a lattice, few slices show more than single struts.
const SHARES: [f64; 2] = [0.5, 0.85];

/// The share of the variance between two classes that noise alone has, 0.64, and no more.
const ONE_LEVEL: f64 = 0.7;

/// The round sample of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCylinder {
    /// It lies inside of the sample: its radius is a voxel less than that of the rim, or a pixel where means of slices are
    /// coarser, and less by what a blur, a tilt or a taper takes.
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
/// Memory: 80 bytes for a pixel of the mean of slices, which are 1024 along the longer side at most, 5 MiB for what is seen
/// around the axis, as much for slices, and 2 MiB of samples, or a row if that is more.
///
/// # Errors
/// The volume's; [`Error::Usage`] that says why there is none, or which may be meant; [`Error::Interrupted`].
pub fn find_cylinder(
    volume: &dyn Volume,
    z: Range<u32>,
    progress: &dyn Progress,
) -> Result<FoundCylinder> {
    let found = with_voxel_type!(volume.header().dtype, T => find::<T>(volume, &z, progress));
    let Some(uneven) = warnings::of_uneven(volume.header().placement.spacing) else {
        return found;
    };
    match found {
        Ok(mut found) => {
            found.warnings.push(uneven);
            Ok(found)
        }
        Err(why @ Error::Usage { .. }) => Err(why.with_hint(uneven)),
        Err(why) => Err(why),
    }
}

fn find<T: Voxel>(
    volume: &dyn Volume,
    z: &Range<u32>,
    progress: &dyn Progress,
) -> Result<FoundCylinder> {
    let seen = Seen::read::<T>(volume, z, progress)?;
    let seen = seen.ok_or_else(|| not_found("slices of one value"))?;
    let few = seen.few(z);
    let seen = match &few {
        Some(few) if seen.is_mostly_blank() => {
            Seen::read::<T>(volume, few, progress)?.unwrap_or(seen)
        }
        _ => seen,
    };
    let scan = Scan {
        volume,
        range: z,
        progress,
    };
    for seen in SHARES.iter().filter_map(|share| seen.of_most(*share)) {
        match scan.sample::<T>(seen) {
            Ok(found) if found.seen.is_bright(&found.axis) => return scan.cylinder::<T>(&found),
            Ok(_) | Err(Error::Usage { .. }) => {}
            Err(why) => return Err(why),
        }
    }
    let found = match (scan.sample::<T>(seen), few) {
        // of few slices with the sample and many without it more are looked at
        (Err(why @ Error::Usage { .. }), Some(few)) => {
            match Seen::read::<T>(volume, &few, progress)? {
                Some(seen) => scan.sample::<T>(seen).map_err(|_| why)?,
                None => return Err(why),
            }
        }
        (found, _) => found?,
    };
    scan.cylinder::<T>(&found)
}

/// What is searched.
struct Scan<'a> {
    volume: &'a dyn Volume,
    range: &'a Range<u32>,
    progress: &'a dyn Progress,
}

/// The sample as slices show it.
struct Found {
    seen: Seen,
    bodies: Bodies,
    axis: Axis,
    /// The brightness of the air around it; NaN if none is seen.
    air: f64,
    /// Voxels along a pixel of the means.
    pixel: u32,
}

/// What else is to be known of it.
struct More {
    warnings: Vec<String>,
    other: Option<Cylinder>,
}

impl Scan<'_> {
    /// The sample, of those slices that show one body.
    fn sample<T: Voxel>(&self, seen: Seen) -> Result<Found> {
        let raster = Raster::fine(self.volume);
        let pixels = [seen.raster.pixel, raster.pixel];
        let outlines = seen.outlines();
        let n = outlines.len();
        let outlines = of_one_body(outlines, seen.raster.pixel);
        let Some(first) = outlines.first() else {
            return Err(not_found("no part of the slices that is bright"));
        };
        if (outlines.len() as f64) < MOST * n as f64 {
            let why = "slices that show one body in few of them only, if it is upright";
            return Err(not_found(why));
        }
        let z = f64::from(first.z.midpoint(outlines[outlines.len() - 1].z));
        let hull = Axis::through(&outlines, pixels);
        let hull = hull.unwrap_or(Axis::UNKNOWN);
        let together = |hull: &Axis| {
            let slices: Vec<Moved> = outlines.iter().map(|o| moved(o, hull, z)).collect();
            let pictures = means::<T>(self.volume, &slices, raster, self.progress)?;
            let means = Means::of(pictures, raster);
            Ok(means.bodies().map(|bodies| (means, bodies)))
        };
        let upright = hull.upright();
        let (hull, (means, bodies)) = match together(&hull)? {
            Ok(found) => (hull, found),
            // the outline of two bodies that are upright may seem to move
            Err(_) if hull != upright => (upright, together(&upright)?.map_err(not_found)?),
            Err(why) => return Err(not_found(why)),
        };
        let around = hull.moved_to(&bodies.sample, z);
        let outlines = seen.alike().filter_map(|slice| {
            let circle = around.at(slice.z.into());
            let reach = bodies
                .reach
                .min(1.3 * circle.radius + 2.0 * f64::from(pixels[0]));
            let is_in = |at| circle.off(at) + circle.radius <= reach;
            let outline = slice.outline(bodies.threshold, is_in)?;
            Some(OfSlice {
                z: slice.z,
                outline,
            })
        });
        let outlines = of_one_body(outlines.collect(), pixels[0]);
        Ok(Found {
            axis: Axis::through(&outlines, pixels).unwrap_or(around),
            air: bodies.air(&means.upper),
            pixel: raster.pixel,
            bodies,
            seen,
        })
    }

    /// The cylinder inside of a sample.
    fn cylinder<T: Voxel>(&self, found: &Found) -> Result<FoundCylinder> {
        let extent = Extent {
            volume: self.volume,
            range: self.range,
            seen: &found.seen,
            axis: &found.axis,
            threshold: found.bodies.threshold,
            reach: found.bodies.reach,
            progress: self.progress,
        };
        let shown = extent.find::<T>()?;
        let clear = self.clear(&shown);
        let before = found.axis.middle(&clear).radius;
        let beyond = (extent::RIM * before).max(3.0) + 3.0 * f64::from(found.pixel);
        let rings = Rings::read::<T>(self.volume, &clear, &found.axis, beyond, self.progress)?;
        let rim = Rim::of(&rings, before);
        let axis = found.axis.corrected(&rim);
        let less = f64::from(found.pixel) + rim.blur;
        let cylinder = inside(&axis, &shown.slices, less)?;
        let tilt = axis.degrees(self.volume.header().placement.spacing);
        let others = &found.bodies.others;
        let mut warnings: Vec<String> = others.iter().map(|o| o.warning(found.pixel)).collect();
        let others = others
            .iter()
            .map(|o| self::cylinder(&o.circle, found.pixel));
        let mut others: Vec<Cylinder> = others.collect();
        warnings.extend(found.bodies.not_round.map(warnings::of_beside));
        let ends = found.seen.ends_at(&axis.middle(&clear));
        warnings.extend(ends.then(|| warnings::of_view(&cylinder)));
        warnings.extend(warnings::of_tilt(tilt, axis.moves(&shown.slices)));
        warnings.extend(warnings::of_taper(&axis, &shown.slices));
        warnings.extend(warnings::of_slices(&shown, self.range));
        let blank = found.seen.blank_names(&shown.slices);
        warnings.extend(blank.as_deref().map(warnings::of_blank));
        let doubts = Doubts {
            cylinder: shrunk(&axis.middle(&clear), less),
            to_rim: less,
            spread: rim.spread,
            rings,
            air: found.air,
        };
        let more = self.doubts(found, &cylinder, &rim, &clear, &doubts);
        warnings.extend(more.warnings);
        others.extend(more.other);
        Ok(FoundCylinder {
            cylinder,
            others,
            slices: shown.slices,
            tilt,
            warnings,
        })
    }

    /// The slices that show the sample alone: the last ones before a holder show some of it.
    fn clear(&self, shown: &Shown) -> Range<u32> {
        let Range { start, end } = shown.slices;
        let start = start + 2 * u32::from(start > self.range.start);
        let end = end.saturating_sub(2 * u32::from(end < self.range.end));
        if start < end {
            start..end
        } else {
            shown.slices.clone()
        }
    }

    /// What the cylinder holds besides the sample.
    fn doubts(
        &self,
        found: &Found,
        cylinder: &Cylinder,
        rim: &Rim,
        clear: &Range<u32>,
        doubts: &Doubts,
    ) -> More {
        let slices = found.seen.slices.iter();
        let slices: Vec<&Slice> = slices.filter(|s| clear.contains(&s.z)).collect();
        let at_rim = AtRim {
            cylinder: *cylinder,
            seen: &found.seen,
            axis: &found.axis,
            threshold: found.bodies.threshold,
            reach: found.bodies.reach,
            further: rim.further,
        };
        let air = at_rim.air(&slices).or_else(|| doubts.side());
        let limit = air.as_ref().map_or(f64::INFINITY, |air| {
            doubts.cylinder.radius - air.deepest - 2.0 * doubts.rings.width
        });
        let mut warnings: Vec<String> = air.iter().map(|air| air.warning(cylinder)).collect();
        warnings.extend(doubts.warning_of_odd());
        let [hollow, inner] = doubts.across(limit);
        warnings.extend(hollow.map(warnings::of_hollow));
        let known = found.bodies.others.iter();
        let inside = known.filter(|other| other.kind == bodies::Kind::Inside);
        let is_known = inside.count() > 0;
        let other = inner
            .filter(|_| !is_known && hollow.is_none())
            .map(|radius| Cylinder {
                centre: cylinder.centre,
                radius: rounded(radius - f64::from(found.pixel)),
            });
        warnings.extend(other.as_ref().map(warnings::of_inside));
        More { warnings, other }
    }
}

/// The upright cylinder that ends so much inside of a sample in all slices that show it.
fn inside(axis: &Axis, shown: &Range<u32>, less: f64) -> Result<Cylinder> {
    let moves = axis.moves(shown);
    if moves / 2.0 > axis::MOST_TILTED * axis.middle(shown).radius {
        let why = format!(
            "one that is not upright: its axis moves by {moves:.1} voxels from the lowest to the highest slice"
        );
        return Err(not_found(why));
    }
    let cylinder = shrunk(&axis.inside(shown), less);
    if cylinder.radius < SMALLEST {
        let why = format!(
            "a sample that is too small: the cylinder inside of it would have a radius of {} voxels, and {SMALLEST} is the \
             least",
            cylinder.radius
        );
        return Err(not_found(why));
    }
    Ok(cylinder)
}

/// A slice that is to be moved upon the one in the middle.
fn moved(of: &OfSlice, axis: &Axis, middle: f64) -> Moved {
    let [here, there] = [f64::from(of.z), middle].map(|z| axis.at(z).centre);
    Moved {
        z: of.z,
        by: [0, 1].map(|a| here[a] - there[a]),
    }
}

fn not_found(found: impl Into<String>) -> Error {
    let expected = "a round sample along z, brighter than the air around it";
    Error::usage("--roi cylinder", found.into(), expected)
        .with_hint("give it as --roi cylinder:CX,CY,R in voxels, or as --roi mask:FILE")
}

/// A circle whose rim is that of a sample, as the cylinder that ends inside of it, by the side of a pixel.
fn cylinder(circle: &Circle, pixel: u32) -> Cylinder {
    shrunk(circle, pixel.into())
}

fn shrunk(circle: &Circle, less: f64) -> Cylinder {
    Cylinder {
        centre: circle.centre.map(rounded),
        radius: rounded(circle.radius - less),
    }
}

/// A hundredth of a voxel is more than can be seen.
fn rounded(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

/// Means of slices as pictures.
struct Means {
    /// What a quarter of these show at least.
    upper: Image,
    /// What most of these show.
    middle: Image,
}

impl Means {
    fn of(pictures: Vec<slices::Picture>, raster: Raster) -> Self {
        let hidden = Hidden::of(&pictures, raster);
        let pictures = pictures.into_iter();
        let images: Vec<Image> = pictures.map(|p| hidden.image(p.pixels, raster)).collect();
        let images: Vec<&Image> = images.iter().collect();
        Means {
            upper: upper(&images),
            middle: middle(&images),
        }
    }

    /// What is round in them.
    fn bodies(&self) -> Result<Bodies, String> {
        Bodies::of(&self.upper).map_err(|why| self.nothing().unwrap_or(why))
    }

    /// Why there can be no sample: nothing stands out, or what does is darker than its surroundings.
    fn nothing(&self) -> Option<String> {
        let values = self.middle.pixels.iter().map(|v| f64::from(*v));
        if split(values).is_some_and(|(_, share)| share < ONE_LEVEL) {
            let none = "nothing that is brighter than the rest in those slices that were looked at (of a sample in few slices: \
                        give them, as --crop :,:,Z0:Z1)";
            return Some(none.to_owned());
        }
        let pixels = self.middle.pixels.iter().map(|v| -v).collect();
        let raster = self.middle.raster;
        let dark = Bodies::of(&Image { raster, pixels }).ok()?;
        let found = cylinder(&dark.sample, raster.pixel);
        Some(format!(
            "something round that is darker than what is around it, {found}: if that is the sample, --invert makes it bright"
        ))
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
    fn warning(&self, pixel: u32) -> String {
        let cylinder = cylinder(&self.circle, pixel);
        match self.kind {
            bodies::Kind::Tube => format!(
                "there are two round things: the sample, and a tube around it, {cylinder}; the tube and what is between are not \
                 in the region: give --roi {cylinder} for all of it"
            ),
            bodies::Kind::Beside => format!(
                "there are two round things: the larger one was taken; give --roi {cylinder} for the other"
            ),
            bodies::Kind::Inside => warnings::of_inside(&cylinder),
        }
    }
}
