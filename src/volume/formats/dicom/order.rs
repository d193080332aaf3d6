//! The order of slices in space, and whether they make a regular grid.

use crate::error::{Error, Result};
use crate::grid::{Placement, Unit};
use crate::volume::adapters::resample::Place;
use crate::volume::formats::dicom::frame::{Frame, Image, Plane};
use crate::volume::formats::dicom::pixel;
use crate::words::{counted, things};
use glam::DVec3;
use std::path::Path;

/// Slices may lie this far from their place in a regular grid, in steps of slices. Files give
/// positions with few decimals: a step of 0.625 mm as 0.6 and 0.7 is off by 0.08 steps.
const MAX_OFF: f64 = 0.1;
/// And this far aside, in pixels.
const MAX_ASIDE: f64 = 0.2;

/// Ways out for slices at one place.
const BY_NUMBER: &str = "all slices have the same position: if their InstanceNumber counts them in order, \
                         --spacing X,Y,Z --unit mm reads them in that order";
const AS_STORED: &str = "all frames have the same position: if they are stored in order, --spacing X,Y,Z --unit mm reads \
                         them in that order";
const SEVERAL: &str = "it holds several times, echoes or reconstructions: put the files of one into a folder of their own";

/// Frames in order and where they lie.
#[derive(Debug)]
pub(crate) struct Stack {
    pub(crate) frames: Vec<Frame>,
    /// Place of the first frame; the spacing's z is the mean step.
    pub(crate) placement: Placement,
    /// For each frame its distance from the first along the normal, in millimetres, and how far its
    /// first pixel lies aside of the first frame's, in pixels along x and y.
    pub(crate) places: Vec<Place>,
    /// Frames left out, since they lie where another of the same pixels does, and the last such pair.
    pub(crate) repeated: usize,
    pub(crate) repeats: Option<[String; 2]>,
}

/// A frame as people find it.
pub(crate) fn called(images: &[Image], frame: &Frame) -> String {
    let image = &images[frame.file as usize];
    let name = image.blob.path().display();
    match image.frames.len() {
        1 => format!("{name}"),
        _ => format!("frame {} of {name}", frame.index + 1),
    }
}

/// A frame that says where it lies.
struct Located {
    frame: Frame,
    plane: Plane,
    /// Distance of pixels along x and y.
    pixel: [f64; 2],
}

/// The frames that lie at places of their own, and how many did not.
struct Distinct {
    kept: Vec<Located>,
    repeated: usize,
    repeats: Option<[String; 2]>,
}

/// Orders frames of one size and orientation along their normal. Of those at one place with the same pixels one is
/// kept. Voxels are of the size `given` where the files state none of pixels.
///
/// # Errors
/// [`Error::Unsupported`] if two of different pixels lie at one place, [`Error::Format`] if pixels have no size.
pub(crate) fn stack(
    path: &Path,
    frames: Vec<Frame>,
    images: &[Image],
    given: Option<[f64; 3]>,
) -> Result<Stack> {
    let mut located = located(path, frames, given)?;
    let Some(&Located { plane, pixel, .. }) = located.first() else {
        return Err(Error::format(path, "a series without slices", "slices"));
    };
    let [row, column] = plane.axes.map(DVec3::from);
    let normal = row.cross(column);
    let depth = |at: &Located| normal.dot(at.plane.position.into());
    located.sort_by(|a, b| {
        let order = depth(a).total_cmp(&depth(b));
        order.then((a.frame.file, a.frame.index).cmp(&(b.frame.file, b.frame.index)))
    });
    let span = depth(&located[located.len() - 1]) - depth(&located[0]);
    let distinct = distinct(path, located, images, normal)?;
    let kept = distinct.kept;
    if kept.len() < 2 {
        let found = "DICOM slices that all lie at one place, with the same pixels";
        return Err(Error::format(path, found, "at least 2 slices"));
    }
    let origin = DVec3::from(kept[0].plane.position);
    let places = kept.iter().map(|at| {
        let shift = DVec3::from(at.plane.position) - origin;
        Place {
            depth: normal.dot(shift),
            aside: [row.dot(shift) / pixel[0], column.dot(shift) / pixel[1]],
        }
    });
    let places = places.collect();
    let step = tidy(span / (kept.len() - 1) as f64);
    let placement = Placement {
        spacing: [pixel[0], pixel[1], step],
        unit: Unit::Millimetre,
        origin: origin.into(),
        // adding 0 turns -0 into 0
        directions: [row, column, normal].map(|axis| (axis + DVec3::ZERO).into()),
    };
    Ok(Stack {
        frames: kept.into_iter().map(|at| at.frame).collect(),
        placement,
        places,
        repeated: distinct.repeated,
        repeats: distinct.repeats,
    })
}

/// The frames with the places and sizes of pixels that they state.
fn located(path: &Path, frames: Vec<Frame>, given: Option<[f64; 3]>) -> Result<Vec<Located>> {
    let given = given.map(|[x, y, _]| [x, y]);
    let locate = |frame: Frame| {
        let (Some(plane), Some(pixel)) = (frame.plane, frame.pixel.or(given)) else {
            let found = "a DICOM series without sizes of pixels";
            return Err(
                Error::format(path, found, "PixelSpacing").with_hint("give --spacing and --unit")
            );
        };
        Ok(Located {
            frame,
            plane,
            pixel,
        })
    };
    frames.into_iter().map(locate).collect()
}

/// Keeps one of the frames at one place, given in the order of their places along the normal.
///
/// # Errors
/// [`Error::Unsupported`] if the pixels of two at one place differ.
fn distinct(
    path: &Path,
    located: Vec<Located>,
    images: &[Image],
    normal: DVec3,
) -> Result<Distinct> {
    let depth = |at: &Located| normal.dot(at.plane.position.into());
    let (first, last) = (&located[0], &located[located.len() - 1]);
    let mean = (depth(last) - depth(first)) / (located.len().max(2) - 1) as f64;
    let near = 1e-3 * mean.max(1e-6);
    let alike = located.iter().all(|at| at.plane == first.plane);
    let many = located.iter().any(|at| at.frame.file != first.frame.file);
    let mut out = Distinct {
        kept: Vec::with_capacity(located.len()),
        repeated: 0,
        repeats: None,
    };
    for next in located {
        match out.kept.last() {
            Some(last) if depth(&next) - depth(last) <= near => {
                let names = [called(images, &last.frame), called(images, &next.frame)];
                if !pixel::same(images, &last.frame, &next.frame)? {
                    let hint = match (alike, many) {
                        (true, true) => BY_NUMBER,
                        (true, false) => AS_STORED,
                        (false, _) => SEVERAL,
                    };
                    return Err(together(path, names, last.plane.position, hint));
                }
                out.repeated += 1;
                out.repeats = Some(names);
            }
            _ => out.kept.push(next),
        }
    }
    Ok(out)
}

/// A quotient without the noise of its last digits: positions are decimals, and 0.05 is not 0.049999999999999996.
fn tidy(step: f64) -> f64 {
    format!("{step:.11e}").parse().unwrap_or(step)
}

/// The refusal of two slices at one place.
fn together(path: &Path, [one, other]: [String; 2], place: [f64; 3], hint: &str) -> Error {
    let [x, y, z] = place;
    let what = format!(
        "a DICOM series with two slices at one place, ({x}, {y}, {z}) mm, of other pixels each: {one} and {other},"
    );
    Error::unsupported(path, what, hint)
}

impl Stack {
    /// What keeps the slices from being a regular grid, with its numbers; `None` if nothing does.
    pub(crate) fn irregular(&self) -> Option<String> {
        let [sx, sy, step] = self.placement.spacing;
        let off = |(k, p): (usize, &Place)| (p.depth - k as f64 * step).abs();
        let uneven = self.places.iter().enumerate().map(off).fold(0.0, f64::max) > MAX_OFF * step;
        let aside = |p: &Place| p.aside[0].abs().max(p.aside[1].abs());
        let sheared = self.places.iter().map(aside).fold(0.0, f64::max) > MAX_ASIDE;
        let mut parts = Vec::new();
        if uneven {
            parts.push(self.uneven());
        }
        if sheared {
            let last = self
                .places
                .iter()
                .max_by(|a, b| aside(a).total_cmp(&aside(b)));
            let [u, v] = last.map_or([0.0; 2], |p| [p.aside[0] * sx, p.aside[1] * sy]);
            let depth = last.map_or(1.0, |p| p.depth);
            let angle = libm::atan2(libm::hypot(u, v), depth).to_degrees();
            parts.push(format!(
                "slices shifted sideways by up to {:.2} mm (a gantry tilt of {angle:.1} degrees)",
                libm::hypot(u, v)
            ));
        }
        (!parts.is_empty()).then(|| parts.join(" and "))
    }

    /// What to say of frames left out.
    pub(crate) fn note(&self) -> Option<String> {
        let [one, other] = self.repeats.as_ref()?;
        Some(format!(
            "{} the place and the pixels of another, as {other} those of {one}: each place counts once",
            counted(self.repeated as u64, "slice has", "slices have")
        ))
    }

    fn steps(&self) -> Vec<f64> {
        let pairs = self.places.windows(2);
        pairs.map(|p| p[1].depth - p[0].depth).collect()
    }

    fn uneven(&self) -> String {
        let steps = self.steps();
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
        let middle = sorted[(sorted.len() - 1) / 2];
        let near = |s: f64| (s - middle).abs() <= MAX_OFF * middle;
        let times = |s: f64| {
            let n = (s / middle).round();
            n >= 1.0 && (s - n * middle).abs() <= MAX_OFF * middle
        };
        let gaps: Vec<usize> = (0..steps.len()).filter(|&i| !near(steps[i])).collect();
        if let Some(&first) = gaps.first()
            && steps.iter().all(|&s| times(s))
        {
            let lost: f64 = gaps
                .iter()
                .map(|&i| (steps[i] / middle).round() - 1.0)
                .sum();
            return format!(
                "{}, the first after slice {} (steps of {middle:.3} mm, there {:.3})",
                things(lost as u64, "missing slice"),
                first + 1,
                steps[first]
            );
        }
        format!("uneven steps between slices, from {least:.3} to {most:.3} mm")
    }
}
